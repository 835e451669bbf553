"""From a captured motion to the puppet's joint angles.

The puppet has other proportions than the captured person, so what is carried over is the direction of every bone. A
limb's two bones, with directions a (upper) and b (lower), fix its four angles: the upper bone's frame has z = -a and
its hinge axis x along +-(a x b), so both directions come out exactly, whatever the angle of the hinge. Only where a
limb is nearly straight does a x b say nothing about the twist; there the axis is taken from the captured joint's own
orientation, in whose frame the hinge of a real knee or elbow hardly moves.

The torso is one body in the puppet: its z runs from between the hips to between the shoulders, its x
half along the hips and half along the shoulders.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from leastaction.errors import MotionFileError
from leastaction.io import Capture, Motion, axis_rotation, forward_kinematics
from leastaction.numerics import Array, as_choice
from leastaction_marionette.choices import Axes, Axis, Heading
from leastaction_marionette.retargeting.captured_markers import captured_markers
from leastaction_marionette.retargeting.geometry import (
    angle_between,
    euler_zyx,
    frame,
    quaternions,
    rotation_zyx,
    smooth_step,
    unit,
)
from leastaction_marionette.retargeting.heading import (
    forward_axis,
    heading_angle,
    leg_length,
    right,
    straightened,
    up_axis,
    world_from,
)
from leastaction_marionette.retargeting.mapping import JointNames, map_joints, more_joints
from leastaction_marionette.retargeting.skeleton import (
    BEND,
    CHAINS,
    COORDINATES,
    LIMBS,
    VARIABLES,
    Limb,
    Proportions,
    placed,
)
from leastaction_marionette.retargeting.spins import beside, without_spins

# Sine of the bend below which a limb's twist comes from the captured joint's orientation, and above
# which it comes from the plane of the bend: 1 and 5 degrees.
_STRAIGHT, _BENT = 0.017, 0.087


@dataclass(frozen=True, eq=False)
class Retargeted:
    """A capture in the puppet's variables, and how well they follow it.

    Attributes
    ----------
    motion : Motion
        The puppet's 22 variables at the capture's frames, or 27 coordinates.
    joints : mapping of role to name
        Which joint of the capture played which role.
    up, forward : str
        The capture's axes that point up and forward, such as ``"y"`` or ``"-x"``.
    scale : float
        Metres of the puppet for one unit of length of the capture.
    turned : float
        Degrees by which the capture was turned about the vertical so that it heads to +y, after
        its forward axis had been laid on +y.
    first_frame : int
        First frame used: 1 where the capture begins with a calibration pose, else 0.
    directions : mapping of bone to (F, 3) array
        Unit direction of every captured bone in the puppet's world.
    errors : mapping of bone to (F,) array
        Angle in degrees between the puppet's bone and the captured one.
    markers : mapping of name to (F, 3) array
        Where head, hands and feet are relative to the pelvis, at the puppet's size (m).
    """

    motion: Motion
    joints: Mapping[str, str]
    up: Axis
    forward: Axis
    scale: float
    turned: float
    first_frame: int
    directions: Mapping[str, Array]
    errors: Mapping[str, Array]
    markers: Mapping[str, Array]

    @property
    def largest_error(self) -> float:
        """Largest angle in degrees between a bone of the puppet and the captured one."""
        return max(float(np.max(error)) for error in self.errors.values())


def retarget(
    capture: Capture,
    *,
    names: JointNames | None = None,
    proportions: Proportions | None = None,
    up: Axis | None = None,
    forward: Axis | None = None,
    heading: Heading = "facing",
    in_place: bool = False,
    axes: Axes = "zyx",
) -> Retargeted:
    """The puppet's variables for every frame of a capture.

    Parameters
    ----------
    capture : Capture
    names : mapping from role to joint names, optional
        See `leastaction_marionette.retargeting.mapping.map_joints`.
    proportions : Proportions, optional
        Lengths of the puppet.
    up, forward : str, optional
        Axes of the capture that point up and forward; found from the poses if not given.
    heading : {"facing", "travel", "axis", "straight"}
        What is turned to the puppet's +y: the mean direction that hips and shoulders face (that of the start, of a
        person who faces every way), the direction from the first to the last place, or just the capture's forward
        axis. "straight": as "facing", and the slow turns of a person who walks in a circle are taken out.
    in_place : bool
        Take the mean velocity over the ground out, for a walk on the spot about the origin.
    axes : {"zyx", "quaternion"}
        What the motion says of pelvis, hips and shoulders: three angles each, kept off where they would spin, or unit
        quaternions, by which bones point exactly as the capture's do; as of `leastaction.models.marionette.marionette`.

    Returns
    -------
    Retargeted
        Positions are scaled by the ratio of the leg lengths. The pelvis starts above or below the
        puppet's origin (`in_place`: is there in the mean), and its mean height is zero.

    Raises
    ------
    MotionFileError
        Joints are missing (see `map_joints`), or joints coincide that must not.
    ArgumentError
        An option that is none of those above, or axes that are not at right angles.
    """
    sizes = proportions or Proportions()
    found = map_joints(capture, names)
    positions, rotations = forward_kinematics(capture)
    first = _calibration_frames(positions, found)
    points = {role: positions[first:, index] for role, index in found.items()}
    frames = {role: rotations[first:, index] for role, index in found.items()}
    _add_middles(points)
    _check_bones(capture, found, points, first)

    up = up or up_axis(points, _at_rest(capture, found))
    forward = forward or forward_axis(points, up)
    world = world_from(up, forward)
    points = {role: place @ world.T for role, place in points.items()}
    angle = heading_angle(capture, heading, points)
    turn = axis_rotation(2, np.array(angle))
    more = {role: positions[first:, index] @ world.T for role, index in more_joints(capture, names).items()}
    points = {role: place @ turn.T for role, place in {**more, **points}.items()}
    frames = {role: turn @ world @ own for role, own in frames.items()}

    scale = sizes.leg / leg_length(points)
    t = capture.frame_time * np.arange(capture.n_frames - first, dtype=np.float64)
    as_choice(axes, "axes", get_args(Axes))
    by_angles, columns = axes == "zyx", list[Array]()
    torso = _torso(points)
    if by_angles:
        turns = beside(t, without_spins(t, euler_zyx(torso), _axes, np.swapaxes(torso[:, :, ::2], 1, 2)))
        torso, yaw = rotation_zyx(turns), turns[:, 0]
    else:
        turned = quaternions(torso)
        yaw = 2.0 * np.unwrap(np.arctan2(turned[:, 3], turned[:, 0]), period=np.pi)
    pelvis, markers, facing = scale * points["pelvis"], captured_markers(points, torso, sizes), torso
    if heading == "straight":
        straight, pelvis[:, :2] = straightened(t, yaw, pelvis[:, :2])
        back = axis_rotation(2, straight - yaw)
        facing = back @ torso
        markers = {name: np.einsum("fij,fj->fi", back, place) for name, place in markers.items()}
        yaw = straight
    columns += [_root(pelvis, in_place=in_place)]
    columns += [np.column_stack([yaw, turns[:, 1:]]) if by_angles else quaternions(facing)]
    limbs = {}
    for side, limb in LIMBS:
        own, hinge, wanted = _limb(side, limb, points, frames, torso)
        if by_angles:
            angles = beside(t, without_spins(t, np.column_stack([euler_zyx(own), hinge]), _bone_directions, wanted))
            own, hinge = rotation_zyx(angles[:, :3]), _bent(limb, angles[:, 3])
            columns += [angles[:, :3], hinge[:, None]]
        else:
            columns += [quaternions(own), hinge[:, None]]
        limbs[side, limb] = own, hinge

    directions = {bone: unit(points[b] - points[a]) for bone, (a, b) in _bones().items()}
    made = placed(np.zeros((t.size, 3)), torso, limbs, sizes)
    errors = {
        bone: np.rad2deg(angle_between(unit(made[b] - made[a]), directions[bone])) for bone, (a, b) in _bones().items()
    }
    return Retargeted(
        motion=Motion(VARIABLES if by_angles else COORDINATES, t, np.hstack(columns), source=capture.path),
        joints={role: capture.names[index] for role, index in found.items()},
        up=up,
        forward=forward,
        scale=scale,
        turned=float(np.rad2deg(angle)),
        first_frame=first,
        directions=directions,
        errors=errors,
        markers=markers,
    )


def _bones() -> dict[str, tuple[str, str]]:
    """The puppet's bones by name: from which joint to which."""
    bones = {"torso": ("pelvis", "spine_top")}
    for side, limb in LIMBS:
        root, hinge, end = (f"{side}_{joint}" for joint in CHAINS[limb])
        upper, lower = ("thigh", "shin") if limb == "leg" else ("upper_arm", "forearm")
        bones[f"{side}_{upper}"] = (root, hinge)
        bones[f"{side}_{lower}"] = (hinge, end)
    return bones


def _check_bones(capture: Capture, found: Mapping[str, int], points: Mapping[str, Array], first: int) -> None:
    leg = leg_length(points)
    across = {"hips": ("left_hip", "right_hip"), "shoulders": ("left_shoulder", "right_shoulder")}
    for bone, (a, b) in {**_bones(), **across}.items():
        length = np.linalg.norm(points[b] - points[a], axis=1)
        short = np.flatnonzero(length <= 1e-3 * leg)
        if short.size or leg == 0.0:
            number = first + 1 + (int(short[0]) if short.size else 0)
            named = [capture.names[found[role]] for role in (a, b) if role in found]
            raise MotionFileError(
                f"{capture.path}, frame {number}: the two ends of {bone} are at the same place"
                + (f" (joints {' and '.join(map(repr, named))})" if named else "")
                + "; expected a bone with a length. Map the roles to other joints (--mapping FILE)."
            )


def _calibration_frames(positions: Array, found: Mapping[str, int]) -> int:
    """1 if the capture begins with a pose that the next frame has nothing to do with, else 0.

    Some converters put the rest pose of the skeleton (arms spread) before the motion.
    """
    if positions.shape[0] < 4:
        return 0
    indices = list(found.values())
    relative = positions[:, indices] - positions[:, indices[:1]]
    moved = np.max(np.linalg.norm(np.diff(relative, axis=0), axis=2), axis=1)
    size = np.max(np.linalg.norm(relative[1], axis=1))
    return int(moved[0] > 0.15 * size and moved[0] > 5.0 * np.max(moved[1:4]))


def _at_rest(capture: Capture, found: Mapping[str, int]) -> dict[str, Array]:
    """Where the joints of the skeleton are before it is posed, (1, 3) by role."""
    places: list[Array] = []
    for joint in capture.joints:
        places.append(np.array(joint.offset) + (places[joint.parent] if joint.parent >= 0 else 0.0))
    points = {role: places[index][None, :] for role, index in found.items()}
    _add_middles(points)
    return points


def _add_middles(points: dict[str, Array]) -> None:
    """Add what is between the hips, and between the shoulders."""
    points["pelvis"] = 0.5 * (points["left_hip"] + points["right_hip"])
    points["spine_top"] = 0.5 * (points["left_shoulder"] + points["right_shoulder"])


def _root(pelvis: Array, *, in_place: bool) -> Array:
    place: Array = pelvis - pelvis[0]
    place[:, 2] -= np.mean(place[:, 2])
    if in_place:
        share = np.linspace(-0.5, 0.5, place.shape[0])
        place[:, :2] -= np.outer(share, share @ place[:, :2]) / float(share @ share)
        place[:, :2] -= np.mean(place[:, :2], axis=0)
    return place


def _torso(points: Mapping[str, Array]) -> Array:
    z = unit(points["spine_top"] - points["pelvis"])
    return frame(right(points), z)


def _axes(turns: Array) -> Array:
    """Directions (F, 2, 3) of a body's x and z axes, turned by rz, ry, rx (F, 3)."""
    return np.swapaxes(rotation_zyx(turns)[:, :, ::2], 1, 2)


def _bone_directions(angles: Array) -> Array:
    """Directions (F, 2, 3) of a limb's two bones where it is tied, from rz, ry, rx and hinge (F, 4)."""
    upper = rotation_zyx(angles[:, :3])
    lower = upper @ axis_rotation(0, angles[:, 3])
    return -np.stack([upper[:, :, 2], lower[:, :, 2]], axis=1)


def _limb(
    side: str, limb: Limb, points: Mapping[str, Array], frames: Mapping[str, Array], torso: Array
) -> tuple[Array, Array, Array]:
    """Rotations (F, 3, 3) of one limb's upper bone against the torso, angles (F,) of its hinge, and directions.

    The directions (F, 2, 3) are those of its bones as the torso sees them.
    """
    root, hinge, end = (f"{side}_{joint}" for joint in CHAINS[limb])
    a = unit(points[hinge] - points[root])
    b = unit(points[end] - points[hinge])
    bend = BEND[limb]
    normal = bend * np.cross(a, b)
    # The hinge's axis in the frame of the captured joint, where it should stand still; of a limb
    # that never bends, the torso's x axis there.
    own = frames[root]
    axis = np.sum(np.einsum("fji,fj->fi", own, normal), axis=0)
    across = np.sum(np.einsum("fji,fj->fi", own, torso[:, :, 0]), axis=0)
    # A knee whose axis points to the other side is one that the capture, or its skeleton, overstretches.
    if np.linalg.norm(axis) < 0.05 * normal.shape[0] or (limb == "leg" and axis @ across < 0.0):
        axis = across
    expected = np.einsum("fij,j->fi", own, unit(axis))
    expected = unit(expected - a * np.sum(expected * a, axis=1, keepdims=True))
    sine = np.linalg.norm(normal, axis=1)
    along = np.sum(normal * expected, axis=1) / np.maximum(sine, 1e-12)
    # A limb bent the wrong way has its normal turned round: it keeps the expected axis too.
    trust = smooth_step(sine, _STRAIGHT, _BENT) * smooth_step(along, -0.2, 0.2)
    x = trust[:, None] * normal / np.maximum(sine, 1e-12)[:, None]
    upper = frame(x + (1.0 - trust)[:, None] * expected, -a)
    forth = np.sum(b * upper[:, :, 1], axis=1)
    down = -np.sum(b * upper[:, :, 2], axis=1)
    wanted = np.einsum("fji,fbj->fbi", torso, np.stack([a, b], axis=1))
    return np.swapaxes(torso, 1, 2) @ upper, _bent(limb, np.arctan2(forth, down)), wanted


def _bent(limb: Limb, angle: Array) -> Array:
    """Angles of a hinge, none of them the wrong way."""
    return np.asarray(BEND[limb] * np.maximum(BEND[limb] * angle, 0.0))
