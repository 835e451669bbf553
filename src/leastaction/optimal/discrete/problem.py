"""A discrete system, its cost and its limits, as the optimiser's loop sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError, ProjectionError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.frozen import changed
from leastaction.numerics.step_quality import StepQuality
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.curve import CurveSteps, Gapped
from leastaction.optimal.discrete.direction import DiscreteDirection, Iterate
from leastaction.optimal.discrete.free_start import FreeStart
from leastaction.optimal.discrete.grid import OwnSteps, TimeGrid
from leastaction.optimal.discrete.here import Here
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution, regulate
from leastaction.optimal.discrete.merit import CostMerit, Merit
from leastaction.optimal.discrete.models import Models
from leastaction.optimal.discrete.projected import project_curve, projection_of
from leastaction.optimal.discrete.stages import DiscreteStages
from leastaction.optimal.discrete.steps import Steps
from leastaction.optimal.discrete.system import DiscreteSystem, Rollout, given_start, told_of
from leastaction.optimal.discrete.trajectory import TrajectorySteps
from leastaction.optimal.discrete.work import Work
from leastaction.optimal.initial import pair_of
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.leeway import may_be_obstacle, stands_still
from leastaction.optimal.limits.merit import BarrierMerit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.start import barrier_merit, depths
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Clock, Loop, Problem
from leastaction.optimal.memory import Memory, Place, Start
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult, Status

_LOST = 10.0  # factor in cost by which a projection has lost a curve
_SAME = 1e-6  # relative difference of a cost from that of a start that was found, by which it is another cost
_SHORTER = 0.7  # part of what a motion lasts that a step of the search takes off at most
_DEARER = 20.0  # price of what is asked at one instant, over that of others, where steps of time may shrink
_AHEAD = 5  # iterations without obstacles, after which it is seen whether they stand in the way
_LONGEST_INSTEAD = 100  # iterations with gaps that take the place of a search that was stuck


@dataclass
class Begun:
    """What a search began with, and where it may begin again.

    ``given``: the start, until gaps were tried from there. ``curve``: what was
    given to begin with, where there are limits. ``wanted``: what gaps are tried from once more. ``first``:
    the trajectory that it began with. ``earlier``: where it stood before there were gaps.
    """

    given: Start | None = None
    curve: Start | None = None
    wanted: Start | None = None
    first: Start | None = None
    earlier: Place | None = None


class DiscreteProblem(Problem[LinearQuadraticSolution, DiscreteDirection, Iterate]):
    """A discrete system, its cost and its limits, at the current iterate.

    It is put together from what differs: the `merit` says what is minimised, `steps` how iterates follow each other,
    the `grid` which times they stand for; `stages` says what is so in this stage.

    Parameters
    ----------
    system : DiscreteSystem
    cost : Cost
    settings : Options
    rows : sequence of Rows
        Of limits.
    free_start : bool or sequence of str
        Whether the initial state is found too, or which of its entries.
    gapped : {"never", "where needed", "at once"}
        When steps may have gaps.
    final_time : int, optional
        The place in the state of the time (s) at which the motion ends, if that is found too. The motion may then be
        made to last ever shorter, which also costs ever less: only the price of what is not reached stands against a
        motion of no time at all, where every search ends. It has to be high from the beginning, and higher still where
        a search ends so.
    dearer : float, optional
        Price of what is asked at a single instant, over that of others, at first.
    grid : TimeGrid, optional
        The times of the steps; the system's own if left out.
    work : Work, optional
        Memory of such a problem that is not searched any more.
    """

    stages: DiscreteStages

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Options,
        rows: Sequence[Rows] = (),
        free_start: bool | Sequence[str] = False,
        gapped: Gapped = "never",
        *,
        final_time: int | None = None,
        dearer: float | None = None,
        grid: TimeGrid | None = None,
        work: Work | None = None,
    ) -> None:
        self.system, self.asked, self.settings, self.rows = system, cost, settings, tuple(rows)
        self.gapped, self.final_time, self.grid = gapped, final_time, grid or OwnSteps()
        self.has_curvature, self.begins_again = system.has_curvature, not self.grid.is_mesh
        sizes = (system.N, system.nx, system.nu)
        self.work = work or Work(*sizes, own_gains=settings.regulator == "lqr")
        self.here = Here()
        self.plain = CostMerit(cost, self.here)
        self.barrier: BarrierMerit | None = None
        if rows:
            dearer = dearer or (1.0 if final_time is None else _DEARER)
            self.barrier = barrier_merit(system, cost, self.rows, self.here, settings, dearer)
        self.models = Models(system, self.plain, self.here, self.work, FreeStart(system, free_start))
        self.trajectory_steps = TrajectorySteps(self.models, settings.chunk)
        self.renew()

    def renew(self) -> None:
        """Be as if nothing had been searched."""
        self.begun = Begun()
        self.ease = 1.0
        self.note = ""
        self.is_drowned = self.begins_at_minimum = False
        self.here.curve, self.here.worst_step, self.here.roughness = None, None, 0.0
        self.steps: Steps = self.trajectory_steps
        self.stages = DiscreteStages(self)
        self.plain.replaced(self.asked)
        self.models.costates = None
        self._put_out()
        if self.barrier is not None:
            self.barrier.stages.renew()

    def related(self, rows: Sequence[Rows], cost: Cost | None = None, **settings: Any) -> DiscreteProblem:
        """Return the problem with other limits and settings, and perhaps another cost."""
        other = self.settings.changed(**settings)
        return DiscreteProblem(
            self.system, cost or self.asked, other, rows, self.free_start, final_time=self.final_time
        )

    # ---- Parts ------------------------------------------------------------------------------------

    @property
    def merit(self) -> Merit:
        """What is minimised now."""
        return self.models.merit

    @property
    def limits(self) -> BarrierMerit | None:
        """The merit with limits, where they have been put in."""
        return self.barrier if self.merit is self.barrier else None

    @property
    def curve(self) -> CurveSteps | None:
        """The steps of curves, where there are gaps."""
        return self.steps if isinstance(self.steps, CurveSteps) else None

    @property
    def free_start(self) -> bool | Sequence[str]:
        """Whether the initial state is found too, or which of its entries."""
        return self.models.start.free

    @property
    def clock(self) -> Clock:
        return self.work.clock

    @property
    def rollouts(self) -> int:
        return self.work.rollouts

    # ---- Where it stands --------------------------------------------------------------------------

    @property
    def x(self) -> Array:
        """States (N+1, nx) of the iterate."""
        return self.here.x

    @property
    def u(self) -> Array:
        """Inputs (N, nu) of the iterate."""
        return self.here.u

    @property
    def value(self) -> float:
        return self.here.value

    @property
    def shown(self) -> float:
        return self.merit.plain_value() if self.ease == 1.0 else self.asked.value(self.x, self.u)

    @property
    def magnitude(self) -> float:
        # Barriers are known up to a constant, and may be of either sign.
        return self.here.value if self.limits is None else self.shown

    @property
    def noise(self) -> float:
        return self.here.noise

    @property
    def roughness(self) -> float:
        return self.here.roughness

    def note_roughness(self, off: float) -> None:
        self.here.roughness = off

    @property
    def gap(self) -> float:
        return 0.0 if self.curve is None else self.curve.gap

    @property
    def worst_step(self) -> StepQuality | None:
        return self.here.worst_step

    @property
    def sees_walls(self) -> bool:
        return self.merit.sees_walls

    @property
    def undetermined(self) -> str:
        return self.models.start.undetermined

    # ---- Where to start ---------------------------------------------------------------------------

    def start(self, initial: Any) -> None:
        """Begin with a trajectory, a curve to be projected, an initial state and inputs, or an earlier result."""
        found = initial if isinstance(initial, OptimizationResult) else None
        if found is not None:
            initial = found.x, found.u
        self._set_out_from(initial)
        if self.barrier is not None:
            for rows, values in zip(self.rows, self.barrier.limits(), strict=True):
                rows.check_values(values, self.system.when)
            self.put_limits_in(found)
        begun = self.begun
        if self.curve is None:
            begun.first = Start(self.x, self.u)
        if self.barrier is None:
            return
        # What was found with another cost is no minimum of this one.
        same = found is not None and abs(self.shown - found.cost) <= _SAME * abs(found.cost)
        self.begins_at_minimum = found is not None and found.success and same
        x, u = pair_of(initial)
        begun.curve = Start(read_only(np.array(x, dtype=np.float64)), read_only(np.array(u, dtype=np.float64)))
        if self.final_time is not None:
            begun.given = begun.curve
        if begun.given is not None:
            begun.given = replace(begun.given, was_found=found is not None)
            begun.wanted = self._wanted_from(begun.given)

    def _wanted_from(self, start: Start) -> Start | None:
        """Return the wanted motion, from the state that a start holds; None of another start, or if it is not known."""
        wanted = self.asked.wanted_states
        if wanted is None or start.x.ndim > 1 or self.final_time is not None:
            return None
        return Start(read_only(np.concatenate([start.x[None], wanted[1:]])), start.u)

    def _set_out_from(self, initial: Any) -> None:
        """Stand at a start without limits: a curve or its projection, whichever is asked for and can be."""
        if self.gapped == "never":
            self.stand_at(initial)
            return
        x, u = given_start(self.system, initial)
        begun = self.begun
        begun.given = Start(x, u)
        failure: ProjectionError | None = None
        if self.gapped == "where needed":
            try:
                self.stand_at((x, u))
                lost = x.ndim == 2 and self.value > _LOST * self.plain.cost.value(x, u)
                begun.given = replace(begun.given, is_lost=lost)
                return
            except ProjectionError as error:
                failure = error
            self.models.forget()
        refusal = self._open(begun.given)
        if refusal is not None:
            if failure is not None:
                raise failure
            self.note = f"projected at once, as {refusal.reason}"
            self.stand_at((x, u))
        elif failure is not None:
            self.note = f"begins with gaps between its steps, as a projection is not possible ({failure})"

    def stand_at(self, initial: Any) -> None:
        """Stand at the projection of a start, with what is minimised now."""
        x, u = given_start(self.system, initial)
        N, nx, nu = self.system.N, self.system.nx, self.system.nu
        made: Rollout | None = None
        if x.ndim == 1:
            made = projection_of(self.models, np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, nx)))
            x = made.x
        self.stand_along(x, u, made)
        if not np.isfinite(self.value):
            raise ProjectionError(
                f"initial: the cost of the initial trajectory is {self.value}, expected a finite "
                "number. Look at the cost's weights and wanted motion."
            )

    def stand_along(self, x: Array, u: Array, made: Rollout | None = None) -> None:
        """Stand at the projection of a curve; ``made``: the roll-out that it is, if it is known to be one."""
        self.steps = self.trajectory_steps
        self.here.move(x, u, self.worst_step)
        project_curve(self.models, made)
        self.here.value = self.merit.cost.value(self.x, self.u)

    def resume(self, result: OptimizationResult) -> None:
        """Begin where an earlier run ended."""
        memory, here = result.memory, self.here
        if memory is not None:
            self.recall(memory)
        if self.gapped != "never" and memory is not None and memory.gaps is not None:
            gaps = memory.gaps
            self.steps = curve = CurveSteps(self.models, gaps.size, gaps.longest)
            found = curve.evaluate(gaps.x, gaps.u)
            if isinstance(found, Refusal):
                raise ArgumentError(f"resume: {found.reason}; expected the result of a run with this system")
            curve.recall(gaps, found)
            self.tells_saddles = False
        else:
            N, nx, nu = self.system.N, self.system.nx, self.system.nu
            if result.gap > 0.0:
                raise ArgumentError(
                    f"resume: got a result with open gaps (of {result.gap:.2g}), expected a trajectory: give "
                    "shooting='multiple', or initial=(result.x, result.u), which is projected"
                )
            x = as_array(result.x, "resume.x", (N + 1, nx), meaning="(N+1, nx)")
            u = as_array(result.u, "resume.u", (N, nu), meaning="(N, nu)")
            here.move(x, u, result.worst_step)
            here.gain = as_array(result.projection_gain, "resume.projection_gain", (N, nu, nx), meaning="(N, nu, nx)")
            here.value = self.plain.cost.value(here.x, here.u)
        if self.barrier is not None:
            self.put_limits_in(result, resumed=True)

    def recall(self, memory: Memory) -> None:
        """Remember what an earlier run did of its way."""
        self.begun = Begun(memory.start, memory.curve, memory.wanted, memory.first, memory.earlier)
        self.set_ease(memory.ease)

    # ---- Limits -----------------------------------------------------------------------------------

    def put_limits_in(self, found: OptimizationResult | None = None, *, resumed: bool = False) -> None:
        """Put the limits in at the trajectory, or the curve, to start from; without any there are none.

        ``found``: an earlier result, whose duals are known. ``resumed``: whether this is where it ended.
        """
        barrier = self.barrier
        if barrier is None:
            return
        if not resumed:
            ahead = self._ahead()
            barrier.forget_leeway()
            barrier.duals.leeway.lend(self.rows, [(self.x, self.u), *ahead])
        # Costs are those of the plain merit still: of a trajectory the value itself.
        shown = self.plain.plain_value()
        barrier.stages.begin(
            shown,
            barrier.limits(),
            lambda: self.asked.value(np.zeros_like(self.x), np.zeros_like(self.u)),
            depths(self.rows, barrier.asked(), self.x, self.u),
        )
        for rows in self.rows:
            rows.check(self.x, self.u)
            rows.check_start(self.x[0])
        self.models.merit = barrier
        if found is not None:
            barrier.stages.take(found.limits, resumed=resumed, changed=abs(shown - found.cost))
        barrier.forget_leeway()
        self.set_out()

    def _ahead(self) -> list[tuple[Array, Array]]:
        """Return where a few iterations without obstacles lead from a start that does not say how to pass them."""
        obstacles = [rows for rows in self.rows if may_be_obstacle(rows, self.x, self.u)]
        if self.here.is_open or not any(stands_still(rows, self.x, self.u) for rows in obstacles):
            return []
        found = self.found_with([rows for rows in self.rows if rows not in obstacles], _AHEAD)
        return [] if found is None else [(found.x, found.u)]

    def _put_out(self) -> None:
        """Take the limits out, to start elsewhere."""
        self.models.forget()
        if self.barrier is not None:
            self.barrier.forget()
        self.models.merit = self.plain
        self.set_saddles()

    def found_with(self, rows: list[Rows], iterations: int, *, tolerance: float = 0.0) -> OptimizationResult | None:
        """Return what some iterations with other limits lead to from the iterate; None where that is nowhere.

        ``tolerance``: is enough, where a smaller one is asked for.
        """
        enough = max(tolerance, self.settings.tolerance)
        return self.found_by(self.related(rows, max_iterations=iterations, tolerance=enough), (self.x, self.u))

    def found_by(self, other: DiscreteProblem, start: tuple[Array, Array]) -> OptimizationResult | None:
        """Return what another problem leads to from a start, without beginning again; None where that is nowhere."""
        try:
            other.start(start)
            found = Loop(other, other.settings).run()
        except LeastActionError:
            return None
        self.work.rollouts += found.rollouts
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return found

    # ---- Elsewhere --------------------------------------------------------------------------------

    def place(self) -> Place:
        """Return where it stands."""
        return self.here.place()

    def go_to(self, place: Place) -> None:
        """Stand at a place again, and put the limits in there."""
        self._put_out()
        self.go_back(place)
        self.put_limits_in()

    def go_back(self, place: Place) -> None:
        """Stand at a place again, with what is minimised now."""
        here = self.here
        self.steps = self.trajectory_steps
        here.move(place.x, place.u, place.worst_step)
        here.gain = place.gain.copy()
        here.value = self.merit.cost.value(here.x, here.u)
        self.models.forget()

    def begin_at(self, x: Array, u: Array) -> bool:
        """Begin again at the projection of a curve; whether there is one."""
        now = self.place()
        self._put_out()
        try:
            self.stand_at((x, u))
        except LeastActionError:
            self.go_to(now)
            return False
        self.put_limits_in()
        return True

    def begin_anew(self, start: Start) -> None:
        """Begin again from a start, without limits as yet."""
        self._put_out()
        self._set_out_from((start.x, start.u))

    def go_on_from(self, x: Array, u: Array, report: LimitReport | None) -> None:
        """Begin the last stage at a trajectory; ``report``: of the limits there, where their duals are known."""
        self.set_ease(1.0)
        self._put_out()
        self.stand_at((x, u))
        self.put_limits_in()
        if report is not None and self.barrier is not None:
            self.barrier.stages.take(report, resumed=False)
            self.set_out()

    # ---- Gaps -------------------------------------------------------------------------------------

    def begin_with_gaps(self, longest: int | None = None) -> bool:
        """Begin again with gaps from the given start, once, and return whether that can be done.

        ``longest``: iterations that they have to close in.
        """
        begun, given, here = self.begun, self.begun.given, self.here
        if self.ease != 1.0 or self.final_time is not None:
            return False
        if here.is_open or given is None:
            if self.barrier is not None:
                self._try_wanted()
            return False
        now, value = self.place(), self.value
        try:
            refused = self._open(given, still=self.barrier is not None) is not None
        except BaseException as error:  # an interruption too leaves it where it stood
            self.steps = self.trajectory_steps
            here.move(now.x, now.u, now.worst_step)
            here.gain, here.value = now.gain, value
            if not isinstance(error, LeastActionError):
                raise
            refused = True
        if refused:
            self._try_wanted()
            return False
        begun.earlier = now
        self.models.forget()
        curve = self.curve
        assert curve is not None
        curve.longest = longest or _LONGEST_INSTEAD
        self.put_limits_in()
        return True

    def _try_wanted(self) -> None:
        """Have gaps tried from the wanted motion next, where an initial state alone was given; once."""
        self.begun.given, self.begun.wanted = self.begun.wanted, None

    def _open(self, start: Start, *, still: bool = False) -> Refusal | None:
        """Stand at a curve with its gaps, or return why that is not possible.

        ``still``: whether an initial state alone is held, and not the motion that it leads to.
        """
        N, nx, nu = self.system.N, self.system.nx, self.system.nu
        x, u = start.x, start.u
        if x.ndim == 1 and still:
            x = np.tile(x, (N + 1, 1))
        elif x.ndim == 1:
            run = self.system.rollout(x, np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, nx)), 0, N)
            self.work.rollouts += 1
            # What leads to a step that cannot be made is too violent to begin with: it stands still instead.
            x = run.x if run.complete else np.tile(x, (N + 1, 1))
        steps = CurveSteps(self.models, 1.0 + np.abs(x).max(axis=0))
        curve = steps.evaluate(x, u)
        if isinstance(curve, Refusal):
            return curve
        steps.begin(curve)
        self.steps, self.tells_saddles = steps, False
        return None

    def leave_gaps(self) -> bool:
        """Go on over trajectories, where the gaps are closed or cannot be; whether it is where they led.

        If not, it is back where it stood before: only closed gaps are worth leaving a place that costs less.
        """
        curve, begun = self.curve, self.begun
        assert curve is not None
        closed, x, u = curve.are_closed, self.x, self.u
        self.models.costates = None
        try:
            self._forget_gaps()
            self.stand_along(x, u)
        except LeastActionError:
            closed = False
            if begun.earlier is not None:
                self.here.value = np.inf
            elif begun.given is not None:
                self.stand_at((begun.given.x, begun.given.u))
            else:
                raise
        self.models.forget()
        earlier, begun.earlier, begun.given = begun.earlier, None, None
        back = not (
            closed or earlier is None or self._asked(self.x, self.u, self.value) < self._asked(earlier.x, earlier.u)
        )
        if back:
            assert earlier is not None
            self.go_to(earlier)
        if not closed:
            self._try_wanted()
        self.set_out()
        return not back

    def _forget_gaps(self) -> None:
        """Stand at the states and inputs of a curve, to be projected."""
        self.steps = self.trajectory_steps
        self.here.move(self.x, self.u, self.worst_step)
        self.models.forget()

    def _asked(self, x: Array, u: Array, cost: float | None = None) -> float:
        """Return what is minimised in the end along a trajectory; ``cost``: its cost, if that is known."""
        return (self.merit.cost.value(x, u) if cost is None else cost) + self.merit.guide(x, u)

    # ---- Stages -----------------------------------------------------------------------------------

    def set_ease(self, ease: float) -> None:
        """Take a stage in which inputs are that much dearer than asked for, where the cost offers one."""
        eased = None if ease == 1.0 or self.barrier is not None else self.asked.eased(ease)
        self.ease, cost = (1.0, self.asked) if eased is None else (ease, eased[0])
        if cost is not self.plain.cost:
            self.plain.replaced(cost)
        self.set_saddles()

    def ease_off(self, stride: float) -> None:
        """Go on with inputs that are less dear."""
        self.set_ease(max(1.0, self.ease / stride))
        self.here.value = self.plain.cost.value(self.x, self.u)
        self.models.forget_stage()

    def set_saddles(self) -> None:
        """Have models tell saddles in stages where these matter: in the last, and where obstacles grow."""
        matters = self.ease == 1.0 and not self.here.is_open
        if self.limits is not None:
            stages, of_bent = self.limits.stages, self.grid.is_mesh and bool(self.limits.limited.others)
            matters = matters and (stages.is_last or self.limits.duals.leeway.is_lent)
            # Along a limit that is bent there is a way down from a saddle as far as its barrier is soft: later, none.
            matters = matters or of_bent
        self.tells_saddles = self.has_curvature and matters

    def set_out(self) -> None:
        """Begin a stage: another cost, the same dynamics."""
        self.set_saddles()
        self.models.forget_stage()
        limits, curve = self.limits, self.curve
        if limits is None:
            return
        if curve is not None:
            curve.cost_again(limits.value())
        else:
            self.here.value = limits.value()

    def following(self, *, moved: bool) -> DiscreteProblem | None:
        more = self.stages.advance(moved=moved)
        return self if more else self.grid.following(self)

    # ---- Directions -------------------------------------------------------------------------------

    def minimise_model(self, method: str, scale: float, shift: float = 0.0) -> LinearQuadraticSolution:
        model = self.models.minimise(method, scale, shift)
        # In exact numbers a convex model has a minimum.
        is_lost = method == "quasi-newton" and not model.definite
        self.is_drowned = self.limits is not None and (is_lost or model.smallest_eigenvalue > 0.0)
        if self.is_drowned:
            # Beside stiff limits the rest of the curvature is lost in rounding: this is no saddle.
            self.tells_saddles = False
        return model

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        return self.merit.followed(self.steps.direction(method, model, scale, shift), self.models)

    def refined(self, direction: DiscreteDirection, *, holds: bool) -> DiscreteDirection:
        return self.merit.refined(direction, self.models, holds=holds)

    def negative_curvature(self, scale: float) -> DiscreteDirection | None:
        return self.models.negative_curvature(scale)

    def left_beside_rounding(self) -> float:
        limits = self.limits
        if self.here.is_open or limits is None or not self.has_curvature:
            return np.inf
        return limits.left_beside_rounding(self.models)

    def where(self, direction: DiscreteDirection) -> str:
        return self.models.where(direction)

    # ---- Steps ------------------------------------------------------------------------------------

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        if self.final_time is not None and direction.dx0 is not None:
            # No model holds as far as to a motion that lasts much shorter.
            lasts, change = self.x[0, self.final_time] - self.system.time(0), direction.dx0[self.final_time]
            if length * change < -_SHORTER * lasts:
                length = float(-_SHORTER * lasts / change)
        return self.steps.first_step(direction, length)

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        return self.steps.simulate(direction, length, bound)

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        return self.steps.promised(direction, length)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        self.steps.accept(direction, trial)
        self.grid.note_step()

    def keep_feedback(self, direction: DiscreteDirection) -> None:
        self.models.feedback = direction.gain
        if self.limits is not None:
            self.limits.are_settled = True

    def forget(self) -> None:
        self.models.forget()

    # ---- What is told -----------------------------------------------------------------------------

    def arrays(self) -> tuple[Array, Array]:
        return self.grid.arrays(self.here)

    def result(self, summary: dict[str, Any]) -> OptimizationResult:
        return self.grid.result(self, summary)

    def told(self, summary: dict[str, Any]) -> OptimizationResult:
        """Return the result in steps of time: at the iterate, or where it stood before, while there are gaps."""
        feedback = self.models.feedback
        if feedback is None:
            feedback = self._final_feedback()
        here, before = self.here, self.begun.earlier
        result = OptimizationResult(
            x=here.x, u=here.u, K=feedback, projection_gain=here.gain, gap=self.gap, memory=self.memory(),
            limits=self.report() if self.rows else None, **summary, **told_of(self.system),
        )  # fmt: skip
        if here.is_open and before is not None:
            return changed(
                result, x=before.x, u=before.u, K=before.gain, projection_gain=before.gain,
                cost=self.asked.value(before.x, before.u), worst_step=before.worst_step, gap=0.0,
            )  # fmt: skip
        return result

    def _final_feedback(self) -> Array:
        """Return gains about the last iterate, for a run that ended before it had any."""
        try:
            solution = self.models.solve("quasi-newton", self.work.free)
            return solution.K if solution.definite else regulate(*self.models.linearize())
        except LeastActionError:
            return self.here.gain

    def memory(self) -> Memory:
        """Return what resuming needs beside the iterate."""
        begun, curve = self.begun, self.curve
        return Memory(
            start=begun.given, curve=begun.curve, wanted=begun.wanted, first=begun.first, earlier=begun.earlier,
            ease=self.ease, gaps=None if curve is None else curve.memory(),
        )  # fmt: skip

    def report(self) -> LimitReport:
        """Return what is told of the limits."""
        limits = self.limits
        assert limits is not None
        earlier = self.begun.earlier if self.here.is_open else None
        return limits.report(self.models, newton=self.has_curvature, at=earlier)
