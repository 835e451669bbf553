"""Exact first and second derivatives of the steps of a trajectory."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction import _core
from leastaction.errors import ArgumentError, StepError
from leastaction.mechanics.discrete.step import StepDerivatives, StepTensors
from leastaction.mechanics.discrete.trajectory import State, Trajectory
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array

_TRAJECTORY_TOLERANCE = 1e-6  # (m or rad) of a step's end, for what counts as a trajectory


class StepDifferentiation:
    """The derivatives that an integrator offers; see `MidpointVI`, which is one."""

    mechanism: Mechanism
    core: _core.Midpoint
    threads: int

    def linearize(self, trajectory: Trajectory, *, multipliers: bool = False) -> StepDerivatives:
        """Return the exact first derivatives of every step of a trajectory, in parallel over time.

        Parameters
        ----------
        trajectory : Trajectory
            Of this mechanism.
        multipliers : bool, optional
            Also the derivatives of the multipliers.

        Raises
        ------
        ArgumentError
            For a trajectory of a mechanism with other variables.
        StepError
            Where the arrays are not a trajectory of the mechanism.
        """
        self._check_trajectory(trajectory)
        d = self.linearize_arrays(trajectory.t, trajectory.x, trajectory.u, multipliers=multipliers)
        wrong = np.flatnonzero(d.defect > _TRAJECTORY_TOLERANCE)
        if len(wrong):
            k = int(wrong[0])
            raise StepError(
                f"linearize: the step at t = {trajectory.t[k]:.6g} s does not lead to the next state, by "
                f"{d.defect[k]:.2g}; give a trajectory of this mechanism and this integrator, such as the "
                "result of simulate()",
                t=float(trajectory.t[k]),
                residuals={},
                iteration=0,
                state=trajectory.state(k),
            )
        return d

    def linearize_arrays(
        self,
        t: Array,
        x: Array,
        u: Array,
        *,
        multipliers: bool = False,
        reuse: dict[str, Array] | None = None,
    ) -> StepDerivatives:
        """Return the derivatives along states x (N+1, nx) and inputs u (N, nu + nrho) at times t.

        `reuse` offers arrays ``A``, ``B``, ``memo`` of an earlier call, unchanged since, to write over.
        """
        out = self.core.linearize(t, x, u, multipliers, self.threads, reuse)
        k = int(out["steps"])
        if k < len(t) - 1:
            raise StepError(
                f"linearize: step {k} at t = {t[k]:.6g} s has no solution near the given next state; "
                "give a trajectory of this mechanism, such as the result of simulate()",
                t=float(t[k]),
                residuals={},
                iteration=0,
                state=self._state(float(t[k]), x[k]),
            )
        return StepDerivatives(
            out["A"], out["B"], out["lam"], out["memo"], self.mechanism.nx, out["defect"]
        )

    def curvature_arrays(
        self,
        t: Array,
        x: Array,
        u: Array,
        derivatives: StepDerivatives,
        weights: Array,
        *,
        reuse: dict[str, Array] | None = None,
    ) -> Array:
        """Return the Hessians (N, ny + nu, ny + nu) of the next states weighted with (N, ny).

        `reuse` offers an array ``H`` of an earlier call, unchanged since, to write over.
        """
        d = derivatives
        multipliers = d.A_all.shape[1] > d.nx
        return self.core.curvatures(
            t, x, u, d.A_all, d.B_all, d.memo, weights, multipliers, self.threads, reuse
        )

    def curvature(
        self,
        trajectory: Trajectory,
        derivatives: StepDerivatives,
        z: npt.ArrayLike,
        *,
        z_lam: npt.ArrayLike | None = None,
    ) -> Array:
        """Return the contracted second derivatives of every step.

        Parameters
        ----------
        trajectory : Trajectory
        derivatives : StepDerivatives
            Of the same trajectory.
        z : array_like, shape (N, nx)
            Weights on the next state of each step.
        z_lam : array_like, shape (N, nc), optional
            Weights on the multipliers of each step.

        Returns
        -------
        ndarray, shape (N, nx + nu + nrho, nx + nu + nrho)
            Hessian of ``z_k . x_{k+1} + z_lam_k . lam_k`` by ``[x_k; u_k]``.
        """
        m, N = self.mechanism, trajectory.steps
        self._check_trajectory(trajectory)
        if len(derivatives.A_all) != N or derivatives.nx != m.nx:
            raise ArgumentError(
                f"derivatives: got those of {len(derivatives.A_all)} steps of {derivatives.nx} states, "
                f"expected {N} steps of {m.nx}; give the result of linearize() for the same trajectory"
            )
        weights = as_array(z, "z", (N, m.nx))
        t, x, u, d = trajectory.t, trajectory.x, trajectory.u, derivatives
        ny = d.A_all.shape[1]
        if z_lam is not None:
            weights_lam = as_array(z_lam, "z_lam", (N, m.nc))
            if ny == m.nx:
                d = self.linearize_arrays(t, x, u, multipliers=True)
            H = self.curvature_arrays(t, x, u, d, np.hstack([weights, weights_lam]))
        else:
            H = self.curvature_arrays(t, x, u, d, np.hstack([weights, np.zeros((N, ny - m.nx))]))
        # The multipliers are states that nothing depends on: their rows are zero.
        keep = np.r_[0 : m.nx, H.shape[1] - (m.nu + m.nrho) : H.shape[1]]
        return H if len(keep) == H.shape[1] else H[:, keep[:, None], keep]

    def tensors(self, trajectory: Trajectory, k: int | np.integer[Any]) -> StepTensors:
        """Return the full second derivatives of step k of a trajectory (for analysis)."""
        m = self.mechanism
        self._check_trajectory(trajectory)
        steps = range(trajectory.steps)
        if k not in steps:
            raise ArgumentError(f"k: got {k!r}, expected a step from 0 to {steps[-1]}")
        k = int(k)
        t = trajectory.t[k : k + 2]
        x, u = (
            np.ascontiguousarray(trajectory.x[k : k + 2]),
            np.ascontiguousarray(trajectory.u[k : k + 1]),
        )
        d = self.linearize_arrays(t, x, u, multipliers=True)
        keep = np.r_[0 : m.nx, m.nx + m.nc : m.nx + m.nc + u.shape[1]]
        out = np.empty((m.nx + m.nc, len(keep), len(keep)))
        for row, weights in enumerate(np.eye(m.nx + m.nc)):
            H = self.curvature_arrays(t, x, u, d, weights[None, :])
            out[row] = H[0][keep[:, None], keep]
        return StepTensors(out[: m.nx], out[m.nx :])

    def _check_trajectory(self, trajectory: Trajectory) -> None:
        theirs, ours = trajectory.mechanism, self.mechanism
        if (theirs.variables, theirs.inputs, theirs.constraints) != (
            ours.variables,
            ours.inputs,
            ours.constraints,
        ):
            raise ArgumentError(
                f"trajectory: it is of {theirs!r} with other names, expected one of {ours!r}; use the "
                "integrator of the mechanism that made it"
            )

    def _state(self, t: float, x: Array) -> State:
        m = self.mechanism
        return State(t, x[: m.nq].copy(), x[m.nq : m.nq + m.nd].copy(), x[m.nq + m.nd :].copy())
