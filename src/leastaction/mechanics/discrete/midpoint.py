"""The midpoint variational integrator: steps, simulation, and exact derivatives of both.

With ``Ld(q1, q2) = dt L((q1 + q2)/2, (q2 - q1)/dt)`` a step solves (dissertation 4.1 and A.2)::

    p1 + D1Ld + fd- - Dh(q1)^T lam = 0,   h(q2) = 0,   p2 = D2Ld + fd+

for the dynamic variables of q2 and the multipliers lam; the kinematic variables of q2 are inputs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, cast, final, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import (
    ArgumentError,
    CoarseStepWarning,
    InconsistentStartError,
    StepError,
    closest,
    worst_first,
)
from leastaction.mechanics.configuration.assembly import check_consistent, check_velocity
from leastaction.mechanics.configuration.contradiction import find_contradiction
from leastaction.mechanics.discrete import derivatives as differentiate
from leastaction.mechanics.discrete import functions
from leastaction.mechanics.discrete import sensitivity as of_trajectories
from leastaction.mechanics.discrete import step_sensitivity as of_steps
from leastaction.mechanics.discrete.feedback import MidpointLaw
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.quality import quality_of
from leastaction.mechanics.discrete.step import Step
from leastaction.mechanics.discrete.trajectory import SimulationStatus, State, Trajectory, check_state, state_of
from leastaction.mechanics.mechanism.arguments import inputs_of
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.singularity import SingularityWatch
from leastaction.numerics.arrays import (
    Array,
    as_array,
    as_choice,
    as_count,
    as_number,
    as_time_step,
    as_times,
    read_only,
    require_instance,
)
from leastaction.numerics.signals import Signal, StateLaw, signal_rows, takes_state
from leastaction.numerics.step_quality import StepQuality, coarsest

Split = Literal["symmetric", "left"]
LawAt = Literal["start", "midpoint"]

_REASONS = {
    _core.StepStatus.no_convergence: "Newton's method did not converge in {iterations} iterations",
    _core.StepStatus.not_finite: "the equations of the step are not finite",
    _core.StepStatus.singular: "the equations of the step are singular",
    _core.StepStatus.too_coarse: "the time step is too coarse",
}
_CHUNK = 2000  # steps between looks at Ctrl-C


@final
class MidpointVI(Integrator):
    """Midpoint variational integrator of one mechanism.

    It holds settings and no state: the same arguments give the same result, to the last bit, whatever was asked
    before, and any number of threads may share it. All that computes releases Python's lock.

    Parameters
    ----------
    mechanism : Mechanism
    split : {"symmetric", "left"}, optional
        How a force acts on a step: half at each end (second order accurate), or all at the start (dissertation 4.12).
    tolerance : float, optional
        Largest residual of a step relative to the size of its terms.
    max_iterations : int, optional
        Newton iterations after which a step counts as failed.
    threads : int, optional
        Threads for derivatives over a trajectory; 0: as many as there are cores.
    at_instants : sequence of str, optional
        Inputs whose forces act at the instants, as those of constraints do: ``dt f(q_1, 0, u)`` is added to the
        momentum at the start of a step. See `PulledSystem`.

    Raises
    ------
    ArgumentError
        For an unknown split, a tolerance or count out of range, an unknown input, or an element of which some inputs
        act at the instants and others do not.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        split: Split = "symmetric",
        tolerance: float = 1e-13,
        max_iterations: int = 50,
        threads: int = 0,
        at_instants: Sequence[str] = (),
    ) -> None:
        require_instance(mechanism, "mechanism", Mechanism)
        as_choice(split, "split", get_args(Split))
        self.mechanism = mechanism
        self.split: Split = split
        self.shares = (0.5, 0.5) if split == "symmetric" else (1.0, 0.0)
        self.tolerance = as_number(tolerance, "tolerance", above=0.0, below=1e-2)
        self.threads = as_count(threads, "threads", 0)
        steps = as_count(max_iterations, "max_iterations", 1)
        self.max_iterations = steps
        self.at_instants = _checked_instants(mechanism, at_instants)
        self._watch = SingularityWatch(mechanism.balls, mechanism.variables)
        late = [mechanism.inputs.index(name) for name in self.at_instants]
        self.core = _core.Midpoint(mechanism.core, _core.Split[split], self.tolerance, steps, at_instants=late)

    def like(self, mechanism: Mechanism) -> MidpointVI:
        return MidpointVI(mechanism, **self._settings)

    def with_instants(self, inputs: Sequence[str]) -> MidpointVI:
        """Return the same integrator with other inputs whose forces act at the instants."""
        return MidpointVI(self.mechanism, **{**self._settings, "at_instants": inputs})

    @property
    def _settings(self) -> dict[str, Any]:
        names = ("split", "tolerance", "max_iterations", "threads", "at_instants")
        return {name: getattr(self, name) for name in names}

    def __reduce__(self) -> tuple[Any, ...]:
        # The core is made again from the settings, in a worker process too.
        return partial(MidpointVI, self.mechanism, **self._settings), ()

    # Starts

    def start(self, q: ArrayLike, v: ArrayLike | None = None, *, p: ArrayLike | None = None, t: float = 0.0) -> State:
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
        check_velocity(m, q0, v0)
        momentum = as_array(m.momentum(q0, v0)[: m.nd], "momentum", (m.nd,), names=m.dynamic)
        return State(as_number(t, "t"), q0.copy(), momentum, v0[m.nd :].copy())

    def start_from_configurations(
        self, q0: ArrayLike, q1: ArrayLike, dt: float, *, inputs: ArrayLike | None = None, t: float = 0.0
    ) -> State:
        """Return the state at q1 of a motion that went from q0 to q1 in one step.

        Parameters
        ----------
        q0, q1 : array_like, shape (nq,)
            Configurations on the constraints.
        dt : float
            Time from q0 to q1 (s).
        inputs : array_like, shape (n_inputs,), optional
            Inputs over that step; zero if not given.
        t : float, optional
            Time at q1 (s).
        """
        m = self.mechanism
        first = as_array(q0, "q0", (m.nq,), names=m.variables)
        second = as_array(q1, "q1", (m.nq,), names=m.variables)
        for q in (first, second):
            check_consistent(m, q)
        h = as_time_step(dt)
        u = inputs_of(m, inputs)
        _, p = self.core.momenta(first, second, u, h, h)
        return State(as_number(t, "t"), second.copy(), p[: m.nd], (second - first)[m.nd :] / h)

    # Motion

    def step(
        self, state: State, dt: float, *, inputs: ArrayLike | None = None, rho_next: ArrayLike | None = None
    ) -> Step:
        """Return the state one time step later.

        Parameters
        ----------
        state : State
        dt : float
            Time step (s).
        inputs : array_like, shape (n_inputs,), optional
            Inputs over the step; zero if not given.
        rho_next : array_like, shape (nrho,), optional
            Kinematic variables at its end; unchanged if not given.

        Raises
        ------
        ArgumentError
            For wrong shapes, values that are not finite, or dt <= 0.
        StepError
            If the step has no solution; residuals by equation, the state is the one given.

        Warns
        -----
        CoarseStepWarning
            If the time step is so coarse that the solution is about to be lost.
        SingularityWarning
            If the step ends near the singularity of a `ball` or `free` joint.
        """
        m = self.mechanism
        check_state(state)
        h = as_time_step(dt)
        u = inputs_of(m, inputs)
        rho = state.q[m.nd :] if rho_next is None else as_array(rho_next, "rho_next", (m.nrho,), names=m.kinematic)
        t = np.array([as_number(state.t, "state.t"), state.t + h])
        self._check_lengths(np.concatenate([state.q[: m.nd], rho])[None, :], t[1:])
        out = self.core.roll_out(t, self._vector(state), None, np.concatenate([u, rho])[None, :], None)
        if out.steps < 1:
            raise self.step_error(out, state, rho)
        x = out.x[1]
        # The start is the end of the step before, which has told of it.
        self._watch.look(t[1:], x[None, : m.nq], before=state.q)
        quality = quality_of(m, out, t)
        if quality is not None and quality.is_coarse:
            warnings.warn(str(quality), CoarseStepWarning, stacklevel=2)
        return Step(state_of(m, float(t[1]), x), out.lam[0], out.iterations, quality)

    def simulate(
        self,
        start: State,
        t: ArrayLike,
        *,
        inputs: Signal | StateLaw = None,
        rho: Signal = None,
        law_at: LawAt = "start",
        progress: Callable[[int, int], None] | None = None,
    ) -> Trajectory:
        """Simulate over given times, which need not be equidistant.

        Parameters
        ----------
        start : State
        t : array_like, shape (N+1,)
            Times (s), increasing, the first one that of the start.
        inputs : array_like (n_inputs,) or (N, n_inputs), or callable, optional
            Inputs: constant, one row a step, or a function of the time at the middle of a step; or a feedback
            ``(t, x)``, such as `Feedback`, of the time and the state ``x = [q; rho; p; v_rho]`` (see `law_at`).
            One input may be given as (N,). Zero if not given.
        rho : array_like (N+1, nrho) or (N, nrho), or callable, optional
            Kinematic variables at every instant (or at the ends of the steps), or a function of time.
            Unchanged if not given.
        law_at : {"start", "midpoint"}, optional
            Where in each step a feedback is evaluated: at its start, and held over it, as a digital controller does; or
            at its midpoint, where forces act (``q = (q1 + q2)/2``, ``v = (q2 - q1)/dt``, p = dL/dv). The closed loop is
            of first order with the former, of second with the latter, whose input is solved for with the step.
        progress : callable, optional
            Called with the number of steps done and of all steps now and then.

        Returns
        -------
        Trajectory
            Up to the first step that failed, or to where Ctrl-C stopped it; its status says which.

        Raises
        ------
        ArgumentError
            For wrong shapes, values that are not finite, times that do not increase, or an unknown `law_at`.

        Warns
        -----
        CoarseStepWarning
            If the time step is so coarse somewhere that the solution is about to be lost; see `Trajectory.worst_step`.
        SingularityWarning
            If the motion comes near the singularity of a `ball` or `free` joint; once for every joint.
        """
        m = self.mechanism
        check_state(start)
        times = as_times(t)
        if abs(times[0] - start.t) > 1e-9 * max(1.0, abs(start.t)):
            raise ArgumentError(f"t: the first time is {times[0]} s, but the start is at {start.t} s; they must agree")
        N = len(times) - 1
        middle = 0.5 * (times[1:] + times[:-1])
        rho_next = signal_rows(rho, times[1:], m.kinematic, "rho", start.q[m.nd :], extra_row=True)
        self._check_lengths(np.hstack([np.tile(start.q[: m.nd], (N, 1)), rho_next]), times[1:])
        law = inputs if takes_state(inputs) else None
        as_choice(law_at, "law_at", get_args(LawAt))
        inside = MidpointLaw(self, law) if law is not None and law_at == "midpoint" else None
        forces = None if law is not None else cast(Signal, inputs)
        u = np.hstack([signal_rows(forces, middle, m.inputs, "inputs", np.zeros(m.n_inputs)), rho_next])
        x, lam = np.empty((N + 1, m.nx)), np.empty((N, m.nc))
        x[0] = self._vector(start)
        done, redundant = 0, False
        qualities: list[StepQuality | None] = []
        status, message = SimulationStatus.COMPLETED, f"completed {N} steps"
        try:
            while done < N:
                stop = min(N, done + (_CHUNK if law is None else 1))
                if inside is not None:
                    pair = times[done : stop + 1]
                    out, u[done, : m.n_inputs] = inside.step(pair, x[done], rho_next[done])
                else:
                    if law is not None:
                        at = float(times[done])
                        given = law(at, read_only(x[done]))
                        u[done, : m.n_inputs] = as_array(given, f"inputs({at:g}, x)", (m.n_inputs,), names=m.inputs)
                    out = self.core.roll_out(times[done : stop + 1], x[done].copy(), None, u[done:stop], None)
                qualities.append(quality_of(m, out, times[done:]))
                made = out.steps
                x[done + 1 : done + 1 + made] = out.x[1 : made + 1]
                lam[done : done + made] = out.lam[:made]
                redundant = redundant or out.rank_deficient
                begun, done = done, done + made
                if done < stop:
                    status = SimulationStatus.STEP_FAILED
                    last = state_of(m, float(times[done]), x[done])
                    message = str(self.step_error(out, last, u[done, m.n_inputs :]))
                    break
                if progress is not None and done > begun:
                    progress(done, N)
        except StepError as error:
            status, message = SimulationStatus.STEP_FAILED, str(error)
        except KeyboardInterrupt:
            status = SimulationStatus.INTERRUPTED
            message = f"interrupted after {done} of {N} steps"
        passages = self._watch.look(times[: done + 1], x[: done + 1, : m.nq])
        worst = coarsest(qualities)
        if worst is not None and worst.is_coarse and status is not SimulationStatus.STEP_FAILED:
            warnings.warn(str(worst), CoarseStepWarning, stacklevel=2)
        return self.trajectory(
            times[: done + 1],
            x[: done + 1],
            u[:done],
            lam[:done],
            status=status,
            message=message,
            rank_deficient=redundant,
            worst_step=worst,
            singularities=passages,
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
        worst_step: StepQuality | None = None,
        singularities: tuple[str, ...] = (),
    ) -> Trajectory:
        """Return arrays of states (N+1, nx), inputs (N, n_inputs + nrho) and multipliers as a `Trajectory`."""
        m = self.mechanism
        return Trajectory(
            m,
            t,
            x[:, : m.nq],
            u[:, : m.n_inputs],
            lam,
            p=x[:, m.nq : m.nq + m.nd],
            v_rho=x[:, m.nq + m.nd :],
            status=status,
            message=message,
            rank_deficient=rank_deficient,
            worst_step=worst_step,
            singularities=singularities,
        )

    # Derivatives and functions of steps: each is explained where it is

    linearize = differentiate.linearize
    linearize_arrays = differentiate.linearize_arrays
    curvature = differentiate.curvature
    tensors = differentiate.tensors
    differentiate_by = of_steps.differentiate_by
    sensitivity = of_trajectories.sensitivity
    discrete_lagrangian = functions.discrete_lagrangian
    discrete_potential = functions.discrete_potential
    discrete_force = functions.discrete_force
    driving_force = functions.driving_force

    # Errors

    def step_error(self, out: _core.RollOut, state: State, rho_next: Array) -> StepError:
        """Return the error of a roll-out of the core that failed after `state`, going to `rho_next`."""
        m = self.mechanism
        wanted = np.concatenate([state.q[: m.nd], rho_next])
        found = find_contradiction(m, wanted) if np.all(np.isfinite(wanted)) else None
        advice = "Try a smaller time step, or prescribed variables and inputs that the mechanism can follow"
        if found is not None:
            advice = f"Where the prescribed variables go, {found}"
        elif np.all(np.isfinite(state.q)):
            try:
                check_consistent(m, state.q, tolerance=1e-6)
            except InconsistentStartError as error:
                advice = f"Where the step begins, {error}"
        names = [f"dynamics of {name!r}" for name in m.dynamic]
        names += [f"constraint {name!r}" for name in m.constraints]
        residuals = worst_first(dict(zip(names, out.residual, strict=True)))
        reason = _REASONS[out.status].format(iterations=out.failed_iterations)
        quality = quality_of(m, out, np.full(out.steps + 1, state.t))
        if quality is not None and out.status == _core.StepStatus.too_coarse:
            reason += f": its solution can be followed from short ones up to {out.reached:.3g} s, "
            reason += f"where s = {quality.s:.3g}"
            if quality.variable:
                reason += f" and {quality.variable!r} moves at {quality.angle:.3g} rad a step"
        # Where Newton's method came to a solution, but not to that of short steps, they are all met.
        if not max(map(abs, residuals.values()), default=0.0) < 1e-9:
            shown = [f"{name}: {value:.2g}" for name, value in list(residuals.items())[:3]]
            reason += f"; largest residuals {', '.join(shown)}"
        return StepError(
            f"the step at t = {state.t:.6g} s failed: {reason}. {advice}",
            t=state.t,
            residuals=residuals,
            iteration=out.failed_iterations,
            state=state,
            quality=quality,
        )

    def _check_lengths(self, q: Array, t: Array) -> None:
        """Complain about a prescribed distance that is not positive: it has no direction to pull in."""
        m = self.mechanism
        for name, element in m.elements.items():
            variable = element.length_variable
            if variable is None:
                continue
            lengths = q[:, m.variables.index(variable)]
            if np.any(lengths <= 0.0):
                k = int(np.argmax(lengths <= 0.0))
                raise ArgumentError(
                    f"{name}: its length {variable!r} is {lengths[k]:.6g} m at t = {t[k]:.6g} s, "
                    "expected a positive one, as a string of zero length has no direction to pull in"
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


def _checked_instants(mechanism: Mechanism, names: Sequence[str]) -> tuple[str, ...]:
    for name in names:
        if name not in mechanism.inputs:
            raise ArgumentError(f"at_instants: got {name!r}; {closest(name, mechanism.inputs, what='inputs')}")
    late = set(names)
    for label, element in mechanism.elements.items() if late else ():
        own = set(element.uses.inputs)
        if own & late and own - late:
            raise ArgumentError(
                f"at_instants: {label!r} has the inputs {sorted(own & late)} at the instants and {sorted(own - late)} "
                "not; the force of one element acts in one place, so give all of its inputs or none"
            )
    return tuple(dict.fromkeys(names))
