"""A network of 16 neurons learns to balance a pendulum on a cart, by JAX's gradients through the mechanism's motion.

It begins with random weights and is told only to keep the pendulum up and the cart near its place. A step of the
mechanism is a function that JAX differentiates, and so are motions under the network, which grow as it learns.

    python examples/22_network_that_balances.py --out pictures
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import leastaction as la
from leastaction.control.bridge.jax import roll_out
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.viz import BLUE, new_figure, save_png, styled

jax.config.update("jax_enable_x64", True)
GROWTH = {15: 50, 30: 50, 45: 25, 60: 25}  # rounds of motions of so many steps
STEP = roll_out(la.MidpointSystem(la.MidpointVI(cart_pendulum(cart_mass=1.0, bob_mass=0.3), threads=1), [0.0, 0.04]))


def leaning(most: float, count: int) -> np.ndarray:
    """Return states at rest that lean by angles (rad) of both signs."""
    return np.array([0.0, np.pi, 0.0, 0.0]) + np.outer(np.linspace(-most, most, count), [0.0, 1.0, 0.0, 0.0])


@partial(jax.jit, static_argnums=2)
def motions(w: list, starts: np.ndarray, steps: int) -> tuple:
    """Return states and pushes (at most 20 N) of the cart under a network with weights w, from several starts."""

    def step(x: jax.Array, _: None) -> tuple:
        seen = jnp.array([x[0], jnp.sin(x[1]), jnp.cos(x[1]), x[2], 3.0 * x[3]])
        u = 20.0 * jnp.tanh(w[2] @ jnp.tanh(w[0] @ seen + w[1]))
        after = STEP(x, u[None, None])[-1]
        return after, (after, u)

    return jax.vmap(lambda x0: jax.lax.scan(step, x0, None, length=steps)[1])(starts)


def price(w: list, starts: np.ndarray, steps: int) -> jax.Array:
    """Return the mean price of the states and pushes of motions."""
    x, u = motions(w, starts, steps)
    return jnp.mean(20.0 * (1.0 + jnp.cos(x[..., 1])) + x[..., 0] ** 2 + 0.5 * x[..., 3] ** 2 + 1e-4 * u**2)


@styled
def main(output: Path) -> tuple[np.ndarray, np.ndarray]:
    """Train by Adam with short gradients, print and draw how it balances from leans that it has not seen."""
    rng = np.random.default_rng(0)
    w = [0.5 * rng.standard_normal((16, 5)), 0.1 * rng.standard_normal(16), 0.1 * rng.standard_normal(16)]
    new, total = leaning(0.55, 20), sum(GROWTH.values())
    before, m, v = np.asarray(motions(w, new, 100)[0]), [0.0 * each for each in w], [0.0 * each for each in w]
    gradient = jax.jit(jax.grad(price), static_argnums=2)
    for i, steps in enumerate((steps for steps, rounds in GROWTH.items() for _ in range(rounds)), 1):
        slopes = [np.asarray(each) for each in gradient(w, leaning(0.6, 8), steps)]
        short = min(1.0, 5.0 / np.sqrt(sum((each**2).sum() for each in slopes)))
        m = [0.9 * a + 0.1 * short * g for a, g in zip(m, slopes, strict=True)]
        v = [0.99 * b + 0.01 * (short * g) ** 2 for b, g in zip(v, slopes, strict=True)]
        rate = 0.03 * (1.0 - i / (total + 1)) * np.sqrt(1.0 - 0.99**i) / (1.0 - 0.9**i)
        w = [each - rate * a / (np.sqrt(b) + 1e-8) for each, a, b in zip(w, m, v, strict=True)]
    after = np.asarray(motions(w, new, 100)[0])
    output.mkdir(parents=True, exist_ok=True)
    figure = new_figure(9.0, 6.0)
    for panel, x, title in zip(figure.subplots(2, 1), (before, after), ("Before", "After"), strict=True):
        panel.plot(0.04 * np.arange(1, 101), np.degrees(x[..., 1].T) - 180.0, color=BLUE, linewidth=1.0)
        panel.set(title=f"{title} {total} rounds", ylabel="lean (degrees)", xlabel="time (s)")
        stand = np.abs(x[:, -1, 1] - np.pi) < 0.05
        print(f"{title.lower()} {total} rounds {stand.sum()} of {len(new)} stand after 4 s")
    print(f"the cart needs {np.abs(after[..., 0]).max():.1f} m at most on either side")
    save_png(figure, output / "22_network_that_balances.png", dpi=110)
    return before, after


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
