"""How far to go along a direction."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.optimal.line_search import LineSearch, SearchStep
from leastaction.optimal.loop.ending import EndFound, Outcome
from leastaction.optimal.loop.problem import Direction
from leastaction.optimal.loop.run import Run
from leastaction.optimal.result import Status

# Shorter steps that are tried along a direction which another one can replace.
_BACKTRACKS = {"newton": 4, "quasi-newton": 6, "negative-curvature": 8}
_BACKTRACKS_SHIFTED = 2

# Factor by which the first step of a search is longer than the last one that was taken.
_LONGER = 4.0

# Changes of the cost by a negative second derivative, in times its noise, at which that is looked at, the first where
# higher orders may hide it; and the part of it that has to be seen at one of them.
_ABOVE_NOISE, _SOME = (1e7, 1e5, 1e3), 0.1

# Lengths of steps over which a cost is looked at for its noise; the part of the cost below which an expected decrease
# is a reason to; and that above which what is seen is no noise.
_SHORTEST = (1e-6, 2e-6, 4e-6)
_LITTLE, _ROUGHEST = 1e-7, 1e-9


class Search:
    """The searches of a run."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.line_search = LineSearch(run.settings.alpha, run.settings.beta)

    def __call__(self, direction: Direction) -> SearchStep[Any]:
        """Return the step along a direction; raises `EndFound` where its negative curvature is seen to be wrong."""
        return self._along(direction) if direction.bend == 0.0 else self._down(direction)

    def _along(self, direction: Direction, first: float | None = None) -> SearchStep[Any]:
        run, problem = self.run, self.run.problem
        if first is None:
            first = min(1.0, _LONGER * run.schedule.length)
            if direction.method == run.schedule.method:
                first = max(first, run.schedule.reach)
            first = problem.steps.first_step(direction, first)
        backtracks = run.settings.max_backtracks
        name = direction.method
        if name != "steepest" and run.settings.method in ("auto", "newton"):
            # Another direction takes over, so very short steps are not worth their roll-outs.
            most = _BACKTRACKS.get(name.removesuffix("-damped"), _BACKTRACKS_SHIFTED)
            backtracks = min(backtracks, most)
        if run.trusts_its_start:
            backtracks = 0
        with problem.report.clock.rollout:
            step = self.line_search(
                lambda length, bound: problem.steps.simulate(direction, length, bound),
                value=problem.here.value,
                noise=problem.here.noise,
                slope=direction.slope,
                bend=direction.bend,
                max_backtracks=backtracks,
                first=first,
            )
        run.searched += step.rollouts
        return step

    def sees_noise(self, direction: Direction) -> bool:
        """Look, where a search for little has failed, how much the cost is off; whether by more than was thought.

        Over the shortest steps it would change by nothing else. Roll-outs whose steps are solved to a tolerance are off
        by more than the rounding of a sum, and so are steep limits.
        """
        problem = self.run.problem
        if direction.bend < 0.0 or -direction.slope > _LITTLE * abs(problem.here.value):
            return False
        with problem.report.clock.rollout:
            trials = [(h, problem.steps.simulate(direction, h, np.inf).cost) for h in _SHORTEST]
        self.run.searched += len(trials)
        off = max(abs(cost - problem.here.value - h * direction.slope) for h, cost in trials)
        if not 2.0 * problem.here.noise < off <= _ROUGHEST * abs(problem.here.value):  # of what failed it is NaN
            return False
        problem.here.roughness = off
        return True

    def _down(self, direction: Direction) -> SearchStep[Any]:
        """Search along negative curvature; if need be, with steps so short that the second derivative holds.

        Raises `EndFound` if the cost is seen not to bend downwards there: then the given second derivative is wrong, or
        holds for much shorter steps only. Nothing speaks against a minimum if the convex model expects none either.
        Beside the stiffness of limits it is the rounding of the model, and no fault of the system's.
        """
        length = self._bends(direction)
        if length is None:
            expected, detail = self._least_expected(), ""
            status = Status.CONVERGED if expected <= self.run.goal else Status.LINE_SEARCH_FAILED
            if not self.run.problem.models.knows_longest_step:
                detail = (
                    "The second derivative of the system has it fall along a direction in which it rises: hold it to "
                    "check_derivatives."
                )
            raise EndFound(Outcome(status, detail, expected))
        step = self._along(direction)
        return step if step.trial is not None else self._along(direction, first=length)

    def _bends(self, direction: Direction) -> float | None:
        """Return a length over which the cost bends downwards as its second derivative says; None if there is none."""
        problem = self.run.problem
        for above in _ABOVE_NOISE:
            length = min(1.0, float(np.sqrt(above * problem.here.noise / -direction.bend)))
            with problem.report.clock.rollout:
                costs = [problem.steps.simulate(direction, side, np.inf).cost for side in (length, -length)]
            self.run.searched += len(costs)
            # A roll-out that failed has a cost of NaN, and says nothing.
            if not sum(costs) - 2.0 * problem.here.value > _SOME * length**2 * direction.bend:
                return length
        return None

    def _least_expected(self) -> float:
        """Return the decrease of the cost that the convex model expects, without any shift."""
        problem = self.run.problem
        model = problem.models.minimise("quasi-newton", 0.0)
        return -problem.steps.direction("quasi-newton", model, 0.0).slope if model.definite else np.inf
