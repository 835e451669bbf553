"""A Stewart platform leans as far as its legs let it, twice round: seven quaternions in six closed loops.

The platform floats, each leg stands on a ball joint and ends in one. Wanted are a place and a way of leaning over time;
strokes, their speeds and the motors have limits, and what is found is the nearest that keeps to them.

    python examples/27_stewart_platform.py --out pictures
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import leastaction as la
from leastaction.costs import OrientationCost, PlaceCost
from leastaction.mechanics.description.shapes import Shape
from leastaction.viz import plot_poses, plot_run, save_png

T, LEGS = np.linspace(0.0, 2.0, 81), range(6)
HOME = np.array([0.0, 0.0, 0.95])
LOW, HIGH = np.radians([[-10, 10, 110, 130, 230, 250], [-50, 50, 70, 170, 190, 290]])
FEET, SOCKETS = (size * np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1) for size, a in ((1.0, LOW), (0.55, HIGH)))
PLATFORM = la.free("platform", axes="quaternion", mass=30.0, inertia=(2.2, 2.2, 4.0))
LEG = {"axes": "quaternion", "mass": 2.0, "com": (0.0, 0.0, 0.3), "inertia": (0.06, 0.06, 2e-3)}
ROD = {"mass": 1.0, "com": (0.0, 0.0, -0.3), "inertia": (0.03, 0.03, 1e-3)}
TREE = [PLATFORM, [*(la.pose(translation=SOCKETS[i], name=f"socket {i}") for i in LEGS), la.tz(0.5, name="mast")]]
for i in LEGS:
    TREE += [la.pose(translation=FEET[i]), [la.ball(f"leg {i}", **LEG), [la.tz(f"stroke {i}", name=f"rod {i}", **ROD)]]]
BALLS = [la.PointToPoint(f"rod {i}", f"socket {i}") for i in LEGS]
STEWART = la.Mechanism(TREE, [la.Gravity(), *BALLS, *(la.JointForce(f"stroke {i}", input=f"push {i}") for i in LEGS)])


def lean(t: float) -> np.ndarray:
    """Return the orientation that is wanted: up to 34 degrees, about an axis that goes round twice."""
    vector = 0.6 * np.sin(np.pi * t / 2.0) ** 2 * np.array([np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t), 0.0])
    return Rotation.from_rotvec(vector).as_matrix()


def solve() -> la.OptimizationResult:
    """Return the motion that is nearest to what is wanted, begun with a platform that is held still."""
    system, level = la.MidpointSystem(la.MidpointVI(STEWART), T), {"platform.z": HOME[2]}
    for i, way in enumerate(HOME + SOCKETS - FEET):  # each leg points from its foot to its socket
        turn = Rotation.align_vectors([way], [HOME])[0].as_quat()
        level |= dict(zip((f"leg {i}.q{letter}" for letter in "xyzw"), turn, strict=True))
        level[f"stroke {i}"] = np.linalg.norm(way)
    x0, hold = system.integrator.start(STEWART.configuration(level)).x, np.full(6, 80.0)  # N, about what carries it
    effort = la.QuadraticCost(x0, hold, Q=np.zeros(system.ndx), R=[1e-6] * 6, space=system)
    placed = PlaceCost(effort, system, {"platform": HOME}, {"platform": 100.0})
    cost = OrientationCost(placed, system, {"platform": lean}, {"platform": 100.0})
    ends, speeds = la.Bound("stroke *", 0.9, 1.35), la.Bound("stroke *", -1.0, 1.0, of="rate")  # m, m/s
    limits = [ends, speeds, la.Bound("push *", -50.0, 250.0)]  # N
    return la.optimize(system, cost, initial=(x0, np.tile(hold, (80, 1))), limits=limits)


def main(output: Path) -> la.OptimizationResult:
    """Optimise, print and draw."""
    found = solve()
    q, mast = found.trajectory.q, STEWART.positions(found.trajectory.q, ["mast"])[:, 0]
    print(f"{found.status.name} in {found.iterations} iterations; {STEWART.nv} rates, {STEWART.nc} constraints")
    print(f"leans by up to {np.degrees(np.arccos(2.0 * (mast - q[:, :3])[:, 2].min())):.1f} degrees of 34.4")
    print(f"loops closed to {np.abs(STEWART.constraint_values(q)).max():.0e} m")
    output.mkdir(parents=True, exist_ok=True)
    dark, light, orange, blue = (0.25, 0.29, 0.36, 1), (0.7, 0.74, 0.8, 1), (0.93, 0.5, 0.13, 1), (0.0, 0.45, 0.7, 1)
    bars = [("platform", a, b, 0.02, orange) for a, b in pairwise([*SOCKETS, SOCKETS[0], 0.0 * HOME, HOME / 1.9])]
    bars += [(f"leg {i}", 0.0 * HOME, 0.75 * HOME, 0.04, dark) for i in LEGS]
    bars += [(f"rod {i}", 0.0 * HOME, -0.75 * HOME, 0.02, light) for i in LEGS]
    bars += [("world", a, b, 0.008, blue) for a, b in pairwise(mast)]
    poses = plot_poses(found, [0.5, 1.25], shapes=[Shape.rod(*bar) for bar in bars])
    save_png([poses, plot_run(found, ["stroke *"])], output / "27_stewart_platform.png", dpi=110)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
