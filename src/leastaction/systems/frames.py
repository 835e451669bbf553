"""What limits on frames of a mechanism share: quantities of the configuration, in either kind of time."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.limits import Points
from leastaction.optimal.limits.limit import Horizon, Limit
from leastaction.optimal.quantity import Instants, Quantity, Samples
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.midpoint import MidpointSystem


class OfConfiguration(Quantity):
    """Functions of the configuration alone, whose derivatives are by the nv directions of a mechanism's velocities."""

    of_state = True

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        return np.arange(self.mechanism.nv)

    def q(self, at: Samples) -> Array:
        """Return the configurations (n, nq)."""
        return np.ascontiguousarray(at.x[:, : self.mechanism.nq])


def frames_of(system: Horizon, limit: Limit) -> tuple[Mechanism, Array]:
    """Return the mechanism of a system whose frames have names, and the times of its instants."""
    given: Any = system.system if isinstance(system, Points) else system
    if not isinstance(given, MidpointSystem | MechanismSystem):
        raise ArgumentError(
            f"{limit}: got a {type(given).__name__}, expected a MidpointSystem or a MechanismSystem: their frames "
            "have names"
        )
    t: Array = getattr(system, "t")  # noqa: B009 - both have times
    return given.mechanism, t


def places_alike(one: Mechanism, other: Mechanism) -> bool:
    """Return whether the frames of a mechanism are where they are with other parameters."""
    if one.tree is other.tree:
        return True
    joints = zip(one.tree.joints, other.tree.joints, strict=True)
    for a, b in joints:
        if a.coordinate != b.coordinate or not (np.array_equal(a.pose, b.pose) and np.array_equal(a.twist, b.twist)):
            return False
    frames = zip(one.tree.frames, other.tree.frames, strict=True)
    return all(np.array_equal(a.pose, b.pose) for a, b in frames)
