"""Equilibria, their stability and their frequencies, against closed forms and against motions."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from leastaction.errors import (
    ArgumentError,
    ContradictoryConstraintsError,
    EquilibriumError,
)
from leastaction.mechanics import (
    BodyWrench,
    Distance,
    Gravity,
    HybridWrench,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    Stability,
    equilibrium,
    project_configuration,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.models.bricard import bricard
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.chain import pendulum_chain
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.models.marionette import marionette, rest_pose
from physics.laws import G, mass_on_string, pendulum, swing, times


@pytest.mark.parametrize("guess", [0.1, 1.5, 3.0, -3.1, np.pi])
def test_a_pendulum_hangs(guess: float) -> None:
    found = equilibrium(pendulum(), [guess])
    assert np.cos(found.q[0]) == pytest.approx(1.0, abs=1e-15)
    assert found.stability is Stability.STABLE
    assert found.frequencies == pytest.approx([np.sqrt(G)], rel=1e-10)
    assert found.potential == pytest.approx(-G)
    assert found.residual < 1e-11 * G


def test_a_pendulum_stands_where_any_equilibrium_will_do() -> None:
    found = equilibrium(pendulum(), [2.8], kind="any")
    assert found.q[0] == pytest.approx(np.pi, abs=1e-12)
    assert found.stability is Stability.UNSTABLE
    assert found.eigenvalues == pytest.approx([-G], rel=1e-10)
    assert len(found.frequencies) == 0


def test_a_weight_on_a_spring() -> None:
    stiffness, mass, length = 50.0, 2.0, 0.3
    m = Mechanism(
        [tx(0.0, name="hook"), tx("x"), [tz("z", name="bob", mass=mass)]],
        [Gravity((0, 0, -G)), LinearSpring("hook", "bob", stiffness, length)],
    )
    found = equilibrium(m, [0.2, 0.4])
    stretched = length + mass * G / stiffness
    assert found.q == pytest.approx([0.0, -stretched], abs=1e-11)
    # Sideways it is a pendulum, along the spring an oscillator.
    assert found.frequencies == pytest.approx(sorted([np.sqrt(G / stretched), np.sqrt(stiffness / mass)]), rel=1e-9)
    energy = -mass * G * stretched + 0.5 * stiffness * (stretched - length) ** 2
    assert found.potential == pytest.approx(energy, rel=1e-12)


def test_two_links_swing_at_the_frequencies_of_the_double_pendulum() -> None:
    m = pendulum_chain(2, inertia=(0.0, 0.0, 0.0), gravity=(0.0, 0.0, -G))
    found = equilibrium(m, [1.0, -2.0])
    assert found.frequencies**2 == pytest.approx(G * np.array([2 - 2**0.5, 2 + 2**0.5]), rel=1e-9)
    # Relative angles: the bobs swing alike in the slow mode, and against each other in the fast one.
    assert found.modes[1] / found.modes[0] == pytest.approx([2**0.5 - 1.0, -(2**0.5) - 1.0], rel=1e-9)


def test_a_constraint_adds_its_curvature_and_its_multiplier_is_the_tension() -> None:
    m, length = mass_on_string(length=1.5), 1.5
    found = equilibrium(m, [1.0, 1.0])
    assert found.q == pytest.approx([0.0, -length], abs=1e-9)
    # Gravity alone is flat: all of the stiffness is the curvature of the constraint.
    assert found.frequencies == pytest.approx([np.sqrt(G / length)], rel=1e-10)
    assert 2.0 * length * found.multipliers["string0"] == pytest.approx(2.0 * G, rel=1e-12)
    run = swing(m, found.q, np.zeros(2), times(0.05, 5))
    assert run.lam[1:, 0] / 0.01 == pytest.approx(found.multipliers["string0"], rel=1e-9)
    above = equilibrium(m, [0.2, 1.5], kind="any")
    assert above.q == pytest.approx([0.0, length], abs=1e-9)
    assert above.eigenvalues == pytest.approx([-G / length], rel=1e-9)
    assert above.stability is Stability.UNSTABLE


def test_doubled_strings_share_the_pull() -> None:
    found = equilibrium(mass_on_string(length=1.0, copies=2), [0.3, -0.4])
    assert found.stability is Stability.STABLE
    assert list(found.multipliers.values()) == pytest.approx([0.5 * G] * 2, rel=1e-12)


def test_a_prescribed_length_is_held_by_the_tension() -> None:
    m = mass_on_string()
    found = equilibrium(m, m.configuration({"x": 0.5, "z": -0.5, "length": 2.0}))
    assert found.q == pytest.approx([0.0, -2.0, 2.0], abs=1e-9)
    # The weight wants to lengthen the string.
    assert found.holding == {"length": pytest.approx(-2.0 * G, rel=1e-12)}


def test_a_held_variable_is_held_by_a_force() -> None:
    m = cart_pendulum()
    found = equilibrium(m, [0.3, 1.0], hold=["theta"])
    assert found.q.tolist() == [0.3, 1.0]
    assert found.holding["theta"] == pytest.approx(9.8 * np.sin(1.0))
    everything = equilibrium(m, [0.3, 1.0], hold=["theta", "x"])
    assert everything.stability is Stability.STABLE
    assert len(everything.eigenvalues) == 0


def test_a_cart_may_stand_anywhere() -> None:
    found = equilibrium(cart_pendulum(), [0.3, 2.5])
    assert found.q == pytest.approx([0.3, 0.0], abs=1e-10)
    assert found.stability is Stability.MARGINAL
    assert found.eigenvalues == pytest.approx([0.0, 9.8 * 11.0 / 10.0], abs=1e-8)


def test_inputs_and_constant_forces_count() -> None:
    m = Mechanism(
        [rz("theta"), [ty(-1.0, name="bob", mass=1.0)]],
        [Gravity((0, -G, 0)), JointForce("theta", input="motor")],
    )
    found = equilibrium(m, [0.0], inputs=[5.0])
    assert found.q[0] == pytest.approx(np.arcsin(5.0 / G), abs=1e-12)
    blown = Mechanism(
        [rz("theta"), [ty(-1.0, name="bob", mass=1.0)]],
        [Gravity((0, -G, 0)), HybridWrench("bob", force=(4.0, 0.0, 0.0))],
    )
    found = equilibrium(blown, [-2.0])
    assert np.tan(found.q[0]) == pytest.approx(4.0 / G, rel=1e-10)
    assert found.frequencies == pytest.approx([np.hypot(4.0, G) ** 0.5], rel=1e-9)


@pytest.mark.parametrize(("load", "stable"), [(2.0, True), (2.2, False), (-3.0, True)])
def test_ziegler_column_flutters_at_its_critical_load(load: float, stable: bool) -> None:
    """Two links with springs, masses 2 m and m, a force that follows the second: P = (7/2 - sqrt 2) k / l."""
    assert 2.0 < 3.5 - 2**0.5 < 2.2
    column = Mechanism(
        [rz("a"), [tx(1.0, name="middle", mass=2.0), [rz("b"), [tx(1.0, name="tip", mass=1.0)]]]],
        [
            JointSpring("a", 1.0),
            JointSpring("b", 1.0),
            BodyWrench("tip", force=(-load, 0.0, 0.0)),
        ],
    )
    found = equilibrium(column, [0.0, 0.0], kind="any")
    assert found.q.tolist() == [0.0, 0.0]
    assert (found.stability is Stability.STABLE) == stable
    assert np.iscomplexobj(found.eigenvalues) != stable
    if not stable:
        assert np.abs(found.eigenvalues.imag).min() > 0.1


@pytest.mark.parametrize("loops", [1, 2, 5])
@pytest.mark.parametrize("seed", range(4))
def test_four_bars_hang_from_a_rough_guess(loops: int, seed: int) -> None:
    m = four_bars(loops)
    rough = at_angle(m, -1.0, 0.0)[0] + np.random.default_rng(seed).uniform(-0.5, 0.5, m.nq)
    found = equilibrium(m, rough)
    assert np.sin(found.q) == pytest.approx(-at_angle(m, 1.0, 0.0)[0], abs=1e-9)
    inertia, moment = (loops + 1) / 3 + loops, (loops + 1) / 2 + loops
    assert found.frequencies == pytest.approx([np.sqrt(moment * G / inertia)], rel=1e-9)
    # A saddle of the potential on the constraints is left, even from right on it.
    down = equilibrium(m, at_angle(m, np.pi / 2, 0.0)[0])
    assert down.potential == pytest.approx(found.potential, rel=1e-9)
    up = equilibrium(m, at_angle(m, 1.3, 0.0)[0], kind="any")
    assert up.potential == pytest.approx(-found.potential, rel=1e-9)
    assert up.eigenvalues == pytest.approx(-found.eigenvalues, rel=1e-8)


def test_bricard_hangs_and_swings_at_the_frequency_of_its_motion() -> None:
    m = bricard()
    found = equilibrium(m, [0.5, -0.4, 0.3, 0.2, 0.4])
    assert found.stability is Stability.STABLE
    assert len(found.frequencies) == 1
    beside = found.q + 1e-4 * found.modes[:, 0] / np.abs(found.modes[:, 0]).max()
    start = project_configuration(m, beside).q
    run = swing(m, start, np.zeros(5), times(20.0, 16000))
    offset = run["joint0"] - found.q[0]
    down = np.flatnonzero((offset[:-1] > 0) & (offset[1:] <= 0))
    crossings = run.t[down] + 0.00125 * offset[down] / (offset[down] - offset[down + 1])
    period = np.diff(crossings).mean()
    assert 2.0 * np.pi / period == pytest.approx(found.frequencies[0], rel=1e-5)


def test_the_marionette_hangs_in_its_rest_pose() -> None:
    m = marionette()
    rest = rest_pose(m)
    rough = rest.copy()
    rough[: m.nd] += np.random.default_rng(0).uniform(-0.5, 0.5, m.nd)
    found = equilibrium(m, rough)
    assert found.q == pytest.approx(rest, abs=1e-9)
    assert found.stability is Stability.STABLE
    assert len(found.frequencies) == 16
    assert min(found.multipliers.values()) > 0.0
    pulls = [-force for name, force in found.holding.items() if name.endswith("-length")]
    assert sum(pulls) == pytest.approx(9.8 * 18.75, rel=1e-12)
    # The modes are those of the motion: a rotation of the basis that makes mass and stiffness diagonal.
    mass = found.modes.T @ m.mass_matrix(found.q) @ found.modes
    assert mass == pytest.approx(np.eye(16), abs=1e-10)
    assert np.abs(m.constraint_jacobian(found.q) @ found.modes).max() < 1e-10


def test_where_nothing_stops_the_fall_that_is_said() -> None:
    falling = Mechanism([tx("x"), [ty("y", name="p", mass=1.0)]], [Gravity((0, -G, 0))])
    with pytest.raises(EquilibriumError, match=r"without bound along 'y'") as caught:
        equilibrium(falling, [0.0, 0.0])
    error = pickle.loads(pickle.dumps(caught.value))
    assert error.residuals["force on 'y'"] == pytest.approx(-G)
    assert error.reached.q[1] < -1e4
    assert error.iteration > 0
    assert equilibrium(falling, [0.0, 0.0], hold=["y"]).stability is Stability.MARGINAL


def test_too_few_iterations_say_how_far_it_came() -> None:
    m = pendulum_chain(8)
    with pytest.raises(EquilibriumError, match="in 2 iterations") as caught:
        equilibrium(m, np.linspace(-3, 3, 8), max_iterations=2)
    reached = caught.value.reached
    assert reached.iterations == 2
    assert reached.residual > 1.0
    assert reached.potential < m.energy(np.linspace(-3, 3, 8), np.zeros(8)).potential
    assert set(caught.value.residuals) == {f"force on 'theta{k}'" for k in range(8)}


def test_bad_arguments_are_named() -> None:
    m = pendulum()
    with pytest.raises(ArgumentError, match=r"kind.*'saddle'"):
        equilibrium(m, [0.0], kind="saddle")
    with pytest.raises(ArgumentError, match="tolerance"):
        equilibrium(m, [0.0], tolerance=0.0)
    with pytest.raises(ArgumentError, match=r"hold.*'x'"):
        equilibrium(m, [0.0], hold=["x"])
    with pytest.raises(ArgumentError, match=r"q_guess.*\(1"):
        equilibrium(m, [0.0, 1.0])
    with pytest.raises(ArgumentError, match="inputs"):
        equilibrium(m, [0.0], inputs=[1.0])


def test_a_guess_that_cannot_be_assembled_is_named() -> None:
    m = Mechanism(
        [tx("x"), [ty("y", name="p", mass=1.0)]],
        [Distance("world", "p", 1.0, name="short"), Distance("world", "p", 2.0, name="long")],
    )
    with pytest.raises(ContradictoryConstraintsError, match="short"):
        equilibrium(m, [1.0, 1.0])


def test_an_equilibrium_stays_at_rest() -> None:
    m = four_bars(2)
    found = equilibrium(m, at_angle(m, -1.2, 0.0)[0])
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(found.q), times(1.0, 100))
    assert np.abs(run.q - found.q).max() < 1e-9


def test_print_says_what_was_found() -> None:
    mechanism = mass_on_string()
    projected = project_configuration(mechanism, [0.3, -2.0, 1.0])
    worst = next(iter(projected.correction))
    assert str(projected).startswith(f"changed {worst!r} {projected.correction[worst]:+.4g}")
    assert f"in {projected.iterations} steps; the largest residual is that of" in str(projected)
    found = equilibrium(cart_pendulum(), [0.0, 0.3], hold=["x"])
    assert str(found).startswith("stable: after a small push it swings about the equilibrium\npotential ")
    assert f"natural frequencies (rad/s) {found.frequencies[0]:.4g}" in str(found)
    assert "held by 'x' " in str(found)
