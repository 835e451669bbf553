"""The puppet's poses by angles as those of its ball joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array, require_mapping
from leastaction.numerics.public import public

_TURNED: Final = ("torso", "lhip", "rhip", "lshoulder", "rshoulder")


@public
def turns_of_angles(values: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Return values of the marionette by angles as those of the one with ``axes="quaternion"``.

    Parameters
    ----------
    values : mapping of str to array_like
        By the names of its variables, such as ``"lshoulder_rx"``: numbers, or values over time (N+1,). What is not
        given of a joint is zero.

    Returns
    -------
    dict of str to ndarray
        All else by its name, and of every joint of which an angle is given unit quaternions by their numbers, such as
        ``"lshoulder.qw"``: without jumps where values are over time.
    """
    require_mapping(values, "values", "{'lshoulder_rx': 1.0}")
    given = {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}
    found = {name: value for name, value in given.items() if not _of_turns(name)}
    for joint in _TURNED:
        angles = [given.get(f"{joint}_r{letter}") for letter in "zyx"]
        if any(angle is not None for angle in angles):
            vectors = np.broadcast_arrays(*(0.0 if angle is None else angle for angle in angles))
            z, y, x = (
                rotations.exponential(each[..., None] * axis)
                for each, axis in zip(vectors, np.eye(3)[::-1], strict=True)
            )
            turn = rotations.product(rotations.product(z, y), x)
            if turn.ndim > 1:  # which of two quaternions stands for a rotation
                turn[1:] *= np.cumprod(np.sign(np.sum(turn[1:] * turn[:-1], axis=1)))[:, None]
            found |= {f"{joint}.q{letter}": turn[..., i] for i, letter in enumerate("wxyz")}
    return found


def _of_turns(name: str) -> bool:
    """Whether a variable is an angle of a joint that turns any way."""
    return any(name == f"{joint}_r{letter}" for joint in _TURNED for letter in "xyz")
