"""What states and trajectories of a mechanism share in either kind of time: everything in them is found by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np

from leastaction.errors import ArgumentError, brief, closest, unknown
from leastaction.mechanics.elements.units import rate_of
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.masses import Energy
from leastaction.mechanics.mechanism.queries.units import input_units
from leastaction.mechanics.mechanism.text import text_of
from leastaction.numerics.arrays import Array
from leastaction.numerics.dataset import STEP, TIME, Dataset, Savable
from leastaction.numerics.dataset.plain import plain
from leastaction.numerics.frozen import Frozen


@dataclass(frozen=True)
class BaseState(Frozen, ABC):
    """State of a mechanism at an instant. Frozen, arrays included, so that any number of threads may share it.

    Attributes
    ----------
    t : float
        Time (s).
    q : ndarray, shape (nq,)
        Configuration, dynamic variables first (m or rad).
    """

    t: float
    q: Array

    @property
    @abstractmethod
    def x(self) -> Array:
        """The state vector, shape (nx,)."""


S_co = TypeVar("S_co", bound=BaseState, covariant=True)


@dataclass(frozen=True)
class BaseTrajectory(Frozen, Savable, ABC, Generic[S_co]):
    """A motion of a mechanism at ``N + 1`` instants. Frozen, arrays included: any number of threads may share it.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray, shape (N+1,)
        Times (s).
    q : ndarray, shape (N+1, nq)
        Configurations (m or rad).
    inputs : ndarray, shape (N, n_inputs) or (N+1, n_inputs)
        Force inputs, of every step or at every instant.
    lam : ndarray, shape (N, nc) or (N+1, nc)
        Multipliers, likewise.
    """

    mechanism: Mechanism = field(repr=False, metadata={"recorded": False})
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    inputs: Array = field(repr=False)
    lam: Array = field(repr=False)

    @property
    def steps(self) -> int:
        """Number of intervals N between instants."""
        return len(self.t) - 1

    @property
    def rho(self) -> Array:
        """Kinematic variables, shape (N+1, nrho); of rotations that are quaternions these, one column more."""
        return self.q[:, self.mechanism.first_rho :]

    @property
    @abstractmethod
    def x(self) -> Array:
        """State vectors, shape (N+1, nx)."""

    @property
    @abstractmethod
    def u(self) -> Array:
        """Input vectors of the system, those of the kinematic variables included."""

    @abstractmethod
    def state(self, k: int) -> S_co:
        """Return the state at instant k."""

    @property
    def last(self) -> S_co:
        """The last state, to go on from."""
        return self.state(self.steps)

    @abstractmethod
    def energy(self) -> Energy:
        """Return the energy along the motion (J)."""

    @property
    @abstractmethod
    def state_units(self) -> tuple[str, ...]:
        """Units of the entries of the state vector."""

    @property
    @abstractmethod
    def multiplier_units(self) -> tuple[str, ...]:
        """Units of the multipliers: of forces, or in discrete time of impulses."""

    @property
    def units(self) -> Mapping[str, str]:
        """The unit of each variable, input and multiplier by name; "" where none is known (see `Mechanism.units`)."""
        m = self.mechanism
        multipliers = dict(zip(m.constraints, self.multiplier_units, strict=True))
        units = m.units
        names = dict.fromkeys((*m.inputs, *m.variables, *m.coordinates))
        return MappingProxyType({**multipliers, **{name: units.get(name, "1") for name in names}})

    def __getitem__(self, name: str) -> Array:
        """Return a variable, an input or a multiplier over time by name, or the places (N+1, 3) of a frame (m)."""
        m = self.mechanism
        if not isinstance(name, str):
            raise ArgumentError(f"name: got {brief(repr(name))}, expected the name of a variable, an input or a frame")
        for names, values in ((m.coordinates, self.q), (m.inputs, self.inputs), (m.constraints, self.lam)):
            if name in names:
                return values[:, names.index(name)]
        if name in m.tree.index:
            return np.asarray(m.positions(self.q, (name,)))[:, 0]
        known = m.coordinates + m.inputs + m.constraints + m.frames
        what = "variables, inputs, constraints and frames"
        raise ArgumentError(f"unknown name {name!r}; {closest(name, known, what=what)}")

    def dataset(self) -> Dataset:
        """Return all of the motion as plain data, but for functions: what is between the instants, and laws."""
        m = self.mechanism
        arrays: dict[str, Any] = {}
        content = plain(self, arrays)
        named = named_arrays(m, self.state_units, len(self.inputs) == len(self.t), self.multiplier_units)
        kept = {name: about for name, about in named.items() if name in arrays}
        return Dataset(
            kind=type(self).__name__,
            t=self.t,
            arrays=arrays,
            dims={"t": (TIME,), **{name: (row, dim) for name, (row, dim, _, _) in kept.items()}},
            labels={dim: names for _, dim, names, _ in kept.values()},
            units={"t": "s", **{name: units for name, (_, _, _, units) in kept.items()}},
            content=content,
            model=text_of(m),
        )

    def _velocity(self, name: str, q: Array, v: Array) -> Array:
        """Return the velocity of a variable (N,), or of a frame (N, 6), at given instants (N, nq)."""
        m = self.mechanism
        if not isinstance(name, str):
            raise ArgumentError(f"name: got {brief(repr(name))}, expected the name of a variable or a frame")
        if name not in m.variables and name in m.tree.index:
            return np.asarray(m.frame_velocity(q, v, name))
        return v[:, self._variable(name)]

    def _variable(self, name: str) -> int:
        """Return the index of a variable by name."""
        m = self.mechanism
        if name not in m.variables:
            raise unknown("variable", name, m.variables)
        return m.variables.index(name)


def named_arrays(
    m: Mechanism, state_units: tuple[str, ...], is_continuous: bool, multiplier_units: tuple[str, ...]
) -> dict[str, tuple[str, str, tuple[str, ...], tuple[str, ...]]]:
    """Return rows, columns, names of columns and their units, of the arrays of a trajectory by their names."""
    row, units, rates = TIME if is_continuous else STEP, m.units, state_units[m.nq :]
    accelerations = tuple(rate_of(units[name], 2) for name in m.variables)
    return {
        "q": (TIME, "coordinate" if m.tree.rotations else "variable", m.coordinates, state_units[: m.nq]),
        "p": (TIME, "momentum", tuple(f"p_{name}" for name in m.dynamic), rates[: m.nd]),
        "v_rho": (TIME, "rate", tuple(f"v_{name}" for name in m.kinematic), rates[m.nd :]),
        "v": (TIME, "velocity", tuple(f"v_{name}" for name in m.variables), rates),
        "a": (TIME, "acceleration", tuple(f"a_{name}" for name in m.variables), accelerations),
        "inputs": (row, "input", m.inputs, input_units(m)),
        "lam": (row, "constraint", m.constraints, multiplier_units),
    }
