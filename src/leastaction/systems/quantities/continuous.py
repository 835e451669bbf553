"""What can be limited of a mechanism in continuous time, by the names of its description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.mechanism.arguments import of_unit_length
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Entries, Quantity, Samples
from leastaction.optimal.space import bent_by_numbers, by_numbers
from leastaction.systems.quantities.scaled import Scaled
from leastaction.systems.state_space import space_of_states

KINDS = ("input", "variable", "rate", "acceleration", "multiplier", "tension", "state")


def points_of(m: Mechanism, x: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    """Return q, v, inputs and accelerations of the kinematic variables, of states (n, nx) and inputs (n, nu).

    Quaternions are of unit length, whatever that of their numbers in the state.
    """
    parts = (x[:, : m.nq], x[:, m.nq :], u[:, : m.n_inputs], u[:, m.n_inputs :])
    q, v, inputs, rho_a = (np.ascontiguousarray(part) for part in parts)
    return of_unit_length(m, q) if m.tree.rotations else q, v, inputs, rho_a


def quantity_of(dynamics: ContinuousDynamics, kind: str, t: Array) -> Quantity:
    """Return the quantities of a kind at instants t (s).

    Raises `ArgumentError`: an unknown kind.
    """
    m = dynamics.mechanism
    if kind == "input":
        return Entries(m.inputs, range(m.n_inputs), of_state=False)
    if kind == "variable":
        return Entries(m.coordinates, range(m.nq), of_state=True)
    if kind == "rate":
        return Entries(m.variables, range(m.nq, m.nx), of_state=True, kind="rate of")
    if kind == "state":
        names = (*m.coordinates, *(f"v_{name}" for name in m.variables))
        return Entries(names, range(m.nx), of_state=True)
    if kind == "acceleration":
        return Solved(dynamics, t, Scaled.plain(m.variables, np.arange(m.nv)), kind="acceleration of")
    if kind == "multiplier":
        return Solved(dynamics, t, Scaled.plain(m.constraints, m.nv + np.arange(m.nc)), kind="multiplier of")
    if kind == "tension":
        strings = Scaled.tensions(m, -1.0)
        return Solved(dynamics, t, strings._replace(rows=m.nv + strings.rows), kind="tension of", unit="N")
    raise ArgumentError(f"quantity: got {kind!r}, expected one of {', '.join(map(repr, KINDS))}")


class Solved(Quantity):
    """Accelerations and multipliers, which the equations of motion give for state and input; times lengths.

    ``t``: times of the instants (s). ``entries``: those of ``[a; rho_a; lam]``.
    """

    def __init__(self, dynamics: ContinuousDynamics, t: Array, entries: Scaled, *, kind: str, unit: str = "") -> None:
        self.dynamics, self.t, self.entries, self.names = dynamics, t, entries, entries.names
        self.kind, self.unit = kind, unit
        self.space, self.by_entries = space_of_states(dynamics.mechanism), True

    def values(self, at: Samples) -> Array:
        return np.asarray(self._solved(at) * self._factor(at))

    def jacobian(self, at: Samples) -> Array:
        result = self._slopes(at) * self._factor(at)[:, :, None]
        result[:, np.arange(len(self.names)), self.entries.places] += self.entries.slope * self._solved(at)
        return result

    def curvature(self, at: Samples, y: Array) -> Array:
        m, slope = self.dynamics.mechanism, self.entries.slope
        weights = (y * self._factor(at)) @ np.eye(m.nv + m.nc)[self.entries.rows]  # one may be asked for twice
        z_a, z_lam = np.ascontiguousarray(weights[:, : m.nd]), np.ascontiguousarray(weights[:, m.nv :])
        result = np.array(self.dynamics.curvature(*self._points(at), self._times(at), z_a=z_a, z_lam=z_lam))
        if self.space is not None:
            found = self.dynamics.linearize(*self._points(at), self._times(at)).all
            result = bent_by_numbers(self.space, at.x, np.einsum("ka,kai->ki", np.hstack([z_a, z_lam]), found), result)
        if slope.any():
            slopes = self._slopes(at)
            for j, place in enumerate(self.entries.places):
                cross = (slope[j] * y[:, j])[:, None] * slopes[:, j]
                result[:, place, :] += cross
                result[:, :, place] += cross
        return result

    def joined(self, others: Sequence[Quantity]) -> Solved:
        return self._of(Scaled.joined([part.entries for part in self.among(others)]))

    def own_select(self, rows: Sequence[int]) -> Quantity:
        """Return some of them; of prescribed variables their accelerations are inputs."""
        m, chosen = self.dynamics.mechanism, self.entries.select(rows)
        if ((m.nd <= chosen.rows) & (chosen.rows < m.nv)).all():
            return Entries(chosen.names, m.n_inputs + chosen.rows - m.nd, of_state=False, kind=self.kind)
        return self._of(chosen)

    def _of(self, entries: Scaled) -> Solved:
        return Solved(self.dynamics, self.t, entries, kind=self.kind, unit=self.unit)

    def _points(self, at: Samples) -> tuple[Array, Array, Array, Array]:
        return points_of(self.dynamics.mechanism, at.x, at.u)

    def _times(self, at: Samples) -> Array:
        return np.asarray(self.t[at.k])

    def _factor(self, at: Samples) -> Array:
        return self.entries.factor(at.x[:, self.entries.places])

    def _solved(self, at: Samples) -> Array:
        points = self._points(at)
        found = self.dynamics.accelerations(*points, self._times(at))
        nd = self.dynamics.mechanism.nd
        return np.hstack([found.a[:, :nd], points[3], found.lam])[:, self.entries.rows]

    def _slopes(self, at: Samples) -> Array:
        m = self.dynamics.mechanism
        found = self.dynamics.linearize(*self._points(at), self._times(at)).all
        found = by_numbers(self.space, at.x, found)
        whole = np.zeros((len(at.x), m.nv + m.nc, found.shape[2]))
        whole[:, : m.nd], whole[:, m.nv :] = found[:, : m.nd], found[:, m.nd :]
        kinematic = np.arange(m.nrho)
        whole[:, m.nd + kinematic, m.nx + m.n_inputs + kinematic] = 1.0
        return np.asarray(whole[:, self.entries.rows])
