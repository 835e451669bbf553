"""Armatures against rotors that are bodies of the tree, and the O(n) solvers against the elimination of the matrix."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import _core
from leastaction.errors import DescriptionError
from leastaction.mechanics import (
    Armature,
    ContinuousDynamics,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    rx,
    ry,
    rz,
    tz,
)
from leastaction.models.chain import pendulum_chain
from leastaction.models.scissor_lift import at_angle, scissor_lift

INERTIA, GEAR = 0.02, 30.0


def arm(rotors: bool) -> Mechanism:
    """An arm with a drive at its shoulder, one geared to two joints, and a flywheel that nothing hangs on."""
    links = [rx("a", mass=1.0, com=(0, 0, -0.3)), [tz(-0.6), [ry("b", mass=0.5, com=(0, 0.1, -0.2))]]]
    factors = {"b": 2.0, "wheel": -1.0, "a": 0.5}
    elements = [Gravity(), JointForce("wheel", "u")]
    disc = {"mass": 0.0, "inertia": (INERTIA / 2, INERTIA / 2, INERTIA)}
    if rotors:
        bodies = [rz({"a": GEAR}, name="drive", **disc), rz(factors, name="geared", **disc)]
        return Mechanism([*links, *bodies, rz("wheel", name="flywheel", **disc)], elements)
    named = [Armature({"a": GEAR}, INERTIA, name="drive"), Armature(factors, INERTIA), Armature("wheel", INERTIA)]
    return Mechanism([*links, rz("wheel")], [*elements, *named])


def test_an_armature_is_a_rotor_without_a_place() -> None:
    ours, bodies = arm(False), arm(True)
    assert set(ours.variables) == set(bodies.variables)
    order = [ours.variables.index(name) for name in bodies.variables]
    rng = np.random.default_rng(0)
    q, v = rng.uniform(-1.0, 1.0, (2, 3))
    np.testing.assert_allclose(ours.mass_matrix(q)[np.ix_(order, order)], bodies.mass_matrix(q[order]), rtol=1e-14)
    assert ours.energy(q, v).kinetic == pytest.approx(bodies.energy(q[order], v[order]).kinetic, rel=1e-14)
    np.testing.assert_allclose(ours.momentum(q, v)[order], bodies.momentum(q[order], v[order]), rtol=1e-13)
    first, second = (
        ContinuousDynamics(m).accelerations(*state, [0.7]).a
        for m, state in ((ours, (q, v)), (bodies, (q[order], v[order])))
    )
    np.testing.assert_allclose(first[order], second, rtol=1e-12)
    t = 0.01 * np.arange(21)
    runs = []
    for m, state in ((ours, (q, v)), (bodies, (q[order], v[order]))):
        vi = MidpointVI(m)
        runs.append(vi.simulate(vi.start(*state), t, inputs=np.full((20, 1), 0.7)))
    np.testing.assert_allclose(runs[0].q[:, order], runs[1].q, rtol=1e-10)


def test_it_has_no_place() -> None:
    ours = arm(False)
    bare = Mechanism(
        [rx("a", mass=1.0, com=(0, 0, -0.3)), [tz(-0.6), [ry("b", mass=0.5, com=(0, 0.1, -0.2))]]], [Gravity()]
    )
    q, v = np.array([0.3, -0.4, 0.2]), np.array([1.0, -2.0, 3.0])
    assert ours.mass == bare.mass
    np.testing.assert_array_equal(ours.center_of_mass(q), bare.center_of_mass(q[:2]))
    np.testing.assert_allclose(ours.total_momentum(q, v), bare.total_momentum(q[:2], v[:2]), rtol=1e-15)
    assert "drive" not in ours.frames
    assert "Armature: wheel, 0.02 kg m^2" in str(ours)


def test_its_inertia_is_a_parameter() -> None:
    heavier = arm(False).with_parameters({"drive.inertia": 2.0 * INERTIA, "drive.factors.a": 10.0})
    q = np.zeros(3)
    added = heavier.mass_matrix(q)[0, 0] - arm(False).mass_matrix(q)[0, 0]
    assert added == pytest.approx((2.0 * 10.0**2 - GEAR**2) * INERTIA, rel=1e-12)
    with pytest.raises(DescriptionError, match=r"inertia.*positive"):
        arm(False).with_parameters({"drive.inertia": 0.0})


def test_what_no_rotor_turns_is_still_refused() -> None:
    with pytest.raises(DescriptionError, match="massless dynamic variable 'b'"):
        Mechanism([rx("a"), rx("b")], [Armature("a", 1.0)])
    with pytest.raises(DescriptionError, match="move masses only in combination"):
        Mechanism([rx("a"), rx("b")], [Armature({"a": 1.0, "b": 2.0}, 1.0)])


def _run(core: _core.Mechanism, solver: str, t: np.ndarray, x0: np.ndarray) -> np.ndarray:
    midpoint = _core.Midpoint(core, split=_core.Split.symmetric, solver=_core.Solver[solver])
    out = midpoint.roll_out(t, x0, None, np.zeros((len(t) - 1, core.n_inputs + core.n_kinematic)), None)
    assert out.steps == len(t) - 1
    return out.x


def test_the_solver_of_deep_trees_keeps_them_on_its_diagonal() -> None:
    n = 60
    chain = pendulum_chain(n)
    m = chain.with_elements([Armature(name, 0.01 * (1 + i % 3)) for i, name in enumerate(chain.dynamic)])
    q, t = 0.05 * np.cos(np.arange(n)), 2e-3 * np.arange(6.0)
    x0 = MidpointVI(m).start(q).x
    np.testing.assert_allclose(_run(m.core, "tree", t, x0), _run(m.core, "dense", t, x0), rtol=0, atol=5e-9)
    v = np.sin(np.arange(n))
    a = ContinuousDynamics(m).accelerations(q, v).a
    by_force = ContinuousDynamics(m).inverse_dynamics(q, v, a)
    assert np.abs(by_force).max() < 1e-9 * np.abs(m.mass_matrix(q) @ a).max()


def test_the_solver_of_loops_does_too() -> None:
    lift = scissor_lift(6)
    m = lift.with_elements([Armature(name, 0.05) for name in lift.dynamic])
    t = 2e-3 * np.arange(6.0)
    x0 = MidpointVI(m).start(*at_angle(m, 0.7)).x
    ours, dense, without = (_run(m.core, "loops", t, x0), _run(m.core, "dense", t, x0), _run(lift.core, "loops", t, x0))
    np.testing.assert_allclose(ours, dense, rtol=0, atol=1e-9)
    assert np.abs(ours - without).max() > 1e-6
