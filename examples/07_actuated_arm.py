"""An arm of three joints waves: inverse dynamics and a time-varying feedback, in two kinds of time (dissertation 5.2).

Torques for the wanted motion and the gains that hold it come from the equations in continuous time. The same law is
then used as it is in three simulations: in continuous time, inside of each step of the variational integrator, and
held over the step as a digital controller would.

    python examples/07_actuated_arm.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import (
    ContinuousDynamics,
    ContinuousTrajectory,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    Trajectory,
    regulate_continuous,
    rz,
    simulate,
    to_velocity,
    tx,
)
from leastaction.optimal import Accuracy

JOINTS = ("shoulder", "elbow", "wrist")
LENGTHS, MASSES = (0.5, 0.4, 0.2), (2.0, 1.2, 0.5)
END = 2.0
PUSHED = np.array([0.3, -0.4, 0.3])  # how far the arm starts from where it should (rad)
STEPS = (100, 200, 400)


def arm() -> Mechanism:
    """Return the arm in the x-y plane: slender rods, a torque in each joint, and nothing that damps."""
    description: list[object] = []
    for joint, length, mass in reversed(list(zip(JOINTS, LENGTHS, MASSES, strict=True))):
        across = mass * length**2 / 12.0
        rod = rz(joint, name=f"{joint} link", mass=mass, com=(length / 2.0, 0.0, 0.0), inertia=(0.0, across, across))
        description = [rod, [tx(length, name=f"{joint} end"), description]]
    return Mechanism(description, [Gravity((0.0, -9.81, 0.0)), *(JointForce(j, input=j) for j in JOINTS)])


def wave(t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return wanted angles, velocities and accelerations (..., 3): a raised arm that waves once a second."""
    w, phase = 2.0 * np.pi, 2.0 * np.pi * np.asarray(t, dtype=float)[..., None] + np.array([0.0, -0.6, -1.2])
    size = np.array([0.15, 0.45, 0.5])
    middle = np.array([np.pi / 2.0, 0.0, 0.0])
    return middle + size * np.sin(phase), w * size * np.cos(phase), -(w**2) * size * np.sin(phase)


class Law:
    """The torques of the wanted motion, and those against what the arm is off by."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.dynamics = ContinuousDynamics(mechanism)
        self.K = regulate_continuous(
            lambda t: self.slopes(t)[0], lambda t: self.slopes(t)[1], horizon=(0.0, END),
            Q=[10.0] * 3 + [0.1] * 3, R=[1.0] * 3, accuracy=Accuracy(rtol=1e-6),
        )  # fmt: skip

    def torques(self, t: float) -> np.ndarray:
        """Return the torques that make the wanted motion."""
        return self.dynamics.inverse_dynamics(*wave(t))

    def slopes(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the linear equations about the wanted motion."""
        q, v, _ = wave(t)
        d = self.dynamics.linearize(q, v, self.torques(t))
        return np.block([[np.zeros((3, 3)), np.eye(3)], [d.a_dq, d.a_dv]]), np.vstack([np.zeros((3, 3)), d.a_du])

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the torques at a time and a state of angles and velocities."""
        q, v, _ = wave(t)
        return self.torques(t) - self.K(t) @ (x - np.concatenate([q, v]))

    def of_momenta(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the torques at a time and a discrete state, of angles and momenta."""
        return self(t, np.concatenate([x[:3], to_velocity(self.mechanism, x[:3], x[3:])]))


@dataclass(frozen=True)
class Result:
    """The motions: in continuous time, by midpoint steps with the law inside, held, and without feedback."""

    law: Law
    exact: ContinuousTrajectory
    inside: Trajectory
    held: Trajectory
    alone: Trajectory
    errors: dict[str, list[float]]  # at the end of the motion (rad), by `STEPS`


def solve() -> Result:
    """Simulate in all ways, and see how errors fall with the time step."""
    m = arm()
    law, vi = Law(m), MidpointVI(m)
    q, v, _ = wave(0.0)
    start = vi.start(q + PUSHED, v)
    t = np.linspace(0.0, END, STEPS[-1] + 1)
    exact = simulate(m, q + PUSHED, v, t, inputs=law, rtol=1e-9, atol=1e-9)
    errors: dict[str, list[float]] = {"midpoint": [], "start": []}
    runs = {}
    for where, off in errors.items():
        for steps in STEPS:
            run = vi.simulate(start, t[:: STEPS[-1] // steps], inputs=law.of_momenta, law_at=where)
            off.append(float(np.abs(run.q - exact.q[:: STEPS[-1] // steps]).max()))
            runs[where, steps] = run
    fine = np.linspace(0.0, END, 8 * STEPS[-1] + 1)  # it falls, and its wrist whirls
    alone = vi.simulate(start, fine, inputs=law.torques)
    return Result(law, exact, runs["midpoint", 200], runs["start", 200], alone, errors)


def draw(result: Result) -> Figure:
    """Return the figure: the arm at some instants, its joints over time, and errors by time step."""
    figure = Figure(figsize=(11.5, 6.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.25])
    arms, errors = left.subplots(2, 1, height_ratios=[1.0, 1.0])
    m = result.law.mechanism
    for moment, shade in ((0.0, 0.8), (0.1, 0.65), (0.3, 0.5), (1.25, 0.25), (1.75, 0.0)):
        q = result.inside.q[round(100 * moment)]
        x, y = np.vstack([[0.0, 0.0], m.positions(q, [f"{j} end" for j in JOINTS])[:, :2]]).T
        arms.plot(x, y, color=str(shade), lw=3, marker="o", ms=6, solid_capstyle="round", label=f"{moment:g} s")
    arms.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", xlim=(-1.5, 1.1), ylim=(-0.1, 1.2))
    arms.legend(fontsize=8, loc="upper left")
    steps = 1e3 * END / np.array(STEPS)
    for where, name, style in (("start", "held over each step", "s--"), ("midpoint", "inside of each step", "o-")):
        errors.loglog(steps, np.degrees(result.errors[where]), style, label=f"law {name}")
    errors.set(
        xlabel="time step (ms)", ylabel="largest error (degrees)", xticks=steps, xticklabels=[f"{s:g}" for s in steps]
    )
    errors.minorticks_off()
    errors.legend(frameon=False)
    t = result.exact.t
    axes = right.subplots(3, 1, sharex=True)
    for i, (axis, joint) in enumerate(zip(axes, JOINTS, strict=True)):
        axis.plot(t, np.degrees(wave(t)[0][:, i]), "--", color="0.5", lw=1, label="wanted")
        falls = result.alone.t < 0.5
        axis.plot(
            result.alone.t[falls], np.degrees(result.alone.q[falls, i]), color="tab:orange", lw=1, label="torques alone"
        )
        axis.plot(t, np.degrees(result.exact.q[:, i]), color="0.75", lw=4, label="continuous time")
        axis.plot(result.inside.t, np.degrees(result.inside.q[:, i]), color="tab:blue", lw=1, label="midpoint, 10 ms")
        axis.set(ylabel=f"{joint} (degrees)", ylim=np.degrees(wave(0.0)[0][i] * (i == 0)) + np.array([-75.0, 75.0]))
    axes[0].set_ylim(0.0, 150.0)
    axes[0].legend(frameon=False, ncols=4, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    axes[-1].set(xlabel="time (s)", xlim=(0.0, END))
    return figure


def main(output: Path) -> Result:
    """Simulate, print and draw."""
    result = solve()
    print("largest error against continuous time (degrees); dissertation: the two are said to agree, without a number")
    print(f"{'time step (ms)':24}" + "".join(f"{1e3 * END / steps:10g}" for steps in STEPS) + "     order")
    for where, name in (("midpoint", "law inside of the step"), ("start", "law held over the step")):
        e = result.errors[where]
        order = np.log2(e[-2] / e[-1])
        print(f"{name:24}" + "".join(f"{np.degrees(value):10.4f}" for value in e) + f"{order:10.2f}")
    off = np.degrees(np.abs(result.exact.q - wave(result.exact.t)[0]).max(axis=1))
    print(f"starts {off[0]:.0f} degrees off, with feedback {off[-1]:.3f} after {END:g} s")
    fallen = np.degrees(np.abs(result.alone.q - wave(result.alone.t)[0]).max())
    print(f"with the torques alone it is {fallen:.0f} degrees off")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "07_actuated_arm.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
