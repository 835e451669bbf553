"""An optimisation that is a stage of a search: what speaks against its motion stands in its message alone."""

from __future__ import annotations

from typing import Any, Final

from leastaction.optimal import IterationRecord, OptimizationResult, Optimizer

_LOST: Final = 10.0  # times the cost of a curve that the motion which follows it by feedback has where it is lost


def optimize(system: Any, cost: Any, *, initial: Any = None, **stated: Any) -> OptimizationResult:
    """Return what `leastaction.optimize` does, without its warnings.

    Where feedback along a curve is lost, as limbs that swing on few strings are thrown about, the search begins with
    gaps between the steps of the curve instead, which it closes.
    """
    resume, callback = (stated.pop(name, None) for name in ("resume", "callback"))
    curve = cost.value(*initial) if isinstance(initial, tuple) else None
    lost = False

    def watch(record: IterationRecord) -> object:
        nonlocal lost
        lost = curve is not None and record.iteration == 0 and record.gap == 0.0 and record.cost > _LOST * curve
        return lost or (callback is not None and callback(record))

    result = Optimizer(system, cost, **stated).run(initial, resume=resume, callback=watch)
    if lost:
        result = Optimizer(system, cost, **stated | {"shooting": "multiple"}).run(initial, callback=callback)
    return result
