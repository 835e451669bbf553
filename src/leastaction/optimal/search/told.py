"""What a search in steps of time tells of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import changed, made
from leastaction.optimal.discrete.linear_quadratic import regulate
from leastaction.optimal.iterates.direction import DiscreteDirection
from leastaction.optimal.loop import Clock, SearchReport
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.search.beginning import Beginning
from leastaction.optimal.search.parts import SearchParts
from leastaction.optimal.state import Begun, SearchState

_NOTHING: Mapping[str, float] = MappingProxyType({})


class DiscreteReport(SearchReport[DiscreteDirection]):
    """What is told of a search in steps of time; ``results``: returns another result than that of these, if given."""

    def __init__(
        self,
        parts: SearchParts,
        beginning: Beginning,
        results: Callable[[dict[str, Any]], OptimizationResult] | None = None,
    ) -> None:
        self.parts, self.beginning, self.results = parts, beginning, results

    @property
    def clock(self) -> Clock:
        return self.parts.work.clock

    @property
    def rollouts(self) -> int:
        return self.parts.work.rollouts

    @property
    def note(self) -> str:
        return self.beginning.note

    @property
    def shown(self) -> float:
        return self.parts.shown

    @property
    def undetermined(self) -> str:
        return self.parts.models.start.undetermined

    def where(self, direction: DiscreteDirection) -> str:
        return self.parts.models.where(direction)

    def arrays(self) -> tuple[Array, Array]:
        return self.parts.grid.arrays(self.parts.here)

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        if self.results is not None:
            return self.results(summary)
        return _result(self.parts, self.beginning.begun, summary)


def _result(parts: SearchParts, begun: Begun, summary: dict[str, Any]) -> OptimizationResult:
    """Return the result in steps of time: at the iterate, or where it stood before, while there are gaps."""
    feedback = parts.models.feedback
    if feedback is None:
        feedback = _final_feedback(parts)
    here, before = parts.here, begun.earlier if parts.here.is_open else None
    gaps = None if parts.curve is None else parts.curve.state()
    state = made(SearchState, begun=changed(begun, ease=parts.ease), gaps=gaps)
    result = made(
        OptimizationResult,
        x=here.x, u=here.u, K=read_only(feedback), projection_gain=read_only(here.gain), unknowns=_NOTHING,
        gap=here.gap, state=state,
        limits=parts.report(before) if parts.rows else None, **summary, **parts.about,
    )  # fmt: skip
    if before is None:
        return result
    return changed(
        result, x=before.x, u=before.u, K=before.gain, projection_gain=before.gain,
        cost=parts.asked.value(before.x, before.u), worst_step=before.worst_step, gap=0.0,
    )  # fmt: skip


def _final_feedback(parts: SearchParts) -> Array:
    """Return gains about the last iterate, for a run that ended before it had any."""
    try:
        solution = parts.models.solve("quasi-newton", parts.work.free)
        return solution.K if solution.definite else regulate(*parts.models.linearize())
    except LeastActionError:
        return parts.here.gain
