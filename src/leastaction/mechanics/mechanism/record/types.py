"""Frames and joints as they stand in a file: one type for each, told apart by ``type``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Union

import msgspec
from msgspec import UNSET, Meta, UnsetType

from leastaction.mechanics.description.frames import PRIMITIVES

Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
Moments = Annotated[list[float], Meta(min_length=3, max_length=6)]
Matrix = Annotated[list[Three], Meta(min_length=3, max_length=3)]
Axis = str | Three
Coordinate = float | str | dict[str, float]


class Strict(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A part of a file, in which every key is known."""

    def given(self, *without: str) -> dict[str, Any]:
        """Return what was given, by key."""
        values = {name: getattr(self, name) for name in self.__struct_fields__ if name not in without}
        return {name: value for name, value in values.items() if value is not UNSET}


class BodyRecord(Strict, kw_only=True):
    """A body: mass (kg), centre of mass (m), inertia about it (kg m^2), as xx yy zz or xx yy zz xy xz yz."""

    mass: float
    com: Three | UnsetType = UNSET
    inertia: Moments | UnsetType = UNSET
    allow_nonphysical: bool | UnsetType = UNSET


class FrameRecord(Strict, tag_field="type", kw_only=True):
    """What every frame may have; those that hang on it are its ``children``, or name it as their ``parent``.

    ``mass``, ``com``, ``inertia``: as of a body, the first on it. ``called``: how a frame without a name is called,
    where that is not what would be made up.
    """

    name: str | UnsetType = UNSET
    called: str | list[str] | UnsetType = UNSET
    parent: str | UnsetType = UNSET
    mass: float | UnsetType = UNSET
    com: Three | UnsetType = UNSET
    inertia: Moments | UnsetType = UNSET
    bodies: list[BodyRecord] | UnsetType = UNSET
    children: list[AnyFrame] | UnsetType = UNSET


class JointRecord(FrameRecord, kw_only=True):
    """A frame that moves by its coordinate: a number (m or rad), a variable, or the factors of several."""

    value: Coordinate
    offset: float | UnsetType = UNSET
    kinematic: bool | list[str] | UnsetType = UNSET


class TwistRecord(JointRecord, tag="twist", kw_only=True):
    """A frame that moves along any twist."""

    linear: Three | UnsetType = UNSET
    angular: Three | UnsetType = UNSET


class RevoluteRecord(JointRecord, tag="revolute", kw_only=True):
    """A frame that turns about any axis, through a point (m)."""

    axis: Axis
    point: Three | UnsetType = UNSET


class ScrewRecord(JointRecord, tag="screw", kw_only=True):
    """A frame that turns about an axis and moves along it, by the pitch (m/rad)."""

    axis: Axis
    point: Three | UnsetType = UNSET
    pitch: float


class PrismaticRecord(JointRecord, tag="prismatic", kw_only=True):
    """A frame that slides along any axis."""

    axis: Axis


class PoseRecord(FrameRecord, tag="pose"):
    """A frame that stands still: its origin in the parent (m), and its axes there as the columns of a matrix."""

    translation: Three | UnsetType = UNSET
    rotation: Matrix | UnsetType = UNSET


class CompositionRecord(FrameRecord, kw_only=True):
    """A joint of several variables: a name for all, or a coordinate for each, to which ``offsets`` are added."""

    variables: str | list[Coordinate]
    offsets: list[float] | UnsetType = UNSET
    axes: str | UnsetType = UNSET
    kinematic: bool | list[str] | UnsetType = UNSET


class UniversalRecord(CompositionRecord, tag="universal"):
    """A frame that turns about two axes."""


class BallRecord(CompositionRecord, tag="ball"):
    """A frame that turns about three axes, x, y and z without ``axes``; "quaternion" for any rotation."""


class FreeRecord(CompositionRecord, tag="free"):
    """A frame that slides along x, y and z and turns as a ball does."""


if TYPE_CHECKING:
    AnyFrame = FrameRecord
else:
    _PRIMITIVES = [
        msgspec.defstruct(
            f"{name.capitalize()}Record",
            [],
            bases=(JointRecord,),
            tag=name,
            forbid_unknown_fields=True,
            namespace={"__doc__": f"A frame that {does} {name[1]} of its parent."},
        )
        for name, does in ((p, "slides along" if p[0] == "t" else "turns about") for p in PRIMITIVES)
    ]
    AnyFrame = Union[
        (
            *_PRIMITIVES, TwistRecord, RevoluteRecord, ScrewRecord, PrismaticRecord, PoseRecord, UniversalRecord,
            BallRecord, FreeRecord,
        )
    ]  # fmt: skip
