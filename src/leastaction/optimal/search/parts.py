"""What a search in steps of time is put together from, and where it stands."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np

from leastaction.errors import ProjectionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.pool import empty, zeros
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.own_projection import own_projection
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem, told_of
from leastaction.optimal.iterates.curve import CurveSteps
from leastaction.optimal.iterates.free_start import FreeStart
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.iterates.merit import CostMerit, Merit
from leastaction.optimal.iterates.models import Models
from leastaction.optimal.iterates.projected import project_curve, projection_of
from leastaction.optimal.iterates.trajectory import TrajectorySteps
from leastaction.optimal.iterates.work import Work
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.charts import charted
from leastaction.optimal.limits.merit import BarrierMerit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.limits.start import barrier_merit
from leastaction.optimal.line_search import Refusal
from leastaction.optimal.options import Options
from leastaction.optimal.search.grid import TimeGrid
from leastaction.optimal.space import sizes_of
from leastaction.optimal.state import Place, Start


class SearchParts:
    """The parts of a search: each says what differs between one and another.

    ``merit``: what is minimised, the `plain` cost of a stage or the `barrier` of the limits; ``limits``: that, where
    they have been put in. ``steps``: how iterates follow each other; ``curve``: these, where there are gaps. ``grid``:
    which times they stand for. ``asked``: the cost that is to be minimised; ``ease``: how much dearer inputs are in
    this stage.

    Parameters
    ----------
    system, cost, settings, rows, free_start, final_time, dearer, grid, work
        As of `DiscreteProblem`.
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost,
        settings: Options,
        rows: Sequence[Rows],
        free_start: bool | Sequence[str],
        final_time: int | None,
        dearer: float,
        grid: TimeGrid,
        work: Work,
    ) -> None:
        self.system, self.asked, self.grid, self.work = system, cost, grid, work
        self.rows = tuple(charted(list(rows), system.charts()))
        self.here = Here()
        self.plain = CostMerit(cost, self.here)
        self.barrier: BarrierMerit | None = None
        self.limits: BarrierMerit | None = None
        if rows:
            self.barrier = barrier_merit(system, cost, self.rows, self.here, settings, dearer)
        own = own_projection(settings, system)
        self.models = Models(system, self.plain, self.here, work, FreeStart(system, free_start, final_time), own)
        self.trajectory_steps = TrajectorySteps(self.models, settings.chunk)
        self.renew()

    def renew(self) -> None:
        """Be as if nothing had been searched."""
        self.ease = 1.0
        self.here.renew()
        self.curve: CurveSteps | None = None
        self.plain.replaced(self.asked)
        self.models.costates = None
        self.put_out()
        if self.barrier is not None:
            self.barrier.stages.renew()

    @property
    def merit(self) -> Merit:
        """What is minimised now."""
        return self.models.merit

    @property
    def steps(self) -> CurveSteps | TrajectorySteps:
        """How iterates follow each other now."""
        return self.curve or self.trajectory_steps

    @property
    def free_start(self) -> bool | Sequence[str]:
        """Whether the initial state is found too, or which of its entries."""
        return self.models.start.free

    @property
    def x(self) -> Array:
        """States (N+1, nx) of the iterate."""
        return self.here.x

    @property
    def u(self) -> Array:
        """Inputs (N, nu) of the iterate."""
        return self.here.u

    def replace_cost(self, cost: Cost) -> None:
        """Search with another cost from now on, from the beginning."""
        self.asked = cost
        if self.barrier is not None:
            self.barrier.replaced(cost)
        self.renew()

    @cached_property
    def about(self) -> dict[str, Any]:
        """What results say of the system, which takes about as long to find as a model."""
        return told_of(self.system)

    @property
    def shown(self) -> float:
        """The cost of the iterate as it is told: that was asked for, without what only guides the search."""
        return self.merit.plain_value() if self.ease == 1.0 else self.asked.value(self.x, self.u)

    # ---- Where it stands ------------------------------------------------------------------------

    def stand_at(self, x: Array, u: Array) -> None:
        """Stand at the projection of a start, a curve or an initial state, with what is minimised now."""
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu
        made: Rollout | None = None
        if x.ndim == 1:
            still = empty((N + 1, len(x)))
            still[...] = x
            made = projection_of(self.models, still, u, zeros((N, nu, ndx)))
            x = made.x
        self.stand_along(x, u, made)
        if not isfinite(self.here.value):
            raise ProjectionError(
                f"initial: the cost of the initial trajectory is {self.here.value}, expected a finite "
                "number. Look at the cost's weights and wanted motion."
            )

    def stand_along(self, x: Array, u: Array, made: Rollout | None = None) -> None:
        """Stand at the projection of a curve; ``made``: the roll-out that it is, if it is known to be one."""
        self.curve = None
        self.here.move(x, u, self.here.worst_step)
        project_curve(self.models, made)

    def place(self) -> Place:
        """Return where it stands."""
        return self.here.place()

    def go_back(self, place: Place) -> None:
        """Stand at a place again, with what is minimised now."""
        here = self.here
        self.curve = None
        here.move(place.x, place.u, place.worst_step)
        here.gain = place.gain.copy()
        here.value = self.merit.cost.value(here.x, here.u)
        self.models.forget()

    def put_out(self) -> None:
        """Take the limits out, to start elsewhere."""
        self.models.forget()
        if self.barrier is not None:
            self.barrier.forget()
        self.models.merit, self.limits = self.plain, None
        self.set_saddles()

    def put_in(self, barrier: BarrierMerit, cost: float) -> None:
        """Minimise the cost with the barriers of the limits from now on; ``cost``: that alone, where it stands."""
        self.models.merit = self.limits = barrier
        barrier.note_cost(cost)

    def open(self, start: Start, *, still: bool = False) -> Refusal | None:
        """Stand at a curve with its gaps, or return why that is not possible.

        ``still``: whether an initial state alone is held, and not the motion that it leads to.
        """
        N, ndx, nu = self.system.N, self.system.ndx, self.system.nu
        x, u = start.x, start.u
        if x.ndim == 1 and still:
            x = np.tile(x, (N + 1, 1))
        elif x.ndim == 1:
            run = self.system.rollout(x, np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, ndx)), 0, N)
            self.work.rollouts += 1
            # What leads to a step that cannot be made is too violent to begin with: it stands still instead.
            x = run.x if run.complete else np.tile(x, (N + 1, 1))
        steps = CurveSteps(self.models, sizes_of(self.models.space, x))
        curve = steps.evaluate(x, u)
        if isinstance(curve, Refusal):
            return curve
        steps.begin(curve)
        self.curve, self.models.tells_saddles = steps, False
        return None

    def forget_gaps(self) -> None:
        """Stand at the states and inputs of a curve, to be projected."""
        self.curve = None
        self.here.move(self.x, self.u, self.here.worst_step)
        self.models.forget()

    def minimised(self, x: Array, u: Array, cost: float | None = None) -> float:
        """Return what is minimised in the end along a trajectory; ``cost``: its cost, if that is known."""
        return (self.merit.cost.value(x, u) if cost is None else cost) + self.merit.guide(x, u)

    # ---- Stages ---------------------------------------------------------------------------------

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
        self.models.tells_saddles = self.system.has_curvature and matters

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

    # ---- What is told ---------------------------------------------------------------------------

    def report(self, at: Place | None = None) -> LimitReport:
        """Return what is told of the limits; ``at``: as of `BarrierMerit`."""
        limits = self.limits
        assert limits is not None
        return limits.report(self.models, newton=self.system.has_curvature, at=at)
