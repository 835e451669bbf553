"""Multiple shooting: iterates that are curves whose steps need not meet, and between which the gaps close.

Where no trajectory is known, or where the projection of a curve leads far away (unstable motions, long horizons), the
states themselves are unknowns. A curve (x, u) has the gaps ``d_k = f(x_k, u_k) - x_{k+1}``; the linear-quadratic
problem along it takes them as the drift of ``dx+ = A dx + B du + d``, so that a step of length a leaves ``(1 - a) d``
of them but for the dynamics' curvature, which is weighed with the problem's costates ``P dx + b``, the multipliers of
the dynamics (H. G. Bock and K. J. Plitt, A multiple shooting algorithm, 1984). No step is rolled out: what the motion
after it would amplify opens a gap instead.

How far to go is decided by a filter (`gap_filter`). Where a full step opens gaps by the curvature of the dynamics,
another one closes these before it is refused.

Once the gaps are closed, the curve is projected onto a trajectory, and the iteration goes on over trajectories: it is
there that a minimum is certified.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.discrete.linear_quadratic import Feedforward, LinearQuadraticSolution, feedforward_of_drift
from leastaction.optimal.iterates.direction import AmongCurves, DiscreteDirection, Iterate
from leastaction.optimal.iterates.gap_filter import Filter, OpenCurve
from leastaction.optimal.iterates.models import Models, least_of
from leastaction.optimal.iterates.trial import is_too_coarse
from leastaction.optimal.line_search import Refusal, Trial
from leastaction.optimal.loop import Steps, along_parabola
from leastaction.optimal.space import apart, moved_by
from leastaction.optimal.state import Gaps

Gapped = Literal["never", "where needed", "where left", "at once"]
"""When steps may have gaps: never; where the start cannot be projected, or a way begins with them; where its projection
leaves it, too; from the start.
"""

LONGEST_WITH_GAPS = 300  # most iterations with gaps
_CLOSED = 1e-6  # largest gap, in parts of the states' sizes, that counts as closed after a full step
_LOOSE = 1e-6  # expected decrease, in parts of the cost, at which a stage with gaps ends
_CORRECTIONS, _LEFT = 4, 0.99  # most steps that close the gaps of a full one; largest ratio of gaps after each


class CurveSteps(Steps[LinearQuadraticSolution, DiscreteDirection, Iterate]):
    """Steps from one curve with gaps to the next.

    ``size`` (ndx,): of the states, in which gaps are measured. ``longest``: iterations after which they are over; None:
    only when the gaps are closed. ``penalty``: of the gaps, in the value that the loop gets.
    """

    def __init__(self, models: Models, size: Array, longest: int | None = LONGEST_WITH_GAPS) -> None:
        self.models, self.size, self.longest = models, size, longest
        self.penalty = 0.0
        self.filter = Filter(1.0)

    # ---- Where it stands --------------------------------------------------------------------------

    def evaluate(self, x: Array, u: Array) -> OpenCurve | Refusal:
        """Return a curve with its gaps, or which step of it cannot be made."""
        models, here = self.models, self.models.here
        made = models.system.step_each(x, u)
        if not made.complete:
            reason = f"a step of the curve failed: {made.failure}"
            return Refusal(reason, made.steps_done, failed=True, coarsest=made.worst_step)
        if here.is_open and is_too_coarse(made.worst_step, here.worst_step):
            assert made.worst_at is not None
            reason = f"{models.system.when(made.worst_at)} would be too coarse, {made.worst_step}"
            return Refusal(reason, made.worst_at, coarsest=made.worst_step)
        x, u = read_only(x), read_only(u)
        gaps = apart(models.space, made.x, x[1:])
        with np.errstate(over="ignore", invalid="ignore"):
            shown = models.merit.cost.value(x, u)
        if not np.isfinite(shown):
            return Refusal("the cost is not finite")
        off = np.abs(gaps) / self.size
        theta, gap, guide = float(np.sum(off)), float(off.max()), models.merit.guide(x, u)
        return OpenCurve(x, u, made.x, gaps, theta, gap, shown + guide, made.worst_step, shown)

    def begin(self, curve: OpenCurve) -> None:
        """Stand at a first curve, of whose multipliers nothing is known."""
        N, nu = curve.u.shape
        self.filter, self.penalty, self.models.costates = Filter(curve.theta), 0.0, None
        self.models.here.gain = np.zeros((N, nu, self.models.system.ndx))
        self.models.here.open(curve, self.penalty)

    def cost_again(self, cost: float) -> None:
        """Stand at the same curve, whose cost with all that guides is another in this stage."""
        self.models.here.open(self.curve._replace(cost=cost), self.penalty)

    @property
    def curve(self) -> OpenCurve:
        """The iterate."""
        curve = self.models.here.curve
        assert curve is not None
        return curve

    @property
    def are_closed(self) -> bool:
        """Whether the gaps are."""
        return self.curve.gap <= _CLOSED

    @property
    def longest_stage(self) -> int | None:
        """Iterations after which the stage is over, if it ends: at once where the gaps are closed."""
        return 1 if self.curve.length == 1.0 and self.are_closed else self.longest

    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough: closing what is left of gaps is expected to gain none."""
        return max(goal, _LOOSE * abs(self.models.here.value)) if self.are_closed else 0.0

    def unfinished(self, returned: str) -> str:
        """Return what is to be said of a run that ends so; ``returned``: what it returns."""
        k = int((np.abs(self.curve.gaps) / self.size).max(axis=1).argmax())
        when = self.models.system.when(k)
        return (
            f"Gaps are still open, the largest of {self.curve.gap:.2g} of the states' size at {when}: "
            f"what is returned is {returned}."
        )

    # ---- State ------------------------------------------------------------------------------------

    def state(self) -> Gaps:
        """Return what resuming needs of it."""
        here, costates = self.models.here, self.models.costates
        if costates is None:
            costates = np.zeros((0, self.models.system.ndx))
        pairs = np.array(self.filter.pairs).reshape(-1, 2)
        return Gaps(
            here.x, here.u, here.gain.copy(), self.size, costates, pairs, self.filter.first, self.penalty,
            self.curve.length, self.longest,
        )  # fmt: skip

    def recall(self, gaps: Gaps, curve: OpenCurve) -> None:
        """Stand where an earlier run stood."""
        self.filter = Filter(gaps.first, [(float(theta), float(cost)) for theta, cost in gaps.filter])
        self.penalty, self.models.costates = gaps.penalty, gaps.costates if len(gaps.costates) else None
        self.models.here.gain = gaps.gain
        self.models.here.open(curve._replace(length=gaps.length), self.penalty)

    # ---- Steps ------------------------------------------------------------------------------------

    def direction(
        self, method: str, model: LinearQuadraticSolution, scale: float, shift: float = 0.0
    ) -> DiscreteDirection:
        """Return the direction of a model that has a minimum, and choose the penalty so that it is one of descent."""
        models, curve = self.models, self.curve
        dx0 = models.start_step(model)
        dx, du = models.sweep(model, dx0, gaps=curve.gaps)
        assert model.P is not None
        assert model.factors is not None
        costates = np.einsum("kij,kj->ki", model.P, dx) + model.b
        q, r, q_final = models.merit.gradient()
        fall = float(np.sum(q * dx[:-1]) + np.sum(r * du) + q_final @ dx[-1])
        least = least_of(model, dx0)
        theta = curve.theta
        rise = fall + max(least - fall, 0.0)
        if theta > 0.0 and rise > 0.5 * self.penalty * theta:
            self.penalty = 2.0 * rise / theta
            models.here.open(curve, self.penalty)
        slope = min(2.0 * (least - self.penalty * theta), -np.finfo(np.float64).tiny)
        found = DiscreteDirection(
            method, slope, scale, shift, gain=model.K, C=model.C, dx=dx, du=du, dx0=dx0,
            among=AmongCurves(costates, fall, least, model.P, model.factors),
        )  # fmt: skip
        return models.merit.followed(found, models)

    def first_step(self, direction: DiscreteDirection, length: float) -> float:
        """Return how far to go at first: beyond a full step gaps would open again."""
        models = self.models
        length = models.start.longest(direction.dx0, models.here.x[0], length)
        return models.merit.first_step(direction, min(length, 1.0))

    def simulate(
        self,
        direction: DiscreteDirection,
        length: float,
        bound: float,  # noqa: ARG002 - the filter decides
    ) -> Trial[Iterate] | Refusal:
        """Return the curve at a step along the direction, its new gaps closed if need be, or why it is refused."""
        curve, among = self.curve, direction.among
        assert among is not None
        assert direction.dx is not None
        assert direction.du is not None
        trial = self._moved(direction.dx, direction.du, length)
        outcome = self._judge(among.fall, length, trial)
        if isinstance(outcome, Trial) or isinstance(trial, Refusal) or length < 1.0 or trial.theta < curve.theta:
            return outcome
        missed, law = curve.gaps, Feedforward(direction.K, direction.C)
        for _ in range(_CORRECTIONS):
            # The full step missed by this much more than the linear dynamics say.
            law = self._closing(law, among, trial.gaps)
            missed, before = missed + trial.gaps, trial.theta
            trial = self._moved(*self.models.sweep(law, direction.dx0, gaps=missed), 1.0)
            if isinstance(trial, Refusal):
                break
            corrected = self._judge(among.fall, 1.0, trial)
            if isinstance(corrected, Trial):
                return corrected
            if trial.theta > _LEFT * before:
                break
        return outcome

    def _closing(self, law: Feedforward, among: AmongCurves, gaps: Array) -> Feedforward:
        """Return the law that closes some more gaps, as cheaply as the model of a direction says."""
        linearization = self.models.linearize()
        A, B = linearization
        with self.models.work.clock.lq:
            more = feedforward_of_drift(A, B, law.K, among.P, among.factors, gaps, pattern=linearization.pattern)
        return law._replace(C=law.C + more)

    def _moved(self, dx: Array, du: Array, length: float) -> OpenCurve | Refusal:
        models, here = self.models, self.models.here
        x, u = moved_by(models.space, here.x, length * dx), here.u + length * du
        if not models.start.is_fixed:
            try:
                x[0] = models.system.moved_start(here.x[0], length * dx[0])
            except LeastActionError as error:
                return Refusal(f"the initial state cannot move so far: {error}", 0, failed=True)
        moved = self.evaluate(x, u)
        return moved if isinstance(moved, Refusal) else moved._replace(length=length)

    def _judge(self, fall: float, length: float, trial: OpenCurve | Refusal) -> Trial[Iterate] | Refusal:
        """Return a trial, or why it is refused by the filter."""
        if isinstance(trial, Refusal):
            return trial
        curve = self.curve
        if not self.filter.takes(curve, trial, length, fall, self.models.here.noise, self.penalty):
            return Refusal(
                f"gaps of {trial.theta:.4g} in all and a cost of {trial.cost:.10g}, where there are "
                f"{curve.theta:.4g} and {curve.cost:.10g}"
            )
        return Trial(Iterate(trial.x, trial.u, trial.worst_step, curve=trial), trial.cost + self.penalty * trial.theta)

    def promised(self, direction: DiscreteDirection, length: float) -> float:
        return along_parabola(direction, length)

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        models, among, old, new = self.models, direction.among, self.curve, trial.iterate.curve
        assert among is not None
        assert new is not None
        models.merit.move(direction, trial.iterate, models)
        self.filter.follow(old, new, among.fall, models.here.noise)
        if models.costates is None:
            models.costates = among.costates
        else:
            models.costates = models.costates + new.length * (among.costates - models.costates)
        models.here.gain = direction.gain
        if direction.gain is models.work.free.K:
            models.work.hold()
        models.here.open(new, self.penalty)
        models.here.moved = True
        models.leave()
