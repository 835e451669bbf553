"""An optimisation that is made ready once, its options, and what each way to begin again is called."""

from __future__ import annotations

import cProfile
import pstats
import tracemalloc
from typing import Any

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.mechanics import Gravity, JointForce, Mechanism, MidpointVI, rx, ty, tz
from leastaction.optimal import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    FinalTime,
    Limit,
    LinearContinuousSystem,
    Optimizer,
    Options,
    QuadraticCost,
    Status,
    optimize,
)
from leastaction.optimal.options import WAY_NAMES
from leastaction.optimal.ways import WAYS
from leastaction.systems import MidpointSystem

N = 40
REST = np.zeros(4), np.zeros((N, 1))
LIMITS = [Bound("push", -12.0, 12.0), Bound("pole", max=0.35)]


def cart(steps: int = N) -> MidpointSystem:
    tree = [ty("cart", mass=2.0), [rx("pole"), [tz(-1.0, mass=1.0)]]]
    m = Mechanism(tree, [Gravity(), JointForce("cart", input="push")])
    return MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 0.8, steps + 1))


def tracking(angle: float = 0.4, steps: int = N) -> QuadraticCost:
    wanted = np.zeros((steps + 1, 4))
    wanted[:, 1] = angle
    return QuadraticCost(wanted, np.zeros((steps, 1)), Q=[0.1, 10.0, 0.0, 0.0], R=[0.01])


def assert_same(one: Any, other: Any) -> None:
    for name in ("x", "u", "K", "projection_gain"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(one.history.cost, other.history.cost)
    assert (one.status, one.message, one.cost) == (other.status, other.message, other.cost)


@pytest.mark.parametrize("limits", [[], LIMITS])
def test_every_run_is_that_of_optimize(limits: list[Limit]) -> None:
    system, cost = cart(), tracking()
    optimizer = Optimizer(system, cost, limits)
    starts = [REST, (np.array([0.0, 0.2, 0.0, 0.0]), REST[1]), REST]
    runs = [optimizer.run(start) for start in starts]
    # What one run has found stays what it was while others work in the same memory.
    for start, run in zip(starts, runs, strict=True):
        assert_same(run, optimize(system, cost, initial=start, limits=limits))
        assert not run.K.flags.writeable
    assert_same(optimizer.run(runs[1]), optimize(system, cost, initial=runs[1], limits=limits))


@pytest.mark.parametrize("limits", [[], LIMITS])
def test_again_goes_on_with_the_multipliers_of_the_last_run(limits: list[Limit]) -> None:
    system = cart()
    optimizer = Optimizer(system, tracking(), limits)
    first = optimizer.run(REST)
    x0 = first.x[1] + 0.01
    again = optimizer.again(x0, shift=1)
    assert again.success
    np.testing.assert_array_equal(again.x[0], x0)
    anew = optimize(system, tracking(), initial=(x0, REST[1]), limits=limits)
    assert again.cost == pytest.approx(anew.cost, rel=1e-7)
    assert again.iterations < anew.iterations + (not limits)
    other = optimizer.again(cost=tracking(0.1))
    assert other.cost == pytest.approx(optimize(system, tracking(0.1), initial=(x0, REST[1]), limits=limits).cost)
    assert optimizer.cost is not first


def test_unknowns_and_continuous_time_run_again_too() -> None:
    system, cost = cart(), QuadraticCost(np.zeros((N + 1, 4)), np.zeros((N, 1)), Q=[0.0] * 4, R=[1e-3])
    limits: list[Limit] = [Bound("push", -20.0, 20.0), Equal("cart", 0.3), Equal("*", 0.0, of="momentum")]
    optimizer = Optimizer(system, cost, limits, unknowns=[FinalTime(price=1.0)])
    one, two = optimizer.run(REST), optimizer.run(REST)
    assert_same(one, two)
    assert one.unknowns == two.unknowns
    mass = LinearContinuousSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    rate = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 0.0], R=[1.0])
    moving = Optimizer(mass, rate, [Bound("x[0]", max=0.1)], horizon=(0.0, 1.0))
    assert_same(*(moving.run(([0.0, 1.0], [-2.0])) for _ in range(2)))
    with pytest.raises(ArgumentError, match=r"again: got a LinearContinuousSystem, expected a discrete system"):
        moving.again([0.0, 1.0])


def test_bad_input() -> None:
    optimizer = Optimizer(cart(), tracking())
    with pytest.raises(ArgumentError, match="again: got no result to start from"):
        optimizer.again()
    with pytest.raises(ArgumentError, match="initial, resume: got neither"):
        optimizer.run()
    optimizer.run(REST)
    with pytest.raises(ArgumentError, match="x0: got shape"):
        optimizer.again(np.zeros(3))
    with pytest.raises(ArgumentError, match=r"optimize: has no argument .tolerence.; .*'tolerance'"):
        optimize(cart(), tracking(), initial=REST, tolerence=1e-3)
    with pytest.raises(ArgumentError, match="without"):
        Options(without=["easy"])  # type: ignore[arg-type]


def test_settings_are_options_by_their_names() -> None:
    options = Options(max_iterations=2, tolerance=1e-3)
    result = optimize(cart(), tracking(), initial=REST, options=options, max_iterations=0)
    assert (result.settings.max_iterations, result.settings.tolerance) == (0, 1e-3)
    assert result.status is Status.ITERATION_LIMIT
    assert options.changed(method="newton").method == "newton"
    assert [way.name for way in WAYS] == list(WAY_NAMES)
    assert Options(without=["gaps"]).without == ("gaps",)  # type: ignore[arg-type]


RATE: list[Limit] = [Bound("push", -60.0, 60.0, of="input rate")]


@pytest.mark.parametrize("limits", [[], LIMITS, RATE])
def test_another_cost_is_that_of_an_optimiser_made_with_it(limits: list[Limit]) -> None:
    system = cart()
    optimizer, other = Optimizer(system, tracking(), limits), Optimizer(system, tracking(0.1), limits)
    optimizer.run(REST)
    again = optimizer.again(REST[0], cost=tracking(0.1))
    assert again.cost == pytest.approx(other.run(REST).cost, rel=1e-8)
    assert_same(optimizer.run(REST), other.run(REST))
    with pytest.raises(ArgumentError, match=r"cost.x_wanted: got shape \(5, 4\)"):
        optimizer.again(cost=QuadraticCost(np.zeros((5, 4)), np.zeros((4, 1)), Q=np.ones(4), R=[1.0]))


@pytest.mark.parametrize("limits", [[], LIMITS])
def test_later_runs_ask_for_no_memory_that_grows_with_the_horizon(limits: list[Limit]) -> None:
    """What the first has found stays what it was, though its result is held."""

    def peak(steps: int) -> int:
        optimizer = Optimizer(cart(steps), tracking(steps=steps), limits)
        start = np.zeros(4), np.zeros((steps, 1))
        first = optimizer.run(start)
        found = {name: getattr(first, name).copy() for name in ("x", "u", "K", "projection_gain")}
        tracemalloc.start()
        try:
            second = optimizer.run(start)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert second.success
        optimizer.run((np.array([0.0, 0.05, 0.0, 0.0]), np.zeros((steps, 1))))
        for name, array in found.items():
            np.testing.assert_array_equal(getattr(first, name), array)
            np.testing.assert_array_equal(getattr(second, name), array)
        return most

    # NumPy has buffers of a size of its own.
    states = 8 * 4 * 2001
    assert peak(4000) < peak(2000) + 0.25 * states


@pytest.mark.parametrize(("limits", "most"), [([], 1100), ([LIMITS[0]], 2400)])
def test_a_short_run_is_made_of_few_calls(limits: list[Limit], most: int) -> None:
    """Each takes about as long as the numbers of a step of time: half of what an iteration costs is theirs."""
    optimizer = Optimizer(cart(), tracking(), limits, max_iterations=1)
    optimizer.run(REST)
    with cProfile.Profile() as profile:
        optimizer.run(REST)
    assert pstats.Stats(profile).total_calls < most  # type: ignore[attr-defined]
