"""The bridge in continuous time: a mechanism is a system like any other to the optimiser."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from leastaction import (
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    project_velocity,
    tx,
    tz,
)
from leastaction.errors import ArgumentError, DynamicsError
from leastaction.mechanics import ContinuousDynamics, PythonConstraint, PythonFunction
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import Status, check_derivatives, optimize_continuous
from leastaction.optimal.continuous import (
    Accuracy,
    ContinuousQuadraticCost,
    ContinuousSystem,
    DenseTrajectory,
)
from leastaction.systems import MechanismSystem
from optimal.systems import crane


def hanging_crane() -> tuple[Mechanism, np.ndarray]:
    """Return the crane, and a start at rest."""
    mechanism, q = crane()
    return mechanism, np.concatenate([q, np.zeros(mechanism.nq)])


@pytest.mark.parametrize("stabilised", [False, True])
def test_derivatives_of_the_system(stabilised: bool) -> None:
    mechanism, x0 = hanging_crane()
    more = {"constraint_damping": 4.0, "constraint_stiffness": 9.0} if stabilised else {}
    system = MechanismSystem(ContinuousDynamics(mechanism, **more))
    assert (system.nx, system.nu) == (2 * mechanism.nq, mechanism.nu + mechanism.nrho)
    rng = np.random.default_rng(0)
    speeds, inputs = rng.standard_normal(mechanism.nq), rng.standard_normal(system.nu)
    curve = DenseTrajectory.from_functions(
        lambda t: x0 + 0.1 * np.sin(t + np.r_[speeds, 3 * speeds]),
        lambda t: inputs * np.cos(t),
        horizon=(0.0, 1.0),
        nx=system.nx,
        nu=system.nu,
    )
    report = check_derivatives(system, curve, tolerance=1e-6)
    assert report.ok, report
    assert "curvatures" in report.errors


@pytest.mark.parametrize("free", [None, ["a", "b", "v_a", "v_b", "v_twist"]])
def test_a_start_moves_along_the_constraints(rng: np.random.Generator, free: list[str] | None) -> None:
    mechanism, x0 = hanging_crane()
    m, system = mechanism, MechanismSystem(ContinuousDynamics(mechanism))
    x0[m.nq :] = project_velocity(m, x0[: m.nq], rng.standard_normal(m.nq)).v
    assert system.input_name(0) == "push"
    assert system.input_name(1) == "winch"
    directions = system.start_directions(x0, free)
    chosen = 2 * m.nq if free is None else len(free)
    assert directions.shape == (2 * m.nq, chosen - 2 * m.nc)
    if free is not None:
        held = np.setdiff1d(np.arange(2 * m.nq), system.free_entries(free))
        assert not directions[held].any()

    def off(x: np.ndarray) -> float:
        q, v = np.ascontiguousarray(x[: m.nq]), x[m.nq :]
        return float(np.abs(np.r_[m.constraint_values(q), m.constraint_jacobian(q) @ v]).max())

    h = 1e-4
    for along in directions.T:
        assert off(x0 + h * along) < 30.0 * h**2
        moved = system.moved_start(x0, h * along)
        assert off(moved) < 1e-9
        np.testing.assert_allclose(moved, x0 + h * along, atol=30.0 * h**2)


class OneByOne(ContinuousSystem):
    """Another system, linearised sample by sample."""

    def __init__(self, system: ContinuousSystem) -> None:
        self.system, self.nx, self.nu = system, system.nx, system.nu

    def f(self, x, u, t):
        return self.system.f(x, u, t)

    def derivatives(self, x, u, t):
        return self.system.derivatives(x, u, t)

    def curvature(self, x, u, t, z):
        return self.system.curvature(x, u, t, z)


def test_a_linearization_owns_what_its_second_order_needs() -> None:
    system = MechanismSystem(hanging_crane()[0])
    rng, n = np.random.default_rng(0), 3
    x = hanging_crane()[1] + 0.1 * rng.standard_normal((n, system.nx))
    u, t, z = (
        rng.standard_normal((n, system.nu)),
        np.arange(3.0),
        rng.standard_normal((n, system.nx)),
    )
    expected = system.curvatures(x, u, t, z)
    whole, single = system.linearize(x, u, t), OneByOne(system).linearize(x, u, t)
    for array in (x, u, t):
        array[:] = 0.1
    for linearization in (whole, single):
        np.testing.assert_allclose(linearization.curvature(z), expected, rtol=1e-13, atol=1e-13)


def test_the_state_and_the_input_are_in_the_order_of_the_mechanism() -> None:
    mechanism, x0 = hanging_crane()
    system = MechanismSystem(mechanism)
    x0[mechanism.nq :] = np.arange(mechanism.nq) * 0.1
    u = np.array([3.0, 0.4, -0.7])
    rate = system.f(x0, u, 0.0)
    nq, nd = mechanism.nq, mechanism.nd
    np.testing.assert_array_equal(rate[:nq], x0[nq:])
    np.testing.assert_array_equal(rate[nq + nd :], u[mechanism.nu :])
    a = ContinuousDynamics(mechanism).accelerations(x0[:nq], x0[nq:], u[:1], u[1:]).a
    np.testing.assert_array_equal(rate[nq : nq + nd], a)


def test_newton_tail_on_a_constrained_mechanism() -> None:
    mechanism, x0 = hanging_crane()
    system = MechanismSystem(mechanism)
    nq = mechanism.nq
    start = x0.copy()

    def wanted(t: float) -> np.ndarray:
        x = start.copy()
        x[0] += 0.4 * np.sin(4 * t)
        return x

    cost = ContinuousQuadraticCost(
        wanted,
        np.zeros(system.nu),
        Q=np.r_[np.full(nq, 10.0), np.full(nq, 0.1)],
        R=np.full(system.nu, 0.01),
    )
    result = optimize_continuous(
        system,
        cost,
        initial=(x0, np.zeros(system.nu)),
        horizon=(0.0, 1.0),
        method="newton",
        tolerance=1e-15,
        accuracy=Accuracy(rtol=1e-10, atol=1e-12),
        collocate=False,
    )
    assert result.success
    assert result.history.method[-2:] == ("newton", "newton")
    gap = np.append(result.history.expected_decrease, result.expected_decrease) / result.cost
    for before, after in itertools.pairwise(gap[gap < 1e-2]):
        assert after < max(100 * before**2, 1e-15)
    # The string stays as long as it is: the integration alone holds it.
    q = result.dense.x(np.linspace(0, 1, 21))[:, :nq]
    residual = [np.abs(mechanism.core.constraints(row)).max() for row in q]
    assert max(residual) < 1e-7


def test_the_variational_integrator_finds_the_same() -> None:
    """The optimum of small steps is off by O(dt^2); the cost sees no velocities, which differ."""
    mechanism = cart_pendulum()
    final = 1.5

    def angle(t: np.ndarray | float) -> np.ndarray | float:
        return 0.8 * np.sin(np.pi * t)

    weights = np.array([1.0, 10.0, 0.0, 0.0])
    cost = ContinuousQuadraticCost(lambda t: np.array([0.0, angle(t), 0.0, 0.0]), [0.0], Q=weights, R=[0.01])
    exact = optimize_continuous(
        MechanismSystem(mechanism),
        cost,
        initial=(np.zeros(4), [0.0]),
        horizon=(0.0, final),
        tolerance=1e-13,
        accuracy=Accuracy(rtol=1e-11, atol=1e-13),
    )
    assert exact.status is Status.CONVERGED
    errors = []
    for count in (150, 300):
        dt = final / count
        t = dt * np.arange(count + 1)
        x_wanted = np.zeros((count + 1, 4))
        x_wanted[:, 1] = angle(t)
        Q = np.tile(dt * weights, (count, 1))[:, :, None]
        Q[0] *= 0.5
        discrete = QuadraticCost(x_wanted, np.zeros((count, 1)), Q=Q, R=[0.01 * dt], Q_final=0.5 * dt * weights)
        result = optimize(
            MidpointSystem(MidpointVI(mechanism), t),
            discrete,
            initial=(np.zeros(4), np.zeros((count, 1))),
            tolerance=1e-13,
        )
        assert result.success
        u = exact.dense.u(t[:-1] + dt / 2)
        errors.append(
            [
                np.abs(result.x[:, :2] - exact.dense.x(t)[:, :2]).max(),
                np.abs(result.u - u).max(),
                abs(result.cost - exact.cost),
            ]
        )
    ratio = np.divide(*errors)
    np.testing.assert_array_less(3.2, ratio)
    np.testing.assert_array_less(ratio, 4.8)
    assert errors[1][0] < 2e-3


def test_where_there_are_no_accelerations() -> None:
    mechanism, x0 = hanging_crane()
    system = MechanismSystem(mechanism)
    x0[1] = np.nan
    with pytest.raises(DynamicsError, match=r"t = 0.25 s"):
        system.f(x0, np.zeros(system.nu), 0.25)


def test_without_second_derivatives_there_is_no_newton() -> None:
    class Square(PythonFunction):
        """``(x^2 - 1) / 2`` of one variable."""

        def value(self, z):
            return 0.5 * (z[0] * z[0] - 1.0)

        def gradient(self, z):
            return np.array([z[0]])

        def hessian(self, z):
            return np.array([[1.0 + 0.0 * z[0]]])

    mechanism = Mechanism(
        [tx("x", mass=1.0), tz("z", mass=1.0)],
        [JointForce("z", "lift"), PythonConstraint(Square(), variables=["x"])],
    )
    system = MechanismSystem(mechanism)
    assert not system.has_curvature
    assert MechanismSystem(hanging_crane()[0]).has_curvature
    cost = ContinuousQuadraticCost([1.0, 1.0, 0.0, 0.0], [0.0], Q=np.ones(4), R=[1.0])
    how = {"initial": ([1.0, 0.0, 0.0, 0.0], [0.0]), "horizon": (0.0, 1.0)}
    result = optimize_continuous(system, cost, **how)
    assert result.success
    assert set(result.history.method) == {"quasi-newton"}
    with pytest.raises(ArgumentError, match="MechanismSystem has no second derivative"):
        optimize_continuous(system, cost, **how, method="newton")


def test_the_swing_up_of_the_dissertation() -> None:
    """Dynamic embedding (6.6.1, 6.7.1): a torque at the pivot whose price rises, then none.

    The weights' ratio is 1e4, where the dissertation's continuous optimisation had to stay below 100; the
    discrete optimisation of the same motion comes to the same cost.
    """
    final = 10.0

    def wanted(t: float) -> np.ndarray:
        share = min(max((t / final - 0.3) / 0.4, 0.0), 1.0)
        return np.array([0.0, 0.5 * np.pi * (1.0 - np.cos(2.0 * np.pi * share)), 0.0, 0.0])

    dt = 0.01
    t = np.linspace(0.0, final, round(final / dt) + 1)
    x_wanted = np.stack([wanted(s) for s in t])
    # Rates and momenta are not the same, so neither is weighed.
    Q = np.array([0.01, 100.0, 0.0, 0.0])
    initial = DenseTrajectory.from_samples([0.0, final], np.zeros((2, 4)), np.zeros((2, 2)))
    start = np.zeros((len(t), 4)), np.zeros((len(t) - 1, 2))
    for torque in (0.01, 10.0, 1000.0, None):
        R = np.array([0.01] if torque is None else [0.01, torque])
        mechanism = cart_pendulum(pivot_torque=torque is not None)
        if torque is None:
            initial = DenseTrajectory(initial.xu.part(np.arange(5), (5,)), 4)
            start = start[0], start[1][:, :1].copy()
        result = optimize_continuous(
            MechanismSystem(mechanism),
            ContinuousQuadraticCost(wanted, np.zeros(R.size), Q=Q, R=R, jumps=[3.0, 7.0]),
            initial=initial,
            collocate=False,
        )
        discrete = optimize(
            MidpointSystem(MidpointVI(mechanism), t),
            QuadraticCost(x_wanted, np.zeros((len(t) - 1, R.size)), Q=Q, R=R),
            initial=start,
        )
        assert result.success
        assert discrete.success
        assert result.iterations <= 10
        assert result.cost == pytest.approx(dt * discrete.cost, rel=2e-3)
        np.testing.assert_allclose(result.dense.x(t)[:, 1], discrete.x[:, 1], atol=0.02)
        initial, start = result.dense, (discrete.x, discrete.u)
    assert result.dense.x(t)[:, 1].max() > 2.9
