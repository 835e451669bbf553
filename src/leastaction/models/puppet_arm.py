"""An arm of two links in a plane that hangs on one string (dissertation 6.7.2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics import Body, Damping, Distance, Gravity, Mechanism, rz, tx, ty
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.public import public

STRING = ("string-x", "string-length")
"""The kinematic variables: the place of the string's upper end along x, and its length (m)."""


@public
def puppet_arm(
    *,
    upper: float = 0.25,
    fore: float = 0.25,
    upper_mass: float = 0.2,
    fore_mass: float = 0.15,
    height: float = 0.8,
    damping: float = 2e-3,
) -> Mechanism:
    """Return an arm that turns at a fixed shoulder and at its elbow, on a string from its hand up to a carriage.

    The arm hangs along -y at zero angles and turns about z. The carriage moves along x, at a height above the shoulder,
    and reels the string in and out.

    Parameters
    ----------
    upper, fore : float, optional
        Lengths of the upper arm and the forearm (m).
    upper_mass, fore_mass : float, optional
        Their masses (kg), slender rods.
    height : float, optional
        Height of the carriage above the shoulder (m).
    damping : float, optional
        Damping of both joints (N m s/rad).

    Returns
    -------
    Mechanism
        With the variables ``shoulder`` and ``elbow`` (rad) and the kinematic ones of `STRING`, the constraint
        ``string`` and the frames ``elbow end``, ``hand`` and ``carriage``.
    """
    rods = [
        Body(mass, com=(0.0, -length / 2.0, 0.0), inertia=(mass * length**2 / 12.0, 0.0, mass * length**2 / 12.0))
        for mass, length in ((upper_mass, upper), (fore_mass, fore))
    ]
    return Mechanism(
        [
            rz("shoulder", name="upper arm", bodies=[rods[0]]), [
                ty(-upper, name="elbow end"), [
                    rz("elbow", name="forearm", bodies=[rods[1]]), [
                        ty(-fore, name="hand"),
                    ],
                ],
            ],
            ty(height, name="rail"), [
                tx(STRING[0], name="carriage", kinematic=True),
            ],
        ],
        [Gravity((0.0, -9.8, 0.0)), Damping(damping), Distance("hand", "carriage", STRING[1], name="string")],
    )  # fmt: skip


@public
def hang(mechanism: Mechanism, angles: ArrayLike) -> Array:
    """Return configurations with the carriage straight above the hand and the string taut.

    Parameters
    ----------
    mechanism : Mechanism
        As `puppet_arm` returns it.
    angles : array_like, shape (2,) or (N, 2)
        Of shoulder and elbow (rad).

    Returns
    -------
    ndarray, shape (4,) or (N, 4)

    Raises
    ------
    ArgumentError
        If the hand is not below the carriage.
    """
    joints = as_array(angles, "angles", (2,), (None, 2), meaning="shoulder and elbow")
    q = np.concatenate([joints, np.zeros_like(joints)], axis=-1)
    ends = mechanism.positions(q, ["hand", "carriage"])
    q[..., 2] = ends[..., 0, 0]
    q[..., 3] = ends[..., 1, 1] - ends[..., 0, 1]
    if np.any(q[..., 3] <= 0.0):
        raise ArgumentError(f"angles: got some that lift the hand {-q[..., 3].min():.3g} m above the carriage")
    return q
