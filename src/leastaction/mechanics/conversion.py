"""Between continuous and discrete time: the Legendre transform, trajectories, and feedback gains.

The two domains share q, rho and the force inputs. They differ in three things, each with a derivation below:

- momentum for velocity: ``p = dL/dv`` of the dynamic variables (`to_momentum`, `to_velocity` of `continuous_legendre`);
- where between instants a quantity lives: the discrete ``v_rho[k] = (rho[k] - rho[k-1]) / dt`` belongs to the middle of
  the step before, and inputs to the middle of their step;
- the input of the prescribed variables: their accelerations rho_a there, their next values rho_next here.

Discrete momenta. With h = dt, the step ``p_k + D1Ld + fdm - Dh^T lam_k = 0, p_k+1 = D2Ld + fdp`` has
``D2Ld = L_v + h/2 L_q`` at the midpoint, so ``p_k+1 = L_v(t_k+1/2) + h/2 (L_q + f)``. Since
``dp/dt = L_q + f + Dh^T lam`` this is ``p(t_k+1) - h/2 Dh^T lam(t_k+1) + O(h^2)``: half of the constraints' impulse
over the step is still to come. It comes with the next step, whose impulse at its start is that half and its own::

    lam_k = -(dt_k-1 + dt_k)/2 lam(t_k),   p_k = p(t_k) - dt_k-1/2 Dh(q_k)^T lam(t_k)

A start has no step before it: ``p_0 = p(t_0)`` and ``lam_0 = -dt_0/2 lam(t_0)``. The missing part of ``M^-1 p_k`` is in
the range of ``M^-1 Dh^T``, which the projection onto ``Dh v = 0`` in the metric of M removes, whatever its size.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.legendre import legendre_jacobian, solve_mass, to_momentum, to_velocity
from leastaction.mechanics.continuous.prescribed import through_rows
from leastaction.mechanics.continuous.stabilisation import Drift, rates
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, IntegrationStatus
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import SimulationStatus, Trajectory
from leastaction.mechanics.mechanism.arguments import check_same_names
from leastaction.mechanics.mechanism.kinematics import Kinematics
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import differences, prescribed_rotations
from leastaction.numerics.arrays import Array, as_array, as_flag, as_number, as_times, require_instance
from leastaction.numerics.public import public

_STATUS = {
    SimulationStatus.COMPLETED: IntegrationStatus.COMPLETED,
    SimulationStatus.UNBALANCED: IntegrationStatus.UNBALANCED,
    SimulationStatus.ROUNDED: IntegrationStatus.UNBALANCED,
    SimulationStatus.STEP_FAILED: IntegrationStatus.FAILED,
    SimulationStatus.INTERRUPTED: IntegrationStatus.INTERRUPTED,
}
_LONGEST = 1e100  # s: of a step of time whose square is a number


# Trajectories


@public
def to_discrete(
    trajectory: ContinuousTrajectory, integrator: MidpointVI, t: ArrayLike | None = None, *, sampled: bool = False
) -> Trajectory:
    """Return the discrete trajectory with the start, the inputs and the prescribed motion of a continuous one.

    Parameters
    ----------
    trajectory : ContinuousTrajectory
        With dense output, unless all times are instants of its own.
    integrator : MidpointVI
        Of the same mechanism.
    t : array_like, shape (N+1,), optional
        Times (s); those of the trajectory if not given.
    sampled : bool, optional
        Return the motion as it is, read at the instants and translated, instead of the integrator's own. Such a
        curve misses the integrator's steps by O(dt^3) each: a reference to track, which an unstable motion needs.

    Returns
    -------
    Trajectory
        Off the continuous motion by O(dt^2). If the integrator fails it ends there, as `MidpointVI.simulate` says.

    Raises
    ------
    ArgumentError
        For a trajectory of another mechanism, or times that it does not cover.
    """
    require_instance(trajectory, "trajectory", ContinuousTrajectory, "simulate(mechanism, ...) makes one")
    require_instance(integrator, "integrator", MidpointVI, "MidpointVI(mechanism) makes one")
    as_flag(sampled, "sampled")
    m, nd = integrator.mechanism, integrator.mechanism.nd
    check_same_names(trajectory.mechanism, m, "trajectory")
    times = trajectory.t if t is None else as_times(t)
    dt = np.diff(times)
    x = trajectory.x if trajectory.dense is None and t is None else trajectory(times)
    q, v = x[:, : m.nq], x[:, m.nq :]
    inputs = trajectory.input(0.5 * (times[1:] + times[:-1]))[:, : m.n_inputs]
    if not sampled:
        start = integrator.start(q[0], v[0], t=float(times[0]))
        return integrator.simulate(start, times, inputs=inputs, rho=q[:, m.first_rho :])
    u = trajectory.input(times)
    lam = np.empty((len(times), m.nc))
    if m.nc:
        out = ContinuousDynamics(m).accelerations(q, v, u[:, : m.n_inputs], u[:, m.n_inputs :], times)
        lam = out.lam
    p = to_momentum(m, q, v)
    for k in range(1, len(times) if m.nc else 0):
        p[k] -= 0.5 * dt[k - 1] * (m.at_time(times[k]).constraint_jacobian(q[k])[:, :nd].T @ lam[k])
    v_rho = np.vstack([v[:1, nd:], differences(m, q[1:], q[:-1])[:, nd:] / dt[:, None]])
    impulses = -0.5 * (dt + np.concatenate([[0.0], dt[:-1]]))[:, None] * lam[:-1]
    message = "sampled from a motion in continuous time"
    return Trajectory(m, times, q, inputs, impulses, p=p, v_rho=v_rho, message=message)


@public
def to_continuous(run: Trajectory, *, dynamics: ContinuousDynamics | None = None) -> ContinuousTrajectory:
    """Return a discrete trajectory as one in continuous time.

    Parameters
    ----------
    run : Trajectory
        Of a midpoint integrator with the symmetric split.
    dynamics : ContinuousDynamics, optional
        Of its mechanism.

    Returns
    -------
    ContinuousTrajectory
        Its configurations are those of the run. Velocities are those of its momenta, with the part that the
        constraints stop left out; velocities and accelerations of the prescribed variables are those of the cubic
        spline through them; inputs are averages of the steps on both sides. All of these are good to O(dt^2) for
        a smooth motion, and so are the accelerations and multipliers, which follow by the equations of motion. Between
        the instants a cubic runs through the configurations with these velocities.

    Raises
    ------
    ArgumentError
        For a run without a step.
    """
    require_instance(run, "run", Trajectory, "MidpointVI.simulate makes one")
    m = run.mechanism
    if run.steps < 1:
        raise ArgumentError("run: got a trajectory without steps, expected at least one")
    dynamics = ContinuousDynamics(m) if dynamics is None else dynamics
    check_same_names(dynamics.mechanism, m, "dynamics")
    rho_v, rho_a = _slopes(m, run.rho, run.t)
    v = to_velocity(m, run.q, run.p, rho_v, keep_constraints=True, t=run.t)
    inputs = _at_instants(run.inputs, run.t)
    out = dynamics.accelerations(run.q, v, inputs, rho_a, run.t)
    worst = np.zeros((2, m.nc))
    for pair in zip(run.q, v, strict=True):
        np.maximum(worst, np.abs(rates(m, *pair)), out=worst)
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    kinematics = Kinematics(m)
    spline = CubicHermiteSpline(run.t, run.q, kinematics.rates(run.q, v))
    slope = spline.derivative()

    def dense(t: float) -> Array:
        q = spline(t)
        return np.concatenate([kinematics.on_space(q), kinematics.changes(q) @ slope(t)])

    return ContinuousTrajectory(
        m,
        run.t,
        run.q,
        inputs,
        out.lam,
        v=v,
        a=np.hstack([out.a, rho_a]),
        status=_STATUS[run.status],
        message=f"from discrete time: {run.message}",
        drift={
            name: Drift(*(float(w) for w in worst[:, i]), *(float(w) for w in worst[:, i]))
            for i, name in enumerate(m.constraints)
        },
        dense=dense,
    )


# Feedback gains


@public
def gain_to_discrete(mechanism: Mechanism, q: ArrayLike, v: ArrayLike, K: ArrayLike, dt: float) -> Array:
    """Return the gains on the discrete state that do what given ones do on the continuous state.

    Both as ``u = ubar - K (x - xbar)``, with ``x = [q; rho; v; v_rho]``, ``u = [inputs; rho_a]`` there and
    ``x = [q; rho; p; v_rho]``, ``u = [inputs; rho_next]`` here. Where a rotation is a quaternion, gains there are by
    the numbers of the state, and those here by differences of states: (n_inputs + nrho, ndx).

    Deviations of the states are related by the Jacobian T of the Legendre transform, so a force input has the
    gain ``K_u T^-1``. For a prescribed variable the second difference is the acceleration,
    ``rho_next = rho + dt v_rho + dt^2 rho_a``, so with ``E dx = drho + dt dv_rho`` its gain is
    ``dt^2 K_rho T^-1 - E``: the difference of references takes its place among ubar and xbar. A rotation that is a
    quaternion turns by ``dt v_rho + dt^2 rho_a``, so E dx is ``dt dv_rho`` there.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)
        The reference motion.
    K : array_like, shape (n_inputs + nrho, nx) or (N, n_inputs + nrho, nx)
        Gains in continuous time.
    dt : float
        Time step (s).

    Returns
    -------
    ndarray, shape of K
        For small deviations the closed loops agree to O(dt): an input is held over a step, and the discrete v_rho
        is half a step old. In large ones p and v differ by more than T.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    m, h = mechanism, as_number(dt, "dt", above=0.0, below=_LONGEST)
    T = legendre_jacobian(m, q, v)
    gains = _gains(m, K, T, m.nx) @ _state_directions(m, q)
    # K T^-1, from the right.
    result = np.swapaxes(solve_mass(np.swapaxes(T, -1, -2), np.swapaxes(gains, -1, -2)), -1, -2)
    result[..., m.n_inputs :, :] = h**2 * result[..., m.n_inputs :, :] - _extrapolation(m, h)
    return result


@public
def gain_to_continuous(mechanism: Mechanism, q: ArrayLike, v: ArrayLike, K: ArrayLike, dt: float) -> Array:
    """Return the gains on the continuous state that do what given ones do on the discrete state.

    The inverse of `gain_to_discrete`: ``K_u T`` for force inputs, ``(K_rho + E) T / dt^2`` for prescribed variables.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)
        The reference motion; `to_velocity` has v from discrete momenta.
    K : array_like, shape (n_inputs + nrho, nx) or (N, n_inputs + nrho, nx)
        Gains in discrete time.
    dt : float
        Time step that they were made for (s).
    """
    require_instance(mechanism, "mechanism", Mechanism)
    m, h = mechanism, as_number(dt, "dt", above=0.0, below=_LONGEST)
    T = legendre_jacobian(m, q, v)
    gains = _gains(m, K, T, m.ndx).copy()
    gains[..., m.n_inputs :, :] = (gains[..., m.n_inputs :, :] + _extrapolation(m, h)) / h**2
    result: Array = gains @ T @ _state_changes(m, q)
    return result


def _extrapolation(m: Mechanism, dt: float) -> Array:
    """Return E (nrho, ndx): ``rho + dt v_rho`` of a state; of rotations ``dt v_rho``, by which a step turns."""
    E = np.zeros((m.nrho, m.ndx))
    E[:, m.nd : m.nv] = np.eye(m.nrho)
    for _, _, turn in prescribed_rotations(m):
        E[turn : turn + 3] = 0.0
    E[:, m.nv + m.nd :] = dt * np.eye(m.nrho)
    return E


def _state_directions(m: Mechanism, q: ArrayLike) -> Array:
    """Return how states (nx,) move with their differences (ndx,), for each configuration."""
    kinematics = Kinematics(m)
    return _beside_velocities(m, q, kinematics.directions) if kinematics.curved else np.eye(m.nx)


def _state_changes(m: Mechanism, q: ArrayLike) -> Array:
    """Return how differences of states (ndx,) change with their numbers (nx,), for each configuration."""
    kinematics = Kinematics(m)
    return _beside_velocities(m, q, kinematics.changes) if kinematics.curved else np.eye(m.nx)


def _beside_velocities(m: Mechanism, q: ArrayLike, of: Callable[[Array], Array]) -> Array:
    values = as_array(q, "q")
    blocks = np.array([of(row) for row in values.reshape(-1, m.nq)])
    rows, columns = blocks.shape[1:]
    out = np.zeros((len(blocks), rows + m.nv, columns + m.nv))
    out[:, :rows, :columns], out[:, rows:, columns:] = blocks, np.eye(m.nv)
    return out.reshape(*values.shape[:-1], *out.shape[1:])


def _gains(m: Mechanism, K: ArrayLike, T: Array, columns: int) -> Array:
    return as_array(K, "K", (*T.shape[:-2], m.n_inputs + m.nrho, columns))


def _slopes(m: Mechanism, rho: Array, t: Array) -> tuple[Array, Array]:
    """Return velocities and accelerations (N+1, nrho) at the instants, along a cubic spline, of second order."""
    if not m.nrho:
        return rho, rho
    motion = through_rows(m, t, rho, degree=3)
    return np.array([motion.at(at)[1] for at in t]), np.array([motion.acceleration(at) for at in t])


def _at_instants(values: Array, t: Array) -> Array:
    """Return values of steps (N, n) at the instants (N+1, n): on straight lines through the middles of the steps."""
    if len(values) < 2 or not values.shape[1]:
        return np.repeat(values, 2, axis=0) if len(values) == 1 else np.zeros((len(t), 0))
    middle = 0.5 * (t[1:] + t[:-1])
    k = np.clip(np.searchsorted(middle, t) - 1, 0, len(middle) - 2)
    part = ((t - middle[k]) / (middle[k + 1] - middle[k]))[:, None]
    return np.asarray((1.0 - part) * values[k] + part * values[k + 1])
