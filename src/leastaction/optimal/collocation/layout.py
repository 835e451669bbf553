"""Where states and inputs of the points of a piece are in the state of the discrete system on a mesh."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.mesh import STAGES
from leastaction.optimal.quantity import Instants

# The state at the end of a piece comes first, then those of its other points.
ORDER = np.array([STAGES - 1, *range(STAGES - 1)])
PLACE = np.argsort(ORDER)


class NodeLayout:
    """Where states and inputs of the points are in the state of the discrete system, ``z = [x(end); x(others); u]``.

    The end of a piece comes first, so the state of the continuous system is the first nx entries.
    """

    def __init__(self, nx: int, nu: int) -> None:
        self.nx, self.nu = nx, nu
        self.nz = STAGES * (nx + nu)
        # Which entries of [A B] may differ from zero: inputs are copied, and the rest depends on the end before.
        self.pattern = np.zeros((self.nz, self.nz + STAGES * nu), dtype=np.bool_)
        self.pattern[: STAGES * nx, :nx] = self.pattern[: STAGES * nx, self.nz :] = True
        self.pattern[STAGES * nx :, self.nz :] = np.eye(STAGES * nu, dtype=np.bool_)
        self.pattern.setflags(write=False)
        # The entries of [z; u] that it has columns of, and those of a matrix by them that are packed.
        self.used = np.concatenate([np.arange(nx), self.nz + np.arange(STAGES * nu)])
        self.lower = np.tril_indices(len(self.used))

    def places(self, stage: int) -> Instants:
        """Return where state and input of a point are in z, (nx + nu,)."""
        x = int(PLACE[stage]) * self.nx + np.arange(self.nx)
        return np.concatenate([x, STAGES * self.nx + stage * self.nu + np.arange(self.nu)])

    def points(self, z: Array) -> tuple[Array, Array]:
        """Return states (n, STAGES, nx) and inputs (n, STAGES, nu) of the points, given z (n, nz)."""
        x = z[:, : STAGES * self.nx].reshape(len(z), STAGES, self.nx)[:, PLACE]
        return x, z[:, STAGES * self.nx :].reshape(len(z), STAGES, self.nu)

    def joined(self, x: Array, u: Array) -> Array:
        """Return z (n, nz) of states and inputs of the points."""
        n = len(x)
        return np.hstack([x[:, ORDER].reshape(n, -1), u.reshape(n, -1)])
