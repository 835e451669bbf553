"""A pendulum on a cart is to swing up, stand, and swing down again; only the cart is pushed (dissertation 6.7.1).

Where the pendulum is level the push has no hold on it, and a search that starts from hanging may end below. With a
torque at the pivot, whose price rises until it is not used any more, the motion is found: dynamic embedding.

    python examples/06_cart_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.viz import plot_convergence, plot_run, save_png

T = np.linspace(0.0, 10.0, 1001)
WANTED = np.zeros((1001, 4))  # up from 3 s on, upright at 5 s, hanging again at 7 s; all else zero
WANTED[:, 1] = 0.5 * np.pi * (1.0 - np.cos(2.0 * np.pi * np.clip((T - 3.0) / 4.0, 0.0, 1.0)))


def posed(torque: float | None) -> tuple[la.MidpointSystem, la.QuadraticCost]:
    """Return the problem, with a torque at the pivot that has a price or without one."""
    R = [1e-3] if torque is None else [1e-3, torque]
    system = la.MidpointSystem(la.MidpointVI(cart_pendulum(pivot_torque=torque is not None)), T)
    return system, la.QuadraticCost(WANTED, np.zeros((1000, len(R))), Q=[1e-3, 1e3, 1e-3, 1e-3], R=R)


def solve() -> list[la.OptimizationResult]:
    """Return the optimisations, each from the one before: with ever dearer torque, and without it."""
    x, u, runs = np.zeros((1001, 4)), np.zeros((1000, 2)), []
    for torque in (1e-2, 1e1, 1e3, None):
        runs.append(la.optimize(*posed(torque), initial=(x, u if torque is not None else u[:, :1]), tolerance=1e-12))
        x, u = runs[-1].x, runs[-1].u
    return runs


def main(output: Path) -> None:
    """Optimise, print and draw."""
    runs = solve()
    best = runs[-1]
    most = float(np.abs(best.u).max())
    limits = [la.Bound("x-force", -0.67 * most, 0.67 * most)]
    bounded = la.optimize(*posed(None), initial=best, limits=limits)
    print("iterations: " + " + ".join(str(run.iterations) for run in runs))
    print(f"it swings up to {np.degrees(best['theta'].max()):.0f} degrees with at most {most:.0f} N")
    print(f"with at most {0.67 * most:.0f} N the cost is {bounded.cost:.0f} instead of {best.cost:.0f}")
    output.mkdir(parents=True, exist_ok=True)
    figures = [
        plot_run({"free push": best, "bounded push": bounded}, ["theta", "x-force"], reference=WANTED),
        plot_convergence(runs[1], title="The second of four"),
    ]
    save_png(figures, output / "06_cart_pendulum.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
