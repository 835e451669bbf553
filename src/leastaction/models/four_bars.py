"""A row of four-bar linkages that share their cranks (benchmark A02 of the IFToMM library of multibody systems)."""

from __future__ import annotations

import numpy as np

from leastaction.mechanics import Body, Gravity, Mechanism, PointToPoint, world
from leastaction.numerics.arrays import Array, as_count, as_number
from leastaction.numerics.public import public


@public
def four_bars(loops: int = 2, *, length: float = 1.0, mass: float = 1.0, gravity: float = 9.81) -> Mechanism:
    """Return equal four-bar linkages in a row, in the x-y plane.

    One more crank than there are loops turns on the ground; a coupler joins each to the next. All of these ``2 loops +
    1`` links are equal slender rods. The whole row moves as one as long as the cranks are not in line with the
    couplers: there the constraints lose rank, and its one degree of freedom becomes ``loops + 1``.

    Parameters
    ----------
    loops : int, optional
        Number of four-bar linkages, at least one.
    length : float, optional
        Length of each link (m), and the distance of the pivots on the ground.
    mass : float, optional
        Mass of each link (kg).
    gravity : float, optional
        Acceleration of gravity, along -y (m/s^2).

    Returns
    -------
    Mechanism
        With the variables ``crank0``, ``coupler0``, ``crank1`` ... (cranks from the x axis, couplers from
        their cranks), and the frames ``A0`` ... of the pivots, ``B0`` ... of the ends of the cranks and
        ``C0`` ... of the couplers.

    Raises
    ------
    ArgumentError
        If the number of loops is not a positive whole number, or a number is not finite.
    """
    as_count(loops, "loops", 1)
    size = as_number(length, "length")
    across = as_number(mass, "mass") * size**2 / 12.0
    rod = Body(mass, com=(size / 2.0, 0.0, 0.0), inertia=(0.0, across, across))
    tree = world()
    for k in range(loops + 1):
        pivot = tree.tx(k * size, name=f"A{k}")
        end = pivot.rz(f"crank{k}", bodies=[rod]).tx(size, name=f"B{k}")
        if k < loops:
            end.rz(f"coupler{k}", bodies=[rod]).tx(size, name=f"C{k}")
    joints = [PointToPoint(f"C{k}", f"B{k + 1}", "xy", name=f"loop{k}") for k in range(loops)]
    return Mechanism(tree, [Gravity((0.0, -gravity, 0.0)), *joints])


@public
def at_angle(mechanism: Mechanism, angle: float, rate: float) -> tuple[Array, Array]:
    """Return the configuration and velocity in which all cranks turn as one and the couplers do not turn.

    Parameters
    ----------
    mechanism : Mechanism
        As `four_bars` returns it.
    angle : float
        Angle of the cranks from the x axis (rad); upright at pi/2.
    rate : float
        Their angular velocity (rad/s).

    Returns
    -------
    q, v : ndarray, shape (nq,)
    """
    sign = np.array([1.0 if name.startswith("crank") else -1.0 for name in mechanism.variables])
    return angle * sign, rate * sign
