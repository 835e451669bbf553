"""Joints about and along any axis: every motion of one parameter.

A joint moves its frame from the parent by ``exp(hat(twist) s)``: at the coordinate ``s = 0`` the frame
coincides with its parent, wherever the joint's axis lies. The coordinate and the options are those of
`tx` ... `rz`; a constant coordinate is a constant pose.
"""

from __future__ import annotations

from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.affine import CoordinateLike
from leastaction.mechanics.description.frames import Frame, JointOptions, moving
from leastaction.numerics.arrays import Array, as_array, as_number
from leastaction.numerics.public import public

_AXES = {
    sign + letter: tuple(factor * float(i == k) for i in range(3))
    for sign, factor in (("", 1.0), ("-", -1.0))
    for k, letter in enumerate("xyz")
}

_UNIT = 1e-15  # how far rounding takes the length of a vector from one


@public
def twist(
    value: CoordinateLike,
    *,
    linear: ArrayLike = (0.0, 0.0, 0.0),
    angular: ArrayLike = (0.0, 0.0, 0.0),
    **options: Unpack[JointOptions],
) -> Frame:
    """Move along a twist, the general joint of one parameter.

    Parameters
    ----------
    value : float, str, Affine or mapping of str to float
        The coordinate: how many times the twist is applied.
    linear : array_like, shape (3,), optional
        Velocity of the point at the parent's origin per unit of the coordinate, in the parent (m).
    angular : array_like, shape (3,), optional
        Angular velocity per unit of the coordinate, in the parent (rad). Not normalised.
    **options
        See `JointOptions`.

    Raises
    ------
    DescriptionError
        If both are zero or a number is not finite.
    """
    v = as_array(linear, "twist: linear", (3,), error=DescriptionError)
    w = as_array(angular, "twist: angular", (3,), error=DescriptionError)
    if not v.any() and not w.any():
        raise DescriptionError(
            "twist: linear and angular are both zero, so nothing moves; give one of them, or use "
            "pose() for a frame that stands still"
        )
    detail = " ".join(f"{what} {_shown(part)}" for what, part in (("linear", v), ("angular", w)) if part.any())
    return moving("twist", _twist(v, w, "twist"), value, detail=detail, **options)


@public
def revolute(
    value: CoordinateLike, *, axis: ArrayLike | str, point: ArrayLike = (0.0, 0.0, 0.0), **options: Unpack[JointOptions]
) -> Frame:
    """Rotate about any axis.

    Parameters
    ----------
    value : float, str, Affine or mapping of str to float
        The angle (rad).
    axis : array_like, shape (3,), or str
        Direction of the axis in the parent, of any length; or ``"x"``, ``"-z"`` ...
    point : array_like, shape (3,), optional
        A point of the axis in the parent (m); its origin if not given.
    **options
        See `JointOptions`.

    Raises
    ------
    DescriptionError
        If the axis is zero or a number is not finite.
    """
    w, p = _unit(axis, "revolute"), _point(point, "revolute")
    v = _moment(p, w, "revolute")
    return moving("revolute", _twist(v, w, "revolute"), value, detail=_line(w, p), point=p, **options)


@public
def screw(
    value: CoordinateLike,
    *,
    axis: ArrayLike | str,
    point: ArrayLike = (0.0, 0.0, 0.0),
    pitch: float,
    **options: Unpack[JointOptions],
) -> Frame:
    """Rotate about an axis and move along it in proportion.

    Parameters
    ----------
    value : float, str, Affine or mapping of str to float
        The angle (rad).
    axis, point
        As in `revolute`.
    pitch : float
        Metres per radian: a screw that advances by ``L`` a turn has the pitch ``L / (2 pi)``. Negative for
        a left-handed one.
    **options
        See `JointOptions`.
    """
    w, p = _unit(axis, "screw"), _point(point, "screw")
    h = as_number(pitch, "screw: pitch (m per radian)", error=DescriptionError)
    return moving("screw", screw_twist(w, p, h), value, detail=screw_detail(w, p, h), point=p, pitch=h, **options)


def screw_twist(axis: Array, point: Array, pitch: float) -> Array:
    """Return the twist (6,) of a screw: its axis of length one, a point of it (m), its pitch (m/rad)."""
    return _twist(_moment(point, axis, "screw") + pitch * axis, axis, "screw")


def screw_detail(axis: Array, point: Array, pitch: float) -> str:
    """Return what describes a screw beside its coordinate."""
    return f"{_line(axis, point)}, {pitch:.6g} m/rad"


@public
def prismatic(value: CoordinateLike, *, axis: ArrayLike | str, **options: Unpack[JointOptions]) -> Frame:
    """Translate along any axis.

    Parameters
    ----------
    value : float, str, Affine or mapping of str to float
        The distance (m).
    axis : array_like, shape (3,), or str
        Direction in the parent, of any length; or ``"x"``, ``"-z"`` ...
    **options
        See `JointOptions`.
    """
    v = _unit(axis, "prismatic")
    along = f"along {_shown(v)}"
    return moving("prismatic", _twist(v, np.zeros(3), "prismatic"), value, detail=along, **options)


def _unit(axis: ArrayLike | str, what: str) -> Array:
    if isinstance(axis, str):
        if axis not in _AXES:
            raise DescriptionError(
                f"{what}: got the axis {axis!r}, expected one of {', '.join(map(repr, _AXES))} or three numbers"
            )
        return np.array(_AXES[axis])
    given = as_array(axis, f"{what}: axis", (3,), error=DescriptionError)
    size = float(np.abs(given).max())
    if size == 0.0:
        raise DescriptionError(f"{what}: the axis is zero; expected a direction, such as (0, 0, 1)")
    # Scaled first, so that no square overflows or vanishes; an axis of unit length, to rounding, stays as it is: one
    # that was made so before comes back from a file bit by bit.
    scaled = given / size
    length = float(np.linalg.norm(scaled)) * size
    unit: Array = given.copy() if abs(length - 1.0) <= _UNIT else scaled / np.linalg.norm(scaled)
    return unit


def _point(point: ArrayLike, what: str) -> Array:
    own = as_array(point, f"{what}: point", (3,), error=DescriptionError).copy()
    own.setflags(write=False)
    return own


def _moment(point: Array, axis: Array, what: str) -> Array:
    """Return the velocity of the parent's origin by a rotation about an axis through a point."""
    with np.errstate(over="ignore", invalid="ignore"):
        v: Array = np.cross(point, axis)
    if not np.all(np.isfinite(v)):
        raise DescriptionError(f"{what}: the point {_shown(point)} is too far away to compute with")
    return v


def _twist(v: Array, w: Array, what: str) -> Array:
    result = np.concatenate([v, w])
    if not np.all(np.isfinite(result)):
        raise DescriptionError(f"{what}: the twist {_shown(result)} is too large to compute with")
    result.setflags(write=False)
    return result


def _line(axis: Array, point: Array) -> str:
    through = f" through {_shown(point)}" if point.any() else ""
    return f"about {_shown(axis)}{through}"


def _shown(numbers: Array) -> str:
    # Adding zero turns -0 into 0.
    return f"({', '.join(f'{number + 0.0:.6g}' for number in numbers)})"
