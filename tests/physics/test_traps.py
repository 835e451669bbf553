"""What was silent, refused or empty without need: tensions of stretching strings, kinks, lengths of zero."""

from __future__ import annotations

import re

import numpy as np
import pytest

from leastaction import pose, ry
from leastaction.errors import ArgumentError, DescriptionError, EquilibriumError
from leastaction.mechanics import (
    Body,
    Distance,
    ElasticString,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    TendonForce,
    equilibrium,
    project_configuration,
    tx,
    ty,
    tz,
    world,
)
from physics.laws import G


def cords() -> dict[str, Element]:
    """Return strings of 1 m from the world to 2 kg below, of all kinds that are no `Distance`."""
    pytest.importorskip("sympy")
    from leastaction.mechanics import ExpressionConstraint, ExpressionPotential
    from leastaction.mechanics.expressions import distance, parameter, variable

    s = distance("world", "bob")
    return {
        "elastic": ElasticString(["world", "bob"], 1e4, 1.0, tension_only=False, name="cord"),
        "tension only": ElasticString(["world", "bob"], 1e4, 1.0, name="cord"),
        "expression": ExpressionConstraint(s - parameter("length", 1.0), name="cord"),
        "squared": ExpressionConstraint(s**2 - 1.0, name="cord"),
        "expression potential": ExpressionPotential(5e3 * (s - 1.0) ** 2 + 0.0 * variable("y"), name="cord"),
    }


@pytest.mark.parametrize("kind", ["elastic", "tension only", "expression", "squared", "expression potential"])
def test_a_hanging_weight_pulls_its_cord(kind: str) -> None:
    m = Mechanism([ty("y"), [tz("z", mass=2.0, name="bob")]], [Gravity(), cords()[kind]])
    vi = MidpointVI(m)
    rest = equilibrium(m, [0.0, -1.0]).q
    run = vi.simulate(vi.start(rest), np.linspace(0.0, 0.1, 11))
    assert list(run.tensions()) == ["cord"]
    assert run.tensions()["cord"][1:] == pytest.approx(2.0 * G, rel=1e-6)


def test_an_expression_that_is_no_cord_has_no_tension() -> None:
    pytest.importorskip("sympy")
    from leastaction.mechanics import ExpressionPotential
    from leastaction.mechanics.expressions import distance, point, variable

    s = distance("world", "bob")
    for expression in (3.0 * variable("z") ** 2, s * point("bob")[2], point("bob")[1] ** 2):
        m = Mechanism([ty("y"), [tz("z", mass=2.0, name="bob")]], [ExpressionPotential(expression)])
        vi = MidpointVI(m)
        assert vi.simulate(vi.start([0.1, -1.0]), np.linspace(0.0, 0.1, 11)).tensions() == {}


@pytest.mark.parametrize(("pulled", "kind"), [("a string", "minimum"), ("a tendon", "minimum"), ("a tendon", "any")])
def test_an_equilibrium_at_a_kink_names_the_points_that_meet(pulled: str, kind: str) -> None:
    """Pulled together, two points meet; there the pull has no direction and no force vanishes."""
    bob = [ty("y"), [tz("z", mass=1.0, name="bob"), tx(0.1, name="c"), [tz(0.2, name="d")]]]
    springs = [JointSpring("y", 10.0), JointSpring("z", 10.0)]
    if pulled == "a string":
        m = Mechanism(bob, [Gravity(), *springs, ElasticString(["world", "bob", "c", "d"], 1e3, 0.1, name="pull")])
    else:
        m = Mechanism(bob, [*springs, TendonForce(["world", "bob"], "u", name="pull")])
    with pytest.raises(
        EquilibriumError, match=r"The frames 'world' and 'bob' of 'pull' are .* apart there; where they meet"
    ):
        equilibrium(m, [0.03, 0.02], inputs=[1.0] * m.n_inputs, kind=kind)


def test_prescribed_lengths_of_zero_are_named_where_they_cannot_be_met() -> None:
    tree = [ty(1.0, name="b"), ty("y"), [tz("z", mass=1.0, name="bob")]]
    m = Mechanism(tree, [Gravity(), Distance("world", "bob", "left"), Distance("b", "bob", "right")])
    with pytest.raises(ArgumentError, match=r"its length 'left' is 0 m, .*Set 'left' in the configuration"):
        project_configuration(m, m.configuration({"z": -1.0}))
    guess = m.configuration({"y": 0.4, "z": -1.0, "left": 1.0, "right": 1.0})
    found = project_configuration(m, guess, move_kinematic=True)
    assert max(map(abs, found.residuals.values())) < 1e-9


@pytest.mark.parametrize("inertia", [[1e-3, 1e-3, -1e-20], [0.0, 0.0, -1e-20], [1.0, 1.0, -1e-11]])
def test_moments_that_are_negative_by_rounding_are_none(inertia: list[float]) -> None:
    body = Body(1.0, inertia=inertia)
    assert np.linalg.eigvalsh(body.inertia).min() >= 0.0
    np.testing.assert_allclose(body.inertia, np.diag(inertia), atol=1e-9)


def test_a_negative_moment_is_refused_unless_it_is_allowed() -> None:
    for inertia in ([1.0, 1.0, -1e-3], [0.0, 0.0, -1e-12]):
        with pytest.raises(DescriptionError, match="none may be negative"):
            Body(1.0, inertia=inertia)
        np.testing.assert_array_equal(Body(1.0, inertia=inertia, allow_nonphysical=True).inertia, np.diag(inertia))


def test_the_sign_of_multipliers_is_that_of_the_docstring() -> None:
    """The impulse of a constraint, minus its gradient times the multiplier, holds a weight against gravity."""
    m = Mechanism([ty("y"), [tz("z", mass=2.0, name="bob")]], [Gravity(), Distance("world", "bob", 1.0)])
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.0, -1.0]), np.linspace(0.0, 0.1, 11))
    impulse = -m.constraint_jacobian(run.q[5]).T @ run.lam[5]
    assert impulse == pytest.approx([0.0, 2.0 * G * 0.01], abs=1e-9)
    assert re.search(r"``-Dh\(q_k\)\^T lam_k`` act at its start", type(run).__doc__ or "")


def test_a_frame_may_be_called_world_where_the_world_is_called_something_else() -> None:
    with pytest.raises(DescriptionError, match=r"duplicate frame name 'world'.*begin with world\('ground'\)"):
        Mechanism([tx("x", mass=1.0, name="world")])
    m = Mechanism(world("ground").tx("x", mass=1.0, name="world"), [JointSpring("x", 1.0)])
    assert m.frames == ("ground", "world")


def test_inputs_sampled_at_the_middle_of_steps_are_of_second_order() -> None:
    """And at the start of first, as the docstring of `simulate` says."""
    m = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="u")])
    vi = MidpointVI(m)
    errors: dict[float, list[float]] = {0.0: [], 0.5: []}
    for share, found in errors.items():
        for n in (50, 100):
            t = np.linspace(0.0, 1.0, n + 1)
            run = vi.simulate(vi.start([0.0]), t, inputs=np.exp(t[:-1] + share / n)[:, None])
            found.append(abs(float(run.q[-1, 0]) - (np.e - 2.0)))
    assert errors[0.0][0] / errors[0.0][1] == pytest.approx(2.0, abs=0.1)
    assert errors[0.5][0] / errors[0.5][1] == pytest.approx(4.0, abs=0.2)


def test_numbers_that_overflow_are_no_warning() -> None:
    arm = [ry("a", mass=0.2, com=(-0.3, -0.3, -0.3)), [pose(translation=(0.3, 0.3, 0.3), name="tip")]]
    m = Mechanism(
        [*arm, pose(translation=(-2.0, -2.0, -2.0), name="post")], [LinearSpring("tip", "post", stiffness=0.5)]
    )
    far = m.with_parameters({"tip.translation.x": 1e300})
    found = far.lagrangian([0.3], [0.0]).along(q=[1.0], v=[1.0])
    assert not np.isfinite(found.hessian).all()


@pytest.mark.parametrize("kind", ["minimum", "any"])
def test_an_equilibrium_from_where_points_meet_names_them(kind: str) -> None:
    m = Mechanism([tx("x"), [tz("z", mass=1.0, name="bob")]], [ElasticString(["world", "bob"], 100.0, 0.5)])
    with pytest.raises(EquilibriumError, match=r"no finite slope at the guess.* 'world' and 'bob' of .* are 0 m apart"):
        equilibrium(m, [0.0, 0.0], kind=kind)
