"""Consistent starts: the nearest configuration and velocity that the constraints allow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from leastaction.errors import ArgumentError, InconsistentStartError
from leastaction.mechanics import (
    Distance,
    Mechanism,
    check_consistent,
    project_configuration,
    project_velocity,
    rx,
    ry,
    tx,
    ty,
    tz,
    world,
)
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


@pytest.mark.parametrize("seed", [20, 57, 101, 126, 153, 178, 211])
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
    with pytest.raises(InconsistentStartError, match=r"contradict.*hold fewer") as caught:
        project_configuration(mechanism, (3.0, 4.0))
    assert set(caught.value.residuals) == {"rod", "longer"}
    assert max(abs(h) for h in caught.value.residuals.values()) > 0.5
    assert "'longer'" in str(caught.value) or "'rod'" in str(caught.value)


def test_sizes_of_all_orders():
    for size in (1e-4, 1e6):
        result = project_configuration(point(rod(size)), (3.0 * size, 4.0 * size))
        np.testing.assert_allclose(result.q, [0.6 * size, 0.8 * size], rtol=1e-7)


def test_a_start_at_the_edge_of_the_numbers_is_an_inconsistent_start():
    with np.errstate(all="ignore"), pytest.raises(InconsistentStartError, match="'rod'"):
        project_configuration(point(rod()), (1e300, 1e300))


def test_a_rod_out_of_reach_is_named():
    reach = [rx("a"), [tz(-1.0, mass=1.0), [ry("b"), [tx(1.0, name="tip", mass=1.0)]]]]
    mechanism = Mechanism(
        [*reach, tx(9.0, name="wall")], [Distance("tip", "wall", 1.0, name="rope")]
    )
    with pytest.raises(InconsistentStartError, match="'rope' is off by") as caught:
        project_configuration(mechanism, (0.1, 0.2))
    assert caught.value.residuals["rope"] > 10.0


def test_an_inconsistent_start_is_named_with_its_residual():
    mechanism = point(rod())
    with pytest.raises(
        InconsistentStartError, match=r"'rod' is off by 24.*project_configuration"
    ) as caught:
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
    "short": ({"q": [1.0]}, r"q.*\(2\)"),
    "NaN": ({"q": [1.0, float("nan")]}, "q.*'b'.*nan"),
    "hold unknown": ({"hold": ["c"]}, "hold.*'c'"),
    "hold text": ({"hold": "a"}, "hold.*list"),
    "weight unknown": ({"weights": {"c": 1.0}}, "'c'"),
    "weight zero": ({"weights": {"a": 0.0}}, "'a'.*positive"),
    "weights short": ({"weights": [1.0]}, "weights.*shape"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arguments(case):
    options, pattern = BAD[case]
    q = options.get("q", [3.0, 4.0])
    options = {name: value for name, value in options.items() if name != "q"}
    with pytest.raises(ArgumentError, match=pattern):
        project_configuration(point(rod()), q, **options)
    with pytest.raises(
        ArgumentError, match=pattern.replace("q", "v", 1) if "q" in pattern else pattern
    ):
        project_velocity(point(rod()), [0.6, 0.8], q, **options)
