"""The package's own mechanisms are what they say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from leastaction.errors import ArgumentError
from leastaction.mechanics import check_consistent
from leastaction.models import MODELS, build
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.chain import pendulum_chain
from leastaction.models.hand import FINGERS, TENDONS, TRAVEL, hand, posture, tendon_lengths
from leastaction.models.marionette import STRINGS, hang_strings, marionette, rest_pose
from leastaction.models.puppet_arm import STRING, hang, puppet_arm
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction_marionette.retargeting.skeleton import VARIABLES, Proportions


@pytest.mark.parametrize("name", MODELS)
def test_every_model_builds_and_prints(name):
    mechanism = build(name)
    assert mechanism.nd > 0
    assert np.linalg.eigvalsh(mechanism.mass_matrix(np.full(mechanism.nq, 0.3)))[0] > -1e-12
    assert str(mechanism).startswith("world\n")


def test_an_unknown_model_is_named():
    with pytest.raises(ArgumentError, match=r"'marionete'.*mean 'marionette'"):
        build("marionete")


def test_the_cart_has_one_input_or_two():
    assert cart_pendulum().inputs == ("x-force",)
    assert cart_pendulum(pivot_torque=True).inputs == ("x-force", "theta-force")
    assert cart_pendulum(length=2.0).positions([0.5, 0.0], ["bob"]).tolist() == [[0.5, -2.0, 0.0]]


@pytest.mark.parametrize("links", [1, 7, np.int64(3)])
def test_the_chain_has_as_many_links_as_asked(links):
    mechanism = pendulum_chain(links)
    assert mechanism.nd == links
    tip = mechanism.positions(np.zeros(links), [f"end{links - 1}"])
    np.testing.assert_allclose(tip, [[0.0, 0.0, -float(links)]])


@pytest.mark.parametrize("links", [0, -1, 2.0, "3", True, None])
def test_a_chain_of_no_whole_number_of_links_is_refused(links):
    with pytest.raises(ArgumentError, match="whole number"):
        pendulum_chain(links)


def test_the_marionette_has_the_variables_of_the_dissertation():
    mechanism = marionette()
    assert (mechanism.nd, mechanism.nrho, mechanism.nu, mechanism.nc) == (22, 18, 0, 6)
    assert mechanism.dynamic == VARIABLES
    assert mechanism.constraints == tuple(string.name for string in STRINGS)
    assert mechanism.kinematic[:3] == (
        "right_leg_string-x",
        "right_leg_string-y",
        "right_leg_string-length",
    )
    assert mechanism.degrees_of_freedom(rest_pose(mechanism)) == 16
    total = sum(body.mass for _, body, _ in mechanism.tree.bodies())
    assert total == pytest.approx(10.0 + 4 * 1.5 + 4 * 0.5 + 0.75)


def test_the_marionette_has_the_proportions_that_motions_are_fitted_to():
    mechanism, sizes = marionette(), Proportions()
    at = dict(zip(mechanism.frames, mechanism.positions(np.zeros(mechanism.nq)), strict=True))
    np.testing.assert_allclose(at["lhip"], sizes.attachment("left", "leg"), atol=1e-12)
    np.testing.assert_allclose(at["rshoulder"], sizes.attachment("right", "arm"), atol=1e-12)
    assert at["lfoot"][2] == pytest.approx(-sizes.thigh - sizes.shin)
    assert at["rhand"][2] == pytest.approx(sizes.spine - sizes.upper_arm - sizes.forearm)


def test_left_and_right_of_the_marionette_are_mirror_images():
    mechanism = marionette()
    at = dict(zip(mechanism.frames, mechanism.positions(rest_pose(mechanism)), strict=True))
    for name in ("hip", "femur_end", "foot_end", "shoulder", "hand_end"):
        np.testing.assert_allclose(at[f"l{name}"] * [-1, 1, 1], at[f"r{name}"], atol=1e-12)


def test_strings_hang_straight_above_their_hooks():
    mechanism = marionette()
    q = rest_pose(mechanism)
    check_consistent(mechanism, q, tolerance=1e-13)
    batch = np.tile(mechanism.configuration(), (5, 1))
    batch[:, : mechanism.nd] = 0.2 * np.random.default_rng(0).normal(size=(5, mechanism.nd))
    hung = hang_strings(mechanism, batch)
    assert np.abs(mechanism.constraint_values(hung)).max() < 1e-13
    np.testing.assert_array_equal(hung[:, : mechanism.nd], batch[:, : mechanism.nd])
    np.testing.assert_allclose(hang_strings(mechanism, batch[2]), hung[2], rtol=1e-15)
    values = mechanism.named(hung[1])
    for string in STRINGS:
        hook, control = mechanism.positions(hung[1], [string.hook, string.control])
        np.testing.assert_allclose(control - hook, [0, 0, values[string.length]], atol=1e-15)


def test_the_rest_pose_is_in_balance_and_every_string_is_taut():
    mechanism = marionette()
    q, nd = rest_pose(mechanism), mechanism.nd
    force = mechanism.core.gradient(q, np.zeros(mechanism.nq))[0][:nd]
    jacobian = mechanism.constraint_jacobian(q)
    multiplier = np.linalg.lstsq(jacobian[:, :nd].T, force, rcond=None)[0]
    np.testing.assert_allclose(jacobian[:, :nd].T @ multiplier, force, atol=1e-10)
    # The strings exert -Dh^T lam; on its own length, that is the pull to let it out: the tension.
    tensions = [
        -multiplier[i] * jacobian[i, mechanism.variables.index(string.length)] for i, string in enumerate(STRINGS)
    ]
    assert min(tensions) > 2.0
    assert sum(tensions) == pytest.approx(9.8 * 18.75, rel=1e-12)


def test_a_puppet_above_its_strings_is_refused():
    mechanism = marionette()
    with pytest.raises(ArgumentError, match=r"upper_torso_string.*torso_tz"):
        hang_strings(mechanism, mechanism.configuration({"torso_tz": 1.6}))
    rows = np.stack([mechanism.configuration(), mechanism.configuration({"torso_tz": 1.6})])
    with pytest.raises(ArgumentError, match="row 1"):
        hang_strings(mechanism, rows)


@pytest.mark.parametrize("segments", [1, 2, 5])
def test_a_scissor_lift_has_one_degree_of_freedom(segments):
    mechanism = scissor_lift(segments, length=0.8)
    assert (mechanism.nd, mechanism.nc) == (2 * segments + 1, 2 * segments)
    q, v = at_angle(mechanism, 0.7, 0.3)
    check_consistent(mechanism, q)
    assert np.abs(mechanism.constraint_jacobian(q) @ v).max() < 1e-12
    assert mechanism.degrees_of_freedom(q) == 1
    bottom = mechanism.positions(q, [f"end_L{segments - 1}"])[0]
    assert bottom[2] == pytest.approx(-segments * 0.8 * np.sin(0.7))
    # In line its pins lose rank.
    assert mechanism.constraint_rank(at_angle(mechanism, np.pi / 2)[0]) < mechanism.nc
    with pytest.raises(ArgumentError, match=r"scissor_lift\(\)"):
        at_angle(pendulum_chain(2), 0.7)


def test_the_arm_hangs_from_its_string():
    mechanism = puppet_arm(upper=0.3, fore=0.2)
    assert (mechanism.dynamic, mechanism.kinematic) == (("shoulder", "elbow"), STRING)
    q = hang(mechanism, [[0.2, 0.5], [1.0, 0.3]])
    for row in q:
        check_consistent(mechanism, row)
    np.testing.assert_allclose(mechanism.positions(np.zeros(4), ["hand"]), [[0.0, -0.5, 0.0]], atol=1e-15)
    np.testing.assert_allclose(mechanism.positions(q[1], ["carriage"])[0, 0], mechanism.positions(q[1], ["hand"])[0, 0])
    with pytest.raises(ArgumentError, match="above the carriage"):
        hang(puppet_arm(height=0.1), [np.pi, 0.0])


def levers(mechanism, q):
    """Return what the tendons do to the joints, (16, 25): how their lengths fall, by differences."""
    rows = []
    for step in 1e-6 * np.eye(mechanism.nq):
        more, less = (np.array(list(tendon_lengths(mechanism, q + sign * step).values())) for sign in (1.0, -1.0))
        rows.append((less - more) / 2e-6)
    return np.array(rows)


def test_the_hand_has_the_joints_and_tendons_of_the_dissertation_or_25_of_each():
    mechanism = hand()
    assert (mechanism.nd, mechanism.nu, mechanism.nc) == (16, 25, 0)
    assert mechanism.inputs == tuple(f"{finger}.{tendon}" for finger in FINGERS for tendon in TENDONS)
    assert mechanism.variables[-3:] == ("little.mcp", "little.pip", "little.dip")
    assert sum(1 for _ in mechanism.tree.bodies()) == 15
    assert hand(tendons=False).inputs == mechanism.variables
    wide = hand(joints=25)
    assert (wide.nd, wide.nu) == (25, 25)
    assert wide.inputs == mechanism.inputs
    assert {"index.cmc", "index.mcp.side", "thumb.dip"} < set(wide.variables)
    assert hand(joints=25, tendons=False).nu == 25
    with pytest.raises(ArgumentError, match="joints: got 15, expected 16 or 25"):
        hand(joints=15)


@pytest.mark.parametrize("closed", [0.0, 0.5, 1.0])
def test_tendons_that_only_pull_can_turn_every_joint_of_a_finger_by_itself_and_hold_the_hand(closed):
    mechanism = hand()
    q = posture(mechanism, closed)
    arms = levers(mechanism, q)
    # What a tendon of a newton does is its lever times the factor of its muscle, which is 1 in the half-closed hand.
    forces = mechanism.force(q, np.zeros(16), np.zeros(25)).value
    for name, arm in zip(mechanism.inputs, arms.T, strict=True):
        pulled = mechanism.force(q, np.zeros(16), np.eye(25)[mechanism.inputs.index(name)]).value - forces
        factor = arm @ pulled / (arm @ arm)
        np.testing.assert_allclose(pulled, factor * arm, atol=1e-8)
        assert factor == pytest.approx(1.0, abs=1e-6) if closed == 0.5 else 0.5 < factor < 1.0
    index = [mechanism.variables.index(f"index.{joint}") for joint in ("mcp", "pip", "dip")]
    for joint in np.eye(3):
        for way in (1.0, -1.0):
            assert nnls(arms[index], 1e-3 * way * joint)[1] < 1e-9
    weight = mechanism.potential(q).gradient
    assert nnls(arms, weight)[1] < 1e-9
    # With the same lever at every joint, as in the hand of 25 joints, a straight finger cannot be held level.
    wide = hand(joints=25)
    straight = np.zeros(25)
    pull = np.array(
        [
            wide.force(straight, straight, unit).value - wide.force(straight, straight, 0.0 * unit).value
            for unit in np.eye(25)
        ]
    ).T
    assert nnls(pull, wide.potential(straight).gradient)[1] > 1e-3


def test_the_joints_of_the_hand_have_stops():
    mechanism = hand(tendons=False)
    for name, (low, high) in TRAVEL.items():
        i = mechanism.variables.index(name if name in mechanism.variables else f"ring.{name}")
        for end, way in ((low, -1.0), (high, 1.0)):
            inside, at, beyond = (
                way * mechanism.potential(np.eye(16)[i] * (end + way * room), element=f"{mechanism.variables[i]} flesh")
                .gradient[i]
                for room in (-0.3, 0.0, 0.25)
            )  # fmt: skip
            assert abs(inside) < 0.05 < 0.5 < beyond
            assert inside < at < beyond
