"""What a time step returns: the next state, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field

from leastaction.mechanics.discrete.trajectory import State
from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class Step:
    """One solved time step.

    Attributes
    ----------
    state : State
        The state at its end.
    lam : ndarray, shape (nc,)
        Multipliers (impulses).
    iterations : int
        Newton iterations.
    """

    state: State
    lam: Array
    iterations: int


@dataclass(frozen=True)
class StepDerivatives:
    """First derivatives of every step of a trajectory.

    Attributes
    ----------
    A_all : ndarray, shape (N, ny, ny)
        Next state by state. The state is ``x = [q; rho; p; v_rho]``; where the derivatives of the
        multipliers were asked for, those of the step stand after it, ``[x; lam]``.
    B_all : ndarray, shape (N, ny, nu + nrho)
        Next state by input, ``u = [inputs; rho_next]``.
    lam : ndarray, shape (N, nc)
        Multipliers.
    memo : ndarray
        What the second order takes over from the first.
    nx : int
        Number of states without multipliers.
    defect : ndarray, shape (N,)
        How far the dynamic configuration that each step leads to is from the one that was given.
    """

    A_all: Array = field(repr=False)
    B_all: Array = field(repr=False)
    lam: Array = field(repr=False)
    memo: Array = field(repr=False)
    nx: int
    defect: Array = field(repr=False)

    @property
    def A(self) -> Array:
        """Next state by state, shape (N, nx, nx)."""
        return self.A_all[:, : self.nx, : self.nx]

    @property
    def B(self) -> Array:
        """Next state by input, shape (N, nx, nu + nrho)."""
        return self.B_all[:, : self.nx]

    @property
    def lam_dx(self) -> Array:
        """Multipliers by state, shape (N, nc, nx); of no rows unless asked for."""
        return self.A_all[:, self.nx :, : self.nx]

    @property
    def lam_du(self) -> Array:
        """Multipliers by input, shape (N, nc, nu + nrho); of no rows unless asked for."""
        return self.B_all[:, self.nx :]


@dataclass(frozen=True)
class StepTensors:
    """Full second derivatives of one step; output index first, then the two arguments.

    Attributes
    ----------
    x : ndarray, shape (nx, nx + nu + nrho, nx + nu + nrho)
        Of the next state by ``[x; u]`` twice.
    lam : ndarray, shape (nc, nx + nu + nrho, nx + nu + nrho)
        Of the multipliers.
    """

    x: Array = field(repr=False)
    lam: Array = field(repr=False)
