"""Limits of a continuous system at the points of a mesh, as those of the discrete one."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import read_only
from leastaction.optimal.collocation.mesh import STAGES, NodeLayout, RadauMesh
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.limit_report import LimitState
from leastaction.optimal.limits.charts import numbered
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Entries, Instants, Quantity, QuantityElsewhere, Samples


class Points:
    """All points of a mesh as instants on which limits are stated; the first is the start. Nothing in it changes."""

    numbered = False

    def __init__(self, system: ContinuousSystem, mesh: RadauMesh) -> None:
        self.system, self.t = system, read_only(mesh.points.copy())
        self.N = len(self.t) - 1

    def of(self, system: ContinuousSystem) -> Points:
        """Return the same points of another system."""
        other = copy(self)
        other.system = system
        return other

    @property
    def quantities(self) -> tuple[str, ...]:
        """The kinds of quantities that can be limited."""
        return self.system.quantities

    def quantity(self, kind: str) -> Quantity:
        """Return the quantities of a kind, by name, at the points."""
        return self.system.quantity(kind, self.t)

    def span(self, *, of_state: bool) -> tuple[int, int]:
        """Return the first and the last point of states, or of inputs, which the start has none of."""
        return 0 if of_state else 1, self.N

    def time(self, k: int) -> float:
        """Return the time of a point."""
        return float(self.t[k])

    def when(self, k: int) -> str:
        """Return how to speak of a point in messages."""
        return f"t = {self.t[k]:.4g} s"

    def instant(self, t: float, what: str) -> int:
        """Return the point at a time: those of limits are among the ends of pieces."""
        k = int(np.argmin(np.abs(self.t - t)))
        if abs(self.t[k] - t) > 1e-8 * (self.t[-1] - self.t[0]):
            raise ArgumentError(
                f"{what}: got the time {t:.6g}, expected one from {self.t[0]:.6g} to {self.t[-1]:.6g} s"
            )
        return k


@dataclass(frozen=True, eq=False)
class Stated:
    """A side of a limit as it was stated, and the rows of the discrete system that it became.

    ``rows``: of each point of a piece. ``points``: which points those are. ``along``: whether it holds at all points:
    its duals then are densities over time.
    """

    rows: tuple[Rows, ...]
    points: tuple[Instants, ...]
    along: bool

    @property
    def is_second(self) -> bool:
        """Whether it is the other side of an equation, which goes with the first."""
        return self.rows[0].equal and self.rows[0].sign < 0.0


def stated(limits: Sequence[Limit], system: ContinuousSystem, mesh: RadauMesh, first: int) -> list[Stated]:
    """Return the sides of limits on a mesh. ``first``: the first point at which states are limited."""
    points, layout, found = Points(system, mesh), NodeLayout(system.nx, system.nu), []
    for side in (side for limit in limits for side in limit.rows(points, first)):
        quantity = numbered(side.quantity, system.space)
        if side.quantity.looks_ahead:
            raise ArgumentError(
                f"{side.limit}: it depends on the next instant, which there is none of in continuous time"
            )
        rows, at = [], []
        for stage in range(STAGES):
            here = side.k % STAGES == (stage + 1) % STAGES
            if stage < STAGES - 1:
                here &= side.k > 0
            if not here.any():
                continue
            rows.append(
                replace(
                    side,
                    quantity=_at_stage(quantity, layout, stage),
                    bounds=side.bounds[here],
                    k=-(-side.k[here] // STAGES),
                    start=side.start if stage == STAGES - 1 else None,
                )
            )
            at.append(side.k[here])
        found.append(Stated(tuple(rows), tuple(at), len(side.k) > 1 and len(side.k) >= points.N))
    return found


def _at_stage(quantity: Quantity, layout: NodeLayout, stage: int) -> Quantity:
    places = layout.places(stage)
    if isinstance(quantity, Entries):
        own = quantity.places if quantity.of_state else layout.nx + quantity.places
        return Entries(
            quantity.names, places[own], of_state=True, factors=quantity.factors, kind=quantity.kind, unit=quantity.unit
        )
    return AtStage(quantity, layout, stage)


class AtStage(QuantityElsewhere):
    """A quantity of the continuous system at one point of every piece, as one of the discrete system's state."""

    def __init__(self, whole: Quantity, layout: NodeLayout, stage: int) -> None:
        super().__init__(whole)
        self.of_state, self.layout, self.stage = True, layout, stage
        self.places = layout.places(stage)

    def columns(self, nx: int, nu: int) -> Instants:  # noqa: ARG002 - of the discrete system
        """Return the places in the state on which it depends."""
        return np.asarray(self.places[self.whole.all_columns(self.layout.nx, self.layout.nu)])

    def seen(self, at: Samples) -> Samples:
        both, n, nothing = at.x[:, self.places], self.layout.nx, np.empty((len(at.k), 0))
        inputs = nothing if self.whole.of_state else np.ascontiguousarray(both[:, n:])
        return Samples(self.instants(at.k), np.ascontiguousarray(both[:, :n]), inputs, nothing)

    def joined(self, others: Sequence[Quantity]) -> Quantity | None:
        _, *parts = self.among(others)
        alike = all(part.stage == self.stage and type(part.whole) is type(self.whole) for part in parts)
        whole = self.whole.joined([part.whole for part in parts]) if alike else None
        return None if whole is None else AtStage(whole, self.layout, self.stage)

    def own_instants(self, k: Instants) -> Instants:
        return (k - 1) * STAGES + 1 + self.stage


def told(sides: Sequence[Stated], states: Sequence[LimitState], mesh: RadauMesh) -> tuple[LimitState, ...]:
    """Return what is told of limits as they were stated, given what is told of the rows that they became.

    Of limits that hold all along duals are densities: by how much the cost would fall for a unit more of room over a
    second.
    """
    weights = mesh.weights_of_points
    found, rest = [], iter(states)
    for side in sides:
        if side.is_second:
            continue
        parts = [next(rest) for _ in side.rows]
        points = np.concatenate(side.points)
        order = np.argsort(points)
        price = np.max([part.price for part in parts], axis=0)
        value, dual, active = (
            np.concatenate([getattr(part, name) for part in parts])[order] for name in ("value", "dual", "active")
        )
        k = points[order].astype(np.int64)
        dual = dual / (weights[k][:, None] if side.along else 1.0)
        t = mesh.points[k]
        for array in (k, t, price, value, dual, active):
            array.setflags(write=False)
        found.append(replace(parts[0], k=k, value=value, dual=dual, price=price, active=active, t=t))
    return tuple(found)
