"""A satellite turns round in least time by three wheels, and its telescope never looks near the sun.

Motors and wheels have limits, so that it is full power one way and then the other; the attitude is a quaternion, to
which half a turn is nothing special. The straight way would pass by the sun: a cone about that is left out, which takes
a third of a second longer.

    python examples/25_satellite.py --out pictures
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.limits import Bound, Equal, FinalTime, Oriented, Pointing
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics import rotations
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 10.0, 61)
AXIS, SUN = np.array([-0.1, -0.6, -0.8]) / np.sqrt(1.01), np.array([0.0, -0.75, 0.66]) / np.sqrt(0.9981)
PATHS = (0.8, 0.8, 0.8, 1.0), (0.0, 0.45, 0.7, 1.0)
NEAR = 0.4  # how near to the sun the telescope must not look (rad)
WHEELS = [turn(f"wheel {axis}", mass=1.0, inertia=(0.01 + 0.01 * np.eye(3))[i])
          for i, (axis, turn) in enumerate(zip("xyz", (la.rx, la.ry, la.rz), strict=True))]  # fmt: skip
HULL = la.ball("hull", axes="quaternion", mass=40.0, inertia=(3.0, 2.4, 1.8))
MOTORS = [la.JointForce(f"wheel {axis}", input=f"motor {axis}") for axis in "xyz"]
SATELLITE = la.Mechanism([HULL, [*WHEELS, la.tx(1.3, name="sight")]], MOTORS)


def solve(*, sun: bool) -> la.OptimizationResult:
    """Return the fastest way round, begun with a straight one that no motor made."""
    system = la.MidpointSystem(la.MidpointVI(SATELLITE), T)
    s = (T / T[-1])[:, None]
    x = np.tile(system.integrator.start(SATELLITE.configuration()).x, (61, 1))
    x[:, :4] = rotations.exponential(np.pi * s * s * (3.0 - 2.0 * s) * AXIS)
    effort = la.QuadraticCost(x[0], np.zeros((60, 3)), Q=np.zeros(system.ndx), R=[1e-3] * 3, space=system)
    limits = [
        Bound("motor *", -0.3, 0.3), Bound("wheel *", -1.0, 1.0, of="momentum"),  # N m, N m s
        Oriented("hull", 2.0 * np.outer(AXIS, AXIS) - np.eye(3), at="end"),
        Equal("wheel *", 0.0, of="momentum"),  # at rest, as the momentum of the whole is zero
        *([Pointing("hull", (1, 0, 0), SUN, beyond=NEAR)] if sun else []),
    ]  # fmt: skip
    return la.optimize(system, effort, initial=(x, np.zeros((60, 3))), limits=limits, unknowns=[FinalTime(price=1.0)])


def main(output: Path) -> la.OptimizationResult:
    """Optimise, print and draw."""
    free, found = (solve(sun=sun) for sun in (False, True))
    sights = [SATELLITE.positions(run.trajectory.q, ["sight"])[:, 0] for run in (free, found)]
    for name, run, sight in zip(("straight at the sun", "around it"), (free, found), sights, strict=True):
        off = np.degrees(np.arccos(sight @ SUN / 1.3)).min()
        print(f"{name}: {run.t[-1]:.2f} s, {off:.1f} degrees off it at least; {run.status.name} in {run.iterations}")
    print(f"motors at their limits for {100 * np.mean(np.abs(found.u) > 0.299):.0f} % of the time")
    output.mkdir(parents=True, exist_ok=True)
    shapes = [
        Shape(frame="hull", kind="box", size=np.array([0.6, 0.5, 0.5]), color=(0.85, 0.7, 0.35, 1.0)),
        Shape.rod("hull", (0.3, 0, 0), (0.45, 0, 0), 0.12, (0.25, 0.25, 0.28, 1.0)),
        *[Shape(frame="hull", kind="box", size=np.array([0.4, 0.9, 0.02]), color=(0.15, 0.25, 0.5, 1.0),
                pose=np.eye(4) + np.outer((0, y, 0, 0), (0, 0, 0, 1))) for y in (-0.75, 0.75)],
        Shape.rod("world", 1.3 * SUN, 1.301 * SUN, 1.3 * np.sin(NEAR), (1.0, 0.8, 0.1, 1.0)),
        *[Shape.rod("world", a, b, 0.012, color) for sight, color in zip(sights, PATHS, strict=True)
          for a, b in pairwise(sight)],
    ]  # fmt: skip
    poses = plot_poses(found, np.linspace(0.0, 1.0, 3) * found.t[-1], shapes=shapes)
    save_png([poses, plot_run(found, ["motor *", "p_wheel *"])], output / "25_satellite.png", dpi=110)
    la.show(found, shapes=shapes, title="Satellite").save(output / "25_satellite.html")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
