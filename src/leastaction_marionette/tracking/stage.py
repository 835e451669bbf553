"""An optimisation that is a stage of a search: what speaks against its motion stands in its message alone."""

from __future__ import annotations

from typing import Any

from leastaction.optimal import OptimizationResult, Optimizer


def optimize(
    system: Any, cost: Any, *, initial: Any = None, resume: Any = None, callback: Any = None, **stated: Any
) -> OptimizationResult:
    """Return what `leastaction.optimize` does, without its warnings."""
    return Optimizer(system, cost, **stated).run(initial, resume=resume, callback=callback)
