"""A scissor lift that hangs from its upper end: many closed loops, one degree of freedom (dissertation 5.1)."""

from __future__ import annotations

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Body, Damping, Element, Gravity, JointForce, Mechanism, PointToPoint, world
from leastaction.numerics.arrays import Array, as_count, as_number
from leastaction.numerics.public import public


@public
def scissor_lift(
    segments: int = 5,
    *,
    length: float = 1.0,
    mass: float = 1.0,
    inertia: float | None = None,
    slider_mass: float = 0.5,
    damping: float = 0.0,
    gravity: float = 9.8,
) -> Mechanism:
    """Return a lift of crossed links, two a segment, in the x-z plane.

    The upper end of one link is pinned to the origin, that of the other to a slider on the x axis; the lift hangs
    below. Both links of a segment are pinned at their middles. Where all links are in line, upright or level, the pins'
    equations lose rank, and other motions branch off. The input ``push`` acts on the slider, along x.

    Parameters
    ----------
    segments : int, optional
        Number of segments, at least one.
    length : float, optional
        Length of a link (m).
    mass : float, optional
        Mass of a link, in its middle (kg).
    inertia : float, optional
        Inertia of a link about its middle (kg m^2); that of a slender rod, ``mass length^2 / 12``, if left out.
    slider_mass : float, optional
        Mass of the slider (kg).
    damping : float, optional
        Damping of every joint at an end of a link (N m s/rad), of the angle between the links that meet there; those at
        the top turn against the world and the slider. Left out if zero.
    gravity : float, optional
        Acceleration of gravity, along -z (m/s^2).

    Returns
    -------
    Mechanism
        With the variables ``slider`` (m) and, for each segment, ``L0``, ``R0``, ``L1`` ... (rad): of the links that
        begin at its left and at its right joint, from the x axis downwards at the top, from the link above elsewhere.
        Frames ``middle_L0`` ... are the pins' places, ``end_L0`` ... the lower ends.

    Raises
    ------
    ArgumentError
        If the number of segments is not a positive whole number, or a number is not finite.
    """
    as_count(segments, "segments", 1)
    size, heavy = as_number(length, "length"), as_number(mass, "mass")
    about = heavy * size**2 / 12.0 if inertia is None else as_number(inertia, "inertia")
    link = Body(heavy, com=(size / 2.0, 0.0, 0.0), inertia=(0.0, about, about))
    tree = world()
    left, right = tree, tree.tx("slider", bodies=[Body(slider_mass)])
    for n in range(segments):
        down = {"L": left.ry(f"L{n}", bodies=[link]), "R": right.ry(f"R{n}", bodies=[link])}
        for side, branch in down.items():
            branch.tx(size / 2.0, name=f"middle_{side}{n}")
        right, left = (branch.tx(size, name=f"end_{side}{n}") for side, branch in down.items())
    elements: list[Element] = [Gravity((0.0, 0.0, -gravity)), JointForce("slider", input="push")]
    if damping:
        elements.append(Damping({f"{side}{n}": damping for n in range(segments) for side in "LR"}))
    elements += [PointToPoint(f"middle_L{n}", f"middle_R{n}", "xz", name=f"pin{n}") for n in range(segments)]
    return Mechanism(tree, elements)


@public
def at_angle(mechanism: Mechanism, angle: float, rate: float = 0.0) -> tuple[Array, Array]:
    """Return the configuration and velocity of a lift whose links are all at one angle below the level.

    Parameters
    ----------
    mechanism : Mechanism
        As `scissor_lift` returns it.
    angle : float
        Angle (rad); upright at pi/2.
    rate : float, optional
        Its angular velocity (rad/s).

    Returns
    -------
    q, v : ndarray, shape (nq,)

    Raises
    ------
    ArgumentError
        If the mechanism is not a lift.
    """
    if "end_L0" not in mechanism.frames or "slider" not in mechanism.variables:
        raise ArgumentError("mechanism: got one without the frames of a lift, expected the result of scissor_lift()")
    length = float(np.linalg.norm(mechanism.positions(np.zeros(mechanism.nq), ["end_L0"])))
    q, v = np.empty(mechanism.nq), np.empty(mechanism.nq)
    for i, name in enumerate(mechanism.variables):
        sign = 1.0 if name[0] == "L" else -1.0
        if name == "slider":
            q[i], v[i] = length * np.cos(angle), -length * np.sin(angle) * rate
        elif name in ("L0", "R0"):
            q[i], v[i] = angle if name == "L0" else np.pi - angle, sign * rate
        else:
            # From the link above, which leans the other way.
            q[i], v[i] = -sign * (np.pi - 2.0 * angle), 2.0 * sign * rate
    return q, v
