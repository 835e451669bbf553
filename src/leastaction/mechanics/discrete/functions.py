"""The functions that a step is made of, with their derivatives, and the force that drives prescribed variables.

They are methods of `MidpointVI`, which is ``vi`` here.

With ``q = (q1 + q2)/2`` and ``v = (q2 - q1)/dt``, all of them are functions of `Mechanism` of ``(q, v)``, which are
linear in ``(q1, q2)``: the derivatives follow without a new formula.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.mechanics.discrete.balance import DiscreteBalance, balance_of
from leastaction.mechanics.discrete.derivatives import check_trajectory
from leastaction.mechanics.discrete.impulses import impulses_along
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.arguments import angles_only
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.function_derivatives import FunctionDerivatives, Substituted
from leastaction.numerics.arrays import Array, as_array, as_time_step


def discrete_lagrangian(vi: Integrator, q1: ArrayLike, q2: ArrayLike, dt: float) -> FunctionDerivatives:
    """Return ``Ld = dt L((q1 + q2)/2, (q2 - q1)/dt)`` (J s), by ``q1`` and ``q2``, to the fourth order.

    Parameters
    ----------
    q1, q2 : array_like, shape (nq,)
        Configurations at the start and the end of a step.
    dt : float
        Time step (s).

    Returns
    -------
    FunctionDerivatives
        ``Ld.by("q1")`` is D1Ld, ``Ld.by("q1", "q2")`` is D2D1Ld.

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, or a time step that is not positive.
    """
    m, h = vi.mechanism, as_time_step(dt)
    q, v = _midpoint(m, q1, q2, h)
    return _on_a_step("Ld", m.lagrangian(q, v), _places_and_rates(m.nq, h), h, {"q1": m.nq, "q2": m.nq})


def discrete_potential(
    vi: Integrator, q1: ArrayLike, q2: ArrayLike, dt: float, element: str | None = None
) -> FunctionDerivatives:
    """Return what one potential, or all, take from `discrete_lagrangian`: ``dt V((q1 + q2)/2)`` (J s).

    Parameters
    ----------
    q1, q2, dt
        As of `discrete_lagrangian`, errors too.
    element : str, optional
        As of `Mechanism.potential`.
    """
    m, h = vi.mechanism, as_time_step(dt)
    q, _ = _midpoint(m, q1, q2, h)
    places = _places_and_rates(m.nq, h)[: m.nq]
    of = m.potential(q, element)
    return _on_a_step(f"dt {of.name}", of, places, h, {"q1": m.nq, "q2": m.nq})


def discrete_force(
    vi: Integrator, q1: ArrayLike, q2: ArrayLike, u: ArrayLike | None, dt: float, element: str | None = None
) -> tuple[FunctionDerivatives, FunctionDerivatives]:
    """Return the discrete forces fd- and fd+ of one element, or of all, by ``q1``, ``q2`` and ``u``.

    Parameters
    ----------
    q1, q2, dt
        As of `discrete_lagrangian`, errors too.
    u : array_like, shape (n_inputs,), or None
        Inputs; zero if None.
    element : str, optional
        As of `Mechanism.force`.

    Returns
    -------
    fd_minus, fd_plus : FunctionDerivatives
        Impulses (N s or N m s) on all nq variables at the start and at the end of the step, as `split` shares them.
    """
    m, h = vi.mechanism, as_time_step(dt)
    q, v = _midpoint(m, q1, q2, h)
    of = m.force(q, v, u, element)
    n = 2 * m.nq
    by = np.eye(n + m.n_inputs)
    by[:n, :n] = _places_and_rates(m.nq, h)
    arguments = {"q1": m.nq, "q2": m.nq, "u": m.n_inputs}
    first, second = (
        _on_a_step(f"fd{sign} of {of.name}", of, by, share * h, arguments)
        for sign, share in zip("-+", vi.shares, strict=True)
    )
    return first, second


def driving_force(vi: Integrator, trajectory: Trajectory) -> Array:
    """Return the forces that make the prescribed variables move as they do in a run (dissertation 4.42).

    A prescribed variable is moved by whatever force that takes. At an instant between two steps it is the impulse
    that its own equation of motion lacks, ``-(D2Ld + fd+ of the step before + D1Ld + fd- of the step after -
    Dh^T lam)``, here over the time that it stands for, half of both steps. In continuous time
    `ContinuousDynamics.inverse_dynamics` has it.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.

    Returns
    -------
    ndarray, shape (N-1, nrho)
        At the instants ``t[1:-1]``, in the order of `Mechanism.kinematic` (N or N m). Besides the forces of
        elements, and positive where it drives the variable up; of a rotation the torque in the axes behind the joint.

    Raises
    ------
    ArgumentError
        For a trajectory of a mechanism with other variables.
    """
    check_trajectory(vi, trajectory)
    run = trajectory
    before, after, held = impulses_along(vi, run.t, run.q, run.inputs, run.lam)
    dt = np.diff(run.t)[:, None]
    lacking = (after[:-1] + before[1:] - held[1:])[:, vi.mechanism.nd :]
    return np.asarray(-2.0 * lacking / (dt[:-1] + dt[1:]))


def balance(vi: Integrator, trajectory: Trajectory) -> DiscreteBalance:
    """Return how energy and work balance along a motion, such as one that an optimisation found.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism. `Trajectory.balance` of what was simulated is the same.

    Raises
    ------
    ArgumentError
        For a trajectory of a mechanism with other variables.
    """
    check_trajectory(vi, trajectory)
    run = trajectory
    return balance_of(run.t, vi.core.energies(run.t, run.x, run.u, run.lam))


def _midpoint(m: Mechanism, q1: ArrayLike, q2: ArrayLike, dt: float) -> tuple[Array, Array]:
    angles_only(m, "a function of the ends of a step")
    start, end = (as_array(q, what, (m.nq,), names=m.variables) for q, what in ((q1, "q1"), (q2, "q2")))
    return (start + end) / 2.0, (end - start) / dt


def _places_and_rates(n: int, dt: float) -> Array:
    """Return [q; v] by [q1; q2]."""
    one = np.eye(n)
    return np.block([[one / 2.0, one / 2.0], [-one / dt, one / dt]])


def _on_a_step(
    name: str, of: FunctionDerivatives, by: Array, factor: float, arguments: dict[str, int]
) -> FunctionDerivatives:
    evaluate = Substituted(of.evaluate, by, factor)
    return FunctionDerivatives.of(name, arguments, evaluate, rows=of.rows, highest_order=of.highest_order)
