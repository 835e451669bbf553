"""Prices on frames in continuous time: what they are, their derivatives, and motions that are found by them."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import BodyWrench, JointForce, Mechanism, MechanismSystem, ball, check_derivatives, optimize, rx, tz
from leastaction.costs import ContinuousCostSum, ContinuousOrientationCost, ContinuousPlaceCost, tracking
from leastaction.errors import ArgumentError
from leastaction.numerics import rotations
from leastaction.optimal import DenseTrajectory

ARM = MechanismSystem(
    Mechanism(
        [rx("shoulder", mass=1.0, inertia=(0.1, 0.1, 0.1)),
         [tz(-1.0, name="upper"), [rx("elbow", mass=1.0, inertia=(0.1, 0.1, 0.1)), [tz(-1.0, name="hand", mass=0.5)]]]],
        [JointForce("shoulder", input="s"), JointForce("elbow", input="e")],
    )
)  # fmt: skip
HULL = MechanismSystem(
    Mechanism(
        [ball("hull", mass=1.0, inertia=(0.2, 0.3, 0.4)), [tz(1.0, name="mast")]],
        [BodyWrench("hull", torque=("a", "b", "c"))],
    )
)


def place(t: float) -> np.ndarray:
    return np.array([0.0, 0.5 + 0.3 * t, -1.5])


def orientation(t: float) -> np.ndarray:
    c, s = np.cos(0.8 * t), np.sin(0.8 * t)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def costs_of(system: MechanismSystem, frame: str) -> tuple[ContinuousPlaceCost, ContinuousOrientationCost]:
    return (
        ContinuousPlaceCost(system, {frame: place}, {frame: [1.0, 2.0, 5.0]}),
        ContinuousOrientationCost(system, {frame: orientation}, {frame: [3.0, 1.0, 2.0]}),
    )


def test_they_are_what_one_would_write_by_hand():
    q = np.array([0.3, -0.9])
    pose = ARM.mechanism.frame_pose(q, "hand")
    x, u, t = np.concatenate([q, [1.0, 2.0]]), np.zeros(2), 0.4
    places, turns = costs_of(ARM, "hand")
    by_hand = 0.5 * np.array([1.0, 2.0, 5.0]) @ (pose[:3, 3] - place(t)) ** 2
    assert places.rate(x, u, t) == pytest.approx(by_hand, rel=1e-12)
    assert turns.rate(x, u, t) == pytest.approx(0.5 * 3.0 * (0.3 - 0.9 - 0.8 * t) ** 2, rel=1e-10)


def test_derivatives_are_those_of_the_values():
    bend = DenseTrajectory.from_functions(
        lambda t: np.array([t, 1.0 - t, 0.2, 0.3]), lambda t: np.array([t, -t]), horizon=(0.0, 1.0), nx=4, nu=2
    )
    turn = DenseTrajectory.from_functions(
        lambda t: np.concatenate([rotations.exponential(np.array([t, 0.3, -0.2 * t])), [t, 0.1, 0.2]]),
        lambda t: np.array([t, 1.0, -t]), horizon=(0.0, 1.0), nx=7, nu=3,
    )  # fmt: skip
    for system, frame, curve in ((ARM, "hand", bend), (HULL, "mast", turn)):
        for cost in costs_of(system, frame):
            assert check_derivatives(cost, curve).ok


@pytest.mark.parametrize("collocate", [True, False])
def test_a_hand_goes_where_it_is_wanted(collocate):
    effort = tracking(ARM, {"*.v": 1e-3}, effort=1e-4)
    wanted = ContinuousPlaceCost(ARM, {"hand": place}, {"hand": 100.0})
    found = optimize(
        ARM, ContinuousCostSum([effort, wanted]), initial=([0.9, -0.9, 0.0, 0.0], np.zeros(2)), horizon=(0.0, 1.0),
        collocate=collocate,
    )  # fmt: skip
    assert found.success
    x, _ = found.dense.sample(np.array([0.5, 0.9]))
    hand = ARM.mechanism.frame_pose(np.ascontiguousarray(x[:, :2]), "hand")[:, :3, 3]
    np.testing.assert_allclose(hand, [place(0.5), place(0.9)], atol=0.02)


@pytest.mark.parametrize("collocate", [True, False])
def test_a_frame_of_a_ball_is_turned_as_it_is_wanted(collocate):
    effort = tracking(HULL, {"*.v": 0.0}, effort=1e-3)
    wanted = ContinuousOrientationCost(HULL, {"mast": orientation}, {"mast": 100.0})
    words = tracking(HULL, {"hull.w?": 100.0}, {"hull": orientation}, effort=1e-3)
    start = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(3)
    one, other = (
        optimize(HULL, cost, initial=start, horizon=(0.0, 1.0), collocate=collocate)
        for cost in (ContinuousCostSum([effort, wanted]), words)
    )
    assert one.success
    assert one.cost == pytest.approx(other.cost, rel=1e-5)


def test_what_is_wrong_is_said():
    for kind, wanted, what in (
        (ContinuousPlaceCost, np.zeros(3), "places"), (ContinuousOrientationCost, np.eye(3), "orientations"),
    ):  # fmt: skip
        with pytest.raises(ArgumentError, match="did you mean 'hand'"):
            kind(ARM, {"hnad": wanted})
        with pytest.raises(ArgumentError, match="weights: unknown name 'hnad'; did you mean 'hand'"):
            kind(ARM, {"hand": wanted}, {"hnad": 1.0})
        with pytest.raises(ArgumentError, match="expected no negative number"):
            kind(ARM, {"hand": wanted}, {"hand": -1.0})
        with pytest.raises(ArgumentError, match=f"{what}: 'hand'.*got shape"):
            kind(ARM, {"hand": np.zeros(5)})
        with pytest.raises(ArgumentError, match=f"{what}: got none"):
            kind(ARM, {})
