"""How a motion whose strings on bars vary in length becomes one on which they keep it, optimisation by optimisation.

What `track` does of it: functions of its job, which names them where they are its methods. `ties.py` has the price.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Protocol

import numpy as np

from leastaction.apps.choices import Follow
from leastaction.apps.marionette.tracking.found import CUT_SHORT, STUCK, Effort, TrackingRun, TrackingSearch
from leastaction.apps.marionette.tracking.limits import FIRST_KINDS
from leastaction.apps.marionette.tracking.plan import SEARCH_STAGES, Plan
from leastaction.apps.marionette.tracking.poses import held_still
from leastaction.apps.marionette.tracking.problem import TrackingProblem
from leastaction.apps.marionette.tracking.ties import FIXED_FROM, WEIGHTS, Ties
from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io.motion.motion import Motion
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult, Status


class Job(Protocol):
    """What of a job of `track` is needed here."""

    mechanism: Mechanism
    motion: Motion
    follow: Follow
    problem: TrackingProblem
    plan: Plan | None
    effort: Effort
    start: tuple[Array, Array] | OptimizationResult | None
    earlier: OptimizationResult | None
    kinds: frozenset[str]
    others: list[tuple[str, Callable[[], tuple[Array, Array]]]]
    left: int
    tolerance: float | None

    @property
    def say(self) -> Callable[[str], object]:
        """Told what is done."""

    def improve(self) -> OptimizationResult:
        """Optimise until nothing more is gained."""

    def planned(self) -> Plan:
        """Return the plan by tensions."""

    def run_of(self, found: OptimizationResult, *, counted: bool = True) -> TrackingRun:
        """Return a result as a run; ``counted``: whether it is in the effort already."""


_TYING: Final = 200  # iterations in which strings on bars are tied more firmly, but the last time
_TOO_LOOSE: Final = 0.03  # m, by which strings on bars may not vary any more where their lengths are fixed
_FIRM: Final = 5e-6  # m, by which they may vary to be settled (`settle.py`)
_ROUNDS: Final = 6  # of multipliers until then
_CLOSELY: Final = 1e-4  # the tolerance meanwhile
_NEARLY: Final = 1e-4  # m, the same where they cannot be tied more firmly
_NOT_TIED: Final = (
    "The best motion found could not be tied to bars: this is one near it on which strings keep their lengths."
)


def varies(job: Job) -> bool:
    """Whether strings that are tied to bars still vary in length."""
    return job.plan is not None and job.plan.ties is not None and not job.plan.ties.firm


def tied(job: Job, result: OptimizationResult) -> OptimizationResult:
    """Return a motion whose strings on bars hardly vary; from a puppet at rest where a given one leads to none."""
    if not varies(job):
        return result
    now = _ties(job).weight
    found = _more_firmly(job, result, [weight for weight in WEIGHTS if weight > now])
    if found.success or found.status in CUT_SHORT or job.left < 1:
        return found
    job.say("strings on bars cannot be tied on the motion found: it begins with a puppet that hangs still")
    before = job.mechanism, job.problem, job.plan, job.kinds
    try:
        still = holds_still(job, found)
    except ArgumentError:
        return found
    again = _more_firmly(job, still, WEIGHTS[1:])
    if not again.success and varies(job):
        again = found
        job.mechanism, job.problem, job.plan, job.kinds = before
    return again


def holds_still(job: Job, near: OptimizationResult) -> OptimizationResult:
    """Return the puppet at rest, with strings on bars tied as they are there; ``near``: what was found instead."""
    assert job.plan is not None
    still = held_still(job.plan, near)
    tie(job, still)
    job.kinds = FIRST_KINDS  # it knows of no others
    return replace(still, cost=job.plan.cost().value(still.x, still.u))


def or_still(job: Job, run: TrackingRun) -> TrackingRun:
    """Return a run on bars that is no minimum, or the puppet held still where that is nearer to what is wanted."""
    assert run.plan is not None
    try:
        still = job.run_of(holds_still(job, run.plan))
    except ArgumentError:
        return run
    return run if run.off <= still.off else still


def tie(job: Job, result: OptimizationResult) -> None:
    """Give strings on bars the lengths that suit a motion of the plan."""
    ties = _ties(job)
    lengths = ties.distances(result.x).mean(axis=0)
    named = dict(zip(ties.names, map(float, lengths), strict=True))
    job.mechanism = job.mechanism.with_parameters(named)
    job.plan = job.planned()


def kept_search(job: Job, found: OptimizationResult) -> TrackingSearch:
    """Return an iterate on which strings still vary in length as what `go_on` goes on with: cheaper than a run is."""
    return TrackingSearch(
        mechanism=job.mechanism,
        motion=job.motion,
        stage=SEARCH_STAGES,
        result=found,
        follow=job.follow,
        effort=job.effort.plus(found, before=0 if job.earlier is None else job.earlier.iterations),
        firmness=_ties(job).weight,
        kinds=job.kinds,
    )


def go_on(job: Job, search: TrackingSearch) -> None:
    """Begin where `kept_search` was."""
    assert search.firmness is not None
    job.mechanism, job.effort, job.kinds, job.earlier = search.mechanism, search.effort, search.kinds, search.result
    job.plan = job.planned()
    if job.plan.ties is None:
        raise ArgumentError("resume: its strings are tied to bars, and those of the mechanism are not")
    job.plan.ties.weight = search.firmness


def _more_firmly(job: Job, result: OptimizationResult, weights: Sequence[float]) -> OptimizationResult:
    """Return what is found where each optimisation ties strings on bars more firmly than the last."""
    left = job.left
    job.others = []  # they are where strings are tied loosely
    for weight in weights:
        if result.status in CUT_SHORT or left < 1:
            return result
        if weight <= FIXED_FROM:
            tie(job, result)
        off = float(np.abs(_ties(job).off(result.x)).max())
        if weight > FIXED_FROM and off > _TOO_LOOSE:
            return replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if weight > FIXED_FROM and off < _FIRM and result.success:
            break
        _ties(job).weight = weight
        job.say(f"strings on bars vary by {1e3 * off:.2g} mm: tied more firmly")
        job.start, job.earlier, job.left = result, None, left if weight == weights[-1] else _TYING
        try:
            firmer = job.improve()
        except ProjectionError as error:
            job.say(f"strings cannot be tied more firmly: {error}")
            return replace(result, status=Status.LINE_SEARCH_FAILED, message=_NOT_TIED)
        if result.success and weight > FIXED_FROM and off < _NEARLY and firmer.status in STUCK:
            break  # so firmly that rounding of what lengths cost looks like negative curvature
        result = firmer
    if result.success:
        result = _by_multipliers(job, result, left)
    _ties(job).firm = result.success
    return result


def _by_multipliers(job: Job, result: OptimizationResult, left: int) -> OptimizationResult:
    """Return what is found where multipliers take over what the last weight holds, until strings hardly vary.

    More weight would look like negative curvature by rounding.
    """
    tolerance = job.tolerance
    if tolerance is None:
        job.tolerance = _CLOSELY  # what is left of the lengths costs less than the motion's own tolerance
    for _ in range(_ROUNDS):
        off = float(np.abs(_ties(job).off(result.x)).max())
        if off < _FIRM or result.status in CUT_SHORT or left < 1:
            break
        before = _ties(job).duals
        _ties(job).tighten(result.x)
        job.say(f"strings on bars vary by {1e3 * off:.2g} mm: multipliers hold them")
        job.start, job.earlier, job.left = result, None, _TYING
        try:
            firmer = job.improve()
        except ProjectionError:
            firmer = None
        if firmer is None or not (firmer.success or firmer.status in CUT_SHORT):
            _ties(job).duals = before
            break
        result = firmer
    job.tolerance = tolerance
    return result


def _ties(job: Job) -> Ties:
    assert job.plan is not None
    assert job.plan.ties is not None
    return job.plan.ties
