"""Ways to look for a motion that follows a wanted one, taken in rounds: what one finds soon, another may never find."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.limits.limit import Limit, checked_limits
from leastaction.optimal.optimizer import optimized
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.systems.embedding import embed
from leastaction.systems.midpoint import MidpointSystem

_ROUNDS = 60, 300  # iterations that each way has had in the end of a round; all that are allowed in the last
_ENDED = Status.INTERRUPTED, Status.STOPPED_BY_CALLBACK
_FREELY = "from what is found without limits"
_MET = 1e-3  # of their scale limits may be off in a result that is better than one that is cheaper

Start = tuple[Array, Array]


class Ways:
    """Ways to a motion of least cost within limits: from some starts, without limits first, with help on all variables.

    ``starts``: the wanted motion, and one that stays where that begins. ``options``: of `optimize`.
    """

    def __init__(
        self,
        system: MidpointSystem,
        cost: Cost,
        limits: Sequence[Limit],
        starts: Sequence[Start],
        options: Mapping[str, Any],
        progress: Callable[[str], object] | None,
    ) -> None:
        self.system, self.cost, self.limits = system, cost, checked_limits(limits)
        self.starts, self.options = starts, dict(options)
        # What is wrong with limits is so for every way.
        first = 1 if self.options.get("free_start", False) is False else 0
        for limit in self.limits:
            if not isinstance(limit, Periodic):
                limit.rows(system, first)
        self.progress = progress
        self.found: dict[str, OptimizationResult] = {}
        self.free: list[OptimizationResult] = []  # from each start, without limits
        self.failed: dict[str, LeastActionError] = {}

    def search(self, max_iterations: int) -> tuple[str, OptimizationResult]:
        """Return the first way that converges, or the best that any led to, and what it led to.

        Raises `ArgumentError`: if no way leads to any motion.
        """
        ways: dict[str, Callable[[int], OptimizationResult]] = {
            "from the wanted motion": lambda most: self._optimize(self.starts[0], most),
            "from holding still where it begins": lambda most: self._optimize(self.starts[1], most),
        }
        if self.limits:
            ways[_FREELY] = self._without_limits
        for most in (*(each for each in _ROUNDS if each < max_iterations), max_iterations):
            for way, begin in ways.items():
                if self._go_on(way, begin, most):
                    return way, self.found[way]
        helped = "by dynamic embedding"
        if self._go_on(helped, self._with_help, max_iterations):
            return helped, self.found[helped]
        if not self.found:
            last = list(self.failed.values())[-1]
            if len({str(error) for error in self.failed.values()}) == 1:
                raise last
            raise ArgumentError(f"follow: no way leads to a motion of the mechanism; at last: {last}") from last
        best = min(self.found, key=lambda way: rank(self.found[way]))
        return best, self.found[best]

    def _go_on(self, way: str, begin: Callable[[int], OptimizationResult], most: int) -> bool:
        """Go on with a way until it has had so many iterations; return whether it is the one to take."""
        earlier = self.found.get(way)
        if way in self.failed:
            return False
        if earlier is None and self.progress is not None:
            self.progress(f"looking for a motion {way}")
        anew = False
        try:
            if earlier is None:
                result = begin(most)
            elif way == _FREELY and self._goes_on_freely(most):
                result, anew = begin(most), True
            elif earlier.status is Status.ITERATION_LIMIT:
                limits, left = self.limits, most - earlier.iterations
                result = optimized(
                    self.system, self.cost, resume=earlier, limits=limits, max_iterations=left, **self.options
                )
            else:
                return False
        except LeastActionError as error:
            if earlier is None:
                self.failed[way] = error
            return False
        if earlier is None or not anew or result.success or rank(result) < rank(earlier):
            self.found[way] = result
        return result.success or result.status in _ENDED

    def _optimize(self, start: Start, most: int) -> OptimizationResult:
        return optimized(self.system, self.cost, initial=start, limits=self.limits, max_iterations=most, **self.options)

    def _without_limits(self, most: int) -> OptimizationResult:
        """Look for a motion from the cheaper of those that are found without limits."""
        if not self.free:
            self.free = [self._freely(most, initial=start) for start in self.starts]
        best = min(self.free, key=rank)
        return optimized(self.system, self.cost, initial=best, limits=self.limits, max_iterations=most, **self.options)

    def _goes_on_freely(self, most: int) -> bool:
        """Go on without limits where that had not arrived; return whether it has now.

        From there limits are met sooner than from where it was on its way, whatever that led to.
        """
        before, self.free = self.free, [
            self._freely(most - each.iterations, resume=each) if each.status is Status.ITERATION_LIMIT else each
            for each in self.free
        ]  # fmt: skip
        best = min(self.free, key=rank)
        return best.success and not any(best is each for each in before)

    def _freely(self, most: int, **begin: Any) -> OptimizationResult:
        return optimized(self.system, self.cost, max_iterations=most, **begin, **self.options)

    def _with_help(self, most: int) -> OptimizationResult:
        start, options = self.starts[0], self.options
        found = embed(self.system, self.cost, initial=start, limits=self.limits, max_iterations=most, **options)
        if not found.success or found.result is None:
            raise ArgumentError(f"the help could not be removed: {found.message}")
        return found.result


def rank(result: OptimizationResult) -> tuple[bool, bool, float]:
    """Return what is least of the best result: one that keeps to its limits, then the cheapest."""
    off = result.limits is not None and result.limits.excess > _MET
    return result.status is Status.INFEASIBLE, off, result.cost
