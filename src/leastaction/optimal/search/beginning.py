"""Where a search in steps of time begins, and begins again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.frozen import changed, made
from leastaction.numerics.pool import copied
from leastaction.optimal.iterates.curve import CurveSteps, Gapped
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.leeway import may_be_obstacle, stands_still
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.start import depths
from leastaction.optimal.line_search import Refusal
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.search.parts import SearchParts
from leastaction.optimal.space import apart, sizes_of
from leastaction.optimal.state import NOT_BEGUN, Begun, Gaps, Place, SearchState, Start

_LOST = 10.0  # factor in cost by which a projection has lost a curve
_LEFT_BEHIND = 0.1  # distance, in parts of the states' sizes, by which a projection has left a curve
_AHEAD = 5  # iterations without obstacles, after which it is seen whether they stand in the way
_LONGEST_INSTEAD = 100  # iterations with gaps that take the place of a search that was stuck


class Beginning:
    """How a search begins: with a trajectory, a curve with gaps, an earlier result; and from where it begins again.

    ``found_with``: returns what some iterations with other limits lead to from the iterate, as of `DiscreteProblem`.
    ``gapped``, ``final_time``: as of it. ``note``: what is to be said of where it starts.
    """

    def __init__(
        self,
        parts: SearchParts,
        gapped: Gapped,
        final_time: int | None,
        found_with: Callable[[list[Rows], int], OptimizationResult | None],
    ) -> None:
        self.parts, self.gapped, self.final_time, self.found_with = parts, gapped, final_time, found_with
        self.begun = NOT_BEGUN
        self.note = ""

    def renew(self) -> None:
        """Be as if nothing had begun."""
        self.begun = NOT_BEGUN
        self.note = ""

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result.

        They have been looked through, and nobody else writes to them.
        """
        found = initial if isinstance(initial, OptimizationResult) else None
        x, u = map(read_only, (found.x, found.u) if found is not None else initial)
        self._set_out_from(x, u)
        if self.parts.barrier is not None:
            self.parts.barrier.limited.check(self.parts.barrier.limits(), self.parts.system.when)
            self.put_limits_in(found)
        if self.parts.curve is None:
            self.remember(first=made(Start, x=self.parts.x, u=self.parts.u))
        if self.parts.barrier is None:
            return
        curve = made(Start, x=x, u=u)
        given = self.begun.given if self.final_time is None else curve
        if given is None:
            self.remember(curve=curve)
            return
        given = given if found is None else changed(given, was_found=True)
        self.remember(curve=curve, given=given, wanted=self._wanted_from(given))

    def remember(self, **values: Any) -> None:
        """Remember something else of where it began, or may begin again."""
        self.begun = changed(self.begun, **values)

    def _wanted_from(self, start: Start) -> Start | None:
        """Return the wanted motion, from the state that a start holds; None of another start, or if it is not known."""
        wanted = self.parts.asked.wanted_states
        if wanted is None or start.x.ndim > 1 or self.final_time is not None:
            return None
        x = copied(wanted)
        x[0] = start.x
        return made(Start, x=read_only(x), u=start.u)

    def _set_out_from(self, x: Array, u: Array) -> None:
        """Stand at a start without limits: a curve or its projection, whichever is asked for and can be."""
        if self.gapped == "never":
            self.parts.stand_at(x, u)
            return
        given = made(Start, x=x, u=u)
        self.remember(given=given)
        failure: ProjectionError | None = None
        if self.gapped != "at once":
            try:
                self.parts.stand_at(x, u)
                lost = self._is_lost(x, u)
                self.remember(given=changed(given, is_lost=lost))
                # Within limits gaps close by short steps, as the first barriers leave them little room.
                at_once = lost and self.parts.barrier is None
                if not (at_once or (self.gapped == "where left" and self._has_left(x))):
                    return
            except ProjectionError as error:
                failure = error
            self.parts.models.forget()
        refusal = self.parts.open(given)
        if refusal is not None:
            if failure is not None:
                raise failure
            self.note = f"projected at once, as {refusal.reason}"
            self.parts.stand_at(x, u)
        elif failure is not None:
            self.note = f"begins with gaps between its steps, as a projection is not possible ({failure})"
        elif self.gapped == "where needed":
            self.note = "begins with gaps between its steps, as its projection is lost"

    def _is_lost(self, x: Array, u: Array) -> bool:
        """Whether the projection of a curve costs many times as much as the curve."""
        return x.ndim == 2 and self.parts.here.value > _LOST * self.parts.plain.cost.value(x, u)

    def _has_left(self, x: Array) -> bool:
        """Whether the projection of a start has left the curve that it is."""
        space = self.parts.models.space
        if x.ndim == 1:
            return False
        return bool((np.abs(apart(space, self.parts.x, x)).max(axis=0) > _LEFT_BEHIND * sizes_of(space, x)).any())

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        state, here = result.state or SearchState(), self.parts.here
        self.recall(state.begun)
        if self.gapped != "never" and state.gaps is not None:
            self.recall_gaps(state.gaps)
        else:
            system = self.parts.system
            N, nx, nu = system.N, system.nx, system.nu
            if result.gap > 0.0:
                raise ArgumentError(
                    f"resume: got a result with open gaps (of {result.gap:.2g}), expected a trajectory: give "
                    "shooting='multiple', or initial=(result.x, result.u), which is projected"
                )
            x = as_array(result.x, "resume.x", (N + 1, nx), meaning="(N+1, nx)")
            u = as_array(result.u, "resume.u", (N, nu), meaning="(N, nu)")
            here.move(x, u, result.worst_step)
            shape = (N, nu, system.ndx)
            here.gain = as_array(result.projection_gain, "resume.projection_gain", shape, meaning="(N, nu, ndx)")
            here.value = self.parts.plain.cost.value(here.x, here.u)
        if self.parts.barrier is not None:
            self.put_limits_in(result, resumed=True)

    def recall_gaps(self, gaps: Gaps) -> None:
        """Stand at a curve with gaps again."""
        self.parts.curve = curve = CurveSteps(self.parts.models, gaps.size, gaps.longest)
        found = curve.evaluate(gaps.x, gaps.u)
        if isinstance(found, Refusal):
            raise ArgumentError(f"resume: {found.reason}; expected the result of a run with this system")
        curve.recall(gaps, found)
        self.parts.models.tells_saddles = False

    def recall(self, begun: Begun) -> None:
        """Go on from where an earlier run began."""
        self.begun = begun
        self.parts.set_ease(begun.ease)

    # ---- Limits ---------------------------------------------------------------------------------

    def put_limits_in(self, found: OptimizationResult | None = None, *, resumed: bool = False) -> None:
        """Put the limits in at the trajectory, or the curve, to start from; without any there are none.

        ``found``: an earlier result, whose duals are known. ``resumed``: whether this is where it ended.
        """
        barrier, x, u = self.parts.barrier, self.parts.x, self.parts.u
        if barrier is None:
            return
        if not resumed:
            barrier.lend([(x, u), *self._ahead()])
        # Costs are those of the plain merit still: of a trajectory the value itself.
        shown = self.parts.plain.plain_value()
        barrier.stages.begin(
            shown,
            barrier.limits(),
            lambda: self.parts.asked.value(np.zeros_like(self.parts.x), np.zeros_like(self.parts.u)),
            depths(self.parts.rows, barrier.asked(), x, u),
        )
        for rows in self.parts.rows:
            rows.check(x, u)
            rows.check_start(x[0])
        self.parts.put_in(barrier, shown)
        if found is not None:
            barrier.stages.take(found.limits, resumed=resumed, changed=abs(shown - found.cost))
            barrier.forget_leeway()
        self.parts.set_out()

    def _ahead(self) -> list[tuple[Array, Array]]:
        """Return where a few iterations without obstacles lead from a start that does not say how to pass them."""
        x, u = self.parts.x, self.parts.u
        obstacles = [rows for rows in self.parts.rows if may_be_obstacle(rows, x, u)]
        if self.parts.here.is_open or not any(stands_still(rows, x, u) for rows in obstacles):
            return []
        found = self.found_with([rows for rows in self.parts.rows if rows not in obstacles], _AHEAD)
        return [] if found is None else [(found.x, found.u)]

    # ---- Elsewhere ------------------------------------------------------------------------------

    def go_to(self, place: Place) -> None:
        """Stand at a place again, and put the limits in there."""
        self.parts.put_out()
        self.parts.go_back(place)
        self.put_limits_in()

    def begin_at(self, x: Array, u: Array) -> bool:
        """Begin again at the projection of a curve; whether there is one."""
        now = self.parts.place()
        self.parts.put_out()
        try:
            self.parts.stand_at(x, u)
        except LeastActionError:
            self.go_to(now)
            return False
        self.put_limits_in()
        return True

    def go_on_from(self, x: Array, u: Array, report: LimitReport | None) -> None:
        """Begin the last stage at a trajectory; ``report``: of the limits there, where their duals are known."""
        self.parts.set_ease(1.0)
        self.parts.put_out()
        self.parts.stand_at(x, u)
        self.put_limits_in()
        if report is not None and self.parts.barrier is not None:
            self.parts.barrier.stages.take(report, resumed=False)
            self.parts.set_out()

    # ---- Gaps -----------------------------------------------------------------------------------

    def begin_with_gaps(self, longest: int | None = None) -> bool:
        """Begin again with gaps from the given start, once, and return whether that can be done.

        ``longest``: iterations that they have to close in.
        """
        given, here = self.begun.given, self.parts.here
        if self.parts.ease != 1.0 or self.final_time is not None:
            return False
        if here.is_open or given is None:
            if self.parts.barrier is not None:
                self._try_wanted()
            return False
        now, value = self.parts.place(), self.parts.here.value
        try:
            refused = self.parts.open(given, still=self.parts.barrier is not None) is not None
        except BaseException as error:  # an interruption too leaves it where it stood
            self.parts.curve = None
            here.move(now.x, now.u, now.worst_step)
            here.gain, here.value = now.gain, value
            if not isinstance(error, LeastActionError):
                raise
            refused = True
        if refused:
            self._try_wanted()
            return False
        self.remember(earlier=now)
        self.parts.models.forget()
        curve = self.parts.curve
        assert curve is not None
        curve.longest = longest or _LONGEST_INSTEAD
        self.put_limits_in()
        return True

    def _try_wanted(self) -> None:
        """Have gaps tried from the wanted motion next, where an initial state alone was given; once."""
        self.remember(given=self.begun.wanted, wanted=None)

    def _stands_at_given(self) -> bool:
        """Stand at the projection of the given start; whether there is one."""
        given = self.begun.given
        if given is None:
            return False
        try:
            self.parts.stand_at(given.x, given.u)
        except LeastActionError:
            if given.x.ndim == 1:  # inputs that cannot be simulated are no start
                raise
            return False
        return True

    def leave_gaps(self) -> bool:
        """Go on over trajectories, where the gaps are closed or cannot be; whether it is where they led.

        If not, it is back where it stood before: only closed gaps are worth leaving a place that costs less. Where
        there is no trajectory to stand at, gaps may stay open for as long as it takes.
        """
        curve, begun = self.parts.curve, self.begun
        assert curve is not None
        closed, x, u, open_still = curve.are_closed, self.parts.x, self.parts.u, curve.state()
        self.parts.models.costates = None
        try:
            self.parts.forget_gaps()
            self.parts.stand_along(x, u)
        except LeastActionError:
            closed = False
            if begun.earlier is not None:
                self.parts.here.value = np.inf
            elif not self._stands_at_given():
                self.recall_gaps(changed(open_still, longest=None))
                return curve.longest is not None
        self.parts.models.forget()
        earlier = begun.earlier
        self.remember(earlier=None, given=None)
        here, minimised = self.parts.here, self.parts.minimised
        cheaper = earlier is None or minimised(here.x, here.u, here.value) < minimised(earlier.x, earlier.u)
        back = not (closed or cheaper)
        if back:
            assert earlier is not None
            self.go_to(earlier)
        if not closed:
            self._try_wanted()
        self.parts.set_out()
        return not back
