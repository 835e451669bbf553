"""The discrete system ``x+ = f(x, u, k)``: all that the optimiser knows of what it steers.

Three methods of one step are enough to define a system. The methods over whole trajectories loop over
them; a system with a faster way (compiled, parallel over time) overrides those.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, as_array, read_only, shape_of
from leastaction.numerics.pool import copied
from leastaction.numerics.public import public
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.initial import pair_of
from leastaction.optimal.looking_back import InputRates
from leastaction.optimal.quantity import Entries, Later, Quantity
from leastaction.optimal.system import FINAL_TIME, Linearization, System


@public
@dataclass(frozen=True)
class Rollout:
    """A trajectory, or the part of it up to the step that failed. Threads may share it.

    Attributes
    ----------
    x : ndarray (steps_done + 1, nx)
        States, the first one is where the roll-out started.
    u : ndarray (steps_done, nu)
        Inputs that were applied.
    steps_done : int
        Number of steps that succeeded.
    failure : str or None
        Why the roll-out ended early; None if it did not.
    worst_step : StepQuality or None
        The coarsest step, which may be the one that failed; None where the system does not know.
    worst_at : int or None
        Which step of the horizon that is.
    """

    x: Array
    u: Array
    steps_done: int
    failure: str | None = None
    worst_step: StepQuality | None = None
    worst_at: int | None = None

    @property
    def complete(self) -> bool:
        """Whether every step succeeded."""
        return self.failure is None


class DiscreteSystem(System):
    """A discrete system over a horizon of N steps.

    Subclasses set `nx`, `nu` and `N`, and implement what `System` says.
    """

    N: int
    """Number of steps of the horizon."""
    numbered = True
    """Limits may name instants by their index."""
    beside: Mapping[str, str] = MappingProxyType({})
    """Kinds of quantities that know names which another kind does not, by that kind."""

    @abstractmethod
    def f(self, x: Array, u: Array, k: int) -> Array:
        """Return the next state (nx,). A step without solution raises `StepError`."""

    @abstractmethod
    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        """Return ``A = df/dx`` (ndx, ndx) and ``B = df/du`` (ndx, nu) of step k."""

    def rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        """Simulate steps ``start .. stop-1`` under the feedback ``u = ubar - K difference(x, xbar)``.

        Parameters
        ----------
        x0 : ndarray (nx,)
            State at index `start`.
        xbar, ubar, K : ndarray (N+1, nx), (N, nu), (N, nu, ndx)
            Reference and gains of the whole horizon; rows are taken at ``k``.
        start, stop : int
            First step, and one past the last.

        Returns
        -------
        Rollout
            States at ``start .. stop``. A step that fails, or a state that is not finite, ends it
            with a reason; it is not an exception.
        """
        x = np.empty((stop - start + 1, self.nx))
        u = np.empty((stop - start, self.nu))
        x[0] = x0
        # What users' functions are given cannot be written to.
        states, inputs = read_only(x), read_only(u)
        for i, k in enumerate(range(start, stop)):
            u[i] = ubar[k] - K[k] @ self.difference(states[i], xbar[k])
            failure = self._make_step(states[i], inputs[i], k, x[i + 1])
            if failure is not None:
                return Rollout(x[: i + 1], u[:i], i, failure)
        return Rollout(x, u, stop - start)

    def _make_step(self, x: Array, u: Array, k: int, end: Array) -> str | None:
        """Write the next state to `end`; return why there is none, an outcome and no exception here."""
        try:
            # A diverging trial leaves the range of doubles.
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found = self.f(x, u, k)
        except (StepError, ArithmeticError) as error:
            return f"step {k}: {error}"
        try:
            if found is None:  # which NumPy would take for no number
                raise TypeError
            end[:] = found
        except (TypeError, ValueError, OverflowError):
            raise ArgumentError(
                f"{type(self).__name__}.f: got {_shown(found)} for step {k}, expected the next state, ({self.nx},)"
            ) from None
        return None if np.isfinite(end).all() else f"step {k}: the state is not finite"

    @property
    def quantities(self) -> tuple[str, ...]:
        return (*super().quantities, "input rate")

    def quantity(self, kind: str) -> Quantity:
        if kind == "input rate":
            return InputRates(self.input_names, range(self.nu), self.times)
        return super().quantity(kind)

    def when(self, k: int) -> str:
        """Return how to speak of step k in messages; one that knows the time says it."""
        return f"step {k}"

    def window(self, start: int, stop: int) -> DiscreteSystem:
        """Return the steps ``start .. stop-1`` as a system of their own; one with a faster way overrides it."""
        return WindowSystem(self, start, stop)

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        """Return names of quantities "rate", and the largest (N, 1) that the steps of time resolve.

        None where nothing is known of that. `optimize` asks for no more where it is stuck at steps that are too coarse.
        """
        return None

    # ---- Parameters: what can be found together with a motion ---------------------------------------

    def with_parameters(self, values: Mapping[str, float]) -> DiscreteSystem:
        """Return the same system with other values of some parameters."""
        raise NotImplementedError(f"{type(self).__name__} has no parameters: implement `with_parameters`.")

    def with_parameters_near(self, values: Mapping[str, float]) -> DiscreteSystem:
        """Return the same for values that are off by a little, for differences: as if all of them were possible."""
        return self.with_parameters(values)

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array:
        """Return the derivatives (n, ndx, len(names)) of steps from `start` on along x (n+1, nx), u (n, nu)."""
        raise NotImplementedError(f"{type(self).__name__} has no parameters: implement `differentiate_by`.")

    def curvature_by_parameters(
        self,
        x: Array,  # noqa: ARG002 - overridden, all of them
        u: Array,  # noqa: ARG002
        z: Array,  # noqa: ARG002
        names: Sequence[str],  # noqa: ARG002
        start: int = 0,  # noqa: ARG002
    ) -> Array | None:
        """Return second derivatives of steps by some parameters and ``(x, u, these parameters)``, weighted with z.

        Of steps as in `curvature_by_final_time`: arrays (n+1, nx), (n, nu), (n, nx) of steps from `start` on, the
        result (n, P, ndx + nu + P). None where the system has none, as here: they are differences then.
        """
        return None

    def curvature_by_final_time(self, x: Array, u: Array, z: Array, start: int = 0) -> Array | None:  # noqa: ARG002
        """Return the second derivatives (n, ndx + nu + 1, ndx + nu + 1) of ``z[k] . f`` by (x, u, the final time).

        Of the same steps as `differentiate_by`, z (n, nx). None where the system has no such derivatives.
        """
        return None

    def linearize_by(
        self, x: Array, u: Array, names: Sequence[str], out: Linearization | None = None
    ) -> tuple[Linearization, Array]:
        """Return the linearization along a trajectory, and the derivatives (N, ndx, P) of its steps by parameters.

        ``out``: as of `linearize`.
        """
        found = linearized(self, x, u, out)
        return found, self.differentiate_by(x, u, names) if names else np.empty((self.N, self.ndx, 0))

    def time(self, k: int) -> float:
        """Return the time of instant k; its index, of a system that knows no time."""
        return float(k)

    @property
    def times(self) -> Array:
        """Times of all instants (N+1,) (s)."""
        return np.array([self.time(k) for k in range(self.N + 1)], dtype=np.float64)

    def span(self, *, of_state: bool) -> tuple[int, int]:
        """Return the first and the last instant of states, or step of inputs."""
        return 0, self.N if of_state else self.N - 1

    def instant(self, t: float, what: str) -> int:
        """Return the index of a time.

        Raises
        ------
        ArgumentError
            If it is none of the system's.
        """
        times = self.times
        k = int(np.argmin(np.abs(times - t)))
        if abs(times[k] - t) > 1e-6 * (times[-1] - times[0]) / self.N:
            raise ArgumentError(
                f"{what}: got the time {t:.6g}, expected one of the system's; {times[k]:.6g} is the next"
            )
        return k

    def linearize(self, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
        """Return the derivatives of every step along ``x`` (N+1, nx), ``u`` (N, nu).

        ``(x, u)`` need not be a trajectory: A, B are derivatives of f at ``(x[k], u[k])``.

        Parameters
        ----------
        x, u : ndarray (N+1, nx), (N, nu)
        out : Linearization, optional
            An earlier result of this system that is not needed any more: its memory is used again.
        """
        if out is None:
            N, ndx, nu = self.N, self.ndx, self.nu
            A, B = np.empty((N, ndx, ndx)), np.empty((N, ndx, nu))
        else:
            A, B = out
        x, u = read_only(x.copy()), read_only(u.copy())
        for k in range(self.N):
            found: Any = self.derivatives(x[k], u[k], k)
            try:
                A[k], B[k] = found
            except (TypeError, ValueError, OverflowError):
                got = " and ".join(map(_shown, found)) if isinstance(found, tuple) else _shown(found)
                raise ArgumentError(
                    f"{type(self).__name__}.derivatives: got {got} for step {k}, expected a pair (A, B) of shapes "
                    f"{A.shape[1:]} and {B.shape[1:]}"
                ) from None
        return Linearization(A, B, partial(_second, self, x, u))

    def step_each(self, x: Array, u: Array) -> Rollout:
        """Make every step of a curve x (N+1, nx), u (N, nu) from its own state, whatever the next one is.

        Returns
        -------
        Rollout
            `x` (steps_done, nx) is where the steps lead to, up to the first that fails.
        """
        ends = np.empty((self.N, self.nx))
        states, inputs = read_only(x), read_only(u)
        for k in range(self.N):
            failure = self._make_step(states[k], inputs[k], k, ends[k])
            if failure is not None:
                return Rollout(ends[:k], u[:k], k, failure)
        return Rollout(ends, u, self.N)

    def linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization:  # noqa: ARG002 - overridden
        """Return the derivatives of every step of a curve, of which `ends` (N, nx) are known: as of `step_each`."""
        x, u = x.copy(), u.copy()
        nothing = np.zeros((1, self.ndx))

        def second(z: Array) -> Array:
            return DiscreteSystem.curvatures(self, x, u, np.concatenate([nothing, z]))

        A, B = DiscreteSystem.linearize(self, x, u)
        return Linearization(A, B, second)

    def curvatures(self, x: Array, u: Array, z: Array) -> Array:
        """Return ``z[k+1] . D2f`` of every step, (N, ndx+nu, ndx+nu).

        The second order of `linearize`, unless that brings one of its own.

        Parameters
        ----------
        x, u : ndarray (N+1, nx), (N, nu)
            Trajectory.
        z : ndarray (N+1, ndx)
            Adjoint; step k is weighted with ``z[k+1]``.
        """
        n = self.ndx + self.nu
        H = np.empty((self.N, n, n))
        x, u, z = read_only(x), read_only(u), read_only(z)
        for k in range(self.N):
            H[k] = self.curvature(x[k], u[k], k, z[k + 1])
        return H


def given_start(system: DiscreteSystem, initial: Any) -> tuple[Array, Array]:
    """Return what was given to start from, or complain: x (N+1, nx) or an initial state (nx,), and u (N, nu).

    Copies, which nobody can write to.
    """
    x, u = pair_of(initial)
    space = system.charts()
    N, nx, nu = system.N, system.nx, system.nu
    states = as_array(x, "initial x", (N + 1, nx), (nx,), meaning="(N+1, nx) or an initial state (nx,)")
    inputs = as_array(u, "initial u", (N, nu), meaning="(N, nu)")
    if space is not None:
        space.check(states, "initial x")
    return read_only(copied(states)), read_only(copied(inputs))


def told_of(system: DiscreteSystem) -> dict[str, Any]:
    """Return what a result says of its system, by the names of its fields."""
    names = {"state_names": system.state_names, "input_names": system.input_names}
    return {"t": system.times, "system": system.told(), **names}


def check_window(start: int, stop: int, N: int) -> None:
    """Complain about steps ``start .. stop-1`` that are none of a horizon of N."""
    if not 0 <= start < stop <= N:
        raise ArgumentError(
            f"window: got the steps {start} to {stop}, expected at least one step within those of the horizon, 0 to {N}"
        )


def _shown(given: object) -> str:
    """Return the shape of what a user's function returned, for a message; its type where it has none."""
    shape = None if given is None else shape_of(given)
    return type(given).__name__ if shape is None else f"shape {shape}"


def _second(system: DiscreteSystem, x: Array, u: Array, z: Array) -> Array:
    """Return the second order of a `Linearization`; z (N, nx), where an adjoint has a row more."""
    return system.curvatures(x, u, np.concatenate([np.zeros((1, system.ndx)), z]))


def linearized(system: DiscreteSystem, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
    """Return `DiscreteSystem.linearize`, complete: where it brings no second order, the system's `curvatures`."""
    found: Any = system.linearize(x, u, out)  # a user's may be a bare pair
    if isinstance(found, Linearization) and found.second is not None:
        return found
    A, B = found
    return Linearization(A, B, partial(_second, system, x, u))


OVER_STEPS = frozenset(
    {
        "f", "derivatives", "curvature", "rollout", "step_each", "linearize", "linearize_each", "curvatures",
        "linearize_by", "differentiate_by", "curvature_by_parameters", "curvature_by_final_time", "window", "when",
        "time", "times", "span", "instant", "quantity", "parameters", "with_parameters", "with_parameters_near",
        "resolved_rates", "told", "motion", "doubts", "dataset",
    }
)  # fmt: skip
"""What a system is asked of its steps and instants: a system around another one has others, and answers itself."""


def _forwarded(name: str) -> Any:
    if isinstance(getattr(DiscreteSystem, name), (property, cached_property)) or not callable(
        getattr(DiscreteSystem, name)
    ):
        return property(
            lambda self: getattr(self.system, name), doc=f"That of the system: see `DiscreteSystem.{name}`."
        )

    def forward(self: Any, *arguments: Any, **options: Any) -> Any:
        return getattr(self.system, name)(*arguments, **options)

    forward.__name__, forward.__doc__ = name, f"Return what the system does: see `DiscreteSystem.{name}`."
    return forward


class SystemAround(DiscreteSystem):
    """A system around another one of the same states and inputs: the base of those that change its steps only.

    All that the interface asks of states and inputs is the other system's answer, whatever a user's has of its own, and
    so is what is no part of the interface. Only what is in `OVER_STEPS` a subclass answers itself, or as any system.

    ``system``: the other one.
    """

    def __init__(self, system: DiscreteSystem) -> None:
        self.system = system
        self.nx, self.nu, self.has_curvature = system.nx, system.nu, system.has_curvature

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "system":  # as while it is unpickled
            raise AttributeError(name)
        return getattr(self.system, name)


for _name in dir(DiscreteSystem):
    if not _name.startswith("_") and _name not in OVER_STEPS | {"nx", "nu", "N", "has_curvature"}:
        setattr(SystemAround, _name, _forwarded(_name))


@public
class WindowSystem(SystemAround):
    """The steps ``start .. stop-1`` of a system, as a system of their own; as fit for several threads as that is.

    Parameters
    ----------
    system : DiscreteSystem
    start, stop : int
        First step, and one past the last.

    Raises
    ------
    ArgumentError
        For a window that is empty, or not within the horizon.
    """

    def __init__(self, system: DiscreteSystem, start: int, stop: int) -> None:
        check_window(start, stop, system.N)
        super().__init__(system)
        self.start, self.N = start, stop - start

    # ---- Steps ------------------------------------------------------------------------------------

    def f(self, x: Array, u: Array, k: int) -> Array:
        return self.system.f(x, u, self.start + k)

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        return self.system.derivatives(x, u, self.start + k)

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        return self.system.curvature(x, u, self.start + k, z)

    def rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        first, last = self.start + start, self.start + stop
        rows = slice(first, last)
        # The system takes rows of its whole horizon; only those of the window are read.
        N = self.system.N
        whole_x, whole_u, whole_K = (np.empty((N + 1, self.nx)), np.empty((N, self.nu)), np.empty((N, *K.shape[1:])))
        whole_x[first : last + 1] = xbar[start : stop + 1]
        whole_u[rows], whole_K[rows] = ubar[start:stop], K[start:stop]
        return self.system.rollout(x0, whole_x, whole_u, whole_K, first, last)

    def linearize(self, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
        """Return the derivatives of every step; of a system with a way of its own, by that, over its whole horizon."""
        system = self.system
        if type(system).linearize is DiscreteSystem.linearize:
            return super().linearize(x, u, out)
        part, after = slice(self.start, self.start + self.N), system.N - self.start - self.N
        whole_x = np.concatenate([np.repeat(x[:1], self.start, axis=0), x, np.repeat(x[-1:], after, axis=0)])
        whole_u = np.concatenate([np.repeat(u[:1], self.start, axis=0), u, np.repeat(u[-1:], after, axis=0)])
        found: Any = system.linearize(whole_x, whole_u)  # a user's may be a bare pair
        A, B = found
        second = found.second if isinstance(found, Linearization) else None

        def bent(z: Array) -> Array:
            assert second is not None
            weights = np.zeros((system.N, z.shape[1]))
            weights[part] = z
            return np.asarray(second(weights)[part])

        return Linearization(A[part], B[part], None if second is None else bent)

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array:
        return self.system.differentiate_by(x, u, names, self.start + start)

    def curvature_by_parameters(
        self, x: Array, u: Array, z: Array, names: Sequence[str], start: int = 0
    ) -> Array | None:
        return self.system.curvature_by_parameters(x, u, z, names, self.start + start)

    # ---- What it is asked -------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:
        """Those of the system, but for its final time: a window ends where it does."""
        return {name: value for name, value in self.system.parameters.items() if name != FINAL_TIME}

    def with_parameters(self, values: Mapping[str, float]) -> DiscreteSystem:
        return WindowSystem(self.system.with_parameters(values), self.start, self.start + self.N)

    def with_parameters_near(self, values: Mapping[str, float]) -> DiscreteSystem:
        return WindowSystem(self.system.with_parameters_near(values), self.start, self.start + self.N)

    def when(self, k: int) -> str:
        return self.system.when(self.start + k)

    def time(self, k: int) -> float:
        return self.system.time(self.start + k)

    def told(self) -> System | None:
        whole = self.system.told()
        return whole.window(self.start, self.start + self.N) if isinstance(whole, DiscreteSystem) else None

    def quantity(self, kind: str) -> Quantity:
        whole = self.system.quantity(kind)
        return whole if isinstance(whole, Entries) else Later(whole, self.start)

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        found = self.system.resolved_rates()
        return None if found is None else (found[0], found[1][self.start : self.start + self.N])
