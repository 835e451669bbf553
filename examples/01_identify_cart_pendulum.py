"""Identify a pendulum on a cart: damping, mass and length from a measured motion, by exact derivatives.

The cart is pushed by a known force; its place and the angle of the pendulum are measured with noise. One call of
`MidpointVI.sensitivity` gives the derivatives of the whole motion by the numbers that `least_squares` looks for.

    python examples/01_identify_cart_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import leastaction as la
from leastaction.viz import plot_run, save_png

NAMES = ["damping.x", "damping.theta", "bob.mass", "bob.value"]  # the last is where the bob is along y (m)
TRUTH, GUESS = np.array([1.2, 0.05, 0.8, -0.6]), np.array([0.3, 0.01, 0.5, -0.5])
NOISE = np.array([0.02, 0.04])  # of the place (m) and of the angle (rad)
T = np.linspace(0.0, 8.0, 801)
CART = la.Mechanism(
    [la.tx("x", name="cart", mass=2.0), [la.rz("theta"), [la.ty(-0.5, name="bob", mass=0.5)]]],
    [la.Gravity((0.0, -9.81, 0.0)), la.Damping({"x": 0.3, "theta": 0.01}), la.JointForce("x", input="push")],
)


def simulate(numbers: np.ndarray) -> la.Trajectory:
    """Return the motion under the known push with these numbers; nothing is compiled again."""
    vi = la.MidpointVI(CART.with_parameters(dict(zip(NAMES, numbers.tolist(), strict=True))))
    push = 6.0 * np.sin(2.0 * T + 0.35 * T**2) * np.exp(-((T / 6.0) ** 4))
    return vi.simulate(vi.start([0.0, 0.4]), T, inputs=push[:-1, None])


def identify(measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers whose motion is closest to the measured one, and their standard errors."""

    def slopes(numbers: np.ndarray) -> np.ndarray:
        run = simulate(numbers)
        by = la.MidpointVI(run.mechanism).sensitivity(run, NAMES, v=np.zeros(2)).x[:, :2]
        return (by / NOISE[:, None]).reshape(-1, len(NAMES))

    def off(numbers: np.ndarray) -> np.ndarray:
        return ((simulate(numbers).q - measured) / NOISE).ravel()

    fit = least_squares(off, GUESS, jac=slopes, x_scale=np.abs(GUESS))
    return fit.x, np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))


def main(output: Path) -> None:
    """Identify, print and draw."""
    measured = simulate(TRUTH).q + NOISE * np.random.default_rng(2012).standard_normal((len(T), 2))
    found, errors = identify(measured)
    for name, guess, number, error, truth in zip(NAMES, GUESS, found, errors, TRUTH, strict=True):
        print(f"{name:13} guessed {guess:5.2f}, found {number:7.4f} +- {error:.4f}, in truth {truth:g}")
    output.mkdir(parents=True, exist_ok=True)
    runs = {"fit": simulate(found), "first guess": simulate(GUESS)}
    figure = plot_run(runs, ["x", "theta"], reference=measured, title="Fit to what was measured")
    save_png(figure, output / "01_identify_cart_pendulum.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
