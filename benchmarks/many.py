"""Many motions at once: how long they take, by the unit, beside one after the other.

``python -m benchmarks.many``, on one core.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks import unit
from benchmarks.cases import DT, package_marionette
from leastaction.control import simulate_many
from leastaction.mechanics import MidpointVI
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.arrays import Array


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


if __name__ == "__main__":
    main()
