"""A satellite without singular attitudes: turned by any angle, with Newton's quadratic tail."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import BodyWrench, Mechanism, MidpointVI, ball, rz
from leastaction.optimal import Bound, QuadraticCost, Status, check_derivatives, optimize
from leastaction.systems import MidpointSystem

AXIS = np.array([0.48, 0.6, 0.64])
N = 40


def satellite() -> MidpointSystem:
    hull = ball("hull", axes="quaternion", mass=1.0, inertia=(1.0, 1.3, 0.7))
    m = Mechanism([hull, [rz("wheel", mass=0.2, inertia=(0.05, 0.05, 0.1))]], [BodyWrench("hull", torque=tuple("abc"))])
    return MidpointSystem(MidpointVI(m), np.linspace(0.0, 2.0, N + 1))


def to_attitude(system: MidpointSystem, angle: float) -> tuple[QuadraticCost, np.ndarray]:
    m = system.mechanism
    start = system.integrator.start(m.configuration(), [0.3, -0.2, 0.1, 1.0])
    wanted = np.zeros(system.nx)
    wanted[:4] = np.cos(angle / 2.0), *(np.sin(angle / 2.0) * AXIS)
    Q_final = np.r_[np.full(3, 100.0), 0.0, np.full(3, 100.0), 0.0]
    cost = QuadraticCost(
        np.tile(wanted, (N + 1, 1)),
        np.zeros((N, 3)),
        Q=np.r_[np.zeros(4), np.full(4, 0.01)],
        R=np.full(3, 0.01),
        Q_final=Q_final,
        space=system,
    )
    return cost, start.x


@pytest.mark.parametrize("angle", [0.5, np.pi / 2.0, 3.0])
def test_a_satellite_turns_by_any_angle(angle: float) -> None:
    system = satellite()
    assert (system.nx, system.ndx) == (9, 8)
    cost, x0 = to_attitude(system, angle)
    found = optimize(
        system, cost, initial=(x0, np.zeros((N, 3))), method="newton", tolerance=1e-24, absolute_tolerance=0.0
    )
    # So tight a tolerance is met, or rounding stands before it.
    assert found.status in (Status.CONVERGED, Status.STALLED)
    away = system.difference(found.x[-1], np.asarray(cost.x_wanted)[-1])
    assert np.abs(away[:3]).max() < 0.05
    # Newton's tail is quadratic.
    newton = [k for k, method in enumerate(found.history.method) if method == "newton"]
    decreases = found.history.expected_decrease
    assert newton
    assert decreases[newton[-1]] < 1e-11
    for k in newton:
        if k - 1 in newton:
            assert decreases[k] < decreases[k - 1] ** 2 + 1e-17


def test_derivatives_of_the_system_and_windows() -> None:
    system = satellite()
    cost, x0 = to_attitude(system, 2.0)
    rng = np.random.default_rng(1)
    u = rng.standard_normal((N, 3))
    run = system.rollout(x0, np.tile(x0, (N + 1, 1)), u, np.zeros((N, 3, 8)), 0, N)
    assert run.failure is None
    assert check_derivatives(system, run.x, run.u, cost=cost).ok
    gains = 0.3 * rng.standard_normal((N, 3, 8))
    bar = system.plus(run.x, np.tile(1e-2 * rng.standard_normal(8), (N + 1, 1)))
    fast = system.rollout(x0, bar, u, gains, 0, N)
    slow = super(MidpointSystem, system).rollout(x0, bar, u, gains, 0, N)
    assert np.abs(fast.x - slow.x).max() < 1e-9


def test_with_bounds_on_torques() -> None:
    system = satellite()
    cost, x0 = to_attitude(system, 2.5)
    found = optimize(system, cost, limits=[Bound(["a", "b", "c"], -2.5, 2.5)], initial=(x0, np.zeros((N, 3))))
    assert found.status is Status.CONVERGED
    assert np.abs(found.u).max() <= 2.5
    assert np.abs(found.u).max() > 2.4
