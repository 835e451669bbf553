"""The one driver of SciPy's solvers: limits, failures, jumps, projection between steps."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics import ode
from leastaction.numerics.ode import SOLVERS, IntegrationFailed, March

TIGHT = {"rtol": 1e-8, "atol": 1e-10}


def circle(t: float, y: np.ndarray) -> np.ndarray:
    return np.array([-y[1], y[0]])


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("tf", [3.0, -3.0])
def test_every_step_ends_on_the_circle_it_is_held_to(solver: str, tf: float) -> None:
    march = March(
        circle, 0.0, tf, np.array([1.0, 0.0]), solver=solver, **TIGHT,
        hold=lambda t, y: y / np.linalg.norm(y),
    )  # fmt: skip
    free = March(circle, 0.0, tf, np.array([1.0, 0.0]), solver=solver, **TIGHT)
    for step in march:
        assert abs(np.linalg.norm(step.y) - 1.0) < 1e-15
        np.testing.assert_allclose(step.interpolant()(step.end), step.y, atol=1e-15)
    assert sum(1 for _ in free) == free.steps
    assert march.t == free.t == tf
    assert march.steps <= 1.2 * free.steps, "the projection costs no order and no restart"
    np.testing.assert_allclose(march.y, [np.cos(tf), np.sin(tf)], atol=1e-5)


def test_the_equation_sees_times_strictly_between_the_jumps() -> None:
    seen: list[float] = []

    def fun(t: float, y: np.ndarray) -> np.ndarray:
        seen.append(t)
        return np.array([1.0 if t < 1.0 else 3.0])

    march = March(fun, 0.0, 2.0, np.zeros(1), solver="DOP853", **TIGHT, jumps=[1.0, 7.0])
    ends = [step.end for step in march]
    assert 1.0 in ends
    assert not {1.0, 2.0} & set(seen)
    assert min(seen) == 0.0
    np.testing.assert_allclose(march.y, 4.0, atol=1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_there_is_no_value_the_reason_is_the_equations_own(solver: str) -> None:
    def wall(t: float, y: np.ndarray) -> np.ndarray:
        if y[0] > 1.5:
            raise StepError("too far", t=t, residuals={}, iteration=0)
        return np.ones(1)

    march = March(wall, 0.0, 3.0, np.zeros(1), solver=solver, **TIGHT)
    with pytest.raises(IntegrationFailed, match="too far"):
        list(march)
    assert 0.0 < march.t <= 1.5 + 1e-12
    assert march.y[0] == pytest.approx(march.t)


def test_limits() -> None:
    march = March(circle, 0.0, 9.0, np.ones(2), solver="RK45", **TIGHT, max_steps=3)
    with pytest.raises(IntegrationFailed, match="3 steps, as many as max_steps allows"):
        list(march)
    assert march.steps == 3
    enough = March(circle, 0.0, 1e-3, np.ones(2), solver="RK45", **TIGHT, first_step=1e-3, max_steps=1)
    assert len(list(enough)) == 1


def test_a_limit_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(100))
    monkeypatch.setattr(ode.time, "monotonic", lambda: float(next(clock)))
    march = March(circle, 0.0, 9.0, np.ones(2), solver="RK45", **TIGHT, max_seconds=2.5)
    with pytest.raises(IntegrationFailed, match="max_seconds"):
        list(march)
    assert march.steps == 3


@pytest.mark.parametrize("error", [ArgumentError("mine"), ValueError("mine"), np.linalg.LinAlgError("mine")])
@pytest.mark.parametrize("solver", ["DOP853", "Radau"])
def test_the_users_own_errors_pass_through(solver: str, error: Exception) -> None:
    def fun(t: float, y: np.ndarray) -> np.ndarray:
        if t > 0.5:
            raise error
        return y

    with pytest.raises(type(error), match="mine"):
        list(March(fun, 0.0, 1.0, np.ones(1), solver=solver, **TIGHT))


def test_states_are_given_to_be_read() -> None:
    def fun(t: float, y: np.ndarray) -> np.ndarray:
        y[0] = 0.0
        return y

    with pytest.raises(ValueError, match="read-only"):
        list(March(fun, 0.0, 1.0, np.ones(1), solver="DOP853", **TIGHT))
