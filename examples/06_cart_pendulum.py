"""A pendulum on a cart is to swing up, stand, and swing down again; only the cart is pushed (dissertation 6.7.1).

Where the pendulum is level the push has no hold on it, and a search that starts from hanging ends below. With a
torque at the pivot, whose price rises until it is not used any more, the motion is found: dynamic embedding. In
discrete and in continuous time; then with a bounded push, and in the shortest time.

    python examples/06_cart_pendulum.py --out pictures
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from leastaction import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    FinalTime,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    QuadraticCost,
    optimize,
    optimize_continuous,
)
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import Accuracy, ContinuousOptimizationResult

END, STEPS = 10.0, 1000
T = np.linspace(0.0, END, STEPS + 1)
MILD, STEEP = (1e2, 1e-2), (1e3, 1e-3)  # weights: of the angle, of everything else
TORQUE = (1e-2, 1e1, 1e3)  # prices of the torque at the pivot, one optimisation after the other
BOUND = 0.67  # part of the push
ACCURACY = Accuracy(solver="RK45", rtol=1e-6, atol=1e-8)


def wanted(t: float | np.ndarray) -> np.ndarray:
    """Return the wanted angle (rad): up from 3 s on, upright at 5 s, hanging again at 7 s."""
    share = np.clip((np.asarray(t) / END - 0.3) / 0.4, 0.0, 1.0)
    return 0.5 * np.pi * (1.0 - np.cos(2.0 * np.pi * share))


def discrete(weights: tuple[float, float], torque: float | None = None) -> tuple[MidpointSystem, QuadraticCost]:
    """Return the problem in discrete time, with a torque at a price or without one."""
    x = np.zeros((STEPS + 1, 4))
    x[:, 1] = wanted(T)
    angle, rest = weights
    R = [rest] if torque is None else [rest, torque]
    system = MidpointSystem(MidpointVI(cart_pendulum(pivot_torque=torque is not None)), T)
    return system, QuadraticCost(x, np.zeros((STEPS, len(R))), Q=[rest, angle, rest, rest], R=R)


def continuous(
    weights: tuple[float, float], torque: float | None = None
) -> tuple[MechanismSystem, ContinuousQuadraticCost]:
    """Return the same problem in continuous time: the integral of what is summed over the steps there."""

    def x(t: float) -> np.ndarray:
        return np.array([0.0, float(wanted(t)), 0.0, 0.0])

    angle, rest = weights
    R = [rest] if torque is None else [rest, torque]
    cost = ContinuousQuadraticCost(x, [0.0] * len(R), Q=[rest, angle, rest, rest], R=R, jumps=[3.0, 7.0])
    return MechanismSystem(cart_pendulum(pivot_torque=torque is not None)), cost


def embedded(weights: tuple[float, float]) -> list[OptimizationResult]:
    """Return the four optimisations in discrete time: with ever dearer torque, and without."""
    x, u = np.zeros((STEPS + 1, 4)), np.zeros((STEPS, 2))
    runs = []
    for torque in (*TORQUE, None):
        start = x, u if torque is not None else u[:, :1]
        runs.append(optimize(*discrete(weights, torque), initial=start, tolerance=1e-12))
        x, u = runs[-1].x, runs[-1].u
    return runs


def embedded_continuously(weights: tuple[float, float]) -> list[ContinuousOptimizationResult]:
    """Return the same in continuous time."""
    runs: list[ContinuousOptimizationResult] = []
    x, u = np.zeros(4), np.zeros(2)
    for torque in (*TORQUE, None):
        start = x, u if torque is not None else u.part([0], (1,))
        problem = continuous(weights, torque)
        runs.append(optimize_continuous(*problem, initial=start, horizon=(0.0, END), accuracy=ACCURACY))
        x, u = runs[-1].dense.x, runs[-1].dense.u
    return runs


def bounded(free: OptimizationResult) -> OptimizationResult:
    """Return the motion where the push may be two thirds of what it was at most."""
    most = BOUND * float(np.abs(free.u).max())
    return optimize(*discrete(STEEP), initial=free, limits=[Bound("x-force", -most, most)])


def shortest(most: float = 60.0, steps: int = 100) -> tuple[np.ndarray, OptimizationResult]:
    """Return the shortest swing from hanging to standing at rest, under a bounded push (N), and its times."""
    t = np.linspace(0.0, 4.0, steps + 1)
    system = MidpointSystem(MidpointVI(cart_pendulum()), t)
    ends = [Equal("theta", np.pi), Equal("x", 0.0), Equal("*", 0.0, of="momentum")]
    limits = [Bound("x-force", -most, most), *ends]
    # First a motion that stands at the end, in the time that was guessed; then the time is found too.
    nothing = np.zeros((steps + 1, 4)), np.zeros((steps, 1))
    standing = optimize(system, QuadraticCost(*nothing, Q=[0.0] * 4, R=[1e-3]), initial=nothing, limits=limits)
    cost = QuadraticCost(*nothing, Q=[0.0] * 4, R=[1e-7])
    found = optimize(system, cost, initial=standing, limits=limits, unknowns=[FinalTime(0.5, 10.0, price=1.0)])
    return system.with_parameters(found.unknowns).t, found


@dataclass(frozen=True)
class Result:
    """The optimisations: from hanging and embedded by weights, in continuous time, bounded, and in the shortest time.

    ``seconds``: processor time of each.
    """

    alone: dict[tuple[float, float], OptimizationResult]
    embedded: dict[tuple[float, float], list[OptimizationResult]]
    continuous: list[ContinuousOptimizationResult]
    bounded: OptimizationResult
    shortest: OptimizationResult
    shortest_t: np.ndarray
    seconds: dict[str, float]

    @property
    def apart(self) -> float:
        """The largest distance of the angles in the two domains (rad)."""
        x, _ = self.continuous[-1].dense.sample(T)
        return float(np.abs(x[:, 1] - self.embedded[STEEP][-1].x[:, 1]).max())


def solve() -> Result:
    """Make all optimisations."""
    hanging = np.zeros(4), np.zeros((STEPS, 1))
    alone = {weights: optimize(*discrete(weights), initial=hanging, tolerance=1e-12) for weights in (MILD, STEEP)}
    moments = [time.process_time()]
    runs = {weights: embedded(weights) for weights in (MILD, STEEP)}
    moments.append(time.process_time())
    in_continuous_time = embedded_continuously(STEEP)
    moments.append(time.process_time())
    within = bounded(runs[STEEP][-1])
    t, fast = shortest()
    seconds = {"discrete": 0.5 * (moments[1] - moments[0]), "continuous": moments[2] - moments[1]}
    return Result(alone, runs, in_continuous_time, within, fast, t, seconds)


def draw(result: Result) -> Figure:
    """Return the figure: angles and pushes, convergence in both domains, and the shortest swing."""
    figure = Figure(figsize=(11.5, 7.4), layout="constrained")
    (angle, converge), (push, fast) = figure.subplots(2, 2)
    best, other = result.embedded[STEEP][-1], result.continuous[-1].dense
    x, u = other.sample(T)
    angle.plot(T, np.degrees(wanted(T)), "--", color="0.5", label="wanted")
    angle.plot(T, np.degrees(result.alone[MILD].x[:, 1]), color="tab:orange", label="not embedded")
    angle.plot(T, np.degrees(result.embedded[MILD][-1].x[:, 1]), color="tab:green", label="embedded, same weights")
    angle.plot(T, np.degrees(x[:, 1]), color="0.75", lw=4, label="steep weights, continuous time")
    angle.plot(T, np.degrees(best.x[:, 1]), color="tab:blue", label="steep weights, discrete time")
    angle.set(
        ylabel="angle (degrees)",
        xlabel="time (s)",
        xlim=(0.0, END),
        ylim=(-60.0, 290.0),
        title="up, stand, and down again",
    )
    angle.legend(fontsize=8, loc="upper left", ncols=2)
    push.plot(T, u[:, 0], color="0.75", lw=4, label="continuous time")
    push.plot(T[:-1], best.u[:, 0], color="tab:blue", label="discrete time")
    push.plot(T[:-1], result.bounded.u[:, 0], color="tab:red", lw=1, label="with a bound")
    push.set(ylabel="push on the cart (N)", xlabel="time (s)", xlim=(0.0, END), title="the push")
    push.legend(fontsize=8, loc="lower left")
    for run, color, name in (
        (result.embedded[STEEP][1], "tab:blue", "discrete"),
        (result.continuous[1], "0.6", "continuous"),
    ):
        converge.semilogy(run.history.expected_decrease, "o-", color=color, ms=4, label=f"{name} time")
    converge.set(xlabel="iteration", ylabel="expected decrease of the cost", title="convergence of the second of four")
    converge.legend(fontsize=8)
    fast.plot(result.shortest_t, np.degrees(result.shortest.x[:, 1]), color="tab:purple")
    fast.set(xlabel="time (s)", ylabel="angle (degrees)", title=f"the shortest swing: {result.shortest_t[-1]:.3f} s")
    force = fast.twinx()
    force.step(result.shortest_t[:-1], result.shortest.u[:, 0], where="post", color="tab:red", lw=1)
    force.set_ylabel("push on the cart (N)", color="tab:red")
    return figure


def main(output: Path) -> Result:
    """Optimise, print and draw."""
    result = solve()
    best = result.embedded[STEEP][-1]
    for (angle, rest), run in result.alone.items():
        with_help = result.embedded[angle, rest][-1]
        tops = [np.degrees(one.x[:, 1].max()) for one in (run, with_help)]
        print(f"weights {angle:g} : {rest:g}: from hanging up to {tops[0]:.0f} degrees, embedded up to {tops[1]:.0f}")
    print("(dissertation: from hanging just below 90; embedded in discrete time it stands)")
    for name, runs in (("discrete", result.embedded[STEEP]), ("continuous", result.continuous)):
        counts = " + ".join(str(run.iterations) for run in runs)
        print(
            f"{name} time, {STEEP[0]:g} : {STEEP[1]:g}: {counts} iterations, {result.seconds[name]:.2f} s, "
            f"{runs[-1].status.name}"
        )
    print("(dissertation: 112 s in discrete time; in continuous time only 100 : 1, and to 1e-2 instead of 1e-6)")
    print(f"the angles of the two are {np.degrees(result.apart):.2f} degrees apart at most")
    within = result.bounded
    pushes = [np.abs(run.u).max() for run in (best, within)]
    print(
        f"a push of {pushes[1]:.0f} N at most instead of {pushes[0]:.0f}: "
        f"cost {within.cost:.0f} instead of {best.cost:.0f}"
    )
    full = np.mean(np.abs(result.shortest.u) > 0.99 * np.abs(result.shortest.u).max())
    print(f"the shortest swing takes {result.shortest_t[-1]:.3f} s, {100 * full:.0f} % of it under full push")
    output.mkdir(parents=True, exist_ok=True)
    draw(result).savefig(output / "06_cart_pendulum.png", dpi=110)
    return result


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "output")
    main(parser.parse_args().out)
