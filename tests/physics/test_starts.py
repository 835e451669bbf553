"""Ways to start and to go on: they lead to the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError, InconsistentStartError
from leastaction.mechanics import (
    ExpressionForce,
    Gravity,
    Mechanism,
    MidpointVI,
    PointOnLine,
    SimulationStatus,
    project_velocity,
    tx,
    ty,
)
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.marionette import marionette, rest_pose
from physics.laws import G, complete, mass_on_string, pendulum, swing, times


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_two_configurations_are_a_start(split: str) -> None:
    m = cart_pendulum(damping=0.4)
    vi = MidpointVI(m, split=split)
    start = vi.start([0.1, 2.0], [1.0, -2.0], t=0.3)
    one = vi.step(start, 0.01, inputs=[7.0]).state
    again = vi.start_from_configurations(start.q, one.q, 0.01, inputs=[7.0], t=0.31)
    assert again.t == pytest.approx(one.t)
    assert np.array_equal(again.q, one.q)
    assert np.abs(again.p - one.p).max() < 1e-12 * np.abs(one.p).max()
    # Another input over that step is another momentum at its end, in the symmetric split.
    without = vi.start_from_configurations(start.q, one.q, 0.01)
    assert (np.abs(without.p - one.p).max() > 1e-2) == (split == "symmetric")


def test_two_configurations_on_moving_strings_are_a_start() -> None:
    m = marionette()
    vi, q, dt = MidpointVI(m), rest_pose(m), 0.01
    rho = q[m.nd :] + 1e-3
    one = vi.step(vi.start(q), dt, rho_next=rho).state
    again = vi.start_from_configurations(q, one.q, dt, t=dt)
    assert np.abs(again.p - one.p).max() < 1e-11 * np.abs(one.p).max()
    assert np.abs(again.v_rho - 0.1).max() < 1e-12
    assert np.abs(again.v_rho - one.v_rho).max() < 1e-12


def test_momentum_is_that_of_the_velocity() -> None:
    m = cart_pendulum()
    vi, q, v = MidpointVI(m), np.array([0.1, 2.0]), np.array([1.0, -2.0])
    start = vi.start(q, v)
    # M of the cart-pendulum by hand: m_c + m, m l cos, m l^2
    mass = np.array([[11.0, np.cos(2.0)], [np.cos(2.0), 1.0]])
    assert start.p == pytest.approx(mass @ v, rel=1e-14)
    assert np.array_equal(vi.start(q, p=start.p).p, start.p)
    assert not vi.start(q).p.any()


def test_a_simulation_goes_on_where_it_ended() -> None:
    m = pendulum()
    t = times(2.0, 400)
    whole = swing(m, [1.0], [0.5], t)
    vi = MidpointVI(m)
    first = complete(vi.simulate(vi.start([1.0], [0.5]), t[:151]))
    second = complete(vi.simulate(first.last, t[150:]))
    both = np.concatenate([first.q, second.q[1:]])
    assert np.abs(both - whole.q).max() < 1e-10


def test_many_steps_are_the_same_as_one_after_the_other() -> None:
    m = mass_on_string()
    vi, t = MidpointVI(m), times(0.5, 50)
    length = 1.0 + 0.1 * np.sin(6 * t)
    start = vi.start(m.configuration({"z": -1.0, "length": 1.0}), m.configuration({"x": 1.0}))
    run = complete(vi.simulate(start, t, rho=length[:, None]))
    state = start
    for k in range(50):
        made = vi.step(state, t[k + 1] - t[k], rho_next=length[k + 1 : k + 2])
        state = made.state
        assert np.abs(state.x - run.x[k + 1]).max() < 1e-10
        assert made.lam == pytest.approx(run.lam[k], rel=1e-8)


def test_runs_are_repeatable_to_the_bit() -> None:
    m = marionette()
    q, t = rest_pose(m), times(0.5, 50)
    rho = np.tile(q[m.nd :], (51, 1)) + 0.03 * np.sin(3 * t)[:, None]
    first, second = (swing(m, q, np.zeros(m.nq), t, rho=rho) for _ in range(2))
    assert np.array_equal(first.x, second.x)
    assert np.array_equal(first.lam, second.lam)


def test_start_off_the_constraints_is_refused_by_name() -> None:
    m = mass_on_string()
    vi = MidpointVI(m)
    q = m.configuration({"z": -1.0, "length": 1.1})
    with pytest.raises(InconsistentStartError, match="string0") as caught:
        vi.start(q)
    assert caught.value.residuals["string0"] == pytest.approx(1.0 - 1.21)
    q = m.configuration({"z": -1.0, "length": 1.0})
    with pytest.raises(InconsistentStartError, match=r"velocity.*string0"):
        vi.start(q, m.configuration({"z": -0.5}))
    with pytest.raises(InconsistentStartError, match="string0"):
        vi.start_from_configurations(q, m.configuration({"z": -1.2, "length": 1.0}), 0.1)
    assert vi.start(q, m.configuration({"z": -0.5, "length": 0.5})).p[1] == pytest.approx(-1.0)


def test_velocity_and_momentum_together_are_refused() -> None:
    with pytest.raises(ArgumentError, match="both v and p"):
        MidpointVI(pendulum()).start([0.0], [1.0], p=[G])


def sledge(size: float, power: float, *others: object, tree: object = None) -> Mechanism:
    """Return 2 kg in a plane with a force of ``size |v|^power`` against the velocity."""
    sympy = pytest.importorskip("sympy")
    from leastaction.mechanics.expressions import rate, variable

    x, y = rate(variable("x")), rate(variable("y"))
    share = size * sympy.sqrt(x**2 + y**2) ** (power - 1)
    forces = [ExpressionForce(-share * v, name, name=f"f{name}") for v, name in ((x, "x"), (y, "y"))]
    return Mechanism(tree or [tx("x"), [ty("y", mass=2.0, name="sledge")]], [*forces, *others])


@pytest.mark.parametrize("split", ["symmetric", "left"])
@pytest.mark.parametrize("dt", [0.1, 0.01, 1e-4])
def test_a_moving_start_goes_with_its_momentum(split: str, dt: float) -> None:
    """Sliding friction has no direction at rest, from where the first step was guessed."""
    vi = MidpointVI(sledge(4.0, 0.0), split=split)
    run = vi.simulate(vi.start([0.0, 0.0], v=[3.0, 4.0]), np.linspace(0.0, 1.0, round(1.0 / dt) + 1))
    assert run.status is SimulationStatus.COMPLETED
    # Half of the first step is without what splits the friction so that all of it acts at its start.
    off = 0.0 if split == "symmetric" else dt
    assert np.abs(run.q[-1] - [2.4 - 0.6 * off, 3.2 - 0.8 * off]).max() < 1e-8
    assert run.balance is not None
    assert abs(run.balance.lost) < 1e-7


def test_forces_whose_slopes_are_undefined_at_rest_start_from_rest() -> None:
    """A fall through air, whose drag by a root has no slope at rest: limit speed sqrt(m g / c)."""
    vi = MidpointVI(sledge(0.1, 2.0, Gravity((0.0, -G, 0.0))))
    run = vi.simulate(vi.start([0.0, 0.0]), np.linspace(0.0, 10.0, 1001))
    assert run.status is SimulationStatus.COMPLETED
    limit = np.sqrt(2.0 * G / 0.1)
    assert run.q[-1, 1] == pytest.approx(-(2.0 / 0.1) * np.log(np.cosh(10.0 * G / limit)), rel=1e-5)


def test_a_moving_start_under_a_constraint_on_a_moving_frame() -> None:
    tree = [tx("belt", kinematic=True), [tx("x"), [ty("y", mass=2.0, name="sledge")]]]
    m = sledge(4.0, 0.0, PointOnLine("world", "sledge", (1.0, 1.0, 0.0)), tree=tree)
    vi, t, v = MidpointVI(m), np.linspace(0.0, 0.5, 51), np.array([2.0, 3.0, 1.0])
    assert np.abs(project_velocity(m, np.zeros(3), v).v - v).max() < 1e-12
    run = vi.simulate(vi.start(np.zeros(3), v), t, rho=t[:, None])
    assert run.status is SimulationStatus.COMPLETED
    assert np.abs(run.q[:, 0] + run.q[:, 2] - run.q[:, 1]).max() < 1e-12
