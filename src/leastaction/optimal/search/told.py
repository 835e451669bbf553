"""What a search in steps of time tells of itself."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.frozen import changed, made
from leastaction.optimal.discrete.linear_quadratic import regulate
from leastaction.optimal.memory import Memory
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.search.beginning import Begun
from leastaction.optimal.search.parts import SearchParts

_NOTHING: Mapping[str, float] = MappingProxyType({})


def told(parts: SearchParts, begun: Begun, summary: dict[str, Any]) -> OptimizationResult:
    """Return the result in steps of time: at the iterate, or where it stood before, while there are gaps."""
    feedback = parts.models.feedback
    if feedback is None:
        feedback = _final_feedback(parts)
    here, before, curve = parts.here, begun.earlier if parts.here.is_open else None, parts.curve
    result = made(
        OptimizationResult,
        x=here.x, u=here.u, K=read_only(feedback), projection_gain=read_only(here.gain), unknowns=_NOTHING,
        gap=0.0 if curve is None else curve.gap, memory=_memory(parts, begun),
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


def _memory(parts: SearchParts, begun: Begun) -> Memory:
    """Return what resuming needs beside the iterate."""
    curve = parts.curve
    return made(
        Memory,
        start=begun.given, curve=begun.curve, wanted=begun.wanted, first=begun.first, earlier=begun.earlier,
        ease=parts.ease, gaps=None if curve is None else curve.memory(),
    )  # fmt: skip
