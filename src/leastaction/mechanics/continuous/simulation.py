"""Simulation in continuous time with SciPy's solvers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, LeastActionError, closest
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics, as_dynamics
from leastaction.mechanics.continuous.equations import Equations
from leastaction.mechanics.continuous.events import Event, EventRecord, watch
from leastaction.mechanics.continuous.integration import Progress
from leastaction.mechanics.continuous.monitoring import Passages, tell
from leastaction.mechanics.continuous.monitoring import balance as energy_balance
from leastaction.mechanics.continuous.prescribed import Prescribed, PrescribedMotion, as_prescribed
from leastaction.mechanics.continuous.signals import ContinuousSignal, InputLaw, WholeInput
from leastaction.mechanics.continuous.stabilisation import Baumgarte, Projection, as_handling, check_start_consistent
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, DenseOutput, IntegrationStatus
from leastaction.mechanics.mechanism.arguments import rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.singularity import SingularityWatch
from leastaction.numerics.arrays import Array, Row, as_array, as_count, as_number, as_times, shape_of
from leastaction.numerics.ode import SOLVERS, March, Passage
from leastaction.numerics.public import public
from leastaction.numerics.signals import StateLaw

_SHOWN = 8  # variables of a state that a message lists
_SHORTEST = 1e-9  # of the whole time: shorter steps never end


@public
def simulate(
    dynamics: ContinuousDynamics | Mechanism,
    q0: Row,
    v0: Row | None,
    t: ArrayLike,
    *,
    inputs: ContinuousSignal = None,
    rho: PrescribedMotion | ArrayLike | Mapping[str, PrescribedMotion | ArrayLike] | None = None,
    rho_a: ContinuousSignal = None,
    u: StateLaw | None = None,
    method: str = "DOP853",
    rtol: float = 1e-8,
    atol: float | ArrayLike = 1e-10,
    max_step: float | None = None,
    first_step: float | None = None,
    max_steps: int | None = None,
    max_seconds: float | None = None,
    events: Mapping[str, Event | Callable[[float, Array], float] | str] | None = None,
    constraints: str | Projection | Baumgarte = "project",
    dense_output: bool = True,
    progress: Callable[[float, float], None] | None = None,
) -> ContinuousTrajectory:
    """Simulate a mechanism in continuous time.

    The state is ``x = [q; rho; v; v_rho]``: configuration and velocity of the dynamic variables q and of the
    kinematic ones rho, whose accelerations rho_a are inputs.

    Parameters
    ----------
    dynamics : ContinuousDynamics or Mechanism
    q0 : array_like, shape (nq,)
        Configuration at the start, dynamic variables first (m or rad).
    v0 : array_like, shape (nq,), optional
        Velocity at the start (m/s or rad/s). None: at rest, but for a prescribed motion, whose velocity is taken.
    t : array_like, shape (N+1,)
        Times of the result (s), increasing; the first is that of the start. The solver chooses its own steps.
    inputs : array_like or callable, optional
        Force inputs: a constant (n_inputs,); rows (N+1, n_inputs) at the instants, joined by straight lines; rows
        (N, n_inputs), each held from one instant to the next, at whose jumps the solver stops; a
        `PiecewisePolynomial`, likewise; a function ``(t) -> (n_inputs,)``; or one ``(t, x) -> (n_inputs,)``, which may
        have a ``jacobian(t, x) -> (n_inputs, nx)`` for implicit methods, such as `Feedback`. Constants, rows and
        functions of time by name too, ``{"push": 2.0}``. Zero if not given.
    rho : PrescribedMotion, spline of SciPy, array_like of shape (N+1, nq - first_rho), or mapping, optional
        Motion of the kinematic coordinates, twice differentiable; through rows a quintic spline is laid. It is kept
        exactly. A rotation that is a quaternion has its four numbers, whose length says nothing, but in rows. By name,
        ``{"hand": rows, "rope": 2.0}``, a rotation by that of its joint, others stay where they begin.
    rho_a : array_like or callable, optional
        Accelerations of the kinematic variables instead, in the forms of `inputs`; rho and v_rho are integrated.
        Zero if neither is given: they go on at the velocity of the start.
    u : callable, optional
        All inputs by one function ``(t, x) -> [inputs; rho_a]``, instead of `inputs`, `rho` and `rho_a`.
    method : {"RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"}, optional
        SciPy's solver. The last three are for stiff equations and get the exact Jacobian.
    rtol, atol : float, optional
        Error allowed for each step, relative and absolute (array_like of shape (nx,) for the latter too).
    max_step, first_step : float, optional
        Largest and first step (s).
    max_steps : int, optional
        Steps of the solver after which a simulation counts as failed; no limit if not given.
    max_seconds : float, optional
        Wall time (s) after which it does.
    events : mapping of str to Event, callable or str, optional
        Functions of time and state whose zeros are looked for, by name; see `Event`.
    constraints : {"project", "baumgarte", "none"}, Projection or Baumgarte, optional
        How constraints are kept: every step is brought back onto them, in the metric of the mass matrix, and
        configurations in which they lose rank are passed by long steps that keep the energy; deviations die out by
        Baumgarte's stabilisation; or not at all. `Baumgarte` takes starts off the constraints too.
    dense_output : bool, optional
        Keep what is needed for states between the instants, and for the balance of the energy.
    progress : callable, optional
        Called after each step with the time that it came to and the last time.

    Returns
    -------
    ContinuousTrajectory
        Up to the last time, the event that ended it, the last step before a failure, or where Ctrl-C stopped it; its
        status says which.

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, unknown names, times that do not increase, or a start that
        does not agree with the prescribed motion.
    InconsistentStartError
        If q0 or v0 violates the constraints; residuals by constraint name.

    Warns
    -----
    EnergyBalanceWarning
        If energy was lost or gained beside the work that was done, such as where constraints lose rank;
        looked for where `dense_output` is kept. The status is then `IntegrationStatus.UNBALANCED`.
    SingularityWarning
        If the motion comes near the singularity of a `ball` or `free` joint; once for every joint.
    """
    dynamics = as_dynamics(dynamics)
    m = dynamics.mechanism
    times = as_times(t)
    handling = as_handling(constraints)
    motion = _motion(m, rho, rho_a, u, inputs, times, q0)
    x0 = _start(m, q0, v0, motion, float(times[0]))
    if not isinstance(handling, Baumgarte):
        check_start_consistent(m.at_time(times[0]), x0[: m.nq], x0[m.nq :])
    watched = watch(events or {}, m)
    options = _options(m, method, rtol, atol, max_step, first_step, float(times[-1] - times[0]))
    seconds = None if max_seconds is None else as_number(max_seconds, "max_seconds", above=0.0)
    limit = None if max_steps is None else as_count(max_steps, "max_steps", 1)
    if isinstance(handling, Baumgarte):
        dynamics = ContinuousDynamics(m, constraint_damping=handling.damping, constraint_stiffness=handling.stiffness)
    law = _law(m, inputs, rho_a, u, motion, times)
    projection = handling if isinstance(handling, Projection) else None
    equations = Equations(dynamics, law, motion, projection)
    passage = None
    if equations.projection is not None:
        watch_rank = Passages(equations, float(rtol))
        passage = Passage(watch_rank.is_near, equations.rate_on_constraints, watch_rank.error)
    march = March(
        equations.rate,
        float(times[0]),
        float(times[-1]),
        x0,
        solver=method,
        jacobian=equations.jacobian,
        hold=equations.hold if equations.holds else None,
        jumps=law.breaks.tolist(),
        passage=passage,
        max_steps=limit,
        max_seconds=seconds,
        **options,
    )
    done = Progress(equations, times, watched, march, dense_output)
    status, message = IntegrationStatus.COMPLETED, f"completed, to t = {times[-1]:g} s"
    try:
        done.run(progress)
    except KeyboardInterrupt:
        status = IntegrationStatus.INTERRUPTED
        message = f"interrupted at t = {done.reached:.6g} s of {times[-1]:g} s"
    if done.event is not None:
        status = IntegrationStatus.EVENT
        message = f"the event {done.event!r} took place at t = {done.reached:.6g} s"
    elif done.failure is not None:
        status = IntegrationStatus.FAILED
        message = (
            f"{method} failed after t = {done.reached:.6g} s: {done.failure}. The state there: {_named(m, done.state)}"
        )
    records = {event.name: event.record(m.nx) for event in watched}
    result = _result(equations, done, status, message, records, dense_output)
    told = SingularityWatch(m.balls, m.coordinates).look(result.t, result.q)
    # A run that failed has said so, and of a motion that blows up the energy means nothing.
    if not done.pieces or status is IntegrationStatus.FAILED:
        return replace(result, warnings=told)
    balance = energy_balance(equations, done.pieces, done.reached)
    complaint = tell(balance, float(rtol))
    if complaint is not None:
        if status is IntegrationStatus.COMPLETED:
            status = IntegrationStatus.UNBALANCED
        told, message = (*told, complaint), f"{message}, but {complaint}"
    elif balance.crossings:
        message += f"; {balance.passed}"
    return replace(result, status=status, message=message, balance=balance, warnings=told)


def _motion(
    m: Mechanism, rho: object, rho_a: object, u: object, inputs: object, times: Array, q0: Row
) -> Prescribed | None:
    given = {"rho": rho, "rho_a": rho_a, "u": u, "inputs": inputs}
    named = [name for name, value in given.items() if value is not None]
    if u is not None and len(named) > 1:
        raise ArgumentError(
            f"u: it gives all inputs, but {' and '.join(n for n in named if n != 'u')} came too; give one or the other"
        )
    if rho is not None and rho_a is not None:
        raise ArgumentError("rho: got both rho and rho_a; give the prescribed motion or its accelerations")
    if u is not None and not callable(u):
        raise ArgumentError(
            f"u: got {type(u).__name__}, expected a function (t, x) -> [inputs; rho_a]; give arrays as inputs= and "
            "rho_a="
        )
    return None if rho is None else as_prescribed(m, rho, times, lambda: single(m, q0, "q0")[m.first_rho :])


def _start(m: Mechanism, q0: Row, v0: Row | None, motion: Prescribed | None, t0: float) -> Array:
    """Return the state at the start, on the prescribed motion."""
    q = single(m, q0, "q0").copy()
    v = np.zeros(m.nv) if v0 is None else rates(m, v0, "v0").copy()
    if motion is not None:
        q, v = motion.start(q, v, t0, at_rest=v0 is None)
    return np.concatenate([q, v])


def _law(
    m: Mechanism,
    inputs: ContinuousSignal,
    rho_a: ContinuousSignal,
    u: StateLaw | None,
    motion: Prescribed | None,
    times: Array,
) -> WholeInput:
    accelerations = [f"acceleration of {name}" for name in m.kinematic]
    if u is not None:
        return WholeInput([InputLaw(u, times, [*m.inputs, *accelerations], "u")])
    forces = InputLaw(inputs, times, m.inputs, "inputs")
    if motion is not None:
        return WholeInput([forces])
    return WholeInput([forces, InputLaw(rho_a, times, m.kinematic, "rho_a")])


def _options(
    m: Mechanism,
    method: str,
    rtol: float,
    atol: float | ArrayLike,
    max_step: float | None,
    first_step: float | None,
    span: float,
) -> dict[str, Any]:
    """Return the options of the solver, checked."""
    if method not in SOLVERS:
        raise ArgumentError(f"method: unknown {method!r}; {closest(method, SOLVERS, what='methods')}")
    # Below 100 eps SciPy would raise it with a warning.
    least = 100.0 * float(np.finfo(float).eps)
    if not least <= as_number(rtol, "rtol") < 1.0:
        raise ArgumentError(f"rtol: got {rtol}, expected a number from {least:.2g} to 1")
    absolute = as_array(atol, "atol", (m.nx,) if shape_of(atol) else ())
    if np.any(absolute <= 0.0):
        raise ArgumentError(f"atol: got {atol!r}, expected positive numbers")
    options: dict[str, Any] = {"rtol": float(rtol), "atol": absolute[()]}
    for name, value in (("max_step", max_step), ("first_step", first_step)):
        if value is None:
            continue
        if as_number(value, name) <= 0.0:
            raise ArgumentError(f"{name}: got {value} s, expected a positive time")
        if value < _SHORTEST * span:
            raise ArgumentError(
                f"{name}: got {value} s, which makes {span / value:.2g} steps of {span:g} s; expected at least "
                f"{_SHORTEST * span:.2g} s"
            )
        if name == "first_step" and value > span:
            raise ArgumentError(f"first_step: got {value} s, expected at most the {span:g} s of t")
        options[name] = float(value)
    return options


def _result(
    equations: Equations,
    done: Progress,
    status: IntegrationStatus,
    message: str,
    records: dict[str, EventRecord],
    dense_output: bool,
) -> ContinuousTrajectory:
    m = equations.mechanism
    # Ctrl-C may have come between a time and its state.
    count = min(len(done.t), len(done.x))
    t, x = done.t[:count], done.x[:count]
    if t[-1] < done.reached:
        t, x = [*t, done.reached], [*x, done.state]
    at, states = np.array(t), np.array(x)
    u = np.array([equations.input(*pair) for pair in zip(t, x, strict=True)])
    a = np.full((len(t), m.nv), np.nan)
    lam = np.full((len(t), m.nc), np.nan)
    for k, state in enumerate(x):
        # Where the simulation failed there may be none.
        with contextlib.suppress(LeastActionError):
            a[k], lam[k] = equations.solve(t[k], state, u[k])
    return ContinuousTrajectory(
        m,
        at,
        states[:, : m.nq],
        u[:, : m.n_inputs],
        lam,
        v=states[:, m.nq :],
        a=a,
        status=status,
        message=message,
        drift=done.drift,
        events=records,
        effort=done.counts,
        dense=DenseOutput(done.pieces, equations.hold, done.x[0]) if dense_output else None,
        law=equations.input,
    )


def _named(m: Mechanism, x: Array) -> str:
    """Return the largest part of a state by name."""
    v = dict(zip(m.variables, x[m.nq :], strict=True))
    parts = {name: (abs(q), f"{name} = {q:.4g}") for name, q in zip(m.coordinates, x[: m.nq], strict=True)}
    for name, rate in v.items():
        size, text = parts.get(name, (0.0, name))
        parts[name] = (max(size, abs(rate)), f"{text} (rate {rate:.4g})")
    texts = [text for _, text in sorted(parts.values(), key=lambda part: -part[0])]
    return ", ".join(texts[:_SHOWN]) + (f", and {len(texts) - _SHOWN} more" if len(texts) > _SHOWN else "")
