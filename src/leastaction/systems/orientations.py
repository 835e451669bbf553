"""How far frames are turned from wanted orientations: the vector of the rotation that is missing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.optimal.quantity import Instants

Orientation = ArrayLike | Callable[[float], ArrayLike]

_ALL = slice(None)
_OFF = 1e-6  # by which the columns of a rotation may miss being of length one and at right angles


class MissingTurn:
    """``e = log(R_wanted' R)`` of a frame, in its own axes (rad), along configurations.

    Its derivative is ``J B`` with the frame's angular Jacobian B in its axes and J of `rotations.logarithm_derivative`;
    smooth to second order up to half a turn. ``wanted`` (n, 4): quaternions, one for each instant, or (1, 4).
    """

    def __init__(self, mechanism: Mechanism, frame: str, wanted: Array) -> None:
        self.mechanism, self.frame, self.wanted = mechanism, frame, wanted
        mechanism.frame_pose(np.zeros(mechanism.nq), frame)  # an unknown name is an error here, not at the first step

    def values(self, q: Array, k: Instants | slice = _ALL) -> Array:
        """Return e (n, 3) at configurations (n, nq) of instants k."""
        R = self.mechanism.frame_pose(q, self.frame)[:, :3, :3]
        wanted = self.wanted if len(self.wanted) == 1 else self.wanted[k]
        return rotations.logarithm(rotations.product(rotations.inverse(wanted), rotations.of_matrix(R)))

    def jacobian(self, q: Array, e: Array) -> Array:
        """Return the derivatives (n, 3, nq), given e."""
        return np.asarray(rotations.logarithm_derivative(e) @ self._turns(q))

    def bent(self, q: Array, e: Array, w: Array) -> Array:
        """Return the second derivatives (n, nq, nq) of ``w . e``; w (n, 3)."""
        B = self._turns(q)
        slopes = self.mechanism.frame_jacobian_derivative(q, self.frame, axes="frame")[:, 3:]
        pull = np.einsum("nai,na->ni", rotations.logarithm_derivative(e), w)
        H = B.transpose(0, 2, 1) @ rotations.logarithm_curvature(e, w) @ B
        # Angular velocities are no derivatives: of their own only the symmetric part bends the rotation.
        own = np.einsum("na,naij->nij", pull, slopes)
        return np.asarray(H + 0.5 * (own + own.transpose(0, 2, 1)))

    def _turns(self, q: Array) -> Array:
        return self.mechanism.frame_jacobian(q, self.frame, axes="frame")[:, 3:]


def quaternions_of(given: Orientation, what: str, t: Array) -> Array:
    """Return the unit quaternions (1, 4) or (n, 4) of an orientation that is wanted at times t (n,).

    Raises
    ------
    ArgumentError
        What is no rotation.
    """
    if callable(given):
        value = np.array([as_array(given(float(time)), f"{what} at t = {time:g} s", (3, 3)) for time in t])
    else:
        value = as_array(given, what, (3, 3), (len(t), 3, 3), meaning="(3, 3), or one for each instant")
    R = value.reshape(-1, 3, 3)
    off = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(initial=0.0)
    if off > _OFF or (np.linalg.det(R) < 0.0).any():
        raise ArgumentError(
            f"{what}: got a matrix that is no rotation (off by {max(off, _OFF):.3g}), expected one whose columns are "
            "of length one, at right angles and right-handed"
        )
    return read_only(rotations.of_matrix(R))
