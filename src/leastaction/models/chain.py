"""A chain of pendulums: any number of equal links, one behind the other."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from leastaction.mechanics import Gravity, Mechanism, world
from leastaction.numerics.arrays import as_count
from leastaction.numerics.public import public


@public
def pendulum_chain(
    links: int = 5,
    *,
    length: float = 1.0,
    mass: float = 1.0,
    inertia: ArrayLike = (0.1, 0.2, 0.3),
    gravity: Sequence[float] = (0.0, 0.0, -9.8),
) -> Mechanism:
    """Return a planar chain of pendulums that turn about x and hang along -z at zero angles.

    Parameters
    ----------
    links : int, optional
        Number of links, at least one.
    length : float, optional
        Length of each link (m).
    mass : float, optional
        Mass at the end of each link (kg).
    inertia : array_like, optional
        Inertia of that mass about its centre (kg m^2), as `Body` takes it.
    gravity : sequence of float, optional
        Acceleration of gravity (m/s^2).

    Returns
    -------
    Mechanism
        With the variables ``theta0``, ``theta1``, ... relative to the link before, and the frames
        ``end0``, ``end1``, ... at the ends of the links.

    Raises
    ------
    ArgumentError
        If the number of links is not a positive whole number.
    """
    as_count(links, "links", 1)
    place = world()
    for k in range(links):
        place = place.rx(f"theta{k}", name=f"link{k}")
        place = place.tz(-length, name=f"end{k}", mass=mass, inertia=inertia)
    return Mechanism(place, [Gravity(gravity)])
