"""An arm on one string waves as keyframes say: planned, calmed, and with a string that pulls (dissertation 6.7.2).

The arm of two links hangs from a carriage that moves along a rail and reels its string in and out. An animation
gives the two angles over eight seconds and knows nothing of strings; the place of the carriage and the length of the
string are found. A price on their acceleration keeps the carriage calm.

    python examples/09_puppet_arm.py --out pictures
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

import leastaction as la
from leastaction.models.puppet_arm import hang, puppet_arm
from leastaction.viz import plot_poses, plot_reactions, plot_run, save_png

# Keyframes: time (s), angles of shoulder and elbow (degrees). Up, three waves, down.
KEYS = np.array([
    (0.0, 20.0, 30.0), (0.5, 20.0, 30.0), (2.0, 65.0, 65.0), (2.5, 65.0, 35.0), (3.0, 65.0, 95.0), (3.5, 65.0, 35.0),
    (4.0, 65.0, 95.0), (4.5, 65.0, 35.0), (5.0, 65.0, 95.0), (5.5, 65.0, 65.0), (7.0, 20.0, 30.0), (8.0, 20.0, 30.0),
])  # fmt: skip
T = np.linspace(0.0, 8.0, 401)
ANIMATION = np.radians(PchipInterpolator(KEYS[:, 0], KEYS[:, 1:])(T))


def solve() -> dict[str, la.OptimizationResult]:
    """Plan as it is, with a price on accelerations of the string's end, and with a string that only pulls."""
    system = la.MidpointSystem(la.MidpointVI(puppet_arm()), T, multipliers=True)
    # State: two angles, carriage and string, two momenta, two speeds, the multiplier. What the animation says
    # nothing of is wanted to be zero, at next to no weight.
    wanted = np.hstack([ANIMATION, np.zeros((len(T), system.nx - 2))])
    Q = [100.0, 100.0, 1e-6, 1e-6, 1e-6, 1e-6, 0.01, 0.01, 0.0]
    cost = la.QuadraticCost(wanted, np.zeros((system.N, 2)), Q=Q, R=[1e-4, 1e-4])
    q = hang(system.mechanism, ANIMATION[0])
    rest = np.r_[system.integrator.start(q).x, 0.0], np.tile(q[2:], (system.N, 1))
    with warnings.catch_warnings(action="ignore"):  # so jagged are its strings that the energy does not balance
        free = la.optimize(system, cost, initial=rest)
    smooth = la.costs.SmoothCost(cost, system, {"string-*": 1e-3})
    calm = la.optimize(system, smooth, initial=free)
    limits = [la.Bound("string", min=0.2, of="tension")]
    pulled = la.optimize(system, smooth, initial=calm, limits=limits)
    return {"as it is": free, "smooth": calm, "smooth, pulls only": pulled}


def main(output: Path) -> None:
    """Plan, print and draw."""
    plans = solve()
    for name, run in plans.items():
        off = np.degrees(np.sqrt(np.mean((run.x[:, :2] - ANIMATION) ** 2)))
        pull = run.trajectory.tensions()["string"][1:]  # the first is of half an impulse
        print(f"{name:19} off by {off:.2f} degrees (rms), string pulls with {pull.min():.1f} to {pull.max():.1f} N")
    output.mkdir(parents=True, exist_ok=True)
    shown = {name: plans[name] for name in ("as it is", "smooth, pulls only")}  # without the limit as with it
    figures = [
        plot_poses(run, [0.0, 2.5, 3.0]),
        plot_run(shown, ["shoulder", "elbow", "string-*"], reference=ANIMATION, title="Plans"),
        plot_reactions(run, title="Tension of the string that only pulls"),
    ]
    save_png(figures, output / "09_puppet_arm.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
