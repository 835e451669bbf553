"""Many balls, or their outsides, each with a point of its own: all at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Instants
from leastaction.systems.regions.regions import Ball, Outside, Region


class Balls:
    """R balls, or the outsides of some, as functions of a point for each; nothing in it changes.

    ``names``: what each function says. ``bend`` (R,): the second derivatives of each are that times the identity.
    """

    def __init__(self, names: Sequence[str], balls: Sequence[Ball], sign: Sequence[float]) -> None:
        self.names = tuple(names)
        self._balls, self._radius = tuple(balls), np.array([ball.radius for ball in balls])
        self.bend = -np.array(sign) / self._radius
        moves = any(isinstance(ball.center, np.ndarray) and ball.center.ndim > 1 for ball in balls)
        self._still = None if moves else self._all_centers(np.zeros(1, dtype=np.intp))

    def values(self, p: Array, k: Instants) -> Array:
        """Return how far points p (n, R, 3) are inside at instants k (n,), (n, R); as each `Region` says."""
        d = p - self._centers(k)
        return np.asarray(-0.5 * self.bend * (self._radius**2 - np.einsum("nri,nri->nr", d, d)))

    def gradient(self, p: Array, k: Instants) -> Array:
        """Return the derivatives (n, R, 3)."""
        return np.asarray((p - self._centers(k)) * self.bend[:, None])

    def _centers(self, k: Instants) -> Array:
        return self._all_centers(k) if self._still is None else self._still

    def _all_centers(self, k: Instants) -> Array:
        return np.stack([np.broadcast_to(ball.center_at(k), (len(k), 3)) for ball in self._balls], axis=1)


def balls_of(regions: Sequence[Region]) -> Balls | None:
    """Return regions as balls and their outsides; None where some are other than that."""
    inside = [region.region if isinstance(region, Outside) else region for region in regions]
    balls = [each for each in inside if isinstance(each, Ball)]
    if len(balls) < len(regions):
        return None
    names = [name for region in regions for name in region.names]
    return Balls(names, balls, [-1.0 if isinstance(region, Outside) else 1.0 for region in regions])
