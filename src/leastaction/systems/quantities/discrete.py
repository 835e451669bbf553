"""What can be limited of a mechanism in discrete time, by the names of its description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.discrete.prescribed import places_of
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal.looking_back import TURN, InputRates, LookingBack, Need, Recalled
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples
from leastaction.systems.quantities.rates import Rates
from leastaction.systems.quantities.scaled import Scaled

KINDS = ("input", "variable", "rate", "acceleration", "momentum", "multiplier", "tension", "state", "input rate")

ACROSS = "acceleration across"
"""Of any variables, from the step before to a step: asked for where "acceleration" does not know the names."""


def quantity_of(mechanism: Mechanism, kind: str, t: Array, *, multipliers: bool) -> Quantity:
    """Return the quantities of a kind.

    Raises `ArgumentError`: an unknown kind, or multipliers where they are no part of the state.
    """
    m = mechanism
    if kind in ("multiplier", "tension") and not multipliers:
        raise ArgumentError(
            f"{kind}: the multipliers are no part of this system's state; make it as MidpointSystem(integrator, t, "
            "multipliers=True), with a cost for its larger state"
        )
    if kind == "input":
        return Entries(m.inputs, range(m.n_inputs), of_state=False)
    if kind == "input rate":
        return InputRates(m.inputs, range(m.n_inputs), t)
    if kind == "variable":
        return Entries(m.coordinates, range(m.nq), of_state=True)
    if kind == "momentum":
        return Entries(m.dynamic, range(m.nq, m.nq + m.nd), of_state=True, kind="momentum of")
    if kind == "multiplier":
        return Entries(m.constraints, range(m.nx, m.nx + m.nc), of_state=True, kind="multiplier of")
    if kind == "state":
        names = (*m.coordinates, *(f"p_{name}" for name in m.dynamic), *(f"v_{name}" for name in m.kinematic))
        if multipliers:
            names += tuple(f"lam_{name}" for name in m.constraints)
        return Entries(names, range(len(names)), of_state=True)
    dt = np.diff(t)
    if kind == "rate":
        return Rates(m, np.arange(m.nv), dt)
    if kind == "acceleration":
        return AccelerationQuantity(m, np.arange(m.nrho), dt)
    if kind == ACROSS:
        return AccelerationsAcross(m, np.arange(m.nv), dt)
    if kind == "tension":
        return Tensions(m, Scaled.tensions(m, 1.0), dt)
    raise ArgumentError(f"quantity: got {kind!r}, expected one of {', '.join(map(repr, KINDS))}")


class AccelerationQuantity(Quantity):
    """Accelerations of kinematic variables over steps, ``((rho_next - rho) / dt - v_rho) / dt``.

    Of turns, whose input is the turn of a step, ``(turn / dt - v_rho) / dt``.
    """

    kind = "acceleration of"

    def __init__(self, mechanism: Mechanism, which: Instants, dt: Array) -> None:
        m = mechanism
        self.mechanism, self.which, self.dt = m, which, dt
        self.names = tuple(m.kinematic[i] for i in which)
        places, turns = places_of(m)
        self.places, self.counts = places[which], 1.0 - turns[which]

    def values(self, at: Samples) -> Array:
        m, dt = self.mechanism, self.dt[at.k, None]
        rate = (at.u[:, m.n_inputs + self.which] - self.counts * at.x[:, self.places]) / dt
        return np.asarray((rate - at.x[:, m.nq + m.nd + self.which]) / dt)

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        m, i = self.mechanism, self.which
        return np.concatenate([m.nd + i, m.nv + m.nd + i, nx + m.n_inputs + i])

    def jacobian(self, at: Samples) -> Array:
        dt = self.dt[at.k, None, None]
        each = np.broadcast_to(np.eye(len(self.which)), (len(at.k), len(self.which), len(self.which)))
        return np.concatenate([-self.counts * each / dt**2, -each / dt, each / dt**2], axis=2)

    def curvature(self, at: Samples, y: Array) -> None:
        """Return None: they are linear."""

    def joined(self, others: Sequence[Quantity]) -> AccelerationQuantity | None:
        which = np.concatenate([part.which for part in self.among(others)])
        # Places come once.
        return AccelerationQuantity(self.mechanism, which, self.dt) if len(np.unique(which)) == len(which) else None

    def own_select(self, rows: Sequence[int]) -> AccelerationQuantity:
        return AccelerationQuantity(self.mechanism, self.which[list(rows)], self.dt)

    def own_is_like(self, other: Quantity) -> bool:
        return isinstance(other, AccelerationQuantity) and np.array_equal(self.dt, other.dt)


class AccelerationsAcross(LookingBack):
    """Accelerations of variables: from the mean rate over a step before to that over a step, from middle to middle.

    Those of kinematic variables are `AccelerationQuantity`: the state has their rates.
    """

    kind = "acceleration of"
    looks_ahead = True

    def __init__(self, mechanism: Mechanism, which: Instants, dt: Array, memory: Recalled | None = None) -> None:
        m = mechanism
        self.mechanism, self.which, self.dt = m, which, dt
        self.rates = Rates(m, which, dt)
        self.names = self.rates.names
        first = {name: each.variables[0] for each in m.tree.rotations for name in each.variables}
        place = {name: i for i, name in enumerate(m.coordinates)}
        place |= {each.variables[0]: m.coordinates.index(each.quaternion[0]) for each in m.tree.rotations}
        of = [m.variables[i] for i in self.rates.moved]
        # One for each direction: a rotation has three, which are remembered together.
        self._needs = tuple((TURN if name in first else "state", place[first.get(name, name)]) for name in of)
        begins = [m.variables.index(first.get(name, name)) for name in of]
        self._axes = self.rates.moved - np.array(begins, dtype=np.intp)
        super().__init__(memory)

    @property
    def needs(self) -> tuple[Need, ...]:
        return self._needs

    def remembering(self, memory: Recalled) -> AccelerationsAcross:
        return AccelerationsAcross(self.mechanism, self.which, self.dt, memory)

    def own_select(self, rows: Sequence[int]) -> AccelerationsAcross:
        return AccelerationsAcross(self.mechanism, self.which[list(rows)], self.dt, self.memory)

    def columns(self, nx: int, nu: int) -> Instants:
        moved = self.rates.moved
        return np.concatenate([moved, nx + self.remembered()[1] + self._axes, nx + nu + moved])

    def values(self, at: Samples) -> Array:
        return np.asarray((self.rates.values(at) - self.rates.values(self._before(at))) / self._lasts(at))

    def jacobian(self, at: Samples) -> Array:
        n = len(self.rates.moved)
        (here, ahead), (back, there) = (
            np.split(self.rates.jacobian(each), [n], axis=2) for each in (at, self._before(at))
        )
        return np.asarray(np.concatenate([here - there, -back, ahead], axis=2) / self._lasts(at)[:, :, None])

    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivatives of turns; None where there are none."""
        weights, n = y / self._lasts(at), len(self.rates.moved)
        after, before = self.rates.curvature(at, weights), self.rates.curvature(self._before(at), -weights)
        if after is None or before is None:
            return None
        out = np.zeros((len(at.k), 3 * n, 3 * n))
        for bent, parts in ((after, (0, 2)), (before, (1, 0))):
            places = np.concatenate([part * n + np.arange(n) for part in parts])
            out[:, places[:, None], places] += bent
        return out

    def own_is_like(self, other: Quantity) -> bool:
        return isinstance(other, AccelerationsAcross) and np.array_equal(self.dt, other.dt)

    def _before(self, at: Samples) -> Samples:
        """Return the step before, as it is remembered; before the first is the last, of a motion that returns."""
        x = at.x.copy()
        for (kind, i), axis, place in zip(self._needs, self._axes, self.remembered()[0], strict=True):
            size = 4 if kind == TURN else 1
            if axis == 0:
                x[:, i : i + size] = at.x[:, at.x.shape[1] + place :][:, :size]
        return at._replace(k=at.k - 1, x=x, x_next=at.x)

    def _lasts(self, at: Samples) -> Array:
        """Return the times between the middles of the steps before and after (n, 1)."""
        return np.asarray(0.5 * (self.dt[at.k - 1, None] + self.dt[at.k, None]))


class Tensions(Quantity):
    """Tensions of strings over the steps that led to the states (N), as `Trajectory.tensions` tells them.

    ``lam_k (constant + slope (L_k - dt v_L)) / dt`` with the length ``L_k - dt v_L`` at the start of the step, where it
    is a variable. ``dt`` (N,).
    """

    of_state, first = True, 1
    kind, unit = "tension of", "N"

    def __init__(self, mechanism: Mechanism, strings: Scaled, dt: Array) -> None:
        self.mechanism, self.strings, self.dt = mechanism, strings, dt
        self.names = strings.names
        m = mechanism
        # A length is a prescribed variable; its rate stands behind the momenta. Where there is none, nothing is read.
        known = {m.coordinates.index(name): i for i, name in enumerate(m.kinematic) if name in m.coordinates}
        of = np.array([known.get(place, 0) for place in strings.places.tolist()], dtype=np.intp)
        rates = m.nq + m.nd + of if m.nrho else strings.places
        self._lam, self._length, self._rate = m.nx + strings.rows, strings.places, rates
        length, rate = (m.nd + of, m.nv + m.nd + of) if m.nrho else (strings.places, strings.places)
        by = [m.ndx + strings.rows, length, rate]
        self._columns = np.unique(np.concatenate(by))
        self._at = [np.searchsorted(self._columns, each) for each in by]

    def values(self, at: Samples) -> Array:
        return np.asarray(at.x[:, self._lam] * self._factor(at))

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002
        return self._columns

    def jacobian(self, at: Samples) -> Array:
        result = np.zeros((len(at.k), len(self.names), len(self._columns)))
        rows, (lam, length, rate) = np.arange(len(self.names)), self._at
        by = self.strings.slope * at.x[:, self._lam]
        result[:, rows, lam] = self._factor(at)
        result[:, rows, length] += by / self._dt(at)
        result[:, rows, rate] -= by
        return result

    def curvature(self, at: Samples, y: Array) -> Array | None:
        """Return the second derivative, of products of a multiplier with a length and its rate."""
        if not self.strings.slope.any():
            return None
        pull, dt = y * self.strings.slope, self._dt(at)
        result = np.zeros((len(at.k), len(self._columns), len(self._columns)))
        for j, (lam, length, rate) in enumerate(zip(*self._at, strict=True)):
            for place, slope in ((length, pull[:, j] / dt[:, 0]), (rate, -pull[:, j])):
                result[:, lam, place] += slope
                result[:, place, lam] += slope
        return result

    def joined(self, others: Sequence[Quantity]) -> Tensions:
        return Tensions(self.mechanism, Scaled.joined([part.strings for part in self.among(others)]), self.dt)

    def own_select(self, rows: Sequence[int]) -> Tensions:
        return Tensions(self.mechanism, self.strings.select(rows), self.dt)

    def own_is_like(self, other: Quantity) -> bool:
        if not isinstance(other, Tensions):
            return False
        own, others = (np.concatenate([each.strings.constant, each.strings.slope, each.dt]) for each in (self, other))
        return np.array_equal(own, others)

    @property
    def sign(self) -> Quantity:
        """The multipliers, which have the signs of the tensions while lengths are positive."""
        multipliers = Entries(self.names, self._lam, of_state=True, kind="tension of")
        multipliers.first = 1
        return multipliers

    def _dt(self, at: Samples) -> Array:
        return self.dt[at.k - 1, None]

    def _factor(self, at: Samples) -> Array:
        dt = self._dt(at)
        return np.asarray(self.strings.factor(at.x[:, self._length] - dt * at.x[:, self._rate]) / dt)
