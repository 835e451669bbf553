"""A pendulum on a cart is to swing up, stand, and swing down again; only the cart is pushed (dissertation 6.7.1).

Where the pendulum is level the push has no hold on it, and a search that starts from hanging ends below. With a
torque at the pivot, whose price rises until it is not used any more, the motion is found: dynamic embedding. In
discrete and in continuous time; then with a bounded push, and in the shortest time.

    python -m benchmarks.studies.cart_pendulum --out pictures
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import leastaction as la
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import Accuracy, ContinuousOptimizationResult
from leastaction.viz import plot_convergence, plot_run, save_png

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


def discrete(weights: tuple[float, float], torque: float | None = None) -> tuple[la.MidpointSystem, la.QuadraticCost]:
    """Return the problem in discrete time, with a torque at a price or without one."""
    x = np.zeros((STEPS + 1, 4))
    x[:, 1] = wanted(T)
    angle, rest = weights
    R = [rest] if torque is None else [rest, torque]
    system = la.MidpointSystem(la.MidpointVI(cart_pendulum(pivot_torque=torque is not None)), T)
    return system, la.QuadraticCost(x, np.zeros((STEPS, len(R))), Q=[rest, angle, rest, rest], R=R)


def continuous(
    weights: tuple[float, float], torque: float | None = None
) -> tuple[la.MechanismSystem, la.ContinuousQuadraticCost]:
    """Return the same problem in continuous time: the integral of what is summed over the steps there."""

    def x(t: float) -> np.ndarray:
        return np.array([0.0, float(wanted(t)), 0.0, 0.0])

    angle, rest = weights
    R = [rest] if torque is None else [rest, torque]
    cost = la.ContinuousQuadraticCost(x, [0.0] * len(R), Q=[rest, angle, rest, rest], R=R, jumps=[3.0, 7.0])
    return la.MechanismSystem(cart_pendulum(pivot_torque=torque is not None)), cost


def embedded(weights: tuple[float, float]) -> list[la.OptimizationResult]:
    """Return the four optimisations in discrete time: with ever dearer torque, and without."""
    x, u = np.zeros((STEPS + 1, 4)), np.zeros((STEPS, 2))
    runs = []
    for torque in (*TORQUE, None):
        start = x, u if torque is not None else u[:, :1]
        runs.append(la.optimize(*discrete(weights, torque), initial=start, tolerance=1e-12))
        x, u = runs[-1].x, runs[-1].u
    return runs


def embedded_continuously(weights: tuple[float, float]) -> list[ContinuousOptimizationResult]:
    """Return the same in continuous time."""
    runs: list[ContinuousOptimizationResult] = []
    x, u = np.zeros(4), np.zeros(2)
    for torque in (*TORQUE, None):
        start = x, u if torque is not None else u.part([0], (1,))
        problem = continuous(weights, torque)
        runs.append(la.optimize(*problem, initial=start, horizon=(0.0, END), accuracy=ACCURACY))
        x, u = runs[-1].dense.x, runs[-1].dense.u
    return runs


def bounded(free: la.OptimizationResult) -> la.OptimizationResult:
    """Return the motion where the push may be two thirds of what it was at most."""
    most = BOUND * float(np.abs(free.u).max())
    return la.optimize(*discrete(STEEP), initial=free, limits=[la.Bound("x-force", -most, most)])


def shortest(most: float = 60.0, steps: int = 100) -> tuple[np.ndarray, la.OptimizationResult]:
    """Return the shortest swing from hanging to standing at rest, under a bounded push (N), and its times."""
    t = np.linspace(0.0, 4.0, steps + 1)
    system = la.MidpointSystem(la.MidpointVI(cart_pendulum()), t)
    ends = [la.Equal("theta", np.pi), la.Equal("x", 0.0), la.Equal("*", 0.0, of="momentum")]
    limits = [la.Bound("x-force", -most, most), *ends]
    # First a motion that stands at the end, in the time that was guessed; then the time is found too.
    nothing = np.zeros((steps + 1, 4)), np.zeros((steps, 1))
    standing = la.optimize(system, la.QuadraticCost(*nothing, Q=[0.0] * 4, R=[1e-3]), initial=nothing, limits=limits)
    cost = la.QuadraticCost(*nothing, Q=[0.0] * 4, R=[1e-7])
    found = la.optimize(system, cost, initial=standing, limits=limits, unknowns=[la.FinalTime(0.5, 10.0, price=1.0)])
    return system.with_parameters(found.unknowns).t, found


def main(output: Path) -> None:
    """Optimise, print and draw."""
    hanging = np.zeros(4), np.zeros((STEPS, 1))
    moments = [time.process_time()]
    found = {weights: embedded(weights) for weights in (MILD, STEEP)}
    moments.append(time.process_time())
    continuous = embedded_continuously(STEEP)
    moments.append(time.process_time())
    for weights, runs in found.items():
        alone = la.optimize(*discrete(weights), initial=hanging, tolerance=1e-12)
        tops = [np.degrees(run["theta"].max()) for run in (alone, runs[-1])]
        print(
            f"weights {weights[0]:g} : {weights[1]:g}: from hanging up to {tops[0]:.0f} degrees, embedded {tops[1]:.0f}"
        )
    print("(dissertation: from hanging just below 90; embedded in discrete time it stands)")
    best = found[STEEP][-1]
    seconds = 0.5 * (moments[1] - moments[0]), moments[2] - moments[1]
    for name, runs, took in zip(("discrete", "continuous"), (found[STEEP], continuous), seconds, strict=True):
        counts = " + ".join(str(run.iterations) for run in runs)
        print(f"{name} time, {STEEP[0]:g} : {STEEP[1]:g}: {counts} iterations, {took:.2f} s, {runs[-1].status.name}")
    print("(dissertation: 112 s in discrete time; in continuous time only 100 : 1, and to 1e-2 instead of 1e-6)")
    apart = np.abs(continuous[-1].dense.sample(T)[0][:, 1] - best["theta"]).max()
    print(f"the angles of the two are {np.degrees(apart):.2f} degrees apart at most")
    within = bounded(best)
    print(f"a push of {np.abs(within.u).max():.0f} N at most instead of {np.abs(best.u).max():.0f}: "
          f"cost {within.cost:.0f} instead of {best.cost:.0f}")  # fmt: skip
    t, fast = shortest()
    full = np.mean(np.abs(fast.u) > 0.99 * np.abs(fast.u).max())
    print(f"the shortest swing takes {t[-1]:.3f} s, {100 * full:.0f} % of it under full push")
    output.mkdir(parents=True, exist_ok=True)
    shown = {"bounded push": within, "discrete time": best, "continuous time": continuous[-1]}
    reference = np.stack([0.0 * T, wanted(T)], axis=1)
    figures = [
        plot_run(shown, ["theta", "x-force"], reference=reference, title="Up, stand, and down"),
        plot_convergence(found[STEEP][1], title="The second of four"),
        plot_run(fast, ["theta", "x-force"], title=f"The shortest swing: {t[-1]:.3f} s"),
    ]
    save_png(figures, output / "cart_pendulum.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("pictures"))
    main(parser.parse_args().out)
