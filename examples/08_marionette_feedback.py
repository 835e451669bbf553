"""A feedback that holds the marionette on its motion, from the exact derivatives of every step (dissertation 5.3).

The strings of arms and legs are let out and drawn in, so that the puppet walks on the spot for ten seconds. Along
that motion the discrete system of 80 states and 18 inputs is linearised, and the linear-quadratic regulator gives
its gains. Shaken at the start, the puppet comes back.

    python examples/08_marionette_feedback.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.marionette import marionette, rest_pose
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 10.0, 1001)


def walk(vi: la.MidpointVI) -> la.Trajectory:
    """Return the motion: an arm and the leg of the other side go up and down together."""
    m = vi.mechanism
    q = rest_pose(m)
    rho = np.tile(q[m.nd :], (len(T), 1))
    swing = 0.1 * np.sin(2.0 * np.pi * 0.3 * T)
    for string, sign in (("right_leg", 1.0), ("left_arm", 1.0), ("left_leg", -1.0), ("right_arm", -1.0)):
        rho[:, m.kinematic.index(f"{string}_string-length")] += sign * swing
    return vi.simulate(vi.start(q), T, rho=rho)


def solve() -> tuple[la.Trajectory, dict[str, la.Trajectory]]:
    """Simulate, linearise and regulate; return the motion, and what comes of it after a shake of 0.1 rad."""
    m = marionette(damping=0.1)
    vi = la.MidpointVI(m)
    run = walk(vi)
    d = vi.linearize(run)
    gains = {
        "feedback": la.regulate(d.A, d.B, Q=np.where(np.arange(m.nx) < m.nd, 100.0, 1.0)),  # places count most
        "no feedback": np.zeros((run.steps, run.u.shape[1], m.nx)),
    }
    q = run.q[0].copy()
    q[: m.nd] += 0.1 * np.random.default_rng(1).uniform(-1.0, 1.0, m.nd)
    start = vi.start(la.project_configuration(m, q).q).x
    system = la.MidpointSystem(vi, T)
    rolled = {name: system.rollout(start, run.x, run.u, K, 0, run.steps) for name, K in gains.items()}
    return run, {name: system.trajectory(each.x, each.u) for name, each in rolled.items()}


def main(output: Path) -> None:
    """Simulate, print and draw."""
    run, shaken = solve()
    print(f"walks on the spot for {T[-1]:g} s: {run.steps} steps of {run.mechanism.nx} states, {run.u.shape[1]} inputs")
    for name, each in shaken.items():
        off = np.degrees(np.sqrt(np.mean((each.q - run.q)[:, 3 : run.mechanism.nd] ** 2, axis=1)))
        print(f"{name:12} off by {off[0]:.1f} degrees (rms), after 5 s by {off[500]:.2f}, after 10 s by {off[-1]:.2f}")
    output.mkdir(parents=True, exist_ok=True)
    joints = ["lknee_rx", "relbow_rx", "lhip_ry", "rshoulder_ry"]
    figures = [plot_poses(run, [0.0, 0.8, 2.5]), plot_run(shaken, joints, reference=run, title="Joints after a shake")]
    save_png(figures, output / "08_marionette_feedback.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
