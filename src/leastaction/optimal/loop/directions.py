"""Which direction to follow, and whether there is any left."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from leastaction.optimal.loop.ending import EndFound, Outcome
from leastaction.optimal.loop.problem import Direction
from leastaction.optimal.loop.run import Run
from leastaction.optimal.result import Status
from leastaction.optimal.schedule import NewtonSchedule

# Methods in the order in which they replace one another when a direction cannot be followed.
_CHAIN = ("newton", "quasi-newton", "steepest")

# Levenberg-Marquardt's weights: the first, and the factor from one to the next.
_FIRST_SHIFT, _MORE_SHIFT = 1e-3, 10.0

# Factor of the curvature with which a model without a minimum is tried again, and the least share that is worth having.
_LESS_CURVATURE = 0.3
_LEAST_CURVATURE = 1.0 / 128.0

# Foretelling of the end of a quadratic tail: the part of the goal below which what is left is foretold to be nothing;
# the error of the model's decrease up to which it foretells; and the square of 2 times what a model missed, by which a
# part of a Newton step's decrease is left to be made along it.
_FORETOLD, _RIGHT, _MISSED = 0.01, 0.05, 4.0

# Part of the cost below which an expected decrease is none, of a cost that does not fall any more; and steps that are
# made to gain more than that.
_STALLED_CLOSE, _STALLED_STEPS = 1e-7, 5


class Directions:
    """The choice of a direction at the current iterate of a run."""

    def __init__(self, run: Run) -> None:
        self.run = run

    def each(self, notes: list[str]) -> Iterator[Direction]:
        """Yield one direction after the other, for as long as they cannot be followed.

        First those of the methods, each of which is simpler than the one before; then, of the automatic choice,
        ever shorter ones (Levenberg-Marquardt). Raises `EndFound` at a minimum.
        """
        run = self.run
        goal, shift, methods = run.goal, run.schedule.shift, self._methods()
        while shift < run.problem.models.largest_shift:
            searched = False
            for method in methods:
                if method == "steepest" and run.is_automatic:
                    if searched or shift > 0.0:
                        break
                    self._end_drowned()
                direction = self._direction(method, shift)
                if method == methods[0] == "quasi-newton" and shift == 0.0:
                    direction = self._unless_newton_will_do(direction, goal)
                if isinstance(direction, str):
                    notes.append(f"{method}: {direction}")
                    run.note_failure(method)
                    continue
                if run.stalled or -direction.slope <= goal:
                    if shift > run.schedule.shift:
                        return  # So short a step leads nowhere.
                    direction = self._confirm(direction)
                searched = True
                run.set_shift(shift)
                yield direction
            if not run.is_automatic or (shift == 0.0 and not searched):
                return
            shift = _MORE_SHIFT * shift if shift > 0.0 else _FIRST_SHIFT

    def _methods(self) -> tuple[str, ...]:
        """Return the methods for this iteration: each replaces the one before if that fails."""
        first = self.run.settings.method
        if first == "auto":
            schedule = self.run.schedule
            newton = self.run.problem.models.has_curvature and schedule.wait == 0
            first = "newton" if newton else "quasi-newton"
        return _CHAIN[_CHAIN.index(first) :]

    def _direction(self, method: str, shift: float) -> Direction | str:
        """Return the direction of a method, or why there is none.

        Newton's model gets as much of the dynamics' curvature as leaves it a minimum.
        """
        run, problem = self.run, self.run.problem
        scale = run.schedule.scale if method == "newton" else 0.0
        model = problem.models.minimise(method, scale, shift)
        while not model.definite and scale > _LEAST_CURVATURE:
            scale *= _LESS_CURVATURE
            run.note_indefinite(scale)
            model = problem.models.minimise(method, scale, shift)
        if not model.definite:
            return str(model.message)
        damped = "-damped" if 0.0 < scale < 1.0 else ""
        shifted = "-shifted" if shift > 0.0 else ""
        found: Direction = problem.steps.direction(f"{method}{damped}{shifted}", model, scale, shift)
        return found

    def _unless_newton_will_do(self, direction: Direction | str, goal: float) -> Direction | str:
        """Return a quasi-Newton direction; that of Newton's method, where one step of it is foretold to be the last.

        The undamped model has to be looked at in the end anyway, to tell the minimum from a saddle.
        """
        run, problem = self.run, self.run.problem
        tells = run.is_automatic and run.schedule.full and problem.models.tells_saddles and problem.models.has_curvature
        if isinstance(direction, str) or not tells:
            return direction
        expected = -direction.slope
        if expected <= goal or _after_newton(expected, run.schedule) > goal:
            return direction
        model = problem.models.minimise("newton", 1.0)
        if model.definite:
            found: Direction = problem.steps.direction("newton", model, 1.0)
            return found
        return self._direction("quasi-newton", 0.0)  # the model was written over the direction

    # ---- Whether it is a minimum ----------------------------------------------------------------

    def _end_drowned(self) -> None:
        """Raise `EndFound` where rounding has left no model, and next to nothing is expected."""
        run = self.run
        if not run.problem.models.is_below_rounding:
            return
        left = run.problem.models.remaining_decrease()
        if left <= run.asked:
            raise EndFound(Outcome(Status.CONVERGED, expected=left))
        if run.history.iterations > 0:
            expected = run.history.expected_decreases[-1]  # in an earlier stage, perhaps
            if expected <= _STALLED_CLOSE * abs(run.problem.here.value):
                raise EndFound(Outcome(Status.STALLED, expected=expected))

    def _confirm(self, direction: Direction) -> Direction:
        """Return a direction along which the cost still falls, where a model expects no more of its own.

        Damped and shifted models have a minimum at a saddle too: only the undamped second derivative tells.
        Raises `EndFound` if there is nowhere to go.
        """
        run, problem = self.run, self.run.problem
        expected = -direction.slope
        status = Status.STALLED if run.stalled else Status.CONVERGED
        run.set_shift(0.0)
        if not problem.models.tells_saddles:
            raise EndFound(Outcome(status, expected=expected))
        goes_on = run.settings.method in ("auto", "newton")
        if direction.curvature_scale == 1.0 > direction.shift:
            return self._unless_close(direction, status)
        model = problem.models.minimise("newton", 1.0)
        if model.definite:
            newton = problem.steps.direction("newton", model, 1.0)
            if not goes_on:
                raise EndFound(Outcome(status, expected=expected))
            return self._unless_close(newton, status)
        scale = 0.0 if direction.shift > 0.0 else direction.curvature_scale
        down: Direction | None = problem.models.negative_curvature(scale) if goes_on else None
        if down is None:
            more = goes_on and not run.stalled and expected > run.asked
            # Where this stage alone is content, there is more to be gained along a damped model's direction.
            damped = self._direction("newton", direction.shift) if more else ""
            if isinstance(damped, str):
                raise EndFound(Outcome(Status.SADDLE, model.message, expected))
            return damped
        promise = -(down.slope + 0.5 * down.bend)
        if promise <= max(run.goal, problem.here.noise):
            detail = f"So is the decrease that negative curvature promises along the direction found, {promise:.2g}."
            raise EndFound(Outcome(status, detail, max(expected, promise)))
        return down

    def _unless_close(self, newton: Direction, status: Status) -> Direction:
        """Return the direction of Newton's undamped model, unless it leads hardly any further down: then it ends."""
        run, problem, expected = self.run, self.run.problem, -newton.slope
        enough = max(run.goal, problem.here.noise)
        if run.stalled:
            enough = max(enough, _STALLED_CLOSE * abs(problem.here.value))
        if expected <= enough:
            raise EndFound(Outcome(status, expected=expected))
        if run.state.still >= problem.stages.patience + _STALLED_STEPS:
            detail = "The cost has not fallen for several steps."
            raise EndFound(Outcome(Status.LINE_SEARCH_FAILED, detail, expected))
        return newton

    def foretold(self, before: NewtonSchedule, expected: float, agreement: float) -> Outcome | None:
        """Return that it has converged where the next step can be foretold to be too short to matter.

        ``before``: the schedule before a full step of Newton's method. ``expected``, ``agreement``: of that step.
        """
        share = abs(agreement - 1.0)
        if not share < _RIGHT:
            return None
        following = max(_after_newton(expected, before), _MISSED * share**2 * expected)
        return Outcome(Status.CONVERGED, expected=following) if following <= _FORETOLD * self.run.goal else None


def _after_newton(expected: float, before: NewtonSchedule) -> float:
    """Return the decrease that is to be expected after a full step of Newton's method; infinity if nothing tells it.

    Newton's method squares it, but for a factor. The full step before tells the most that this may be, whichever its
    model was. ``expected``: that before Newton's step. ``before``: the schedule then.
    """
    if not before.full:
        return np.inf
    ratio = expected / before.expected
    return expected * ratio * ratio  # products overflow to infinity, powers of floats in an error
