"""Some steps of a system as a system of their own, and how a system around another one forwards what it is asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.system import FINAL_TIME, DiscreteSystem, Rollout, check_window
from leastaction.optimal.quantity import Entries, Later, Quantity
from leastaction.optimal.system import Linearization, System

OVER_STEPS = frozenset(
    {
        "f", "derivatives", "curvature", "rollout", "step_each", "linearize", "linearize_each", "curvatures",
        "linearize_by", "differentiate_by", "curvature_by_parameters", "curvature_by_final_time", "window", "when",
        "time", "times", "span", "instant", "quantity", "parameters", "with_parameters", "with_parameters_near",
        "resolved_rates", "told", "motion", "dataset",
    }
)  # fmt: skip
"""What a system is asked of its steps and instants: a system around another one has others, and answers itself."""


def _forwarded(name: str) -> Any:
    if isinstance(getattr(DiscreteSystem, name), (property, cached_property)) or not callable(
        getattr(DiscreteSystem, name)
    ):
        return property(lambda self: getattr(self.system, name))

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
