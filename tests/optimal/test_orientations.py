"""How frames are turned: prices and limits, against SciPy's rotations and differences of what these say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction import (
    ContinuousQuadraticCost,
    Gravity,
    JointForce,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    ry,
    rz,
    tz,
)
from leastaction.costs import OrientationCost
from leastaction.errors import ArgumentError
from leastaction.limits import Oriented
from leastaction.numerics import rotations
from leastaction.numerics.differences import fourth_order
from leastaction.optimal import Status, check_derivatives
from leastaction.optimal.quantity import Samples
from leastaction.systems.orientations import MissingTurn, TurnedFrame
from leastaction.systems.oriented import TurnOfFrame

INERTIA = {"mass": 0.5, "inertia": (2e-3, 3e-3, 4e-3)}


def wrist():
    """An arm whose hand turns about three axes, with a motor at each joint."""
    tree = (
        rx("a", name="upper", **INERTIA),
        [tz(0.3), [ry("b", name="fore", **INERTIA), [tz(0.2), [rz("c", name="hand", **INERTIA)]]]],
    )
    return Mechanism(list(tree), [Gravity(), *(JointForce(joint, input=f"{joint} motor") for joint in "abc")])


def turned(axis, angle):
    return Rotation.from_rotvec(angle * np.asarray(axis) / np.linalg.norm(axis))


WANTED = turned([1.0, -2.0, 0.5], 1.1)


def missing(m, q):
    """What SciPy says of the rotation that is missing."""
    return (WANTED.inv() * Rotation.from_matrix(m.frame_pose(q, "hand")[:3, :3])).as_rotvec()


def test_quaternions_of_matrices_are_those_of_scipy():
    rng = np.random.default_rng(0)
    vectors = np.concatenate([rng.standard_normal((50, 3)), np.pi * np.eye(3), -np.pi * np.eye(3), np.zeros((1, 3))])
    R = Rotation.from_rotvec(vectors)
    found = rotations.of_matrix(R.as_matrix())
    theirs = np.roll(R.as_quat(), 1, axis=1)
    assert np.abs(np.sum(found * theirs, axis=1)) == pytest.approx(1.0, abs=1e-15)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0, abs=1e-15)


def test_the_missing_rotation_and_its_derivatives_are_those_of_differences():
    m, rng = wrist(), np.random.default_rng(1)
    turn = MissingTurn(TurnedFrame(m, "hand"), rotations.of_matrix(WANTED.as_matrix())[None])
    far = np.array([[0.3, -0.4, 0.7], [1.9, 0.6, -2.0], [2.0, -0.8, 1.0]])
    q = np.concatenate([far, rng.uniform(-1, 1, (3, 3))])
    w = rng.standard_normal((6, 3))
    e = turn.values(q)
    J, H = turn.jacobian(q, e), turn.bent(q, e, w)
    assert np.linalg.norm(e, axis=1).max() > 2.3
    for i in range(6):
        assert e[i] == pytest.approx(missing(m, q[i]), abs=1e-14)
        for j, step in enumerate(np.eye(3)):
            slope = fourth_order(lambda by, i=i, step=step: missing(m, q[i] + by * step), 1e-3)
            assert J[i, :, j] == pytest.approx(slope, abs=1e-10)

            def slopes(by, i=i, step=step):
                moved = (q[i] + by * step)[None]
                return w[i] @ turn.jacobian(moved, turn.values(moved))[0]

            assert H[i, j] == pytest.approx(fourth_order(slopes, 1e-3), abs=1e-9)


@pytest.mark.parametrize("within", [None, 0.3])
def test_a_limit_on_it_has_right_derivatives(within):
    m, rng = wrist(), np.random.default_rng(2)
    limit = Oriented("hand", WANTED.as_matrix(), within=within)
    quantity = TurnOfFrame(m, np.zeros(5), limit)
    x, y = rng.uniform(-1, 1, (4, 6)), rng.standard_normal((4, 1 if within else 3))

    def at(q):
        return Samples(np.arange(4), np.hstack([q, x[:, 3:]]), np.empty((4, 0)), np.empty((4, 0)))

    q = x[:, :3]
    J, H = quantity.jacobian(at(q)), quantity.curvature(at(q), y)
    for j, step in enumerate(np.eye(3)):
        slope = fourth_order(lambda by, step=step: quantity.values(at(q + by * step)), 1e-3)
        np.testing.assert_allclose(J[:, :, j], slope, atol=1e-9)
        slope = fourth_order(
            lambda by, step=step: np.einsum("km,kmi->ki", y, quantity.jacobian(at(q + by * step))), 1e-3
        )
        np.testing.assert_allclose(H[:, j], slope, atol=1e-8)


@pytest.fixture
def problem():
    system = MidpointSystem(MidpointVI(wrist()), np.linspace(0.0, 0.6, 31))
    plain = QuadraticCost(np.zeros((31, 6)), np.zeros((30, 3)), Q=np.full(6, 1e-4), R=np.full(3, 1e-2))
    return system, plain, (np.zeros(6), np.zeros((30, 3)))


def test_a_price_on_it_keeps_to_its_derivatives_and_turns_the_hand(problem):
    system, plain, initial = problem
    half = np.tile(WANTED.as_matrix(), (31, 1, 1))
    cost = OrientationCost(plain, system, {"hand": half, "fore": lambda t: turned([0, 1, 0], t).as_matrix()},
                           {"hand": [20.0, 20.0, 10.0], "fore": 1e-3})  # fmt: skip
    rng = np.random.default_rng(3)
    run = system.rollout(np.r_[0.1, 0.2, -0.3, np.zeros(3)], np.zeros((31, 6)), 0.1 * rng.standard_normal((30, 3)),
                         np.zeros((30, 3, 6)), 0, 30)  # fmt: skip
    assert check_derivatives(cost, run.x, run.u).ok
    found = optimize(system, cost, initial=initial)
    assert found.status is Status.CONVERGED
    off = [np.linalg.norm(missing(system.mechanism, q)) for q in found.x[:, :3]]
    assert off[0] > 1.0
    assert off[-1] < 0.1
    window = cost.window(10, 20, N=30, nu=3)
    assert check_derivatives(window, found.x[10:21], found.u[10:20]).ok
    # What a price is, by SciPy.
    alone = OrientationCost(plain, system, {"hand": WANTED.as_matrix()}, {"hand": 2.0})
    expected = plain.value(found.x, found.u) + sum(angle**2 for angle in off)
    assert alone.value(found.x, found.u) == pytest.approx(expected, rel=1e-12)


def test_a_unit_quaternion_is_a_rotation_as_its_matrix_is(problem):
    system, plain, initial = problem
    turns = WANTED * Rotation.from_rotvec(np.outer(np.linspace(0.0, 1.0, 31), [0.3, 0.2, -0.5]))
    quaternions = np.roll(turns.as_quat(), 1, axis=1)
    pairs = [
        (turns.as_matrix(), quaternions), (turns[3].as_matrix(), quaternions[3]),
        (lambda t: turns[0].as_matrix() + 0.0 * t, lambda t: -quaternions[0] + 0.0 * t),
    ]  # fmt: skip
    x, u = initial[0] + 0.1, initial[1]
    states = np.tile(x, (31, 1))
    for matrix, quaternion in pairs:
        values = [OrientationCost(plain, system, {"hand": each}).value(states, u) for each in (matrix, quaternion)]
        assert values[0] == pytest.approx(values[1], rel=1e-13)
    for wrong, match in (
        ([2.0, 0.0, 0.0, 0.0], "got a quaternion of length 2, expected 1"),
        (np.zeros((31, 3)), r"got shape \(31, 3\), expected \(3, 3\) or \(4,\) or .*unit quaternion, scalar first"),
        (lambda t: [1.0, t, 0.0, 0.0], "'hand': got a quaternion of length 1.16619"),
    ):
        with pytest.raises(ArgumentError, match=match):
            OrientationCost(plain, system, {"hand": wrong})


def test_an_orientation_is_met_at_the_end_and_kept_to_within_an_angle(problem):
    system, plain, initial = problem
    met = optimize(system, plain, initial=initial, limits=[Oriented("hand", WANTED.as_matrix(), at="end")])
    assert met.status is Status.CONVERGED, met.message
    assert np.linalg.norm(missing(system.mechanism, met.x[-1, :3])) < 1e-7

    def turning(t):
        return turned([1, 0, 0], 2.0 * t).as_matrix()

    kept = optimize(system, plain, initial=initial, limits=[Oriented("hand", turning, within=0.1)])
    assert kept.status is Status.CONVERGED, kept.message
    poses = system.mechanism.frame_pose(kept.x[:, :3], "hand")[:, :3, :3]
    apart = (Rotation.from_matrix([turning(t) for t in system.t]).inv() * Rotation.from_matrix(poses)).magnitude()
    assert apart[1:].max() == pytest.approx(0.1, abs=1e-5)
    assert np.sum(apart > 0.0999) > 5  # it costs less to stay behind


def test_an_orientation_is_met_in_continuous_time():
    system = MechanismSystem(wrist())
    cost = ContinuousQuadraticCost(np.zeros(6), np.zeros(3), Q=np.full(6, 1e-3), R=np.full(3, 1e-2))
    found = optimize(system, cost, initial=(np.zeros(6), np.zeros(3)), horizon=(0.0, 0.6),
                     limits=[Oriented("hand", WANTED.as_matrix(), at="end")])  # fmt: skip
    assert found.success, found.message
    assert np.linalg.norm(missing(system.mechanism, found.x[-1, :3])) < 1e-6


def test_what_is_no_orientation_is_told(problem):
    system, plain, initial = problem
    with pytest.raises(ArgumentError, match="rotation: got a matrix that is no rotation"):
        optimize(system, plain, initial=initial, limits=[Oriented("hand", np.diag([1.0, 1.0, -1.0]))])
    with pytest.raises(ArgumentError, match=r"Oriented\('hand'\): within: got 4"):
        Oriented("hand", np.eye(3), within=4.0)
    with pytest.raises(ArgumentError, match="hnad"):
        optimize(system, plain, initial=initial, limits=[Oriented("hnad", np.eye(3))])
    with pytest.raises(ArgumentError, match="weights: 'fore' has no orientation"):
        OrientationCost(plain, system, {"hand": np.eye(3)}, {"fore": 1.0})
    with pytest.raises(ArgumentError, match="expected no negative number"):
        OrientationCost(plain, system, {"hand": np.eye(3)}, {"hand": [1.0, -1.0, 0.0]})
