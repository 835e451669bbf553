"""What the equations of motion in continuous time return: accelerations, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field

from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class Accelerations:
    """Accelerations and multipliers of one point, or of N points with a leading axis.

    Attributes
    ----------
    a : ndarray, shape (nd,)
        Accelerations of the dynamic variables (rad/s^2 or m/s^2).
    lam : ndarray, shape (nc,)
        Multipliers: the generalised force of the constraints is ``Dh^T lam``.
    rank_deficient : bool
        Whether constraints were redundant at some point: of all multipliers those of least norm are given.
    """

    a: Array
    lam: Array
    rank_deficient: bool = False


@public
@dataclass(frozen=True)
class AccelerationDerivatives:
    """First derivatives of accelerations and multipliers, at one point or at N with a leading axis.

    Attributes
    ----------
    a, lam : ndarray, shape (nd,), (nc,)
        The accelerations and multipliers themselves.
    all : ndarray, shape (nd + nc, 2 nv + n_inputs + nrho)
        Of ``[a; lam]`` by ``[q; v; u; rho_a]``; the other fields are views of it.
    sizes : tuple of int
        nd, nv, n_inputs.
    """

    a: Array = field(repr=False)
    lam: Array = field(repr=False)
    all: Array = field(repr=False)
    sizes: tuple[int, int, int]

    def _block(self, rows: slice, argument: int) -> Array:
        _, nv, n_inputs = self.sizes
        ends = (0, nv, 2 * nv, 2 * nv + n_inputs, self.all.shape[-1])
        return self.all[..., rows, ends[argument] : ends[argument + 1]]

    @property
    def a_dq(self) -> Array:
        """Accelerations by configuration, shape (nd, nv): of quaternions by turns in the body."""
        return self._block(slice(0, self.sizes[0]), 0)

    @property
    def a_dv(self) -> Array:
        """Accelerations by velocity, shape (nd, nv)."""
        return self._block(slice(0, self.sizes[0]), 1)

    @property
    def a_du(self) -> Array:
        """Accelerations by input, shape (nd, n_inputs)."""
        return self._block(slice(0, self.sizes[0]), 2)

    @property
    def a_drho_a(self) -> Array:
        """Accelerations by kinematic acceleration, shape (nd, nrho)."""
        return self._block(slice(0, self.sizes[0]), 3)

    @property
    def lam_dq(self) -> Array:
        """Multipliers by configuration, shape (nc, nv)."""
        return self._block(slice(self.sizes[0], None), 0)

    @property
    def lam_dv(self) -> Array:
        """Multipliers by velocity, shape (nc, nv)."""
        return self._block(slice(self.sizes[0], None), 1)

    @property
    def lam_du(self) -> Array:
        """Multipliers by input, shape (nc, n_inputs)."""
        return self._block(slice(self.sizes[0], None), 2)

    @property
    def lam_drho_a(self) -> Array:
        """Multipliers by kinematic acceleration, shape (nc, nrho)."""
        return self._block(slice(self.sizes[0], None), 3)


@public
@dataclass(frozen=True)
class AccelerationTensors:
    """Full second derivatives at one point; output index first, then ``[q; v; u; rho_a]`` twice.

    Attributes
    ----------
    a : ndarray, shape (nd, n, n), n = 2 nv + n_inputs + nrho
        Of the accelerations.
    lam : ndarray, shape (nc, n, n)
        Of the multipliers.
    """

    a: Array = field(repr=False)
    lam: Array = field(repr=False)
