"""Constraints that move by a formula in the time: closed forms, twins, starts, conversions, optimisation."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from leastaction import (
    FinalTime,
    Gravity,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    check_consistent,
    equilibrium,
    free,
    optimize,
    project_configuration,
    project_velocity,
    rx,
    simulate,
    to_continuous,
    to_discrete,
    to_momentum,
    to_velocity,
    tx,
    ty,
    tz,
)
from leastaction.control import simulate_many
from leastaction.costs import ContinuousQuadraticCost
from leastaction.elements import ExpressionConstraint, ExpressionForce
from leastaction.errors import InconsistentStartError
from leastaction.expressions import distance, input_, parameter, point, time, variable

sympy = pytest.importorskip("sympy")

TURN = 2.0  # rad/s


def bead() -> Mechanism:
    """A bead of 1.5 kg on a straight wire that turns about the vertical."""
    angle = TURN * time()
    wire = variable("y") * sympy.cos(angle) - variable("x") * sympy.sin(angle)
    return Mechanism([tx("x"), [ty("y", mass=1.5)]], [ExpressionConstraint(wire, name="wire")])


def begun(m: Mechanism, t: float, q: list[float]) -> tuple[np.ndarray, np.ndarray]:
    now = m.at_time(t)
    place = project_configuration(now, q).q
    return place, project_velocity(now, place, np.zeros(m.nv)).v


def wire_at(t: float, r: float = 0.1) -> np.ndarray:
    return r * np.array([np.cos(TURN * t), np.sin(TURN * t)])


def test_a_bead_on_a_wire_that_turns_goes_out_as_cosh() -> None:
    m, begin = bead(), 0.5
    q, v = begun(m, begin, wire_at(begin).tolist())
    assert v == pytest.approx(0.1 * TURN * np.array([-np.sin(1.0), np.cos(1.0)]))
    t = np.linspace(begin, begin + 1.0, 51)
    far = 0.1 * np.cosh(TURN * (t - begin))
    run = simulate(m, q, v, t, rtol=1e-10, atol=1e-12)
    assert run.status.name == "COMPLETED"
    assert np.linalg.norm(run.q, axis=1) == pytest.approx(far, abs=1e-8)
    # The force of the wire, twice the mass times the turn times the speed outwards; h has a gradient of one.
    assert run.lam[:, 0] == pytest.approx(2.0 * 1.5 * TURN * 0.1 * TURN * np.sinh(TURN * (t - begin)), abs=1e-7)
    vi = MidpointVI(m)
    off = []
    for steps in (100, 200):
        found = vi.simulate(vi.start(q, v, t=begin), np.linspace(begin, begin + 1.0, steps + 1))
        assert found.status.name == "COMPLETED"
        assert found.balance.swing < 1e-2 * found.balance.scale
        off.append(np.abs(np.linalg.norm(found.q, axis=1)[:: steps // 50] - far).max())
        there = np.array([m.at_time(now).constraint_values(at)[0] for now, at in zip(found.t, found.q, strict=True)])
        assert np.abs(there).max() < 1e-12
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.05)


def test_energy_is_what_the_wire_adds() -> None:
    m = bead()
    q, v = begun(m, 0.0, [0.1, 0.0])
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(q, v), np.linspace(0.0, 1.0, 401))
    gained = run.energy().total[-1] - run.energy().total[0]
    assert gained == pytest.approx(1.5 * (TURN * 0.1 * np.sinh(TURN)) ** 2, rel=1e-2)
    assert abs(run.balance.residual).max() < 1e-3 * gained


def support(now, *, along: str = "x"):
    """The point where a pendulum hangs."""
    place = 0.3 * sympy.sin(3.0 * now) * sympy.exp(-now / 4)
    return sympy.Matrix([place, 0, 0] if along == "x" else [0, 0, place])


@pytest.mark.parametrize("quaternions", [False, True], ids=["point", "body"])
def test_a_pendulum_on_a_support_that_moves_is_that_on_a_prescribed_one(*, quaternions: bool) -> None:
    body = {"mass": 0.7, "com": (0.02, 0.0, 0.1), "inertia": (2e-2, 3e-2, 1e-2)}
    hung = free("bob", **body) if quaternions else tx("x")
    tree = [hung, [tz(0.2, name="eye")]] if quaternions else [hung, [ty("y"), [tz("z", mass=0.7, name="eye")]]]

    def mechanism(of, more: list) -> Mechanism:
        away = point("eye") - of
        rod = ExpressionConstraint(away.dot(away) - parameter("length", 0.8) ** 2, name="rod")
        pull = ExpressionForce(input_("u"), point("eye").dot(point("eye")), name="pull")
        return Mechanism([*tree, *more], [Gravity(), rod, pull])

    moving = mechanism(support(time()), [])
    twin = mechanism(point("hook"), [tx("hook", kinematic=True, name="hook")])
    t, u = np.linspace(0.2, 1.2, 51), np.linspace(-0.3, 0.4, 50)
    rho = np.array([0.3 * np.sin(3.0 * now) * np.exp(-now / 4) for now in t])
    rate = 0.3 * np.exp(-0.05) * (3.0 * np.cos(0.6) - np.sin(0.6) / 4)
    q = moving.configuration({"bob.z": -1.0, "bob.x": 0.1} if quaternions else {"z": -0.8, "x": 0.1})
    q, v = begun(moving, 0.2, q.tolist())
    vi, other = MidpointVI(moving), MidpointVI(twin)
    run = vi.simulate(vi.start(q, v, t=0.2), t, inputs=u)
    same = other.simulate(other.start(np.append(q, rho[0]), np.append(v, rate), t=0.2), t, inputs=u, rho=rho)
    assert run.status.name == same.status.name == "COMPLETED"
    assert run.q == pytest.approx(same.q[:, : moving.nq], abs=1e-10)
    assert run.lam == pytest.approx(same.lam, abs=1e-9)
    n, nq = moving.nv, moving.nv
    at = [*range(nq), *range(nq + 1, 2 * nq + 1)]
    mine, theirs = vi.linearize(run), other.linearize(same)
    np.testing.assert_allclose(mine.A, theirs.A[:, at][:, :, at], atol=1e-8)
    z = np.random.default_rng(0).normal(size=(run.steps, 2 * n))
    weights = np.zeros((run.steps, twin.ndx))
    weights[:, at] = z
    order = [*at, 2 * n + 2]
    assert vi.curvature(run, mine, z) == pytest.approx(
        other.curvature(same, theirs, weights)[:, order][:, :, order], abs=1e-5
    )


def test_starts_know_the_time() -> None:
    m = bead()
    check_consistent(m.at_time(0.5), wire_at(0.5))
    with pytest.raises(InconsistentStartError, match="'wire' is off by"):
        check_consistent(m, wire_at(0.5))
    vi = MidpointVI(m)
    with pytest.raises(InconsistentStartError, match=r"the rate of 'wire' is -0\.2"):
        vi.start(wire_at(0.5), t=0.5)
    with pytest.raises(InconsistentStartError, match=r"the rate of 'wire' is -0\.2"):
        simulate(m, wire_at(0.5), None, [0.5, 1.0])
    with pytest.raises(InconsistentStartError, match="'wire' is off by"):
        vi.start(wire_at(0.5), p=[0.0, 0.0], t=0.4)
    q, v = begun(m, 0.5, [0.1, 0.1])
    second = wire_at(0.51, float(np.linalg.norm(q)))
    state = vi.start_from_configurations(q, second, 0.01, t=0.51)
    assert state.p / 1.5 == pytest.approx((second - q) / 0.01)
    # What constraints stop is left out of a velocity, up to what they move by themselves.
    p = to_momentum(m, q, v + np.array([0.3, 0.1]))
    kept = to_velocity(m, q, p, keep_constraints=True, t=0.5)
    assert m.at_time(0.5).constraint_rates(q, kept) == pytest.approx([0.0], abs=1e-12)
    assert m.at_time(0.5).constraint_rates(q, v + np.array([0.3, 0.1]))[0] != pytest.approx(0.0, abs=1e-2)
    assert to_velocity(m.at_time(0.5), q, p, keep_constraints=True) == pytest.approx(kept)


def test_another_time_is_another_mechanism_to_ask() -> None:
    hanging = ExpressionConstraint(variable("a") + variable("b") - sympy.sin(time()), name="both")
    arm = Mechanism([rx("a", mass=1.0, com=(0, 0, -1.0)), [rx("b", mass=1.0, com=(0, 0, -1.0))]], [Gravity(), hanging])
    for t in (0.0, 0.7):
        rest = equilibrium(arm.at_time(t), [0.1, 0.1])
        assert rest.q.sum() == pytest.approx(np.sin(t), abs=1e-12)
    then = arm.at_time(0.7)
    assert then.with_parameters({"a.mass": 2.0}).constraint_values([0.0, 0.0]) == pytest.approx([-np.sin(0.7)])
    assert pickle.loads(pickle.dumps(then)).constraint_values([0.0, 0.0]) == pytest.approx([-np.sin(0.7)])
    still = Mechanism([rx("a", mass=1.0, com=(0, 0, -1.0))], [Gravity()])
    assert still.at_time(3.0) is still


def test_conversions_go_there_and_back() -> None:
    m = bead()
    q, v = begun(m, 0.5, wire_at(0.5).tolist())
    t = np.linspace(0.5, 1.5, 201)
    run = simulate(m, q, v, t, rtol=1e-10, atol=1e-12)
    made, sampled = to_discrete(run, MidpointVI(m)), to_discrete(run, MidpointVI(m), sampled=True)
    assert made.q == pytest.approx(run.q, abs=2e-4)
    assert sampled.p[1:-1] == pytest.approx(made.p[1:-1], abs=2e-3)
    back = to_continuous(made)
    assert back.v == pytest.approx(run.v, abs=3e-3)
    assert back.lam[1:-1] == pytest.approx(run.lam[1:-1], abs=5e-3)


def test_many_and_sensitivities_know_what_moves() -> None:
    length = parameter("length", 0.8) + 0.1 * sympy.sin(4.0 * time())
    rod = ExpressionConstraint(distance("bob", "hook") - length, name="rod")
    m = Mechanism([tx("x"), [tz("z", mass=0.7, name="bob")], tx(0.05, name="hook")], [Gravity(), rod])
    vi, t = MidpointVI(m), np.linspace(0.1, 0.6, 26)

    def made(of: Mechanism):
        q, v = begun(of, 0.1, [0.3, -0.7])
        return MidpointVI(of).simulate(MidpointVI(of).start(q, v, t=0.1), t), v

    run, v = made(m)
    assert run.tensions()["rod"].min() > 1.0
    states = np.array([vi.start(*begun(m, 0.1, [0.3 + 0.01 * i, -0.7]), t=0.1).x for i in range(9)])
    assert simulate_many(vi, states, t).x[0] == pytest.approx(run.x, abs=1e-10)
    found = vi.sensitivity(run, ["rod.length"], v=v, hold=[])
    h = 1e-5

    def moved(by: float):
        changed = m.with_parameters({"rod.length": 0.8 + by}).at_time(0.1)
        q = project_configuration(changed, run.q[0]).q
        return MidpointVI(changed).simulate(MidpointVI(changed).start(q, project_velocity(changed, q, v).v, t=0.1), t).x

    assert found.x[:, :, 0] == pytest.approx((moved(h) - moved(-h)) / (2 * h), abs=1e-6)


def test_they_are_steered_in_both_kinds_of_time() -> None:
    tilt = 0.4 * sympy.sin(2.0 * time())
    ramp = ExpressionConstraint(variable("z") - tilt * variable("x"), name="ramp")
    m = Mechanism([tx("x"), [tz("z", mass=1.0)]], [Gravity(), ExpressionForce(input_("u"), "x"), ramp])
    t = np.linspace(0.0, 1.0, 41)
    system = MidpointSystem(MidpointVI(m), t)
    q, v = begun(m, 0.0, [1.0, 0.0])
    u, start = np.zeros((40, 1)), system.integrator.start(q, v)
    Q, R, last = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1]), [50.0, 0.0, 0.0, 0.0]
    cost = QuadraticCost(np.zeros((41, 4)), np.zeros((40, 1)), Q=Q / 40, R=R / 40, Q_final=last)
    found = optimize(system, cost, initial=(start.x, u))
    assert found.status.name == "CONVERGED"
    there = found.trajectory
    assert abs(there["x"][-1]) < 0.2
    assert there["z"] == pytest.approx(0.4 * np.sin(2.0 * t) * there["x"], abs=1e-12)
    smooth = ContinuousQuadraticCost(np.zeros(4), np.zeros(1), Q=Q, R=R, Q_final=last)
    along = optimize(MechanismSystem(m), smooth, horizon=(0.0, 1.0), initial=(np.concatenate([q, v]), np.zeros(1)))
    assert along.status.name == "CONVERGED"
    assert along.cost == pytest.approx(found.cost, rel=4e-2)


def test_a_free_start_stays_on_what_moves() -> None:
    m = bead()
    pushed = m.with_elements([ExpressionForce(input_("u"), "x", name="push")])
    t = np.linspace(0.5, 1.0, 21)
    system = MidpointSystem(MidpointVI(pushed), t)
    q, v = begun(pushed, 0.5, wire_at(0.5).tolist())
    wanted = np.tile([0.1, 0.2, 0.0, 0.0], (21, 1))
    cost = QuadraticCost(wanted, np.zeros((20, 1)), Q=np.ones(4), R=[1.0], Q_final=np.full(4, 10.0))
    begin = system.integrator.start(q, v, t=0.5).x
    found = optimize(system, cost, initial=(begin, np.zeros((20, 1))), free_start=["x", "y"])
    assert found.status.name == "CONVERGED"
    assert abs(pushed.at_time(0.5).constraint_values(found.x[0, :2])[0]) < 1e-9
    assert np.abs(found.x[0, :2] - q).max() > 1e-3


@pytest.mark.parametrize("unknowns", [(), (FinalTime(0.9, 1.1),)], ids=["fixed", "final time"])
def test_a_free_start_in_continuous_time_is_on_what_has_moved(unknowns: tuple[FinalTime, ...]) -> None:
    pushed = bead().with_elements([ExpressionForce(input_("u"), "x", name="push")])
    q, v = begun(pushed, 0.5, wire_at(0.5).tolist())
    last = np.full(4, 10.0)
    cost = ContinuousQuadraticCost([0.1, 0.2, 0.0, 0.0], [0.0], Q=np.ones(4), R=[1.0], Q_final=last)
    begin = (np.concatenate([q, v]), np.zeros(1))
    found = optimize(
        MechanismSystem(pushed), cost, horizon=(0.5, 1.0), initial=begin, free_start=True, unknowns=unknowns
    )
    assert found.status.name == "CONVERGED"
    then, (q0, v0) = pushed.at_time(0.5), np.split(found.x[0], 2)
    assert abs(then.constraint_values(q0)[0]) < 1e-9
    assert abs(then.constraint_rates(q0, v0)[0]) < 1e-9
    assert np.abs(q0 - q).max() > 1e-3


def test_what_drives_a_prescribed_variable_is_what_a_coupling_that_moves_needs() -> None:
    tied = ExpressionConstraint(variable("x") - variable("s") - 0.1 * time() ** 2, name="tied")
    m = Mechanism([tx("x", mass=2.0), tx("s", kinematic=True)], [tied])
    vi, t = MidpointVI(m), np.linspace(0.0, 1.0, 41)
    run = vi.simulate(vi.start([0.0, 0.0], [0.0, 0.0]), t, rho=lambda now: [0.05 * now**2])
    force = vi.driving_force(run)
    assert force[:, 0] == pytest.approx(np.full(39, 2.0 * 0.3), abs=1e-9)
