"""Motions: files read, mapped and retargeted; resampled, filtered, eased; made by formula."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.io import Motion, forward_kinematics, read_bvh
from leastaction.io.motion.capture import axis_rotation
from leastaction.models.marionette import REST, marionette
from leastaction_marionette import (
    VARIABLES,
    load_motion,
    map_joints,
    puppet_points,
    read_mapping,
    retarget,
    walk_in_place,
)
from leastaction_marionette.retargeting.geometry import euler_zyx
from marionette.motions import captured
from marionette.puppet_bvh import (
    CMU_NAMES,
    Y_UP,
    Z_UP,
    Z_UP_FACING_MINUS_X,
    Convention,
    waving,
    write_puppet,
)


@pytest.fixture
def cmu_walk() -> Path:
    return captured("cmu_02_01_walk.bvh")


# Reading and forward kinematics


@pytest.mark.parametrize("order", ["ZYX", "XYZ", "YXZ", "ZXY"])
@pytest.mark.parametrize(
    ("axes", "up", "forward"),
    [(Y_UP, "y", "z"), (Z_UP, "z", "y"), (Z_UP_FACING_MINUS_X, "z", "-x")],
)
def test_a_puppet_written_in_any_convention_comes_back(
    tmp_path: Path, order: str, axes: np.ndarray, up: str, forward: str
) -> None:
    q = waving()
    convention = Convention(axes=axes, order=order, unit=0.01)
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q, convention=convention)), heading="axis")
    assert (made.up, made.forward) == (up, forward)
    assert made.scale == pytest.approx(0.01, rel=1e-9)
    assert made.largest_error < 1e-6
    np.testing.assert_allclose(made.motion.q, q, atol=1e-8)


def test_joints_with_position_channels_use_them(tmp_path: Path) -> None:
    q = waving()
    convention = Convention(positions_everywhere=True)
    path = write_puppet(tmp_path / "a.bvh", q, convention=convention)
    shifted = path.read_text().replace("OFFSET 0.0 0.0 0.4", "OFFSET 9.0 9.0 9.0")
    path.write_text(shifted)
    np.testing.assert_allclose(retarget(read_bvh(path), heading="axis").motion.q, q, atol=1e-8)


def test_forward_kinematics_meets_the_puppet(tmp_path: Path) -> None:
    q = waving()
    capture = read_bvh(write_puppet(tmp_path / "a.bvh", q, convention=Convention(axes=Z_UP)))
    positions, rotations = forward_kinematics(capture)
    points = puppet_points(q)
    for role, name in CMU_NAMES.items():
        np.testing.assert_allclose(positions[:, capture.index(name)], points[role], atol=1e-12)
    identity = rotations @ np.swapaxes(rotations, 2, 3)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-12)


def test_the_puppet_is_the_marionette() -> None:
    model = marionette()
    assert model.dynamic == VARIABLES
    q = np.zeros((60, len(model.variables)))
    q[:, : len(VARIABLES)] = waving()
    frames = {
        "pelvis": "pelvis",
        "spine_top": "spine_top",
        "hip": "hip",
        "knee": "femur_end",
        "ankle": "foot",
        "shoulder": "shoulder",
        "elbow": "humerus_end",
        "wrist": "hand",
    }
    for name, place in puppet_points(waving()).items():
        side, _, joint = name.partition("_")
        frame = frames[name] if name in frames else side[0] + frames[joint]
        np.testing.assert_allclose(model.positions(q, [frame])[:, 0], place, atol=1e-12)


def test_layout_of_the_text_does_not_matter(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving())
    text = path.read_text()
    other = tmp_path / "b.bvh"
    changed = text.replace("\n{\n", " {\n").replace("\n", "\r\n").replace("Xrotation", "XROTATION")
    other.write_bytes(b"\xef\xbb\xbf" + changed.replace("CHANNELS", "\t CHANNELS").encode() + b"\r\n\r\n")
    np.testing.assert_array_equal(read_bvh(other).values, read_bvh(path).values)
    assert read_bvh(other).joints == read_bvh(path).joints or read_bvh(other).names == read_bvh(path).names


def test_forward_kinematics_against_pybvh(cmu_walk: Path) -> None:
    pybvh = pytest.importorskip("pybvh")
    capture = read_bvh(cmu_walk)
    expected = pybvh.read_bvh_file(str(cmu_walk)).node_positions()
    np.testing.assert_allclose(forward_kinematics(capture)[0], expected, atol=1e-10)


# Mapping


@pytest.mark.parametrize(
    "style",
    ["mixamorig:{cmu}", "mixamorig{cmu}", "plain", "sided", "biped", "blender", "poser"],
)
def test_usual_names_are_found(tmp_path: Path, style: str) -> None:
    def renamed(role: str) -> str:
        side, joint = role.split("_")
        bone = {
            "hip": "thigh",
            "knee": "shin",
            "ankle": "foot",
            "shoulder": "upper_arm",
            "elbow": "forearm",
            "wrist": "hand",
        }[joint]
        biped = {"shin": "Calf", "upper_arm": "UpperArm"}.get(bone, bone.capitalize())
        poser = {"upper_arm": "Shldr", "forearm": "ForeArm"}.get(bone, bone.capitalize())
        return {
            "plain": f"{side.capitalize()}{joint.capitalize()}",
            "sided": f"{side[0].upper()}_{joint.capitalize()}",
            "biped": f"Bip01 {side[0].upper()} {biped}",
            "blender": f"{bone}.{side[0].upper()}",
            "poser": f"{side[0]}{poser}",
        }.get(style) or style.format(cmu=CMU_NAMES[role])

    names = {role: renamed(role) for role in CMU_NAMES}
    path = write_puppet(tmp_path / "a.bvh", waving(), convention=Convention(names=names))
    capture = read_bvh(path)
    found = map_joints(capture)
    assert {role: capture.names[index] for role, index in found.items()} == names


def test_a_collar_called_shoulder_is_not_taken_for_the_shoulder(cmu_walk: Path) -> None:
    made = retarget(read_bvh(cmu_walk))
    assert made.joints["left_shoulder"] == "LeftArm"
    assert made.joints["left_hip"] == "LeftUpLeg"


def test_a_mapping_file_says_what_the_names_do_not(tmp_path: Path) -> None:
    names = dict(CMU_NAMES, left_hip="Joint_17", right_wrist="Joint 18")
    q = waving()
    bvh = write_puppet(tmp_path / "a.bvh", q, convention=Convention(names=names))
    mapping = tmp_path / "map.toml"
    mapping.write_text('[joints]\nleft_hip = "Joint_17"\nright_wrist = ["nothing", "Joint 18"]\n')
    made = retarget(read_bvh(bvh), names=read_mapping(mapping), heading="axis")
    np.testing.assert_allclose(made.motion.q, q, atol=1e-8)
    assert load_motion(bvh, mapping=mapping).retargeted.joints["left_hip"] == "Joint_17"


# Retargeting


def test_headings(tmp_path: Path) -> None:
    q = waving()
    q[:, VARIABLES.index("torso_rz")] += 0.5
    q[:, 0] = np.linspace(0.0, -3.0, len(q))
    q[:, 1] = np.linspace(0.0, 3.0, len(q))
    capture = read_bvh(write_puppet(tmp_path / "a.bvh", q))
    kept = retarget(capture, heading="axis").motion
    np.testing.assert_allclose(kept["torso_rz"], q[:, 3], atol=1e-8)
    facing = retarget(capture, heading="facing")
    assert abs(np.mean(facing.motion["torso_rz"])) < 0.02
    assert facing.turned == pytest.approx(np.rad2deg(-0.5), abs=2.0)
    travel = retarget(capture, heading="travel").motion
    assert travel["torso_tx"][-1] == pytest.approx(0.0, abs=1e-9)
    assert travel["torso_ty"][-1] == pytest.approx(3.0 * np.sqrt(2.0))
    np.testing.assert_allclose(travel["torso_rz"], q[:, 3] - np.pi / 4.0, atol=1e-8)
    still = retarget(capture, heading="travel", in_place=True).motion
    assert np.max(np.abs(still["torso_ty"])) < 1e-9
    # Only the place is taken out, never the pose.
    np.testing.assert_array_equal(still.q[:, 2:], travel.q[:, 2:])


def test_axes_can_be_given(tmp_path: Path) -> None:
    q = waving()
    capture = read_bvh(write_puppet(tmp_path / "a.bvh", q))
    made = retarget(capture, up="y", forward="x", heading="axis").motion
    np.testing.assert_allclose(made["torso_rz"], q[:, 3] - np.pi / 2.0, atol=1e-8)


def test_a_limb_that_straightens_keeps_its_twist(tmp_path: Path) -> None:
    """At zero bend the plane of the bend says nothing; the twist must not jump there."""
    q = waving(200, 0.01)
    phase = np.linspace(0.0, 4.0 * np.pi, 200)
    for name in ("lknee_rx", "rknee_rx"):
        q[:, VARIABLES.index(name)] = -0.4 * (1.0 - np.cos(phase))
    for name in ("lelbow_rx", "relbow_rx"):
        q[:, VARIABLES.index(name)] = 0.4 * (1.0 - np.cos(phase))
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q)), heading="axis")
    np.testing.assert_allclose(made.motion.q, q, atol=1e-6)


def test_a_limb_that_never_bends_takes_its_twist_from_the_joint(tmp_path: Path) -> None:
    q = waving()
    for column, name in enumerate(VARIABLES):
        if "knee" in name or "elbow" in name:
            q[:, column] = 0.0
        elif "torso" not in name:
            q[:, column] -= np.mean(q[:, column])
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q)), heading="axis")
    assert made.largest_error < 1e-6
    assert np.max(np.abs(made.motion.q - q)) < 0.1


def test_joints_bent_the_wrong_way_stop_at_straight(tmp_path: Path) -> None:
    q = waving()
    knee, elbow = VARIABLES.index("lknee_rx"), VARIABLES.index("relbow_rx")
    over = 0.05 * np.sin(np.linspace(0.0, 6.0, len(q)))
    q[:, knee] = -0.3 + 7.0 * over
    q[:, elbow] = 0.3 + 7.0 * over
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", q)), heading="axis")
    assert np.max(made.motion["lknee_rx"]) == 0.0
    assert np.min(made.motion["relbow_rx"]) == 0.0
    np.testing.assert_allclose(made.motion["lknee_rx"], np.minimum(q[:, knee], 0.0), atol=1e-6)
    # What cannot be followed is reported: 0.35 - 0.3 rad.
    assert made.errors["left_shin"].max() == pytest.approx(np.rad2deg(q[:, knee].max()), rel=1e-3)


def test_angles_stay_continuous_over_full_turns_and_gimbal_lock() -> None:
    angle = np.linspace(0.0, 4.0 * np.pi, 400)
    np.testing.assert_allclose(euler_zyx(axis_rotation(2, angle))[:, 0], angle, atol=1e-12)
    tilt = np.linspace(0.0, np.pi, 401)  # through ry = 90 degrees, exactly
    turns = axis_rotation(2, np.full(401, 0.3)) @ axis_rotation(1, tilt)
    angles = euler_zyx(turns)
    rebuilt = axis_rotation(2, angles[:, 0]) @ axis_rotation(1, angles[:, 1]) @ axis_rotation(0, angles[:, 2])
    np.testing.assert_allclose(rebuilt, turns, atol=1e-7)
    np.testing.assert_allclose(angles, np.stack([0 * tilt + 0.3, tilt, 0 * tilt], 1), atol=1e-6)


def test_a_calibration_pose_before_the_motion_is_left_out(tmp_path: Path) -> None:
    q = waving()
    spread = np.zeros((1, len(VARIABLES)))
    spread[0, VARIABLES.index("lshoulder_ry")] = 1.57
    spread[0, VARIABLES.index("rshoulder_ry")] = -1.57
    made = retarget(read_bvh(write_puppet(tmp_path / "a.bvh", np.vstack([spread, q]))))
    assert made.first_frame == 1
    assert made.motion.t.size == len(q)
    assert retarget(read_bvh(write_puppet(tmp_path / "b.bvh", q))).first_frame == 0


def test_the_walk_of_the_capture_database(cmu_walk: Path) -> None:
    made = retarget(read_bvh(cmu_walk))
    assert made.motion.q.shape == (343, 22)
    assert (made.up, made.forward) == ("y", "z")
    assert made.largest_error < 1.0
    # A frame is 1/120 s: nothing in a walk turns at more than 10 rad/s.
    jumps = np.max(np.abs(np.diff(made.motion.q, axis=0)), axis=0)
    assert np.max(jumps) < 10.0 / 120.0
    assert made.motion["torso_ty"][-1] > 2.0
    assert np.all(made.motion["lknee_rx"] <= 0.0)
    assert np.all(made.motion["relbow_rx"] >= 0.0)
    # The legs swing in opposition, and each arm with the other side's leg.
    left, right = made.motion["lhip_rx"], made.motion["rhip_rx"]
    assert np.corrcoef(left, right)[0, 1] < -0.8
    # The walker's left elbow bends as the left leg goes back.
    assert np.corrcoef(made.motion["lelbow_rx"], right - left)[0, 1] > 0.5


def test_the_capture_becomes_a_reference_motion(cmu_walk: Path) -> None:
    reference = load_motion(cmu_walk, dt=0.01)
    motion, raw = reference.motion, reference.retargeted.motion
    np.testing.assert_allclose(np.diff(motion.t), 0.01, atol=1e-12)
    assert motion.duration == pytest.approx(raw.duration + 0.25, abs=0.011)
    np.testing.assert_allclose(motion.q[0], raw.q[0], atol=2e-2)
    assert np.max(np.abs(motion.q[1] - motion.q[0])) < 1e-4
    assert "343 frames" in reference.summary()
    moving = load_motion(cmu_walk, dt=0.01, start="moving").motion
    assert np.max(np.abs(moving.q[1] - moving.q[0])) > 1e-2
    ten = load_motion(cmu_walk, dt=0.01, duration=10.0).motion
    assert ten.t.size == 1001
    assert ten["torso_ty"][-1] > 9.0
    rate = np.max(np.abs(np.diff(ten.q, axis=0)), axis=0)
    assert np.all(rate < 1.2 * np.max(np.abs(np.diff(moving.q, axis=0)), axis=0) + 1e-3)


# Motion


def sine(n: int = 201, dt: float = 0.01, frequency: float = 1.0) -> Motion:
    t = dt * np.arange(n)
    phase = 2.0 * np.pi * frequency * t
    return Motion(("torso_tx", "lknee_rx"), t, np.stack([0.5 * t, np.sin(phase)], 1), "a sine")


def test_resampling_follows_the_motion() -> None:
    motion = sine().resample(0.003)
    np.testing.assert_allclose(np.diff(motion.t), 0.003, atol=1e-12)
    np.testing.assert_allclose(motion["lknee_rx"], np.sin(2.0 * np.pi * motion.t), atol=1e-6)
    assert sine().resample(0.01, duration=1.0).t.size == 101
    with pytest.raises(ArgumentError, match="loop"):
        sine().resample(0.01, duration=2.5)


def test_the_filter_takes_noise_and_leaves_the_motion(rng: np.random.Generator) -> None:
    clean = sine(401)
    noisy = Motion(clean.names, clean.t, clean.q + 0.05 * rng.standard_normal(clean.q.shape))
    error = noisy.low_pass(6.0).q - clean.q
    assert np.std(error) < 0.5 * 0.05
    # No phase shift: a lag of one sample would leave 0.06.
    assert np.max(np.abs(clean.low_pass(6.0).q - clean.q)) < 0.01
    buzz = Motion(clean.names, clean.t, clean.q + np.sin(2.0 * np.pi * 30.0 * clean.t)[:, None])
    inner = slice(50, -50)
    assert np.max(np.abs(buzz.low_pass(6.0).q - clean.q)[inner]) < 0.01
    assert clean.low_pass(1000.0) is clean


def test_easing_starts_and_stops_without_leaving_the_path() -> None:
    motion = sine()
    eased = motion.ease_in(0.6).ease_out(0.4)
    assert eased.duration == pytest.approx(2.0 + 0.3 + 0.2)
    np.testing.assert_allclose(eased.q[[0, -1]], motion.q[[0, -1]], atol=1e-12)
    assert np.max(np.abs(eased.velocity()[[0, -1]])) < 1e-3
    # torso_tx = t / 2 tells the time that has passed in the motion itself.
    own = 2.0 * eased["torso_tx"]
    np.testing.assert_allclose(eased["lknee_rx"], np.sin(2.0 * np.pi * own), atol=1e-6)
    assert np.all(np.diff(own) >= 0.0)
    np.testing.assert_allclose(own[80:200], eased.t[80:200] - 0.3, atol=1e-3)
    with pytest.raises(ArgumentError, match="twice the duration"):
        motion.ease_in(5.0)


def test_leading_in_from_a_pose_at_rest() -> None:
    motion = sine()
    led = motion.lead_in({"lknee_rx": -0.4}, 0.5)
    assert led.duration == pytest.approx(2.5)
    np.testing.assert_allclose(led.q[0], [0.0, -0.4])
    velocity = led.velocity()
    assert np.max(np.abs(velocity[0])) < 3e-3
    np.testing.assert_allclose(velocity[50], [0.5, 2.0 * np.pi], atol=1e-3)
    np.testing.assert_array_equal(led.q[50:], motion.q)


def test_looping_repeats_the_cycle_and_goes_on_travelling() -> None:
    looped = sine(261).loop(7.3)
    assert looped.duration == pytest.approx(7.3)
    np.testing.assert_allclose(looped["torso_tx"], 0.5 * looped.t, atol=1e-9)
    cycle = looped["lknee_rx"]
    np.testing.assert_allclose(cycle[100:], cycle[:-100], atol=1e-9)
    assert np.max(np.abs(np.diff(cycle))) < 2.0 * np.pi * 0.01 * 1.01
    assert sine(261).loop(1.0).duration == pytest.approx(1.0)
    with pytest.raises(ArgumentError, match="must fit"):
        sine().loop(5.0, shortest=3.0)


def test_a_loop_is_not_made_of_standing_still() -> None:
    moving = sine(261)
    stand = moving.t[-1] + 0.01 * np.arange(1, 151)
    q = np.concatenate([moving.q, np.tile(moving.q[-1], (150, 1))])
    looped = Motion(moving.names, np.concatenate([moving.t, stand]), q).loop(8.0)
    assert np.ptp(looped["lknee_rx"][400:]) > 1.9


def test_values_by_name_and_in_degrees() -> None:
    motion = sine()
    assert motion.angle_names == ("lknee_rx",)
    np.testing.assert_allclose(motion.angles_in_degrees()["lknee_rx"], np.rad2deg(motion.q[:, 1]))
    np.testing.assert_array_equal(motion.columns(["lknee_rx", "torso_tx"]), motion.q[:, ::-1])
    with pytest.raises(ArgumentError, match="did you mean 'lknee_rx'"):
        motion["lkne_rx"]
    with pytest.raises(ValueError, match="read-only"):
        motion.q[0, 0] = 1.0


# The walk made by formula


def test_the_walk_in_place_is_one_a_puppet_can_nearly_do() -> None:
    walk = walk_in_place()
    assert walk.names == VARIABLES
    assert walk.q.shape == (1001, 22)
    for end in (0, -1):
        pose = dict(zip(walk.names, walk.q[end], strict=True))
        assert pose == pytest.approx({name: REST.get(name, 0.0) for name in VARIABLES})
    velocity = walk.velocity()
    acceleration = np.gradient(velocity, walk.t, axis=0)
    assert np.max(np.abs(velocity[[0, -1]])) < 1e-3
    assert np.max(np.abs(acceleration[[0, -1]])) < 0.05
    for side in "lr":
        assert np.all(walk[f"{side}knee_rx"] < -0.3)
        assert np.all(walk[f"{side}elbow_rx"] > 1.0)
        # Shins have no string: they stay near the vertical.
        shin = walk["torso_rx"] + walk[f"{side}hip_rx"] + walk[f"{side}knee_rx"]
        assert np.max(np.abs(shin)) < 0.15
    middle = slice(200, 800)
    left, right = walk["lhip_rx"][middle], walk["rhip_rx"][middle]
    assert np.ptp(left) > 0.5
    assert np.corrcoef(left, right)[0, 1] == pytest.approx(-1.0)
    assert np.corrcoef(left, walk["lelbow_rx"][middle])[0, 1] == pytest.approx(-1.0)
    # They swing as free pendulums: J a'' + m g d a = -m d y'' about the knee, which is at y.
    swing = (walk["lhip_rx"] + walk["lknee_rx"] + walk["torso_rx"])[middle]
    turning = np.gradient(np.gradient(swing, 0.01), 0.01)
    pushed = np.gradient(np.gradient(puppet_points(walk.q)["left_knee"][middle, 1], 0.01), 0.01)
    weight = 1.5 * 0.2
    drive = -weight * pushed
    balance = 0.36 * turning + weight * 9.81 * (swing - np.mean(swing)) - drive
    assert np.std(balance[5:-5]) < 0.25 * np.std(drive[5:-5])
    # No string can push: the knees never fall faster than half of gravity.
    knee = puppet_points(walk.q)["left_knee"][:, 2]
    assert np.max(np.abs(np.diff(knee, 2))) / 0.01**2 < 0.5 * 9.81


def test_the_walk_follows_its_options() -> None:
    walk = walk_in_place(4.0, 0.02, cadence=0.5, stride=0.2, ramp=1.0, rest={"lhip_rx": 0.5})
    assert walk.q.shape == (201, 22)
    assert np.max(np.abs(walk["lhip_rx"] - 0.5)) == pytest.approx(0.2, rel=0.02)
    assert np.max(np.abs(walk_in_place(stride=0.0)["lknee_rx"] + 0.97)) == 0.0
