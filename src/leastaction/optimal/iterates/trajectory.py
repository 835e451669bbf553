"""Iterates that are trajectories: a step along a direction is projected, and its cost decides how far to go."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import made
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution
from leastaction.optimal.iterates.direction import DiscreteDirection, Iterate
from leastaction.optimal.iterates.models import Models, least_of
from leastaction.optimal.iterates.trial import SHORT, leap, try_projection
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Steps


class TrajectorySteps(Steps[LinearQuadraticSolution, DiscreteDirection, Iterate]):
    """Steps from one trajectory to the next.

    ``chunk``: steps of time after each of which a trial is looked at.
    """

    def __init__(self, models: Models, chunk: int) -> None:
        self.models, self.chunk = models, chunk

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        models = self.models
        own_gain = models.own_gain()
        dx = du = None
        dx0 = models.start_step(model)
        if own_gain is not None:
            dx, du = models.sweep(model, dx0)
        models.feedback = model.K if own_gain is None else own_gain
        # The model's minimum is half of its linear part.
        slope = 2.0 * least_of(model, dx0)
        found = made(
            DiscreteDirection, method=method, slope=slope, curvature_scale=scale, shift=shift, gain=models.feedback,
            C=model.C, dx=dx, du=du, dx0=dx0,
        )  # fmt: skip
        return models.merit.followed(found, models)

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        models = self.models
        length = models.start.longest(direction.dx0, models.here.x[0], length)
        return models.merit.first_step(direction, length)

    def simulate(self, direction: DiscreteDirection, length: float, bound: float) -> Trial[Iterate] | Refusal:
        models, here = self.models, self.models.here
        xbar, ubar = direction.curve(models.space, here.x, here.u, length)
        x0 = xbar[0]
        if direction.dx0 is not None:
            try:
                x0 = models.system.moved_start(here.x[0], length * direction.dx0)
            except LeastActionError as error:
                return Refusal(f"the initial state cannot move so far: {error}", 0, failed=True)

        explain = partial(self._look_for_leap, direction, length)
        trial = try_projection(
            models.system,
            models.merit.cost,
            (xbar, ubar, direction.gain),
            x0,
            bound=models.merit.bound(bound),
            worst=here.worst_step,
            chunk=self.chunk,
            explain=explain,
        )
        return trial if isinstance(trial, Refusal) else models.merit.judged(trial, bound, explain)

    def _look_for_leap(self, direction: DiscreteDirection, length: float, x: Array, refusal: Refusal) -> Refusal:
        """Return the refusal of a trial, the better explained if one step of time leapt to another solution.

        ``x``: its states, up to where it ended.
        """
        if length > SHORT and direction.shift == 0.0:
            return refusal
        models = self.models
        dx = direction.dx
        if dx is None:
            dx = models.sweep(direction, direction.dx0)[0]
        leapt = leap(models.system, models.here.x, length * dx, x, length)
        return refusal if leapt is None else replace(leapt, coarsest=refusal.coarsest)

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        return self.models.merit.promised(direction, length)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        models, here, found = self.models, self.models.here, trial.iterate
        models.merit.move(direction, found, models)
        here.move(found.x, found.u, found.worst_step)
        here.value, here.gain, here.moved = trial.cost, direction.gain, True
        if direction.gain is models.work.free.K:
            models.work.hold()
        models.leave()
