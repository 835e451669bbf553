"""What may be wanted over time: values of variables, turns of joints, places and orientations of frames."""

from __future__ import annotations

from enum import Enum, auto

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array


class WantedKind(Enum):
    """What is wanted, as the shape of its values tells."""

    VALUE = auto()
    """(N+1,), of a variable."""
    PLACE = auto()
    """(N+1, 3), of a frame (m)."""
    TURN = auto()
    """(N+1, 4), of a joint that turns as a unit quaternion."""
    ORIENTATION = auto()
    """(N+1, 3, 3), of a frame: a rotation."""


def kind_of(values: Array) -> WantedKind:
    """Return what is wanted."""
    if values.ndim == 1:
        return WantedKind.VALUE
    if values.ndim == 3:
        return WantedKind.ORIENTATION
    return WantedKind.PLACE if values.shape[1] == 3 else WantedKind.TURN


def quaternion_of(m: Mechanism, name: str) -> slice:
    """Return where the quaternion of a joint stands in a configuration."""
    (rotation,) = (each for each in m.tree.rotations if each.name == name)
    first = m.coordinates.index(rotation.quaternion[0])
    return slice(first, first + 4)


def turns_of(m: Mechanism, name: str) -> slice:
    """Return where the angular velocity of a joint stands among the velocities."""
    (rotation,) = (each for each in m.tree.rotations if each.name == name)
    first = m.variables.index(rotation.variables[0])
    return slice(first, first + 3)
