"""Frames, and how a tree of them is written.

A mechanism is a tree of coordinate frames. Each frame is placed in its parent by one transformation:
a translation along or a rotation about an axis of the parent (`tx ty tz rx ry rz`), or a constant
`pose`. The amount is a number (metres, radians), or the name of a configuration variable: dynamic
(found by the equations of motion) or kinematic (prescribed from outside).

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

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import Array, as_array, as_number
from leastaction.mechanics.bodies import Body

# A rotation matrix that was typed or stored with fewer digits than this is refused, not guessed at.
ROTATION_TOLERANCE = 1e-8

PRIMITIVES = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a description: how it is placed in its parent, and what mass it carries.

    Made by `tx`, `ty`, `tz`, `rx`, `ry`, `rz` and `pose`; two frames are the same only if they are
    the same object.

    Attributes
    ----------
    transform : str
        ``"tx"`` ... ``"rz"``, or ``"pose"``.
    value : float or None
        The constant amount (m or rad); None with a variable or a pose.
    variable : str or None
        The configuration variable that is the amount.
    kinematic : bool
        Whether that variable is kinematic.
    matrix : ndarray, shape (4, 4), or None
        The constant pose.
    name : str or None
        The name that was given; the mechanism makes one up for None.
    bodies : tuple of Body
        The bodies fixed to the frame, after its transformation.
    """

    transform: str
    value: float | None = None
    variable: str | None = None
    kinematic: bool = False
    matrix: Array | None = None
    name: str | None = None
    bodies: tuple[Body, ...] = ()

    @property
    def label(self) -> str:
        """The transformation as text, such as ``rz(theta)`` or ``ty(-1)``."""
        if self.transform == "pose":
            return "pose"
        return f"{self.transform}({self.variable if self.value is None else f'{self.value:.6g}'})"

    def __repr__(self) -> str:
        return self.label if self.name is None else f"{self.label} {self.name!r}"


class FrameOptions(TypedDict, total=False):
    """The options that every frame takes.

    ``name``: the frame's name, unique in the mechanism. ``mass`` (kg), ``com`` (m, shape (3,)) and
    ``inertia`` (kg m^2, 3 or 6 numbers or 3x3): one `Body` on the frame, as described there.
    ``bodies``: further bodies.
    """

    name: str | None
    mass: float | None
    com: npt.ArrayLike | None
    inertia: npt.ArrayLike | None
    bodies: Sequence[Body]


class PrimitiveOptions(FrameOptions, total=False):
    """`FrameOptions`, and ``kinematic``: the variable is prescribed instead of found."""

    kinematic: bool


def _bodies(
    label: str,
    mass: float | None,
    com: npt.ArrayLike | None,
    inertia: npt.ArrayLike | None,
    bodies: Sequence[Body],
) -> tuple[Body, ...]:
    if mass is None and (com is not None or inertia is not None):
        given = "com" if com is not None else "inertia"
        raise DescriptionError(f"frame {label}: {given} is given without a mass; give mass= too")
    if isinstance(bodies, Body) or not all(isinstance(body, Body) for body in bodies):
        raise DescriptionError(f"frame {label}: bodies must be a list of Body, got {bodies!r}")
    if mass is None:
        return tuple(bodies)
    try:
        return (Body(mass, com=com, inertia=inertia), *bodies)
    except DescriptionError as error:
        raise DescriptionError(f"frame {label}: {error}") from None


def check_name(name: object, what: str) -> str:
    """Return a name, or raise a `DescriptionError` if it is not a string with something in it."""
    if not isinstance(name, str) or not name.strip():
        raise DescriptionError(f"{what}: a name is a string that is not empty, got {name!r}")
    return name


def _primitive(
    transform: str,
    value: float | str,
    *,
    kinematic: bool = False,
    name: str | None = None,
    mass: float | None = None,
    com: npt.ArrayLike | None = None,
    inertia: npt.ArrayLike | None = None,
    bodies: Sequence[Body] = (),
) -> Frame:
    if name is not None:
        check_name(name, f"the name of a {transform} frame")
    constant, variable = None, None
    if isinstance(value, str):
        variable = check_name(value, f"the variable of {transform}")
        label = f"{transform}({value!r})"
    else:
        constant = as_number(
            value, f"{transform}: the amount, a number or a variable's name", error=DescriptionError
        )
        label = f"{transform}({constant:g})"
        if kinematic:
            raise DescriptionError(
                f"{label}: kinematic=True marks a variable, but the amount is a constant; "
                "give the variable's name instead"
            )
    if name is not None:
        label = f"{name!r}"
    return Frame(
        transform,
        value=constant,
        variable=variable,
        kinematic=bool(kinematic),
        name=name,
        bodies=_bodies(label, mass, com, inertia, bodies),
    )


def tx(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Translate along x by a constant (m) or by a variable; see `PrimitiveOptions`."""
    return _primitive("tx", value, **options)


def ty(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Translate along y by a constant (m) or by a variable; see `PrimitiveOptions`."""
    return _primitive("ty", value, **options)


def tz(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Translate along z by a constant (m) or by a variable; see `PrimitiveOptions`."""
    return _primitive("tz", value, **options)


def rx(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Rotate about x by a constant (rad) or by a variable; see `PrimitiveOptions`."""
    return _primitive("rx", value, **options)


def ry(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Rotate about y by a constant (rad) or by a variable; see `PrimitiveOptions`."""
    return _primitive("ry", value, **options)


def rz(value: float | str, **options: Unpack[PrimitiveOptions]) -> Frame:
    """Rotate about z by a constant (rad) or by a variable; see `PrimitiveOptions`."""
    return _primitive("rz", value, **options)


def pose(
    matrix: npt.ArrayLike | None = None,
    *,
    translation: npt.ArrayLike | None = None,
    rotation: npt.ArrayLike | None = None,
    name: str | None = None,
    mass: float | None = None,
    com: npt.ArrayLike | None = None,
    inertia: npt.ArrayLike | None = None,
    bodies: Sequence[Body] = (),
) -> Frame:
    """Place a frame by a constant pose in its parent.

    Parameters
    ----------
    matrix : array_like, shape (4, 4), optional
        The homogeneous matrix that takes coordinates in the frame to coordinates in its parent.
    translation : array_like, shape (3,), optional
        Origin of the frame in its parent (m), instead of a matrix.
    rotation : array_like, shape (3, 3), optional
        Axes of the frame in its parent as columns, instead of a matrix.
    name, mass, com, inertia, bodies
        As in `FrameOptions`.

    Returns
    -------
    Frame

    Raises
    ------
    DescriptionError
        If both forms are given, a number is not finite, or the rotation is not one. A rotation within
        1e-8 of orthonormal is taken as the nearest orthonormal one.
    """
    what = "pose" if name is None else f"pose {check_name(name, 'the name of a pose')!r}"
    if matrix is not None and (translation is not None or rotation is not None):
        raise DescriptionError(
            f"{what}: give either a matrix or translation= and rotation=, not both"
        )
    if matrix is None and translation is None and rotation is None:
        raise DescriptionError(f"{what}: give a 4x4 matrix, or translation= or rotation= or both")
    placed = np.eye(4)
    if matrix is not None:
        placed = as_array(matrix, f"{what}: matrix", (4, 4), error=DescriptionError).copy()
        if not np.array_equal(placed[3], [0.0, 0.0, 0.0, 1.0]):
            raise DescriptionError(
                f"{what}: the last row of a pose is [0, 0, 0, 1], got {placed[3].tolist()}"
            )
    if translation is not None:
        placed[:3, 3] = as_array(translation, f"{what}: translation", (3,), error=DescriptionError)
    if rotation is not None:
        placed[:3, :3] = as_array(rotation, f"{what}: rotation", (3, 3), error=DescriptionError)
    placed[:3, :3] = _nearest_rotation(placed[:3, :3], what)
    placed.setflags(write=False)
    return Frame("pose", matrix=placed, name=name, bodies=_bodies(what, mass, com, inertia, bodies))


def _nearest_rotation(rotation: Array, what: str) -> Array:
    error = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        raise DescriptionError(
            f"{what}: the rotation is not orthonormal: R^T R differs from the identity by "
            f"{error:.2g}, more than {ROTATION_TOLERANCE:g}. Give more digits, or build it from rx, ry, rz"
        )
    if np.linalg.det(rotation) < 0.0:
        raise DescriptionError(
            f"{what}: the rotation has determinant -1: it is a reflection. Use right-handed axes"
        )
    if error < 1e-15:
        return rotation
    left, _, right = np.linalg.svd(rotation)
    nearest: Array = left @ right
    return nearest
