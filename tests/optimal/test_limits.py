"""Limits: the barrier against its definition, optima against the conditions of an optimum, and what users get wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog, minimize, minimize_scalar

from leastaction._core import Room
from leastaction.errors import ArgumentError
from leastaction.io.results import load_result, save_result
from leastaction.mechanics import (
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PathLength,
    PointOnPlane,
    ball,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import (
    Bound,
    Equal,
    FunctionQuantity,
    LinearSystem,
    OptimizationResult,
    QuadraticCost,
    Status,
    WindowSystem,
    Within,
    adjoint,
    optimize,
)
from leastaction.optimal.iterates.models import Models
from leastaction.optimal.limit_report import LimitReport, LimitState
from leastaction.optimal.limits.duals import Duals, LimitSide
from leastaction.optimal.limits.rows import Rows, Weights
from leastaction.optimal.limits.sides import SideLayout
from leastaction.optimal.limits.stages import BarrierStages
from leastaction.optimal.line_search import SearchStep, Trial
from leastaction.optimal.loop.problem import Direction
from leastaction.optimal.loop.run import Run
from leastaction.optimal.quantity import Quantity, Samples, WeightedSum
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.systems import Ball, Box, HalfSpace, Keep, MidpointSystem, PlaceCost

N, DT = 150, 0.02


@pytest.fixture(scope="module")
def cart() -> MidpointSystem:
    return MidpointSystem(MidpointVI(cart_pendulum(), threads=1), DT * np.arange(N + 1))


@pytest.fixture(scope="module")
def cost() -> QuadraticCost:
    """Swing the pendulum out by a radian and back."""
    reference = np.zeros((N + 1, 4))
    reference[:, 1] = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(N + 1) / N))
    return QuadraticCost(reference, np.zeros((N, 1)), Q=np.array([0.01, 100.0, 0.01, 0.01]), R=np.array([0.01]))


REST = np.zeros((N + 1, 4)), np.zeros((N, 1))


def stationarity(system, cost, limits, result: OptimizationResult) -> float:
    """Return the gradient of the Lagrangian by the inputs, relative to the cost's own; found without the optimiser."""
    x, u = result.x, result.u
    gradient = cost.gradient(x, u)
    q, r = np.vstack([gradient.q, gradient.q_final]), gradient.r.copy()
    size = np.abs(r).max()
    rows: list[Rows] = [row for limit in limits for row in limit.rows(system, 1)]
    rows = [row for row in rows if not (row.equal and row.sign < 0.0)]
    for row, side in zip(rows, result.limits.sides, strict=True):
        row.add_gradient(row.jacobian(x, u), side.dual, q, r)
    A, B = system.linearize(x, u)
    z = adjoint(A, B, np.zeros((system.N, system.nu, system.nx)), q[:-1], r, q[-1])
    total = r + np.einsum("kij,ki->kj", B, z[1:])
    return float(np.abs(total).max() / size)


def certify(system, cost, limits, result: OptimizationResult) -> None:
    """Hold an end to the conditions of Karush, Kuhn and Tucker."""
    assert result.success, result.message
    report = result.limits
    assert report is not None
    assert report.excess < 1e-8
    for side in report.sides:
        if not side.equation:
            assert (side.dual > 0.0).all()
            # Each dual times its room is the barrier's parameter.
            assert np.sum(side.dual * np.maximum(side.value, 0.0)) < 1e-7 * abs(result.cost)
    assert stationarity(system, cost, limits, result) < 2e-5


# ---- The barrier -----------------------------------------------------------------------------------


def written(write: Callable[..., None], y: np.ndarray, *others: Any) -> np.ndarray:
    """Return what a method of a room writes, given duals and others."""
    out = np.empty(len(y))
    write(y, *others, out)
    return out


@pytest.mark.parametrize("c", [-2.0, -0.01, 0.0, 0.003, 1.5])
@pytest.mark.parametrize(("mu", "rho"), [(0.1, 3.0), (1e-3, 50.0)])
def test_the_barrier_is_the_minimum_over_slack_and_excess(c: float, mu: float, rho: float) -> None:
    def value(log_excess: np.ndarray) -> float:
        t = np.exp(log_excess[0])
        if c + t <= 0.0:
            return np.inf
        return float(rho * t - mu * np.log(rho * t / mu) - mu * np.log(rho * (c + t) / mu))

    there = Room(np.array([c]), mu, np.array([rho]))
    slack, excess = there.slack, there.excess
    assert slack[0] - excess[0] == pytest.approx(c, abs=1e-14)
    found = minimize(value, np.log(excess * 1.3), method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14})
    assert there.value == pytest.approx(found.fun, rel=1e-9, abs=1e-11)
    assert mu / slack[0] + mu / excess[0] == pytest.approx(rho, rel=1e-12)


def test_the_dual_is_the_slope_of_the_barrier_and_its_stiffness_the_bend() -> None:
    c, mu, rho = np.linspace(-1.0, 1.0, 21), 0.02, np.full(21, 7.0)
    h = 1e-5

    def each(values: np.ndarray) -> np.ndarray:
        return np.array([Room(value[None], mu, rho[:1]).value for value in values])

    slope = (each(c + h) - each(c - h)) / (2.0 * h)
    part = Room(c, mu, rho)
    y = mu / part.slack
    np.testing.assert_allclose(-slope, y, rtol=1e-6, atol=1e-7)
    bend = (mu / Room(c - h, mu, rho).slack - mu / Room(c + h, mu, rho).slack) / (2.0 * h)
    np.testing.assert_allclose(written(part.stiffness, y), bend, rtol=1e-5)
    far = np.array([-1e6, -3.0, -1e-9, 0.0, 1e-9, 3.0, 1e6])
    there = Room(far, mu, rho[:7])
    np.testing.assert_allclose(mu / there.slack + mu / there.excess, rho[:7], rtol=1e-12)
    # A roll-out that is lost is dear, however far it is.
    lost = np.array([-1e200, 1e200])
    assert Room(lost, mu, rho[:2]).value == pytest.approx(7e200)


def test_a_step_ends_where_the_barriers_begin_to_rise() -> None:
    """The model of a step is the quadratic one, with the barriers themselves in place of their models."""
    rng = np.random.default_rng(3)
    c, dc, rho, mu = rng.uniform(-0.1, 1.0, 300), rng.normal(size=300), rng.uniform(1.0, 9.0, 300), 0.01
    part = Room(c, mu, rho)
    y = mu / part.slack * rng.uniform(0.7, 1.0, 300)
    barriers = written(part.stiffness, y) @ dc**2, float(mu / part.slack @ dc)
    bend = 300.0
    fall = -150.0 - barriers[1]
    least = fall + 0.5 * (bend + barriers[0])

    def model(a: float) -> float:
        return (fall + barriers[1]) * a + 0.5 * bend * a**2 + Room(c + a * dc, mu, rho).value

    best = minimize_scalar(model, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).x
    assert 0.01 < best < 0.9
    found = part.step(y, dc, fall, least, 1.0)
    assert found == pytest.approx(best, rel=0.1)
    assert part.step(y, dc, fall, least, 0.5 * best) == 0.5 * best
    # At once, by the derivatives of what is beside the barriers.
    assert part.along(y, dc) == pytest.approx((barriers[1], barriers[0]), rel=1e-12)
    y_there = np.empty(300)
    there, length = part.advance(y, dc, fall + barriers[1], bend, y_there)
    assert length == pytest.approx(found, rel=1e-12)
    after = Room(c + length * dc, mu, rho)
    np.testing.assert_allclose(there.c, c + length * dc, rtol=1e-14)
    np.testing.assert_allclose(there.slack, after.slack, rtol=1e-12)
    np.testing.assert_allclose(there.excess, after.excess, rtol=1e-12)
    np.testing.assert_allclose(y_there, written(part.move_duals, y, dc, after), rtol=1e-12)
    assert there.value == pytest.approx(after.value, rel=1e-12)


def test_duals_stay_inside_of_their_bounds_and_near_those_of_the_barriers() -> None:
    rng = np.random.default_rng(4)
    c, dc, rho, mu = rng.normal(size=200), 3.0 * rng.normal(size=200), rng.uniform(1.0, 9.0, 200), 1e-3
    part, after = Room(c, mu, rho), Room(c + dc, mu, rho)
    y = mu / part.slack * rng.uniform(0.5, 1.0, 200)
    newton = mu / part.slack - written(part.stiffness, y) * dc
    moved, barrier = written(part.move_duals, y, dc, after), mu / after.slack
    assert (moved > 0.0).all()
    assert (moved < rho).all()
    assert (moved >= 0.999e-3 * barrier).all()
    assert (rho - moved >= 0.999e-3 * (rho - barrier)).all()
    free = (newton > 0.005 * y) & (rho - newton > 0.005 * (rho - y)) & (newton < 1e3 * barrier)
    free &= (rho - newton > 1e-3 * (rho - barrier)) & (newton > 1e-3 * barrier) & (rho - newton < 1e3 * (rho - barrier))
    assert free.sum() > 20
    np.testing.assert_allclose(moved[free], newton[free], rtol=1e-12)


# ---- Optima ----------------------------------------------------------------------------------------


def test_a_linear_problem_with_bounds_keeps_to_them_and_is_optimal(rng: np.random.Generator) -> None:
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    system = LinearSystem(np.tile(A, (40, 1, 1)), np.tile(B, (40, 1, 1)))
    cost = QuadraticCost(rng.normal(size=(41, 2)), np.zeros((40, 1)), Q=np.array([1.0, 0.1]), R=np.array([0.1]))
    limits = [Bound("u[0]", -0.3, 0.25), Bound("x[1]", min=-0.3, max=0.05)]
    result = optimize(system, cost, limits=limits, initial=(np.zeros((41, 2)), np.zeros((40, 1))), tolerance=1e-11)
    certify(system, cost, limits, result)
    assert result.limits.active("u[0] <= 0.25").size > 0
    assert result.limits.active("x[1] <= 0.05").size > 0


def test_a_start_far_away_says_nothing_of_which_limits_are_active() -> None:
    A, B = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]])
    system = LinearSystem(np.tile(A, (40, 1, 1)), np.tile(B, (40, 1, 1)))
    wanted = np.zeros((41, 2))
    wanted[:, 0] = np.sin(0.1 * np.arange(41.0))
    cost = QuadraticCost(wanted, np.zeros((40, 1)), Q=np.array([1.0, 0.1]), R=np.array([0.1]))
    limit = Within(FunctionQuantity("place", lambda x: x[:, 0]), max=0.3)
    result = optimize(system, cost, limits=[limit], initial=(np.zeros(2), np.full((40, 1), 1e3)))
    assert result.success
    room = result.limits["place <= 0.3"]
    np.testing.assert_array_equal(result.limits.sides[0].active[:, 0], room < 1e-4)
    assert 0 < result.limits.active("place <= 0.3").size < 20


CASES = {
    "push": [Bound("x-force", -12.0, 12.0)],
    "push over time": [Bound("x-force", max=lambda t: 12.0 + t)],
    "place": [Bound("x", -0.15, 0.1)],
    "rate": [Bound("x", -0.3, 0.3, of="rate")],
    "sum": [Bound({"x": 1.0, "theta": -0.5}, -0.3, 0.25)],
    "sum of rates": [Bound({"x": 2.0, "theta": 1.0}, -1.5, 1.5, of="rate")],
    "sum of inputs": [Bound({"x-force": 0.5}, -6.0, 6.0)],
    "sum at the end": [Equal({"x": 1.0, "theta": 0.3}, 0.1)],
    "end": [Equal(["x", "theta"]), Equal("*", of="momentum")],
    "on the way": [Equal("theta", 0.9, at=1.5), Bound("x-force", -60.0, 60.0)],
    "own": [Within(FunctionQuantity("height", lambda x: -np.cos(x[:, 1])), max=-0.97)],
    "ball": [Keep("bob", outside=Ball((0.3, -0.95, 0.0), 0.05))],
    "moving ball": [Keep("bob", outside=Ball(lambda t: (0.3 - 0.02 * t, -0.95, 0.0), 0.05))],
    "box": [Keep("bob", inside=Box((-0.3, -2.0, -1.0), (0.6, 2.0, 1.0)))],
    "half space": [Keep("bob", inside=HalfSpace((0.0, -2.0, 0.0), 1.94))],
    "apart": [Keep("bob", outside=Ball((0.35, -0.95, 0.0), 0.08), origin="cart")],
}


@pytest.mark.parametrize("name", CASES)
def test_limits_on_a_cart_are_kept_at_an_optimum(name: str, cart: MidpointSystem, cost: QuadraticCost) -> None:
    limits = CASES[name]
    result = optimize(cart, cost, limits=limits, initial=REST, tolerance=1e-11)
    certify(cart, cost, limits, result)
    free = optimize(cart, cost, initial=REST)
    assert result.cost > free.cost + 1e-6 * abs(free.cost), "the limit does not bind: the test says nothing"
    assert any(side.active.any() for side in result.limits.sides)
    assert str(result.limits).count("\n") == len(result.limits.labels)


@pytest.mark.parametrize("name", ["push", "rate", "end", "on the way", "own", "box"])
def test_limits_on_a_cart_are_kept_where_steps_had_gaps(name: str, cart: MidpointSystem, cost: QuadraticCost) -> None:
    """From what is wanted, which is no motion of the cart at all."""
    limits, start = CASES[name], (cost.x_wanted, cost.u_wanted)
    gaps: list[float] = []
    result = optimize(
        cart, cost, limits=limits, initial=start, tolerance=1e-11, shooting="multiple",
        callback=lambda record: gaps.append(record.gap),
    )  # fmt: skip
    assert gaps[0] > 1e-3
    assert gaps[-1] == 0.0
    certify(cart, cost, limits, result)
    other = optimize(cart, cost, limits=limits, initial=REST, tolerance=1e-11)
    assert result.cost <= other.cost * (1.0 + 1e-9)


def test_a_rough_tolerance_is_met_roughly(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """All the barriers together leave a tenth of the tolerated change: the motion need not be nearer to their end."""
    limits = [Bound("x-force", -60.0, 60.0)]
    exact = optimize(cart, cost, limits=limits, initial=REST, tolerance=1e-11)
    rough = optimize(cart, cost, limits=limits, initial=REST, tolerance=1e-3)
    assert rough.success
    assert rough.limits is not None
    assert rough.limits.excess <= 1e-6
    assert exact.cost <= rough.cost <= 1.001 * exact.cost
    # Of one row alone the part would be that much smaller.
    assert rough.expected_decrease > 10.0 * rough.limits.mu
    assert rough.iterations < exact.iterations


def test_the_tolerance_is_relative_to_the_cost_without_barriers(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """Barriers are known up to a constant, and may nearly cancel the cost."""
    rows = Bound("x-force", -60.0, 60.0).rows(cart, 1)
    settings = optimize(cart, cost, initial=REST, max_iterations=0).settings
    problem = DiscreteProblem(cart, cost, settings, rows)
    problem.start(REST)
    assert problem.models.magnitude == cost.value(*REST)
    assert abs(problem.here.value - problem.models.magnitude) > 0.01 * problem.models.magnitude


def test_few_digits_of_the_cost_are_asked_for_as_such() -> None:
    """Exact duals want a motion nearer to the barrier's minimum than the cost does; rough ones do not."""
    for tolerance, enough, off in ((1e-2, 1.0, 1e-4), (1e-9, 1e-5, 1e-6)):
        side = LimitSide("limit", ("c >= 0",), False, False, np.ones(1), np.zeros(1))
        stages = BarrierStages(Duals([side], SideLayout([(1000, 1)])), tolerance, 1e-12)
        c = stages.duals.layout.empty()
        c.flat[:] = 1.0
        stages.begin(1.0, c, lambda: 1.0)
        stages.duals.mu = stages.last = 1e-6
        assert stages.tolerated(1.0, 0.0, stages.duals.room(c)) == pytest.approx(enough)
        # What limits are off by is for dearer excess to mend: along a flat valley more digits of the cost never come.
        c.flat[7] = -1e-3
        assert stages.tolerated(1.0, 0.0, stages.duals.room(c)) == pytest.approx(enough)
        assert stages.met == pytest.approx(off)


@pytest.mark.parametrize("equal", [True, False])
def test_a_stage_of_equations_without_a_step_is_followed_by_the_next_but_one(equal: bool) -> None:
    """Its minimum was where it began, and there are no active limits to be found."""
    after: dict[bool, list[float]] = {}
    for moved in (True, False):
        sides = [LimitSide("limit", ("c = 0",), equal, first, np.ones(1), np.zeros(1)) for first in (True, False)]
        stages = BarrierStages(Duals(sides, SideLayout([(10, 1), (10, 1)])), 1e-9, 1e-12)
        c = stages.duals.layout.filled([0.0, 0.0] if equal else [1.0, 1.0])
        stages.begin(1.0, c, lambda: 1.0)
        found = after[moved] = []
        while not stages.is_last:
            assert stages.advance(1.0, c, moved=moved)
            found.append(stages.duals.mu)
    if equal:
        assert after[False] == pytest.approx([*after[True][1:-1:2], after[True][-1]])
        assert len(after[False]) < len(after[True])
    else:
        assert after[False] == after[True]


def test_what_is_off_keeps_its_price() -> None:
    """Its dual has hardly begun to grow; by that it would be given away, and bought back in many stages."""
    side = LimitSide("limit", ("c >= 0",), False, False, np.ones(1), np.zeros(1))
    duals = Duals([side], SideLayout([(4, 1)]))
    c = duals.layout.empty()
    c.flat[:] = 1.0
    duals.begin(c, 1e-6, 1.0)
    c.flat[2] = -1e-2
    duals.y.flat[:] = 1e-6
    assert duals.price(c, 1e6, met=1e-4)
    assert duals.rho[0] == pytest.approx(10.0)
    assert not duals.price(c, 10.0, met=1e-4)
    assert duals.rho[0] == pytest.approx(10.0)
    c.flat[2] = 1.0
    duals.y.flat[:] = 1e-6
    assert not duals.price(c, 1e6, met=1e-4)
    assert duals.rho[0] < 0.1


def test_the_duals_tell_what_more_room_is_worth(cart: MidpointSystem, cost: QuadraticCost) -> None:
    def solve(bound: float) -> OptimizationResult:
        return optimize(cart, cost, limits=[Bound("x-force", max=bound)], initial=REST, tolerance=1e-11)

    h = 0.01
    fall = (solve(12.0 - h).cost - solve(12.0 + h).cost) / (2.0 * h)
    result = solve(12.0)
    assert np.sum(result.limits.dual("x-force <= 12")) == pytest.approx(fall, rel=1e-4)


def test_a_start_far_outside_of_the_limits_will_do(cart: MidpointSystem, cost: QuadraticCost) -> None:
    limits = [Bound("x-force", -12.0, 12.0), Bound("x", -0.3, 0.3)]
    rng = np.random.default_rng(4)
    u = 40.0 * rng.normal(size=(N, 1))
    wild = optimize(cart, cost, limits=limits, initial=(np.zeros(4), u), tolerance=1e-11)
    certify(cart, cost, limits, wild)
    assert wild.cost == pytest.approx(optimize(cart, cost, limits=limits, initial=REST).cost, rel=1e-8)


# ---- Going on --------------------------------------------------------------------------------------


@pytest.mark.parametrize("stop", [2, 4])
@pytest.mark.parametrize("name", ["push", "on the way"])
def test_a_run_that_was_stopped_goes_on_as_if_it_had_not_been(
    name: str, stop: int, cart: MidpointSystem, cost: QuadraticCost, tmp_path: Path
) -> None:
    limits = CASES[name]
    whole = optimize(cart, cost, limits=limits, initial=REST)
    part = optimize(cart, cost, limits=limits, initial=REST, max_iterations=stop)
    assert part.status is Status.ITERATION_LIMIT
    rest = optimize(cart, cost, limits=limits, resume=load_result(save_result(tmp_path / "part.npz", part)))
    assert rest.iterations == whole.iterations
    np.testing.assert_array_equal(rest.u, whole.u)
    for one, other in zip(rest.limits.sides, whole.limits.sides, strict=True):
        np.testing.assert_array_equal(one.dual, other.dual)


def test_what_is_looked_at_on_the_way_stays_as_it_is(cart: MidpointSystem, cost: QuadraticCost) -> None:
    plain = optimize(cart, cost, limits=CASES["push"], initial=REST)
    seen = optimize(cart, cost, limits=CASES["push"], initial=REST, callback=lambda record: record.snapshot() and None)
    np.testing.assert_array_equal(plain.u, seen.u)
    for one, other in zip(plain.limits.sides, seen.limits.sides, strict=True):
        np.testing.assert_array_equal(one.dual, other.dual)


def test_a_warm_start_keeps_the_duals(cart: MidpointSystem, cost: QuadraticCost) -> None:
    first = optimize(cart, cost, limits=CASES["push"], initial=REST)
    again = optimize(cart, cost, limits=CASES["push"], initial=first)
    assert again.iterations <= 4
    assert again.cost == pytest.approx(first.cost, rel=1e-9)


# ---- What is asked, and of what ----------------------------------------------------------------------


def test_values_belong_to_the_instants_in_the_order_given(cart: MidpointSystem, cost: QuadraticCost) -> None:
    limits = [Equal("theta", [0.5, 0.9], at=[2.5, 1.5])]
    result = optimize(cart, cost, limits=limits, initial=REST)
    assert result.success, result.message
    np.testing.assert_allclose(result.x[[125, 75], 1], [0.5, 0.9], atol=1e-6)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        (Bound("x-force", max=-np.inf), r"Bound\('x-force'\): max: got -inf, which nothing can meet"),
        (Bound("x-force", [np.inf] * N, np.inf), r"Bound\('x-force'\): min: got inf, which nothing can meet"),
        (Equal("x", np.inf), r"Equal\('x'\): value: got inf, which nothing can meet"),
    ],
)
def test_values_that_nothing_can_meet_are_named(limit: Bound | Equal, message: str, cart: MidpointSystem) -> None:
    """A largest value of minus infinity had been taken for no limit."""
    with pytest.raises(ArgumentError, match=message):
        limit.rows(cart, 1)


def test_values_belong_to_the_names_in_the_order_given(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """Not in that of the system, in which they had been taken without a word."""
    ends = Equal(["theta", "x"], [0.1, 0.2])
    result = optimize(cart, cost, initial=(np.zeros(4), np.zeros((cart.N, 1))), limits=[ends])
    assert result.success
    np.testing.assert_allclose(result.x[-1, :2], [0.2, 0.1], atol=1e-6)
    (rows,) = Bound(["theta", "x"], max=np.array([[1.0, 2.0]])).rows(cart, 1)
    assert rows.labels == ("theta <= 1", "x <= 2")


def test_bounds_over_time_are_told_by_their_ends(cart: MidpointSystem) -> None:
    """One that differs by rounding, as of steps of time, is one number: it was told as 140 .. 140."""
    for most, told in ((np.linspace(2.0, 3.0, cart.N), "x <= 2 .. 3"), (140.0 + 1e-12 * np.arange(cart.N), "x <= 140")):
        (rows,) = Bound("x", max=most).rows(cart, 1)
        assert rows.labels == (told,)


def test_what_holds_all_along_is_named_among_what_stands_against() -> None:
    """Its duals are small at each instant: ends at rest were named, and not the rate that lets nobody get there."""

    def side(labels: tuple[str, ...], values: list[list[float]], duals: list[list[float]]) -> LimitState:
        value, n = np.array(values), len(values)
        return LimitState(
            limit="", labels=labels, equation=n == 1, k=np.arange(n), value=value, dual=np.array(duals),
            price=np.full(len(labels), 1e6), active=np.ones(value.shape, dtype=np.bool_),
        )  # fmt: skip

    rests = ("at rest", "upright", "still", "in place")
    report = LimitReport(
        (
            side(("there",), [[-1.0]], [[1e6]]),
            side(rests, [[0.0, 0.0, 0.0, 0.0]], [[2.0, 3.0, 4.0, 5.0]]),
            side(("slowly",), [[0.0]] * 100, [[1.0]] * 100),
        ),
        mu=1e-6,
        excess=1.0,
    )
    said = report.contradiction(lambda k: f"step {k}")
    assert said.startswith("Not met: 'there' by 1 at step 0. Against that stand 'slowly'")


@pytest.mark.parametrize("width", [None, 1, 2])
def test_bounds_on_states_may_be_given_for_all_instants(width: int | None, cart: MidpointSystem) -> None:
    """The first of them, whose state is fixed, is no row."""
    bounds = np.linspace(0.5, 2.0, N + 1)
    given = bounds if width is None else np.tile(bounds[:, None], (1, width))
    (whole,) = Bound(["x", "theta"], max=given).rows(cart, 1)
    (late,) = Bound(["x", "theta"], max=given[1:]).rows(cart, 1)
    np.testing.assert_array_equal(whole.k, np.arange(1, N + 1))
    np.testing.assert_array_equal(whole.bounds, late.bounds)
    np.testing.assert_array_equal(whole.bounds, np.tile(bounds[1:, None], (1, 2)))
    (free,) = Bound(["x", "theta"], max=given).rows(cart, 0)
    np.testing.assert_array_equal(free.k, np.arange(N + 1))


FORBIDDEN = {
    "a constant": ([Bound("x", min=0.2)], ("Bound('x')", "violates 'x >= 0.2' by 0.2", "free_start")),
    "of one name": ([Bound(["x", "theta"], [[-1.0, 0.1]], 2.0)], ("'theta >= 0.1' by 0.1",)),
    "a function": ([Bound("x", max=lambda t: t - 0.1)], ("'x <= -0.1' by 0.1",)),
    "all instants": ([Bound("x", min=np.r_[0.3, np.full(N, -1.0)])], ("'x >= 0.3' by 0.3",)),
    "a place": ([Keep("bob", outside=Ball((0.0, -1.0, 0.0), 0.3))], ("'bob not within 0.3 m of", " by 0.")),
    "equations": ([Equal("x", 1.0, at=None)], ("Equal('x')", "'x = 1' by 1")),
}


@pytest.mark.parametrize("name", FORBIDDEN)
def test_a_fixed_initial_state_that_violates_a_limit_is_named(name: str, cart: MidpointSystem, cost) -> None:
    limits, words = FORBIDDEN[name]
    with pytest.raises(ArgumentError) as caught:
        optimize(cart, cost, limits=limits, initial=REST)
    for word in words:
        assert word in str(caught.value)


def test_limits_that_begin_later_say_nothing_of_the_initial_state(cart: MidpointSystem, cost: QuadraticCost) -> None:
    later = [Bound("x", min=np.full(N, -0.01)), Bound("x", min=0.0, at=[1.0, 2.0]), Bound("x", min=-1e-9)]
    for limit in later:
        assert optimize(cart, cost, limits=[limit], initial=(np.r_[-1e-8, 0.0, 0.0, 0.0], REST[1])).success
    wanted = [Bound("x", min=0.01)]
    found = optimize(cart, cost, limits=wanted, initial=REST, free_start=["x"])
    assert found.success, found.message
    assert found.x[0, 0] >= 0.01 - 1e-6


@pytest.mark.parametrize("of", ["input", "state", "momentum", "rate"])
def test_a_window_of_a_system_has_its_quantities(of: str, cart: MidpointSystem, rng: np.random.Generator) -> None:
    start, stop = 40, 60
    x, u = rng.normal(size=(N + 1, cart.nx)), rng.normal(size=(N, cart.nu))
    bound = Bound("*", min=-1.0, of=of)
    (whole,), (part,) = bound.rows(cart, 1), bound.rows(WindowSystem(cart, start, stop), 1)
    of_whole = whole.values(x, u)[np.isin(whole.k, start + part.k)]
    of_part = part.values(x[start : stop + 1], u[start:stop])
    assert len(part.k) >= stop - start - 1
    np.testing.assert_allclose(of_part, of_whole, atol=1e-9)


# ---- What cannot be, and what is wrong ----------------------------------------------------------------


def test_limits_that_contradict_each_other_are_named(cart: MidpointSystem, cost: QuadraticCost) -> None:
    limits = [Bound("x-force", -3.0, 3.0), Equal("x", 2.0, at=0.4)]
    result = optimize(cart, cost, limits=limits, initial=REST)
    assert result.status is Status.INFEASIBLE
    assert not result.success
    assert "Not met: 'x = 2' by" in result.message
    assert "t = 0.4 s" in result.message
    assert "'x-force <= 3'" in result.message


def test_what_is_off_by_next_to_nothing_is_not_said_not_to_be_met() -> None:
    """All duals are those of the highest price, 10."""

    def side(label: str, value: float, dual: float, *, equation: bool) -> LimitState:
        each = np.array([[value]]), np.array([[dual]])
        return LimitState(label, (label,), equation, np.array([4]), *each, np.array([10.0]), np.array([[True]]))

    off, met = side("x = 2", -0.1, 10.0, equation=True), side("y = 1", 1e-6, 10.0, equation=True)
    push = side("push <= 1", 1e-9, 3.0, equation=False)

    def told(*sides: LimitState) -> str:
        return LimitReport(sides, 1e-9, 0.1).contradiction(lambda k: f"step {k}")

    least = "Not met: 'x = 2' by 0.1 at step 4. Against that stand "
    assert told(off, met, push) == least + "'push <= 1' (most at step 4)."
    assert told(off, met) == least + "'y = 1' (most at step 4)."


def test_what_cannot_be_met_is_off_by_the_least_that_is_possible() -> None:
    """Two carts that are to change places in a time that their motors do not suffice for, against a linear program."""
    steps, h, most = 30, 0.1, np.array([0.3, 0.05])
    A, B = np.eye(4), np.zeros((4, 2))
    A[0, 2] = A[1, 3] = h
    B[2, 0] = B[3, 1] = h
    carts = LinearSystem(A, B, N=steps)
    price = QuadraticCost(np.zeros((steps + 1, 4)), np.zeros((steps, 2)), Q=np.zeros(4), R=[1.0, 1.0])
    limits = [Bound("u*", -most[None], most[None]), Equal("x*", [1.0, -1.0, 0.0, 0.0])]
    start = np.array([0.2, 0.0, 0.1, 0.0])
    result = optimize(carts, price, limits=limits, initial=(start, np.zeros((steps, 2))))
    assert result.status is Status.INFEASIBLE, result.message
    assert "u[1]" in result.message
    assert result.limits is not None
    sides = result.limits.sides
    paid = sum(float(np.sum(s.price * (np.abs(s.value) if s.equation else np.maximum(-s.value, 0.0)))) for s in sides)
    # Unknowns: inputs, by how much they are out of bounds, and by how much the end is off to either side.
    powers = [np.linalg.matrix_power(A, steps - 1 - k) @ B for k in range(steps)]
    n = 2 * steps
    equations = np.hstack([np.hstack(powers), np.zeros((4, n)), np.eye(4), -np.eye(4)])
    end = np.array([1.0, -1.0, 0.0, 0.0]) - np.linalg.matrix_power(A, steps) @ start
    beyond = np.block([[np.eye(n), -np.eye(n), np.zeros((n, 8))], [-np.eye(n), -np.eye(n), np.zeros((n, 8))]])
    inputs, ends = [s.price for s in sides if not s.equation], [s.price for s in sides if s.equation]
    dear = np.concatenate([np.zeros(n), np.tile(inputs[0], steps), np.tile(np.concatenate(ends), 2)])
    bounds = [(None, None)] * n + [(0.0, None)] * (n + 8)
    least = linprog(dear, beyond, np.tile(most, 2 * steps), equations, end, bounds).fun
    assert least <= paid <= 1.02 * least


def test_conditions_that_motors_are_too_weak_for_are_told_from_those_that_they_reach() -> None:
    """A body in space turns by three wheels; with prices for each limit the search went on for 1000 iterations."""
    wheels = [
        [tx(0.1), [rx("wx", mass=0.3, inertia=(2e-3, 1e-3, 1e-3))]],
        [ty(0.1), [ry("wy", mass=0.3, inertia=(1e-3, 2e-3, 1e-3))]],
        [tz(0.1), [rz("wz", mass=0.3, inertia=(1e-3, 1e-3, 2e-3))]],
    ]
    body = ball("body", axes="xyz", mass=10.0, inertia=(0.4, 0.5, 0.3))
    tree = [body, [part for wheel in wheels for part in wheel]]
    m = Mechanism(tree, [JointForce(wheel, input=wheel.replace("w", "m")) for wheel in ("wx", "wy", "wz")])
    vi = MidpointVI(m)
    system = MidpointSystem(vi, np.linspace(0.0, 6.0, 121))
    wanted = np.zeros((121, 12))
    wanted[:, :3] = attitude = [1.0, 0.6, -0.8]
    price = QuadraticCost(wanted, np.zeros((120, 3)), Q=[0.05] * 3 + [0.0] * 9, R=np.ones(3))
    turned = [Equal("body.*", attitude), Equal("body.*", 0.0, of="rate")]
    rest = vi.start(np.zeros(6)).x, np.zeros((120, 3))
    for most in (0.02, 0.04):
        weak = optimize(system, price, initial=rest, limits=[Bound("m?", -most, most), *turned])
        assert weak.status is Status.INFEASIBLE, weak.message
        assert weak.iterations < 600
        assert "Against that stand '" in weak.message
    strong = optimize(system, price, initial=rest, limits=[Bound("m?", -0.045, 0.045), *turned])
    assert strong.status is Status.CONVERGED, strong.message


def test_limits_that_are_still_violated_when_iterations_run_out_are_named(
    cart: MidpointSystem, cost: QuadraticCost
) -> None:
    limits = [Bound("x-force", -30.0, 30.0), Equal("x", 0.5)]
    result = optimize(cart, cost, limits=limits, initial=REST, max_iterations=2)
    assert result.status is Status.ITERATION_LIMIT
    assert "Limits are still violated: 'x = 0.5' by" in result.message
    whole = optimize(cart, cost, limits=limits, initial=REST)
    assert whole.success
    assert "violated" not in whole.message


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ([Bound("x", max=0.5), Bound("x", min=0.6, at=[0.2, 0.4])], ("0.6 or more at", "t = 0.2 s", "0.5 or less")),
        ([Bound("x", max=0.5), Equal("x", 1.0)], ("Equal('x')", "Bound('x')", "'x'", "1 or more")),
        ([Bound("x-force", max=1.0), Bound("*", 2.0, 3.0, of="input")], ("Bound('*')", "'x-force'")),
    ],
)  # fmt: skip
def test_limits_that_no_value_can_meet_are_told_at_once(
    limits: list[Bound | Equal], words: tuple[str, ...], cart: MidpointSystem, cost: QuadraticCost
) -> None:
    with pytest.raises(ArgumentError) as info:
        optimize(cart, cost, limits=limits, initial=REST)
    for word in words:
        assert word in str(info.value)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ([Bound("x-forc", -1.0, 1.0)], ("x-force",)),
        ([Bound("x-force", 1.0, -1.0)], ("min 1", "max -1", "t = 0 s")),
        ([Bound("x-force")], ("neither min nor max",)),
        ([Bound("x", 1.0, of="force")], ("of='force'", "'rate'")),
        ([Bound("x", np.nan)], ("NaN",)),
        ([Bound("x", np.zeros(7))], ("(7,)", "(150,)", "(151,)")),
        ([Bound("x-force", np.zeros(N + 1))], ("(151,)", "(150,)")),
        ([Bound("x", np.r_[1.0, np.zeros(N)], 0.5)], ("min 1", "max 0.5", "t = 0 s")),
        ([Bound({}, 0.0)], ("no names",)),
        ([Bound({"x": 1.0, "thetta": 1.0}, 0.0)], ("'thetta'", "'theta'")),
        ([Bound({"x": 0.0}, 0.0)], ("weight of 0 for 'x'",)),
        ([Bound({"x": 1.0, "x-force": 1.0}, 0.0)], ("several quantities",)),
        ([Bound("x", 0.0, at=0)], ("initial state is fixed",)),
        ([Bound("x", 0.0, at="start")], ("initial state is fixed", "'start'")),
        ([Bound("x", 0.0, at=np.nan)], ("nan", "'start'", "a time")),
        ([Equal(["x", "theta"], [1.0, 2.0, 3.0])], ("(3,)", "(2,)", "a function of the time")),
        ([Bound("x", 0.0, at=1.234567)], ("1.23457", "1.24")),
        ([Bound("x", 0.0, at="middle")], ("'middle'", "'end'")),
        ([Bound("string", min=0.0, of="tension")], ("tension", "'variable'", "multipliers=True")),
        ([3], ("limits[0]", "int")),
        ([Keep("hand", inside=Box((0, 0, 0), (1, 1, 1)))], ("hand",)),
        ([Within(FunctionQuantity("f", lambda x: x))], ("'f'", "(150, 4)", "(150, 1)")),
        ([Within(FunctionQuantity("f", lambda x: np.abs(x[:, 0])))], ("complex",)),
    ],
)  # fmt: skip
def test_wrong_limits_are_named(limits, words, cart: MidpointSystem, cost: QuadraticCost) -> None:
    with pytest.raises(ArgumentError) as caught:
        optimize(cart, cost, limits=limits, initial=REST)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Keep("bob"),
        lambda: Keep("bob", inside=Ball((0, 0, 0), 1.0), outside=Ball((0, 0, 0), 1.0)),
        lambda: Keep("bob", outside=Box((0, 0, 0), (1, 1, 1))),
        lambda: Keep("bob", inside=(0, 1)),
        lambda: Box((0, 0, 0), (1, -1, 1)),
        lambda: Ball((0, 0), 1.0),
        lambda: Ball((0, 0, 0), -1.0),
        lambda: HalfSpace((0, 0, 0)),
    ],
)
def test_wrong_regions_are_named(wrong) -> None:
    with pytest.raises(ArgumentError):
        wrong()


# ---- Derivatives of quantities -----------------------------------------------------------------------


def scattered(J, H, columns, size):
    """Return derivatives in some columns as derivatives in all."""
    to = np.eye(size)[columns]
    return J @ to, None if H is None else to.T @ H @ to


@pytest.mark.parametrize("name", CASES)
def test_the_derivatives_of_rows(name: str, cart: MidpointSystem, rng: np.random.Generator) -> None:
    """First derivatives against differences of values, second ones against differences of first ones."""
    for rows in (row for limit in CASES[name] for row in limit.rows(cart, 1)):
        quantity, n = rows.quantity, 5
        k = rows.k[rng.integers(0, len(rows.k), n)]
        sizes = (4,) if quantity.of_state else (4, 1, 4) if quantity.looks_ahead else (4, 1)
        z = rng.normal(size=(n, sum(sizes)))
        y = rng.normal(size=(n, len(quantity.names)))

        def at(z: np.ndarray, k=k, n=n, sizes=sizes) -> Samples:
            parts = [*np.split(z, np.cumsum(sizes)[:-1], axis=1), np.empty((n, 0)), np.empty((n, 0))]
            return Samples(k, *parts[:3])

        J, H = quantity.jacobian(at(z)), quantity.curvature(at(z), y)
        columns = quantity.columns(4, 1)
        if columns is not None:
            J, H = scattered(J, H, columns, z.shape[1])
        h = 1e-6
        for i in range(z.shape[1]):
            e = h * np.eye(z.shape[1])[i]
            difference = (quantity.values(at(z + e)) - quantity.values(at(z - e))) / (2.0 * h)
            np.testing.assert_allclose(J[:, :, i], difference, atol=2e-8)
            slopes = [np.einsum("kmi,km->ki", quantity.jacobian(at(z + s * e)), y) for s in (1.0, -1.0)]
            bend = (slopes[0] - slopes[1]) / (2.0 * h)
            if columns is not None:
                bend = scattered(bend[:, None, :], None, columns, z.shape[1])[0][:, 0]
            np.testing.assert_allclose(0.0 if H is None else H[:, i], bend, atol=3e-8)


def test_the_derivatives_of_tensions_and_accelerations(rng: np.random.Generator) -> None:
    """Against differences, of strings with lengths that vary and that do not, over steps of different lengths."""
    m = Mechanism(
        [tx("a"), [tz(-1.0, name="A", mass=1.0)], ty("b"), [tz(-1.0, name="B", mass=1.0)]],
        [Gravity(), Distance("A", "world", "L", name="long"), Distance("B", "world", 1.3, name="short"),
         PathLength(["A", "B", "world"], "L", name="path")],
    )  # fmt: skip
    system = MidpointSystem(MidpointVI(m, threads=1), [0.0, 0.1, 0.3, 0.35], multipliers=True)
    n = [system.nx, system.nu, system.nx]
    z, y = rng.normal(size=(3, sum(n))), rng.normal(size=(3, 3))

    def at(z: np.ndarray) -> Samples:
        return Samples(np.arange(3) + quantity.of_state, *np.split(z, np.cumsum(n)[:-1], axis=1))

    sums = [
        WeightedSum(system.quantity(kind), np.array([3.0, -2.0, 0.5, 0.0][: len(system.quantity(kind).names)]))
        for kind in ("tension", "rate")
    ]
    for quantity in (*(system.quantity(kind) for kind in ("tension", "acceleration", "rate")), *sums):
        weights = y[:, : len(quantity.names)] if len(quantity.names) <= 3 else rng.normal(size=(3, len(quantity.names)))
        columns = quantity.columns(system.nx, system.nu)
        J, H = scattered(quantity.jacobian(at(z)), quantity.curvature(at(z), weights), columns, sum(n))
        h = 1e-6
        for i in range(sum(n)):
            e = h * np.eye(sum(n))[i]
            difference = (quantity.values(at(z + e)) - quantity.values(at(z - e))) / (2.0 * h)
            np.testing.assert_allclose(J[:, :, i], difference, atol=1e-6)
            ends = [scattered(quantity.jacobian(at(z + s * e)), None, columns, sum(n))[0] for s in (1.0, -1.0)]
            bend = np.einsum("kmi,km->ki", ends[0] - ends[1], weights) / (2.0 * h)
            np.testing.assert_allclose(0.0 if H is None else H[:, i], bend, atol=1e-6)


@pytest.mark.parametrize("of_state", [True, False])
@pytest.mark.parametrize("indexed", [False, True])
def test_functions_with_derivatives_of_their_own(rng: np.random.Generator, of_state: bool, indexed: bool) -> None:
    """They are called for all instants at once, and are those that differences find."""

    def factor(given: tuple[np.ndarray, ...]) -> np.ndarray:
        return 1.0 + given[-1] if indexed else np.ones(len(given[0]))

    def values(x: np.ndarray, *given: np.ndarray) -> np.ndarray:
        more = 0.0 if of_state else given[0][:, 0] ** 3
        return np.stack([factor((x, *given)) * np.sin(x[:, 0]) * x[:, 1], x[:, 1] ** 2 + more], axis=1)

    def jacobian(x: np.ndarray, *given: np.ndarray) -> np.ndarray:
        J, a = np.zeros((len(x), 2, 2 if of_state else 3)), factor((x, *given))
        J[:, 0, 0], J[:, 0, 1], J[:, 1, 1] = a * np.cos(x[:, 0]) * x[:, 1], a * np.sin(x[:, 0]), 2.0 * x[:, 1]
        if not of_state:
            J[:, 1, 2] = 3.0 * given[0][:, 0] ** 2
        return J

    def curvature(x: np.ndarray, *given: np.ndarray) -> np.ndarray:
        y = given[0 if of_state else 1]
        n = 2 if of_state else 3
        H, a = np.zeros((len(x), n, n)), factor((x, *given))
        H[:, 0, 0] = -y[:, 0] * a * np.sin(x[:, 0]) * x[:, 1]
        H[:, 0, 1] = H[:, 1, 0] = y[:, 0] * a * np.cos(x[:, 0])
        H[:, 1, 1] = 2.0 * y[:, 1]
        if not of_state:
            H[:, 2, 2] = y[:, 1] * 6.0 * given[0][:, 0]
        return H

    options = {"of_state": of_state, "indexed": indexed}
    found = FunctionQuantity(["f", "g"], values, **options)
    own = FunctionQuantity(["f", "g"], values, jacobian=jacobian, curvature=curvature, **options)
    half = FunctionQuantity(["f", "g"], values, jacobian=jacobian, **options)
    at = Samples(np.arange(2, 6), rng.normal(size=(4, 2)), rng.normal(size=(4, 1)), rng.normal(size=(4, 2)))
    y = rng.normal(size=(4, 2))
    np.testing.assert_allclose(own.jacobian(at), found.jacobian(at), atol=1e-14)
    np.testing.assert_allclose(own.curvature(at, y), found.curvature(at, y), atol=1e-8)
    np.testing.assert_allclose(own.curvature(at, y), half.curvature(at, y), atol=1e-8)
    wrong = FunctionQuantity(
        "f", lambda x, *_: x[:, 0], jacobian=lambda x, *_: x, curvature=lambda x, *_: x, **options
    )  # fmt: skip
    with pytest.raises(
        ArgumentError, match=r"limit 'f': jacobian: the function returned shape \(4, 2\), expected \(4, 1, "
    ):
        wrong.jacobian(at)
    with pytest.raises(
        ArgumentError, match=r"limit 'f': curvature: the function returned shape \(4, 2\), expected \(4, "
    ):
        wrong.curvature(at, y[:, :1])


def test_what_is_limited_is_the_tension_that_a_trajectory_tells() -> None:
    m = Mechanism(
        [tx("a"), [tz("c"), [tz(0.0, name="A", mass=1.0)]], tx("d"), [tz("e"), [tz(0.0, name="B", mass=1.0)]],
         tx("f"), [tz("g", name="C", mass=1.0)]],
        [Gravity(), Distance("A", "world", "L", name="long"), Distance("B", "world", 1.3, name="short"),
         PointOnPlane("world", "C", name="no string")],
    )  # fmt: skip
    vi = MidpointVI(m, threads=1)
    system = MidpointSystem(vi, [0.0, 0.01, 0.03, 0.035], multipliers=True)
    q = m.configuration({"a": 0.0, "c": -1.2, "d": 0.0, "e": -1.3, "L": 1.2})
    run = vi.simulate(vi.start(q), system.t, rho=[[1.2], [1.201], [1.203], [1.202]])
    x = np.hstack([run.x, np.vstack([np.zeros(3), run.lam])])
    quantity = system.quantity("tension")
    assert quantity.names == ("long", "short")
    told = np.stack([run.tensions()[name] for name in quantity.names], axis=1)
    assert (np.abs(told) > 1.0).all()
    np.testing.assert_allclose(quantity.values(Samples(np.arange(1, 4), x[1:], run.u, x[1:])), told, rtol=1e-11)


@pytest.mark.parametrize("of", ["tension", "acceleration"])
def test_a_window_limits_what_reaches_over_two_steps(of: str, rng: np.random.Generator) -> None:
    m = Mechanism([tz("z"), [tz(-1.0, name="A", mass=1.0)]], [Gravity(), Distance("A", "world", "L", name="string")])
    system = MidpointSystem(MidpointVI(m, threads=1), [0.0, 0.1, 0.3, 0.35, 0.5, 0.6], multipliers=True)
    x, u = rng.normal(size=(6, system.nx)), rng.normal(size=(5, system.nu))
    bound = Bound("*", min=-1.0, of=of)
    (whole,), (part,) = bound.rows(system, 1), bound.rows(WindowSystem(system, 2, 5), 1)
    np.testing.assert_allclose(part.values(x[2:], u[2:]), whole.values(x, u)[np.isin(whole.k, 2 + part.k)])
    y = rng.normal(size=(len(part.k), 1))
    bends = Weights(3, part.weighs(system.nx, system.nu))
    part.add_hessian(x[2:], u[2:], part.jacobian(x[2:], u[2:]), y, np.abs(y), bends, None)
    assert np.abs(bends.matrices).sum() > 0.0


@pytest.mark.parametrize("instants", [[0, 1, 2, 3], [1, 2], [0, 3]])
@pytest.mark.parametrize("columns", [[0, 1, 2, 3, 4], [3, 4], [0, 1], [1, 2, 4], [4, 0, 2, 3]])
def test_matrices_of_steps_are_summed_by_their_places(
    instants: list[int], columns: list[int], rng: np.random.Generator
) -> None:
    k, at = np.array(instants), np.array(columns)
    few = np.unique([*columns, 2])
    weights = Weights(4, few)
    for _ in range(2):  # memory that is used again
        weights.clear()
        dense = np.zeros((5, 5, 5))
        for _ in range(2):
            bent = rng.normal(size=(len(k), len(at), len(at)))
            bent += bent.transpose(0, 2, 1)
            J, sigma = rng.normal(size=(len(k), 3, len(at))), rng.uniform(size=(len(k), 3))
            J[:, 1, 0] = 0.0
            weights.add(k, at, J, sigma, bent)
            weights.add(k, at, J, sigma, None)
            dense[np.ix_(k, at, at)] += 2.0 * np.einsum("kmi,km,kmj->kij", J, sigma, J) - bent
        np.testing.assert_allclose(weights.matrices, dense[:, few[:, None], few], atol=1e-13)


@pytest.mark.parametrize("name", ["push", "rate"])
def test_stages_end_without_a_model_that_only_says_so(
    name: str, cart: MidpointSystem, cost: QuadraticCost, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a full Newton step it is foreseen that a barrier's minimum is near: the next direction is another's."""
    solved, minimise = [], Models.minimise

    def counted(self: Models, method: str, scale: float, shift: float = 0.0):
        solved.append(self.merit.duals.mu)
        return minimise(self, method, scale, shift)

    monkeypatch.setattr(Models, "minimise", counted)
    result = optimize(cart, cost, limits=CASES[name], initial=REST)
    assert result.status is Status.CONVERGED
    stages = len(set(solved))
    assert stages >= 5
    assert len(solved) <= result.iterations + stages - 3


@pytest.mark.parametrize(
    ("inside", "outside", "far"),
    [
        (Box((-0.1, -0.1, -1.1), (0.1, 0.1, -0.9)), Ball((0.0, 0.0, -1.0), 0.3), 0.3 - 0.1 * np.sqrt(3.0)),
        (Ball((0.0, 0.0, -1.0), 0.1), Ball((0.0, 0.1, -1.0), 0.3), 0.1),
        (Ball(lambda t: (0.0, 0.2 * t, -1.0), 0.1), Ball((0.0, 0.0, -1.0), 0.3), 0.2 - 0.2 * DT),
        (Ball((0.0, 0.0, -1.0), 0.1), HalfSpace((0.0, 0.0, -2.0), 0.8), 0.5),
        (HalfSpace((0.0, 0.0, 1.0), 0.5), HalfSpace((0.0, 0.0, 2.0), 0.6), 0.2),
    ],
    ids=["box and ball", "balls", "moving ball", "ball and plane", "planes"],
)
def test_places_that_exclude_each_other_are_told_before_the_first_step(
    inside, outside, far: float, cart: MidpointSystem, cost: QuadraticCost
) -> None:
    limits = [Keep("bob", inside=inside), Keep("bob", outside=outside)]
    with pytest.raises(
        ArgumentError, match=r"limits: 'bob .* and 'bob not .* exclude each other at step \d+ .*apart"
    ) as told:
        optimize(cart, cost, initial=REST, limits=limits)
    assert float(str(told.value).split("for is ")[1].split(" ")[0]) == pytest.approx(far, rel=1e-3)
    elsewhere = [limits[0], Keep("cart", outside=outside)]
    later = [Keep("bob", inside=inside, at=1.0), Keep("bob", outside=outside, at=2.0)]
    for fine in (elsewhere, later):
        rows = [row for limit in fine for row in limit.rows(cart, 1)]
        DiscreteProblem(cart, cost, optimize(cart, cost, initial=REST, max_iterations=0).settings, rows)


@pytest.mark.parametrize(
    "other",
    [
        Keep("bob", inside=Box((0.2, -1.0, -2.0), (0.3, 1.0, 0.0))),
        Keep("bob", inside=Ball((0.4, 0.0, -1.0), 0.25)),
        Keep("bob", inside=HalfSpace((1.0, 0.0, 0.0), 0.15)),
    ],
    ids=["box", "ball", "plane"],
)
def test_places_that_do_not_meet_are_told_before_the_first_step(
    other: Keep, cart: MidpointSystem, cost: QuadraticCost
) -> None:
    box = Keep("bob", inside=Box((-0.1, -1.0, -2.0), (0.1, 1.0, 0.0)))
    for limits in ([box, other], [other, box]):
        with pytest.raises(ArgumentError, match="exclude each other"):
            optimize(cart, cost, initial=REST, limits=limits)
    wider = Keep("bob", inside=Box((-0.1, -1.0, -np.inf), (0.5, 1.0, 0.0)))
    rows = [row for limit in (wider, other) for row in limit.rows(cart, 1)]
    DiscreteProblem(cart, cost, optimize(cart, cost, initial=REST, max_iterations=0).settings, rows)


class RoughCost(QuadraticCost):
    """Off by far more than the rounding of its sum, as roll-outs to a tolerance are."""

    def stage_values(self, x: np.ndarray, u: np.ndarray, start: int) -> np.ndarray:
        return super().stage_values(x, u, start) + 3e-7 * np.sin(1e10 * x[:, 1])


@pytest.mark.parametrize("method", ["auto", "newton"])
def test_searches_see_how_much_a_cost_is_off(method: str, cart: MidpointSystem, cost: QuadraticCost) -> None:
    wanted = 2.0 * cost.x_wanted
    rough = RoughCost(wanted, cost.u_wanted, Q=cost.Q, R=cost.R)
    smooth = QuadraticCost(wanted, cost.u_wanted, Q=cost.Q, R=cost.R)
    result = optimize(cart, rough, limits=CASES["push"], initial=REST, method=method, tolerance=1e-12)
    assert result.success, result.message
    assert result.iterations <= 15
    exact = optimize(cart, smooth, limits=CASES["push"], initial=REST, tolerance=1e-12)
    assert result.cost == pytest.approx(exact.cost, rel=1e-8)


def linear_within(limits: list[Bound], *, free_start: bool) -> DiscreteProblem:
    """Return a linear system's problem within limits, at its first trajectory."""
    rng = np.random.default_rng(2)
    N, nx, nu = 20, 3, 2
    system = LinearSystem(rng.normal(size=(N, nx, nx)) / 2.0, rng.normal(size=(N, nx, nu)))
    cost = QuadraticCost(rng.normal(size=(N + 1, nx)), np.zeros((N, nu)), Q=np.ones(nx), R=[0.1, 0.2])
    start = np.zeros((N + 1, nx)), np.zeros((N, nu))
    settings = optimize(system, cost, initial=start, max_iterations=0).settings
    rows = [row for limit in limits for row in limit.rows(system, 1)]
    problem = DiscreteProblem(system, cost, settings, rows, free_start)
    problem.start(start)
    return problem


@pytest.mark.parametrize("free_start", [False, True])
def test_further_steps_of_a_model_lead_to_where_it_is_least(free_start: bool) -> None:
    """Of a linear system it is the cost itself: what they foretell comes true, and little is left to be gained."""
    limits = [Bound("*", -0.5, 0.4, of="input"), Bound("x[1]", -0.3, 0.6)]
    problem = linear_within(limits, free_start=free_start)
    problem.parts.barrier.duals.mu *= 1e-3
    problem.parts.set_out()
    gained = []
    for holds in (False, True):
        direction = problem.steps.direction("quasi-newton", problem.models.minimise("quasi-newton", 0.0), 0.0)
        direction = problem.models.refined(direction, holds=holds)
        length = problem.steps.first_step(direction, 1.0)
        trial = problem.steps.simulate(direction, length, np.inf)
        assert isinstance(trial, Trial)
        gained.append(problem.here.value - trial.cost)
        assert gained[-1] == pytest.approx(problem.steps.promised(direction, length), rel=1e-9)
    assert length == 1.0
    assert gained[1] > 1.05 * gained[0]
    problem.steps.accept(direction, trial)
    following = problem.steps.direction("quasi-newton", problem.models.minimise("quasi-newton", 0.0), 0.0)
    assert -following.slope < 0.3 * gained[1]


@pytest.mark.parametrize(("most", "bends"), [(0.5, True), (2.0, True), (5.0, False)])
def test_a_full_step_goes_on_within_the_model_where_barriers_bend_along_it(most: float, bends: bool) -> None:
    """From the minimum of one barrier to that of a smaller one: limits that are far away are as their model is."""
    problem = linear_within([Bound("*", -most, most, of="input")], free_start=False)

    def direction(*, holds: bool):
        model = problem.models.minimise("quasi-newton", 0.0)
        return problem.models.refined(problem.steps.direction("quasi-newton", model, 0.0), holds=holds)

    for _ in range(8):
        found = direction(holds=True)
        trial = problem.steps.simulate(found, problem.steps.first_step(found, 1.0), np.inf)
        assert isinstance(trial, Trial)
        problem.steps.accept(found, trial)
    problem.parts.barrier.duals.mu *= 0.03
    problem.parts.set_out()
    first = direction(holds=False)
    assert first.reach == 1.0
    more = direction(holds=True).promise / first.promise
    assert more > 1.1 if bends else more == 1.0


def test_a_stage_ends_sooner_where_its_duals_are_near_those_of_the_barrier() -> None:
    """From elsewhere a much smaller barrier leads close to limits whose duals are still those of others."""
    side = LimitSide("limit", ("c >= 0",), False, False, np.ones(1), np.zeros(1))
    stages = BarrierStages(Duals([side], SideLayout([(50, 1)])), 1e-9, 1e-12)
    c = stages.duals.layout.empty()
    c.flat[:] = 1.0
    stages.begin(1.0, c, lambda: 1.0)
    duals = stages.duals
    room = duals.room(c)
    assert duals.are_central(room)
    loose = stages.tolerated(0.0, 0.0, room)
    duals.y.flat[7] *= 100.0
    assert not duals.are_central(room)
    tight = stages.tolerated(0.0, 0.0, room)
    assert loose == pytest.approx(10.0 * tight)
    assert stages.tolerated(2.0 * loose, 0.0, room) == 2.0 * loose


def test_the_least_that_limits_are_off_by_is_looked_for_once() -> None:
    """However prices times scales are rounded: a search that leads nowhere would begin with that for ever."""
    for scale in np.random.default_rng(0).uniform(0.1, 10.0, 200):
        side = LimitSide("limit", ("c >= 0",), False, False, np.array([scale]), np.zeros(1))
        stages = BarrierStages(Duals([side], SideLayout([(5, 1)])), 1e-9, 1e-12)
        c = stages.duals.layout.empty()
        c.flat[:] = -scale
        stages.begin(960.1668613147427, c, lambda: 1.0)
        assert stages.look_for_the_least(c)
        assert not stages.look_for_the_least(c)


def test_prices_of_equations_fall_to_a_hundred_duals_in_the_end() -> None:
    """Dear ones leave their barriers no room, and before the end duals are rough."""
    sides = [LimitSide("equal", ("c = 0",), True, first, np.ones(1), np.zeros(1)) for first in (True, False)]
    duals = Duals(sides, SideLayout([(1, 1), (1, 1)]))
    c = duals.layout.empty()
    c.flat[:] = 0.0
    duals.begin(c, 1e-6, 1.0)
    least = duals.least_mu(1e-12)
    for kept, price in ((np.inf, 1.0), (0.5, 0.5), (0.0, 0.01), (0.0, 0.01)):
        duals.y.flat[:] = 0.5 * duals.prices + np.array([0.5e-4, -0.5e-4])
        assert not duals.price(c, 1e6, kept=kept)
        assert float(duals.rho.flat[0]) == pytest.approx(price, rel=1e-9)
        assert duals.net(duals.y.flat) == pytest.approx([1e-4, -1e-4], rel=1e-9)
    assert duals.least_mu(1e-12) == pytest.approx(0.01 * least, rel=0.1)


def test_duals_of_equations_stay_as_they_are_where_prices_do() -> None:
    """To the last bit: what was computed with them is not computed again for rounding."""
    sides = [LimitSide("equal", ("c = 0",), True, first, np.ones(1), np.zeros(1)) for first in (True, False)]
    duals = Duals(sides, SideLayout([(5, 1), (5, 1)]))
    c = duals.layout.empty()
    c.flat[:] = np.r_[np.linspace(-1e-3, 1e-3, 5), np.linspace(1e-3, -1e-3, 5)]
    duals.begin(c, 1e-3, 1.0)
    duals.price(c, 1e6)
    before = duals.y.flat.copy()
    duals.y.flat[:] *= 1.0 + 2.0**-52 * np.arange(10)
    kept = duals.y.flat.copy()
    duals.price(c, 1e6)
    np.testing.assert_array_equal(duals.y.flat, kept)
    assert (before != kept).any()


def test_where_the_model_holds_a_run_takes_few_roll_outs() -> None:
    """What barriers bend is found without another roll-out."""
    rng = np.random.default_rng(5)
    system = LinearSystem(np.tile(np.array([[1.0, 0.1], [0.0, 1.0]]), (60, 1, 1)), np.tile([[0.0], [0.1]], (60, 1, 1)))
    wanted = np.cumsum(rng.normal(size=(61, 2)), axis=0) / 4.0
    cost = QuadraticCost(wanted, np.zeros((60, 1)), Q=[10.0, 0.1], R=[0.01])
    start = np.zeros((61, 2)), np.zeros((60, 1))
    limits = [Bound("u[0]", -1.0, 1.0), Bound("x[0]", max=0.4), Bound("x[1]", -0.5, 0.5)]
    result = optimize(system, cost, initial=start, limits=limits)
    assert result.success
    assert result.rollouts <= 13


def test_where_a_run_begins_at_a_minimum_its_model_holds_at_once(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """Elsewhere that is to be seen first. A run that is resumed knows as much."""
    limits = [Bound("x-force", -20.0, 20.0), Bound("x", -0.1, 0.1)]
    free = optimize(cart, cost, initial=REST)
    cut = optimize(cart, cost, initial=REST, max_iterations=1)
    for initial, holds in ((free, True), (cut, False), ((free.x, free.u), False)):
        begun = optimize(cart, cost, initial=initial, limits=limits, max_iterations=0)
        assert begun.schedule.holds is holds
    begun = optimize(cart, cost, initial=free, limits=limits, max_iterations=0)
    resumed = optimize(cart, cost, resume=begun, limits=limits)
    whole = optimize(cart, cost, initial=free, limits=limits)
    np.testing.assert_array_equal(resumed.x, whole.x)


def test_what_does_not_bend_has_one_model(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """Where limits and cost are convex as they are, their second derivatives are summed once."""
    settings = optimize(cart, cost, initial=REST, max_iterations=0).settings
    straight = Bound("x", -1.0, 1.0, of="rate").rows(cart, 1)
    bent = Keep("bob", outside=Ball((0.3, -0.95, 0.0), 0.05)).rows(cart, 1)
    for rows, same in ((straight, True), (bent, False)):
        problem = DiscreteProblem(cart, cost, settings, rows)
        problem.start(REST)
        exact = problem.parts.merit.hessian(1.0, problem.parts.models)
        assert (problem.parts.merit.hessian(0.0, problem.parts.models) is exact) is same


def test_a_share_of_what_bends_lies_between_none_and_all_of_it(cart: MidpointSystem, cost: QuadraticCost) -> None:
    """Of cost and limits alike; and what the whole is stays, whichever shares are asked for after it."""
    rng = np.random.default_rng(5)
    start = 0.1 * rng.normal(size=(N + 1, 4)), 0.1 * rng.normal(size=(N, 1))
    settings = optimize(cart, cost, initial=REST, max_iterations=0).settings
    bent = PlaceCost(cost, cart, {"bob": np.array([0.5, 0.5, 0.0])}, {"bob": 30.0})
    rows = Keep("bob", outside=Ball((0.3, -0.95, 0.0), 0.05)).rows(cart, 1)
    problem = DiscreteProblem(cart, bent, settings, rows)
    problem.start(start)
    whole = problem.parts.merit.hessian(1.0, problem.parts.models)
    none, part = (problem.parts.merit.hessian(share, problem.parts.models).whole() for share in (0.0, 0.3))
    for low, between, high in zip(none, part, whole.whole(), strict=True):
        if low is not None:
            np.testing.assert_allclose(between, low + 0.3 * (high - low), rtol=0, atol=1e-9 * np.abs(high).max())
    assert np.abs(none.Q - whole.whole().Q).max() > 1.0
    # Each of the two has a part in that.
    for other_cost, other_rows in ((cost, rows), (bent, Bound("x", -1.0, 1.0, of="rate").rows(cart, 1))):
        other = DiscreteProblem(cart, other_cost, settings, other_rows)
        other.start(start)
        merit, models = other.parts.merit, other.parts.models
        assert np.abs(merit.hessian(0.0, models).whole().Q - merit.hessian(1.0, models).whole().Q).max() > 0.1


def test_a_limit_on_a_start_that_costs_nothing_is_enforced(rng):
    """The wanted motion is one that the system can make, so that prices in proportion to its cost would be nothing."""
    t = np.linspace(0.0, 1.0, 51)
    system = MidpointSystem(MidpointVI(Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])), t)
    u = 5.0 * np.cos(2.0 * np.pi * t[:-1])[:, None]
    x = system.rollout(np.zeros(2), np.zeros((51, 2)), u, np.zeros((50, 1, 2)), 0, 50).x
    wanted = x + 1e-13 * rng.standard_normal(x.shape)
    cost = QuadraticCost(wanted, u, Q=[1e3, 0.0], R=[1e-3])
    free = optimize(system, cost, initial=(x, u))
    assert 0.0 < free.cost < 1e-20
    bounded = optimize(system, cost, initial=free, limits=[Bound("push", -3.0, 3.0)])
    assert bounded.status is Status.CONVERGED
    assert np.abs(bounded.u).max() <= 3.0 * (1.0 + 1e-9)
    zero = QuadraticCost(x, u, Q=[1e3, 0.0], R=[1e-3])
    assert optimize(system, zero, initial=(x, u), limits=[Bound("push", -3.0, 3.0)]).cost == pytest.approx(bounded.cost)


@pytest.mark.parametrize("rollouts", [1, 3])
def test_a_step_that_barriers_alone_shortened_does_not_shorten_the_next(rollouts):
    """One that was cut where a roll-out failed does, within limits as without."""
    system = MidpointSystem(MidpointVI(cart_pendulum()), np.linspace(0.0, 0.5, 6))
    cost = QuadraticCost(np.zeros((6, 4)), np.zeros((5, 1)), Q=np.ones(4), R=[1.0])
    settings = optimize(system, cost, initial=(np.zeros(4), np.zeros((5, 1)))).settings
    limited = DiscreteProblem(system, cost, settings, Bound("x-force", max=1.0).rows(system, 1))
    limited.start((np.zeros(4), np.zeros((5, 1))))
    for problem in (limited, DiscreteProblem(system, cost, settings)):
        run = Run(problem, settings, None)
        step = SearchStep(Trial(None, 1.0), 0.01, rollouts, None)
        problem.parts.here.value = 1.0
        run.note_step(Direction("newton", -1.0, 1.0), step, decrease=0.1, agreement=0.2, cost=0.9, share=0.2)
        assert run.schedule.length == (1.0 if problem is limited and rollouts == 1 else 0.01)


def test_a_limit_whose_function_is_no_number_where_the_search_begins_is_named() -> None:
    system = LinearSystem(np.tile([[1.0, 0.1], [0.0, 1.0]], (20, 1, 1)), np.tile([[0.0], [0.1]], (20, 1, 1)))
    cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=np.ones(2), R=[1.0])
    height = FunctionQuantity("height", lambda x: np.log(x[:, 0] - 1.0))
    with (
        np.errstate(all="ignore"),
        pytest.raises(ArgumentError, match=r"Within\('height'\): 'height <= 1' got nan at step 1.* of the motion"),
    ):
        optimize(system, cost, initial=([0.5, 0.0], np.zeros((20, 1))), limits=[Within(height, max=1.0)])


class _Linear(Quantity):
    """Two linear functions of some places of a step."""

    names = ("one", "two")

    def __init__(self, places, *, of_state=False, looks_ahead=False):
        self.places, self.of_state, self.looks_ahead = np.array(places), of_state, looks_ahead
        self.slopes = np.random.default_rng(1).normal(size=(2, len(places)))
        self.given = None

    def columns(self, nx, nu):
        return self.places

    def values(self, at):
        self.given = at
        return np.hstack([at.x, at.u, at.x_next])[:, self.places] @ self.slopes.T

    def jacobian(self, at):
        return np.tile(self.slopes, (len(at.k), 1, 1))

    def curvature(self, at, y):
        return None


@pytest.mark.parametrize("instants", [[1, 2, 3, 4], [4, 1, 3], [2]])
@pytest.mark.parametrize(
    "quantity",
    [
        _Linear([2, 0], of_state=True),
        _Linear([0, 3, 4]),
        _Linear([1, 3, 6, 5, 1, 6], looks_ahead=True),  # two places come twice
    ],
    ids=["state", "step", "ahead"],
)
def test_gradients_and_changes_of_rows_are_those_of_their_values(quantity, instants, rng):
    k = np.array(instants)
    rows = Rows("limit", quantity, -1.0, rng.normal(size=(len(k), 2)), k, np.ones(2))
    x, u, dx, du = (rng.normal(size=size) for size in ((7, 3), (6, 2), (7, 3), (6, 2)))
    y, jacobian = rng.uniform(size=(len(k), 2)), rows.jacobian(x, u)
    change = rows.values(x + dx, u + du) - rows.values(x, u)
    np.testing.assert_allclose(rows.along(jacobian, dx, du), change, atol=1e-13)
    q, r = np.zeros_like(x), np.zeros_like(u)
    rows.add_gradient(jacobian, y, q, r)
    assert -np.sum(q * dx) - np.sum(r * du) == pytest.approx(np.sum(y * change), rel=1e-12)
    # Where it is asked it is given views, which cannot be written to.
    assert not any(part.size and part.flags.writeable for part in quantity.given[1:])
