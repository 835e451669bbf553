"""A quadrotor turns a somersault through a ring, upside down, and hovers again: by four rotors that only push.

The attitude goes all the way round, through every angle at which three angles fail. Wanted are the hover before and
after, and the ring in the middle; a line between them that turns once is the start, with gaps between its steps.

    python examples/26_quadrotor.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.elements import BodyWrench, Drag
from leastaction.limits import Bound, Box, Equal, Keep, Oriented, Pointing
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics import rotations

T = np.linspace(0.0, 1.6, 81)
ROTORS = {"front": (0.17, 0.0, 1), "left": (0.0, 0.17, -1), "back": (-0.17, 0.0, 1), "right": (0.0, -0.17, -1)}
DRONE = la.Mechanism(
    [la.free("drone", axes="quaternion", mass=0.5, inertia=(2.3e-3, 2.3e-3, 4e-3)),
     [la.pose(translation=(x, y, 0.02), name=name) for name, (x, y, _) in ROTORS.items()]],
    [la.Gravity(), Drag("drone", 0.02, smoothing=0.1), *[BodyWrench(name, (0, 0, name), (0, 0, {name: 0.016 * turns}))
                                                         for name, (*_, turns) in ROTORS.items()]],
)  # fmt: skip
LOOK = [Shape.rod("drone", (-0.17, 0, 0), (0.17, 0, 0), 0.012), Shape.rod("drone", (0, -0.17, 0), (0, 0.17, 0), 0.012),
        Shape.rod("drone", (-0.03, 0, 0.01), (0.03, 0, 0.01), 0.035, (0.25, 0.3, 0.4, 1.0)),
        *[Shape(frame="drone", kind="cylinder", size=np.array([0.085, 0.008]), color=(0.85, 0.3, 0.15, 1.0),
                pose=np.eye(4) + np.outer((x, y, 0.025, 0), (0, 0, 0, 1))) for x, y, _ in ROTORS.values()]]  # fmt: skip


def solve() -> la.OptimizationResult:
    """Return the somersault of least effort."""
    system = la.MidpointSystem(la.MidpointVI(DRONE), T)
    s = (3.0 - 2.0 * T[:, None] / T[-1]) * (T[:, None] / T[-1]) ** 2
    x = np.tile(system.integrator.start(DRONE.configuration({"drone.y": -1.2, "drone.z": 1.0})).x, (81, 1))
    x[:, 1:2], x[:, 3:7] = 2.4 * s - 1.2, rotations.exponential(2.0 * np.pi * s * np.array([-1.0, 0.0, 0.0]))
    hover = np.full(4, 0.5 * 9.81 / 4.0)
    effort = la.QuadraticCost(x[0], hover, Q=np.zeros(system.ndx), R=[0.01] * 4, space=system)
    limits = [
        Bound(list(ROTORS), 0.0, 3.0),  # N
        Equal(["drone.x", "drone.y", "drone.z"], [0.0, 1.2, 1.0]), Oriented("drone", np.eye(3), at="end"),
        Equal("*", 0.0, of="momentum"),
        Keep("drone", inside=Box((-0.05, -0.02, 1.25), (0.05, 0.02, 1.35)), at=0.8),
        Pointing("drone", (0, 1, 0), (0, 0, -1), within=0.5, at=0.64),  # head first, on its back, feet first
        Pointing("drone", (0, 0, 1), (0, 0, -1), within=0.2, at=0.8),
        Pointing("drone", (0, 1, 0), (0, 0, 1), within=0.5, at=0.96),
    ]  # fmt: skip
    return la.optimize(system, effort, initial=(x, np.tile(hover, (80, 1))), limits=limits, shooting="multiple")


def main(output: Path) -> la.OptimizationResult:
    """Optimise, print and draw."""
    found = solve()
    print(f"{found.status.name} in {found.iterations} iterations")
    print(f"it turns at up to {-np.degrees(found.trajectory.v[:, 3].min()):.0f} degrees a second")
    print(f"rotors push with {found.u.min():.2f} to {found.u.max():.2f} N")
    output.mkdir(parents=True, exist_ok=True)
    angles = np.linspace(0.0, 2.0 * np.pi, 41)
    ring = np.stack([0.4 * np.cos(angles), 0.0 * angles, 1.3 + 0.4 * np.sin(angles)], axis=1)
    shapes = [Shape.rod("world", a, b, 0.02, (0.95, 0.75, 0.2, 1.0)) for a, b in pairwise(ring)]
    flown = DRONE.frame_pose(found.trajectory.q[[0, 20, 30, 36, 40, 45, 50, 62, 80]], "drone")
    look = shapes + [replace(each, frame="world", pose=pose @ each.pose) for pose in flown for each in LOOK]
    la.show(found, shapes=look).seen_from(20, 14, nearer=1.6).save(output / "26_quadrotor.png", at=0.8, size=(840, 520))
    la.show(found, shapes=shapes + LOOK, title="Quadrotor").save(output / "26_quadrotor.html")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
