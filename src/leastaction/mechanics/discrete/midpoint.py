"""The midpoint variational integrator: steps, simulation, and exact derivatives of both.

With ``Ld(q1, q2) = dt L((q1 + q2)/2, (q2 - q1)/dt)`` a step solves (dissertation 4.1 and A.2)::

    p1 + D1Ld + fd- - Dh(q1)^T lam = 0,   h(q2) = 0,   p2 = D2Ld + fd+

for the dynamic variables of q2 and the multipliers lam; the kinematic variables of q2 are inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Literal, final, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, CoarseStepWarning, StepError, closest
from leastaction.mechanics.configuration.assembly import (
    CONFIGURATION_TOLERANCE,
    VELOCITY_TOLERANCE,
    check_consistent,
    check_lengths,
    check_velocity,
)
from leastaction.mechanics.discrete import derivatives as differentiate
from leastaction.mechanics.discrete import functions, simulation
from leastaction.mechanics.discrete import sensitivity as of_trajectories
from leastaction.mechanics.discrete import step_sensitivity as of_steps
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.outcome import step_error
from leastaction.mechanics.discrete.prescribed import held, reached, step_to
from leastaction.mechanics.discrete.trajectory import (
    State,
    Step,
    Trajectory,
    check_state,
    state_in,
    state_of,
    trajectory_of,
    vector_of,
)
from leastaction.mechanics.mechanism.arguments import inputs_of, rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.singularity import SingularityWatch
from leastaction.mechanics.mechanism.turns import differences
from leastaction.numerics.arrays import (
    Array,
    Row,
    as_array,
    as_choice,
    as_count,
    as_number,
    as_time_step,
    require_finite,
    require_instance,
)
from leastaction.numerics.frozen import made
from leastaction.numerics.names import as_names
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality
from leastaction.numerics.warn import warn

Split = Literal["symmetric", "left"]


@public
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
        Where rotations are quaternions it is half at each end.
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
        For an unknown split, or "left" beside rotations that are quaternions, a tolerance or count out of range, an
        unknown input, or an element of which some inputs act at the instants and others do not.
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
        if split == "left" and mechanism.tree.rotations:
            names = ", ".join(each.name for each in mechanism.tree.rotations)
            raise ArgumentError(
                f"split: got 'left' where rotations are quaternions ({names}), whose forces act half at each end; "
                "take split='symmetric', or three angles (axes='xyz')"
            )
        self.mechanism = mechanism
        self.split: Split = split
        self.shares = (0.5, 0.5) if split == "symmetric" else (1.0, 0.0)
        self.tolerance = as_number(tolerance, "tolerance", above=0.0, below=1e-2)
        self.threads = as_count(threads, "threads", 0)
        steps = as_count(max_iterations, "max_iterations", 1)
        self.max_iterations = steps
        self.at_instants = _checked_instants(mechanism, at_instants)
        self.reels = any(element.length_variable is not None for element in mechanism.elements.values())
        self.watch = SingularityWatch(mechanism.balls, mechanism.coordinates)
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

    def start(self, q: Row, v: Row | None = None, *, p: Row | None = None, t: float = 0.0) -> State:
        """Return the state at a configuration, with a velocity, a momentum, or at rest.

        Parameters
        ----------
        q : array_like, shape (nq,), or mapping of str to float
            Configuration; must satisfy the constraints (see `project_configuration`). By name, ``{"hip": 0.3}``, what
            is not given is zero, and quaternions are of no rotation: as everywhere that one configuration is taken.
        v : array_like, shape (nv,), or mapping of str to float, optional
            Velocity, by name ``{"base.wx": 2.0}``; must keep the constraints (see `project_velocity`). The momentum is
            ``dL/dv``.
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
        when = as_number(t, "t")
        m = self.mechanism.at_time(when)
        q0 = single(m, q)
        if self.reels:
            check_lengths(m, q0[None, :], np.array([t]))
        if v is not None and p is not None:
            raise ArgumentError("start: got both v and p; give the velocity or the momentum")
        if p is not None:
            if m.nc:
                check_consistent(m, q0)
            momentum = as_array(p, "p", (m.nd,), names=m.dynamic)
            return state_of(m, when, np.concatenate((q0, momentum, np.zeros(m.nrho))))
        v0 = None if v is None else rates(m, v)
        x = np.empty(m.nx)
        if not m.core.start(q0, v0, when, CONFIGURATION_TOLERANCE, VELOCITY_TOLERANCE, x):
            check_consistent(m, q0)
            check_velocity(m, q0, np.zeros(m.nv) if v0 is None else v0)
            require_finite(x[m.nq :][: m.nd], "momentum", names=m.dynamic)
        return state_in(m, when, x)

    def start_from_configurations(
        self, q0: Row, q1: ArrayLike, dt: float, *, inputs: ArrayLike | None = None, t: float = 0.0
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
        first, second = single(m, q0, "q0"), single(m, q1, "q1")
        h, end = as_time_step(dt), as_number(t, "t")
        for q, when in ((first, end - h), (second, end)):
            check_consistent(m.at_time(when), q)
        u = inputs_of(m, inputs)
        _, p = self.core.momenta(first, second, u, h, h, end - h)
        moved = differences(m, second[None], first[None])[0]
        return State(end, second.copy(), p[: m.nd], moved[m.nd :] / h)

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
            Kinematic variables at its end, of rotations that are quaternions these; unchanged if not given.

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
        begin = as_number(state.t, "state.t")
        u = None if inputs is None else inputs_of(m, inputs)
        given = None
        if rho_next is not None:
            given = step_to(m, state.q, rho_next)
        elif m.nq - m.first_rho > m.nrho:
            given = held(m, vector_of(m, state)[m.first_rho : m.nq])
        if self.reels:
            start = vector_of(m, state)[: m.nq]
            after = start[m.first_rho :] if given is None else reached(m, start[m.first_rho :], given)
            check_lengths(m, np.concatenate((start[: m.first_rho], after))[None, :], np.array((begin + h,)))
        x, lam = np.empty(m.nx), np.empty(m.nc)
        told = self.core.step(begin, h, state.q, state.p, state.v_rho, u, given, x, lam)
        if told is None:
            raise self._failure(state, h, u, given)
        s, angle, variable, iterations = told
        # The start is the end of the step before, which has told of it.
        if self.watch.balls:
            self.watch.look(np.array((begin + h,)), x[None, : m.nq], before=state.q)
        name = m.variables[variable] if variable >= 0 else ""
        quality = made(StepQuality, t=begin, s=s, angle=angle, variable=name)
        if quality.is_coarse:
            warn(str(quality), CoarseStepWarning)
        return made(Step, state=state_in(m, begin + h, x), lam=lam, iterations=iterations, quality=quality)

    def _failure(self, state: State, dt: float, inputs: Array | None, given: Array | None) -> StepError:
        """Return why a step failed; raise where its state is none."""
        m = self.mechanism
        start = vector_of(m, state)
        rho = held(m, start[m.first_rho : m.nq]) if given is None else given
        controls = np.concatenate((inputs_of(m, inputs), rho))
        out = self.core.roll_out(np.array((state.t, state.t + dt)), start, None, controls[None, :], None)
        return step_error(m, out, state, rho)

    simulate = simulation.simulate

    def trajectory(self, t: Array, x: Array, u: Array, lam: Array, **told: Any) -> Trajectory:
        """Return arrays of states (N+1, nx), inputs (N, n_inputs + nrho) and multipliers as a `Trajectory`.

        ``told``: what else it tells of itself, such as its status and message.
        """
        return trajectory_of(self.mechanism, t, x, u, lam, **told)

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
    balance = functions.balance


def _checked_instants(mechanism: Mechanism, names: Sequence[str]) -> tuple[str, ...]:
    for name in as_names(names, "at_instants", "inputs"):
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
