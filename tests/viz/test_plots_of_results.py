"""Plots of results of the optimiser: convergence, limits, feedback, the cost along directions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from leastaction import (
    ContinuousQuadraticCost,
    JointForce,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    QuadraticCost,
    ball,
    optimize,
)
from leastaction.costs import tracking
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import FunctionSystem, cost_along
from leastaction.optimal.limit_report import LimitReport, LimitState
from leastaction.optimal.result import OptimizationHistory
from leastaction.viz import plot_convergence, plot_descent, plot_feedback, plot_limits, save_png

N = 20
START = np.array([0.0, 0.4, 0.0, 0.0])


def linear(x: Any, u: Any, k: int) -> Any:
    """Return the next state of a double integrator."""
    return np.array([x[0] + 0.1 * x[1], x[1] + 0.1 * u[0]])


def problem() -> tuple[FunctionSystem, QuadraticCost]:
    system = FunctionSystem(linear, nx=2, nu=1, N=N, derivatives="complex-step")
    return system, QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 1)), Q=[1.0, 0.1], R=[0.1])


@pytest.fixture(scope="module")
def result() -> OptimizationResult:
    return optimize(*problem(), initial=(np.array([1.0, 0.0]), np.zeros((N, 1))))


def history(cost: Any, decrease: Any, methods: Any) -> OptimizationHistory:
    n = len(methods)
    nothing, counts = np.zeros(n), np.zeros(n, dtype=np.int64)
    return OptimizationHistory(
        np.array(cost), np.array(decrease), nothing, nothing, counts, nothing, nothing, counts, tuple(methods), nothing
    )


def test_convergence_marks_every_method(result: OptimizationResult, tmp_path: Any) -> None:
    told = history([100.0, 10.0, 3.0, 2.9], [150.0, 12.0, 0.2], ["quasi-newton", "newton", "newton"])
    figure = plot_convergence(replace(result, history=told, cost=2.9, expected_decrease=1e-8))
    top, bottom = figure.axes
    assert top.get_yscale() == bottom.get_yscale() == "log"
    assert (top.get_ylabel(), bottom.get_ylabel(), bottom.get_xlabel()) == ("cost", "expected decrease", "iteration")
    drawn = {line.get_label(): line.get_xdata() for line in top.lines}
    np.testing.assert_array_equal(drawn["quasi-newton"], [1])
    np.testing.assert_array_equal(drawn["newton"], [2, 3])
    np.testing.assert_allclose(bottom.lines[0].get_ydata(), [150.0, 12.0, 0.2, 1e-8])
    stop = result.settings.tolerance * 2.9 + result.settings.absolute_tolerance
    assert [line.get_ydata()[0] for line in bottom.lines if line.get_linestyle() == "--"] == [pytest.approx(stop)]
    save_png(figure, tmp_path / "c.png", dpi=40)


def test_convergence_of_costs_that_no_logarithm_takes_and_of_no_steps(result: OptimizationResult) -> None:
    falling = replace(result, history=history([1.0, -1.0], [2.0], ["newton"]), expected_decrease=0.0)
    assert plot_convergence(falling).axes[0].get_yscale() == "linear"
    plot_convergence(replace(result, history=history([1.0], [], []), expected_decrease=np.nan))
    with pytest.raises(ArgumentError, match="result: got list, expected"):
        plot_convergence([1.0])  # type: ignore[arg-type]


def test_limits_show_where_they_are_active(result: OptimizationResult) -> None:
    k = np.arange(N)
    room, dual = np.ones((N, 1)), np.zeros((N, 1))
    room[2:4], dual[2:4] = 0.0, 3.0
    side = LimitState("Bound('push')", ("push <= 5",), False, k, room, dual, np.ones(1), dual > 0.0)
    end = LimitState(
        "Equal('x')", ("x = 0",), True, k[-1:], np.zeros((1, 1)), np.ones((1, 1)), np.ones(1), np.ones((1, 1), bool)
    )
    figure = plot_limits(replace(result, limits=LimitReport((side, end), 1e-9, 0.0)))
    push, worth = figure.axes  # what holds at one instant makes no curve
    np.testing.assert_array_equal(push.lines[0].get_ydata(), room[:, 0])
    np.testing.assert_array_equal(worth.lines[0].get_ydata(), dual[:, 0])
    (shade,) = push.patches
    # A rectangle, which older versions of Matplotlib make a polygon of.
    shaded = shade.get_path().transformed(shade.get_patch_transform()).get_extents()
    assert (shaded.x0, shaded.x1) == (1.5, 3.5)
    assert push.get_title(loc="right") == "active 10 % of the time"
    broken = replace(side, value=room - 1.0)
    figure = plot_limits(replace(result, limits=LimitReport((broken,), 1e-9, 1.0)))
    assert figure.axes[0].get_title(loc="right") == "not met"
    for nothing in (None, LimitReport((), 1e-9, 0.0), LimitReport((end,), 1e-9, 0.0)):
        with pytest.raises(ArgumentError, match="got a result without limits over time"):
            plot_limits(replace(result, limits=nothing))


def test_feedback_shows_gains_and_eigenvalues_of_the_closed_loop(result: OptimizationResult) -> None:
    system, _ = problem()
    figure = plot_feedback(result, system=system)
    gains, plane, largest = (axes for axes in figure.axes if axes.get_label() != "<colorbar>")
    np.testing.assert_array_equal(gains.lines[0].get_ydata(), result.K[:, 0, 0])
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.0], [0.1]])
    expected = [np.linalg.eigvals(A - B @ K) for K in result.K]
    (points,) = plane.collections
    found = np.asarray(points.get_offsets())
    np.testing.assert_allclose(found @ [1.0, 1j], np.ravel(expected), atol=1e-12)
    np.testing.assert_allclose(largest.lines[0].get_ydata(), np.abs(expected).max(axis=1))
    assert plane.get_xlabel() == "real part"
    circle = plane.lines[0]
    np.testing.assert_allclose(np.hypot(circle.get_xdata(), circle.get_ydata()), 1.0)
    with pytest.raises(ArgumentError, match="keeps no system"):
        plot_feedback(result)
    with pytest.raises(ArgumentError, match="result: got str"):
        plot_feedback("result")  # type: ignore[arg-type]


def test_feedback_of_a_mechanism_has_units_and_in_continuous_time_the_imaginary_axis(tmp_path: Any) -> None:
    m = cart_pendulum()
    cost = ContinuousQuadraticCost([0.0] * 4, [0.0], Q=[1.0] * 4, R=[1e-2])
    found = optimize(MechanismSystem(m), cost, initial=(START, [0.0]), horizon=(0.0, 1.0))
    figure = plot_feedback(found, title="A cart")
    gains, plane, largest = (axes for axes in figure.axes if axes.get_label() != "<colorbar>")
    assert gains.get_ylabel() == "gains of x-force"
    legend = gains.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        "x (N / m)", "theta (N / rad)", "v_x (N / (m/s))", "v_theta (N / (rad/s))",
    ]  # fmt: skip
    assert (plane.get_xlabel(), largest.get_ylabel()) == ("real part (1/s)", "largest real part (1/s)")
    save_png(figure, tmp_path / "k.png", dpi=40)


def test_feedback_of_rotations_names_turns_and_not_the_numbers_of_quaternions() -> None:
    m = Mechanism([ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4))], [JointForce(f"hull.w{a}", a) for a in "xyz"])
    system = MidpointSystem(MidpointVI(m, threads=1), 0.1 * np.arange(11))
    x0 = system.integrator.start(m.configuration()).x
    cost = tracking(system, {"hull": 10.0}, {"hull": [0.8, 0.6, 0.0, 0.0]}, effort=0.1)
    axes = plot_feedback(optimize(system, cost, initial=(x0, np.zeros((10, 3))))).axes[0]
    names = [text.get_text().partition(" (")[0] for text in axes.get_legend().get_texts()]
    assert names == [*m.variables, "p_hull.wx", "p_hull.wy", "p_hull.wz"]


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_models_are_those_of_the_cost_along_the_direction(kind: str) -> None:
    arguments: tuple[Any, ...]
    options: dict[str, Any] = {}
    if kind == "discrete":
        t = np.linspace(0.0, 1.0, 51)
        x = np.zeros((51, 4))
        x[:, 1] = 0.5
        cost = QuadraticCost(x, np.zeros((50, 1)), Q=[0.1, 10.0, 0.1, 0.1], R=[1e-2])
        arguments = MidpointSystem(MidpointVI(cart_pendulum()), t), cost, (START, np.full((50, 1), 30.0))
    else:
        rate = ContinuousQuadraticCost([0.0, 0.5, 0.0, 0.0], [0.0], Q=[0.1, 10.0, 0.1, 0.1], R=[1e-2])
        arguments = MechanismSystem(cart_pendulum()), rate, (START, np.array([30.0]))
        options = {"horizon": (0.0, 1.0)}
    size = 1e-2
    along = cost_along(*arguments, method="newton", gamma=[-size, 0.0, size], **options)
    behind, here, ahead = along.cost
    assert here == pytest.approx(along.start)
    assert (ahead - behind) / (2.0 * size) == pytest.approx(along.slope, rel=1e-3)
    # By Newton's method the model's second derivative is the cost's own.
    assert (ahead - 2.0 * here + behind) / size**2 == pytest.approx(-along.slope, rel=3e-3)
    rough = cost_along(*arguments, method="quasi-newton", gamma=[-size, 0.0, size], **options)
    bend = (rough.cost[2] - 2.0 * rough.cost[1] + rough.cost[0]) / size**2
    assert bend != pytest.approx(-rough.slope, rel=8e-3)
    figure = plot_descent(*arguments, **options)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["quasi-newton", "newton"]
    assert {axes.get_xlabel() for axes in figure.axes} == {"step length"}
    drawn = {line.get_label(): np.asarray(line.get_ydata()) for line in figure.axes[1].lines}
    at = figure.axes[1].lines[0].get_xdata()
    np.testing.assert_allclose(drawn["linear"], along.start + along.slope * at)
    assert at[np.argmin(drawn["quadratic"])] == pytest.approx(1.0)


def test_descent_of_a_linear_quadratic_problem_is_its_own_model() -> None:
    system, cost = problem()
    along = cost_along(system, cost, (np.array([1.0, 0.0]), np.zeros((N, 1))), method="quasi-newton")
    np.testing.assert_allclose(along.cost, along.quadratic, rtol=1e-10)


def test_wrong_methods_are_named() -> None:
    system, cost = problem()
    start = np.array([1.0, 0.0]), np.zeros((N, 1))
    with pytest.raises(ArgumentError, match="has no second derivative; use 'quasi-newton'"):
        plot_descent(system, cost, start)
    with pytest.raises(ArgumentError, match="method: got 'auto'"):
        plot_descent(system, cost, start, methods=["auto"])
    with pytest.raises(ArgumentError, match="methods: got none"):
        plot_descent(system, cost, start, methods=[])
    with pytest.raises(ArgumentError, match="cost: got ContinuousQuadraticCost"):
        cost_along(system, ContinuousQuadraticCost([0.0] * 2, [0.0], Q=[1.0] * 2, R=[1.0]), start, method="steepest")
