"""A hand of five fingers that turn at the wrist and the knuckle too: 25 variables, the option of `hand`."""

from __future__ import annotations

from typing import Any

from leastaction.mechanics import (
    Damping,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    TendonForce,
    pose,
    ry,
    rz,
    tx,
)
from leastaction.numerics.public import public

FINGERS = ("thumb", "index", "middle", "ring", "little")
JOINTS = ("cmc", "mcp.side", "mcp", "pip", "dip")
"""Joints of a finger, outwards: at the wrist, the knuckle sidewards and down, and the two of the finger."""

TENDONS = ("deep", "superficial", "extensor", "radial", "ulnar")
"""Tendons of a finger: two flexors to the last and the middle bone, an extensor, one at either side."""

_BONES = ("metacarpal", "proximal", "middle", "distal")
_LENGTHS = (0.065, 0.042, 0.026, 0.02)
_MASSES = (0.03, 0.02, 0.01, 0.006)
_SCALES = {"thumb": 0.8, "index": 1.0, "middle": 1.08, "ring": 1.0, "little": 0.82}
RADIUS = 0.008  # of a bone with its flesh, where tendons run


@public
def broad_hand(*, tendons: bool = True) -> Mechanism:
    """Return a hand of five fingers with five joints each, the palm up to the wrist fixed in the world.

    Fingers point along x, side by side along y; bending turns them down, about y.

    Parameters
    ----------
    tendons : bool, optional
        Five tendons a finger over via-points on every bone that they pass, each with its tension (N) as an
        input (`TENDONS`); else a motor in every joint (N m).

    Returns
    -------
    Mechanism
        With the variables and inputs ``index.pip``, ``index.deep`` and so on.
    """
    elements: list[Element] = [Gravity(), Damping(2e-3)]
    description: list[Any] = []
    for place, finger in enumerate(FINGERS):
        description += [
            pose(translation=(0.0, 0.02 * (2 - place), 0.0), name=f"{finger}.wrist"),
            [*_tendon_points(finger, "wrist", 0.0), *_finger(finger)],
        ]
        for joint in JOINTS:
            name = f"{finger}.{joint}"
            elements.append(JointSpring(name, 0.02, rest=0.0 if "side" in joint else 0.2))
            if not tendons:
                elements.append(JointForce(name, input=name))
        if tendons:
            elements += [
                TendonForce(
                    [f"{finger}.{bone}.{tendon}" for bone in ("wrist", *_passed(tendon))], input=f"{finger}.{tendon}"
                )
                for tendon in TENDONS
            ]
    return Mechanism(description, elements)


@public
def bone_body(length: float, mass: float) -> dict[str, Any]:
    """Return the body of a bone along x, a cylinder with its flesh, as the options of a frame at its start."""
    across = mass * (length**2 / 12.0 + RADIUS**2 / 4.0)
    return {"mass": mass, "com": (length / 2.0, 0.0, 0.0), "inertia": [0.5 * mass * RADIUS**2, across, across]}


def _passed(tendon: str) -> tuple[str, ...]:
    """The bones that a tendon runs over, the last of which it is fixed to."""
    reach = {"deep": 4, "superficial": 3, "extensor": 4, "radial": 2, "ulnar": 2}
    return _BONES[: reach[tendon]]


def _finger(finger: str) -> list[Any]:
    scale = _SCALES[finger]
    bones: list[Any] = []
    for bone, length, mass in reversed(list(zip(_BONES, _LENGTHS, _MASSES, strict=True))):
        long, heavy = scale * length, scale**3 * mass
        end = tx(long, name=f"{finger}.{bone}.end")
        inside = [*_tendon_points(finger, bone, 0.6 * long), end, bones] if bones else [
            *_tendon_points(finger, bone, 0.6 * long), end
        ]  # fmt: skip
        joint = {"metacarpal": "cmc", "proximal": "mcp", "middle": "pip", "distal": "dip"}[bone]
        frame = ry(f"{finger}.{joint}", name=f"{finger}.{bone}", **bone_body(long, heavy))
        bones = [frame, inside]
        if bone == "proximal":
            bones = [rz(f"{finger}.mcp.side", name=f"{finger}.knuckle"), bones]
    return bones


def _tendon_points(finger: str, bone: str, x: float) -> list[Any]:
    r = RADIUS
    at = {
        "deep": (x, 0.0, -r),
        "superficial": (x, 0.25 * r, -1.2 * r),
        "extensor": (x, 0.0, r),
        "radial": (x, r, -0.3 * r),
        "ulnar": (x, -r, -0.3 * r),
    }
    return [
        pose(translation=at[tendon], name=f"{finger}.{bone}.{tendon}")
        for tendon in TENDONS
        if bone == "wrist" or bone in _passed(tendon)
    ]
