"""The discrete system ``x+ = f(x, u, k)``: all that the optimiser knows of what it steers.

Three methods of one step are enough to define a system. Methods over whole trajectories make one step after the other,
unless the system has a faster way (compiled, parallel over time): each asks a method that begins with ``own_`` first.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.pool import kept
from leastaction.numerics.public import public
from leastaction.optimal.discrete import step_by_step
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.initial import pair_of
from leastaction.optimal.looking_back import InputRates
from leastaction.optimal.quantity import Entries, Later, Quantity
from leastaction.optimal.system import FINAL_TIME, Linearization, System, keeps, missing_unless


class DiscreteSystem(System):
    """A discrete system over a horizon of N steps.

    Subclasses set `nx`, `nu` and `N`, and implement what `System` says.
    """

    N: int
    """Number of steps of the horizon."""
    numbered = True
    """Limits may name instants by their index."""

    @abstractmethod
    def f(self, x: Array, u: Array, k: int) -> Array:
        """Return the next state (nx,). A step without solution raises `StepError`."""

    @abstractmethod
    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        """Return ``A = df/dx`` (ndx, ndx) and ``B = df/du`` (ndx, nu) of step k."""

    def own_horizon(self) -> str | None:
        if not hasattr(self, "N"):
            return None
        first, last = self.own_time(0), self.own_time(self.N)
        when = "" if first is None or last is None else f", {first:g} to {last:g} s"
        return f"{self.N} steps{when}"

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
        found = self.own_rollout(x0, xbar, ubar, K, start, stop)
        return step_by_step.rollout(self, x0, xbar, ubar, K, start, stop) if found is None else found

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout | None:
        """Return the same by a faster way; None where there is none."""

    def input_rates(self) -> Quantity:
        return InputRates(self.input_names, range(self.nu), self.times)

    def when(self, k: int) -> str:
        """Return step k in words, for messages."""
        found = self.own_when(k)
        return f"step {k}" if found is None else found

    def own_when(self, k: int) -> str | None:
        """Return the same of a system that knows the time, with the time."""

    def window(self, start: int, stop: int) -> DiscreteSystem:
        """Return the steps ``start .. stop-1`` as a system of their own."""
        found = self.own_window(start, stop)
        return WindowSystem(self, start, stop) if found is None else found

    def own_window(self, start: int, stop: int) -> DiscreteSystem | None:
        """Return the same without the other steps; None of a system that cannot leave them out."""

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        """Return names of quantities "rate", and the largest (N, 1) that the steps of time resolve.

        None where that is not known. `optimize` limits them where a search ends at steps that are too coarse.
        """

    # ---- Parameters: what can be found together with a motion ---------------------------------------

    def with_parameters(self, values: Mapping[str, float]) -> DiscreteSystem | None:
        """Return the same system with other values of some parameters; None of a system without."""

    def with_parameters_near(self, values: Mapping[str, float]) -> DiscreteSystem | None:
        """Return the same for differences, also of values that are not quite possible; None: as `with_parameters`."""

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array | None:
        """Return the derivatives (n, ndx, len(names)) of steps from `start` on along x (n+1, nx), u (n, nu)."""

    def curvature_by_parameters(
        self, x: Array, u: Array, z: Array, names: Sequence[str], start: int = 0
    ) -> Array | None:
        """Return second derivatives of steps by some parameters and ``(x, u, these parameters)``, weighted with z.

        Of steps as in `curvature_by_final_time`: arrays (n+1, nx), (n, nu), (n, nx) of steps from `start` on, the
        result (n, P, ndx + nu + P). None where the system has none: they are differences then.
        """

    def curvature_by_final_time(self, x: Array, u: Array, z: Array, start: int = 0) -> Array | None:
        """Return the second derivatives (n, ndx + nu + 1, ndx + nu + 1) of ``z[k] . f`` by (x, u, the final time).

        Of the same steps as `differentiate_by`, z (n, nx). None where the system has no such derivatives.
        """

    def linearize_by(
        self, x: Array, u: Array, names: Sequence[str], out: Linearization | None = None
    ) -> tuple[Linearization, Array]:
        """Return the linearization along a trajectory, and the derivatives (N, ndx, P) of its steps by parameters.

        ``out``: as of `linearize`.
        """
        found = self.own_linearize_by(x, u, names, out)
        if found is None:
            by = derivatives_by(self, x, u, names) if names else np.empty((self.N, self.ndx, 0))
            found = linearized(self, x, u, out), by
        return found

    def own_linearize_by(
        self, x: Array, u: Array, names: Sequence[str], out: Linearization | None
    ) -> tuple[Linearization, Array] | None:
        """Return both by a faster way; None where there is none."""

    def time(self, k: int) -> float:
        """Return the time of instant k; its index, of a system that knows no time."""
        found = self.own_time(k)
        return float(k) if found is None else found

    def own_time(self, k: int) -> float | None:
        """Return the time of instant k (s), of a system that knows it."""

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
        found = self.own_linearize(x, u, out)
        return step_by_step.linearize(self, x, u, out, self._contracted) if found is None else found

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization | None:
        """Return the same by a faster way; None where there is none."""

    def step_each(self, x: Array, u: Array) -> Rollout:
        """Make every step of a curve x (N+1, nx), u (N, nu) from its own state, whatever the next one is.

        Returns
        -------
        Rollout
            `x` (steps_done, nx) is where the steps lead to, up to the first that fails.
        """
        found = self.own_step_each(x, u)
        return step_by_step.step_each(self, x, u) if found is None else found

    def own_step_each(self, x: Array, u: Array) -> Rollout | None:
        """Return the same by a faster way; None where there is none."""

    def linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization:
        """Return the derivatives of every step of a curve, of which `ends` (N, nx) are known: as of `step_each`."""
        found = self.own_linearize_each(x, u, ends)
        return step_by_step.linearize(self, x, u) if found is None else found

    def own_linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization | None:
        """Return the same by a faster way; None where there is none."""

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
        return step_by_step.curvatures(self, x, u, z[1:])

    def _contracted(self, x: Array, u: Array, z: Array) -> Array:
        """Return the second order of a `Linearization`; z (N, ndx), where an adjoint has a row more."""
        return self.curvatures(x, u, np.concatenate([np.zeros((1, self.ndx)), z]))


def with_parameters(system: DiscreteSystem, values: Mapping[str, float], *, near: bool = False) -> DiscreteSystem:
    """Return `DiscreteSystem.with_parameters`, or `with_parameters_near`; complain where there is none."""
    found = system.with_parameters_near(values) if near else None
    return missing_unless(system.with_parameters(values) if found is None else found, system, "with_parameters")


def derivatives_by(system: DiscreteSystem, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array:
    """Return `DiscreteSystem.differentiate_by`; complain where there is none."""
    return missing_unless(system.differentiate_by(x, u, names, start), system, "differentiate_by")


def given_start(system: DiscreteSystem, initial: Any) -> tuple[Array, Array]:
    """Return what was given to start from, or complain: x (N+1, nx) or an initial state, and u (N, nu) or one of (nu,).

    Copies, which nobody can write to.
    """
    x, u = pair_of(initial)
    space = system.charts()
    N, nx, nu = system.N, system.nx, system.nu
    found = system.own_state(x)
    states = as_array(
        x if found is None else found, "initial x", (N + 1, nx), (nx,), meaning="(N+1, nx) or an initial state (nx,)",
        names=system.state_names,
    )  # fmt: skip
    inputs = as_array(u, "initial u", (N, nu), (nu,), meaning="(N, nu) or a constant (nu,)", names=system.input_names)
    if inputs.ndim == 1:
        inputs = np.tile(inputs, (N, 1))
    if space is not None:
        space.check(states, "initial x")
    return kept(states), kept(inputs)


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


def linearized(system: DiscreteSystem, x: Array, u: Array, out: Linearization | None = None) -> Linearization:
    """Return `DiscreteSystem.linearize`, complete: where it brings no second order, the system's `curvatures`."""
    found: Any = system.linearize(x, u, out)  # a user's may be a bare pair
    if isinstance(found, Linearization) and found.second is not None:
        return found
    A, B = found
    return Linearization(A, B, partial(system._contracted, x, u))


class SystemAround(DiscreteSystem):
    """A system around another one of the same states and inputs: the base of those that have other steps only.

    All that `System` says of states and inputs is the other system's answer, whatever a user's has of its own, but for
    what a subclass says itself; and so is what is no part of the interface. What `DiscreteSystem` says of steps and
    instants a subclass answers itself, or as any system.

    ``system``: the other one.
    """

    def __init__(self, system: DiscreteSystem) -> None:
        self.system = system
        self.nx, self.nu, self.has_curvature = system.nx, system.nu, system.has_curvature

    def __init_subclass__(cls) -> None:
        said = {name for kind in cls.__mro__[: cls.__mro__.index(System)] for name in vars(kind)}
        for name in vars(System):
            if not said & {name, f"own_{name}"} and not name.startswith("_") and name != "has_curvature":
                setattr(cls, name, _forwarded(name))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "system":  # as while it is unpickled
            raise AttributeError(name)
        return getattr(self.system, name)


def _forwarded(name: str) -> Any:
    """Return what asks the other system for an attribute."""
    kind = vars(System)[name]
    if isinstance(kind, (property, cached_property)) or not callable(kind):
        return property(lambda self: getattr(self.system, name), doc=f"That of the system: see `System.{name}`.")

    def forward(self: Any, *arguments: Any, **options: Any) -> Any:
        return getattr(self.system, name)(*arguments, **options)

    forward.__name__, forward.__doc__ = name, f"Return what the system does: see `System.{name}`."
    return forward


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

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array | None:
        return self.system.curvature(x, u, self.start + k, z)

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        first, last = self.start + start, self.start + stop
        rows = slice(first, last)
        # The system takes rows of its whole horizon; only those of the window are read.
        N = self.system.N
        whole_x, whole_u, whole_K = (np.empty((N + 1, self.nx)), np.empty((N, self.nu)), np.empty((N, *K.shape[1:])))
        whole_x[first : last + 1] = xbar[start : stop + 1]
        whole_u[rows], whole_K[rows] = ubar[start:stop], K[start:stop]
        return self.system.rollout(x0, whole_x, whole_u, whole_K, first, last)

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization | None:  # noqa: ARG002
        """Return the derivatives of every step by a way of the system's own, over its whole horizon, if it has one."""
        system = self.system
        if keeps(system, DiscreteSystem, "linearize", "own_linearize"):
            return None
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

    def differentiate_by(self, x: Array, u: Array, names: Sequence[str], start: int = 0) -> Array | None:
        return self.system.differentiate_by(x, u, names, self.start + start)

    def curvature_by_parameters(
        self, x: Array, u: Array, z: Array, names: Sequence[str], start: int = 0
    ) -> Array | None:
        return self.system.curvature_by_parameters(x, u, z, names, self.start + start)

    # ---- Names and quantities -------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:  # type: ignore[override]
        """Those of the system, but for its final time: a window ends where it does."""
        return {name: value for name, value in self.system.parameters.items() if name != FINAL_TIME}

    def with_parameters(self, values: Mapping[str, float]) -> DiscreteSystem:
        return WindowSystem(with_parameters(self.system, values), self.start, self.start + self.N)

    def with_parameters_near(self, values: Mapping[str, float]) -> DiscreteSystem:
        return WindowSystem(with_parameters(self.system, values, near=True), self.start, self.start + self.N)

    def own_when(self, k: int) -> str:
        return self.system.when(self.start + k)

    def own_time(self, k: int) -> float:
        return self.system.time(self.start + k)

    def told(self) -> System | None:
        whole = self.system.told()
        return whole.window(self.start, self.start + self.N) if isinstance(whole, DiscreteSystem) else None

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:  # noqa: ARG002 - time goes in steps
        whole = self.system.quantity(kind)
        return whole if isinstance(whole, Entries) else Later(whole, self.start)

    def resolved_rates(self) -> tuple[tuple[str, ...], Array] | None:
        found = self.system.resolved_rates()
        return None if found is None else (found[0], found[1][self.start : self.start + self.N])
