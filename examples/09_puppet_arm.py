"""An arm on one string waves as keyframes say: planned, calmed, with a string that pulls, and on another arm.

The arm of two links hangs from a carriage that moves along a rail and reels its string in and out (dissertation
6.7.2). An animation gives the two angles over eight seconds and knows nothing of strings; the place of the carriage
and the length of the string are found. Then the plan is played on an arm with other masses and damping, with
sensors that are noisy and late, by a regulator along the plan.

    python examples/09_puppet_arm.py --out pictures
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from leastaction import (
    Bound,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    Played,
    QuadraticCost,
    Rig,
    SmoothCost,
    optimize,
    play,
    project_configuration,
)
from leastaction.models.puppet_arm import hang, puppet_arm

# Keyframes: time (s), angles of shoulder and elbow (degrees). Up, three waves, down.
KEYS = np.array([
    (0.0, 20.0, 30.0), (0.5, 20.0, 30.0), (2.0, 65.0, 65.0), (2.5, 65.0, 35.0), (3.0, 65.0, 95.0), (3.5, 65.0, 35.0),
    (4.0, 65.0, 95.0), (4.5, 65.0, 35.0), (5.0, 65.0, 95.0), (5.5, 65.0, 65.0), (7.0, 20.0, 30.0), (8.0, 20.0, 30.0),
])  # fmt: skip
T = np.linspace(0.0, 8.0, 401)
DT = T[1]
ANGLES, SPEEDS, SMOOTH = 100.0, 0.01, 1e-3  # weights: angles; speeds and accelerations of carriage and string
LEAST = 0.2  # tension (N)
# The rig: masses and damping by factors of the model's, noise of the sensors (rad), and how late they are (s).
FACTORS = {"upper arm.mass": 1.1, "forearm.mass": 0.9, "damping.*": 1.5}
RIG = Rig(spread=0.0, factors=FACTORS, stiffness=None, noise=1e-3, delay=0.02)
SWUNG = 0.4  # how far the shoulder is swung aside before the string takes hold of the arm (rad)


def animation() -> np.ndarray:
    """Return the animated angles (401, 2) (rad): a smooth curve through the keyframes."""
    return np.radians(PchipInterpolator(KEYS[:, 0], KEYS[:, 1:])(T))


class Planner:
    """The arm's problem: to follow the animation by the carriage's place and the string's length."""

    def __init__(self) -> None:
        self.vi = MidpointVI(puppet_arm())
        self.system = MidpointSystem(self.vi, T, multipliers=True)
        wanted = np.zeros((len(T), self.system.nx))
        wanted[:, :2] = animation()
        # State: two angles, carriage and string, two momenta, two speeds, the multiplier. What the animation says
        # nothing of is wanted to be zero, at next to no weight.
        Q = [ANGLES, ANGLES, 1e-6, 1e-6, 1e-6, 1e-6, SPEEDS, SPEEDS, 0.0]
        self.cost = QuadraticCost(wanted, np.zeros((len(T) - 1, 2)), Q=Q, R=[1e-4, 1e-4])
        q = hang(self.vi.mechanism, wanted[0, :2])
        self.start = np.r_[self.vi.start(q).x, 0.0], np.tile(q[2:], (len(T) - 1, 1))

    def plan(
        self, *limits: Bound, smooth: float = 0.0, initial: OptimizationResult | None = None
    ) -> OptimizationResult:
        """Return the optimal motion with a price on accelerations, within limits; from rest or from an earlier one."""
        start = self.start if initial is None else initial
        cost = SmoothCost(self.cost, self.system, {"string-*": smooth}) if smooth else self.cost
        return optimize(self.system, cost, initial=start, limits=limits)


def tension(x: np.ndarray) -> np.ndarray:
    """Return the tension of the string (N) over each step but the first, whose impulse is half of one."""
    return 2.0 * x[1:-1, 3] * x[2:, 8] / DT


def off(x: np.ndarray) -> float:
    """Return how far angles are from the animation, root mean square (degrees)."""
    return float(np.degrees(np.sqrt(np.mean((x[:, :2] - animation()) ** 2))))


def acceleration(x: np.ndarray) -> np.ndarray:
    """Return the acceleration of the carriage (m/s^2) at the instants between."""
    return np.diff(x[:, 2], 2) / DT**2


def on_rig(planner: Planner, plan: OptimizationResult, *, feedback: bool) -> Played:
    """Return what the rig does, swung aside at first, as it plays a plan."""
    swung = project_configuration(planner.vi.mechanism, plan.x[0, :4] + [SWUNG, 0.0, 0.0, 0.0])
    return play(
        planner.system, plan, RIG, Q=[10.0, 10.0, 0.1, 0.1, 0.0, 0.0, 1.0, 1.0], R=[1.0, 1.0],
        start=planner.vi.start(swung.q), feedback=feedback,
    )  # fmt: skip


@dataclass(frozen=True)
class Result:
    """The plans: as it is, with a smooth string, and with one that only pulls; and the last on the rig."""

    plans: dict[str, OptimizationResult]
    rig: dict[str, np.ndarray]
    mechanism: Mechanism


def solve() -> Result:
    """Plan in three ways, and play the last plan with and without feedback."""
    planner = Planner()
    free = planner.plan()
    calm = planner.plan(smooth=SMOOTH, initial=free)
    pulled = planner.plan(Bound("string", min=LEAST, of="tension"), smooth=SMOOTH, initial=calm)
    plans = {"as it is": free, "smooth": calm, "smooth, pulls only": pulled}
    rig = {name: on_rig(planner, pulled, feedback=name != "plan alone").x for name in ("plan alone", "with feedback")}
    return Result(plans, rig, planner.vi.mechanism)


def draw(result: Result) -> Figure:
    """Return the figure: the arm on its string, angles, carriage, tension, and the rig."""
    figure = Figure(figsize=(12.0, 7.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[0.75, 1.0])
    m, plan = result.mechanism, result.plans["smooth, pulls only"]
    for axis, moment in zip(above.subplots(1, 3, sharey=True), (0.0, 2.5, 3.0), strict=True):
        q = plan.x[round(moment / DT), :4]
        animated = np.r_[animation()[round(moment / DT)], q[2:]]
        joints = ["world", "elbow end", "hand"]
        axis.plot(*m.positions(animated, joints)[:, :2].T, color="tab:green", lw=7, alpha=0.4, solid_capstyle="round")
        axis.plot(*m.positions(q, joints)[:, :2].T, "o-", color="k", lw=3, ms=5)
        axis.plot(*m.positions(q, ["hand", "carriage"])[:, :2].T, color="tab:red", lw=1)
        axis.plot(*m.positions(q, ["carriage"])[:, :2].T, "s", color="tab:red", ms=9)
        axis.axhline(0.8, color="0.7", lw=1, zorder=0)
        axis.set(aspect="equal", xlim=(-0.3, 2.4), ylim=(-0.55, 0.9), title=f"{moment:g} s", xlabel="x (m)")
    figure.axes[0].set_ylabel("y (m)")
    (elbow, carriage), (pull, rig) = below.subplots(2, 2, sharex=True)
    colors = dict(zip(result.plans, ("tab:orange", "tab:cyan", "tab:blue"), strict=True))
    elbow.plot(T, np.degrees(animation()[:, 1]), color="0.8", lw=5, label="animation")
    for name, run in result.plans.items():
        elbow.plot(T, np.degrees(run.x[:, 1]), color=colors[name], lw=1, label=name)
        carriage.plot(T[1:-1], acceleration(run.x), color=colors[name], lw=1)
        pull.plot(T[1:-1], tension(run.x), color=colors[name], lw=1)
    elbow.set(ylabel="elbow (degrees)", xlim=(0.0, T[-1]))
    elbow.legend(frameon=False, ncols=4, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    carriage.set(ylabel="carriage (m/s²)", ylim=(-150.0, 150.0))
    pull.set(ylabel="tension (N)", xlabel="time (s)", ylim=(-10.0, 20.0))
    rig.plot(T, np.degrees(plan.x[:, 1]), color="0.8", lw=5, label="plan")
    for (name, x), color in zip(result.rig.items(), ("tab:orange", "tab:blue"), strict=True):
        rig.plot(T, np.degrees(x[:, 1]), color=color, lw=1, label=f"rig, {name}")
    rig.set(ylabel="elbow (degrees)", xlabel="time (s)")
    rig.legend(frameon=False, ncols=3, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def main(output: Path) -> Result:
    """Plan, play, print and draw."""
    result = solve()
    for name, run in result.plans.items():
        a, pull = acceleration(run.x), tension(run.x)
        print(
            f"{name:19} off by {off(run.x):.2f} degrees (rms), carriage up to {np.abs(a).max():.0f} m/s^2, tension "
            f"{pull.min():.1f} to {pull.max():.1f} N; {run.iterations} iterations, {run.status.name}"
        )
    print("(dissertation: 11 iterations in continuous time)")
    plan = result.plans["smooth, pulls only"].x
    for name, x in result.rig.items():
        apart = np.degrees(np.sqrt(np.mean((x[:, :2] - plan[:, :2]) ** 2)))
        print(f"rig, {name}: {apart:.2f} degrees (rms) from the plan, {off(x):.2f} from the animation")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "09_puppet_arm.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
