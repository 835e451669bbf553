"""Rigid bodies: mass, centre of mass and inertia, checked for what a real body can have."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError
from leastaction.numerics.arrays import Array, as_array, as_flag, as_number, shape_of
from leastaction.numerics.public import public

# Relative slack of the inequalities that the inertia of a real body obeys.
INERTIA_TOLERANCE = 1e-9
# Moments below that of the body's mass at so short a radius (m), or of a gram there, are rounding.
ROUNDING_RADIUS = 1e-8
_GRAM = 1e-3


@public
class Body:
    """A rigid body fixed to a frame. Nothing in it changes: threads may share it.

    Parameters
    ----------
    mass : float
        Mass (kg), not negative. A mass of zero with an inertia is a rotor whose mass counts elsewhere.
    com : array_like, shape (3,), optional
        Centre of mass in the frame (m); the frame's origin if not given.
    inertia : array_like, shape (3,), (6,) or (3, 3), optional
        Inertia about the centre of mass, in the axes of the frame (kg m^2): the principal moments ``[Ixx, Iyy, Izz]``,
        the entries ``[Ixx, Iyy, Izz, Ixy, Ixz, Iyz]`` of the symmetric inertia matrix (so ``Ixy`` is the entry of row x
        and column y, minus the integral of ``x y dm``), or the matrix itself. Zero if not given: a point mass.
    allow_nonphysical : bool, optional
        Accept an inertia that no distribution of positive mass has (a principal moment that is negative, or larger
        than the sum of the other two), as identified or lumped models sometimes need.

    Raises
    ------
    DescriptionError
        If a number is not finite, the mass is negative, the inertia is not symmetric, has a negative
        principal moment, or breaks the triangle inequality without being allowed to.
    """

    __slots__ = ("allow_nonphysical", "com", "inertia", "mass")

    mass: float
    com: Array
    inertia: Array
    allow_nonphysical: bool

    def __init__(
        self,
        mass: float,
        *,
        com: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        allow_nonphysical: bool = False,
    ) -> None:
        number = as_number(mass, "mass", error=DescriptionError)
        if number < 0.0:
            raise DescriptionError(f"mass: got {number} kg; a mass is zero or positive")
        allowed = as_flag(allow_nonphysical, "allow_nonphysical", error=DescriptionError)
        centre, matrix = np.zeros(3), np.zeros((3, 3))
        if com is not None:
            centre = as_array(com, "com", (3,), error=DescriptionError).copy()
        if inertia is not None:
            matrix = _inertia_matrix(inertia).copy()
            if not allowed:
                matrix = _checked_inertia(matrix, number)
        for array in (centre, matrix):
            array.setflags(write=False)
        for field, value in (("mass", number), ("com", centre), ("inertia", matrix), ("allow_nonphysical", allowed)):
            object.__setattr__(self, field, value)

    @property
    def is_massive(self) -> bool:
        """Whether it has a mass or an inertia."""
        return bool(self.mass or self.inertia.any())

    def __setattr__(self, field: str, value: object) -> None:
        raise AttributeError(f"a Body is immutable: make a new one with another {field}")

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore_body, (self.mass, self.com, self.inertia, self.allow_nonphysical)

    def __repr__(self) -> str:
        return f"Body({self.mass:g}, com={self.com.tolist()}, inertia={self.inertia.tolist()})"


def _restore_body(mass: float, com: Array, inertia: Array, allow_nonphysical: bool) -> Body:
    return Body(mass, com=com, inertia=inertia, allow_nonphysical=allow_nonphysical)


def _inertia_matrix(inertia: ArrayLike) -> Array:
    shape = shape_of(inertia)
    if shape is None or shape not in ((3,), (6,), (3, 3)):
        raise DescriptionError(
            f"inertia: expected [Ixx, Iyy, Izz], [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] or a 3x3 matrix, "
            f"got {'shape ' + str(shape) if shape else repr(inertia)}"
        )
    values = as_array(inertia, "inertia", shape, error=DescriptionError)
    if shape == (3,):
        return np.diag(values)
    if shape == (6,):
        xx, yy, zz, xy, xz, yz = values
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    scale = float(np.abs(values).max())
    if np.abs(values - values.T).max() > INERTIA_TOLERANCE * scale:
        raise DescriptionError(f"inertia: the matrix {values.tolist()} is not symmetric; give I[i][j] = I[j][i]")
    return (values + values.T) / 2.0


def _checked_inertia(matrix: Array, mass: float) -> Array:
    """Return the inertia of a real body, without moments that are negative by rounding."""
    (smallest, middle, largest), axes = np.linalg.eigh(matrix)
    slack = INERTIA_TOLERANCE * max(abs(largest), abs(smallest)) + ROUNDING_RADIUS**2 * max(mass, _GRAM)
    moments = f"principal moments {smallest:.6g}, {middle:.6g}, {largest:.6g} kg m^2"
    if smallest < -slack:
        raise DescriptionError(
            f"inertia: {moments}; none may be negative. Check the signs of Ixy, Ixz, Iyz, that the inertia is about "
            "the centre of mass, and that six numbers are [Ixx, Iyy, Izz, Ixy, Ixz, Iyz]: URDF has another order"
        )
    if largest > smallest + middle + slack:
        raise DescriptionError(
            f"inertia: {moments}; no real body has one larger than the sum of the other two: a flat disc has J about "
            "its axis and J / 2 about others. Correct it, or say Body(..., allow_nonphysical=True) if it is meant"
        )
    if smallest < 0.0:
        return np.asarray(axes @ np.diag(np.maximum([smallest, middle, largest], 0.0)) @ axes.T)
    return matrix
