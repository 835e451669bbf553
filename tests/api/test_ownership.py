"""What is given is not held on to: who changes an array later changes nothing that was made of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import leastaction as la
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearContinuousSystem, LinearSystem

vi = la.MidpointVI(cart_pendulum())
x, u = np.array([1.0, 2.0]), np.array([3.0])
TIMES, THREE, GAIN, CURVE = np.linspace(0.0, 0.4, 5), np.ones(3), np.ones((1, 4)), np.ones((5, 4))
STAGES, MATRIX = np.ones((5, 2, 2)), np.eye(2)
COLUMNS, COLUMN, DRIFT = np.ones((5, 2, 1)), np.ones((2, 1)), np.ones(2)

# What is made of arrays, these, and something that it answers.
MADE: list[tuple[str, tuple[np.ndarray, ...], Callable[..., object], Callable[[object], object]]] = [
    ("times of a system", (TIMES,), lambda t: la.MidpointSystem(vi, t), lambda it: it.t),
    ("times of a run", (TIMES,), lambda t: vi.simulate(vi.start([0.0, 0.1]), t), lambda it: it.t),
    ("feedback", (GAIN, THREE), lambda K, p: la.Feedback(K, np.append(p, 1.0), p[:1]), lambda it: it(0.0, np.zeros(4))),
    ("reference", (CURVE,), lambda c: la.Feedback(np.ones((1, 4)), c[0], np.zeros(1)), lambda it: it(0.0, np.ones(4))),
    ("ball", (THREE,), lambda p: la.Ball(p, 1.0), lambda it: it.values(np.zeros((1, 3)), np.array([0]))),
    ("box", (THREE,), lambda p: la.Box(-p, p), lambda it: it.values(np.zeros((1, 3)), np.array([0]))),
    ("half space", (THREE,), lambda p: la.HalfSpace(p), lambda it: it.values(np.ones((1, 3)), np.array([0]))),
    ("point", (THREE,), lambda p: la.Keep("bob", inside=la.Ball((0, 0, 0), 1.0), point=p), lambda it: it.point),
    ("linear", (STAGES, COLUMNS, DRIFT), lambda A, B, c: LinearSystem(A, B, c=c), lambda it: it.f(x, u, 0)),
    ("linear", (MATRIX, COLUMN, DRIFT), lambda A, B, c: LinearContinuousSystem(A, B, c=c), lambda it: it.f(x, u, 0.0)),
]


@pytest.mark.parametrize(("name", "arrays", "make", "ask"), MADE)
def test_what_is_changed_later_changes_nothing(
    name: str, arrays: tuple[np.ndarray, ...], make: Callable[..., object], ask: Callable[[object], object]
) -> None:
    given = [array.copy() for array in arrays]
    made = make(*given)
    before = np.array(ask(made))
    for array in given:
        array *= 7.0
    np.testing.assert_array_equal(ask(made), before, err_msg=name)


def test_times_cannot_be_written_to() -> None:
    system = la.MidpointSystem(vi, TIMES)
    for t in (system.t, system.window(1, 3).t, vi.simulate(vi.start([0.0, 0.1]), TIMES).t):
        with pytest.raises(ValueError, match="read-only"):
            t[1] = 5.0


def test_a_result_that_is_where_it_began_is_not_the_start_itself() -> None:
    system = la.MidpointSystem(vi, TIMES)
    run = vi.simulate(vi.start([0.0, 0.1]), TIMES)
    given, inputs = np.array(run.x), np.array(run.u)
    cost = la.QuadraticCost(np.zeros((5, 4)), np.zeros((4, 1)), Q=np.ones(4), R=[1.0])
    result = la.optimize(system, cost, initial=(given, inputs), max_iterations=0)
    given[2], inputs[2] = 7.0, 7.0
    np.testing.assert_array_equal(result.x, run.x)
    np.testing.assert_array_equal(result.u, run.u)
