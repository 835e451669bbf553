"""Unknowns beside the inputs in continuous time: the final time, parameters, a first state that returns."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import expm
from scipy.optimize import minimize

from derivatives.differences import extrapolated
from leastaction import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    MechanismSystem,
    optimize,
    rx,
    rz,
    simulate,
    tx,
    ty,
    tz,
)
from leastaction.elements import Distance, ExpressionForce
from leastaction.errors import ArgumentError
from leastaction.expressions import time, variable
from leastaction.io import load_result, save_result
from leastaction.limits import FinalTime, Keep, Parameter, Periodic
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearContinuousSystem, PiecewisePolynomial, Status
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.mesh import MATRIX, STAGES, NodeLayout
from leastaction.optimal.continuous import FunctionContinuousSystem
from leastaction.optimal.unknowns.continuous.cost import ExtendedContinuousCost
from leastaction.optimal.unknowns.continuous.system import ExtendedContinuousSystem
from leastaction.systems import Box

MASS = LinearContinuousSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
HORIZON = (0.3, 1.5)
ROUGHLY = {"accuracy": Accuracy(rtol=1e-7, atol=1e-9)}


def driven() -> FunctionContinuousSystem:
    """Return a system that depends on time."""
    return FunctionContinuousSystem(
        lambda x, u, t: np.array([x[1], -np.sin(x[0]) * np.cos(3.0 * t) + x[1] * u[0]]),
        nx=2,
        nu=1,
        derivatives=lambda x, u, t: (
            np.array([[0.0, 1.0], [-np.cos(x[0]) * np.cos(3.0 * t), u[0]]]),
            np.array([[0.0], [x[1]]]),
        ),
        curvature=lambda x, u, t, z: z[1] * np.array(
            [[np.sin(x[0]) * np.cos(3.0 * t), 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
        ),
    )  # fmt: skip


def pushed() -> MechanismSystem:
    """Return a mechanism whose force changes with the time."""
    force = ExpressionForce(2.0 * sp.cos(3.0 * time()) * variable("x"), "x", name="wave")
    return MechanismSystem(Mechanism([tx("x", mass=1.5)], [force, JointForce("x", "push")]))


CASES = {
    "mechanism that depends on time": (pushed, ["final time", "x.mass"], [1.9, 1.4], []),
    "depends on time": (driven, ["final time"], [1.9], [1]),
    "mechanism": (lambda: MechanismSystem(cart_pendulum()), ["final time", "bob.mass"], [1.9, 0.4], [0, 3]),
    "parameters": (lambda: MechanismSystem(cart_pendulum()), ["bob.mass", "gravity.vector.z"], [0.4, -9.0], []),
}


def extended(name):
    make, names, values, copied = CASES[name]
    own = make()
    names = [each for each in names if each == "final time" or each in own.parameters]
    assert len(names) == len(values), sorted(own.parameters)
    return ExtendedContinuousSystem(own, names, copied, True, HORIZON), np.array(values)


def samples(system, values, rng, n=3):
    x = np.tile(np.concatenate([np.zeros(system.n_own), values, rng.normal(size=len(system.copied))]), (n, 1))
    x[:, : system.n_own] = rng.normal(size=(n, system.n_own))
    return x, rng.normal(size=(n, system.nu)), np.linspace(0.5, 1.3, n)


@pytest.mark.parametrize("name", CASES)
def test_the_extended_system_has_exact_derivatives(name, rng):
    system, values = extended(name)
    x, u, t = samples(system, values, rng)
    found, z = system.linearize(x, u, t), rng.normal(size=(3, system.nx))
    H = found.curvature(z)
    np.testing.assert_allclose(H, H.transpose(0, 2, 1), atol=1e-12 * np.abs(H).max())
    for _ in range(3):
        # Constants move alike in all samples.
        dx, du = rng.normal(size=x.shape), rng.normal(size=u.shape)
        dx[:, system.n_own :] = 0.3 * dx[0, system.n_own :]

        def rates(by, dx=dx, du=du):
            return system.rates(x + by * dx, u + by * du, t)

        slope = np.einsum("kij,kj->ki", found.A, dx) + np.einsum("kij,kj->ki", found.B, du)
        wanted = extrapolated(rates, 0.0, 0.02)
        np.testing.assert_allclose(slope, wanted, atol=2e-8 * np.abs(wanted).max())

        def slopes(by, dx=dx, du=du):
            A, B = system.linearize(x + by * dx, u + by * du, t)
            return np.hstack([np.einsum("ki,kij->kj", z, A), np.einsum("ki,kij->kj", z, B)])

        bent = np.einsum("kij,kj->ki", H, np.hstack([dx, du]))
        wanted = extrapolated(slopes, 0.0, 0.02)
        np.testing.assert_allclose(bent, wanted, atol=2e-7 * np.abs(wanted).max())


def test_its_cost_has_exact_derivatives(rng):
    system, values = extended("mechanism")
    own = ContinuousQuadraticCost(
        lambda t: [np.sin(t), 0.2, 0.0, t], [0.1], Q=[1.0, 2.0, 0.5, 0.1], R=[0.3], Q_final=[5.0, 1.0, 0.0, 1.0]
    )
    unknowns = [FinalTime(price=0.7, weight=0.2), Parameter("bob.mass", price=-0.3, weight=2.0)]
    cost = ExtendedContinuousCost(own, unknowns, np.array([1.5, 0.3]), system)
    x, u, t = samples(system, values, rng)
    q, r = cost.gradient(x, u, t)
    Q, R, S = cost.hessian(x, u, t)
    S = np.zeros((3, system.nx, 1)) if S is None else S
    dx, du = 0.3 * rng.normal(size=x.shape), 0.3 * rng.normal(size=u.shape)
    slope = np.einsum("ki,ki->k", q, dx) + np.einsum("ki,ki->k", r, du)
    wanted = extrapolated(lambda by: cost.rates(x + by * dx, u + by * du, t), 0.0, 0.05)
    np.testing.assert_allclose(slope, wanted, rtol=1e-8)
    bent = np.einsum("kij,kj->ki", Q, dx) + np.einsum("kij,kj->ki", S, du)
    wanted = extrapolated(lambda by: cost.gradient(x + by * dx, u + by * du, t).q, 0.0, 0.05)
    np.testing.assert_allclose(bent, wanted, atol=1e-8 * np.abs(wanted).max())
    bent = np.einsum("kij,ki->kj", S, dx) + np.einsum("kij,kj->ki", R, du)
    wanted = extrapolated(lambda by: cost.gradient(x + by * dx, u + by * du, t).r, 0.0, 0.05)
    np.testing.assert_allclose(bent, wanted, atol=1e-8 * np.abs(wanted).max())
    at, move = x[0], dx[0]
    wanted = extrapolated(lambda by: cost.final_value(at + by * move, 1.5), 0.0, 0.05)
    assert cost.final_gradient(at, 1.5) @ move == pytest.approx(wanted, rel=1e-8)
    wanted = extrapolated(lambda by: cost.final_gradient(at + by * move, 1.5), 0.0, 0.05)
    np.testing.assert_allclose(cost.final_hessian(at, 1.5) @ move, wanted, atol=1e-8 * np.abs(wanted).max())
    assert cost.rate(x[1], u[1], t[1]) == pytest.approx(cost.rates(x, u, t)[1], rel=1e-14)


def test_pieces_are_rolled_out_by_the_mechanism_as_by_the_extended_system(rng):
    system, values = extended("mechanism")
    n, nu, h = system.nx, system.nu, np.array([0.05, 0.03, 0.04])
    layout = NodeLayout(n, nu)
    x, _, _ = samples(system, values, rng, 1)
    zbar = np.zeros((4, layout.nz))
    for k in range(4):
        zbar[k] = layout.joined(np.tile(x, (1, STAGES, 1)), rng.normal(size=(1, STAGES, nu)))[0]
    ubar = np.ascontiguousarray(zbar[1:, STAGES * n :])
    K = np.zeros((3, STAGES * nu, layout.nz))
    K[:, :, :n] = 0.2 * rng.normal(size=(3, STAGES * nu, n))
    z, u = np.zeros((4, layout.nz)), np.zeros((3, STAGES * nu))
    z[0, :n] = x[0] + 0.1 * rng.normal(size=n)
    assert system.roll_out_pieces(h, np.zeros((3, STAGES)), MATRIX, (zbar, ubar), K, z, u) == 3
    for k in range(3):
        np.testing.assert_allclose(u[k], ubar[k] - K[k] @ (z[k] - zbar[k]), atol=1e-12)
        states, inputs = layout.points(z[k + 1 : k + 2])
        rates = system.rates(states[0], inputs[0], np.zeros(STAGES))
        np.testing.assert_allclose(states[0], z[k, :n] + h[k] * MATRIX @ rates, atol=1e-12)


# ---- The final time -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("far", "most"), [(2.0, 1.0), (5.0, 0.7)])
def test_the_least_time_of_a_double_integrator(far, most):
    effort = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1e-7])
    limits = [Bound("u[0]", -most, most), Equal(["x[0]", "x[1]"], [far, 0.0])]
    last = FinalTime(0.1, 30.0, price=1.0)
    result = optimize(MASS, effort, initial=([0.0, 0.0], [0.1]), horizon=(0.0, 3.0), limits=limits, unknowns=[last])
    assert result.success, result.message
    assert result.unknowns["final time"] == pytest.approx(2.0 * np.sqrt(far / most), rel=1e-7)
    assert result.t[-1] == pytest.approx(result.unknowns["final time"], rel=1e-14) == result.dense.tf
    # Pushed as hard as may be, one way and then the other.
    middle = 0.5 * result.dense.tf
    t = np.concatenate([np.linspace(0.0, 0.99 * middle, 50), np.linspace(1.01 * middle, 2.0 * middle, 50)])
    np.testing.assert_allclose(result.dense.u(t)[:, 0], most * np.sign(middle - t), atol=2e-2 * most)


@pytest.mark.parametrize("price", [1.0, 3.0])
def test_what_effort_and_time_cost_together_has_its_closed_form(price):
    effort = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1.0])
    limits = [Equal(["x[0]", "x[1]"], [2.0, 0.0])]
    last = FinalTime(0.6, 30.0, price=price)
    start = {"initial": ([0.0, 0.0], [0.1]), "horizon": (0.5, 3.0)}
    result = optimize(MASS, effort, **start, limits=limits, unknowns=[last])
    assert result.success, result.message
    # int u^2 / 2 = 6 d^2 / T^3, and price (t0 + T).
    lasts = (18.0 * 4.0 / price) ** 0.25
    assert result.unknowns["final time"] - 0.5 == pytest.approx(lasts, rel=1e-8)
    assert result.cost == pytest.approx(24.0 / lasts**3 + price * (0.5 + lasts), rel=1e-10)
    t = 0.5 + lasts * np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(result.dense.u(t)[:, 0], 12.0 / lasts**2 * (1.0 - 2.0 * (t - 0.5) / lasts), atol=1e-6)
    # The feedback is by the true time: that of the regulator with the rest of the time to go.
    assert result.feedback.tf == result.dense.tf


def test_limits_are_by_the_true_time():
    slide = Mechanism([tx("x", mass=2.0)], [JointForce("x", input="push")])
    effort = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1e-7])
    limits = [
        Bound("x", -0.5, 0.5, of="acceleration"), Bound("x", -1.0, 1.0, of="rate"),
        Equal("x", 4.0), Equal("x", of="rate"),
    ]  # fmt: skip
    last = FinalTime(0.1, 30.0, price=1.0)
    start = {"initial": ([0.0, 0.0], [0.1]), "horizon": (0.0, 3.0)}
    result = optimize(MechanismSystem(slide), effort, **start, limits=limits, unknowns=[last])
    assert result.success, result.message
    # Two seconds of it speeding up and slowing down, at 1 m/s between.
    assert result.unknowns["final time"] == pytest.approx(4.0 + 2.0, rel=1e-4)
    sides = {label: side for side in result.limits.sides for label in side.labels}
    assert sides["rate of x <= 1"].t[-1] == pytest.approx(result.dense.tf)
    # With speed v and acceleration a it takes d/v + v/a; duals are by seconds of the true time.
    side = sides["rate of x <= 1"]
    saved = np.trapezoid(side.dual[:, 0], side.t)
    step = 1e-2
    assert saved == pytest.approx((4.0 / 1.0 + 1.0 / 0.5 - 4.0 / (1.0 + step) - (1.0 + step) / 0.5) / step, rel=0.1)
    assert result.trajectory.t[-1] == result.dense.tf
    assert result["x"][-1] == pytest.approx(4.0)


def test_what_is_wanted_over_time_is_wanted_at_the_same_fractions():
    wanted = PiecewisePolynomial.through([0.0, 2.0], [[0.0, 0.0], [1.0, 0.0]], kind="linear")
    cost = ContinuousQuadraticCost(wanted, [0.0], Q=[1e4, 0.0], R=[1e-3])
    line = optimize(
        MASS, cost, initial=([0.0, 0.5], [0.0]), horizon=(0.0, 2.0), unknowns=[FinalTime(weight=1.0, wanted=4.0)]
    )
    # A speed of 1/T throughout would cost nothing; what it begins with is 0.5.
    other = PiecewisePolynomial.through([0.0, 3.0], [[0.0, 0.0], [1.0, 0.0]], kind="linear")
    again = ContinuousQuadraticCost(other, [0.0], Q=[1e4, 0.0], R=[1e-3])
    same = optimize(
        MASS, again, initial=([0.0, 0.5], [0.0]), horizon=(0.0, 3.0), unknowns=[FinalTime(weight=1.0, wanted=4.0)]
    )
    assert line.success
    assert same.success
    assert line.unknowns["final time"] == pytest.approx(same.unknowns["final time"], rel=1e-7)
    assert line.cost == pytest.approx(same.cost, rel=1e-8)


@pytest.mark.slow
def test_two_poles_are_turned_up_in_least_time():
    rod = {"mass": 1.0, "inertia": (0.0, 2.0, 2.0)}
    poles = Mechanism(
        [tx("cart", mass=1.0), [rz("a"), [tx(2.0, **rod), [rz("b"), [tx(2.0, **rod)]]]]],
        [Gravity((0.0, -9.81, 0.0)), JointForce("cart", "F")],
    )
    cost = ContinuousQuadraticCost(np.zeros(6), [0.0], Q=np.zeros(6), R=[1e-7])
    limits = [
        Bound("F", -50, 50), Bound("cart", -5, 5), Equal("a", np.pi / 2), Equal("b", 0.0), Equal("*", 0.0, of="rate")
    ]  # fmt: skip
    line = lambda t: [0.0, -np.pi / 2 + np.pi * t / 3.0, 0.0, 0.0, 0.0, 0.0]  # noqa: E731
    last = FinalTime(0.1, 30.0, price=1.0)
    start = {"initial": (line, [0.0]), "horizon": (0.0, 3.0)}
    result = optimize(MechanismSystem(poles), cost, **start, limits=limits, unknowns=[last])
    assert result.success, result.message
    # In 299 and 598 steps of the midpoint rule 2.8904 and 2.8900 s.
    assert result.unknowns["final time"] == pytest.approx(2.8898, abs=3e-4)


# ---- Parameters -----------------------------------------------------------------------------------------


def pendulum(length):
    return Mechanism([rx("a"), [tz(-length, mass=1.0, name="bob")]], [Gravity(), JointForce("a", input="u")])


@pytest.fixture(scope="module")
def swung():
    t = np.linspace(0.0, 3.0, 301)
    run = simulate(pendulum(1.234), [1.0], [0.3], t, rtol=1e-12, atol=1e-13)
    return PiecewisePolynomial.through(t, np.hstack([run.q, run.v]))


def test_the_length_of_a_pendulum_is_identified(swung):
    cost = ContinuousQuadraticCost(swung, [0.0], Q=[1.0, 0.0], R=[1e4])
    system = MechanismSystem(pendulum(1.0))
    start = {"initial": ([1.0, 0.3], [0.0]), "horizon": (0.0, 3.0)}
    for free in (False, True):
        result = optimize(system, cost, **start, unknowns=[Parameter("bob.value")], free_start=free)
        assert result.success, result.message
        assert result.unknowns["bob.value"] == pytest.approx(-1.234, rel=1e-7)
        assert result.system.mechanism.parameters["bob.value"] == result.unknowns["bob.value"]
        np.testing.assert_allclose(result.x[0], [1.0, 0.3], atol=1e-7)
    again = optimize(system, cost, initial=result, unknowns=[Parameter("bob.value")], free_start=True)
    assert again.success
    assert again.iterations <= 2
    assert again.unknowns["bob.value"] == pytest.approx(-1.234, rel=1e-7)


def test_one_number_of_several_elements_is_found():
    t = np.linspace(0.0, 2.0, 201)

    def carts(k):
        springs = [JointSpring("x", k, name="one"), JointSpring("y", k, name="other"), JointForce("x", input="push")]
        return Mechanism(
            [tx("x", mass=1.0), tx("y", mass=2.0)], springs, shared={"k": ["one.stiffness", "other.stiffness"]}
        )

    run = simulate(carts(7.0), [1.0, -0.5], None, t, rtol=1e-12, atol=1e-13)
    wanted = PiecewisePolynomial.through(t, np.hstack([run.q, run.v]))
    cost = ContinuousQuadraticCost(wanted, [0.0], Q=[1.0, 1.0, 0.0, 0.0], R=[1e4])
    start = {"initial": ([1.0, -0.5, 0.0, 0.0], [0.0]), "horizon": (0.0, 2.0)}
    result = optimize(MechanismSystem(carts(5.0)), cost, **start, unknowns=[Parameter("k", 1.0, 20.0)])
    assert result.success, result.message
    assert result.unknowns["k"] == pytest.approx(7.0, rel=1e-7)


def test_a_limit_on_a_frame_follows_the_length_that_moves_it():
    cost = ContinuousQuadraticCost([1.0, 0.0], [0.0], Q=[1.0, 0.1], R=[0.1])
    start = {"initial": ([0.0, 0.0], [0.0]), "horizon": (0.0, 1.0)}
    limits = [Keep("bob", inside=Box((-1.0, -0.15, -3.0), (1.0, 0.15, 0.0)))]
    unknowns = [Parameter("bob.value", -3.0, -0.5, weight=0.1)]
    result = optimize(MechanismSystem(pendulum(1.0)), cost, **start, limits=limits, unknowns=unknowns, **ROUGHLY)
    assert result.success, result.message
    run, length = result.trajectory, -result.unknowns["bob.value"]
    places = run.mechanism.positions(run.q, ["bob"])[:, 0]
    np.testing.assert_allclose(np.hypot(places[:, 1], places[:, 2]), length)
    assert np.abs(places[:, 1]).max() == pytest.approx(0.15, abs=1e-4)
    assert length < 0.98  # Shorter, it may swing further.


def test_a_start_follows_the_parameter_that_its_constraint_depends_on():
    hung = Mechanism(
        [tx("x"), [tz("z", mass=1.0, name="bob")]],
        [Gravity(), Distance("world", "bob", 1.0, name="rod"), JointForce("x", input="push")],
    )
    cost = ContinuousQuadraticCost([0.5, -1.0, 0.0, 0.0], [0.0], Q=[1.0, 1.0, 0.1, 0.1], R=[1.0])
    start = {"initial": ([0.0, -1.0, 0.0, 0.0], [0.0]), "horizon": (0.0, 0.5)}
    length = Parameter("rod.length", 0.5, 2.0, weight=0.1)
    with pytest.raises(ArgumentError, match="rod"):
        optimize(MechanismSystem(hung), cost, **start, unknowns=[length])
    result = optimize(MechanismSystem(hung), cost, **start, unknowns=[length], free_start=True)
    assert result.success, result.message
    assert result.unknowns["rod.length"] != pytest.approx(1.0, abs=1e-3)
    np.testing.assert_allclose(np.hypot(*result.x[:, :2].T), result.unknowns["rod.length"], rtol=1e-8)


# ---- Motions that return ----------------------------------------------------------------------------------


def test_a_motion_that_returns_is_that_of_its_frequency():
    slide = MechanismSystem(Mechanism([tx("x", mass=1.0)], [JointForce("x", input="u")]))
    cost = ContinuousQuadraticCost(lambda t: [np.sin(2.0 * np.pi * t), 0.0], [0.0], Q=[100.0, 0.0], R=[0.01])
    start = {"initial": ([0.0, 1.0], [0.0]), "horizon": (0.0, 1.0)}
    result = optimize(slide, cost, **start, limits=[Periodic("*")], free_start=True)
    assert result.success, result.message
    w = 2.0 * np.pi
    t, size = np.linspace(0.0, 1.0, 41), 100.0 / (100.0 + 0.01 * w**4)
    np.testing.assert_allclose(result.dense.x(t)[:, 0], size * np.sin(w * t), atol=1e-5)
    np.testing.assert_allclose(result.x[-1], result.x[0], atol=1e-8)
    # Nothing is said of the inputs: those of the cheapest motion return by themselves.
    np.testing.assert_allclose(result.u[[0, -1]], 0.0, atol=2e-2)
    with pytest.raises(ArgumentError, match="fixed initial state"):
        optimize(slide, cost, **start, limits=[Periodic("*")])


def test_the_period_of_a_motion_that_returns_is_found():
    swing = MechanismSystem(Mechanism([tx("x", mass=2.0)], [JointSpring("x", 8.0), JointForce("x", input="u")]))
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1.0])
    limits = [Periodic("*"), Equal("x", 1.0, at="start"), Equal("x", -1.0, at=1.5)]
    start = {"initial": (lambda t: [np.cos(2.0 * np.pi * t / 3.0), 0.0], [0.0]), "horizon": (0.0, 3.0)}
    unknowns = [FinalTime(1.0, 5.0, price=1.0)]
    result = optimize(swing, cost, **start, limits=limits, unknowns=unknowns, free_start=True)
    assert result.success, result.message

    def least(y):
        """Return the cost of half a swing from (1, v) to (-1, -v) in T/2, twice, by the Gramian; and the time."""
        v, half = y
        A, B = np.array([[0.0, 1.0], [-4.0, 0.0]]), np.array([[0.0], [0.5]])
        whole = expm(half * np.block([[A, B @ B.T], [np.zeros((2, 2)), -A.T]]))
        W = whole[:2, 2:] @ whole[:2, :2].T
        d = np.array([-1.0, -v]) - whole[:2, :2] @ [1.0, v]
        return d @ np.linalg.solve(W, d) + 2.0 * half

    found = minimize(least, [0.0, 1.5], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14})
    assert result.cost == pytest.approx(found.fun, rel=1e-7)
    assert result.unknowns["final time"] == pytest.approx(2.0 * found.x[1], rel=1e-5)
    assert result.x[0, 1] == pytest.approx(found.x[0], abs=1e-4)
    assert result.unknowns["final time"] < 0.995 * np.pi  # which it takes by itself


# ---- Going on, and what is told -----------------------------------------------------------------------------


def test_a_run_goes_on_bit_by_bit(tmp_path):
    effort = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1e-2])
    problem = {
        "limits": [Bound("u[0]", -1.0, 1.0), Equal(["x[0]", "x[1]"], [2.0, 0.0])],
        "unknowns": [FinalTime(0.1, 30.0, price=1.0)],
        **ROUGHLY,
    }
    start = {"initial": ([0.0, 0.0], [0.1]), "horizon": (0.0, 3.0)}
    seen = []
    whole = optimize(MASS, effort, **start, **problem, callback=lambda record: seen.append(record.x.shape))
    assert {shape[1] for shape in seen} == {2}
    part = optimize(MASS, effort, **start, **problem, max_iterations=9)
    assert part.status is Status.ITERATION_LIMIT
    save_result(tmp_path / "part.npz", part)
    rest = optimize(MASS, effort, **problem, resume=load_result(tmp_path / "part.npz"))
    assert rest.success
    assert rest.iterations == whole.iterations
    np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
    np.testing.assert_array_equal(rest.x, whole.x)
    with pytest.raises(ArgumentError, match="final time"):
        optimize(MASS, effort, limits=problem["limits"], resume=part, **ROUGHLY)


def test_gains_of_a_projection_are_those_of_the_own_states(swung):
    cost = ContinuousQuadraticCost(swung, [0.0], Q=[1.0, 0.0], R=[1e4])
    start = {"initial": ([1.0, 0.3], [0.0]), "horizon": (0.0, 3.0), "unknowns": [Parameter("bob.value")]}
    gains = PiecewisePolynomial.constant(np.array([[2.0, 1.0]]), 0.0, 3.0)
    result = optimize(MechanismSystem(pendulum(1.0)), cost, **start, projection=gains, **ROUGHLY)
    assert result.success, result.message
    assert result.unknowns["bob.value"] == pytest.approx(-1.234, rel=1e-5)
    with pytest.raises(ArgumentError, match="projection: Q: got a function"):
        optimize(MechanismSystem(pendulum(1.0)), cost, **start, projection={"Q": lambda t: [1.0, 1.0]})


@pytest.mark.parametrize(
    ("system", "unknown", "said"),
    [
        (MASS, Parameter("mass"), "no\\s*`parameters`"),
        (MechanismSystem(pendulum(1.0)), Parameter("bob.mas"), "'bob.mass'"),
        (MASS, FinalTime(max=-1.0), "expected a time after the first"),
        (MASS, FinalTime(guess=-1.0), "expected a time after the first"),
    ],
)
def test_what_cannot_be_found_is_said(system, unknown, said):
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
    with pytest.raises(ArgumentError, match=said):
        optimize(system, cost, initial=([1.0, 0.0], [0.0]), horizon=(0.0, 1.0), unknowns=[unknown])


def test_a_system_that_jumps_has_no_free_final_time():
    system = FunctionContinuousSystem(
        lambda x, u, t: np.array([x[1], u[0] + (t > 0.5)]), nx=2, nu=1, jumps=[0.5],
        derivatives=lambda x, u, t: (np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])),
    )  # fmt: skip
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
    with pytest.raises(ArgumentError, match=r"jumps with time, at 0\.5 s"):
        optimize(system, cost, initial=([1.0, 0.0], [0.0]), horizon=(0.0, 1.0), unknowns=[FinalTime()])


@pytest.mark.parametrize("guess", [0.2, 0.02])
def test_a_time_that_is_too_short_is_begun_again(guess: float) -> None:
    """In no time nothing moves, so that limits are violated as little as is possible nearby: it ended there."""
    cart = [ty("x", mass=2.0), [rx("theta"), [tz(-1.0, mass=1.0)]]]
    m = Mechanism(cart, [Gravity(), JointForce("x", input="push")])
    cost = ContinuousQuadraticCost(np.zeros(4), np.zeros(1), Q=[0.0] * 4, R=[0.1])
    limits = [Bound("push", -5.0, 5.0), Equal(["x", "theta"], [1.0, 0.0]), Equal("*", 0.0, of="rate")]
    asked = {"initial": (np.zeros(4), np.zeros(1)), "horizon": (0.0, guess), "limits": limits}
    found = optimize(MechanismSystem(m), cost, unknowns=[FinalTime(price=1.0)], **asked)
    assert found.status is Status.CONVERGED
    assert found.unknowns["final time"] == pytest.approx(2.186081, rel=1e-5)
    lost = optimize(MechanismSystem(m), cost, unknowns=[FinalTime(price=1.0)], without=["gaps"], **asked)
    assert lost.status is Status.INFEASIBLE
    assert f"give it a least value, FinalTime(min=...), or begin with a longer horizon than {guess} s" in lost.message
