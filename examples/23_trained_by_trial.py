"""A pendulum on a cart is balanced by gains that are found by trial alone, in an environment of Gymnasium.

The method is cross entropy: 32 sets of gains are drawn, each has four trials side by side, the best six say where the
next are drawn. It sees rewards, not the mechanism; gains that know the mechanism are there to compare with.

    python examples/23_trained_by_trial.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.control import lqr
from leastaction.control.bridge.gymnasium import vector_environment
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.viz import BLUE, ORANGE, new_figure, save_png, styled

T, SETS, TRIALS = 0.03 * np.arange(101), 32, 4
UP = np.array([0.0, np.pi, 0.0, 0.0])
SYSTEM = la.MidpointSystem(la.MidpointVI(cart_pendulum(cart_mass=1.0, bob_mass=0.3), threads=1), T)


def reward(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the reward of a step, at most zero."""
    return -(x[:, 0] ** 2) - 10.0 * (x[:, 1] - np.pi) ** 2 - 1e-3 * u[:, 0] ** 2


def play(gains: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean return of sets of gains (n, 4) over trials of 3 s, and the leans (101, n, trials)."""
    env = vector_environment(
        SYSTEM, len(gains) * TRIALS, reward=reward, actions={"x-force": (-20.0, 20.0)},
        start=lambda rng: UP + [0.3, 0.2, 0.0, 0.0] * rng.uniform(-1.0, 1.0, 4),
        ended=lambda x: np.abs(x[:, 1] - np.pi) > 1.0,
    )  # fmt: skip
    x, _ = env.reset(seed=seed)
    each, total, fallen, leans = np.repeat(gains, TRIALS, axis=0), 0.0, np.zeros(len(x), dtype=bool), [x[:, 1] - np.pi]
    for _ in range(SYSTEM.N):
        x, rewards, ended, _, _ = env.step(-np.sum(each * (x - UP), axis=1, keepdims=True))
        total = total + np.where(fallen, -10.0, rewards)  # what lies is as bad as what leans by 1 rad
        leans.append(np.where(fallen, np.nan, x[:, 1] - np.pi))
        fallen |= ended
    return total.reshape(-1, TRIALS).mean(axis=1), np.reshape(leans, (len(leans), -1, TRIALS))


@styled
def main(output: Path, rounds: int = 40) -> list[float]:
    """Train, print, draw, and return the returns on new trials of the gains that were found and of the best linear."""
    rng, mean, spread, history = np.random.default_rng(0), np.zeros(4), np.full(4, 50.0), []
    for i in range(rounds):
        gains = mean + spread * rng.standard_normal((SETS, 4))
        best = gains[np.argsort(-(returns := play(gains, i)[0]))[:6]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + max(0.0, 5.0 - 0.2 * i)  # it does not settle too early
        history.append([returns.max(), np.median(returns), returns.min()])
    known = lqr(*SYSTEM.derivatives(UP, np.zeros(1), 0), [1.0, 10.0, 0.0, 0.0], [1e-3], dt=0.03).gain[0]
    print(f"that took {rounds * SETS * TRIALS} trials of 3 s")
    output.mkdir(parents=True, exist_ok=True)
    (top, bottom), found = (figure := new_figure(9.0, 6.0)).subplots(2, 1), []
    top.plot(-np.array(history), label=["best of 32", "median", "worst"])
    top.set(yscale="log", xlabel="round", ylabel="return, its negative", title="Learning")
    for name, K, color in (("trial", mean, BLUE), ("the model", known, ORANGE)):
        returns, leans = play(np.tile(K, (SETS, 1)), 1000)  # the same trials for both
        print(f"gains by {name} {K.round()}: a return of {returns.mean():.2f} in {returns.size * TRIALS} new trials")
        shown = np.degrees(leans[:, :3].reshape(len(T), -1))
        bottom.plot(T, shown, color=color, linewidth=0.9)[0].set_label(f"gains by {name}")
        found.append(float(returns.mean()))
    bottom.set(xlabel="time (s)", ylabel="lean (degrees)", title="Twelve new trials, the same for both")
    for panel in (top, bottom):
        panel.legend()
    save_png(figure, output / "23_trained_by_trial.png", dpi=110)
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
