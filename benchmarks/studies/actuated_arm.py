"""An arm of three joints waves: inverse dynamics and a time-varying feedback, in two kinds of time (dissertation 5.2).

Torques for the wanted motion and the gains that hold it come from the equations in continuous time. The same law is
then used as it is in three simulations: in continuous time, inside of each step of the variational integrator, and
held over the step as a digital controller would.

    python -m benchmarks.studies.actuated_arm --out pictures
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.errors import EnergyBalanceWarning
from leastaction.optimal import Accuracy
from leastaction.viz import plot_poses, plot_run, save_png

JOINTS = ("shoulder", "elbow", "wrist")
LENGTHS, MASSES = (0.5, 0.4, 0.2), (2.0, 1.2, 0.5)
END = 2.0
PUSHED = np.array([0.3, -0.4, 0.3])  # how far the arm starts from where it should (rad)
STEPS, DRAWN = (100, 200, 400), 200


def arm() -> la.Mechanism:
    """Return the arm in the x-y plane: slender rods, a torque in each joint, and nothing that damps."""
    tree: list[object] = []
    for joint, length, mass in reversed(list(zip(JOINTS, LENGTHS, MASSES, strict=True))):
        across = mass * length**2 / 12.0
        body = {"mass": mass, "com": (length / 2.0, 0.0, 0.0), "inertia": (0.0, across, across)}
        tree = [la.rz(joint, name=f"{joint} link", **body), [la.tx(length, name=f"{joint} end"), tree]]
    return la.Mechanism(tree, [la.Gravity((0.0, -9.81, 0.0)), *(la.JointForce(j, input=j) for j in JOINTS)])


def wave(t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return wanted angles, velocities and accelerations (..., 3): a raised arm that waves once a second."""
    w, phase = 2.0 * np.pi, 2.0 * np.pi * np.asarray(t, dtype=float)[..., None] + np.array([0.0, -0.6, -1.2])
    size, middle = np.array([0.15, 0.45, 0.5]), np.array([np.pi / 2.0, 0.0, 0.0])
    return middle + size * np.sin(phase), w * size * np.cos(phase), -(w**2) * size * np.sin(phase)


class Law:
    """The torques of the wanted motion, and those against what the arm is off by."""

    def __init__(self, mechanism: la.Mechanism) -> None:
        self.mechanism = mechanism
        self.dynamics = la.ContinuousDynamics(mechanism)
        self.K = la.regulate_continuous(
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
        return self(t, np.concatenate([x[:3], la.to_velocity(self.mechanism, x[:3], x[3:])]))


def solve() -> tuple[dict[str, la.Trajectory | la.ContinuousTrajectory], dict[str, list[float]]]:
    """Simulate in all ways; return motions, and largest errors against continuous time by `STEPS` (rad)."""
    m = arm()
    law, vi = Law(m), la.MidpointVI(m)
    q, v, _ = wave(0.0)
    start, t = vi.start(q + PUSHED, v), np.linspace(0.0, END, STEPS[-1] + 1)
    exact = la.simulate(m, q + PUSHED, v, t, inputs=law, rtol=1e-9, atol=1e-9)
    runs: dict[str, la.Trajectory | la.ContinuousTrajectory] = {"continuous time": exact}
    errors: dict[str, list[float]] = {}
    # Held over 20 ms the feedback shakes the arm, and energy does not balance; that is to be seen here.
    warnings.simplefilter("ignore", EnergyBalanceWarning)
    for name, where in (("law inside of the step", "midpoint"), ("law held over the step", "start")):
        for steps in STEPS:
            every = STEPS[-1] // steps
            run = vi.simulate(start, t[::every], inputs=law.of_momenta, law_at=where)
            errors.setdefault(name, []).append(float(np.abs(run.q - exact.q[::every]).max()))
            if steps <= DRAWN:
                runs[name] = run
    # Without feedback it falls, and its wrist whirls.
    runs["torques alone"] = vi.simulate(start, np.linspace(0.0, END, 8 * STEPS[-1] + 1), inputs=law.torques)
    return runs, errors


def main(output: Path) -> None:
    """Simulate, print and draw."""
    runs, errors = solve()
    print("largest error against continuous time (degrees); dissertation: the two are said to agree, without a number")
    print(f"{'time step (ms)':24}" + "".join(f"{1e3 * END / steps:10g}" for steps in STEPS) + "     order")
    for name, e in errors.items():
        print(f"{name:24}" + "".join(f"{np.degrees(value):10.4f}" for value in e) + f"{np.log2(e[-2] / e[-1]):10.2f}")
    exact, alone = runs["continuous time"], runs["torques alone"]
    off = np.degrees(np.abs(exact.q - wave(exact.t)[0]).max(axis=1))
    print(f"starts {off[0]:.0f} degrees off, with feedback {off[-1]:.3f} after {END:g} s")
    print(f"with the torques alone it is {np.degrees(np.abs(alone.q - wave(alone.t)[0]).max()):.0f} degrees off")
    output.mkdir(parents=True, exist_ok=True)
    shown = {name: run for name, run in runs.items() if run is not alone}
    wanted = wave(exact.t)[0]
    figures = [plot_poses(exact, [0.0, 0.1, 0.3, 1.25], reference=wanted), plot_run(shown, reference=wanted)]
    save_png(figures, output / "actuated_arm.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
