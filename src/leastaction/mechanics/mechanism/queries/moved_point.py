"""Points of frames, and how the variables move them: for limits and costs of many instants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from numpy.typing import ArrayLike

from leastaction.mechanics.mechanism.arguments import Compiled, frame_index
from leastaction.numerics.arrays import Array, as_array


@dataclass(frozen=True)
class MovedPoint:
    """A point of a frame: behind joint ``joint`` (-1: the world), at ``offset`` in its axes."""

    mechanism: Compiled
    joint: int
    offset: tuple[float, float, float]

    @classmethod
    def of(cls, m: Compiled, frame: str, point: ArrayLike = (0.0, 0.0, 0.0)) -> Self:
        """Look up a point (3,) of a frame, in its axes."""
        placed = m.tree.frames[frame_index(m, frame)]
        x, y, z = placed.pose[:3, :3] @ as_array(point, "point", (3,)) + placed.pose[:3, 3]
        return cls(m, placed.joint, (float(x), float(y), float(z)))

    def places(self, q: Array) -> Array:
        """Return where it is at configurations (N, nq), (N, 3)."""
        return self.mechanism.core.point_places(q, self.joint, self.offset)

    def jacobian(self, q: Array) -> Array:
        """Return its derivatives (N, 3, nq)."""
        return self.mechanism.core.point_jacobians(q, self.joint, self.offset)

    def bent(self, q: Array, force: Array) -> Array:
        """Return the second derivatives (N, nq, nq) of how far forces (N, 3), which do not turn, move it along."""
        return self.mechanism.core.point_bent(q, self.joint, self.offset, force)
