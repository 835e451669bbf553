"""A cat that falls on its back lands on its feet: it only bends, its angular momentum is zero all the while.

The body turns as a rotation that is a quaternion, so no attitude is special; the back is a bend and a sway, shared by
both ends of the spine. Found is how the back moves: within what it can bend, in the time of the fall, and smoothly.

    python examples/24_falling_cat.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.costs import SmoothCost
from leastaction.limits import Bound, Equal, Pointing
from leastaction.mechanics.description.shapes import Shape
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 0.6, 61)  # a fall of 1.8 m, seen from beside it: all falls alike, so weight is left out
HALF = {"mass": 1.4, "inertia": (0.003, 0.009, 0.009)}
BACK = {"axes": "yz", "kinematic": True}
SPINE = la.universal(["bend", "sway"], name="waist", mass=0.6, com=(-0.04, 0.0, 0.0), inertia=(8e-4,) * 3, **BACK)
REAR = la.universal(["bend", "sway"], name="rear", com=(-0.12, 0.0, 0.0), **HALF, **BACK)
CAT = la.Mechanism([la.free("front", axes="quaternion", com=(0.12, 0.0, 0.0), **HALF), [SPINE, [la.tx(-0.08), [REAR]]]])
FUR, DARK, PALE = (0.9, 0.55, 0.2, 1.0), (0.55, 0.3, 0.12, 1.0), (0.98, 0.92, 0.84, 1.0)
LIMBS = [  # frame, from, to, radius (m), colour
    ("front", (0.0, 0, 0.0), (0.2, 0, 0.0), 0.055, FUR), ("waist", (0.0, 0, 0.0), (-0.08, 0, 0.0), 0.052, DARK),
    ("rear", (0.0, 0, 0.0), (-0.18, 0, 0.0), 0.055, FUR), ("front", (0.2, 0, 0.0), (0.27, 0, 0.06), 0.03, FUR),
    ("front", (0.28, 0, 0.07), (0.31, 0, 0.06), 0.05, FUR), ("front", (0.34, 0, 0.05), (0.355, 0, 0.04), 0.022, PALE),
    ("rear", (-0.18, 0, 0.02), (-0.28, 0, 0.1), 0.016, DARK), ("rear", (-0.28, 0, 0.1), (-0.34, 0, 0.22), 0.014, DARK),
    *[("front", (0.28, 0.03 * side, 0.1), (0.275, 0.04 * side, 0.14), 0.014, DARK) for side in (-1, 1)],
    *[("front", (0.16, 0.045 * side, 0.0), (0.18, 0.05 * side, -0.15), 0.02, FUR) for side in (-1, 1)],
    *[("rear", (-0.15, 0.045 * side, 0.0), (-0.14, 0.05 * side, -0.15), 0.022, FUR) for side in (-1, 1)],
    *[("front", (0.175, 0.05 * side, -0.16), (0.2, 0.05 * side, -0.165), 0.021, PALE) for side in (-1, 1)],
    *[("rear", (-0.145, 0.05 * side, -0.16), (-0.12, 0.05 * side, -0.165), 0.021, PALE) for side in (-1, 1)],
]  # fmt: skip


def solve() -> la.OptimizationResult:
    """Return the motion that is smoothest, begun with a back that goes round once and turns the cat too little."""
    system = la.MidpointSystem(la.MidpointVI(CAT), T)
    start = system.integrator.start(CAT.configuration({"front.qw": 0.0, "front.qx": 1.0})).x
    s = T[1:, None] / T[-1]
    u = -0.65 * np.sqrt(np.sin(np.pi * s)) * np.hstack([np.cos(2.0 * np.pi * s), np.sin(2.0 * np.pi * s)])
    cost = la.QuadraticCost(start, np.zeros((60, 2)), Q=np.zeros(system.ndx), R=[100.0, 100.0], space=system)
    limits = [
        Bound("bend", -0.4, 0.8), Bound("sway", -0.6, 0.6),  # of each of both joints (rad)
        Pointing("rear", (1, 0, 0), (1, 0, 0), within=1.3, origin="front"),  # of all of the back
        Pointing("front", (0, 0, 1), (0, 0, 1), within=0.03, at="end"),  # on its feet
        Equal(["bend", "sway"], 0.0), Equal(["bend", "sway"], 0.0, of="rate"),
    ]  # fmt: skip
    return la.optimize(system, SmoothCost(cost, system, {"bend": 1.0, "sway": 3.0}), initial=(start, u), limits=limits)


def main(output: Path) -> la.OptimizationResult:
    """Optimise, print and draw."""
    found = solve()
    up = CAT.frame_pose(found.x[:, : CAT.nq], "front")[:, 2, 2].clip(-1.0, 1.0)
    bent, swayed = (2.0 * np.degrees(np.abs(found[name]).max()) for name in ("bend", "sway"))
    print(f"{found.status.name} in {found.iterations} iterations")
    print(f"it turns over by {np.degrees(np.ptp(np.arccos(up))):.0f} degrees in {T[-1]:g} s")
    print(f"it bends by up to {bent:.0f} degrees, aside by {swayed:.0f}")
    print(f"its angular momentum stays zero: {bool(np.abs(found.trajectory.p).max() < 1e-12)}")
    output.mkdir(parents=True, exist_ok=True)
    shapes = [Shape.rod(*each) for each in LIMBS]
    figures = [plot_poses(found, times, shapes=shapes) for times in ([0.0, 0.16, 0.26], [0.36, 0.46, 0.6])]
    save_png([*figures, plot_run(found, ["bend", "sway"])], output / "24_falling_cat.png", dpi=110)
    la.show(found, shapes=shapes, title="Falling cat").save(output / "24_falling_cat.html")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
