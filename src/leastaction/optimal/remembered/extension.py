"""An optimisation within limits that look back, as one of a system that remembers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from leastaction.numerics.arrays import as_array, read_only
from leastaction.optimal.cost import widened
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.own_projection import with_projection
from leastaction.optimal.discrete.system import DiscreteSystem, told_of, with_parameters
from leastaction.optimal.initial import pair_of
from leastaction.optimal.limits.limit import Bound, FromSecond, Horizon, Limit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.looking_back import Need, needs_of
from leastaction.optimal.loop import Callback
from leastaction.optimal.options import Options
from leastaction.optimal.remembered.system import RememberingSystem
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.unknowns.extended import told_in_own_states
from leastaction.optimal.unknowns.periodic import Periodic

_LOOK_BACK = ("input rate", "acceleration")  # kinds of quantities that may need the step before


def needed_by(limits: Sequence[Limit], cost: Cost, system: DiscreteSystem, first: int) -> list[Need]:
    """Return what some limits, and a cost, of a system need to be remembered: inputs first."""
    found: set[Need] = set(cost.needs)
    for limit in limits:
        stated = limit.limit if isinstance(limit, FromSecond) else limit
        if getattr(stated, "of", None) in _LOOK_BACK:
            found.update(need for row in limit.rows(cast(Horizon, system), first) for need in needs_of(row.quantity))
    return sorted(found)


@dataclass(frozen=True)
class OwnLimit(Limit):
    """A limit that is stated of a system, for one that remembers."""

    limit: Limit

    def __str__(self) -> str:
        return str(self.limit)

    def rows(self, system: Any, first: int) -> list[Rows]:
        # Names are looked up by a system that remembers; what is a quantity already is of its own states.
        if not isinstance(system, RememberingSystem):
            return self.limit.rows(system, first)
        rows = self.limit.rows(system.system, first)
        return [replace(row, quantity=system.looking(row.quantity)) for row in rows]


def own_limits(limits: Sequence[Limit]) -> list[Limit]:
    """Return limits that are stated of a system, for one that remembers."""
    return [each if isinstance(each, Bound | Periodic) else OwnLimit(each) for each in limits]


class Remembered:
    """The system that remembers and its cost, and the way there and back for all that is given and returned."""

    def __init__(self, system: DiscreteSystem, cost: Cost, limits: Sequence[Limit], needs: Sequence[Need]) -> None:
        self.own = system
        # What returns is before the first step as it is before what would come after the last.
        places = [place for each in limits if isinstance(each, Periodic) for place in each.entries(system)]
        returning = [need for need in needs if places and (need[0] == "input" or need[1] in places)]
        self.system = RememberingSystem(system, needs, returning, cost.before)
        self.cost = self.system.cost_of(cost)
        self.limits = own_limits(limits)

    def settings(self, given: Options) -> Options:
        """Return options for the system that remembers: a projection acts on the system's own states."""
        behind = self.system.behind
        return with_projection(given, self.own, behind, partial(widened, moved=behind))

    def start(self, initial: Any) -> Any:
        """Return a start for the system that remembers."""
        if isinstance(initial, OptimizationResult):
            return self.resume(initial)
        x, u = pair_of(initial)
        N, nx = self.own.N, self.own.nx
        states = as_array(x, "initial x", (N + 1, nx), (nx,), meaning="(N+1, nx) or an initial state (nx,)")
        inputs = as_array(u, "initial u", (N, self.own.nu), meaning="(N, nu)")
        return self.system.extended(states, inputs), inputs

    def resume(self, result: OptimizationResult) -> OptimizationResult:
        """Return an earlier result as one of the system that remembers."""
        return replace(result, x=read_only(self.system.extended(np.asarray(result.x), np.asarray(result.u))))

    def callback(self, given: Callback | None) -> Callback | None:
        """Return a callback that calls the given one with the system's own states."""
        return told_in_own_states(given, self.system.own, self.result)

    def result(self, found: OptimizationResult) -> OptimizationResult:
        """Return a result in the system's own states; its feedback is what of the gains acts on these."""
        system = with_parameters(self.own, found.unknowns) if found.unknowns else self.own
        K = np.ascontiguousarray(found.K[:, :, : self.own.ndx])
        return replace(found, **told_of(system), x=read_only(self.system.own(found.x)), K=K)
