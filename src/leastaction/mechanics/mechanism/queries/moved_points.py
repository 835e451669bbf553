"""Points of frames, and how the variables move them: for limits and costs of many instants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from leastaction.mechanics.mechanism.arguments import Compiled, frame_index
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class MovedPoints:
    """P points of frames: behind joints ``joints`` (-1: the world), at ``offsets`` (P, 3) in their axes.

    Derivatives are by the nv directions in which configurations move: variables, and turns of quaternions.
    """

    mechanism: Compiled
    joints: tuple[int, ...]
    offsets: Array

    @classmethod
    def of(cls, m: Compiled, frames: Sequence[str], points: Sequence[ArrayLike] | None = None) -> Self:
        """Look up points (3,) of frames, each in the axes of its own; their origins if none are given."""
        joints, offsets = [], np.zeros((len(frames), 3))
        for i, frame in enumerate(frames):
            placed = m.tree.frames[frame_index(m, frame)]
            point = np.zeros(3) if points is None else as_array(points[i], "point", (3,))
            joints.append(placed.joint)
            offsets[i] = placed.pose[:3, :3] @ point + placed.pose[:3, 3]
        return cls(m, tuple(joints), read_only(offsets))

    def places(self, q: Array) -> Array:
        """Return where they are at configurations (N, nq), (N, P, 3)."""
        return self.mechanism.core.point_places(q, self.joints, self.offsets)

    def slopes(self, q: Array, of: Sequence[int], along: Array) -> Array:
        """Return how far the points ``of`` (R,) move along vectors (N, R, 3), or (1, R, 3): derivatives (N, R, nv)."""
        return self.mechanism.core.point_slopes(q, self.joints, self.offsets, of, along)

    def jacobian(self, q: Array) -> Array:
        """Return the derivatives (N, P, 3, nv) of their places."""
        P = len(self.joints)
        slopes = self.slopes(q, np.repeat(np.arange(P), 3).tolist(), np.tile(np.eye(3), (P, 1))[None])
        return slopes.reshape(len(q), P, 3, slopes.shape[-1])

    def bent(self, q: Array, force: Array, weight: Array | None = None) -> Array:
        """Return second derivatives (N, nv, nv), summed over the points.

        Of how far forces (N, P, 3), which do not turn, move them along; and weights (N, P) times the products of their
        first ones.
        """
        weight = np.zeros(force.shape[:2]) if weight is None else weight
        return self.mechanism.core.point_bent(q, self.joints, self.offsets, force, weight)

    def apart(self, q: Array) -> Array:
        """Return where the points of the first half are, seen from those of the second, (N, P/2, 3)."""
        half = len(self.joints) // 2
        places = self.places(q)
        return np.asarray(places[:, :half] - places[:, half:])

    def apart_slopes(self, q: Array, along: Array) -> Array:
        """Return how far they move apart along vectors (N, P/2, 3): derivatives (N, P/2, nv)."""
        half = len(self.joints) // 2
        moved = self.slopes(q, range(2 * half), np.concatenate([along, -along], axis=1))
        return np.asarray(moved[:, :half] + moved[:, half:])

    def apart_bent(self, q: Array, along: Array, stiff: Array, weight: Array) -> Array:
        """Return products of the derivatives D (N, P/2, 3, nv) of that, (N, nv, nv), summed over the pairs.

        Of those along vectors (N, P/2, 3) times `stiff` (N, P/2), and of all three times `weight` (N, P/2).
        """
        return self.mechanism.core.point_apart_bent(q, self.joints, self.offsets, along, stiff, weight)
