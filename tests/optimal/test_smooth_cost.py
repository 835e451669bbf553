"""A price on the accelerations of prescribed variables, beside another cost."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    SmoothCost,
    optimize,
    rx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError
from leastaction.optimal import check_derivatives

# Jagged inputs are what is looked at: their energy does not balance.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

MECHANISM = Mechanism(
    [ty("left", kinematic=True), [rx("a"), [tz(-1.0, mass=1.0), [ty("right", kinematic=True), [tz(0.0, mass=0.5)]]]]],
    [Gravity(), JointForce("a", input="push")],
)
EVEN, UNEVEN = np.linspace(0.0, 0.6, 7), np.array([0.0, 0.1, 0.25, 0.3, 0.5, 0.55, 0.6])


def made(t: np.ndarray, weights: dict[str, float]) -> tuple[MidpointSystem, QuadraticCost, SmoothCost]:
    system = MidpointSystem(MidpointVI(MECHANISM), t)
    rng = np.random.default_rng(4)
    wanted = rng.normal(size=(len(t), system.nx)), rng.normal(size=(len(t) - 1, system.nu))
    plain = QuadraticCost(*wanted, Q=rng.uniform(size=system.nx), R=rng.uniform(0.5, 1.0, size=system.nu))
    return system, plain, SmoothCost(plain, system, weights)


@pytest.mark.parametrize("t", [EVEN, UNEVEN])
def test_it_is_half_the_weighted_squares_of_second_differences(t: np.ndarray) -> None:
    system, plain, cost = made(t, {"left": 0.3, "r*": 0.7})
    vi = system.integrator
    rho = 0.1 * np.random.default_rng(5).normal(size=(len(t) - 1, 2))
    start = vi.start([0.2, 0.0, 0.0])
    run = vi.simulate(start, t, inputs=np.full((len(t) - 1, 1), 0.4), rho=np.vstack([start.q[1:], rho]))
    rates = np.vstack([np.zeros(2), np.diff(run.q[:, 1:], axis=0) / np.diff(t)[:, None]])
    a = np.diff(rates, axis=0) / np.diff(t)[:, None]
    assert cost.value(run.x, run.u) == pytest.approx(plain.value(run.x, run.u) + 0.5 * np.sum(a**2 @ [0.3, 0.7]))
    assert check_derivatives(system, run.x, run.u, cost=cost).ok
    assert cost.hessian(run.x, run.u).Q.ndim == (2 if t is EVEN else 3)


def test_weights_that_are_not_given_change_nothing() -> None:
    system, plain, cost = made(EVEN, {"left": 0.0})
    rng = np.random.default_rng(6)
    x, u = rng.normal(size=(len(EVEN), system.nx)), rng.normal(size=(len(EVEN) - 1, system.nu))
    assert cost.value(x, u) == plain.value(x, u)


def test_windows_and_eased_costs_are_those_of_the_same_accelerations() -> None:
    t = np.linspace(0.0, 0.5, 51)
    system, plain, cost = made(t, {"*": 0.01})
    x, u = np.zeros((51, system.nx)), np.zeros((50, system.nu))
    x[:, 1], x[:, 4] = t**2, 2.0 * t - 0.01  # the rate over the step before
    u[:, 1] = t[1:] ** 2
    price = cost.value(x, u) - plain.value(x, u)
    assert price == pytest.approx(0.5 * 0.01 * 50 * 2.0**2)
    part, alone = (c.window(20, 30, N=50, nu=system.nu) for c in (cost, plain))
    assert part.value(x[20:31], u[20:30]) - alone.value(x[20:31], u[20:30]) == pytest.approx(price / 5)
    eased, wanted = cost.eased(100.0)
    np.testing.assert_array_equal(wanted, plain.u_wanted)
    assert eased.value(x, u) - plain.eased(100.0)[0].value(x, u) == pytest.approx(price)


def test_an_optimum_is_smoother() -> None:
    t = np.linspace(0.0, 1.0, 101)
    system, _, _ = made(t, {})
    wanted = np.zeros((101, system.nx))
    wanted[:, 0] = 0.3 * np.sign(np.sin(8.0 * t))
    plain = QuadraticCost(wanted, np.zeros((100, 3)), Q=[10.0] + [1e-3] * 5, R=[1.0, 1e-4, 1e-4])
    start = system.integrator.start([0.0, 0.0, 0.0])
    still = system.integrator.simulate(start, t, rho=np.zeros((101, 2)))
    hard = []
    for cost in (plain, SmoothCost(plain, system, {"left": 1e-4, "right": 1e-4})):
        result = optimize(system, cost, initial=(still.x, still.u))
        assert result.success
        hard.append(np.abs(np.diff(result.x[:, 1:3], 2, axis=0)).max())
    assert hard[1] < 0.3 * hard[0]


def test_bad_input() -> None:
    system, plain, cost = made(EVEN, {"left": 0.3})
    with pytest.raises(ArgumentError, match=r"nothing is called 'up'; .*'left'"):
        SmoothCost(plain, system, {"up": 1.0})
    with pytest.raises(ArgumentError, match=r"the weight of 'right': got -1.0, expected a number >= 0"):
        SmoothCost(plain, system, {"right": -1.0})
    with pytest.raises(ArgumentError, match=r"weight of 'right'"):
        SmoothCost(plain, system, {"right": np.nan})
    with pytest.raises(ArgumentError, match=r"those of a system of N, nx, nu = \(6, 6, 3\)"):
        cost.check_shapes(7, 6, 3)
