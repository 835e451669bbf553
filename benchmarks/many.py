"""Many motions at once: how long they take, by the unit, beside one after the other, and where that pays.

``python -m benchmarks.many``, on one core. It pays in samples: motions from starts that are drawn by chance, and what
learns by trial. The trials of a line search follow from one another; told is how often the first is refused, and what
three side by side would gain at the best in place of those that follow.
"""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass

import numpy as np

from benchmarks import unit
from benchmarks.cases import DT, package_marionette
from benchmarks.robustness_problems import PROBLEMS
from leastaction.control import simulate_many
from leastaction.mechanics import MidpointVI
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.arrays import Array
from leastaction.optimal import optimize


def cart_poles() -> tuple[MidpointVI, Array, Array, Array]:
    """Return an integrator, 1000 starts, times of 500 steps, and pushes by chance."""
    x0 = np.zeros((1000, 4))
    x0[:, 1] = np.linspace(0.1, 3.0, 1000)
    u = np.random.default_rng(0).standard_normal((1000, 500, 1))
    return MidpointVI(cart_pendulum(), threads=1), x0, 0.01 * np.arange(501), u


def marionettes() -> tuple[MidpointVI, Array, Array, Array]:
    """Return the same of 64 marionettes of 100 steps that are knocked at the start."""
    case = package_marionette()
    m, rng = case.mechanism, np.random.default_rng(0)
    x0 = np.tile(case.x0, (64, 1))
    x0[:, m.nq : m.nq + m.nd] += 1e-3 * rng.standard_normal((64, m.nd))
    held = np.concatenate([np.zeros(m.n_inputs), case.x0[m.nd : m.nq]])
    return MidpointVI(m, threads=1), x0, DT * np.arange(101), np.tile(held, (64, 100, 1))


@dataclass(frozen=True)
class Trials:
    """The line searches of some problems: how many trials each took (n,), and the share of the time of all trials."""

    rollouts: Array
    share: float

    def gain(self, cost: float) -> float:
        """Return what part of the time is saved if all trials after the first, made at once, cost so many roll-outs."""
        more = self.rollouts[self.rollouts > 1] - 1.0
        return float(self.share * np.sum(more - cost) / np.sum(self.rollouts))


def searches(problems: int = 40) -> Trials:
    """Return what line searches take on the first problems of `benchmarks.robustness`."""
    rollouts, spent, whole = list[int](), 0.0, 0.0
    for problem in PROBLEMS[:problems]:
        given = problem.build()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = optimize(given.system, given.cost, initial=(given.x, given.u))
        rollouts += [count for count in result.history.rollouts.tolist() if count > 0]
        spent, whole = spent + result.timings["rollout"], whole + result.timings["total"]
    return Trials(np.array(rollouts, dtype=np.float64), spent / whole)


def price_of_three(vi: MidpointVI, x0: Array, t: Array, u: Array) -> float:
    """Return what three motions side by side cost, in roll-outs of one."""
    starts, inputs, three, one = np.ascontiguousarray(x0[:3]), np.ascontiguousarray(u[:3]), list[float](), list[float]()
    for _ in range(20):
        begun = time.thread_time()
        vi.core.roll_out_many(t, starts, inputs, 1)
        three.append(time.thread_time() - begun)
        begun = time.thread_time()
        vi.core.roll_out(t, starts[0], None, inputs[0], None)
        one.append(time.thread_time() - begun)
    return min(three) / min(one)


def main() -> None:
    """Measure and print."""
    found = unit.measure(0.5)
    share = 1.0 if isinstance(found, str) else found.best / unit.AT_DESIGN
    print(f"the unit: {found if isinstance(found, str) else f'{1e6 * found.best:.1f} us'}; times by it")
    for name, (vi, x0, t, u) in {"1000 cart-poles, 500 steps": cart_poles(), "64 marionettes": marionettes()}.items():
        many, one = [], []
        some = range(0, len(x0), 8)
        for _ in range(5):
            begun = time.thread_time()
            simulate_many(vi, x0, t, u, threads=1)
            many.append(time.thread_time() - begun)
            begun = time.thread_time()
            for i in some:
                vi.core.roll_out(t, x0[i], None, u[i], None)
            one.append((time.thread_time() - begun) * len(x0) / len(some))
        steps = len(x0) * (len(t) - 1)
        print(
            f"{name:28s} {min(many) / share:7.4f} s, {1e6 * min(many) / share / steps:6.3f} us a step; "
            f"one after the other {min(one) / min(many):.1f} times as long"
        )
    runs = simulate_many(*cart_poles(), threads=1)
    begun = time.thread_time()
    low, high = runs.bands().quantiles("theta", (0.05, 0.95))[:, -1]
    print(f"1000 samples: nine in ten end within {low:.1f} to {high:.1f} rad ({time.thread_time() - begun:.3f} s)")
    trials = searches()
    first, second = np.mean(trials.rollouts > 1), np.mean(trials.rollouts > 2)
    print(
        f"{len(trials.rollouts)} line searches: {100 * first:.0f} % of their first trials are refused, "
        f"{100 * second:.0f} % of the second ones too; trials take {100 * trials.share:.0f} % of the time"
    )
    for name, case in {"cart-pole": cart_poles(), "marionette": marionettes()}.items():
        cost = price_of_three(*case)
        print(
            f"three trials of a {name} side by side cost {cost:.1f} roll-outs: in place of those after the first they "
            f"would save {100 * trials.gain(cost):+.1f} % of the time at the best"
        )


if __name__ == "__main__":
    main()
