"""Exact first and second derivatives of the steps of a trajectory: methods of `MidpointVI`, which is ``vi`` here."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, StepError
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.linearization import StepDerivatives, StepTensors
from leastaction.mechanics.discrete.trajectory import Trajectory, state_of
from leastaction.mechanics.mechanism.arguments import check_same_names
from leastaction.numerics.arrays import Array, require_instance
from leastaction.numerics.memory import MAX_BYTES, check_memory


def linearize(
    vi: Integrator, trajectory: Trajectory, *, multipliers: bool = False, out: StepDerivatives | None = None
) -> StepDerivatives:
    """Return the exact derivatives of every step of a trajectory, in parallel over time.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.
    multipliers : bool, optional
        Also the derivatives of the multipliers.
    out : StepDerivatives, optional
        Derivatives of as many steps that this integrator returned earlier and that are not needed any
        more: they are written over and returned, and no memory is asked for.

    Returns
    -------
    StepDerivatives
        First derivatives, and by its `curvature` second ones.

    Raises
    ------
    ArgumentError
        For a trajectory of a mechanism with other variables, or an `out` that does not fit.
    StepError
        Where the arrays are not a trajectory of the mechanism; `out` then holds nothing of use.
    """
    check_trajectory(vi, trajectory)
    t = trajectory.t
    d = linearize_arrays(vi, t, trajectory.x, trajectory.u, multipliers=multipliers, out=out)
    wrong = np.flatnonzero(d.defect > _core.SAME_MOTION)
    if len(wrong):
        k = int(wrong[0])
        raise StepError(
            f"linearize: the step at t = {t[k]:.6g} s does not lead to the next state, by "
            f"{d.defect[k]:.2g}; give a trajectory of this mechanism and this integrator, such as the "
            "result of simulate()",
            t=float(t[k]),
            residuals={},
            iteration=0,
            state=trajectory.state(k),
        )
    return d


def linearize_arrays(
    vi: Integrator,
    t: Array,
    x: Array,
    u: Array,
    *,
    multipliers: bool = False,
    out: StepDerivatives | None = None,
    ends: Array | None = None,
    first_share: float = 1.0,
    by_time_step: Array | None = None,
) -> StepDerivatives:
    """Return the derivatives along states x (N+1, nx) and inputs u (N, n_inputs + nrho) at times t.

    The next states may be off; then the derivatives are those of the steps near them, or of those that lead to
    `ends` (N, nx). ``first_share``: the part of the first step for which forces at the instants act at its start.
    ``by_time_step`` (N, nx), or (N, nx + nc) with multipliers: where derivatives by the length of every step are put.
    See `linearize`.
    """
    m, N = vi.mechanism, len(t) - 1
    if out is None:
        core = _core.Linearization(vi.core, N, multipliers)
        out = StepDerivatives(core, vi)
    elif out.integrator is not vi or out.A_all.shape[:2] != (N, m.ndx + m.nc * multipliers):
        raise ArgumentError(
            f"out: got derivatives of {out.steps} steps of {out.A_all.shape[1]} states, by {out.mechanism!r}; "
            f"expected such of {N} steps of {m.ndx + m.nc * multipliers} states by this integrator itself"
        )
    k = out.core.along(t, x, u, vi.threads, ends, first_share, by_time_step)
    if k < N:
        raise StepError(
            f"linearize: step {k} at t = {t[k]:.6g} s has no solution near the given next state; "
            "give a trajectory of this mechanism, such as the result of simulate()",
            t=float(t[k]),
            residuals={},
            iteration=0,
            state=state_of(m, float(t[k]), x[k]),
        )
    return out


def curvature(
    vi: Integrator,
    trajectory: Trajectory,
    derivatives: StepDerivatives,
    z: ArrayLike,
    *,
    z_lam: ArrayLike | None = None,
) -> Array:
    """Return the contracted second derivatives of a trajectory's steps, `StepDerivatives.curvature`.

    Parameters
    ----------
    trajectory : Trajectory
    derivatives : StepDerivatives
        Of the same trajectory.
    z, z_lam : array_like, shapes (N, nx) and (N, nc)
        Weights on the next state of each step, and on its multipliers (optional).

    Raises
    ------
    ArgumentError
        For wrong shapes, or derivatives of something else.
    """
    check_trajectory(vi, trajectory)
    if (derivatives.steps, derivatives.mechanism.nx) != (trajectory.steps, vi.mechanism.nx):
        raise ArgumentError(
            f"derivatives: got those of {derivatives.steps} steps of {derivatives.mechanism.nx} states, "
            f"expected {trajectory.steps} steps of {vi.mechanism.nx}; give the result of linearize() "
            "for the same trajectory"
        )
    return derivatives.curvature(z, z_lam=z_lam)


def tensors(
    vi: Integrator, trajectory: Trajectory, k: int | np.integer[Any], *, max_bytes: float = MAX_BYTES
) -> StepTensors:
    """Return the full second derivatives of step k of a trajectory (for analysis).

    They take ``8 (nx + nc) (nx + n_inputs + nrho)^2`` bytes.

    Raises
    ------
    ArgumentError
        For a k that is no step, a trajectory of another mechanism, or, before anything is made, where they would
        take more than `max_bytes`.
    """
    m = vi.mechanism
    check_trajectory(vi, trajectory)
    if k not in range(trajectory.steps):
        last = trajectory.steps - 1
        known = f"a step from 0 to {last}" if last >= 0 else "a trajectory of one step or more"
        raise ArgumentError(f"k: got {k!r}, expected {known}")
    n = m.ndx + m.n_inputs + m.nrho
    check_memory((m.ndx + m.nc, n, n), max_bytes, "tensors", "contract them by linearize(...).curvature(z)")
    pair, step = slice(k, k + 2), slice(k, k + 1)
    d = linearize_arrays(vi, trajectory.t[pair], trajectory.x[pair], trajectory.u[step])
    weights = np.eye(m.ndx + m.nc)
    out = np.stack([d.curvature(w[None, : m.ndx], z_lam=w[None, m.ndx :])[0] for w in weights])
    return StepTensors(out[: m.ndx], out[m.ndx :])


def check_trajectory(vi: Integrator, trajectory: Trajectory) -> None:
    """Raise unless a trajectory has the variables, inputs and constraints of an integrator's mechanism."""
    require_instance(trajectory, "trajectory", Trajectory, "simulate() makes one")
    advice = "; use the integrator of the mechanism that made it"
    check_same_names(trajectory.mechanism, vi.mechanism, "trajectory", advice)
