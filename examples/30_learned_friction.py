"""A network of 8 neurons learns the friction in the joint of a pendulum, by PyTorch's gradients through its motion.

What is recorded is how the pendulum swings, noisily, and no torque. The network is a torque by the rate of the joint;
what it does within 0.4 s is held against the record, from 60 instants of it on.

    python examples/30_learned_friction.py --out pictures
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

import leastaction as la
from leastaction.control import close_loop
from leastaction.control.bridge.torch import roll_out
from leastaction.viz import BLUE, ORANGE, new_figure, save_png, styled

DT, AHEAD, STARTS, ROUNDS = 0.02, 20, 60, 400
PENDULUM = la.Mechanism(
    [la.ry("angle"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("angle", input="friction")]
)
STEP = roll_out(la.MidpointSystem(la.MidpointVI(PENDULUM, threads=1), [0.0, DT]))  # of as many motions as there are


def friction(rate: np.ndarray) -> np.ndarray:
    """Return the torque (N m) that nobody knows: dry friction and a drag."""
    return -0.4 * np.tanh(3.0 * rate) - 0.04 * rate * np.abs(rate)


def swing(torque: Callable, lean: float) -> np.ndarray:
    """Return angles and momenta (301, 2), which are rates of this pendulum, under a torque by the rate (1,)."""
    return close_loop(la.MidpointVI(PENDULUM), lambda _, x: torque(x[1:]), [lean, 0.0], DT * np.arange(301)).x


@styled
def main(output: Path) -> None:
    """Train, print and draw."""
    rng, _ = np.random.default_rng(0), torch.manual_seed(0)
    record = np.concatenate([swing(friction, lean) for lean in (2.8, -2.0, 1.0)]) + 1e-3 * rng.standard_normal((903, 2))
    network = torch.nn.Sequential(torch.nn.Linear(1, 8), torch.nn.Tanh(), torch.nn.Linear(8, 1)).double()
    adam, losses = torch.optim.Adam(network.parameters(), lr=0.1), []
    for _ in range(ROUNDS):
        first = rng.integers(0, 300 - AHEAD, STARTS) + 301 * rng.integers(0, 3, STARTS)
        x, off = torch.tensor(record[first]), 0.0
        for k in range(1, AHEAD + 1):
            x = STEP(x, network(x[:, 1:])[:, None, :])[:, -1]
            off = off + torch.mean((x - torch.tensor(record[first + k])) ** 2) / AHEAD
        adam.zero_grad()
        off.backward()
        adam.step()
        losses.append(float(off.detach()) ** 0.5)
    rates, runs = np.linspace(-6.0, 6.0, 241)[:, None], []
    print(f"within 0.4 s it is off by {losses[0]:.2g} before, {np.mean(losses[-20:]):.2g} after {ROUNDS} rounds")
    output.mkdir(parents=True, exist_ok=True)
    top, bottom = (figure := new_figure(9.0, 6.0)).subplots(2, 1)
    for name, torque, look in (
        ("true", friction, {"color": ORANGE}), ("none", lambda rate: 0.0 * rate, {"color": "0.7", "linestyle": ":"}),
        ("learned", lambda rate: network(torch.tensor(rate)).detach().numpy(), {"color": BLUE, "linestyle": "--"}),
    ):  # fmt: skip
        runs.append((torque(rates), swing(torque, 1.5)[:, 0]))
        top.plot(rates, runs[-1][0], label=name, **look)
        bottom.plot(DT * np.arange(301), np.degrees(runs[-1][1]), **look)
        off = [np.sqrt(np.mean((a - b) ** 2)) for a, b in zip(runs[-1], runs[0], strict=True)]
        print(f"{name}: the torque is off by {off[0]:.2f} N m, a swing that it has not seen by {off[1]:.2f} rad (rms)")
    top.set(xlabel="rate (rad/s)", ylabel="friction (N m)", title="What it learned")
    bottom.set(xlabel="time (s)", ylabel="angle (degrees)", title="A swing that it has not seen")
    top.legend()
    save_png(figure, output / "30_learned_friction.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
