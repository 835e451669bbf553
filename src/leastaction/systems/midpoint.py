"""The bridge in discrete time: a midpoint integrator over given times as a system that the optimiser can steer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from leastaction._core import StepStatus
from leastaction.errors import (
    ArgumentError,
    CoarseStepWarning,
    EnergyBalanceWarning,
    InconsistentStartError,
    ProjectionError,
)
from leastaction.mechanics.configuration.assembly import check_consistent, project_configuration
from leastaction.mechanics.configuration.null_space import NullSpace
from leastaction.mechanics.discrete.balance import balance_of
from leastaction.mechanics.discrete.derivatives import linearize_arrays
from leastaction.mechanics.discrete.linearization import StepDerivatives, step_pattern
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.outcome import quality_of, step_error
from leastaction.mechanics.discrete.sensitivity import start_by
from leastaction.mechanics.discrete.step_sensitivity import StepSensitivity, by_time_step, steps_by
from leastaction.mechanics.discrete.trajectory import State, Trajectory
from leastaction.mechanics.mechanism.arguments import state_by_name
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.units import input_units, multiplier_units, state_units
from leastaction.mechanics.mechanism.turns import differences
from leastaction.numerics.arrays import Array, Row, as_number, as_times, require_instance
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.frozen import changed, made, restore_state, saved_state
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem, check_window
from leastaction.optimal.quantity import Quantity
from leastaction.optimal.system import FINAL_TIME, Linearization, keeps
from leastaction.systems.quantities.discrete import ACROSS, KINDS, quantity_of
from leastaction.systems.quantities.physical import conditions_of
from leastaction.systems.saving import dataset_with_multipliers
from leastaction.systems.state_space import space_of_states

_RESOLVED = 0.7  # angle (rad) by which a variable may turn within a step that follows its motion
_FAR = 0.5 * np.pi  # angle (rad) by which a ball may turn within a step of a minimum before it is doubted
_OFF = 1e-6  # about the distance from the constraints at which a motion may begin, as far as rounded numbers go


@public
class MidpointSystem(DiscreteSystem):
    """``x+ = f(x, u, k)`` of a midpoint integrator over given times.

    State ``x = [q; rho; p; v_rho]``, input ``u = [inputs; rho_next]``. With `multipliers` the multipliers of
    the step that led to a state are appended, ``x = [q; rho; p; v_rho; lam]``, so that a cost can weigh the
    tension of strings and other constraint forces, with exact derivatives like everything else. Whole
    trajectories are rolled out and differentiated in the core. Any number of threads may share one system.

    Parameters
    ----------
    integrator : MidpointVI
    t : array_like, shape (N+1,)
        Times (s), increasing.
    multipliers : bool, optional
        Append the multipliers to the state.

    Raises
    ------
    ArgumentError
        If the times do not increase.
    """

    beside = MappingProxyType({"acceleration": ACROSS})
    __getstate__, __setstate__ = saved_state, restore_state

    def __init__(self, integrator: MidpointVI, t: ArrayLike, *, multipliers: bool = False) -> None:
        require_instance(integrator, "integrator", MidpointVI, "MidpointVI(mechanism) makes one")
        m = integrator.mechanism
        self.integrator = integrator
        self.t = as_times(t)
        self.multipliers = multipliers
        # Multipliers can be limited only where they are part of the state.
        self.quantities = tuple(kind for kind in KINDS if multipliers or kind not in ("multiplier", "tension"))
        self.nx = m.nx + (m.nc if multipliers else 0)
        self.nu = m.n_inputs + m.nrho
        self.space = space_of_states(m, beside=m.nc if multipliers else 0)
        self.N = len(self.t) - 1
        self.first_share = 1.0
        self._pattern = step_pattern(m, multipliers=multipliers)

    @property
    def mechanism(self) -> Mechanism:
        """What the integrator steps."""
        return self.integrator.mechanism

    def own_when(self, k: int) -> str:
        return f"step {k} at t = {self.t[k]:.4g} s"

    def own_input_name(self, i: int) -> str:
        """Return the name of an input, or of the prescribed variable that stands behind the inputs."""
        m = self.mechanism
        return (*m.inputs, *m.variables[m.nd :])[i]

    @property
    def state_units(self) -> tuple[str, ...]:
        units = state_units(self.mechanism, momenta=True)
        return (*units, *multiplier_units(self.mechanism, impulses=True)) if self.multipliers else units

    @property
    def input_units(self) -> tuple[str, ...]:
        m, units = self.mechanism, self.mechanism.units
        return (*input_units(m), *(units[name] for name in m.kinematic))

    def told(self) -> MidpointSystem | None:
        """Return the system without what a subclass adds; None of one that steps otherwise, or has other states."""
        if type(self) is MidpointSystem:
            return self
        plain = MidpointSystem(self.integrator, self.t, multipliers=self.multipliers)
        plain.first_share = self.first_share
        same = (plain.nx, plain.nu, plain.N) == (self.nx, self.nu, self.N)
        return plain if same and type(self).f is MidpointSystem.f else None

    def motion(self, result: Any) -> Trajectory:
        return self.trajectory(result.x, result.u)

    def doubts(self, result: Any) -> list[Warning]:
        """Return that steps of time are coarse, or that energy and work do not balance, as `simulate` would warn."""
        worst, found = result.worst_step, list[Warning]()
        if worst is not None and worst.is_coarse:
            found.append(CoarseStepWarning(str(worst)))
        elif worst is not None and worst.angle > _FAR and worst.variable not in self.mechanism.coordinates:
            far = f"{worst.variable!r} moved by {worst.angle:.3g} rad in the step at t = {worst.t:.6g} s"
            found.append(CoarseStepWarning(f"{far}, more than a right angle: shorter steps may turn the other way"))
        vi, x = self.integrator, self._bare(result.x)
        complaint = balance_of(self.t, vi.core.energies(self.t, x, result.u, self._impulses(x, result.u))).complaint
        return [*found, EnergyBalanceWarning(complaint)] if complaint else found

    def dataset(self, result: Any) -> Dataset:
        vi = self.integrator
        settings = {name: getattr(vi, name) for name in ("split", "tolerance", "max_iterations", "threads")}
        own = {"multipliers": self.multipliers, "first_share": self.first_share, "at_instants": list(vi.at_instants)}
        return dataset_with_multipliers(result, {"name": "MidpointSystem", **settings, **own}, impulses=True)

    def own_window(self, start: int, stop: int) -> DiscreteSystem:
        check_window(start, stop, self.N)
        return self._remade(self.integrator, self.t[start : stop + 1], self._share(start))

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        """Return the angles, and what turns them as far as a step of time follows well; see `DiscreteSystem`."""
        m = self.mechanism
        turning = {name for joint in m.tree.joints if joint.twist[3:].any() for name in joint.variables}
        names = tuple(name for name in m.variables if name in turning)
        return (names, _RESOLVED / np.diff(self.t)[:, None]) if names else None

    def own_time(self, k: int) -> float:
        return float(self.t[k])

    @property
    def times(self) -> Array:
        return self.t

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        """Return the directions (nx, n) in which an initial state may move; see `DiscreteSystem`.

        Those of the configuration are tangent to the constraints, and so are those of the momenta. The multipliers of
        an initial state mean nothing and stay. Left out, `free` is all variables, momenta, and rates of kinematic ones.
        """
        m = self.mechanism.at_time(self.t[0])
        chosen = list(range(m.nx)) if free is None else [i for i in self.free_entries(free) if i < m.nx]
        if self.space is not None:
            # A direction is free where all is that it moves.
            held = np.ones(self.nx, dtype=np.bool_)
            held[chosen] = False
            chosen = np.flatnonzero(~self.space.pattern[held].any(axis=0) & (np.arange(self.ndx) < m.ndx)).tolist()
        variables = [i for i in chosen if i < m.nv]
        momenta = [i for i in chosen if m.nv <= i < m.nv + m.nd]
        if not m.nc:
            return np.eye(self.ndx)[:, [*(i for i in chosen if i >= m.nv + m.nd), *variables, *momenta]]
        blocks = [np.eye(self.ndx)[:, [i for i in chosen if i >= m.nv + m.nd]]]
        whole = np.zeros((self.ndx, len(variables)))
        whole[variables, np.arange(len(variables))] = 1.0
        q = np.ascontiguousarray(x[: m.nq])
        Dh = m.constraint_jacobian(q)
        blocks.append(whole @ NullSpace.of(Dh[:, variables]).basis)
        # A momentum that constraints take up at once moves nothing: M times the velocities that they allow is left.
        moving = np.zeros((self.ndx, m.nd))
        moving[m.nv : m.nv + m.nd] = np.eye(m.nd)
        moving = moving @ m.mass_matrix(q)[: m.nd, : m.nd] @ NullSpace.of(Dh[:, : m.nd]).basis
        fixed = [i for i in range(m.nv, m.nv + m.nd) if i not in momenta]
        moving = moving @ NullSpace.of(moving[fixed]).basis
        return np.hstack([*blocks, moving])

    def idle_directions(self, x: Array) -> Array:
        """Return the momenta (nx, n) that constraints take up at once; at the end of a step they are what they are."""
        m = self.mechanism
        whole = np.zeros((self.ndx, 0))
        if m.nc:
            Dh = m.constraint_jacobian(np.ascontiguousarray(x[: m.nq]))[:, : m.nd]
            taken_up = NullSpace.of(NullSpace.of(Dh).basis.T).basis
            whole = np.zeros((self.ndx, taken_up.shape[1]))
            whole[m.nv : m.nv + m.nd] = taken_up
        return whole

    def own_state(self, given: Any) -> Row | None:
        """Return the numbers of a `State`, or by name with what is not turned; multipliers of no step are zero."""
        if isinstance(given, Mapping):
            return state_by_name(self.mechanism, given)
        bare = given.x if isinstance(given, State) else given
        if self.multipliers and np.shape(bare) == (self.mechanism.nx,):
            return np.concatenate([bare, np.zeros(self.mechanism.nc)])
        return None if bare is given else np.asarray(bare)

    def check_start(self, x: Array) -> None:
        if self.mechanism.nc:
            m = self.mechanism.at_time(self.t[0])
            try:
                check_consistent(m, np.ascontiguousarray(x[: m.nq]), tolerance=_OFF)
            except InconsistentStartError as error:
                raise ProjectionError(
                    f"initial x: the first state, which is fixed, is no state of the mechanism: {error}. Or begin with "
                    "free_start=True, or with `relax`"
                ) from None

    def own_moved_start(self, x: Array, dx: Array) -> Array:
        m = self.mechanism.at_time(self.t[0])
        moved = self.plus(x, dx)
        if m.nc:
            q = np.ascontiguousarray(moved[: m.nq])
            still = [name for name, change in zip(m.variables, dx[: m.nv], strict=True) if change == 0.0]
            moved[: m.nq] = project_configuration(m, q, hold=still, move_kinematic=True).q
        return moved

    def returning_entries(self, names: Sequence[str], what: str) -> list[int]:
        """Return the places of entries that are the same again in a periodic motion: not those of multipliers."""
        return [i for i in self.free_entries(names, what) if i < self.mechanism.nx]

    @property
    def parameters(self) -> Mapping[str, float]:  # type: ignore[override]
        """Those of the mechanism, and the final time (s)."""
        return {**self.mechanism.parameters, FINAL_TIME: float(self.t[-1])}

    def with_parameters(self, values: Mapping[str, float]) -> Self:
        """Return the same system with other values of some parameters; its time steps grow with the final time.

        Raises
        ------
        ArgumentError
            An unknown name, a value that is not finite, or a final time that is not after the first one.
        DescriptionError
            For a mass or a coefficient that cannot be.
        """
        return self._with_parameters(values, allow_nonphysical=False)

    def with_parameters_near(self, values: Mapping[str, float]) -> Self:
        return self._with_parameters(values, allow_nonphysical=True)

    def _with_parameters(self, values: Mapping[str, float], *, allow_nonphysical: bool) -> Self:
        numbers = {name: value for name, value in values.items() if name != FINAL_TIME}
        t, integrator = self.t, self.integrator
        if FINAL_TIME in values:
            end = as_number(values[FINAL_TIME], FINAL_TIME, above=float(t[0]))
            t = t[0] + (t - t[0]) * ((end - t[0]) / (t[-1] - t[0]))
        if numbers:
            mechanism = integrator.mechanism.with_parameters(numbers, allow_nonphysical=allow_nonphysical)
            integrator = integrator.like(mechanism)
        return self._remade(integrator, t, self.first_share)

    def conditions_of(self, names: Sequence[str]) -> list[Quantity]:
        return conditions_of(self.mechanism, names)

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array:
        bare, t = self._bare(x), self.t[start : start + len(x)]
        out = np.empty((len(u), self.ndx, len(names)))
        numbers = [name for name in names if name != FINAL_TIME]
        vi, share = self.integrator, self._share(start)
        found: list[tuple[list[str], StepSensitivity, Array | None]] = []
        if numbers:
            found.append((numbers, steps_by(vi, t, bare, u, numbers, first_share=share), None))
        if FINAL_TIME in names:
            # By the length of each step, and by the time at its start.
            growth = np.array([np.diff(t), t[:-1] - self.t[0]]).T[:, None, :] / (self.t[-1] - self.t[0])
            found.append(([FINAL_TIME], by_time_step(vi, t, bare, u, first_share=share), growth))
        for of, slopes, growing in found:
            columns = [list(names).index(name) for name in of]
            rows = slopes.x if not self.multipliers else np.concatenate([slopes.x, slopes.lam], axis=1)
            out[:, :, columns] = rows if growing is None else np.sum(rows * growing, axis=2, keepdims=True)
        return out

    def curvature_by_final_time(self, x: Array, u: Array, z: Array, start: int = 0) -> Array | None:
        """Return all second derivatives at once; None of a system that steps otherwise, as of its parameters.

        None too where an element changes with the time.
        """
        if type(self).f is not MidpointSystem.f or self.mechanism.core.timed:
            return None
        t, vi = self.t[start : start + len(x)], self.integrator
        out = vi.core.curvature_by_time_step(
            t, self._bare(x), u, z, self.multipliers, threads=vi.threads, first_share=self._share(start)
        )
        growth = np.diff(t)[:, None] / (self.t[-1] - self.t[0])
        out[:, -1] *= growth
        out[:, :, -1] *= growth
        return out

    def curvature_by_parameters(
        self, x: Array, u: Array, z: Array, names: Sequence[str], start: int = 0
    ) -> Array | None:
        """Return second derivatives by numbers of elements; None where a name is another number, or the final time."""
        vi, m = self.integrator, self.mechanism
        if FINAL_TIME in names or type(self).f is not MidpointSystem.f:
            return None
        each, sums = m.members_of(names)
        slots = m.slots_of_elements(each)
        if slots is None:
            return None
        directions = np.zeros((len(names), len(m.core.numbers)))
        directions[:, slots] = sums.T
        t = self.t[start : start + len(x)]
        found = vi.core.curvature_by_numbers(
            t, self._bare(x), u, z, directions, threads=vi.threads, first_share=self._share(start)
        )
        out = np.zeros((len(u), len(names), self.ndx + self.nu + len(names)))
        out[:, :, : m.ndx], out[:, :, self.ndx :] = found[:, :, : m.ndx], found[:, :, m.ndx :]
        return out

    def start_by_parameters(self, x: Array, names: Sequence[str], free: bool | Sequence[str]) -> Array:
        """Return how a configuration has to follow parameters that change its constraints, (nx, len(names)).

        Raises
        ------
        ArgumentError
            Where it would have to, and is not free.
        """
        m = self.mechanism
        out = np.zeros((self.ndx, len(names)))
        numbers = [name for name in names if name != FINAL_TIME]
        if m.nc and numbers:
            entries = () if free is False else range(m.nq) if free is True else self.free_entries(list(free))
            hold = [name for i, name in enumerate(m.variables) if i not in entries]
            columns = [list(names).index(name) for name in numbers]
            q = np.ascontiguousarray(x[: m.nq])
            try:
                out[: m.nd, columns] = start_by(self.integrator.like(m.at_time(self.t[0])), q, numbers, hold)
            except ArgumentError as error:
                raise ArgumentError(
                    f"unknowns: too little of the start is free to follow: {error}, or give free_start=True"
                ) from None
        return out

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:  # noqa: ARG002 - its own times
        return quantity_of(self.mechanism, kind, self.t, multipliers=self.multipliers)

    def f(self, x: Array, u: Array, k: int) -> Array:
        m = self.mechanism
        if not 0 <= k < self.N:
            raise ArgumentError(f"k: got {k}, expected a step of 0 .. {self.N - 1}")
        full, x = x, np.ascontiguousarray(x[: m.nx])
        out = self.integrator.core.roll_out(self.t[k : k + 2], x, None, u[None, :], None, first_share=self._share(k))
        if out.steps < 1:
            nothing = np.empty((0, m.nc))
            state = self.integrator.trajectory(self.t[k : k + 1], x[None, :], u[None, :][:0], nothing).last
            raise step_error(m, out, state, u[m.n_inputs :])
        return np.asarray(self._states(out.x, out.lam, full)[1])

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        d = self._step(x, u, k)
        return d.A_all[0], d.B_all[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        return np.asarray(self._step(x, u, k).curvature_all(z[None, :])[0])

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout | None:
        m = self.mechanism
        if self.multipliers and np.any(K[start:stop, :, m.ndx :]):
            # The core feeds back no multipliers. Nothing depends on them, so no optimal gain is lost with
            # theirs; a gain that does have them takes the slow way.
            return None
        out = self.integrator.core.roll_out(
            self.t[start : stop + 1],
            x0[: m.nx],
            self._bare(xbar[start : stop + 1]),
            ubar[start:stop],
            np.ascontiguousarray(K[start:stop, :, : m.ndx]),
            first_share=self._share(start),
        )
        done = out.steps
        failure = None
        worst = quality_of(m, out, self.t[start : stop + 1])
        if done < stop - start:
            failure = self._failure(out.status, worst, start + done)
        x = self._states(out.x[: done + 1], out.lam[:done], x0)
        at = None if worst is None else start + out.worst.k
        return made(Rollout, x=x, u=out.u[:done], steps_done=done, failure=failure, worst_step=worst, worst_at=at)

    def own_linearize_by(
        self, x: Array, u: Array, names: Sequence[str], out: Linearization | None
    ) -> tuple[Linearization, Array] | None:
        own = keeps(self, MidpointSystem, "linearize", "own_linearize") and not self.mechanism.core.timed
        if tuple(names) != (FINAL_TIME,) or not own:
            return None
        by = np.empty((self.N, self.ndx))
        d = self._linearize(self.t, x, u, self.first_share, _memory_of(out), by)
        by *= np.diff(self.t)[:, None] / (self.t[-1] - self.t[0])
        return self._linearization(d), by[:, :, None]

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization:
        d = self._linearize(self.t, x, u, self.first_share, _memory_of(out))
        return self._linearization(d) if out is None or out.memory is not d else out

    def _linearization(self, d: StepDerivatives) -> Linearization:
        return made(
            Linearization, A=d.A_all, B=d.B_all, second=d.curvature_all, memory=d, pattern=self._pattern,
            packed=d.packed_curvature_all,
        )  # fmt: skip

    def own_step_each(self, x: Array, u: Array) -> Rollout | None:
        if type(self).f is not MidpointSystem.f:
            return None
        m = self.mechanism
        out = self.integrator.core.step_each(self.t, self._bare(x), u, self.integrator.threads, self.first_share)
        worst = quality_of(m, out, self.t)
        done = out.steps
        failure = None if done == self.N else self._failure(out.status, worst, done)
        ends = np.hstack([out.x, out.lam]) if self.multipliers else out.x
        at = None if out.worst.k < 0 else out.worst.k
        return Rollout(ends[:done], u[:done], done, failure, worst, at)

    def own_linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization | None:
        if type(self).derivatives is not MidpointSystem.derivatives:
            return None
        d = linearize_arrays(
            self.integrator, self.t, self._bare(x), u, multipliers=self.multipliers, ends=self._bare(ends),
            first_share=self.first_share,
        )  # fmt: skip
        return self._linearization(d)

    def curvatures(self, x: Array, u: Array, z: Array) -> Array:
        return self.linearize(x, u).curvature(z)

    def trajectory(self, x: Array, u: Array) -> Trajectory:
        """Return states (N+1, nx) and inputs (N, nu) of this system as a `Trajectory`, multipliers and all."""
        x = self._bare(x)
        return self.integrator.trajectory(self.t, x, u, self._impulses(x, u))

    def _impulses(self, x: Array, u: Array) -> Array:
        """Return the multipliers (N, nc) of every step along states without them."""
        return self._linearize(self.t, x, u, self.first_share).lam if self.mechanism.nc else np.empty((len(u), 0))

    def states_along(self, q: Array, p: Array, v_rho: Array | None = None) -> Array:
        """Return the states (N+1, nx) of a motion with these configurations and momenta; multipliers in them are zero.

        Parameters
        ----------
        q, p : ndarray, shape (N+1, nq), (N+1, nd)
        v_rho : ndarray, shape (nrho,), optional
            First rates of the prescribed variables, zero if left out; the others follow from q.

        Raises
        ------
        ArgumentError
            Other shapes.
        """
        m = self.mechanism
        first = np.zeros(m.nrho) if v_rho is None else v_rho
        for what, given, shape, meaning in (
            ("q", q, (self.N + 1, m.nq), "(N+1, nq)"), ("p", p, (self.N + 1, m.nd), "(N+1, nd)"),
            ("v_rho", first, (m.nrho,), "(nrho,)"),
        ):  # fmt: skip
            if given.shape != shape:
                raise ArgumentError(f"{what}: got shape {given.shape}, expected {shape}, that is {meaning}")
        x = np.zeros((self.N + 1, self.nx))
        x[:, : m.nq], x[:, m.nq : m.nq + m.nd] = q, p
        x[0, m.nq + m.nd : m.nx] = first
        x[1:, m.nq + m.nd : m.nx] = differences(m, q[1:], q[:-1])[:, m.nd :] / np.diff(self.t)[:, None]
        return x

    def _failure(self, status: StepStatus, worst: StepQuality | None, k: int) -> str:
        """Return why step k could not be made."""
        failure = f"{self.when(k)} could not be solved"
        if status == StepStatus.too_coarse and worst is not None:
            failure += f", the time step is too coarse: s = {worst.s:.3g}"
            if worst.variable:
                failure += f", {worst.variable!r} moves at {worst.angle:.3g} rad a step"
        return failure

    def _step(self, x: Array, u: Array, k: int) -> StepDerivatives:
        return self._linearize(self.t[k : k + 2], np.stack([x, self.f(x, u, k)]), u[None, :], self._share(k))

    def _linearize(
        self,
        t: Array,
        x: Array,
        u: Array,
        first_share: float,
        out: StepDerivatives | None = None,
        by_time_step: Array | None = None,
    ) -> StepDerivatives:
        return linearize_arrays(
            self.integrator, t, self._bare(x), u, multipliers=self.multipliers, out=out, first_share=first_share,
            by_time_step=by_time_step,
        )  # fmt: skip

    def _remade(self, integrator: MidpointVI, t: Array, first_share: float) -> Self:
        """Return the same system with another integrator or other times.

        A subclass that holds more than those, such as values by step, overrides it.
        """
        return changed(self, integrator=integrator, t=t, N=len(t) - 1, first_share=first_share)

    def _share(self, k: int) -> float:
        """Return the part of step k for which forces at the instants act at its start."""
        return self.first_share if k == 0 else 1.0

    def _bare(self, x: Array) -> Array:
        """Return states without multipliers."""
        return np.ascontiguousarray(x[:, : self.mechanism.nx])

    def _states(self, x: Array, lam: Array, x0: Array) -> Array:
        """Return states of the core with their multipliers behind them, where they belong to the state."""
        if not self.multipliers:
            return x
        full = np.empty((len(x), self.nx))
        nx = x.shape[1]
        full[:, :nx] = x
        full[0, nx:] = x0[nx:]
        full[1:, nx:] = lam
        return full


def _memory_of(out: Linearization | None) -> StepDerivatives | None:
    """Return the memory of an earlier linearization, to be used again."""
    memory = None if out is None else out.memory
    if not isinstance(memory, StepDerivatives | None):
        raise ArgumentError(
            f"out: got a linearization with the memory {type(memory).__name__}, expected one that this system returned"
        )
    return memory
