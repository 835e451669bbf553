"""Bricard's orthogonal linkage: a closed loop of six revolute joints that moves although it should not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.mechanics import Body, Gravity, HingeLoop, Mechanism, world
from leastaction.numerics.arrays import as_number
from leastaction.numerics.public import public

# Links from joint to joint at zero angles, along edges of a cube, and the axes of the joints before them.
# Each axis is at right angles to the links on both of its sides.
_LINKS = ((1, 0, 0), (0, -1, 0), (0, 0, 1), (-1, 0, 0), (0, 1, 0))
_AXES = "yzxyz"


@public
def bricard(*, length: float = 1.0, mass: float = 1.0, gravity: Sequence[float] = (0.0, -9.81, 0.0)) -> Mechanism:
    """Return Bricard's linkage of five equal slender rods, the sixth side of which is the ground.

    At zero angles its sides are six edges of a cube. Counting six equations for the loop of six joints
    leaves no degree of freedom, but one of them is redundant in every configuration, so that the linkage
    moves. Four of the five equations with which the last joint is closed here are independent.

    Parameters
    ----------
    length : float, optional
        Length of each rod (m).
    mass : float, optional
        Mass of each rod (kg).
    gravity : sequence of float, optional
        Acceleration of gravity (m/s^2).

    Returns
    -------
    Mechanism
        With the variables ``joint0`` ... ``joint4``, the frames ``end0`` ... ``end4`` at the ends of the rods
        and ``ground``, where the last end is held.
    """
    size = as_number(length, "length")
    across = as_number(mass, "mass") * size**2 / 12.0
    tree = world()
    place = tree
    for k, (axis, link) in enumerate(zip(_AXES, _LINKS, strict=True)):
        along = size * np.array(link, dtype=float)
        rod = Body(mass, com=along / 2.0, inertia=across * (1.0 - np.abs(link)))
        turn = {"x": place.rx, "y": place.ry, "z": place.rz}[axis]
        place = turn(f"joint{k}", bodies=[rod]).pose(translation=along, name=f"end{k}")
    tree.tz(size, name="ground")
    return Mechanism(tree, [Gravity(gravity), HingeLoop("end4", "ground", "x", name="hinge")])
