"""Identify a pendulum on a cart: damping, mass and length from a measured motion, with their standard errors.

The cart is pushed by a known force; its place and the angle of the pendulum are measured with noise.

    python examples/01_identify_cart_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.identification import Experiment, identify
from leastaction.viz import save_png

# In truth; the last is where the bob is along y (m).
TRUTH = {"damping.x": 1.2, "damping.theta": 0.05, "bob.mass": 0.8, "bob.value": -0.6}
NOISE = {"x": 0.02, "theta": 0.04}  # of the place (m) and of the angle (rad)
T = np.linspace(0.0, 8.0, 801)
PUSH = 6.0 * np.sin(2.0 * T + 0.35 * T**2) * np.exp(-((T / 6.0) ** 4))
CART = la.Mechanism(  # as it is guessed
    [la.tx("x", name="cart", mass=2.0), [la.rz("theta"), [la.ty(-0.5, name="bob", mass=0.5)]]],
    [la.Gravity((0.0, -9.81, 0.0)), la.Damping({"x": 0.3, "theta": 0.01}), la.JointForce("x", input="push")],
)


def measure() -> Experiment:
    """Return what is measured of the motion of the true one."""
    vi, rng = la.MidpointVI(CART.with_parameters(TRUTH)), np.random.default_rng(2012)
    run = vi.simulate(vi.start([0.0, 0.4]), T, inputs=PUSH[:-1, None])
    measured = {name: run[name] + sigma * rng.standard_normal(len(T)) for name, sigma in NOISE.items()}
    return Experiment(T, measured, NOISE, inputs={"push": PUSH[:-1]})


def main(output: Path) -> None:
    """Identify, print and draw."""
    found = identify(CART, measure(), list(TRUTH))
    print(found)
    for name, truth in TRUTH.items():
        print(
            f"{name:13} in truth {truth:g}, off by {abs(found[name] - truth) / found.errors[name]:.1f} standard errors"
        )
    output.mkdir(parents=True, exist_ok=True)
    save_png(found.plot(title="Fit to what was measured"), output / "01_identify_cart_pendulum.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
