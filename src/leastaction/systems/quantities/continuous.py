"""What can be limited of a mechanism in continuous time, by the names of its description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples, names_of
from leastaction.systems.quantities.strings import Strings

KINDS = ("input", "variable", "rate", "acceleration", "multiplier", "tension", "state")


def points_of(m: Mechanism, x: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    """Return q, v, inputs and accelerations of the kinematic variables, of states (n, nx) and inputs (n, nu)."""
    parts = (x[:, : m.nq], x[:, m.nq :], u[:, : m.n_inputs], u[:, m.n_inputs :])
    q, v, inputs, rho_a = (np.ascontiguousarray(part) for part in parts)
    return q, v, inputs, rho_a


def quantity_of(dynamics: ContinuousDynamics, kind: str, t: Array) -> Quantity:
    """Return the quantities of a kind at instants t (s).

    Raises
    ------
    ArgumentError
        An unknown kind.
    """
    m = dynamics.mechanism
    if kind == "input":
        return Entries(m.inputs, range(m.n_inputs), of_state=False)
    if kind == "variable":
        return Entries(m.variables, range(m.nq), of_state=True)
    if kind == "rate":
        return Entries(m.variables, range(m.nq, 2 * m.nq), of_state=True, kind="rate of")
    if kind == "state":
        names = (*m.variables, *(f"v_{name}" for name in m.variables))
        return Entries(names, range(2 * m.nq), of_state=True)
    if kind == "acceleration":
        return Solved(dynamics, t, m.variables, np.arange(m.nq), kind="acceleration of")
    if kind == "multiplier":
        return Solved(dynamics, t, m.constraints, m.nq + np.arange(m.nc), kind="multiplier of")
    if kind == "tension":
        return _tensions(dynamics, t)
    raise ArgumentError(f"quantity: got {kind!r}, expected one of {', '.join(map(repr, KINDS))}")


def _tensions(dynamics: ContinuousDynamics, t: Array) -> Solved:
    strings = Strings.of(dynamics.mechanism, -1.0)
    return Solved(
        dynamics, t, strings.names, dynamics.mechanism.nq + strings.rows, kind="tension of", unit="N",
        constant=strings.constant, slope=strings.slope, places=strings.lengths,
    )  # fmt: skip


class Solved(Quantity):
    """Accelerations and multipliers, which the equations of motion give for state and input; times lengths.

    ``t``: times of the instants (s). ``rows`` (m,): places in ``[a; rho_a; lam]``. ``constant``, ``slope``, ``places``
    (m,): each is multiplied with ``constant + slope q[place]``.
    """

    def __init__(
        self, dynamics: ContinuousDynamics, t: Array, names: Sequence[str], rows: Instants, *, kind: str,
        unit: str = "", constant: Array | None = None, slope: Array | None = None, places: Instants | None = None,
    ) -> None:  # fmt: skip
        self.dynamics, self.t, self.names, self.rows = dynamics, t, tuple(names), rows
        self.kind, self.unit = kind, unit
        self.constant = np.ones(len(rows)) if constant is None else constant
        self.slope = np.zeros(len(rows)) if slope is None else slope
        self.places = np.zeros(len(rows), dtype=np.intp) if places is None else places

    def values(self, at: Samples) -> Array:
        return np.asarray(self._solved(at) * self._factor(at))

    def jacobian(self, at: Samples) -> Array:
        result = self._slopes(at) * self._factor(at)[:, :, None]
        result[:, np.arange(len(self.rows)), self.places] += self.slope * self._solved(at)
        return result

    def curvature(self, at: Samples, y: Array) -> Array:
        m = self.dynamics.mechanism
        weights = (y * self._factor(at)) @ np.eye(m.nq + m.nc)[self.rows]  # one may be asked for twice
        z_a, z_lam = np.ascontiguousarray(weights[:, : m.nd]), np.ascontiguousarray(weights[:, m.nq :])
        result = np.array(self.dynamics.curvature(*self._points(at), self._times(at), z_a=z_a, z_lam=z_lam))
        if self.slope.any():
            slopes = self._slopes(at)
            for j, place in enumerate(self.places):
                cross = (self.slope[j] * y[:, j])[:, None] * slopes[:, j]
                result[:, place, :] += cross
                result[:, :, place] += cross
        return result

    def joined(self, others: Sequence[Quantity]) -> Solved:
        parts = self.among(others)
        each = [(part.rows, part.constant, part.slope, part.places) for part in parts]
        rows, constant, slope, places = (np.concatenate(of_parts) for of_parts in zip(*each, strict=True))
        return Solved(
            self.dynamics, self.t, names_of(parts), rows, kind=self.kind, unit=self.unit,
            constant=constant, slope=slope, places=places,
        )  # fmt: skip

    def select(self, rows: Sequence[int]) -> Quantity:
        """Return some of them; of prescribed variables their accelerations are inputs."""
        m, i = self.dynamics.mechanism, list(rows)
        names, chosen = [self.names[row] for row in i], self.rows[i]
        if ((m.nd <= chosen) & (chosen < m.nq)).all():
            return Entries(names, m.n_inputs + chosen - m.nd, of_state=False, kind=self.kind)
        return Solved(
            self.dynamics, self.t, names, chosen, kind=self.kind, unit=self.unit,
            constant=self.constant[i], slope=self.slope[i], places=self.places[i],
        )  # fmt: skip

    def _points(self, at: Samples) -> tuple[Array, Array, Array, Array]:
        return points_of(self.dynamics.mechanism, at.x, at.u)

    def _times(self, at: Samples) -> Array:
        return np.asarray(self.t[at.k])

    def _factor(self, at: Samples) -> Array:
        return np.asarray(self.constant + self.slope * at.x[:, self.places])

    def _solved(self, at: Samples) -> Array:
        points = self._points(at)
        found = self.dynamics.accelerations(*points, self._times(at))
        nd = self.dynamics.mechanism.nd
        return np.hstack([found.a[:, :nd], points[3], found.lam])[:, self.rows]

    def _slopes(self, at: Samples) -> Array:
        m = self.dynamics.mechanism
        found = self.dynamics.linearize(*self._points(at), self._times(at)).all
        whole = np.zeros((len(at.x), m.nq + m.nc, found.shape[2]))
        whole[:, : m.nd], whole[:, m.nq :] = found[:, : m.nd], found[:, m.nd :]
        kinematic = np.arange(m.nrho)
        whole[:, m.nd + kinematic, 2 * m.nq + m.n_inputs + kinematic] = 1.0
        return np.asarray(whole[:, self.rows])
