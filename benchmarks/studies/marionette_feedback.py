"""A feedback that holds the marionette on its motion, from the exact derivatives of every step (dissertation 5.3).

The strings of arms and legs are let out and drawn in, so that the puppet walks on the spot for ten seconds. Along
that motion the discrete system of 80 states and 18 inputs is linearised, and the linear-quadratic regulator gives
its gains: with identities as weights, and with positions that count a hundred times as much. Shaken at the start,
the puppet comes back.

    python -m benchmarks.studies.marionette_feedback --out pictures
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import leastaction as la
from leastaction.models.marionette import marionette, rest_pose
from leastaction.viz import plot_poses, plot_run, save_png
from leastaction.viz.figures import styled

T = np.linspace(0.0, 10.0, 1001)
SHAKEN = 0.1  # of every variable at the start, at random (rad, m)
DAMPING = 0.1
AFTER = (0, 200, 500, 1000)  # steps, at which the error is printed
DISSERTATION = {"simulation": 2110.0, "first derivatives": 1120.0, "second derivatives": 22150.0}  # us a step


def walk(vi: la.MidpointVI) -> la.Trajectory:
    """Return the motion: an arm and the leg of the other side go up and down together."""
    m = vi.mechanism
    q = rest_pose(m)
    rho = np.tile(q[m.nd :], (len(T), 1))
    swing = 0.1 * np.sin(2.0 * np.pi * 0.3 * T)
    for string, sign in (("right_leg", 1.0), ("left_arm", 1.0), ("left_leg", -1.0), ("right_arm", -1.0)):
        rho[:, m.kinematic.index(f"{string}_string-length")] += sign * swing
    return vi.simulate(vi.start(q), T, rho=rho)


def best(work: Callable[[], object], repeats: int = 7) -> float:
    """Return the time that some work takes (s), the shortest of several."""
    seconds = []
    for _ in range(repeats):
        begun = time.process_time()
        work()
        seconds.append(time.process_time() - begun)
    return min(seconds)


def solve() -> tuple[la.Trajectory, dict[str, la.Trajectory], dict[str, float]]:
    """Simulate, linearise, regulate, and let the shaken puppet go; return seconds of each part for all steps, too."""
    m = marionette(damping=DAMPING)
    vi = la.MidpointVI(m, threads=1)
    run = walk(vi)
    d = vi.linearize(run)
    z, positions = np.ones((run.steps, m.nx)), np.where(np.arange(m.nx) < m.nd, 100.0, 1.0)
    gains = {
        "open loop": np.zeros((run.steps, run.u.shape[1], m.nx)),
        "closed, identities": la.regulate(d.A, d.B),
        "closed, positions": la.regulate(d.A, d.B, Q=positions),
    }
    seconds = {
        "simulation": best(lambda: walk(vi)),
        "first derivatives": best(lambda: vi.linearize(run)),
        "second derivatives": best(lambda: vi.linearize(run).curvature(z)),
        "regulator": best(lambda: la.regulate(d.A, d.B)),
    }
    q = run.q[0].copy()
    q[: m.nd] += SHAKEN * np.random.default_rng(1).uniform(-1.0, 1.0, m.nd)
    start = vi.start(la.project_configuration(m, q).q).x
    system = la.MidpointSystem(vi, T)
    rolled = {name: system.rollout(start, run.x, run.u, K, 0, run.steps) for name, K in gains.items()}
    return run, {name: system.trajectory(each.x, each.u) for name, each in rolled.items()}, seconds


def off(shaken: la.Trajectory, run: la.Trajectory) -> np.ndarray:
    """Return how far joints are off at every instant (rad, rms)."""
    return np.sqrt(np.mean((shaken.q - run.q)[:, 3 : run.mechanism.nd] ** 2, axis=1))


@styled
def main(output: Path) -> None:
    """Simulate, print and draw."""
    run, shaken, seconds = solve()
    for name, each in seconds.items():
        then = f" (dissertation: {DISSERTATION[name]:g} us)" if name in DISSERTATION else ""
        print(f"{name:18} {1e6 * each / run.steps:7.1f} us a step{then}")
    errors = Figure(figsize=(8.0, 2.6), layout="constrained")
    axes = errors.subplots()
    for (name, each), look in zip(shaken.items(), ("-", "--", "-."), strict=True):
        values = np.degrees(off(each, run))
        print(f"{name:18} off by (degrees, rms) " + ", ".join(f"{values[k]:.3g} after {T[k]:g} s" for k in AFTER))
        axes.semilogy(T, values, look, label=name)
    axes.set(xlabel="time (s)", ylabel="off by (degrees, rms)", xlim=(0.0, T[-1]), title="all joints, after a shake")
    axes.legend(frameon=False)
    output.mkdir(parents=True, exist_ok=True)
    joints = plot_run(shaken, ["lknee_rx", "relbow_rx"], reference=run, title="Two of them")
    save_png([plot_poses(run, [0.0, 0.8, 2.5]), errors, joints], output / "marionette_feedback.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
