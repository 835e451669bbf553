"""A hand of sixteen joints under twenty-five tendons (dissertation 6.7.4), or of twenty-five joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp
from typing import Any, Literal

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Curve,
    Damping,
    Element,
    Gravity,
    JointForce,
    Mechanism,
    NonlinearSpring,
    TendonForce,
    pose,
    ry,
    rz,
    tx,
)
from leastaction.mechanics.description.poses import constant_matrix
from leastaction.models.broad_hand import FINGERS, JOINTS, TENDONS, bone_body, broad_hand
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

__all__ = ["BONES", "FINGERS", "JOINTS", "TENDONS", "TRAVEL", "hand", "posture", "tendon_frames", "tendon_lengths"]

TRAVEL = {
    "mcp": (-0.35, 1.6), "pip": (-0.05, 1.8), "dip": (-0.1, 1.3),
    "thumb.cmc.side": (-0.5, 0.9), "thumb.cmc": (-0.5, 0.9), "thumb.mcp": (-0.2, 1.1), "thumb.ip": (-0.3, 1.3),
}  # fmt: skip
"""Between which angles joints turn freely (rad), by the end of their names."""

BONES = {"thumb": ("metacarpal", "proximal", "distal"), **dict.fromkeys(FINGERS[1:], ("proximal", "middle", "distal"))}
"""Bones of a finger that move, outwards; a frame ``index.middle`` stands at the joint of each."""


@dataclass(frozen=True)
class _Bone:
    """A bone: its name, joint, length (m) and mass (kg), before it is scaled to its finger."""

    name: str
    joint: str
    length: float
    mass: float


_FINGER = (
    _Bone("proximal", "mcp", 0.042, 0.02), _Bone("middle", "pip", 0.026, 0.01), _Bone("distal", "dip", 0.02, 0.006)
)  # fmt: skip
_THUMB = (
    _Bone("metacarpal", "cmc", 0.045, 0.03), _Bone("proximal", "mcp", 0.034, 0.02), _Bone("distal", "ip", 0.026, 0.01)
)  # fmt: skip
_SCALES = {"thumb": 0.9, "index": 1.0, "middle": 1.08, "ring": 1.0, "little": 0.82}
_KNUCKLES = {"index": (0.068, 0.024), "middle": (0.07, 0.003), "ring": (0.064, -0.018), "little": (0.057, -0.036)}
_WRIST = 0.4  # of a knuckle's place sidewards is its tendons' place at the wrist
_SADDLE = (0.018, 0.026, -0.008)  # of the thumb's joint at the wrist
_THUMB_START = -0.03  # of the thumb's tendons, along it
_THUMB_TURN = (-0.9, 0.1, 0.75)  # of the thumb about x, y and z

# Lever of each tendon at each joint of the straight finger (m), to the palm where positive, and how far sidewards of
# the bone it runs. Levers fall outwards, as in a hand: so tendons that only pull can turn each joint by itself.
_Routes = dict[str, tuple[tuple[float, ...], float]]
_LEVERS: _Routes = {
    "deep": ((0.0075, 0.006, 0.004), 0.0),
    "superficial": ((0.0085, 0.0055), 0.0015),
    "extensor": ((-0.008, -0.0045, -0.0012), 0.0),
    "radial": ((0.004, -0.003, -0.002), 0.006),
    "ulnar": ((0.005, -0.0045), -0.006),
}
_THUMB_LEVERS: _Routes = {
    "deep": ((0.007, 0.006, 0.005), 0.0),
    "superficial": ((0.002, 0.008), 0.0),
    "extensor": ((-0.008, -0.008, -0.004), 0.0),
    "radial": ((-0.003,), 0.012),
    "ulnar": ((0.004,), -0.012),
}
_AHEAD = 1.6  # of a pulley on the palm's side, from the joint, in levers: it stays behind its fellow up to 116 degrees
_STIFFNESS, _REST = 0.02, 0.3  # of the flesh: N m/rad, rad
_STOP, _SOFT = 0.02, 0.06  # torque of a stop at the end of a joint's travel (N m), and in what it grows e-fold (rad)
_FIBRES = 0.05  # change of a muscle's length (m) by which its force falls to 1/e


@public
def hand(*, joints: Literal[16, 25] = 16, tendons: bool = True, force_length: bool = True) -> Mechanism:
    """Return a right hand, palm down, its palm fixed in the world.

    Fingers point along x, the thumb is on the side of y; bending turns them down, about y. Every bone is a rigid body.
    The flesh is a weak spring in every joint, and at the ends of its travel (`TRAVEL`) a stop, soft to a few degrees.

    Parameters
    ----------
    joints : 16 or 25, optional
        Sixteen as in the dissertation: three in each finger, four in the thumb. With 25 every finger also turns at the
        wrist and sidewards at its knuckle, its tendons have the same lever at every joint, and it has no stops.
    tendons : bool, optional
        Five tendons a finger (`TENDONS`): two flexors to the last bone and the one before, an extensor, and one at
        either side, which bends the knuckle and stretches what is beyond. They run through pulleys on the palm's side,
        and over the back through hoods that turn half as far as the joint. Else a motor in every joint (N m).
    force_length : bool, optional
        A tendon pulls with its input (N) times a factor, which is 1 where its length is that of the half-closed hand
        and falls as a bell on both sides. Of sixteen joints only.

    Returns
    -------
    Mechanism
        With the variables and inputs ``index.pip``, ``index.deep`` and so on.

    Raises
    ------
    ArgumentError
        For another number of joints.
    """
    if joints == 25:
        return broad_hand(tendons=tendons)
    if joints != 16:
        raise ArgumentError(f"joints: got {joints!r}, expected 16 or 25")
    description: list[Any] = []
    for finger in FINGERS:
        description += _thumb() if finger == "thumb" else _long_finger(finger)
    elements: list[Element] = [Gravity(), Damping(2e-3)]
    bare = Mechanism(description, elements)
    elements += [NonlinearSpring(name, _flesh(name), name=f"{name} flesh") for name in bare.variables]
    if not tendons:
        return Mechanism(description, [*elements, *(JointForce(name, input=name) for name in bare.variables)])
    half = tendon_lengths(bare, posture(bare, 0.5))
    for name, length in half.items():
        curve = _bell(float(length)) if force_length else None
        elements.append(TendonForce(tendon_frames(bare, name), input=name, force_length=curve, name=name))
    return Mechanism(description, elements)


@public
def posture(mechanism: Mechanism, closed: float | Array) -> Array:
    """Return configurations (..., 16) of the hand of sixteen joints: open at 0, a fist at 1.

    Parameters
    ----------
    mechanism : Mechanism
        As `hand` returns it.
    closed : float or ndarray
        How far it is closed.
    """
    first, last = (np.array([_pose_of(name)[end] for name in mechanism.variables]) for end in (0, 1))
    share: Array = np.asarray(closed, dtype=np.float64)[..., None]
    angles: Array = first + share * (last - first)
    return angles


@public
def tendon_frames(mechanism: Mechanism, tendon: str) -> tuple[str, ...]:
    """Return the frames that a tendon, such as ``"index.deep"``, runs through, from the wrist outwards."""
    finger, _, name = tendon.partition(".")
    return tuple(frame for frame in mechanism.frames if frame.startswith(f"{finger}.") and frame.split(".")[-1] == name)


@public
def tendon_lengths(mechanism: Mechanism, q: Array) -> dict[str, Array]:
    """Return the length of every tendon (m) by its name, for one configuration or many."""
    lengths = {}
    for name in (f"{finger}.{tendon}" for finger in FINGERS for tendon in TENDONS):
        points = mechanism.positions(q, tendon_frames(mechanism, name))
        lengths[name] = np.linalg.norm(np.diff(points, axis=-2), axis=-1).sum(axis=-1)
    return lengths


def _pose_of(variable: str) -> tuple[float, float]:
    """Return the angles of a joint in the open hand and in the fist (rad)."""
    finger, _, joint = variable.partition(".")
    if finger == "thumb":
        return {"cmc.side": (-0.1, 0.45), "cmc": (0.0, 0.4), "mcp": (0.1, 0.7), "ip": (0.05, 0.9)}[joint]
    return {"mcp": (0.1, 1.35), "pip": (0.15, 1.6), "dip": (0.1, 0.95)}[joint]


def _flesh(variable: str) -> Curve:
    """Return the torque of a joint's flesh by its angle, without the sign of a pull: a spring and two soft stops."""
    low, high = TRAVEL[variable if variable in TRAVEL else variable.partition(".")[2]]
    rest = 0.0 if variable.endswith("side") else _REST

    def torque(angle: float) -> float:
        return _STIFFNESS * (angle - rest) + _STOP * (exp((angle - high) / _SOFT) - exp((low - angle) / _SOFT))

    return Curve.from_function(torque, low - 0.4, high + 0.4, pieces=80)


def _bell(length: float) -> Curve:
    """Return the force of a muscle by the length of its tendon."""
    room = min(2.0 * _FIBRES, 0.9 * length)
    return Curve.from_function(lambda s: exp(-(((s - length) / _FIBRES) ** 2)), length - room, length + room)


def _long_finger(finger: str) -> list[Any]:
    x, y = _KNUCKLES[finger]
    starts = [
        pose(translation=(0.0, _WRIST * y + side, -levers[0]), name=f"{finger}.wrist.{tendon}")
        for tendon, (levers, side) in _LEVERS.items()
    ]
    return [*starts, pose(translation=(x, y, 0.0), name=f"{finger}.knuckle"), _bones(finger, _FINGER, _LEVERS)]


def _thumb() -> list[Any]:
    a, b, c = _THUMB_TURN
    turn = (constant_matrix("rz", c) @ constant_matrix("ry", b) @ constant_matrix("rx", a))[:3, :3]
    starts = [
        pose(translation=(_THUMB_START, side, -levers[0]), name=f"thumb.wrist.{tendon}")
        for tendon, (levers, side) in _THUMB_LEVERS.items()
    ]
    saddle = rz("thumb.cmc.side", name="thumb.saddle")
    place = pose(rotation=turn, translation=_SADDLE, name="thumb.wrist")
    return [place, [*starts, saddle, _bones("thumb", _THUMB, _THUMB_LEVERS)]]


def _bones(finger: str, bones: Sequence[_Bone], routes: _Routes) -> list[Any]:
    """Return what stands at the first joint: the bones, and at each joint the points that tendons run through."""
    scale = _SCALES[finger]
    beyond: list[Any] = []
    for k in reversed(range(len(bones))):
        bone = bones[k]
        length, mass = scale * bone.length, scale**3 * bone.mass
        joint = f"{finger}.{bone.joint}"
        before, over, after = _pulleys(joint, k, scale, routes)
        end: list[Any] = [tx(length, name=f"{finger}.{bone.name}.end"), *([beyond] if beyond else [])]
        # The thumb's saddle has its tendons' starts behind it, near enough.
        beyond = [
            *(before if k or finger != "thumb" else []),
            ry({joint: 0.5}, name=f"{joint}.hood"), over,
            ry(joint, name=f"{finger}.{bone.name}", **bone_body(length, mass)), [*after, *end],
        ]  # fmt: skip
    return beyond


def _pulleys(joint: str, k: int, scale: float, routes: _Routes) -> tuple[list[Any], list[Any], list[Any]]:
    """Return the points of all tendons on the bone before a joint, on its hood, and on the bone after it."""
    before, over, after = [], [], []
    for tendon, (levers, side) in routes.items():
        if k >= len(levers):
            continue
        lever = scale * levers[k]
        away = _AHEAD * lever if lever > 0.0 else -lever
        before.append(pose(translation=(-away, side, -lever), name=f"{joint}.before.{tendon}"))
        after.append(pose(translation=(away, side, -lever), name=f"{joint}.after.{tendon}"))
        if lever < 0.0:
            over.append(pose(translation=(0.0, side, -lever), name=f"{joint}.over.{tendon}"))
    return before, over, after
