"""Systems and costs of plain functions, by every way to their derivatives; constants where arrays stand."""

from __future__ import annotations

import pickle
from functools import partial

import numpy as np
import pytest

from leastaction import (
    Bound,
    ContinuousQuadraticCost,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    check_derivatives,
    optimize,
    tx,
)
from leastaction.costs import FunctionCost
from leastaction.errors import ArgumentError
from leastaction.optimal import (
    FunctionContinuousSystem,
    FunctionSystem,
    LinearContinuousSystem,
    LinearSystem,
    cost_along,
)

N, DT = 12, 0.1
NAMES = (["angle", "rate"], ["push"])
START = (np.array([1.0, 0.0]), np.zeros((N, 1)))


def step(x, u, k, np=np):
    return np.stack([x[0] + DT * x[1], x[1] + DT * (u[0] - np.sin(x[0]) * (1.0 + 0.1 * k))])


def rate(x, u, t, np=np):
    return np.stack([x[1], u[0] - np.sin(x[0]) + t])


def stage(x, u, k, np=np):
    return DT * (1.0 - np.cos(x[0]) + x[0] * u[0] * 0.1 + (1.0 + k) * 0.1 * u[0] ** 2)


def end(x, np=np):
    return 5.0 * (x[0] ** 2 + 0.1 * x[1] ** 4)


def stage_derivatives(x, u, k):
    gradient = DT * np.array([np.sin(x[0]) + 0.1 * u[0], 0.0, 0.1 * x[0] + 0.2 * (1.0 + k) * u[0]])
    hessian = DT * np.array([[np.cos(x[0]), 0.0, 0.1], [0.0, 0.0, 0.0], [0.1, 0.0, 0.2 * (1.0 + k)]])
    return gradient, hessian


def end_derivatives(x):
    return np.array([10.0 * x[0], 2.0 * x[1] ** 3]), np.diag([10.0, 6.0 * x[1] ** 2])


def costs():
    jnp = pytest.importorskip("jax.numpy")
    return {
        "given": FunctionCost(stage, end, derivatives=stage_derivatives, final_derivatives=end_derivatives),
        "complex-step": FunctionCost(stage, end, derivatives="complex-step"),
        "jax": FunctionCost(partial(stage, np=jnp), partial(end, np=jnp), derivatives="jax"),
    }


def test_costs_have_the_same_derivatives_however_they_are_obtained() -> None:
    rng = np.random.default_rng(0)
    x, u = rng.normal(size=(N + 1, 2)), rng.normal(size=(N, 1))
    by = costs()
    value, gradient, hessian = (getattr(by["given"], what)(x, u) for what in ("value", "gradient", "hessian"))
    for name, tolerance in (("complex-step", 1e-9), ("jax", 1e-13)):
        assert by[name].value(x, u) == pytest.approx(value, rel=1e-13)
        for ours, theirs in zip(
            (*by[name].gradient(x, u), *by[name].hessian(x, u)), (*gradient, *hessian), strict=True
        ):
            np.testing.assert_allclose(ours, theirs, atol=tolerance)


def test_the_same_minimum_by_every_way() -> None:
    jnp = pytest.importorskip("jax.numpy")
    systems = {
        "given": FunctionSystem(step, names=NAMES, N=N, derivatives="complex-step", curvature="differences"),
        "jax": FunctionSystem(partial(step, np=jnp), names=NAMES, N=N, derivatives="jax", curvature="jax"),
    }
    found = [
        optimize(systems[how], costs()[how], initial=START, limits=[Bound("push", -0.8, 0.8)])
        for how in ("given", "jax")
    ]
    report = found[0].limits
    assert report is not None
    assert report.active(report.sides[0].labels[0]).any()
    np.testing.assert_allclose(found[0].u, found[1].u, atol=1e-6)
    np.testing.assert_allclose(found[1]["angle"], found[1].x[:, 0])
    assert found[1].state_names == ("angle", "rate")
    assert found[1].input_names == ("push",)


def test_derivatives_by_jax_are_those_of_the_step() -> None:
    jnp = pytest.importorskip("jax.numpy")
    rng = np.random.default_rng(1)
    x, u, z = rng.normal(size=2), rng.normal(size=1), rng.normal(size=2)
    for kind, function, when in ((FunctionSystem, step, 3), (FunctionContinuousSystem, rate, 0.3)):
        horizon = {"N": N} if kind is FunctionSystem else {}
        traced = kind(partial(function, np=jnp), names=NAMES, derivatives="jax", curvature="jax", **horizon)
        plain = kind(function, nx=2, nu=1, derivatives="complex-step", curvature="differences", **horizon)
        np.testing.assert_allclose(traced.f(x, u, when), plain.f(x, u, when), atol=1e-15)
        for ours, theirs in zip(traced.derivatives(x, u, when), plain.derivatives(x, u, when), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-14)
        np.testing.assert_allclose(traced.curvature(x, u, when, z), plain.curvature(x, u, when, z), atol=1e-8)
        again = pickle.loads(pickle.dumps(kind(function, names=NAMES, derivatives="complex-step", **horizon)))
        assert again.state_names == ("angle", "rate")


def test_wrong_derivatives_of_a_cost_are_found() -> None:
    system = FunctionSystem(step, names=NAMES, N=N, derivatives="complex-step")
    x, u = np.ones((N + 1, 2)), np.ones((N, 1))
    assert check_derivatives(system, x, u, cost=costs()["given"], tolerance=1e-5).ok
    wrong = FunctionCost(stage, derivatives=lambda x, u, k: (2.0 * stage_derivatives(x, u, k)[0], np.eye(3)))
    assert not check_derivatives(system, x, u, cost=wrong, tolerance=1e-5).ok


def test_constants_are_the_same_as_rows() -> None:
    system = LinearSystem([[1.0, DT], [0.0, 1.0]], [[0.0], [DT]], N=N)
    weights = {"Q": [1.0, 0.1], "R": [0.1], "Q_final": [10.0, 1.0]}
    rows = QuadraticCost(np.tile([0.5, 0.0], (N + 1, 1)), np.full((N, 1), 0.2), **weights)
    x, u = np.ones((N + 1, 2)), np.ones((N, 1))
    for same in (
        QuadraticCost([0.5, 0.0], [0.2], **weights),
        QuadraticCost(np.tile([0.5, 0.0], (N + 1, 1)), [0.2], **weights),
        QuadraticCost([0.5, 0.0], np.full((N, 1), 0.2), **weights),
    ):
        assert same.value(x, u) == rows.value(x, u)
        for ours, theirs in zip(same.gradient(x, u), rows.gradient(x, u), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        found, expected = (
            optimize(system, cost, initial=START, limits=[Bound("u[0]", -0.3, 0.3)]) for cost in (same, rows)
        )
        np.testing.assert_array_equal(found.u, expected.u)
        assert pickle.loads(pickle.dumps(same)).over(N).value(x, u) == rows.value(x, u)
        np.testing.assert_array_equal(
            cost_along(system, same, START, gamma=[0.0, 1.0]).cost,
            cost_along(system, rows, START, gamma=[0.0, 1.0]).cost,
        )


def test_bad_input() -> None:
    with pytest.raises(ArgumentError, match=r"QuadraticCost: x_wanted, u_wanted: got shapes \(5, 2\) and \(3, 1\)"):
        QuadraticCost(np.zeros((5, 2)), np.zeros((3, 1)), Q=[1.0, 1.0], R=[1.0])
    with pytest.raises(ArgumentError, match=r"cost.x_wanted: got shape \(3,\), expected \(2,\)"):
        optimize(
            FunctionSystem(step, names=NAMES, N=N, derivatives="complex-step"),
            QuadraticCost(np.zeros(3), [0.0], Q=np.ones(3), R=[1.0]), initial=START,
        )  # fmt: skip
    with pytest.raises(ArgumentError, match="nx: got 3 beside 2 names"):
        FunctionSystem(step, nx=3, names=NAMES, N=N, derivatives="complex-step")
    with pytest.raises(ArgumentError, match=r"names: .*expected different names"):
        FunctionSystem(step, names=(["x", "x"], ["u"]), N=N, derivatives="complex-step")
    with pytest.raises(ArgumentError, match="names: got 'xu'"):
        FunctionSystem(step, names="xu", N=N, derivatives="complex-step")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="FunctionCost: derivatives: got 'jacks', expected a function, 'jax'"):
        FunctionCost(stage, derivatives="jacks")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="final_derivatives: expected a function"):
        FunctionCost(stage, end, derivatives=stage_derivatives)
    with pytest.raises(ArgumentError, match="stage: the function returned shape"):
        FunctionCost(lambda x, u, k: x, derivatives="complex-step").value(np.zeros((3, 2)), np.zeros((2, 1)))
    with pytest.raises(ArgumentError, match="stage: got a real result for complex arguments"):
        FunctionCost(lambda x, u, k: float(x[0].real), derivatives="complex-step").gradient(*START_OF_COST)


START_OF_COST = np.zeros((3, 2)), np.zeros((2, 1))


def test_of_one_input_a_number_will_do() -> None:
    t, slide = np.linspace(0.0, 1.0, 11), Mechanism([tx("x", mass=1.0)], [JointForce("x", "push")])
    system, start = MidpointSystem(MidpointVI(slide), t), ([1.0, 0.0], np.zeros((10, 1)))
    found = [
        optimize(system, QuadraticCost([0.0, 0.0], u, Q=[1.0, 0.1], R=R), initial=start)
        for u, R in ((0.2, 0.5), ([0.2], [0.5]))
    ]
    np.testing.assert_array_equal(found[0].x, found[1].x)
    one = {"Q": 2.0, "R": 0.5, "Q_final": 3.0}
    line = LinearContinuousSystem([[-1.0]], [[1.0]])
    wanted = (0.3, lambda t: 0.1 * t), ([0.3], lambda t: [0.1 * t])
    arrays = {name: [value] for name, value in one.items()}
    other = [
        optimize(line, ContinuousQuadraticCost(x, u, **weights), initial=(x0, u0), horizon=(0.0, 1.0))
        for (x, u), weights, x0, u0 in zip(wanted, (one, arrays), ([1.0], [1.0]), (0.0, [0.0]), strict=True)
    ]
    np.testing.assert_array_equal(other[0].x, other[1].x)
    with pytest.raises(ArgumentError, match=r"Q: got shape \(\), expected .*2"):
        QuadraticCost([0.0, 0.0], 0.0, Q=1.0, R=1.0)
