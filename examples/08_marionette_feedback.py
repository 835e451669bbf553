"""A feedback that holds the marionette on its motion, from the exact derivatives of every step (dissertation 5.3).

The strings of arms and legs are let out and drawn in, so that the puppet walks on the spot for ten seconds. Along
that motion the discrete system of 80 states and 18 inputs is linearised, and the linear-quadratic regulator gives
its gains: with identities as weights, and with positions that count a hundred times as much. Shaken at the start,
the puppet comes back.

    python examples/08_marionette_feedback.py --out pictures
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import MidpointSystem, MidpointVI, Trajectory, project_configuration, regulate
from leastaction.models.marionette import marionette, rest_pose

T = np.linspace(0.0, 10.0, 1001)
SHAKEN = 0.1  # of every variable at the start, at random (rad, m)
DAMPING = 0.1
DISSERTATION = {"simulation": 2110.0, "first derivatives": 1120.0, "second derivatives": 22150.0}  # us a step


def walk(vi: MidpointVI) -> Trajectory:
    """Return the motion: an arm and the leg of the other side go up and down together."""
    m = vi.mechanism
    q = rest_pose(m)
    rho = np.tile(q[m.nd :], (len(T), 1))
    swing = 0.1 * np.sin(2.0 * np.pi * 0.3 * T)
    for string, sign in (("right_leg", 1.0), ("left_arm", 1.0), ("left_leg", -1.0), ("right_arm", -1.0)):
        rho[:, m.kinematic.index(f"{string}_string-length")] += sign * swing
    return vi.simulate(vi.start(q), T, rho=rho)


@dataclass(frozen=True)
class Result:
    """The motion, and what becomes of the shaken puppet with and without feedback.

    ``off``: root mean square over the joints of how far they are off (rad), at every instant. ``seconds``: of each part
    of the work, for all steps.
    """

    run: Trajectory
    shaken: dict[str, np.ndarray]  # states (N+1, nx)
    off: dict[str, np.ndarray]
    seconds: dict[str, float]


def best(work: Callable[[], object], repeats: int = 7) -> float:
    """Return the time that some work takes (s), the shortest of several."""
    seconds = []
    for _ in range(repeats):
        begun = time.process_time()
        work()
        seconds.append(time.process_time() - begun)
    return min(seconds)


def solve() -> Result:
    """Simulate, linearise, regulate, and let the shaken puppet go."""
    m = marionette(damping=DAMPING)
    vi = MidpointVI(m, threads=1)
    run = walk(vi)
    d = vi.linearize(run)
    z, positions = np.ones((run.steps, m.nx)), np.where(np.arange(m.nx) < m.nd, 100.0, 1.0)
    gains = {
        "open loop": np.zeros((run.steps, run.u.shape[1], m.nx)),
        "closed, identities": regulate(d.A, d.B),
        "closed, positions": regulate(d.A, d.B, Q=positions),
    }
    seconds = {
        "simulation": best(lambda: walk(vi)),
        "first derivatives": best(lambda: vi.linearize(run)),
        "second derivatives": best(lambda: vi.linearize(run).curvature(z)),
        "regulator": best(lambda: regulate(d.A, d.B)),
    }
    q = run.q[0].copy()
    q[: m.nd] += SHAKEN * np.random.default_rng(1).uniform(-1.0, 1.0, m.nd)
    start = vi.start(project_configuration(m, q).q).x
    system = MidpointSystem(vi, T)
    shaken = {name: system.rollout(start, run.x, run.u, K, 0, run.steps).x for name, K in gains.items()}
    off = {name: np.sqrt(np.mean((x - run.x)[:, 3 : m.nd] ** 2, axis=1)) for name, x in shaken.items()}
    return Result(run, shaken, off, seconds)


def draw(result: Result) -> Figure:
    """Return the figure: the error over time, two joints, and the times."""
    figure = Figure(figsize=(11.5, 6.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.2, 1.0])
    error = left.subplots()
    colors = dict(zip(result.off, ("tab:orange", "tab:cyan", "tab:blue"), strict=True))
    for name, off in result.off.items():
        error.semilogy(T, np.degrees(off), color=colors[name], label=name)
    error.set(xlabel="time (s)", ylabel="joints off by (degrees, rms)", xlim=(0.0, T[-1]), title="after a shake")
    error.legend(frameon=False)
    m = result.run.mechanism
    axes = right.subplots(3, 1)
    for axis, joint in zip(axes, ("lknee_rx", "relbow_rx"), strict=False):
        i = m.variables.index(joint)
        axis.plot(T, np.degrees(result.run.q[:, i]), "--", color="0.4", lw=1, label="motion")
        for name, x in result.shaken.items():
            axis.plot(T, np.degrees(x[:, i]), color=colors[name], lw=1, label=name)
        axis.set(ylabel=f"{joint}\n(degrees)", xlim=(0.0, T[-1]), xlabel="time (s)")
    axes[0].legend(frameon=False, ncols=2, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    names = list(DISSERTATION)
    axes[2].barh(names, [DISSERTATION[n] for n in names], 0.4, align="edge", color="0.7", label="dissertation, 2012")
    ours = [1e6 * result.seconds[n] / result.run.steps for n in names]
    axes[2].barh(names, ours, -0.4, align="edge", color="tab:green", label="today")
    axes[2].set(xscale="log", xlim=(1.0, 1e5), xlabel="us a step, on the machine of each")
    axes[2].legend(frameon=False, ncols=2, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    for name, seconds in result.seconds.items():
        each = 1e6 * seconds / result.run.steps
        then = f" (dissertation: {DISSERTATION[name]:g} us)" if name in DISSERTATION else ""
        print(f"{name:18} {each:7.1f} us a step{then}")
    for name, off in result.off.items():
        values = ", ".join(f"{np.degrees(off[k]):.3g} after {T[k]:g} s" for k in (0, 200, 500, 1000))
        print(f"{name:18} off by (degrees, rms) {values}")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "08_marionette_feedback.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
