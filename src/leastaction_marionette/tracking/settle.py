"""A motion by tensions as one of the puppet on strings of prescribed lengths.

Where hands hold all strings it is the same motion. Strings on bars are rods whose lengths are exact, and what was
planned misses them by newtons at most. A motion near it is sought in which nothing is off: what limits are broken by
has a price, which rises, while what has changed already costs nothing more. It is sought by multiple shooting: where
strings have lost their grip a roll-out of rods that begins at the start throws limbs about.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.models.marionette import string_lengths, strings_of
from leastaction.numerics import Array
from leastaction.optimal import (
    Bound,
    IterationRecord,
    Method,
    OptimizationResult,
    PricedLimit,
    PricedLimits,
    QuadraticCost,
    Status,
    regulate,
)
from leastaction_marionette.tracking.limits import KINDS, PuppetLimits
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.stage import optimize

_BY_TENSION, _BY_POSE, _BY_PLACE, _BY_MOMENTUM = 1e-4, 1.0, 1.0, 1e-3  # prices of changes
# Of what limits are broken by, at first: by 1 N, rad or m, m/s or rad/s, and so on.
_PRICES: Final = {"tension": 1e-3, "joints": 10.0, "speed": 1e-2, "acceleration": 1e-5, "reach": 10.0}
# Each round asks for as many times the price of the last; less where that is too much at once, in the end hardly more.
_DEARER, _HARDLY, _DEAREST, _ROUNDS = 10.0, 1.1, 1e5, 20
_WITHIN, _MARGIN = 1e-4, 1e-3  # of limits, and N of tensions at most, by which they are kept more than they have to be
_ITERATIONS, _CONVEX = 25, 12  # of a round, at most, and of one with convex models
_EASY = 7  # iterations of a round after which more can be asked for at once
_GAP: Final = 1e-7  # m, rad and so on
_SAME = 1e-6  # m or rad, by which the same motion may differ, by tensions and by lengths
_NEARLY = 1e-3  # of limits, by which a motion that keeps to them may be off


class NotTiedError(ArgumentError):
    """No motion near a given one has strings of fixed lengths that all pull."""


def by_lengths(plan: TrackingPlan, result: OptimizationResult) -> OptimizationResult:
    """Return a result of a plan as one of the puppet on strings of prescribed lengths, with gains that hold it.

    With strings on bars it is a motion near it, which says where it breaks limits. Raises `NotTiedError` where there is
    none.
    """
    problem, system = plan.problem, plan.problem.system
    x, u = plan.by_lengths(result.x, result.u)
    if plan.ties is not None:
        settled_motion = settled(problem, x, u)
        if settled_motion is None:
            raise NotTiedError(
                "strings on bars: no motion is found in which all of them pull. Lower the least tension, allow bars "
                "more reach, or let hands hold more strings"
            )
        x, u = settled_motion
        result = _qualified(problem, result, x, u)
    try:
        cost = problem.cost().hessian(x, u)
        K = regulate(*system.linearize(x, u), Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
    except LeastActionError:  # where strings have lost their grip there is no regulator; the motion stands
        K = np.zeros((system.N, system.nu, system.ndx))
    done = system.rollout(x[0], x, u, K, 0, system.N)
    # Rods push where strings lose their grip: what has gone another way there is another motion.
    nq = problem.mechanism.nq
    if done.complete and np.abs(done.x[:, :nq] - x[:, :nq]).max() < _SAME:
        x, u = done.x, done.u
    return replace(result, x=x, u=u, K=K, projection_gain=K, state=None)


def _qualified(problem: TrackingProblem, result: OptimizationResult, x: Array, u: Array) -> OptimizationResult:
    """Return a result that does not say it converged where the motion by lengths breaks limits."""
    limits = problem.limits
    broken = limits.loosened(_NEARLY).broken(problem.mechanism, problem.t, problem.pelvis, x)
    pulls = np.stack(list(problem.system.trajectory(x, u).tensions().values()))
    if not limits.keep(pulls[:, 1:], _NEARLY):
        broken |= {"tension"}
    if not (broken and result.success):
        return result
    kinds = ", ".join(sorted(broken))
    said = f"Where strings on bars keep their lengths it breaks limits of {kinds}, by as little as was found."
    return replace(result, status=Status.INFEASIBLE, message=said)


def settled(problem: TrackingProblem, x: Array, u: Array) -> Curve | None:
    """Return a motion on which strings are as long as they are tied, none of them pulling too little.

    ``x`` (N+1, nx), ``u`` (N, nu): of its system, hardly off its constraints; near that is the motion. It keeps to
    limits where such a one is found, else less nearly. None where no motion is found in which all strings pull.
    """
    m, system, limits = problem.mechanism, problem.system, problem.limits
    pull = _BY_TENSION * (2.0 * string_lengths(m, problem.reference[0]) / problem.dt) ** 2
    sizes = m.nd, m.nrho, m.nd, m.nrho
    Q = np.concatenate([np.repeat([_BY_POSE, _BY_PLACE, _BY_MOMENTUM, 0.0], sizes), pull])
    R = np.full(system.nu, _BY_PLACE)
    margin = min(_MARGIN, 0.25 * (limits.strength - limits.tension))
    inside = replace(limits.loosened(-_WITHIN), tension=limits.tension + margin, strength=limits.strength - margin)

    def priced(kept: PuppetLimits, x: Array, u: Array, price: float) -> PricedLimits:
        near = QuadraticCost(x, u, Q=Q, R=R, space=system.space)
        return PricedLimits(near, system, _priced(problem, kept, price))

    asked = priced(limits, x, u, 1.0)
    best: Curve | None = None  # of those whose strings pull, the one that limits are broken least by
    least, price, dearer, begun = np.inf, 1.0, _DEARER, False
    method: Method = "quasi-newton"
    for _ in range(_ROUNDS):
        cost = priced(inside, x, u, price)
        found = _found(problem, cost, x, u, method)
        if not _is_motion(problem, found) and method == "quasi-newton":
            # Near a motion, where convex models do not lead to it.
            method = "auto"
            near = (x, u) if found is None else (found.x, found.u)
            found = _found(problem, cost, *near, method) or _found(problem, cost, x, u, method)
        made = _is_motion(problem, found)
        if begun and not made:
            # Again from the same motion, with a price that is not as much dearer.
            dearer = math.sqrt(dearer)
            price /= dearer
            if dearer < _HARDLY:
                break
            continue
        if found is None:
            break
        x, u, begun = found.x, found.u, made
        off = asked.off(x, u)
        if made and off < least and all(each.min() > 0.0 for each in system.trajectory(x, u).tensions().values()):
            best, least = (x, u), off
        if least <= 0.0:
            break
        if found.iterations <= _EASY:
            dearer = min(dearer**2, _DEARER)
        price = min(dearer * price, _DEAREST)
    return best


def _found(
    problem: TrackingProblem, cost: PricedLimits, x: Array, u: Array, method: Method
) -> OptimizationResult | None:
    """Return what one round finds from a motion, which may still have gaps; None where derivatives or steps fail."""
    try:
        return optimize(
            problem.system,
            cost,
            initial=(x, u),
            free_start=problem.mechanism.coordinates,
            shooting="multiple",
            method=method,
            tolerance=1e-2,
            max_iterations=_CONVEX if method == "quasi-newton" else _ITERATIONS,
            callback=_is_there,
        )
    except LeastActionError:
        return None


def _is_there(record: IterationRecord) -> bool:
    """Whether there is nothing left but to leave a saddle for a minimum: a motion is wanted, and this is one."""
    return record.method == "negative-curvature"


def _is_motion(problem: TrackingProblem, found: OptimizationResult | None) -> bool:
    """Whether there are no gaps between the steps of what was found."""
    if found is None:
        return False
    made, ndx = problem.system.step_each(found.x, found.u), problem.mechanism.ndx
    return made.complete and bool(np.abs(problem.system.difference(made.x, found.x[1:])[:, :ndx]).max() < _GAP)


def _priced(problem: TrackingProblem, limits: PuppetLimits, dearer: float) -> list[PricedLimit]:
    """Return limits of the marionette by lengths, with their prices."""
    m, found = problem.mechanism, []
    for kind in KINDS:
        own = limits.of(m, problem.pelvis, {kind})
        if kind == "tension":
            share = np.ones(len(problem.t) - 1)
            share[0] = 0.5  # the first impulse is that of half a step
            names = [s.name for s in strings_of(m)]
            own = [Bound(names, share * limits.tension, share * limits.strength, of="tension")]
        found += [PricedLimit(each, dearer * _PRICES[kind]) for each in own]
    return found
