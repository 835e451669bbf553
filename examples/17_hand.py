"""A hand closes to a fist and opens again, under twenty-five tendons that can only pull.

Sixteen joints, every bone a rigid body, and five tendons a finger whose force depends on their length (dissertation
6.7.4). Without limits more than half of all tensions come out negative: the optimiser pushes with strings. With
`Bound("*", min=0.0, of="input")` none is.

    python examples/17_hand.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.hand import hand, posture
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 2.0, 201)
EFFORT = 1e-5  # price of half the square of a tension (N), where a joint that is off by a radian costs a half
HAND = hand()


def eased(start: float) -> np.ndarray:
    """Return a smooth rise from 0 to 1 in 0.6 s."""
    s = np.clip((T - start) / 0.6, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


WANTED = posture(HAND, eased(0.2) - eased(1.2))  # angles (201, 16): open, a fist in 0.6 s, held, and open again


def solve() -> tuple[la.OptimizationResult, la.OptimizationResult]:
    """Return the motion without limits, and from there the one under tendons that only pull."""
    system = la.MidpointSystem(la.MidpointVI(HAND), T)
    curve, slack = np.hstack([WANTED, np.zeros_like(WANTED)]), np.zeros((system.N, system.nu))
    last = [100.0] * HAND.nq + [1e8] * HAND.nq  # the last state stands for what would follow: the hand stays
    weights = {"Q": [1.0] * HAND.nq + [0.0] * HAND.nq, "R": [EFFORT] * HAND.n_inputs, "Q_final": last}
    cost = la.QuadraticCost(curve, slack, **weights)
    free = la.optimize(system, cost, initial=(curve, slack))
    return free, la.optimize(system, cost, initial=free, limits=[la.Bound("*", min=0.0, of="input")])


def off(run: la.OptimizationResult) -> np.ndarray:
    """Return how far the angles of a motion are from the wanted ones (201, 16) (degrees)."""
    return np.degrees(run.x[:, : HAND.nq] - WANTED)


def main(output: Path) -> None:
    """Optimise, print and draw."""
    free, pulled = solve()
    for name, run in (("without limits", free), ("pulling only", pulled)):
        apart, share = off(run), 100.0 * np.mean(run.u < 0.0)
        rms, third = np.sqrt(np.mean(apart**2)), np.sqrt(np.mean(apart[:, HAND.variables.index("middle.dip")] ** 2))
        print(f"{name:15} {run.status.name} in {run.iterations} iterations, cost {run.cost:.4f}")
        print(f"{'':15} {share:.0f} % of the tensions negative, {run.u.min():.2f} to {run.u.max():.1f} N")
        print(f"{'':15} off by {rms:.3f} degrees rms, {np.abs(apart).max():.2f} at most; last of the third {third:.3f}")
    output.mkdir(parents=True, exist_ok=True)
    runs = {"pulling only": pulled, "without limits": free}
    figures = [
        plot_poses(pulled, [0.0, 0.45, 1.0]),
        plot_run(runs, "middle.*", reference=WANTED, title="Middle finger: angles, and tensions (N)"),
    ]
    save_png(figures, output / "17_hand.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
