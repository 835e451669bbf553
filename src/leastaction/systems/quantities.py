"""What can be limited of a mechanism in discrete time, by the names of its description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples

__all__ = ["KINDS", "Accelerations", "Rates", "Tensions", "quantity_of"]

KINDS = ("input", "variable", "rate", "acceleration", "momentum", "multiplier", "tension", "state")


def quantity_of(mechanism: Mechanism, kind: str, t: Array, *, multipliers: bool) -> Quantity:
    """Return the quantities of a kind.

    Raises
    ------
    ArgumentError
        An unknown kind, or multipliers where they are no part of the state.
    """
    m = mechanism
    if kind in ("multiplier", "tension") and not multipliers:
        raise ArgumentError(
            f"{kind}: the multipliers are no part of this system's state; make it as MidpointSystem(integrator, t, "
            "multipliers=True), with a cost for its larger state"
        )
    if kind == "input":
        return Entries(m.inputs, range(m.n_inputs), of_state=False)
    if kind == "variable":
        return Entries(m.variables, range(m.nq), of_state=True)
    if kind == "momentum":
        return Entries(m.dynamic, range(m.nq, m.nq + m.nd), of_state=True, kind="momentum of")
    if kind == "multiplier":
        return Entries(m.constraints, range(m.nx, m.nx + m.nc), of_state=True, kind="multiplier of")
    if kind == "state":
        names = (*m.variables, *(f"p_{name}" for name in m.dynamic), *(f"v_{name}" for name in m.kinematic))
        if multipliers:
            names += tuple(f"lam_{name}" for name in m.constraints)
        return Entries(names, range(len(names)), of_state=True)
    dt = np.diff(t)
    if kind == "rate":
        return Rates(m.variables, np.arange(m.nq), dt)
    if kind == "acceleration":
        return Accelerations(m, np.arange(m.nrho), dt)
    if kind == "tension":
        return Tensions.of(m, dt)
    raise ArgumentError(f"quantity: got {kind!r}, expected one of {', '.join(map(repr, KINDS))}")


class Rates(Quantity):
    """Mean rates of variables over steps, ``(q_{k+1} - q_k) / dt``."""

    kind = "rate of"
    looks_ahead = True

    def __init__(self, names: Sequence[str], columns: Instants, dt: Array) -> None:
        self.names, self.columns, self.dt = tuple(names), columns, dt

    def values(self, at: Samples) -> Array:
        """Return the rates."""
        return np.asarray((at.x_next[:, self.columns] - at.x[:, self.columns]) / self.dt[at.k, None])

    def jacobian(self, at: Samples) -> Array:
        """Return the constant derivatives."""
        nx, rows = at.x.shape[1], np.arange(len(self.columns))
        result = np.zeros((len(at.k), len(rows), 2 * nx + at.u.shape[1]))
        result[:, rows, self.columns] = -1.0 / self.dt[at.k, None]
        result[:, rows, nx + at.u.shape[1] + self.columns] = 1.0 / self.dt[at.k, None]
        return result

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""

    def select(self, rows: Sequence[int]) -> Rates:
        """Return the rates of some of the variables."""
        return Rates([self.names[row] for row in rows], self.columns[list(rows)], self.dt)


class Accelerations(Quantity):
    """Accelerations of kinematic variables over steps, ``((rho_next - rho) / dt - v_rho) / dt``."""

    kind = "acceleration of"

    def __init__(self, mechanism: Mechanism, which: Instants, dt: Array) -> None:
        m = mechanism
        self.mechanism, self.which, self.dt = m, which, dt
        self.names = tuple(m.kinematic[i] for i in which)

    def values(self, at: Samples) -> Array:
        """Return the accelerations."""
        m, dt = self.mechanism, self.dt[at.k, None]
        rate = (at.u[:, m.n_inputs + self.which] - at.x[:, m.nd + self.which]) / dt
        return np.asarray((rate - at.x[:, m.nq + m.nd + self.which]) / dt)

    def jacobian(self, at: Samples) -> Array:
        """Return the constant derivatives."""
        m, nx, rows, dt = self.mechanism, at.x.shape[1], np.arange(len(self.which)), self.dt[at.k, None]
        result = np.zeros((len(at.k), len(rows), nx + at.u.shape[1]))
        result[:, rows, m.nd + self.which] = -1.0 / dt**2
        result[:, rows, m.nq + m.nd + self.which] = -1.0 / dt
        result[:, rows, nx + m.n_inputs + self.which] = 1.0 / dt**2
        return result

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""

    def select(self, rows: Sequence[int]) -> Accelerations:
        """Return the accelerations of some of the variables."""
        return Accelerations(self.mechanism, self.which[list(rows)], self.dt)


class Tensions(Quantity):
    """Tensions of strings over steps (N), as `Trajectory.tensions` tells them.

    ``lam_{k+1} (constant + slope L_k) / dt`` with the length L at the start of the step, where it is a variable.

    Parameters
    ----------
    names : sequence of str
    lam, length : ndarray of int (m,)
        Places in the state; where no variable is the length, any place with a slope of zero.
    constant, slope : ndarray (m,)
    dt : ndarray (N,)
    """

    looks_ahead = True
    kind, unit = "tension of", "N"

    def __init__(
        self, names: Sequence[str], lam: Instants, length: Instants, constant: Array, slope: Array, dt: Array
    ) -> None:
        self.names, self.dt = tuple(names), dt
        self._lam, self._length, self._constant, self._slope = lam, length, constant, slope

    @classmethod
    def of(cls, mechanism: Mechanism, dt: Array) -> Tensions:
        """Return those of all strings."""
        m, one = mechanism, np.ones(1)
        found = []
        for row, name in enumerate(m.constraints):
            element = m.elements.get(name)
            at = [
                None if element is None else element.tension(one, one, dict.fromkeys(m.variables, length))
                for length in (0.0 * one, one)
            ]
            if at[0] is None or at[1] is None:
                continue
            constant = float(at[0][0])
            variable = getattr(element, "length_variable", None)
            place = m.variables.index(variable) if variable is not None else 0
            found.append((name, m.nx + row, place, constant, float(at[1][0]) - constant))
        names, lam, length, constants, slopes = zip(*found, strict=True) if found else ((), (), (), (), ())
        whole = (np.array(lam, dtype=np.intp), np.array(length, dtype=np.intp))
        return cls(names, *whole, np.array(constants), np.array(slopes), dt)

    def values(self, at: Samples) -> Array:
        """Return the tensions."""
        return np.asarray(at.x_next[:, self._lam] * self._factor(at) / self.dt[at.k, None])

    def jacobian(self, at: Samples) -> Array:
        """Return the first derivatives."""
        nx, rows, dt = at.x.shape[1], np.arange(len(self.names)), self.dt[at.k, None]
        ahead = nx + at.u.shape[1]
        result = np.zeros((len(at.k), len(rows), ahead + nx))
        result[:, rows, self._length] = self._slope * at.x_next[:, self._lam] / dt
        result[:, rows, ahead + self._lam] = self._factor(at) / dt
        return result

    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivative, of products of a multiplier and a length."""
        if not self._slope.any():
            return None
        nx = at.x.shape[1]
        ahead = nx + at.u.shape[1]
        result = np.zeros((len(at.k), ahead + nx, ahead + nx))
        mixed = y * self._slope / self.dt[at.k, None]
        for j, (length, lam) in enumerate(zip(self._length, ahead + self._lam, strict=True)):
            result[:, length, lam] += mixed[:, j]
            result[:, lam, length] += mixed[:, j]
        return result

    def select(self, rows: Sequence[int]) -> Tensions:
        """Return the tensions of some of the strings."""
        i = list(rows)
        names = [self.names[row] for row in rows]
        return Tensions(names, self._lam[i], self._length[i], self._constant[i], self._slope[i], self.dt)

    @property
    def sign(self) -> Entries:
        """The multipliers, which have the signs of the tensions while lengths are positive."""
        return Entries(self.names, self._lam, of_state=True, kind="tension of")

    def _factor(self, at: Samples) -> Array:
        return np.asarray(self._constant + self._slope * at.x[:, self._length])
