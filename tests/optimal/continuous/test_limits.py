"""Limits in continuous time: closed forms, the maximum principle, discrete time, and what users get wrong."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from threadpoolctl import threadpool_info, threadpool_limits

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Damping,
    Distance,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    MidpointVI,
    PointOnPlane,
    PointToPoint,
    project_configuration,
    rx,
    ry,
    tx,
    ty,
    tz,
    world,
)  # fmt: skip
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import (
    Accuracy,
    Bound,
    ContinuousQuadraticCost,
    Equal,
    FunctionContinuousSystem,
    FunctionQuantity,
    LinearContinuousSystem,
    Periodic,
    QuadraticCost,
    Status,
    Within,
    check_derivatives,
    optimize,
)
from leastaction.optimal.collocation.cost import AnyCollocationCost, QuadraticCollocationCost, collocation_cost
from leastaction.optimal.collocation.limits import Points, stated
from leastaction.optimal.collocation.mesh import STAGES, RadauMesh
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.continuous import regulate_continuous, solve_continuous_linear_quadratic
from leastaction.optimal.continuous.models import ContinuousModels
from leastaction.optimal.cost import matrix_of
from leastaction.optimal.quantity import Samples
from leastaction.systems import Ball, Keep, MechanismSystem, MidpointSystem
from leastaction.viz import plot_limits
from optimal.systems import rolled_out

MASS = LinearContinuousSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
EFFORT = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1.0])
ROUGHLY = {"accuracy": Accuracy(rtol=1e-6, atol=1e-8), "tolerance": 1e-7}


# ---- Against closed forms ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bounded():
    """A mass brought to rest by a bounded force."""
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 0.1], R=[0.1], Q_final=[1.0, 1.0])
    start = {"initial": ([1.0, 0.0], [0.0]), "horizon": (0.0, 3.0)}
    limits = [Bound("u[0]", -0.4, 0.5)]
    return cost, start, limits, optimize(MASS, cost, **start, limits=limits, **ROUGHLY)


def test_a_bounded_input_obeys_the_maximum_principle(bounded):
    _, _, _, result = bounded
    assert result.success, result.message
    assert result.limits.active("u[0] >= -0.4").size > 3
    t = np.linspace(0.0, 3.0, 301)
    weights = np.array([1.0, 0.1])

    def adjoint(time, z):
        return -(weights * result.dense.x(time) + np.array([0.0, z[0]]))

    done = solve_ivp(adjoint, (3.0, 0.0), result.x[-1], rtol=1e-9, atol=1e-11, dense_output=True)
    wanted = np.clip(-done.sol(t)[1] / 0.1, -0.4, 0.5)
    np.testing.assert_allclose(result.dense.u(t)[:, 0], wanted, atol=3e-3)
    # The dual, a density over time, is what is left of the derivative of the Hamiltonian.
    side = result.limits.sides[0]
    dual = np.maximum(0.1 * -0.4 + done.sol(side.t)[1], 0.0)
    np.testing.assert_allclose(result.limits.dual("u[0] >= -0.4"), dual, atol=3e-3)


@pytest.mark.parametrize("most", [0.1, 0.2])
def test_the_problem_of_bryson_and_denham_has_its_closed_form(most):
    ends = [Equal("x[0]", 0.0), Equal("x[1]", -1.0)]
    result = optimize(
        MASS,
        EFFORT,
        initial=([0.0, 1.0], [-2.0]),
        horizon=(0.0, 1.0),
        limits=[Bound("x[0]", max=most), *ends],
        **ROUGHLY,
    )
    assert result.success, result.message
    # With an arc along the limit from 3 l to 1 - 3 l, or with one touch in the middle.
    cost = 4.0 / (9.0 * most)
    if most > 1.0 / 6.0:
        # Cubics from (0, 1) to (l, 0) and back, in half a second each.
        d = np.array([most - 0.5, -1.0])
        cost = 2.0 * 0.5 * d @ np.linalg.solve([[0.5**3 / 3.0, 0.5**2 / 2.0], [0.5**2 / 2.0, 0.5]], d)
    # The limit holds at the points of the pieces; between them the motion may be a little cheaper.
    assert result.cost == pytest.approx(cost, rel=2e-6)
    assert result.dense.x(np.linspace(0.0, 1.0, 2001))[:, 0].max() < most + 1e-6
    np.testing.assert_allclose(result.x[-1], [0.0, -1.0], atol=1e-9)


def test_conditions_on_the_way_and_at_the_end_have_their_closed_form():
    limits = [Equal("x[0]", 0.8, at=0.5), Equal(["x[0]", "x[1]"], [1.0, 0.0])]
    result = optimize(MASS, EFFORT, initial=([0.0, 0.0], [0.0]), horizon=(0.0, 1.0), limits=limits, **ROUGHLY)
    assert result.success, result.message
    # Each is a linear functional of the input; what is cheapest is the least norm.
    t, weights = np.polynomial.legendre.leggauss(40)
    t = np.concatenate([0.25 * (t + 1.0), 0.5 + 0.25 * (t + 1.0)])
    weights = 0.25 * np.concatenate([weights, weights])
    rows = np.stack([np.maximum(0.5 - t, 0.0), 1.0 - t, np.ones_like(t)])
    multipliers = np.linalg.solve(rows * weights @ rows.T, [0.8, 1.0, 0.0])
    assert result.cost == pytest.approx(0.5 * multipliers @ [0.8, 1.0, 0.0], rel=1e-9)
    np.testing.assert_allclose(result.dense.u(t)[:, 0], multipliers @ rows, atol=1e-6 * np.abs(multipliers).max())
    found = np.concatenate([side.dual.ravel() for side in result.limits.sides])
    np.testing.assert_allclose(found, multipliers, rtol=1e-5)


def test_a_free_initial_state_is_that_of_the_value_function():
    A, B = np.array([[0.0, 1.0], [-2.0, -0.3]]), np.array([[0.0], [1.0]])
    Q, R, wanted = np.array([1.0, 0.2]), np.array([0.5]), np.array([0.4, -0.2])
    cost = ContinuousQuadraticCost(wanted, [0.0], Q=Q, R=R)
    start = {"initial": (np.zeros(2), [0.0]), "horizon": (0.0, 1.5)}
    result = optimize(LinearContinuousSystem(A, B), cost, **start, free_start=True)
    solved = solve_continuous_linear_quadratic(A, B, horizon=(0.0, 1.5), Q=Q, R=R, q=-Q * wanted)
    np.testing.assert_allclose(result.x[0], -np.linalg.solve(solved.P(0.0), solved.b(0.0)), atol=1e-7)
    one = optimize(LinearContinuousSystem(A, B), cost, **start, free_start=["x[1]"])
    assert one.x[0, 0] == pytest.approx(0.0, abs=1e-14)
    assert one.x[0, 1] == pytest.approx(-solved.b(0.0)[1] / solved.P(0.0)[1, 1], abs=1e-7)
    with pytest.raises(ArgumentError, match=r"x\[1\]"):
        optimize(LinearContinuousSystem(A, B), cost, **start, free_start=["x[7]"])


# ---- Mechanisms --------------------------------------------------------------------------------------


def swing(t):
    return [0.0, 0.5 * (1.0 - np.cos(2.0 * np.pi * t)), 0.0, 0.0]


TRACKING = ContinuousQuadraticCost(swing, [0.0], Q=[0.01, 100.0, 0.0, 0.0], R=[0.01])
CART = MechanismSystem(cart_pendulum())
REST = {"initial": (np.zeros(4), [0.0]), "horizon": (0.0, 1.0)}


def discrete_cost(limits, N):
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), np.linspace(0.0, 1.0, N + 1))
    reference = np.stack([swing(t) for t in system.t])
    Q = np.full((N, 4), 1.0 / N) * np.array([0.01, 100.0, 0.0, 0.0])
    Q[0] *= 0.5
    cost = QuadraticCost(reference, np.zeros((N, 1)), Q=Q, R=np.array([0.01 / N]), Q_final=0.5 * Q[-1])
    result = optimize(system, cost, limits=limits, initial=(np.zeros((N + 1, 4)), np.zeros((N, 1))))
    assert result.success
    return result.cost


@pytest.mark.parametrize(
    ("limits", "same"),
    [
        ([Bound("x-force", -30.0, 30.0)], None),
        ([Equal("theta", 0.9, at=0.5)], None),
        ([Equal(["x", "theta"]), Equal("*", of="rate")], [Equal(["x", "theta"]), Equal("*", of="momentum")]),
    ],
)
def test_discrete_time_tends_to_it_by_the_square_of_its_step(limits, same):
    result = optimize(CART, TRACKING, **REST, limits=limits, **ROUGHLY)
    assert result.success, result.message
    assert result.limits.excess < 1e-5
    coarse, fine = (discrete_cost(same or limits, N) for N in (40, 80))
    assert abs(fine - result.cost) < 0.4 * abs(coarse - result.cost)
    # Richardson's extrapolation of the two.
    assert result.cost == pytest.approx(fine + (fine - coarse) / 3.0, rel=5e-4)


def test_frames_keep_clear_of_a_moving_ball():
    limits = [Keep("bob", outside=Ball(lambda t: (0.02 * t - 0.4, -1.0, 0.0), 0.2))]
    result = optimize(CART, TRACKING, **REST, limits=limits, **ROUGHLY)
    assert result.success, result.message
    t = np.linspace(0.0, 1.0, 501)
    place = CART.mechanism.positions(np.ascontiguousarray(result.dense.x(t)[:, :2]), ["bob"])[:, 0]
    away = np.linalg.norm(place - np.stack([0.02 * t - 0.4, np.full(501, -1.0), np.zeros(501)], axis=1), axis=1)
    # Met at the points of the pieces, and grazed: without the limit it comes to 0.1 m.
    assert 0.2 - 1e-4 < away.min() < 0.2 + 1e-4
    assert result.limits.labels == ("bob not within 0.2 m of a moving point",)


def test_accelerations_and_multipliers_have_exact_derivatives(rng):
    pendulum = Mechanism(
        [ty("cart", mass=10.0), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]],
        [Gravity((0.0, 0.0, -9.8)), JointForce("cart", input="push")],
    )
    system = MechanismSystem(pendulum)
    quantity = system.quantity("acceleration", np.zeros(4))
    x, u = rng.normal(size=(4, 4)), rng.normal(size=(4, 1))
    nothing = np.empty((4, 0))

    def at(z):
        return Samples(np.arange(4), np.ascontiguousarray(z[:, :4]), np.ascontiguousarray(z[:, 4:]), nothing)

    z, y, h = np.hstack([x, u]), rng.normal(size=(4, 2)), 1e-6
    J, H = quantity.jacobian(at(z)), quantity.curvature(at(z), y)
    for i in range(5):
        e = h * np.eye(5)[i]
        np.testing.assert_allclose(
            J[:, :, i], (quantity.values(at(z + e)) - quantity.values(at(z - e))) / (2 * h), atol=1e-7
        )
        slopes = (quantity.jacobian(at(z + e)) - quantity.jacobian(at(z - e))) / (2 * h)
        np.testing.assert_allclose(H[:, i], np.einsum("nm,nmi->ni", y, slopes), atol=1e-6)


# ---- Going on, and what is told -------------------------------------------------------------------------


def test_a_run_goes_on_with_its_duals(bounded):
    cost, start, limits, whole = bounded
    part = optimize(MASS, cost, **start, limits=limits, **ROUGHLY, max_iterations=whole.iterations - 3)
    assert part.status is Status.ITERATION_LIMIT
    kept = pickle.loads(pickle.dumps(part))
    rest = optimize(MASS, cost, limits=limits, resume=kept, **ROUGHLY)
    assert rest.success
    assert rest.cost == pytest.approx(whole.cost, rel=1e-7)
    assert rest.iterations <= whole.iterations + 6
    again = optimize(MASS, cost, limits=limits, initial=whole, **ROUGHLY)
    assert again.iterations <= whole.iterations
    assert again.cost == pytest.approx(whole.cost, rel=1e-7)
    with pytest.raises(ArgumentError, match="resume: got a result with the limits"):
        optimize(MASS, cost, limits=[Bound("u[0]", -0.1, 0.5)], resume=kept, **ROUGHLY)


def test_limits_over_time_can_be_drawn(bounded):
    result = bounded[3]
    figure = plot_limits(result)
    assert len(figure.axes) == 4
    assert "u[0] <= 0.5" in str(result.limits)


def test_limits_that_contradict_each_other_are_named():
    limits = [Bound("u[0]", -1.0, 1.0), Equal("x[0]", 5.0)]
    result = optimize(MASS, EFFORT, initial=([0.0, 0.0], [0.1]), horizon=(0.0, 1.0), limits=limits, **ROUGHLY)
    assert result.status is Status.INFEASIBLE, result.message
    assert "'x[0] = 5' by 4.5" in result.message
    assert "t = 1 s" in result.message
    assert "'u[0] <= 1'" in result.message


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ([Bound("u[1]", -1.0, 1.0)], ("u[0]",)),
        ([Bound("u[0]", 1.0, -1.0)], ("min 1", "max -1", "'u[0]' at t = 0.0")),
        ([Bound("u[0]")], ("neither min nor max",)),
        ([Bound("x[0]", 1.0, of="rate")], ("of='rate'", "'state'")),
        ([Bound("x[0]", np.nan)], ("NaN",)),
        ([Bound("x[0]", np.zeros(7))], ("(7,)",)),
        ([Bound("x[0]", max=lambda t: [1.0, t])], ("2)", "1)")),
        ([Bound("x[0]", 0.0, at=0.0)], ("initial state is fixed",)),
        ([Bound("x[0]", 0.0, at=3.5)], ("3.5", "from 0 to 3 s")),
        ([Bound("x[0]", 0.0, at="middle")], ("'middle'", "'end'")),
        ([Periodic("*")], ("Periodic", "fixed initial state", "Equal")),
        ([3], ("limits[0]", "int")),
        ([Within(FunctionQuantity("f", lambda x: x))], ("'f'",)),
        ([Within(FunctionQuantity("f", lambda x: np.abs(x[:, 0])))], ("complex",)),
        ([Keep("bob", outside=Ball((0.0, 0.0, 0.0), 0.1))], ("LinearContinuousSystem", "MechanismSystem")),
    ],
)  # fmt: skip
def test_wrong_limits_are_named(limits, words, bounded):
    cost, start, _, _ = bounded
    with pytest.raises(ArgumentError) as caught:
        optimize(MASS, cost, **start, limits=limits, **ROUGHLY)
    for word in words:
        assert word in str(caught.value)


def test_stiff_conditions_that_drown_the_rest_of_the_curvature_make_no_saddle():
    # Four equations at the end beside six inputs of the last piece, of a small price: the model is lost in rounding.
    arm = Mechanism(
        [ry("shoulder"), [tz(-0.5, mass=1.0), [ry("elbow"), [tz(-0.5, mass=0.5)]]]],
        [Gravity((0.0, 0.0, -9.81)), JointForce("shoulder", input="upper"), JointForce("elbow", input="lower")],
    )
    wanted, rest = np.array([1.0, 0.5, 0.0, 0.0]), {"initial": (np.zeros(4), np.zeros(2)), "horizon": (0.0, 1.5)}
    cost = ContinuousQuadraticCost(wanted, np.zeros(2), Q=[1.0, 1.0, 0.01, 0.01], R=[0.01, 0.01])
    limits = [Bound("upper", -8.0, 8.0), Bound("lower", -3.0, 3.0), Equal("*", wanted, of="state")]
    result = optimize(MechanismSystem(arm), cost, **rest, limits=limits, accuracy=Accuracy(rtol=0.09))
    assert result.status is Status.CONVERGED, result.message
    np.testing.assert_allclose(result.x[-1], wanted, atol=1e-9)
    # Where no model is left, steepest descent is no way on: it gained 1e-13 in hundreds of roll-outs.
    assert result.rollouts < 20


def test_strings_that_hang_still_pull_by_the_weight() -> None:
    """One of a given length, one whose length is prescribed, and a constraint that is no string."""
    m = Mechanism(
        [tx("a"), [tz("c"), [tz(0.0, name="A", mass=1.0)]], tx("b"), [tz("d"), [tz(0.0, name="B", mass=2.0)]],
         tz("e", mass=1.0, name="C")],
        [Gravity(), PointOnPlane("world", "C", name="floor"), Distance("A", "world", 1.2, name="short"),
         Distance("B", "world", "L", name="long")],
    )  # fmt: skip
    x = np.zeros((2, 2 * m.nq))
    x[:, : m.nq] = m.configuration({"c": -1.2, "d": -1.5, "L": 1.5})
    quantity = MechanismSystem(m).quantity("tension", np.zeros(2))
    assert quantity.names == ("short", "long")
    found = quantity.values(Samples(np.arange(2), x, np.zeros((2, m.nrho)), x))
    np.testing.assert_allclose(found, np.tile([9.81, 2.0 * 9.81], (2, 1)), rtol=1e-9)


# ---- Inside ----------------------------------------------------------------------------------------


def test_pieces_of_a_mesh_have_exact_derivatives(rng):
    mesh = RadauMesh(np.array([0.0, 0.1, 0.25, 0.3]))
    system = CollocationSystem(CART, mesh)
    cost = AnyCollocationCost(TRACKING, mesh, system.layout)
    u = 5.0 * rng.normal(size=(3, system.nu))
    x = rolled_out(system, np.zeros(system.nx), u).x
    report = check_derivatives(system, x, u, cost=cost)
    assert report.ok, str(report)
    # With rows of their own for state and input, from the implicit function theorem: against differences of the step.
    A, B = system.derivatives(x[1], u[1], 1)
    h = 1e-6
    for i in range(system.nu):
        e = h * np.eye(system.nu)[i]
        d = (system.f(x[1], u[1] + e, 1) - system.f(x[1], u[1] - e, 1)) / (2.0 * h)
        np.testing.assert_allclose(B[:, i], d, atol=1e-8)
    for i in range(4):
        e = h * np.eye(system.nx)[i]
        d = (system.f(x[1] + e, u[1], 1) - system.f(x[1] - e, u[1], 1)) / (2.0 * h)
        np.testing.assert_allclose(A[:, i], d, atol=1e-7)


def test_a_piece_is_a_step_of_order_five():
    whole = solve_ivp(lambda t, x: CART.f(x, np.array([np.sin(5.0 * t)]), t), (0.0, 0.8), [0.1, 0.4, 0.0, 0.3],
                      method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]  # fmt: skip
    errors = []
    for pieces in (4, 8, 16):
        mesh = RadauMesh(np.linspace(0.0, 0.8, pieces + 1))
        system = CollocationSystem(CART, mesh)
        u = np.sin(5.0 * mesh.t)
        x0 = np.zeros(system.nx)
        x0[:4] = [0.1, 0.4, 0.0, 0.3]
        run = rolled_out(system, x0, u)
        errors.append(np.abs(run.x[-1, :4] - whole).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 4.5).all(), (errors, orders)


class _OwnRates(MechanismSystem):
    """A mechanism whose rates are stated anew: pieces are not simulated in the core."""

    def rates(self, x, u, t):
        return super().rates(x, u, t)


def _four_bar():
    """A closed linkage on a slide whose place is prescribed, with a spring, friction and a motor."""
    tree = world().ty("slide", kinematic=True)
    tree.rx("a").tz(-1.0, mass=1.0).rx("b").tz(-1.2, name="pin", mass=0.5)
    tree.ty(1.0).rx("c").tz(-1.1, name="end", mass=0.8)
    m = Mechanism(
        tree,
        [
            Gravity(),
            Damping(0.1),
            JointSpring("b", 2.0),
            JointForce("a", input="motor"),
            PointToPoint("pin", "end", "yz"),
        ],
    )
    return m, project_configuration(m, m.configuration({"a": 0.3, "b": 0.8, "c": -0.2})).q


@pytest.mark.parametrize("which", ["cart", "linkage"])
def test_pieces_are_simulated_in_the_core_as_in_python(which, rng):
    """Under a feedback, from a reference that is off, with constraints and prescribed variables."""
    m, q = (cart_pendulum(), np.zeros(2)) if which == "cart" else _four_bar()
    mesh = RadauMesh(np.array([0.0, 0.1, 0.25, 0.3, 0.45]))
    native, plain = (CollocationSystem(kind(m), mesh) for kind in (MechanismSystem, _OwnRates))
    u = rng.normal(size=(mesh.N, native.nu))
    start = np.zeros(native.nx)
    start[: m.nq] = q
    K = 0.1 * rng.normal(size=(mesh.N, native.nu, native.nx))
    along = np.tile(start, (mesh.N + 1, 1))
    for _ in range(2):  # along a curve that is none of its motions, and along one of them
        runs = [system.rollout(start, along, u, K, 0, mesh.N) for system in (native, plain)]
        assert runs[0].complete
        np.testing.assert_allclose(runs[0].x, runs[1].x, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(runs[0].u, runs[1].u, rtol=1e-10, atol=1e-10)
        along = runs[1].x + 1e-2 * rng.normal(size=along.shape)
    later = native.rollout(runs[1].x[2], along, u, K, 2, 4), plain.rollout(runs[1].x[2], along, u, K, 2, 4)
    np.testing.assert_allclose(later[0].x, later[1].x, rtol=1e-10, atol=1e-10)


def test_a_piece_that_has_no_solution_ends_a_roll_out_alike_in_the_core():
    mesh = RadauMesh(np.array([0.0, 0.1, 0.2, 0.3, 0.4]))
    m = cart_pendulum()
    native, plain = (CollocationSystem(kind(m), mesh) for kind in (MechanismSystem, _OwnRates))
    u, start = np.full((4, native.nu), 50.0), np.zeros(native.nx)
    K, along = np.zeros((4, native.nu, native.nx)), np.zeros((5, native.nx))
    u[2] = 1e200
    runs = [system.rollout(start, along, u, K, 0, 4) for system in (native, plain)]
    assert runs[0].steps_done == runs[1].steps_done == 2
    assert str(runs[0].failure) == str(runs[1].failure)


@pytest.mark.parametrize("given", ["constant", "over time"])
def test_a_quadratic_cost_on_a_mesh_is_looked_up_once(given, rng):
    mesh = RadauMesh(np.array([0.0, 0.3, 0.5, 1.1]))
    system = CollocationSystem(MechanismSystem(cart_pendulum()), mesh)
    if given == "constant":
        own = ContinuousQuadraticCost([1.0, 2.0, 0.0, 0.5], [0.3], Q=[1.0, 0.0, 2.0, 3.0], R=[0.5], Q_final=np.eye(4))
    else:
        own = ContinuousQuadraticCost(
            lambda t: [t, np.sin(t), 1.0, 0.0], lambda t: [t], Q=lambda t: [1.0, t, 2.0, 0.0], R=lambda t: [1.0 + t],
            Q_final=[4.0, 3.0, 2.0, 1.0], x_final=[1.0, 1.0, 0.0, 2.0],
        )  # fmt: skip
    fast, slow = collocation_cost(own, mesh, system.layout), AnyCollocationCost(own, mesh, system.layout)
    assert type(fast) is QuadraticCollocationCost
    x, u = rng.normal(size=(4, system.nx)), rng.normal(size=(3, system.nu))
    for start in (0, 1):
        np.testing.assert_allclose(
            fast.stage_values(x[start:3], u[start:], start), slow.stage_values(x[start:3], u[start:], start), rtol=1e-13
        )
    assert fast.final_value(x[-1]) == pytest.approx(slow.final_value(x[-1]), rel=1e-13)
    for one, other in zip(fast.gradient(x, u), slow.gradient(x, u), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)
    Q, R, S, Q_final = fast.hessian(x, u)
    wanted = slow.hessian(x, u)
    np.testing.assert_allclose(matrix_of(Q), wanted.Q, atol=1e-13)
    np.testing.assert_allclose(R, wanted.R)
    assert S is wanted.S is None
    np.testing.assert_allclose(Q_final, wanted.Q_final, atol=1e-13)


@pytest.mark.parametrize("reference", ["near", "far", "without derivatives"])
def test_pieces_are_simulated_with_matrices_of_the_curve_that_is_followed(reference, rng, monkeypatch):
    mesh = RadauMesh(np.linspace(0.0, 0.9, 7))
    cart = _OwnRates(cart_pendulum())
    system = CollocationSystem(cart, mesh)
    u, nothing = 5.0 * rng.normal(size=(6, system.nu)), np.zeros((6, system.nu, system.nx))
    along = system.rollout(np.zeros(system.nx), np.zeros((7, system.nx)), u, nothing, 0, 6).x
    if reference == "far":
        along[:, :12] += rng.normal(size=(7, 12))
    asked, linearize = [], cart.linearize

    def counted(x, u, t):
        asked.append(len(x))
        if reference == "without derivatives" and len(x) > STAGES:
            raise ArithmeticError("none of a curve")
        return linearize(x, u, t)

    monkeypatch.setattr(cart, "linearize", counted)
    u += 1e-4 * rng.normal(size=u.shape)
    run = system.rollout(np.zeros(system.nx), along, u, nothing, 0, 6)
    assert run.complete
    if reference == "near":
        assert asked == [6 * STAGES]  # of all pieces at once, and no more
    x = np.zeros(system.nx)
    for k in range(6):
        x = system.f(x, u[k], k)
        np.testing.assert_allclose(run.x[k + 1], x, rtol=1e-11, atol=1e-11)


def test_limits_stand_at_every_point_once():
    mesh = RadauMesh(np.array([0.0, 0.2, 0.5, 1.0]))
    limits = [Bound("x[0]", max=lambda t: 1.0 + t), Bound("u[0]", -1.0), Equal("x[1]", 0.3, at=0.5)]
    along, pushed, at, negative = stated(limits, MASS, mesh, 1)
    points = Points(MASS, mesh)
    assert sorted(np.concatenate(along.points)) == list(range(1, 10)) == sorted(np.concatenate(pushed.points))
    for rows, k in zip(along.rows, along.points, strict=True):
        np.testing.assert_allclose(rows.bounds[:, 0], 1.0 + points.t[k])
    assert along.along
    assert not at.along
    assert [list(k) for k in at.points] == [[6]] == [list(k) for k in negative.points]


def test_a_start_too_violent_for_long_pieces_gets_shorter_ones():
    fast = LinearContinuousSystem([[0.0, 1.0], [60.0, 0.0]], [[0.0], [1.0]])
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 0.1], R=[1e-4], Q_final=[10.0, 1.0])
    result = optimize(fast, cost, initial=([0.01, 0.0], [0.0]), horizon=(0.0, 1.0), limits=[Bound("u[0]", -0.9, 0.9)])
    assert result.success, result.message
    free = optimize(fast, cost, initial=([0.01, 0.0], [0.0]), horizon=(0.0, 1.0))
    assert free.u.min() < -0.9
    assert result.cost > free.cost
    assert np.abs(result.u[1:]).max() <= 0.9 + 1e-9


# ---- Without limits ------------------------------------------------------------------------------------


def test_a_problem_without_limits_is_put_on_a_mesh_too(monkeypatch):
    system = FunctionContinuousSystem(
        lambda x, u, t: np.array([x[1], u[0] - 9.0 * np.sin(x[0])]),
        nx=2,
        nu=1,
        derivatives=lambda x, u, t: (np.array([[0.0, 1.0], [-9.0 * np.cos(x[0]), 0.0]]), np.array([[0.0], [1.0]])),
        curvature=lambda x, u, t, z: np.diag([9.0 * np.sin(x[0]) * z[1], 0.0, 0.0]),
    )
    cost = ContinuousQuadraticCost(lambda t: [np.sin(t), 0.0], [0.0], Q=[10.0, 0.1], R=[0.1], Q_final=[1.0, 1.0])
    start = {"initial": ([0.5, 0.0], [0.0]), "horizon": (0.0, 3.0), "tolerance": 1e-12}
    along = optimize(system, cost, **start, collocate=False)
    # Nothing is integrated in time, and no Riccati equation solved, but the first trajectory of an initial state.
    monkeypatch.setattr(ContinuousModels, "_solve", None)
    result = optimize(system, cost, **start)
    assert result.success
    assert result.limits is None
    assert result.cost == pytest.approx(along.cost, rel=1e-8)
    t = np.linspace(0.0, 3.0, 50)
    for found, wanted, atol in zip(result.dense.sample(t), along.dense.sample(t), (1e-5, 1e-3), strict=True):
        np.testing.assert_allclose(found, wanted, atol=atol)
    # The gains about it are those of the cost's own regulator.
    wanted = regulate_continuous(
        lambda t: system.derivatives(result.dense.x(t), None, t)[0], np.array([[0.0], [1.0]]),
        horizon=(0.0, 3.0), Q=[10.0, 0.1], R=[0.1], Q_final=[1.0, 1.0],
    )  # fmt: skip
    np.testing.assert_allclose(result.feedback(t), wanted(t), atol=5e-3)


def test_blas_has_one_thread_on_a_mesh_and_its_own_afterwards(bounded):
    cost, start, limits, _ = bounded
    seen = []

    def threads():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        before = threads()
        optimize(MASS, cost, **start, limits=limits, max_iterations=2, callback=lambda _: seen.extend(threads()))
        assert set(seen) <= {1}
        assert threads() == before


def test_only_continuous_problems_are_put_on_a_mesh():
    system = MidpointSystem(MidpointVI(cart_pendulum()), np.linspace(0.0, 0.1, 11))
    cost = QuadraticCost(np.zeros((11, system.nx)), np.zeros((10, 1)), Q=np.ones(system.nx), R=[1.0])
    with pytest.raises(
        ArgumentError, match=r"collocate: got False, expected True: MidpointSystem is a discrete system"
    ):
        optimize(system, cost, initial=(np.zeros(system.nx), np.zeros((10, 1))), collocate=False)


def test_rates_and_costs_of_many_samples_are_those_of_each(rng):
    m = cart_pendulum()
    system = MechanismSystem(m)
    x, u, t = rng.normal(size=(20, system.nx)), rng.normal(size=(20, system.nu)), np.linspace(0.0, 1.0, 20)
    one_by_one = [system.f(*at) for at in zip(x, u, t, strict=True)]
    np.testing.assert_array_equal(system.rates(x, u, t), one_by_one)
    np.testing.assert_array_equal(MASS.rates(x[:, :2], u, t), [MASS.f(*at) for at in zip(x[:, :2], u, t, strict=True)])
    cost = ContinuousQuadraticCost(
        lambda t: np.full(system.nx, np.sin(t)), np.zeros(system.nu),
        Q=lambda t: np.full(system.nx, 1.0 + t), R=np.eye(system.nu) + 0.1,
    )  # fmt: skip
    np.testing.assert_allclose(cost.rates(x, u, t), [cost.rate(*at) for at in zip(x, u, t, strict=True)], rtol=1e-13)


def test_a_way_around_is_found_from_the_saddle_in_front_of_it() -> None:
    # Nothing bends but the limit: by symmetry the way to the other side leads no further than to the ball.
    m = Mechanism([tx("x"), [ty("y", name="bob", mass=1.0)]], [JointForce("x", "push-x"), JointForce("y", "push-y")])
    cost = ContinuousQuadraticCost(
        np.zeros(4),
        np.zeros(2),
        Q=np.full(4, 1e-6),
        R=np.ones(2),
        Q_final=np.full(4, 100.0),
        x_final=[1.0, 0.0, 0.0, 0.0],
    )
    result = optimize(
        MechanismSystem(m),
        cost,
        initial=(np.array([-1.0, 0.0, 0.0, 0.0]), np.zeros(2)),
        horizon=(0.0, 1.0),
        limits=[Keep("bob", outside=Ball((0.0, 0.0, 0.0), 0.3))],
        tolerance=1e-4,
        accuracy=Accuracy(rtol=1e-3),
    )
    assert result.status is Status.CONVERGED, result.message
    x, _ = result.dense.sample(np.linspace(0.0, 1.0, 101))
    assert np.hypot(x[:, 0], x[:, 1]).min() > 0.29
    assert np.abs(x[:, 1]).max() > 0.25
    assert x[-1, 0] > 0.7
