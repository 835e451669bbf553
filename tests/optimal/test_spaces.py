"""States that are no plain vectors: on a circle, and rotations as unit quaternions."""

from __future__ import annotations

import numpy as np
import pytest

import leastaction as la
from leastaction.errors import ArgumentError
from leastaction.numerics import rotations
from leastaction.numerics.differences import central_differences
from leastaction.optimal import (
    Bound,
    ContinuousQuadraticCost,
    ContinuousSystem,
    DiscreteSystem,
    FinalTime,
    FunctionQuantity,
    FunctionSystem,
    Optimizer,
    Periodic,
    ProductSpace,
    QuadraticCost,
    Rotations,
    Status,
    Vectors,
    Within,
    check_derivatives,
    coarse_to_fine,
    optimize,
    receding_horizon,
)
from leastaction.optimal.space import DifferencedSpace
from leastaction.optimal.unknowns.system import ExtendedSystem
from optimal.spaces import BODY, Body, Circle, Pendulum, TimedBody, attitude, body, step

AT_REST = np.zeros(3)


def to_attitude(N, axis, angle, *, of_rates=0.1, of_inputs=0.01):
    """Return a cost that asks a body for an attitude at the end, and its initial state and inputs."""
    wanted = np.tile([*attitude(axis, angle), *AT_REST], (N + 1, 1))
    Q, last = np.r_[np.zeros(3), np.full(3, of_rates)], np.full(6, 100.0)
    cost = QuadraticCost(wanted, np.zeros((N, 3)), Q=Q, R=np.full(3, of_inputs), Q_final=last, space=BODY)
    return cost, (np.array([1.0, 0, 0, 0, 0.1, -0.2, 0.3]), np.zeros((N, 3)))


def swing_up(system):
    wanted = np.tile([-1.0, 0.0, 0.0], (system.N + 1, 1))
    cost = QuadraticCost(wanted, np.zeros((system.N, 1)), Q=[0.1, 0.01], R=[0.02], Q_final=[100.0, 10.0], space=system)
    return cost, (np.array([np.cos(0.4), np.sin(0.4), 0.0]), np.zeros((system.N, 1)))


def is_followed(system, x, u):
    ends = np.stack([system.f(x[k], u[k], k) for k in range(system.N)])
    return np.abs(system.difference(ends, x[1:])).max() < 1e-9


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.049, 0.051, 1.0, 3.0])
def test_rotations_differ_as_scipy_says_and_their_derivatives_are_those_of_differences(angle):
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(3)
    axis, q = rng.standard_normal(3), rng.standard_normal(4)
    x = np.array([*(q / np.linalg.norm(q)), 1.0, 2.0, -1.0])
    turn = angle * axis / np.linalg.norm(axis)
    y = BODY.plus(x, np.array([*turn, 0.1, 0.2, 0.3]))
    of = [Rotation.from_quat(np.roll(each[:4], -1)) for each in (x, y)]
    assert BODY.difference(y, x)[:3] == pytest.approx((of[0].inv() * of[1]).as_rotvec(), abs=1e-15)
    assert BODY.difference(y, x) == pytest.approx([*turn, 0.1, 0.2, 0.3], abs=1e-15)
    by_differences = DifferencedSpace(7, 6, BODY.difference, BODY.plus)
    w, v = rng.standard_normal(6), rng.standard_normal(7)
    for name, given, tolerance in (
        ("difference_derivative", (y, x), 1e-11),
        ("difference_curvature", (y, x, w), 1e-8),
        ("plus_derivative", (y,), 1e-11),
        ("plus_curvature", (y, v), 1e-8),
    ):
        assert getattr(BODY, name)(*given) == pytest.approx(getattr(by_differences, name)(*given), abs=tolerance)


def test_derivatives_of_a_step_among_rotations_are_those_of_automatic_differentiation():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy

    def times(p, q):
        return jnp.concatenate(
            [(p[0] * q[0] - p[1:] @ q[1:])[None], p[0] * q[1:] + q[0] * p[1:] + jnp.cross(p[1:], q[1:])]
        )

    def turn(phi):
        half = 0.5 * jnp.sqrt(phi @ phi + 1e-300)
        return jnp.concatenate([jnp.cos(half)[None], 0.5 * phi * jnp.sinc(half / jnp.pi)])

    def log(q):
        # Of small rotations, to fifth order: enough for second derivatives at none.
        v = q[1:] * jnp.sign(q[0])
        s = v @ v
        return 2.0 * v * (1.0 + s / 6.0 + 3.0 * s * s / 40.0)

    inertia = jnp.array([1.0, 1.3, 0.7])

    def move(q, w, u):
        w = w + 0.1 * (u - jnp.cross(w, inertia * w)) / inertia
        return times(q, turn(0.1 * w)), w

    rng = np.random.default_rng(1)
    x, u, z = np.r_[attitude([1, 2, 3], 2.0), 2.0, -3.0, 1.0], rng.standard_normal(3), rng.standard_normal(6)
    end = move(x[:4], x[4:], u)

    def charted(y):
        # A quaternion moved to second order: what is beyond has no part in second derivatives at zero.
        d = y[:3]
        moved = jnp.concatenate([(1.0 - d @ d / 8.0)[None], 0.5 * d])
        q, w = move(times(x[:4], moved), x[4:] + y[3:6], y[6:])
        back = end[0] * jnp.array([1.0, -1.0, -1.0, -1.0])
        return jnp.concatenate([log(times(back, q)), w - end[1]])

    at = jnp.array(np.r_[np.zeros(6), u])
    A, B = body(4).derivatives(x, u, 0)
    assert np.hstack([A, B]) == pytest.approx(np.asarray(jax.jit(jax.jacfwd(charted))(at)), abs=1e-13)
    expected = np.asarray(jax.jit(jax.hessian(lambda y: z @ charted(y)))(at))
    assert np.abs(expected).max() > 0.05
    assert body(4).curvature(x, u, 0, z) == pytest.approx(expected, abs=1e-8)


def test_functions_of_steps_among_rotations_are_derived_by_charts():
    known = body(4)
    system = FunctionSystem(
        lambda x, u, k: step(x, u, 0.1),
        nx=7, nu=3, N=4, derivatives="complex-step", curvature="differences", space=BODY,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    x, u, z = np.r_[attitude([1, 2, 3], 2.0), 2.0, -3.0, 1.0], rng.standard_normal(3), rng.standard_normal(6)
    for ours, theirs in zip(system.derivatives(x, u, 0), known.derivatives(x, u, 0), strict=True):
        assert ours == pytest.approx(theirs, abs=1e-13)
    assert system.curvature(x, u, 0, z) == pytest.approx(known.curvature(x, u, 0, z), abs=1e-9)
    given = FunctionSystem(
        system.f, nx=7, nu=3, N=4, derivatives=known.derivatives, curvature=known.curvature, space=BODY
    )
    assert np.array_equal(given.curvature(x, u, 0, z), known.curvature(x, u, 0, z))
    with pytest.raises(ArgumentError, match=r"A: the function returned shape \(7, 7\), expected \(6, 6\)"):
        FunctionSystem(
            system.f, nx=7, nu=3, N=4, derivatives=lambda x, u, k: (np.eye(7), np.ones((7, 3))), space=BODY
        ).derivatives(x, u, 0)


@pytest.mark.parametrize("kind", ["circle", "rotations"])
def test_systems_and_costs_keep_to_their_derivatives(kind):
    rng = np.random.default_rng(2)
    if kind == "circle":
        system = Pendulum(6)
        cost, (x0, _) = swing_up(system)
    else:
        system = body(6)
        cost, (x0, _) = to_attitude(6, [1, 2, 3], 2.5)
    u = rng.standard_normal((6, system.nu))
    x = system.plus(np.tile(x0, (7, 1)), 0.6 * rng.standard_normal((7, system.ndx)))
    report = check_derivatives(system, x, u, cost=cost)
    assert report.ok, str(report)


def test_a_wrong_derivative_among_rotations_is_seen():
    class Wrong(Pendulum):
        def derivatives(self, x, u, k):
            A, B = super().derivatives(x, u, k)
            return A.T, B

    system = Wrong(6)
    cost, (x0, u) = swing_up(system)
    assert not check_derivatives(system, np.tile(x0, (7, 1)), u, cost=cost).ok


@pytest.mark.parametrize(("axis", "angle"), [([1, 2, 3], 2.9), ([-1, 0.3, 0.2], 3.1)])
def test_newton_ends_quadratically_among_rotations(axis, angle):
    system = body(20)
    cost, initial = to_attitude(20, axis, angle)
    found = optimize(system, cost, initial=initial, tolerance=1e-24, absolute_tolerance=0.0, without=["easing"])
    assert is_followed(system, found.x, found.u)
    assert np.abs(BODY.difference(found.x[-1], cost.x_wanted[-1])).max() < 0.05
    assert is_minimum(system, cost, found)
    # The decrease that is expected goes with the square of the distance, so that it is squared in its turn.
    expected, methods = found.history.expected_decrease / found.cost, found.history.method
    assert methods[-2:] == ("newton", "newton")
    assert expected[-1] < 10.0 * expected[-2] ** 2 < 1e-6


def is_minimum(system, cost, found):
    """Whether no small change of the inputs lowers the cost to first order."""
    rng = np.random.default_rng(0)
    N, K = system.N, np.zeros((system.N, system.nu, system.ndx))
    slopes = []
    for _ in range(3):
        du = rng.standard_normal(found.u.shape)
        values = []
        for by in (1e-4, -1e-4):
            run = system.rollout(found.x[0], found.x, found.u + by * du, K, 0, N)
            values.append(cost.value(run.x, run.u))
        slopes.append((values[0] - values[1]) / 2e-4)
    return np.abs(slopes).max() < 1e-5 * (1.0 + found.cost)


@pytest.mark.parametrize("kind", ["circle", "rotations"])
def test_gaps_close_across_half_a_turn(kind):
    """From a curve of states that jump to and fro: each step misses its next state, some by nearly half a turn."""
    if kind == "circle":
        system = Pendulum(40)
        cost, (x0, u) = swing_up(system)
        x = cost.x_wanted.copy()
        x[1::2] = _turned(x[1::2], 0.05)
        x[20] = _turned(x[20], 3.1)
    else:
        system = body(20)
        cost, (x0, u) = to_attitude(20, [1, 2, 3], 3.0)
        x = cost.x_wanted.copy()
        x[1::3] = BODY.plus(x[1::3], np.r_[2.9, 0.1, 0.2, 0.0, 0.0, 0.0] * np.ones((len(x[1::3]), 1)))
        x[:, :4] *= np.where(np.arange(21) % 2, 1.0, -1.0)[:, None]  # the same rotations
    x[0] = x0
    found = optimize(system, cost, initial=(x, u), shooting="multiple", tolerance=1e-12)
    assert found.status is Status.CONVERGED, found.message
    assert found.gap == 0.0
    assert found.history.gap[0] > 0.1
    assert is_followed(system, found.x, found.u)
    assert is_minimum(system, cost, found)


def _turned(x, by):
    return ProductSpace(Circle(), Vectors(1)).plus(x, np.array([by, 0.0]))


def test_a_search_among_rotations_that_is_stopped_and_resumed_is_the_same():
    system = body(8)
    cost, initial = to_attitude(8, [1, 2, 3], 2.8)
    limits = [Bound("u*", -4.0, 4.0), Within(BACKWARDS, max=1.2)]
    for more in ({}, {"limits": limits}, {"shooting": "multiple"}, {"free_start": ["x[4]", "x[5]", "x[6]"]}):
        whole = optimize(system, cost, initial=initial, **more)
        for stop in (2, 5):
            part = optimize(system, cost, initial=initial, max_iterations=stop, **more)
            if part.status is not Status.ITERATION_LIMIT:
                continue
            again = optimize(system, cost, resume=part, **more)
            assert again.status is whole.status
            assert np.array_equal(again.x, whole.x)
            assert np.array_equal(again.history.cost, whole.history.cost)


BACKWARDS = FunctionQuantity("leans", lambda x: 2.0 * (x[:, 1] ** 2 + x[:, 2] ** 2))  # 1 less the cosine of the tilt


def test_a_search_among_rotations_goes_on_from_a_file(tmp_path):
    system = body(8)
    cost, initial = to_attitude(8, [1, 2, 3], 2.8)
    for more in ({}, {"shooting": "multiple"}, {"limits": [Bound("u*", -4.0, 4.0, of="input rate")]}):
        whole = optimize(system, cost, initial=initial, **more)
        part = optimize(system, cost, initial=initial, max_iterations=2, **more)
        part.save(tmp_path / "part.npz")
        again = optimize(system, cost, resume=la.open(tmp_path / "part.npz"), **more)
        assert np.array_equal(again.x, whole.x)


def test_limits_hold_on_entries_and_functions_of_states_that_are_no_vectors():
    system = body(20)
    cost, initial = to_attitude(20, [0.2, 0.1, 1.0], 2.9)
    free = optimize(system, cost, initial=initial)
    lowest, tilt = free.x[1:, 6].max() - 0.2, BACKWARDS.values(samples(free.x)).max() - 0.02
    within = optimize(system, cost, initial=initial, limits=[Bound("x[6]", max=lowest), Within(BACKWARDS, max=tilt)])
    assert within.status is Status.CONVERGED, within.message
    assert within.x[1:, 6].max() == pytest.approx(lowest, abs=1e-5)
    assert BACKWARDS.values(samples(within.x)).max() == pytest.approx(tilt, abs=1e-5)
    assert within.cost > free.cost
    # A dual is by how much the cost falls for a unit more of room.
    more = optimize(
        system, cost, initial=initial, limits=[Bound("x[6]", max=lowest + 1e-4), Within(BACKWARDS, max=tilt)]
    )
    assert within.limits.dual(within.limits.labels[0]).sum() == pytest.approx(
        (within.cost - more.cost) / 1e-4, rel=2e-2
    )


def test_sums_of_entries_and_rates_of_inputs_are_limited_among_rotations():
    system = body(10)
    cost, initial = to_attitude(10, [0.2, 0.1, 1.0], 2.0)
    free = optimize(system, cost, initial=initial)
    most, fastest = (free.x[1:, 4] + 2.0 * free.x[1:, 6]).max() - 0.3, 0.8 * np.abs(np.diff(free.u[:, 2])).max()
    limits = [Bound({"x[4]": 1.0, "x[6]": 2.0}, max=most), Bound("u[2]", -fastest, fastest, of="input rate")]
    within = optimize(system, cost, initial=initial, limits=limits)
    assert within.status is Status.CONVERGED, within.message
    assert (within.x[1:, 4] + 2.0 * within.x[1:, 6]).max() == pytest.approx(most, abs=1e-5)
    assert np.abs(np.diff(within.u[:, 2])).max() < fastest + 1e-6
    assert within.K.shape == (10, 3, 6)
    assert is_followed(system, within.x, within.u)


def samples(x):
    from leastaction.optimal.quantity import Samples

    return Samples(np.arange(len(x)), x, np.empty((len(x), 0)), np.empty((len(x), 0)))


def test_a_free_start_among_rotations_is_the_best_one():
    system = body(15)
    cost, (x0, u) = to_attitude(15, [1, 2, 3], 2.0)
    wanted = QuadraticCost(
        cost.x_wanted, cost.u_wanted, Q=np.r_[np.full(3, 0.05), 0.1, 0.1, 0.1], R=cost.R, Q_final=cost.Q_final,
        space=BODY,
    )  # fmt: skip
    held = optimize(system, wanted, initial=(x0, u))
    freed = optimize(system, wanted, initial=(x0, u), free_start=["x[0]", "x[1]", "x[2]", "x[3]"], tolerance=1e-12)
    assert freed.status is Status.CONVERGED
    assert freed.cost < held.cost - 1e-3
    assert np.linalg.norm(freed.x[0, :4]) == pytest.approx(1.0, abs=1e-12)
    assert freed.x[0, 4:] == pytest.approx(x0[4:], abs=1e-15)
    for direction in np.eye(6)[:3]:
        moved = [system.plus(freed.x[0], by * direction) for by in (1e-3, -1e-3)]
        costs = [optimize(system, wanted, initial=(at, freed.u)).cost for at in moved]
        assert min(costs) > freed.cost


def test_windows_and_coarser_steps_go_through_the_space():
    system = body(20)
    cost, initial = to_attitude(20, [1, 2, 3], 2.5)
    whole = optimize(system, cost, initial=initial)
    made = receding_horizon(system, cost, initial=initial, window=10)
    again = optimize(system, cost, initial=(made.x, made.u))
    assert again.cost == pytest.approx(whole.cost, rel=1e-7)

    def build(t):
        steps = np.diff(t)
        priced = QuadraticCost(
            np.tile(cost.x_wanted[0], (len(t), 1)), np.zeros((len(steps), 3)),
            Q=steps[:, None] / 0.1 * cost.Q, R=steps[:, None] / 0.1 * cost.R, Q_final=cost.Q_final, space=BODY,
        )  # fmt: skip
        return Body(steps), priced

    found = coarse_to_fine(build, 0.1 * np.arange(21), initial=initial, factors=(4, 2, 1))
    assert found.result.cost == pytest.approx(whole.cost, rel=1e-7)


def test_an_optimizer_runs_again_among_rotations():
    system = body(15)
    cost, (x0, u) = to_attitude(15, [1, 2, 3], 2.5)
    solver = Optimizer(system, cost)
    solver.run((x0, u))
    moved = BODY.plus(x0, np.array([0.1, 0.0, -0.1, 0.0, 0.0, 0.0]))
    assert solver.again(moved).cost == pytest.approx(optimize(system, cost, initial=(moved, u)).cost, rel=1e-8)


def test_a_system_with_a_difference_and_a_plus_of_its_own_needs_no_space():
    class Own(DiscreteSystem):
        nx, nu, N = 3, 1, 12
        has_curvature = True

        def __init__(self):
            self.ndx = 2
            self.inner = Pendulum(12)

        def difference(self, x, xbar):
            return self.inner.difference(x, xbar)

        def plus(self, x, dx):
            return self.inner.plus(x, dx)

        def f(self, x, u, k):
            return self.inner.f(x, u, k)

        def derivatives(self, x, u, k):
            return self.inner.derivatives(x, u, k)

        def curvature(self, x, u, k, z):
            return self.inner.curvature(x, u, k, z)

    system, known = Own(), Pendulum(12)
    for more in ({}, {"shooting": "multiple", "limits": [Bound("u*", -6.0, 6.0), Bound("x[1]", -0.9, 0.9)]}):
        cost, initial = swing_up(system)
        expected = optimize(known, swing_up(known)[0], initial=initial, **more)
        found = optimize(system, cost, initial=initial, **more)
        assert found.status is expected.status
        assert found.cost == pytest.approx(expected.cost, rel=1e-8)


def test_what_does_not_fit_a_space_is_told():
    system = body(5)
    cost, (x0, u) = to_attitude(5, [1, 2, 3], 1.0)
    with pytest.raises(ArgumentError, match="space=system"):
        optimize(system, QuadraticCost(cost.x_wanted, u, Q=np.ones(7), R=np.ones(3)), initial=(x0, u))
    with pytest.raises(ArgumentError, match=r"initial x: got a quaternion of length 1\.1"):
        optimize(system, cost, initial=(x0 * np.r_[1.1, np.ones(6)], u))
    with pytest.raises(ArgumentError, match="x_wanted: got a quaternion of length 0, expected a unit"):
        QuadraticCost(np.zeros((6, 7)), u, Q=np.ones(6), R=np.ones(3), space=system)
    with pytest.raises(ArgumentError, match="parts: got nothing"):
        ProductSpace()
    with pytest.raises(ArgumentError, match="expected spaces such as"):
        ProductSpace(Rotations(), 3)


def test_unknowns_beside_rotations_are_derived_and_found():
    system, rng = TimedBody(12, 1.5), np.random.default_rng(4)
    extended = ExtendedSystem(system, ["final time", "strength"], [], False)
    x = np.hstack([np.tile(to_attitude(12, [1, 2, 3], 2.0)[1][0], (13, 1)), np.tile([1.3, 0.8], (13, 1))])
    u = rng.standard_normal((12, 3))
    x = extended.plus(x, np.hstack([0.5 * rng.standard_normal((13, 6)), np.zeros((13, 2))]))
    report = check_derivatives(extended, x, u)
    assert report.ok, str(report)

    cost, initial = to_attitude(12, [1, 2, 3], 2.0)
    limits = [Bound("u*", -6.0, 6.0)]
    unknowns = [FinalTime(0.5, 3.0, price=1.0)]
    found = optimize(system, cost, initial=initial, unknowns=unknowns, limits=limits, tolerance=1e-12)
    assert found.status is Status.CONVERGED, found.message
    T = found.unknowns["final time"]
    assert 0.5 < T < 3.0
    assert found.K.shape == (12, 3, 6)

    def best(T):
        start = (found.x[0], found.u)
        return optimize(system.with_parameters({"final time": T}), cost, initial=start, limits=limits).cost + T

    assert best(T) == pytest.approx(found.cost, rel=1e-8)
    assert min(best(T - 0.02), best(T + 0.02)) > best(T)


def test_what_returns_in_another_space_is_refused_by_name():
    system = Pendulum(5)
    cost, initial = swing_up(system)
    expected = "Periodic: got entries of a Circle, expected some of vectors and rotations"
    with pytest.raises(ArgumentError, match=expected):
        optimize(system, cost, initial=initial, limits=[Periodic("x*")], free_start=True)


def test_a_quadratic_cost_in_continuous_time_prices_differences():
    rng = np.random.default_rng(5)
    wanted = np.array([*attitude([1, 2, 3], 2.0), *AT_REST])
    cost = ContinuousQuadraticCost(
        wanted, np.zeros(3), Q=np.arange(1.0, 7.0), R=np.ones(3), Q_final=np.ones(6), space=BODY
    )
    x = BODY.plus(np.tile(wanted, (2, 1)), rng.standard_normal((2, 6)))
    u, t = rng.standard_normal((2, 3)), np.array([0.1, 0.2])
    off = BODY.difference(x, wanted)
    assert cost.rates(x, u, t) == pytest.approx(0.5 * (off**2 @ np.arange(1.0, 7.0) + np.sum(u**2, axis=1)), rel=1e-14)
    slope = central_differences(lambda y: np.array([cost.rate(y, u[0], 0.1)]), x[0])[0]
    assert cost.gradient(x, u, t).q[0] == pytest.approx(slope, abs=1e-8)
    last = central_differences(lambda y: np.array([cost.final_value(y, 0.1)]), x[0])[0]
    assert cost.final_gradient(x[0], 0.1) == pytest.approx(last, abs=1e-8)
    bent = central_differences(lambda y: cost.gradient(y[None], u[:1], t[:1]).q[0], x[0])
    assert cost.hessian(x, u, t).Q[0] == pytest.approx(bent, abs=1e-7)
    bent = central_differences(lambda y: cost.final_gradient(y, 0.1), x[0])
    assert cost.final_hessian(x[0], 0.1) == pytest.approx(bent, abs=1e-7)


@pytest.mark.parametrize("space", [Rotations(), Circle(), BODY], ids=["rotations", "circle", "product"])
def test_differences_derive_by_numbers(space):
    """Those of states are the inverse of how states move; a space that says nothing leaves out what is across them."""
    rng = np.random.default_rng(3)
    x = space.plus(np.eye(space.nx)[0], rng.standard_normal(space.ndx))[None]
    w = rng.standard_normal((1, space.ndx))
    G, N = space.changes(x)[0], space.plus_derivative(x)[0]
    identity = G @ N
    assert identity == pytest.approx(np.eye(space.ndx), abs=1e-14)
    # Along the states to second order: differences of plus(x, d) are d.
    bent = N.T @ space.changes_curvature(x, w)[0] @ N
    assert bent == pytest.approx(-space.plus_curvature(x, w @ G)[0], abs=1e-13)


class Steered(ContinuousSystem):
    """A quaternion that is turned at will, by its numbers."""

    nx, nu, space = 4, 3, Rotations()

    def f(self, x, u, t):
        return 0.5 * rotations.product(x, np.r_[0.0, u])

    def derivatives(self, x, u, t):
        A = [0.5 * rotations.product(e, np.r_[0.0, u]) for e in np.eye(4)]
        return np.transpose(A), np.transpose([0.5 * rotations.product(x, e) for e in np.eye(4)[1:]])

    def curvature(self, x, u, t, z):
        H = np.zeros((7, 7))
        H[:4, 4:] = [[0.5 * z @ rotations.product(e, turn) for turn in np.eye(4)[1:]] for e in np.eye(4)]
        return H + H.T


def test_a_continuous_system_is_steered_by_the_numbers_of_its_states():
    """The shortest way between attitudes: half the square of the angle, at a speed that does not change."""
    system, goal = Steered(), attitude([1, 2, 3], 2.5)
    cost = ContinuousQuadraticCost(
        goal, np.zeros(3), Q=np.zeros(3), R=np.ones(3), Q_final=np.full(3, 1e4), space=system
    )
    found = optimize(system, cost, initial=(np.eye(4)[0], np.zeros(3)), horizon=(0.0, 1.0))
    assert found.success
    assert found.cost == pytest.approx(0.5 * 2.5**2 / (1.0 + 1e-4), rel=1e-8)
    assert np.ptp(found.u, axis=0).max() < 1e-4
    still = ContinuousQuadraticCost(goal, np.zeros(3), Q=np.ones(3), R=np.ones(3), space=system)  # no final weight
    assert optimize(system, still, initial=(goal, np.zeros(3)), horizon=(0.0, 1.0)).cost < 1e-20
    with pytest.raises(ArgumentError, match=r"subtracts states.*give it space=system"):
        optimize(
            system,
            ContinuousQuadraticCost(goal, np.zeros(3), Q=np.zeros(4), R=np.ones(3)),
            initial=(np.eye(4)[0], np.zeros(3)),
            horizon=(0.0, 1.0),
        )


def test_a_continuous_system_with_a_difference_of_its_own_is_told_to_have_a_space():
    class Turning(Steered):
        space = None

        def difference(self, x, xbar):
            return x - xbar

    cost = ContinuousQuadraticCost(np.eye(4)[0], np.zeros(3), Q=np.ones(3), R=np.ones(3), space=Rotations())
    with pytest.raises(ArgumentError, match="got a Turning with a difference of states of its own"):
        optimize(Turning(), cost, initial=(np.eye(4)[0], np.zeros(3)), horizon=(0.0, 1.0))
