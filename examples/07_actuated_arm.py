"""An arm of three joints waves: inverse dynamics and a feedback that varies with time (dissertation 5.2).

Torques for the wanted motion and the gains that hold it come from the equations in continuous time. The same law is
then used as it is in continuous time and inside of each step of the variational integrator.

    python examples/07_actuated_arm.py --out pictures
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.viz import plot_poses, plot_run, save_png

T = np.linspace(0.0, 2.0, 201)
PUSHED = np.array([0.3, -0.4, 0.3])  # how far the arm starts from where it should (rad)


def arm() -> la.Mechanism:
    """Return the arm in the x-y plane: slender rods, a torque in each joint, and nothing that damps."""
    place = tree = la.world()
    for joint, length, mass in (("shoulder", 0.5, 2.0), ("elbow", 0.4, 1.2), ("wrist", 0.2, 0.5)):
        rod = (0.0, mass * length**2 / 12.0, mass * length**2 / 12.0)
        link = place.rz(joint, name=f"{joint} link", mass=mass, com=(length / 2.0, 0.0, 0.0), inertia=rod)
        place = link.tx(length, name=f"{joint} end")
    motors = [la.JointForce(joint, input=joint) for joint in ("shoulder", "elbow", "wrist")]
    return la.Mechanism(tree, [la.Gravity((0.0, -9.81, 0.0)), *motors])


def wave(t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return wanted angles, velocities and accelerations (..., 3): a raised arm that waves once a second."""
    w, phase = 2.0 * np.pi, 2.0 * np.pi * np.asarray(t, dtype=float)[..., None] + np.array([0.0, -0.6, -1.2])
    size, middle = np.array([0.15, 0.45, 0.5]), np.array([np.pi / 2.0, 0.0, 0.0])
    return middle + size * np.sin(phase), w * size * np.cos(phase), -(w**2) * size * np.sin(phase)


def solve() -> dict[str, la.Trajectory | la.ContinuousTrajectory]:
    """Return the motions under the law in both kinds of time."""
    m = arm()
    dynamics, vi = la.mechanics.ContinuousDynamics(m), la.MidpointVI(m)

    def slopes(t: float) -> tuple[np.ndarray, np.ndarray]:
        q, v, _ = wave(t)
        d = dynamics.linearize(q, v, dynamics.inverse_dynamics(*wave(t)))
        return np.block([[np.zeros((3, 3)), np.eye(3)], [d.a_dq, d.a_dv]]), np.vstack([np.zeros((3, 3)), d.a_du])

    weights = {"Q": [10.0] * 3 + [0.1] * 3, "R": [1.0] * 3}
    K = la.regulate_continuous(lambda t: slopes(t)[0], lambda t: slopes(t)[1], horizon=(0.0, T[-1]), **weights)

    def law(t: float, x: np.ndarray) -> np.ndarray:
        q, v, a = wave(t)
        return dynamics.inverse_dynamics(q, v, a) - K(t) @ (x - np.concatenate([q, v]))

    def of_momenta(t: float, x: np.ndarray) -> np.ndarray:
        return law(t, np.concatenate([x[:3], la.to_velocity(m, x[:3], x[3:])]))

    q, v, _ = wave(0.0)
    return {
        "continuous time": la.simulate(m, q + PUSHED, v, T, inputs=law),
        "steps of 10 ms": vi.simulate(vi.start(q + PUSHED, v), T, inputs=of_momenta, law_at="midpoint"),
    }


def main(output: Path) -> None:
    """Simulate, print and draw."""
    runs = solve()
    wanted, (exact, steps) = wave(T)[0], runs.values()
    for name, run in runs.items():
        off = np.degrees(np.abs(run.q - wanted).max(axis=1))
        print(f"{name}: {off[0]:.0f} degrees off at the start, {off[-1]:.3f} after {T[-1]:g} s")
    print(f"the two are {np.degrees(np.abs(exact.q - steps.q).max()):.3f} degrees apart at most")
    output.mkdir(parents=True, exist_ok=True)
    figures = [plot_poses(exact, [0.0, 0.1, 0.3, 1.25], reference=wanted), plot_run(runs, reference=wanted)]
    save_png(figures, output / "07_actuated_arm.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
