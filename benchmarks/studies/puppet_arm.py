"""An arm on one string waves as keyframes say: planned, calmed, with a string that pulls, and on another arm.

The arm of two links hangs from a carriage that moves along a rail and reels its string in and out (dissertation
6.7.2). An animation gives the two angles over eight seconds and knows nothing of strings; the place of the carriage
and the length of the string are found. Then the plan is played on an arm with other masses and damping, with
sensors that are noisy and late, by a regulator along the plan.

    python -m benchmarks.studies.puppet_arm --out pictures
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

import leastaction as la
from leastaction.models.puppet_arm import hang, puppet_arm
from leastaction.viz import plot_poses, plot_reactions, plot_run, save_png

# Keyframes: time (s), angles of shoulder and elbow (degrees). Up, three waves, down.
KEYS = np.array([
    (0.0, 20.0, 30.0), (0.5, 20.0, 30.0), (2.0, 65.0, 65.0), (2.5, 65.0, 35.0), (3.0, 65.0, 95.0), (3.5, 65.0, 35.0),
    (4.0, 65.0, 95.0), (4.5, 65.0, 35.0), (5.0, 65.0, 95.0), (5.5, 65.0, 65.0), (7.0, 20.0, 30.0), (8.0, 20.0, 30.0),
])  # fmt: skip
T = np.linspace(0.0, 8.0, 401)
ANGLES, SPEEDS, SMOOTH = 100.0, 0.01, 1e-3  # weights: angles; speeds and accelerations of carriage and string
LEAST = 0.2  # tension (N)
# The rig: masses and damping by factors of the model's, noise of the sensors (rad), and how late they are (s).
FACTORS = {"upper arm.mass": 1.1, "forearm.mass": 0.9, "damping.*": 1.5}
RIG = la.Rig(spread=0.0, factors=FACTORS, stiffness=None, noise=1e-3, delay=0.02)
SWUNG = 0.4  # how far the shoulder is swung aside before the string takes hold of the arm (rad)


# A smooth curve through the keyframes: the angles (401, 2) (rad).
ANIMATION = np.radians(PchipInterpolator(KEYS[:, 0], KEYS[:, 1:])(T))
SYSTEM = la.MidpointSystem(la.MidpointVI(puppet_arm()), T, multipliers=True)


def plan(smooth: float = 0.0, limits: list[la.Limit] | None = None, initial: object = None) -> la.OptimizationResult:
    """Return the optimal motion with a price on accelerations, within limits; from rest or from an earlier one."""
    # State: two angles, carriage and string, two momenta, two speeds, the multiplier. What the animation says
    # nothing of is wanted to be zero, at next to no weight.
    wanted = np.hstack([ANIMATION, np.zeros((len(T), SYSTEM.nx - 2))])
    Q = [ANGLES, ANGLES, 1e-6, 1e-6, 1e-6, 1e-6, SPEEDS, SPEEDS, 0.0]
    cost = la.QuadraticCost(wanted, np.zeros((SYSTEM.N, 2)), Q=Q, R=[1e-4, 1e-4])
    q = hang(SYSTEM.mechanism, ANIMATION[0])
    rest = np.r_[SYSTEM.integrator.start(q).x, 0.0], np.tile(q[2:], (SYSTEM.N, 1))
    priced = la.SmoothCost(cost, SYSTEM, {"string-*": smooth}) if smooth else cost
    return la.optimize(SYSTEM, priced, initial=rest if initial is None else initial, limits=limits or [])


def solve() -> dict[str, la.OptimizationResult]:
    """Plan as it is, with a smooth string, and with one that only pulls."""
    with warnings.catch_warnings(action="ignore"):  # so jagged are its strings that the energy does not balance
        free = plan()
    calm = plan(SMOOTH, initial=free)
    pulled = plan(SMOOTH, [la.Bound("string", min=LEAST, of="tension")], calm)
    return {"as it is": free, "smooth": calm, "smooth, pulls only": pulled}


def on_rig(found: la.OptimizationResult, *, feedback: bool) -> la.Played:
    """Return what the rig does, swung aside at first, as it plays a plan."""
    swung = la.project_configuration(SYSTEM.mechanism, found.x[0, :4] + [SWUNG, 0.0, 0.0, 0.0])
    return la.play(
        SYSTEM, found, RIG, Q=[10.0, 10.0, 0.1, 0.1, 0.0, 0.0, 1.0, 1.0], R=[1.0, 1.0],
        start=SYSTEM.integrator.start(swung.q), feedback=feedback,
    )  # fmt: skip


def off(x: np.ndarray, wanted: np.ndarray = ANIMATION) -> float:
    """Return how far angles are from the animation, root mean square (degrees)."""
    return float(np.degrees(np.sqrt(np.mean((x[:, :2] - wanted) ** 2))))


def acceleration(run: la.OptimizationResult) -> np.ndarray:
    """Return the acceleration of the carriage (m/s^2) at the instants between."""
    return np.diff(run["string-x"], 2) / T[1] ** 2


def tension(run: la.OptimizationResult) -> np.ndarray:
    """Return the tension of the string (N) over each step but the first, whose impulse is half of one."""
    return run.trajectory.tensions()["string"][1:]


def main(output: Path) -> None:
    """Plan, play, print and draw."""
    plans = solve()
    for name, run in plans.items():
        pull = tension(run)
        print(
            f"{name:19} off by {off(run.x):.2f} degrees (rms), carriage up to {np.abs(acceleration(run)).max():.0f} "
            f"m/s^2, tension {pull.min():.1f} to {pull.max():.1f} N; {run.iterations} iterations, {run.status.name}"
        )
    print("(dissertation: 11 iterations in continuous time)")
    last = plans["smooth, pulls only"]
    rig = {name: on_rig(last, feedback=name == "with feedback") for name in ("with feedback", "plan alone")}
    for name, played in rig.items():
        apart = off(played.x, last.x[:, :2])
        print(f"rig, {name}: {apart:.2f} degrees (rms) from the plan, {off(played.x):.2f} from the animation")
    output.mkdir(parents=True, exist_ok=True)
    figures = [
        plot_poses(last, [0.0, 2.5, 3.0]),
        plot_run(plans, ["shoulder", "elbow", "string-*"], reference=ANIMATION, title="Plans"),
        plot_reactions(last, title="Tension of the string that only pulls"),
        plot_run(rig, ["shoulder", "elbow"], reference=last, title="On another arm"),
    ]
    save_png(figures, output / "puppet_arm.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
