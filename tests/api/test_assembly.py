"""Consistent starts: the nearest configuration and velocity that the constraints allow."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import sympy
from scipy.optimize import minimize

from leastaction.errors import (
    ArgumentError,
    ContradictoryConstraintsError,
    InconsistentStartError,
)
from leastaction.mechanics import (
    Distance,
    ExpressionConstraint,
    Mechanism,
    MidpointVI,
    PathLength,
    PointToPoint,
    check_consistent,
    find_contradiction,
    project_configuration,
    project_velocity,
    rx,
    ry,
    tx,
    ty,
    tz,
    world,
)
from leastaction.mechanics.expressions.terms import variable
from leastaction.models.bricard import bricard
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.models.marionette import marionette, rest_pose


def point(*elements):
    """A point mass in the plane."""
    return Mechanism([tx("a"), [ty("b", name="p", mass=1.0)]], elements)


def rod(length=1.0, name="rod"):
    return Distance("world", "p", length, name=name)


def arms():
    """Two spatial arms held together by two rods."""
    tree = world()
    for side in "lr":
        place = tree.tx(0.4 if side == "r" else -0.4)
        for k, turn in enumerate(("rx", "ry", "rx")):
            place = getattr(place, turn)(f"{side}{k}", mass=0.2, inertia=(0.1, 0.1, 0.1))
            place = place.tz(-0.5, name=f"{side}end{k}", mass=1.0)
    rods = [
        Distance("lend1", "rend2", 0.9, name="upper"),
        Distance("lend2", "rend2", 0.7, name="lower"),
    ]
    return Mechanism(tree, rods)


@pytest.mark.parametrize("start", [(3, 4), (0.01, 0.02), (-5, 1e-3), (300, -20), (0.6, 0.8)])
def test_nearest_point_of_a_circle(start):
    result = project_configuration(point(rod()), start)
    expected = np.array(start) / np.linalg.norm(start)
    np.testing.assert_allclose(result.q, expected, atol=1e-9)
    assert abs(result.residuals["rod"]) < 1e-13
    assert result.largest == pytest.approx(np.abs(expected - start).max(), abs=1e-9)
    assert result.correction["a"] == pytest.approx(expected[0] - start[0], abs=1e-9)


def test_a_weight_makes_its_variable_move_less():
    weights = {"a": 4.0}
    result = project_configuration(point(rod()), (2.0, 1.0), weights=weights)
    # Stationary: W (q - q0) is along the gradient of the constraint, which is along q.
    pull = np.array([4.0, 1.0]) * (result.q - [2.0, 1.0])
    assert abs(pull[0] * result.q[1] - pull[1] * result.q[0]) < 1e-9
    same = project_configuration(point(rod()), (2.0, 1.0), weights=[4.0, 1.0])
    np.testing.assert_array_equal(same.q, result.q)
    assert abs(result.q[0] - project_configuration(point(rod()), (2.0, 1.0)).q[0]) > 0.01


@pytest.mark.parametrize("seed", range(5))
def test_nearest_point_agrees_with_a_general_optimiser(seed):
    mechanism = arms()
    start = np.random.default_rng(seed).normal(size=mechanism.nq)
    result = project_configuration(mechanism, start)
    q = result.q
    assert np.abs(mechanism.constraint_values(q)).max() < 1e-13
    # Stationary: the change is a combination of the constraints' gradients.
    jacobian = mechanism.constraint_jacobian(q)
    multiplier = np.linalg.lstsq(jacobian.T, q - start, rcond=None)[0]
    np.testing.assert_allclose(jacobian.T @ multiplier, q - start, atol=1e-8)
    # A minimum: no neighbour on the constraints is nearer.
    found = minimize(
        lambda z: 0.5 * np.sum((z - start) ** 2),
        q + 0.01 * np.random.default_rng(seed + 100).normal(size=mechanism.nq),
        jac=lambda z: z - start,
        constraints={
            "type": "eq", "fun": mechanism.constraint_values, "jac": mechanism.constraint_jacobian,
        },
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )  # fmt: skip
    assert np.linalg.norm(q - start) <= np.linalg.norm(found.x - start) + 1e-7
    np.testing.assert_allclose(found.x, q, atol=1e-5)


@pytest.mark.parametrize("seed", [*range(20), 57, 101, 126, 153, 178, 211])
def test_a_far_start_is_led_around_places_where_the_residual_is_stuck(seed):
    mechanism = arms()
    start = np.random.default_rng(seed).uniform(-3, 3, mechanism.nq)
    result = project_configuration(mechanism, start)
    jacobian, change = mechanism.constraint_jacobian(result.q), result.q - start
    multiplier = np.linalg.lstsq(jacobian.T, change, rcond=None)[0]
    np.testing.assert_allclose(jacobian.T @ multiplier, change, atol=1e-8)
    assert max(abs(h) for h in result.residuals.values()) < 1e-13


def test_the_marionette_is_brought_back_onto_its_strings():
    mechanism = marionette()
    start = rest_pose(mechanism)
    start[: mechanism.nd] += 0.1 * np.random.default_rng(0).normal(size=mechanism.nd)
    result = project_configuration(mechanism, start)
    np.testing.assert_array_equal(result.q[mechanism.nd :], start[mechanism.nd :])
    assert max(abs(h) for h in result.residuals.values()) < 1e-13
    assert set(result.correction) == set(mechanism.dynamic)
    assert next(iter(result.correction.values())) in (result.largest, -result.largest)
    assert result.iterations < 20
    held = mechanism.dynamic[:6]
    free = project_configuration(mechanism, start, hold=held, move_kinematic=True)
    np.testing.assert_array_equal(free.q[:6], start[:6])
    assert "left_leg_string-length" in free.correction
    assert not set(held) & set(free.correction)


def test_a_consistent_start_is_returned_as_it_is():
    mechanism = marionette()
    q = rest_pose(mechanism)
    check_consistent(mechanism, q)
    result = project_configuration(mechanism, q)
    assert result.largest < 1e-14
    unconstrained = project_configuration(point(), (3.0, 4.0))
    assert unconstrained.q.tolist() == [3.0, 4.0]
    assert unconstrained.residuals == {}


def test_a_doubled_rod_does_no_harm():
    result = project_configuration(point(rod(), rod(name="again")), (3.0, 4.0))
    np.testing.assert_allclose(result.q, [0.6, 0.8], atol=1e-9)
    moved = project_velocity(point(rod(), rod(name="again")), result.q, (1.0, 1.0))
    np.testing.assert_allclose(moved.v, np.array([0.16, -0.12]), atol=1e-9)


def test_contradicting_rods_are_named():
    mechanism = point(rod(), rod(2.0, name="longer"))
    with pytest.raises(ContradictoryConstraintsError, match=r"contradict each other") as caught:
        project_configuration(mechanism, (3.0, 4.0))
    error = pickle.loads(pickle.dumps(caught.value))
    assert set(error.constraints) == {"rod", "longer"}
    assert set(error.residuals) == {"rod", "longer"}
    # Between the two circles, as far from one as from the other in squared lengths.
    assert np.linalg.norm(error.q) == pytest.approx(np.sqrt(2.5), rel=1e-6)
    assert sorted(error.residuals.values()) == pytest.approx([-1.5, 1.5], rel=1e-6)
    assert error.held == ()
    assert "'longer'" in str(error)
    assert "'rod'" in str(error)


def test_only_those_with_a_part_in_it_are_named():
    """Two rods that contradict each other, beside rods that do not."""
    bars = [
        Distance("left", "p", 1.0, name="left rod"),
        Distance("p", "q", 0.5, name="between"),
        Distance("left", "p", 1.2, name="other rod"),
    ]
    mechanism = Mechanism(
        [
            *[tx("a"), [ty("b", name="p", mass=1.0)]],
            *[tx("c"), [ty("d", name="q", mass=1.0)]],
            tx(-1.0, name="left"),
        ],
        bars,
    )
    found = find_contradiction(mechanism, [0.1, 0.4, 0.9, -0.3])
    assert set(found.constraints) == {"left rod", "other rod"}
    assert abs(found.residuals["between"]) < 1e-9
    assert "between" not in str(found)
    with pytest.raises(ContradictoryConstraintsError, match="left rod"):
        MidpointVI(mechanism).start([0.1, 0.4, 0.9, -0.3])
    assert find_contradiction(Mechanism([tx("a", mass=1.0)]), [0.0]) is None
    single = point(rod())
    assert find_contradiction(single, [3.0, 4.0]) is None
    # What can be brought onto the constraints is no contradiction at a start either.
    with pytest.raises(InconsistentStartError, match="project_configuration") as caught:
        MidpointVI(single).start([3.0, 4.0])
    assert not isinstance(caught.value, ContradictoryConstraintsError)


def test_held_variables_that_stand_in_the_way_are_named():
    mechanism = four_bars(2)
    q, _ = at_angle(mechanism, 1.0, 0.0)
    q[mechanism.variables.index("crank1")] = 2.0
    with pytest.raises(ContradictoryConstraintsError, match="hold fewer") as caught:
        project_configuration(mechanism, q, hold=["crank0", "crank1"])
    assert set(caught.value.constraints) == {"loop0.x", "loop0.y"}
    assert set(caught.value.held) == {"crank0", "crank1"}
    one = project_configuration(mechanism, q, hold=["crank0"])
    assert max(abs(h) for h in one.residuals.values()) < 1e-13


def test_a_prescribed_length_that_is_too_short_is_named():
    mechanism = Mechanism(
        [tx("a"), [ty("b", name="p", mass=1.0)], tx(3.0, name="wall")],
        [rod("rope"), Distance("p", "wall", 1.0, name="far")],
    )
    start = mechanism.configuration({"a": 1.0, "b": 0.3, "rope": 1.0})
    with pytest.raises(ContradictoryConstraintsError, match="move_kinematic") as caught:
        project_configuration(mechanism, start)
    assert set(caught.value.constraints) == {"rod", "far"}
    assert caught.value.held == ("rope",)
    moved = project_configuration(mechanism, start, move_kinematic=True)
    assert moved.q[2] >= 2.0 - 1e-6


def test_a_loop_that_cannot_close_names_its_equations():
    arm = [rx("a"), [tz(-1.0, mass=1.0), [rx("b"), [tz(-1.0, name="tip", mass=1.0)]]]]
    mechanism = Mechanism([*arm, ty(3.0, name="wall")], [PointToPoint("tip", "wall", "yz", name="loop")])
    with pytest.raises(ContradictoryConstraintsError, match=r"'loop.y'.*out of reach") as caught:
        project_configuration(mechanism, [1.2, 0.3])
    assert caught.value.constraints == ("loop.y",)
    # Stretched towards the wall, a metre away from it.
    assert caught.value.residuals["loop.y"] == pytest.approx(-1.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(30))
def test_bricard_is_assembled_from_sixty_degrees_off(seed):
    """Its redundant equation is one only on the constraints: beside them the Jacobian has full rank."""
    mechanism = bricard()
    start = np.random.default_rng(seed).uniform(-np.pi / 3, np.pi / 3, 5)
    result = project_configuration(mechanism, start)
    assert max(abs(h) for h in result.residuals.values()) < 1e-12
    assert result.iterations < 150
    if mechanism.degrees_of_freedom(result.q) > 1:
        return  # folded flat, where branches of the motion meet and the constraints have no tangent
    jacobian, change = mechanism.constraint_jacobian(result.q), result.q - start
    multiplier = np.linalg.lstsq(jacobian.T, change, rcond=1e-9)[0]
    np.testing.assert_allclose(jacobian.T @ multiplier, change, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 1.5])
def test_bricard_is_assembled_at_a_held_angle(angle):
    mechanism = bricard()
    result = project_configuration(mechanism, [angle, 0.2, 0.1, -0.2, 0.3], hold=["joint0"])
    assert result.q[0] == angle
    assert max(abs(h) for h in result.residuals.values()) < 1e-12
    assert mechanism.degrees_of_freedom(result.q) == 1


@pytest.mark.parametrize("loops", [1, 2, 5])
@pytest.mark.parametrize("seed", range(10))
def test_four_bars_are_assembled_from_sixty_degrees_off(loops, seed):
    mechanism, rng = four_bars(loops), np.random.default_rng(seed)
    aligned, _ = at_angle(mechanism, rng.uniform(-3, 3), 0.0)
    start = aligned + rng.uniform(-np.pi / 3, np.pi / 3, mechanism.nq)
    result = project_configuration(mechanism, start)
    assert max(abs(h) for h in result.residuals.values()) < 1e-12
    held = start.copy()
    held[0] = aligned[0]
    result = project_configuration(mechanism, held, hold=["crank0"], attempts=4)
    assert result.q[0] == aligned[0]
    assert max(abs(h) for h in result.residuals.values()) < 1e-12


def test_more_starting_points_are_tried_on_request():
    """Held next to the line where a linkage can fold both ways, the way that the guess leads to is closed."""
    mechanism = four_bars(2)
    start = [-0.00095033, -0.42391085, 0.27310052, 0.18442843, 0.4359089]
    with pytest.raises(InconsistentStartError, match="attempts="):
        project_configuration(mechanism, start, hold=["crank0"])
    result = project_configuration(mechanism, start, hold=["crank0"], attempts=5)
    assert max(abs(h) for h in result.residuals.values()) < 1e-12
    again = project_configuration(mechanism, start, hold=["crank0"], attempts=5)
    np.testing.assert_array_equal(result.q, again.q)


def test_sizes_of_all_orders():
    for size in (1e-4, 1e6):
        result = project_configuration(point(rod(size)), (3.0 * size, 4.0 * size))
        np.testing.assert_allclose(result.q, [0.6 * size, 0.8 * size], rtol=1e-7)


def test_a_start_at_the_edge_of_the_numbers_is_an_inconsistent_start():
    with np.errstate(all="ignore"), pytest.raises(InconsistentStartError, match="'rod'"):
        project_configuration(point(rod()), (1e300, 1e300))


def test_rods_at_the_edge_of_the_numbers_that_contradict_are_an_inconsistent_start():
    mechanism = point(rod(1e150), rod(1e155, "other"))
    with pytest.raises(InconsistentStartError, match=r"'rod'|'other'"):
        project_configuration(mechanism, (1e80, 1e80))


def test_what_is_not_a_number_is_not_on_the_constraints():
    """A string through a point that it meets has no gradient, and a function may have no value."""
    log = ExpressionConstraint(sympy.log(variable("a")), name="log")
    with pytest.raises(InconsistentStartError, match="'log'"):
        check_consistent(point(log), (-1.0, 0.0))
    with pytest.raises(InconsistentStartError, match="'log'"):
        MidpointVI(point(log)).start((-1.0, 0.0))
    met = point(PathLength(["world", "p"], 1.0, name="string"))
    with pytest.raises(ArgumentError, match="gradient of 'string' is not finite"):
        met.redundancy((0.0, 0.0))
    with pytest.raises(InconsistentStartError, match="'string'"):
        project_velocity(met, (0.0, 0.0), (1.0, 0.0))


def test_a_rod_out_of_reach_is_named():
    reach = [rx("a"), [tz(-1.0, mass=1.0), [ry("b"), [tx(1.0, name="tip", mass=1.0)]]]]
    mechanism = Mechanism([*reach, tx(9.0, name="wall")], [Distance("tip", "wall", 1.0, name="rope")])
    with pytest.raises(ContradictoryConstraintsError, match="'rope' is out of reach") as caught:
        project_configuration(mechanism, (0.1, 0.2))
    assert caught.value.constraints == ("rope",)
    assert caught.value.residuals["rope"] > 10.0


def test_an_inconsistent_start_is_named_with_its_residual():
    mechanism = point(rod())
    with pytest.raises(InconsistentStartError, match=r"'rod' is off by 24.*project_configuration") as caught:
        check_consistent(mechanism, (3.0, 4.0))
    assert caught.value.residuals == {"rod": pytest.approx(24.0)}
    check_consistent(mechanism, (0.6, 0.8 + 1e-10))


def test_everything_held_is_an_inconsistent_start():
    with pytest.raises(InconsistentStartError, match="'rod'"):
        project_configuration(point(rod()), (3.0, 4.0), hold=["a", "b"])
    with pytest.raises(InconsistentStartError, match=r"'rod'.*Hold fewer"):
        project_velocity(point(rod()), (0.6, 0.8), (1.0, 1.0), hold=["a", "b"])


def test_nearest_velocity():
    result = project_velocity(point(rod()), (0.6, 0.8), (1.0, 1.0))
    np.testing.assert_allclose(result.v, np.array([0.16, -0.12]), atol=1e-15)
    assert result.largest == pytest.approx(1.12)
    assert list(result.correction) == ["b", "a"]
    assert abs(result.residuals["rod"]) < 1e-15


def test_a_prescribed_length_pulls_the_velocity_along():
    mechanism = point(rod("rope"))
    result = project_velocity(mechanism, (0.6, 0.8, 1.0), (0.0, 0.0, 0.5))
    np.testing.assert_allclose(result.v, [0.3, 0.4, 0.5], atol=1e-15)


BAD = {
    "short": ({"q": [1.0]}, r"q.*\(2,\)"),
    "NaN": ({"q": [1.0, float("nan")]}, "q.*nan.*'b'"),
    "hold unknown": ({"hold": ["c"]}, "hold.*'c'"),
    "hold text": ({"hold": "a"}, "hold.*list"),
    "weight unknown": ({"weights": {"c": 1.0}}, "'c'"),
    "weight zero": ({"weights": {"a": 0.0}}, "'a'.*positive"),
    "weights short": ({"weights": [1.0]}, "weights.*shape"),
}


@pytest.mark.parametrize("attempts", [0, True, 1.5])
def test_attempts_are_a_whole_number(attempts):
    with pytest.raises(ArgumentError, match="attempts"):
        project_configuration(point(rod()), [3.0, 4.0], attempts=attempts)


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments(case):
    options, pattern = BAD[case]
    q = options.get("q", [3.0, 4.0])
    options = {name: value for name, value in options.items() if name != "q"}
    with pytest.raises(ArgumentError, match=pattern):
        project_configuration(point(rod()), q, **options)
    with pytest.raises(ArgumentError, match=pattern.replace("q", "v", 1) if "q" in pattern else pattern):
        project_velocity(point(rod()), [0.6, 0.8], q, **options)


def test_a_projection_given_as_a_configuration_is_told_what_holds_it() -> None:
    m = Mechanism([tx("x", mass=1.0)])
    with pytest.raises(ArgumentError, match="it has an array 'q': give that"):
        MidpointVI(m).start(project_configuration(m, [0.1]))
