"""What the linearisation of a trajectory returns: derivatives of its steps, of first and of second order."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import prescribed_rotations
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.public import public


@public
@dataclass(frozen=True, eq=False)
class StepDerivatives:
    """Derivatives of every step of a trajectory: first ones, and contracted second ones for the asking.

    It owns its memory: whatever becomes of the arrays that it was made from, it stays what it is, until it is
    given up as the `out` of another call. It can be read, and asked for curvatures, by many threads at once.
    The state of a step is ``x = [q; rho; p; v_rho]``, its input ``u = [inputs; rho_next]``; where the
    derivatives of the multipliers were asked for, these stand after the state, ``[x; lam]``, in `A_all` and
    `B_all`. Where a rotation is a quaternion, derivatives are of and by differences of states, which have ndx numbers:
    of ``difference(f(plus(x, dx), u), f(x, u))``, with turns in the axes of the body. All arrays are
    read-only views of its memory.

    Attributes
    ----------
    core : Linearization of the core
    integrator : Integrator
        What made it.
    """

    core: _core.Linearization = field(repr=False)
    integrator: Integrator

    def __reduce__(self) -> tuple[Any, ...]:
        more = self.A_all.shape[1] > self.mechanism.ndx
        return _restored, (self.integrator, self.steps, more, self.core.saved())

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that makes the steps."""
        return self.integrator.mechanism

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return len(self.core.defect)

    @property
    def A_all(self) -> Array:
        """Next state, and multipliers, by both, shape (N, ny, ny)."""
        return self.core.A

    @property
    def B_all(self) -> Array:
        """Next state, and multipliers, by input, shape (N, ny, n_inputs + nrho)."""
        return self.core.B

    @property
    def A(self) -> Array:
        """Next state by state, shape (N, ndx, ndx)."""
        ndx = self.mechanism.ndx
        return self.core.A[:, :ndx, :ndx]

    @property
    def B(self) -> Array:
        """Next state by input, shape (N, ndx, n_inputs + nrho)."""
        return self.core.B[:, : self.mechanism.ndx]

    @property
    def lam(self) -> Array:
        """Multipliers, shape (N, nc)."""
        return self.core.lam

    @property
    def lam_dx(self) -> Array:
        """Multipliers by state, shape (N, nc, ndx); of no rows unless asked for."""
        ndx = self.mechanism.ndx
        return self.core.A[:, ndx:, :ndx]

    @property
    def lam_du(self) -> Array:
        """Multipliers by input, shape (N, nc, n_inputs + nrho); of no rows unless asked for."""
        return self.core.B[:, self.mechanism.ndx :]

    @property
    def defect(self) -> Array:
        """How far the dynamic configuration that each step leads to is from the given one, shape (N,)."""
        return self.core.defect

    def curvature(self, z: ArrayLike, *, z_lam: ArrayLike | None = None) -> Array:
        """Return the contracted second derivatives of every step.

        Parameters
        ----------
        z : array_like, shape (N, ndx)
            Weights on the next state of each step.
        z_lam : array_like, shape (N, nc), optional
            Weights on the multipliers of each step.

        Returns
        -------
        ndarray, shape (N, ndx + n_inputs + nrho, ndx + n_inputs + nrho)
            Hessian of ``z_k . x_{k+1} + z_lam_k . lam_k`` by ``[x_k; u_k]``, read-only. Its memory is used again
            once nobody holds it any more.

        Raises
        ------
        ArgumentError
            For wrong shapes, or weights that are not finite.
        """
        m, N = self.mechanism, self.steps
        weights = as_array(z, "z", (N, m.ndx))
        if z_lam is not None:
            weights = np.hstack([weights, as_array(z_lam, "z_lam", (N, m.nc))])
        return self.core.curvature(weights, False, self.integrator.threads)

    def curvature_all(self, z: Array) -> Array:
        """Return the Hessians (N, ny + nu, ny + nu) by the states of `A_all`, weighted with z (N, ny)."""
        more = self.core.A.shape[1] > self.mechanism.ndx
        return self.core.curvature(z, more, self.integrator.threads)

    def packed_curvature_all(self, z: Array) -> Array:
        """Return lower triangles of the same Hessians, by rows, of inputs and what `step_pattern` has entries of."""
        return self.core.packed_curvature(z, self.integrator.threads)


def step_pattern(mechanism: Mechanism, *, multipliers: bool) -> npt.NDArray[np.bool_]:
    """Return which entries of ``[A_all B_all]`` may differ from zero, at any step, shape (ny, ny + n_inputs + nrho).

    The dynamic variables, their momenta and the multipliers depend on everything but the rates of the prescribed
    variables and the multipliers; what is prescribed is copied or differenced. ``multipliers``: whether these stand
    after the state.
    """
    m = mechanism
    nv, ny = m.nv, m.ndx + (m.nc if multipliers else 0)
    dynamic = np.zeros(ny, dtype=bool)
    dynamic[: m.nd] = dynamic[nv : nv + m.nd] = dynamic[m.ndx :] = True
    free = np.zeros(ny + m.n_inputs + m.nrho, dtype=bool)
    free[: nv + m.nd] = free[ny:] = True
    pattern = dynamic[:, None] & free
    k = np.arange(m.nrho)
    pattern[m.nd + k, ny + m.n_inputs + k] = True
    pattern[nv + m.nd + k, ny + m.n_inputs + k] = pattern[nv + m.nd + k, m.nd + k] = True
    for _, _, first in prescribed_rotations(m):
        turns = first + np.arange(3)
        pattern[np.ix_(m.nd + turns, m.nd + turns)] = pattern[np.ix_(m.nd + turns, ny + m.n_inputs + turns)] = True
        pattern[nv + m.nd + turns, m.nd + turns] = False
    return pattern


def _restored(integrator: Integrator, steps: int, multipliers: bool, arrays: list[Array]) -> StepDerivatives:
    core = _core.Linearization(integrator.core, steps, multipliers)
    core.restore(arrays)
    return StepDerivatives(core, integrator)


@public
@dataclass(frozen=True)
class StepTensors:
    """Full second derivatives of one step; output index first, then the two arguments. Threads may share it.

    Attributes
    ----------
    x : ndarray, shape (nx, nx + n_inputs + nrho, nx + n_inputs + nrho)
        Of the next state by ``[x; u]`` twice.
    lam : ndarray, shape (nc, nx + n_inputs + nrho, nx + n_inputs + nrho)
        Of the multipliers.
    """

    x: Array = field(repr=False)
    lam: Array = field(repr=False)
