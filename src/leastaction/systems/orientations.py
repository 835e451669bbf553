"""How far frames are turned from wanted orientations: the vector of the rotation that is missing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array, as_array, as_wanted, read_only
from leastaction.optimal.quantity import Instants

Orientation = ArrayLike | Callable[[float], ArrayLike]

_ALL = slice(None)
_ONE, _MEANS, _EACH = ((3, 3), (4,)), "a matrix or a unit quaternion, scalar first", ", or one for each instant"
_OFF = 1e-6  # by which the columns of a rotation may miss being of length one and at right angles


class TurnedFrame:
    """How a frame is turned, in the world or seen from another frame, and how the variables turn it.

    Directions are the nv variables, and turns about its own axes of a rotation that is a quaternion.
    """

    def __init__(self, mechanism: Mechanism, frame: str, origin: str | None = None) -> None:
        self.mechanism, self.frame, self.origin = mechanism, frame, origin
        for name in self.frames:  # an unknown name is an error here, not at the first step
            mechanism.frame_pose(mechanism.configuration(), name)

    @property
    def frames(self) -> tuple[str, ...]:
        """The frame, and the one that it is seen from, if there is one."""
        return (self.frame,) if self.origin is None else (self.frame, self.origin)

    def rotations(self, q: Array) -> list[Array]:
        """Return the rotations (n, 3, 3) of the frames in the world at configurations (n, nq)."""
        return [self.mechanism.frame_pose(q, name)[:, :3, :3] for name in self.frames]

    def seen(self, q: Array) -> Array:
        """Return the rotation (n, 3, 3) of the frame from where it is seen."""
        R, *origin = self.rotations(q)
        return origin[0].swapaxes(1, 2) @ R if origin else R

    def turns(self, q: Array) -> list[Array]:
        """Return the angular velocities (n, 3, nv) of the frames by the rates of all directions, in world axes."""
        return [self.mechanism.frame_jacobian(q, name)[:, 3:] for name in self.frames]

    def changes(self, q: Array) -> Array:
        """Return the derivatives (n, 3, nv, nv) of the frame's angular velocity, less that of the other frame."""
        own, *other = (self.mechanism.frame_jacobian_derivative(q, name)[:, 3:] for name in self.frames)
        return own - other[0] if other else own


class MissingTurn:
    """``e = log(R_wanted' R)`` of a frame, in its own axes (rad), along configurations.

    Its derivative is ``J B`` with the frame's angular Jacobian B in its axes and J of `rotations.logarithm_derivative`;
    smooth to second order up to half a turn. ``wanted`` (n, 4): quaternions, one for each instant, or (1, 4).
    """

    def __init__(self, turned: TurnedFrame, wanted: Array) -> None:
        self.turned, self.wanted = turned, wanted

    def values(self, q: Array, k: Instants | slice = _ALL) -> Array:
        """Return e (n, 3) at configurations (n, nq) of instants k."""
        wanted = self.wanted if len(self.wanted) == 1 else self.wanted[k]
        seen = rotations.of_matrix(self.turned.seen(q))
        return rotations.logarithm(rotations.product(rotations.inverse(wanted), seen))

    def jacobian(self, q: Array, e: Array) -> Array:
        """Return the derivatives (n, 3, nv), given e."""
        return np.asarray(rotations.logarithm_derivative(e) @ self._velocities(q)[0])

    def bent(self, q: Array, e: Array, w: Array) -> Array:
        """Return the second derivatives (n, nv, nv) of ``w . e``; w (n, 3)."""
        B, back, own = self._velocities(q)
        H = B.transpose(0, 2, 1) @ rotations.logarithm_curvature(e, w) @ B
        # Angular velocities are no derivatives: of their own only the symmetric part bends the rotation. In the axes of
        # the frame they turn with it.
        pull = np.einsum("nai,na->ni", rotations.logarithm_derivative(e), w)
        in_world = np.einsum("nai,na->ni", back, pull)
        change = np.einsum("na,naij->nij", in_world, self.turned.changes(q))
        carried = np.cross(in_world[:, None], own.transpose(0, 2, 1)).transpose(0, 2, 1)
        change -= B.transpose(0, 2, 1) @ (back @ carried)
        return np.asarray(H + 0.5 * (change + change.transpose(0, 2, 1)))

    def _velocities(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the velocities (n, 3, nv) in the frame's axes, its rotation's inverse, and its turns in the world."""
        back = self.turned.rotations(q)[0].swapaxes(1, 2)
        own, *other = self.turned.turns(q)
        return back @ (own - other[0] if other else own), back, own


def quaternions_of(given: Orientation, what: str, t: Array) -> Array:
    """Return the unit quaternions (1, 4) or (n, 4) of an orientation that is wanted at times t (n,).

    ``given``: matrices or quaternions, one, or where there are several times one for each; or a function of the time.

    Raises `ArgumentError`: what is no rotation.
    """
    if callable(given):
        value = np.array([
            as_array(given(float(time)), f"{what} at t = {time:g} s", *_ONE, meaning=_MEANS) for time in t
        ])  # fmt: skip
    else:
        each = [(len(t), *shape) for shape in _ONE] if len(t) > 1 else []
        value = as_array(given, what, *_ONE, *each, meaning=_MEANS + _EACH * bool(each))
    if value.shape[-1] == 4:
        q = value.reshape(-1, 4)
        length = np.linalg.norm(q, axis=1, keepdims=True)
        worst = float(length.flat[int(np.argmax(np.abs(length - 1.0)))])
        if abs(worst - 1.0) > _OFF:
            raise ArgumentError(
                f"{what}: got a quaternion of length {worst:.6g}, expected 1: a rotation's, scalar first"
            )
        return read_only(q / length)
    R = value.reshape(-1, 3, 3)
    off = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(initial=0.0)
    if off > _OFF or (np.linalg.det(R) < 0.0).any():
        raise ArgumentError(
            f"{what}: got a matrix that is no rotation (off by {max(off, _OFF):.3g}), expected one whose columns are "
            "of length one, at right angles and right-handed"
        )
    return read_only(rotations.of_matrix(R))


def known_quaternions(given: Orientation, what: str, t: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the same, and of which (1,) or (n,) a rotation is wanted: NaN in all of its numbers says of which none is.

    Raises `ArgumentError`: what is no rotation, or part of one.
    """
    if callable(given):
        return quaternions_of(given, what, t), np.ones(len(t), dtype=np.bool_)
    values = as_wanted(given, what, *_ONE, *((len(t), *shape) for shape in _ONE), meaning=_MEANS + _EACH)
    one = np.eye(3) if values.shape[-2:] == (3, 3) else np.eye(4)[0]
    left_out = np.isnan(values).reshape(-1, one.size)
    known = np.asarray(~left_out.all(axis=1))
    torn = np.flatnonzero(known & left_out.any(axis=1))
    if len(torn) or not known.any():
        at = f"part of a rotation at t = {t[torn[0]]:g} s" if len(torn) else "nothing but NaN"
        raise ArgumentError(f"{what}: got {at}, expected whole rotations, and NaN in all numbers where none is wanted")
    return quaternions_of(np.where(np.isnan(values), one, values), what, t), known
