"""Frames, and how a tree of them is written.

A mechanism is a tree of coordinate frames. Each frame is placed in its parent by one transformation:
a translation along or a rotation about an axis of the parent (`tx ty tz rx ry rz`), a constant `pose`,
or one of the joints of `leastaction.mechanics.description.joints`. The coordinate is a number (metres, radians), the
name of a configuration variable, or a linear expression of several (`var`). A variable is dynamic
(found by the equations of motion) or kinematic (prescribed from outside), and may move many frames.

As nested lists, where a frame may be followed by the list of its children::

    [tx("x", name="cart", mass=10.0), [
        rz("theta"), [
            ty(-1.0, name="bob", mass=1.0)]]]

or as chained calls, each of which goes one frame further out::

    tree = world()
    tree.tx("x", name="cart", mass=10.0).rz("theta").ty(-1.0, name="bob", mass=1.0)

Both describe the same mechanism.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError, UnitWarning, closest
from leastaction.mechanics.description.affine import Affine, CoordinateLike, as_affine
from leastaction.mechanics.description.bodies import Body
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.names import check_name

_FULL_TURN = 2.0 * np.pi * (1.0 + 1e-9)

QUATERNION = "quaternion"  # instead of the axes of a rotation by angles

PRIMITIVES = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Group:
    """What the frames of one composition have in common: ``kind`` ("ball" ...), ``name`` and ``axes``.

    ``axes`` is "quaternion" where its rotation is one.
    """

    kind: str
    name: str
    axes: str


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a description: how it is placed in its parent, and what mass it carries.

    Made by `tx` ... `rz`, `pose`, `twist`, `screw`, `revolute` and `prismatic`; two frames are the same
    only if they are the same object.

    Attributes
    ----------
    transform : str
        Which function made it: ``"tx"`` ... ``"rz"``, ``"pose"``, ``"twist"`` ...
    coordinate : Affine or None
        How far the frame moves along its twist; None for a pose.
    twist : ndarray, shape (6,), or None
        The twist [v; w] in the parent by which it moves; None for a pose.
    kinematic : tuple of str
        Those variables of the coordinate that are kinematic.
    matrix : ndarray, shape (4, 4), or None
        The constant pose.
    name : str or None
        The name that was given; the mechanism makes one up for None.
    bodies : tuple of Body
        The bodies fixed to the frame, after its transformation.
    group : Group or None
        The composition that the frame is part of.
    detail : str
        Where the joint's axis lies, in words; empty where ``transform`` says it.
    point : ndarray, shape (3,), or None
        The point of its axis that a revolute or a screw was given (m).
    pitch : float or None
        That of a screw (m/rad).
    """

    transform: str
    coordinate: Affine | None = None
    twist: Array | None = None
    kinematic: tuple[str, ...] = ()
    matrix: Array | None = None
    name: str | None = None
    bodies: tuple[Body, ...] = ()
    group: Group | None = None
    detail: str = ""
    point: Array | None = None
    pitch: float | None = None

    __getstate__, __setstate__ = saved_state, restore_state

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables that move the frame; none for a constant one."""
        return () if self.coordinate is None else self.coordinate.names

    @property
    def label(self) -> str:
        """The transformation as text, such as ``rz(theta)``, ``ty(-1)`` or ``rz(2 theta + 0.3)``."""
        return self.transform if self.coordinate is None else f"{self.transform}({self.coordinate})"

    def __repr__(self) -> str:
        return self.label if self.name is None else f"{self.label} {self.name!r}"


class FrameOptions(TypedDict, total=False):
    """The options that every frame takes.

    ``name``: the frame's name, unique in the mechanism. ``mass`` (kg), ``com`` (m, shape (3,)) and ``inertia`` (kg m^2,
    3 or 6 numbers or 3x3): one `Body` on the frame, as described there. ``bodies``: further bodies.
    """

    name: str | None
    mass: float | None
    com: ArrayLike | None
    inertia: ArrayLike | None
    bodies: Sequence[Body]


class JointOptions(FrameOptions, total=False):
    """The options of every frame that may move: `FrameOptions`, and how its variables are meant.

    ``kinematic``: True if the variables of the coordinate are prescribed instead of found; the list of those
    that are, where the coordinate mixes both kinds. ``offset``: added to the coordinate (m or rad).
    """

    kinematic: bool | Sequence[str]
    offset: float


def bodies_of(
    label: str, mass: float | None, com: ArrayLike | None, inertia: ArrayLike | None, bodies: Sequence[Body]
) -> tuple[Body, ...]:
    """Return the bodies that the options of a frame describe; `label` is the frame in messages."""
    if mass is None and (com is not None or inertia is not None):
        which = "com" if com is not None else "inertia"
        raise DescriptionError(f"frame {label}: {which} is given without a mass; give mass= too, 0 for a rotor alone")
    given: object = bodies
    listed = tuple(given) if isinstance(given, Iterable) else ()
    more = tuple(body for body in listed if isinstance(body, Body))
    if not isinstance(given, Iterable) or len(more) < len(listed):
        raise DescriptionError(f"frame {label}: bodies must be a list of Body, got {bodies!r}")
    if mass is None:
        return more
    try:
        return (Body(mass, com=com, inertia=inertia), *more)
    except DescriptionError as error:
        raise DescriptionError(f"frame {label}: {error}") from None


def kinematic_names(kinematic: bool | Sequence[str], variables: Sequence[str], label: str) -> tuple[str, ...]:
    """Return those of a joint's variables that are kinematic.

    ``kinematic``: the option as given. ``variables``: the variables of the joint. ``label``: the joint, for messages.
    """
    if isinstance(kinematic, (bool, np.bool_)):
        if kinematic and not variables:
            raise DescriptionError(
                f"{label}: kinematic=True marks a variable, but the coordinate is a constant; "
                "give the variable's name instead"
            )
        return tuple(variables) if kinematic else ()
    if isinstance(kinematic, str) or not isinstance(kinematic, (list, tuple, set, frozenset)):
        raise DescriptionError(f"{label}: kinematic must be True, False or a list of variables, got {kinematic!r}")
    for name in kinematic:
        if name not in variables:
            raise DescriptionError(
                f"{label}: kinematic lists {name!r}, which does not move the frame; "
                f"{closest(name, variables, what='variables of the frame')}"
            )
    return tuple(name for name in variables if name in kinematic)


def moving(
    transform: str,
    twist: Array,
    value: CoordinateLike,
    *,
    detail: str = "",
    point: Array | None = None,
    pitch: float | None = None,
    group: Group | None = None,
    offset: float = 0.0,
    kinematic: bool | Sequence[str] = False,
    name: str | None = None,
    mass: float | None = None,
    com: ArrayLike | None = None,
    inertia: ArrayLike | None = None,
    bodies: Sequence[Body] = (),
) -> Frame:
    """Return the frame that moves along a twist: the one place where such frames are made and checked.

    ``transform``: the name of the function that the user called. ``twist`` (6,): [v; w] in the parent; must not change
    any more. ``value``: how far it moves. ``detail``, ``point``, ``pitch``, ``group``: as in `Frame`. ``offset``,
    ``kinematic``, ``name``, ``mass``, ``com``, ``inertia``, ``bodies``: as in `JointOptions`. Warns `UnitWarning` for a
    constant angle of more than a full turn, most likely one in degrees.
    """
    if name is not None:
        check_name(name, f"the name of a {transform} frame")
    coordinate = as_affine(value, transform, offset)
    label = f"{transform}({coordinate})" if name is None else repr(name)
    prescribed = kinematic_names(kinematic, coordinate.names, f"{transform}({coordinate})")
    angle = coordinate.offset and coordinate.offset * float(np.linalg.norm(twist[3:]))
    if abs(angle) > _FULL_TURN:
        warnings.warn(
            f"{transform}({coordinate}): the constant angle {angle:.6g} rad is more than a full turn. Angles "
            f"are in radians; if degrees are meant, write np.radians({angle:.6g})",
            UnitWarning,
            stacklevel=3,
        )
    return Frame(
        transform,
        coordinate=coordinate,
        twist=twist,
        kinematic=prescribed,
        name=name,
        bodies=bodies_of(label, mass, com, inertia, bodies),
        group=group,
        detail=detail,
        point=point,
        pitch=pitch,
    )


def _unit_twists() -> dict[str, Array]:
    twists = dict(zip(PRIMITIVES, np.eye(6), strict=True))
    for twist in twists.values():
        twist.setflags(write=False)
    return twists


TWISTS = _unit_twists()
"""The twist of every primitive transformation."""


def tx(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Translate along x by a constant (m), a variable or an expression; see `JointOptions`."""
    return moving("tx", TWISTS["tx"], value, **options)


def ty(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Translate along y by a constant (m), a variable or an expression; see `JointOptions`."""
    return moving("ty", TWISTS["ty"], value, **options)


def tz(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Translate along z by a constant (m), a variable or an expression; see `JointOptions`."""
    return moving("tz", TWISTS["tz"], value, **options)


def rx(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Rotate about x by a constant (rad), a variable or an expression; see `JointOptions`."""
    return moving("rx", TWISTS["rx"], value, **options)


def ry(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Rotate about y by a constant (rad), a variable or an expression; see `JointOptions`."""
    return moving("ry", TWISTS["ry"], value, **options)


def rz(value: CoordinateLike, **options: Unpack[JointOptions]) -> Frame:
    """Rotate about z by a constant (rad), a variable or an expression; see `JointOptions`."""
    return moving("rz", TWISTS["rz"], value, **options)
