"""Forces at the instants: strings by tensions make the motions of strings by lengths, with exact derivatives."""

from __future__ import annotations

import pickle
from typing import get_args

import numpy as np
import pytest

from leastaction import (
    Damping,
    Distance,
    ExpressionForce,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    TendonForce,
    ball,
    optimize,
    rx,
    ry,
    tx,
    ty,
    tz,
)  # fmt: skip
from leastaction.errors import ArgumentError
from leastaction.mechanics import expressions as ex
from leastaction.mechanics.discrete.midpoint import Split
from leastaction.mechanics.mechanism.turns import moved
from leastaction.optimal import (
    Bound,
    Parameter,
    PricedLimit,
    PricedLimits,
    QuadraticCost,
    Status,
    check_derivatives,
)
from leastaction.optimal.system import FINAL_TIME
from leastaction.systems import PulledSystem
from optimal.systems import rolled_out

ARM = [
    tz(1.0), [rx("a"), [ry("b"), [tz(-0.4, name="elbow", mass=0.5, inertia=(0.02, 0.02, 0.01)), [
        rx("c"), [tz(-0.3, name="hand", mass=0.3, inertia=(0.01, 0.01, 0.01))],
    ]]]],
    tz(2.0), [tx("x1", kinematic=True), [ty("y1", name="end1", kinematic=True)]],
    tz(2.0), [tx("x2", kinematic=True), [ty("y2", name="end2", kinematic=True)]],
]  # fmt: skip
ENDS = ["x1", "y1", "x2", "y2"]
T = np.linspace(0.0, 0.3, 31)


def by_tension() -> PulledSystem:
    arm = Mechanism(
        ARM,
        [
            Gravity((0.0, 0.0, -9.8)),
            TendonForce(("elbow", "end1"), "T1"),
            JointForce("c", "motor"),
            TendonForce(("hand", "end2"), "T2"),
        ],
        kinematic=ENDS,
    )
    return PulledSystem(MidpointVI(arm), T, at_instants=["T1", "T2"])


def pulled() -> tuple[PulledSystem, np.ndarray, np.ndarray]:
    """A motion by tensions: (system, x, u)."""
    system = by_tension()
    rng = np.random.default_rng(5)
    x0 = np.array([0.3, 0.2, 0.4, 0.0, 0.1, 0.1, 0.3, *np.zeros(7)])
    u = np.zeros((30, 7))
    u[:, [0, 2]] = rng.uniform(3.0, 5.0, size=(30, 2))
    u[:, 3:] = x0[3:7] + 0.02 * np.sin(4.0 * T[1:, None] + np.arange(4))
    done = system.rollout(x0, np.zeros((31, 14)), u, np.zeros((30, 7, 14)), 0, 30)
    assert done.complete
    assert done.worst_step is not None
    return system, done.x, u


def test_the_same_motion_with_lengths_as_constraints() -> None:
    _, x, u = pulled()
    arm = Mechanism(
        ARM,
        [
            Gravity((0.0, 0.0, -9.8)),
            Distance("elbow", "end1", "L1", name="one"),
            Distance("hand", "end2", "L2", name="two"),
        ],
        kinematic=[*ENDS, "L1", "L2"],
    )
    q = np.hstack([x[:, :7], np.zeros((31, 2))])
    lengths = np.stack(
        [
            np.linalg.norm(arm.positions(q, [a])[:, 0] - arm.positions(q, [b])[:, 0], axis=1)
            for a, b in (("elbow", "end1"), ("hand", "end2"))
        ],
        axis=1,
    )
    q[:, 7:] = lengths
    integrator = MidpointVI(arm)
    run = integrator.simulate(integrator.start(q[0]), T, rho=q[:, 3:])
    np.testing.assert_allclose(run.q, q, atol=1e-9)
    np.testing.assert_allclose(run.p[1:], x[1:, 7:10], atol=1e-9)
    share = np.diff(T)
    share[0] *= 0.5
    np.testing.assert_allclose(run.lam, share[:, None] * u[:, [0, 2]] / (2.0 * lengths[:-1]), atol=1e-9)


@pytest.mark.parametrize("k", [0, 7])
def test_derivatives(k: int) -> None:
    """Against central differences of what is exact to rounding."""
    system, x, u = pulled()
    h = 1e-5
    nx = system.nx
    z = np.random.default_rng(k).normal(size=nx)
    whole = system.linearize(x, u)
    A, B = system.derivatives(x[k], u[k], k)
    np.testing.assert_allclose(whole.A[k], A, atol=1e-12)
    np.testing.assert_allclose(whole.B[k], B, atol=1e-12)

    def at(y: np.ndarray) -> np.ndarray:
        return system.f(y[:nx], y[nx:], k)

    def slope(y: np.ndarray) -> np.ndarray:
        A, B = system.derivatives(y[:nx], y[nx:], k)
        return np.concatenate([z @ A, z @ B])

    y = np.concatenate([x[k], u[k]])
    steps = h * np.eye(len(y))
    first = np.stack([(at(y + e) - at(y - e)) / (2.0 * h) for e in steps], axis=1)
    np.testing.assert_allclose(np.hstack([A, B]), first, atol=1e-7)
    second = np.stack([(slope(y + e) - slope(y - e)) / (2.0 * h) for e in steps], axis=1)
    H = system.curvature(x[k], u[k], k, z)
    np.testing.assert_allclose(H, second, atol=1e-6)
    weights = np.zeros((31, nx))
    weights[k + 1] = z
    np.testing.assert_allclose(whole.curvature(weights)[k], H, atol=1e-12)


def turning() -> tuple[PulledSystem, np.ndarray, np.ndarray]:
    """A motion by tensions of an arm whose shoulder is a ball joint: (system, x, u)."""
    shoulder = [tz(1.0), [ball("s"), ARM[1][1][1]], *ARM[2:]]
    elements = [Gravity((0.0, 0.0, -9.8)), JointForce("s.wy", "motor")]
    pulls = [TendonForce(("elbow", "end1"), "T1"), TendonForce(("hand", "end2"), "T2")]
    m = Mechanism(shoulder, [*elements, *pulls], kinematic=ENDS)
    system = PulledSystem(MidpointVI(m), T, at_instants=["T1", "T2"])
    q = m.configuration({"c": 0.4, "y1": 0.1, "x2": 0.1, "y2": 0.3})
    q = moved(m, q[None], np.array([[0.5, -0.4, 0.7, *np.zeros(5)]]))[0]
    u = np.zeros((30, system.nu))
    u[:, 1:3] = np.random.default_rng(5).uniform(3.0, 5.0, size=(30, 2))
    u[:, 3:] = q[m.first_rho :] + 0.02 * np.sin(4.0 * T[1:, None] + np.arange(4))
    x = np.concatenate([q, np.zeros(m.nv)])
    done = system.rollout(x, np.tile(x, (31, 1)), u, np.zeros((30, system.nu, system.ndx)), 0, 30)
    assert done.complete
    return system, done.x, u


def test_a_ball_joint_moves_as_with_lengths_as_constraints() -> None:
    system, x, _ = turning()
    by = system.mechanism
    lengths = [Distance("elbow", "end1", "L1", name="one"), Distance("hand", "end2", "L2", name="two")]
    arm = Mechanism(
        [tz(1.0), [ball("s"), ARM[1][1][1]], *ARM[2:]],
        [Gravity((0.0, 0.0, -9.8)), *lengths],
        kinematic=[*ENDS, "L1", "L2"],
    )
    q = np.hstack([x[:, : by.nq], np.zeros((31, 2))])
    q[:, -2:] = np.stack(
        [
            np.linalg.norm(np.diff(arm.positions(q, ends), axis=1)[:, 0], axis=1)
            for ends in (("elbow", "end1"), ("hand", "end2"))
        ],
        axis=1,
    )
    integrator = MidpointVI(arm)
    run = integrator.simulate(integrator.start(q[0]), T, rho=q[:, arm.first_rho :])
    np.testing.assert_allclose(run.q, q, atol=1e-11)
    np.testing.assert_allclose(run.p[1:], x[1:, by.nq : by.nq + by.nd], atol=1e-11)


def test_derivatives_of_a_ball_joint_under_tensions() -> None:
    """First and second ones, and those of prices of limits, which are by directions too."""
    system, x, u = turning()
    report = check_derivatives(system, x, u)
    assert report.ok, report
    wanted = QuadraticCost(x[-1], u[0], Q=np.ones(system.ndx), R=np.ones(system.nu), space=system)
    limits = [Bound("c", 0.0, 0.1), Bound("s.qy", -0.1, 0.1), Bound("x1", -1.0, 1.0, of="acceleration")]
    prices = PricedLimits(wanted.over(30), system, [PricedLimit(each, 3.0) for each in limits])
    slopes = prices.gradient(x, u)
    rng = np.random.default_rng(3)
    dx, du = 1e-6 * rng.normal(size=(31, system.ndx)), 1e-6 * rng.normal(size=u.shape)
    change = prices.value(system.plus(x, dx), u + du) - prices.value(system.plus(x, -dx), u - du)
    expected = 2.0 * (np.sum(slopes.q * dx[:-1]) + np.sum(slopes.r * du) + slopes.q_final @ dx[-1])
    assert prices.value(x, u) > 1.01 * wanted.over(30).value(x, u)
    assert change == pytest.approx(expected, rel=1e-6)
    assert prices.convex_hessian(x, u).Q.shape == (30, system.ndx, system.ndx)


def test_prices_of_inputs_and_states_beside_rotations() -> None:
    """And what depends on the next state has none, by name."""
    joints = [ball("hip"), [tz(-0.5, mass=1.0, inertia=(0.1, 0.1, 0.05))]]
    m = Mechanism(joints, [JointForce("hip.wx", input="torque")])
    vi = MidpointVI(m)
    system = MidpointSystem(vi, 0.02 * np.arange(11))
    run = vi.simulate(vi.start({}, {"hip.wx": 2.0, "hip.wy": 1.0}), system.t, inputs=[1.5])
    cost = QuadraticCost(run.x[0], [0.0], Q=np.ones(6), R=[1.0], space=system).over(10)
    limits = [Bound("torque", -1.0, 1.0), Bound("p_hip.wx", -0.1, 0.1)]
    prices = PricedLimits(cost, system, [PricedLimit(each, 3.0) for each in limits])
    slopes = prices.gradient(run.x, run.u)
    rng = np.random.default_rng(3)
    dx, du = 1e-6 * rng.normal(size=(11, 6)), 1e-6 * rng.normal(size=(10, 1))
    change = prices.value(system.plus(run.x, dx), run.u + du) - prices.value(system.plus(run.x, -dx), run.u - du)
    expected = 2.0 * (np.sum(slopes.q * dx[:-1]) + np.sum(slopes.r * du) + slopes.q_final @ dx[-1])
    assert change == pytest.approx(expected, rel=1e-6)
    with pytest.raises(ArgumentError, match=r"rate of hip.wx depends on the state that a step leads to"):
        PricedLimits(cost, system, [PricedLimit(Bound("hip.wx", -1.0, 1.0, of="rate"), 3.0)])


# ---- Parameters and time ------------------------------------------------------------------------------

ANGLE = ex.variable("c")
GRIP = ex.input_("grip") * (ex.parameter("lever", 0.3) + 0.1 * ANGLE**2) + 0.05 * ex.input_("grip") ** 2
PUSH = ex.parameter("push", 0.4) * (1.0 + ANGLE**2)


def held_by_all_kinds(split: Split) -> PulledSystem:
    """Forces at the instants of every kind, which depend on numbers, places and inputs; others act in the middle."""
    arm = Mechanism(
        ARM,
        [
            Gravity((0.0, 0.5, -9.8)),
            TendonForce(("elbow", "end1"), "T1", 1.3, name="first"),
            JointForce("a", "shoulder"),
            JointForce("c", "motor"),
            ExpressionForce(GRIP, "c", name="hold"),
            ExpressionForce(PUSH, "b", name="pushing"),
            Damping(0.1),
        ],
        kinematic=ENDS,
    )
    steps = 0.01 * (1.0 + 0.2 * np.sin(np.arange(8)))
    t = 0.5 + np.concatenate([[0.0], np.cumsum(steps)])
    return PulledSystem(MidpointVI(arm, split=split, threads=1), t, at_instants=["T1", "shoulder", "grip"])


def motion(system: PulledSystem) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    inputs = system.mechanism.n_inputs
    x0 = np.array([0.3, 0.2, 0.4, 0.0, 0.1, 0.1, 0.3, *rng.normal(size=3, scale=0.1), *np.zeros(4)])
    u = np.zeros((system.N, system.nu))
    u[:, :inputs] = rng.uniform(1.0, 3.0, size=(system.N, inputs))
    u[:, inputs:] = x0[3:7] + 0.05 * np.sin(8.0 * (system.t[1:, None] - 0.5) + np.arange(4))
    done = rolled_out(system, x0, u)
    assert done.complete
    return done.x, u


@pytest.mark.parametrize("split", get_args(Split))
def test_all_kinds_of_forces_at_the_instants(split: Split) -> None:
    """The step from its own equations: what acts at the start is added to the momentum, and nothing else is."""
    system = held_by_all_kinds(split)
    m = system.integrator.mechanism
    x, u = motion(system)
    plain = MidpointSystem(MidpointVI(m, split=split, threads=1), system.t)
    late = [m.inputs.index(name) for name in system.at_instants]
    still, nothing = np.zeros(m.nq), np.zeros(m.n_inputs)
    for k in range(system.N):
        at_start, rest, kicked = nothing.copy(), u[k].copy(), x[k].copy()
        at_start[late], rest[late] = u[k, late], 0.0
        q, share = np.ascontiguousarray(x[k, : m.nq]), np.diff(system.t)[k] * (0.5 if k == 0 else 1.0)
        # Less the force that no input makes, which acts in the middle as ever.
        force = m.core.force(q, still, at_start) - m.core.force(q, still, nothing)
        kicked[m.nq : m.nq + m.nd] += share * force[: m.nd]
        np.testing.assert_allclose(system.f(x[k], u[k], k), plain.f(kicked, rest, k), rtol=1e-12, atol=1e-13)


NAMES = ["elbow.mass", "hand.com.y", "elbow.value", "first.gain", "hold.lever", "pushing.push", "damping.b", FINAL_TIME]


@pytest.mark.parametrize("split", get_args(Split))
@pytest.mark.parametrize("start", [0, 3])
def test_derivatives_by_parameters_and_the_final_time(split: Split, start: int) -> None:
    system = held_by_all_kinds(split)
    x, u = motion(system)
    part = slice(start, None)
    found = system.differentiate_by(x[part], u[part], NAMES, start)
    z = np.random.default_rng(1).normal(size=(system.N - start, system.nx))
    second = system.curvature_by_final_time(x[part], u[part], z, start)
    for k in range(start, system.N):
        alone = system.curvature(x[k], u[k], k, z[k - start])
        np.testing.assert_allclose(second[k - start, :-1, :-1], alone, atol=1e-9 * np.abs(alone).max())
    for column, name in enumerate(NAMES):
        value = system.parameters[name]
        h = 1e-4 * max(abs(value), 0.1)

        def steps(by: float, name: str = name, value: float = value) -> np.ndarray:
            other = system.with_parameters({name: value + by})
            return np.array([other.f(x[k], u[k], k) for k in range(start, system.N)])

        wanted = (8.0 * (steps(h) - steps(-h)) - (steps(2.0 * h) - steps(-2.0 * h))) / (12.0 * h)
        np.testing.assert_allclose(found[:, :, column], wanted, atol=2e-9, err_msg=name)
    h, end = 1e-4, system.parameters[FINAL_TIME]

    def slopes(by: float) -> np.ndarray:
        other = system.with_parameters({FINAL_TIME: end + by})
        rows = []
        for k in range(start, system.N):
            A, B = other.derivatives(x[k], u[k], k)
            pair = np.stack([x[k], other.f(x[k], u[k], k)])
            by_time = other.differentiate_by(pair, u[k : k + 1], [FINAL_TIME], k)[0, :, 0]
            rows.append(np.concatenate([z[k - start] @ A, z[k - start] @ B, [z[k - start] @ by_time]]))
        return np.array(rows)

    wanted = (8.0 * (slopes(h) - slopes(-h)) - (slopes(2.0 * h) - slopes(-2.0 * h))) / (12.0 * h)
    np.testing.assert_allclose(second[:, -1], wanted, atol=1e-6 * max(1.0, np.abs(wanted).max()))


@pytest.mark.parametrize("split", get_args(Split))
def test_second_derivatives_of_all_kinds(split: Split) -> None:
    system = held_by_all_kinds(split)
    x, u = motion(system)
    z, h = np.random.default_rng(2).normal(size=system.nx), 1e-4
    for k in (0, 5):
        y = np.concatenate([x[k], u[k]])

        def slope(y: np.ndarray, k: int = k) -> np.ndarray:
            A, B = system.derivatives(y[: system.nx], y[system.nx :], k)
            return np.concatenate([z @ A, z @ B])

        columns = []
        for e in h * np.eye(len(y)):
            near, far = slope(y + e) - slope(y - e), slope(y + 2.0 * e) - slope(y - 2.0 * e)
            columns.append((8.0 * near - far) / (12.0 * h))
        wanted = np.stack(columns, axis=1)
        np.testing.assert_allclose(system.curvature(x[k], u[k], k, z), wanted, atol=1e-8 * np.abs(wanted).max())


def test_unknown_numbers_are_found_with_the_forces_at_the_instants() -> None:
    """What they would be in the middle makes another motion: the mass that made this one is found again."""
    system, x, u = pulled()
    cost = QuadraticCost(x, u, Q=np.ones(14), R=np.full(7, 1e-3))
    guess = system.with_parameters({"elbow.mass": 0.8})
    assert guess.at_instants == system.at_instants
    found = optimize(guess, cost, initial=(x, u), unknowns=[Parameter("elbow.mass", 0.1, 2.0)])
    assert found.status is Status.CONVERGED, found.message
    assert found.unknowns["elbow.mass"] == pytest.approx(0.5, abs=1e-7)


# ---- Systems made of others ---------------------------------------------------------------------------


def test_windows_and_copies_keep_what_they_are() -> None:
    system, x, u = pulled()
    z = np.random.default_rng(0).normal(size=(30, 14))
    whole = system.linearize(x, u)
    for start, stop in ((0, 9), (4, 30)):
        part = system.window(start, stop)
        assert type(part) is PulledSystem
        assert part.time(0) == system.time(start)
        own = part.linearize(x[start : stop + 1], u[start:stop])
        np.testing.assert_array_equal(own.A, whole.A[start:stop])
        np.testing.assert_array_equal(own.B, whole.B[start:stop])
        np.testing.assert_array_equal(own.curvature(z[start:stop]), whole.curvature(z)[start:stop])
        np.testing.assert_array_equal(part.f(x[start], u[start], 0), system.f(x[start], u[start], start))
    again = pickle.loads(pickle.dumps(system))
    assert (type(again), again.at_instants, again.first_share) == (PulledSystem, ("T1", "T2"), 0.5)
    np.testing.assert_array_equal(again.linearize(x, u).A, whole.A)
    # Each step from its own state, as a start with gaps asks for it.
    made = system.step_each(x, u)
    np.testing.assert_allclose(made.x, x[1:], atol=1e-11)
    each = system.linearize_each(x, u, made.x)
    np.testing.assert_allclose(each.A, whole.A, atol=1e-10)
    np.testing.assert_allclose(each.curvature(z), whole.curvature(z), atol=1e-10)
    later = system.with_parameters({FINAL_TIME: 0.6})
    assert (type(later), later.at_instants, later.first_share) == (PulledSystem, ("T1", "T2"), 0.5)
    assert later.time(30) == 0.6


def test_a_roll_out_is_that_of_single_steps_and_tells_of_failure() -> None:
    system, x, u = pulled()
    K = 0.1 * np.random.default_rng(1).normal(size=(30, 7, 14))
    fed = system.rollout(x[4] + 1e-3, x, u, K, 4, 9)
    assert fed.complete
    state = x[4] + 1e-3
    for k in range(4, 9):
        state = system.f(state, u[k] - K[k] @ (state - x[k]), k)
    np.testing.assert_allclose(fed.x[-1], state, atol=1e-12)
    wild = u.copy()
    wild[3, 0] = np.inf
    cut = system.rollout(x[0], x, wild, 0.0 * K, 0, 30)
    assert (cut.steps_done, cut.complete) == (3, False)
    assert "step 3 at t = 0.03 s" in str(cut.failure)


def test_what_it_refuses() -> None:
    arm = by_tension().integrator.mechanism
    with pytest.raises(ArgumentError, match=r"at_instants: .*T3"):
        PulledSystem(MidpointVI(arm), T, at_instants=["T3"])
    held = arm.with_elements([Distance("elbow", "hand", 0.3, name="rod")])
    with pytest.raises(ArgumentError, match="has 1 constraints, expected none"):
        PulledSystem(MidpointVI(held), T, at_instants=["T1"])
    both = arm.with_elements([ExpressionForce(ex.input_("T1") * ex.input_("more"), "c", name="mixed")])
    with pytest.raises(
        ArgumentError, match=r"at_instants: 'mixed' has the inputs \['T1'\] at the instants and \['more'\]"
    ):
        PulledSystem(MidpointVI(both), T, at_instants=["T1"])
    plain = MidpointSystem(MidpointVI(arm), T)
    assert plain.nu == by_tension().nu
