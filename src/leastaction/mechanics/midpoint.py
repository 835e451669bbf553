"""The midpoint variational integrator: steps, simulation, and exact derivatives of both.

With ``Ld(q1, q2) = dt L((q1 + q2)/2, (q2 - q1)/dt)`` a step solves (dissertation 4.1 and A.2)::

    p1 + D1Ld + fd- - Dh(q1)^T lam = 0,   h(q2) = 0,   p2 = D2Ld + fd+

for the dynamic variables of q2 and the multipliers lam; the kinematic variables of q2 are inputs.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from leastaction import _core
from leastaction.errors import ArgumentError, InconsistentStartError, StepError, worst_first
from leastaction.mechanics.arguments import Array, as_array, as_number, shape_of
from leastaction.mechanics.assembly import check_consistent
from leastaction.mechanics.elements import Distance
from leastaction.mechanics.mechanism import Mechanism
from leastaction.mechanics.trajectory import SimulationStatus, State, Trajectory

Split = Literal["symmetric", "left"]
Signal = npt.ArrayLike | Callable[[float], npt.ArrayLike] | None

_REASONS = {
    1: "Newton's method did not converge in {iterations} iterations",
    2: "the equations of the step are not finite",
    3: "the equations of the step are singular",
}
_VELOCITY_TOLERANCE = 1e-6
_TRAJECTORY_TOLERANCE = 1e-6  # (m or rad) of a step's end, for what counts as a trajectory
_CHUNK = 2000  # steps between looks at Ctrl-C


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


class MidpointVI:
    """Midpoint variational integrator of one mechanism. Holds settings, no state.

    Parameters
    ----------
    mechanism : Mechanism
    split : {"symmetric", "left"}, optional
        How a force acts on a step: half at each end (second order accurate), or all at the start
        (dissertation 4.12).
    tolerance : float, optional
        Largest residual of a step relative to the size of its terms.
    max_iterations : int, optional
        Newton iterations after which a step counts as failed.
    threads : int, optional
        Threads for derivatives over a trajectory; 0: as many as there are cores.

    Raises
    ------
    ArgumentError
        For an unknown split, or a tolerance or count out of range.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        split: Split = "symmetric",
        tolerance: float = 1e-13,
        max_iterations: int = 50,
        threads: int = 0,
    ) -> None:
        if split not in ("symmetric", "left"):
            raise ArgumentError(f"split: got {split!r}, expected 'symmetric' or 'left'")
        if not 0.0 < as_number(tolerance, "tolerance") < 1e-2:
            raise ArgumentError(f"tolerance: got {tolerance}, expected a number between 0 and 0.01")
        self.mechanism = mechanism
        self.split: Split = split
        self.tolerance = float(tolerance)
        self.threads = _count(threads, "threads", 0)
        steps = _count(max_iterations, "max_iterations", 1)
        self.core = _core.Midpoint(mechanism.core, split, self.tolerance, steps)

    # Starts

    def start(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike | None = None,
        *,
        p: npt.ArrayLike | None = None,
        t: float = 0.0,
    ) -> State:
        """Return the state at a configuration, with a velocity, a momentum, or at rest.

        Parameters
        ----------
        q : array_like, shape (nq,)
            Configuration; must satisfy the constraints (see `project_configuration`).
        v : array_like, shape (nq,), optional
            Velocity; must keep the constraints (see `project_velocity`). The momentum is ``dL/dv``.
        p : array_like, shape (nd,), optional
            Momentum of the dynamic variables, instead of a velocity.
        t : float, optional
            Time (s).

        Raises
        ------
        ArgumentError
            For wrong shapes, values that are not finite, or both v and p.
        InconsistentStartError
            If q or v violates the constraints; residuals by constraint name.
        """
        m = self.mechanism
        q0 = as_array(q, "q", (m.nq,), names=m.variables)
        self._check_lengths(q0[None, :], np.array([t]))
        check_consistent(m, q0)
        if v is not None and p is not None:
            raise ArgumentError("start: got both v and p; give the velocity or the momentum")
        if p is not None:
            momentum = as_array(p, "p", (m.nd,), names=m.dynamic)
            return State(as_number(t, "t"), q0.copy(), momentum.copy(), np.zeros(m.nrho))
        v0 = np.zeros(m.nq) if v is None else as_array(v, "v", (m.nq,), names=m.variables)
        self._check_velocity(q0, v0)
        return State(as_number(t, "t"), q0.copy(), m.momentum(q0, v0)[: m.nd], v0[m.nd :].copy())

    def start_from_configurations(
        self,
        q0: npt.ArrayLike,
        q1: npt.ArrayLike,
        dt: float,
        *,
        inputs: npt.ArrayLike | None = None,
        t: float = 0.0,
    ) -> State:
        """Return the state at q1 of a motion that went from q0 to q1 in one step.

        Parameters
        ----------
        q0, q1 : array_like, shape (nq,)
            Configurations on the constraints.
        dt : float
            Time from q0 to q1 (s).
        inputs : array_like, shape (nu,), optional
            Inputs over that step; zero if not given.
        t : float, optional
            Time at q1 (s).
        """
        m = self.mechanism
        first = as_array(q0, "q0", (m.nq,), names=m.variables)
        second = as_array(q1, "q1", (m.nq,), names=m.variables)
        for q in (first, second):
            check_consistent(m, q)
        h = _time_step(dt)
        u = (
            np.zeros(m.nu)
            if inputs is None
            else as_array(inputs, "inputs", (m.nu,), names=m.inputs)
        )
        _, p = self.core.momenta(first, second, u, h)
        return State(as_number(t, "t"), second.copy(), p, (second - first)[m.nd :] / h)

    # Motion

    def step(
        self,
        state: State,
        dt: float,
        *,
        inputs: npt.ArrayLike | None = None,
        rho_next: npt.ArrayLike | None = None,
    ) -> Step:
        """Return the state one time step later.

        Parameters
        ----------
        state : State
        dt : float
            Time step (s).
        inputs : array_like, shape (nu,), optional
            Inputs over the step; zero if not given.
        rho_next : array_like, shape (nrho,), optional
            Kinematic variables at its end; unchanged if not given.

        Raises
        ------
        ArgumentError
            For wrong shapes, values that are not finite, or dt <= 0.
        StepError
            If the step has no solution; residuals by equation, the state is the one given.
        """
        m = self.mechanism
        _check_state(state)
        h = _time_step(dt)
        u = (
            np.zeros(m.nu)
            if inputs is None
            else as_array(inputs, "inputs", (m.nu,), names=m.inputs)
        )
        rho = (
            state.q[m.nd :]
            if rho_next is None
            else as_array(rho_next, "rho_next", (m.nrho,), names=m.kinematic)
        )
        t = np.array([as_number(state.t, "state.t"), state.t + h])
        self._check_lengths(np.concatenate([state.q[: m.nd], rho])[None, :], t[1:])
        out = self.core.roll_out(
            t, self._vector(state), None, np.concatenate([u, rho])[None, :], None, None
        )
        if out["steps"] < 1:
            raise self.step_error(out, state)
        x = out["x"][1]
        return Step(self._state(float(t[1]), x), out["lam"][0], int(out["iterations"]))

    def simulate(
        self,
        start: State,
        t: npt.ArrayLike,
        *,
        inputs: Signal = None,
        rho: Signal = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Trajectory:
        """Simulate over given times, which need not be equidistant.

        Parameters
        ----------
        start : State
        t : array_like, shape (N+1,)
            Times (s), increasing, the first one that of the start.
        inputs : array_like (nu,) or (N, nu), or callable, optional
            Inputs: constant, one row a step, or a function of the time at the middle of a step. Zero if not
            given.
        rho : array_like (N+1, nrho) or (N, nrho), or callable, optional
            Kinematic variables at every instant (or at the ends of the steps), or a function of time.
            Unchanged if not given.
        progress : callable, optional
            Called with the number of steps done and of all steps now and then.

        Returns
        -------
        Trajectory
            Up to the first step that failed, or to where Ctrl-C stopped it; its status says which.

        Raises
        ------
        ArgumentError
            For wrong shapes, values that are not finite, or times that do not increase.
        """
        m = self.mechanism
        _check_state(start)
        times = check_times(t)
        if abs(times[0] - start.t) > 1e-9 * max(1.0, abs(start.t)):
            raise ArgumentError(
                f"t: the first time is {times[0]} s, but the start is at {start.t} s; they must agree"
            )
        N = len(times) - 1
        middle = 0.5 * (times[1:] + times[:-1])
        rho_next = signal_rows(rho, times[1:], m.kinematic, "rho", start.q[m.nd :], extra_row=True)
        self._check_lengths(np.hstack([np.tile(start.q[: m.nd], (N, 1)), rho_next]), times[1:])
        u = np.hstack([signal_rows(inputs, middle, m.inputs, "inputs", np.zeros(m.nu)), rho_next])
        x, lam = np.empty((N + 1, m.nx)), np.empty((N, m.nc))
        x[0] = self._vector(start)
        done, redundant = 0, False
        status, message = SimulationStatus.COMPLETED, f"completed {N} steps"
        try:
            while done < N:
                stop = min(N, done + _CHUNK)
                velocity = None
                if done:
                    velocity = (x[done, : m.nd] - x[done - 1, : m.nd]) / (
                        times[done] - times[done - 1]
                    )
                out = self.core.roll_out(
                    times[done : stop + 1], x[done].copy(), None, u[done:stop], None, velocity
                )
                made = int(out["steps"])
                x[done + 1 : done + 1 + made] = out["x"][1 : made + 1]
                lam[done : done + made] = out["lam"][:made]
                redundant = redundant or bool(out["rank_deficient"])
                begun, done = done, done + made
                if done < stop:
                    status = SimulationStatus.STEP_FAILED
                    message = str(self.step_error(out, self._state(float(times[done]), x[done])))
                    break
                if progress is not None and done > begun:
                    progress(done, N)
        except KeyboardInterrupt:
            status = SimulationStatus.INTERRUPTED
            message = f"interrupted after {done} of {N} steps"
        return self.trajectory(
            times[: done + 1],
            x[: done + 1],
            u[:done],
            lam[:done],
            status=status,
            message=message,
            rank_deficient=redundant,
        )

    def trajectory(
        self,
        t: Array,
        x: Array,
        u: Array,
        lam: Array,
        *,
        status: SimulationStatus = SimulationStatus.COMPLETED,
        message: str = "completed",
        rank_deficient: bool = False,
    ) -> Trajectory:
        """Return arrays of states (N+1, nx), inputs (N, nu + nrho) and multipliers as a `Trajectory`."""
        m = self.mechanism
        return Trajectory(
            m,
            t,
            x[:, : m.nq],
            x[:, m.nq : m.nq + m.nd],
            x[:, m.nq + m.nd :],
            u[:, : m.nu],
            lam,
            status,
            message,
            rank_deficient,
        )

    # Derivatives

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

        `reuse` offers arrays ``A``, ``B``, ``memo`` of an earlier call that may be written over.
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

        `reuse` offers an array ``H`` of an earlier call that may be written over.
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

    # Errors

    def step_error(self, out: dict[str, Any], state: State) -> StepError:
        """Return the error of a roll-out of the core that failed after `state`."""
        m = self.mechanism
        names = [f"dynamics of {name!r}" for name in m.dynamic]
        names += [f"constraint {name!r}" for name in m.constraints]
        residuals = worst_first(dict(zip(names, out["residual"], strict=True)))
        shown = ", ".join(f"{name}: {value:.2g}" for name, value in list(residuals.items())[:3])
        reason = _REASONS[int(out["status"])].format(iterations=out["failed_iterations"])
        return StepError(
            f"the step at t = {state.t:.6g} s failed: {reason}; largest residuals {shown}. Try a smaller "
            "time step, or prescribed variables and inputs that the mechanism can follow",
            t=state.t,
            residuals=residuals,
            iteration=int(out["failed_iterations"]),
            state=state,
        )

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

    def _check_lengths(self, q: Array, t: Array) -> None:
        """Complain about a prescribed distance that is not positive: it has no direction to pull in."""
        m = self.mechanism
        for name, element in m.elements.items():
            if not (isinstance(element, Distance) and isinstance(element.length, str)):
                continue
            lengths = q[:, m.variables.index(element.length)]
            if np.any(lengths <= 0.0):
                k = int(np.argmax(lengths <= 0.0))
                raise ArgumentError(
                    f"{name}: its length {element.length!r} is {lengths[k]:.6g} m at t = {t[k]:.6g} s, "
                    "expected a positive one, as a string of zero length has no direction to pull in"
                )

    def _check_velocity(self, q: Array, v: Array) -> None:
        m = self.mechanism
        if m.nc == 0:
            return
        jacobian = m.constraint_jacobian(q)
        rate = jacobian @ v
        size = np.abs(jacobian) @ np.abs(v)
        if np.any(np.abs(rate) > _VELOCITY_TOLERANCE * np.maximum(1.0, size)):
            residuals = worst_first(dict(zip(m.constraints, rate, strict=True)))
            name, value = next(iter(residuals.items()))
            raise InconsistentStartError(
                f"the velocity does not keep the constraints: the rate of {name!r} is {value:.3g}. "
                "Use project_velocity to bring it onto them",
                residuals=residuals,
            )

    def _vector(self, state: State) -> Array:
        m = self.mechanism
        return np.concatenate(
            [
                as_array(state.q, "state.q", (m.nq,), names=m.variables),
                as_array(state.p, "state.p", (m.nd,), names=m.dynamic),
                as_array(state.v_rho, "state.v_rho", (m.nrho,), names=m.kinematic),
            ]
        )

    def _state(self, t: float, x: Array) -> State:
        m = self.mechanism
        return State(t, x[: m.nq].copy(), x[m.nq : m.nq + m.nd].copy(), x[m.nq + m.nd :].copy())


def check_times(t: npt.ArrayLike) -> Array:
    """Return times (N+1,) as an array, N >= 1, strictly increasing and finite."""
    times = as_array(t, "t", (None,))
    if len(times) < 2:
        raise ArgumentError(f"t: got {len(times)} times, expected at least two")
    steps = np.diff(times)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        raise ArgumentError(
            f"t: times must increase, but t[{k}] = {times[k]} and t[{k + 1}] = {times[k + 1]}"
        )
    return times


def signal_rows(
    signal: Signal,
    times: Array,
    names: tuple[str, ...],
    what: str,
    default: Array,
    *,
    extra_row: bool = False,
) -> Array:
    """Return a signal as one row a step (N, n): constant, given by rows, or a function of time.

    With `extra_row` rows at all N + 1 instants are taken too, of which the first is dropped.
    """
    N, n = len(times), len(names)
    if signal is None:
        return np.tile(default, (N, 1))
    if callable(signal):
        return np.array(
            [as_array(signal(float(at)), f"{what}({at:g})", (n,), names=names) for at in times]
        ).reshape(N, n)
    shape = shape_of(signal)
    if shape is not None and len(shape) == 1:
        return np.tile(as_array(signal, what, (n,), names=names), (N, 1))
    rows = N + 1 if extra_row and shape is not None and shape[0] == N + 1 else N
    values = as_array(signal, what, (rows, n), names=names)
    if rows > N:
        off = np.abs(values[0] - default)
        if np.any(off > 1e-9 * np.maximum(1.0, np.abs(default))):
            i = int(np.argmax(off))
            raise ArgumentError(
                f"{what}: its first row has {names[i]!r} at {values[0, i]:.6g}, but the start has it at "
                f"{default[i]:.6g}; they must agree, or give one row a step without the first"
            )
    return values[rows - N :]


def _count(value: int, what: str, least: int) -> int:
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    if number < least:
        raise ArgumentError(f"{what}: got {value!r}, expected a whole number, at least {least}")
    return number


def _check_state(state: object) -> None:
    if not isinstance(state, State):
        raise ArgumentError(
            f"state: got {type(state).__name__}, expected a State, such as the result of start()"
        )


def _time_step(dt: float) -> float:
    h = as_number(dt, "dt")
    if h <= 0.0:
        raise ArgumentError(f"dt: got {h} s, expected a positive time step")
    return h
