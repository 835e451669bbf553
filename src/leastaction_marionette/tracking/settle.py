"""A motion by tensions as one of the puppet on strings of prescribed lengths.

Where hands hold all strings it is the same motion. Strings on bars are rods whose lengths are exact, and what was
planned misses them by newtons at most. A motion near it is sought, by tensions and within all limits, on which nothing
is off, by the method of multipliers (M. J. D. Powell, A method for nonlinear constraints in minimization problems,
1969): by what a length is off after a round, another is wanted in the next. Where that leads on slowly, as a limb hangs
straight below its string and moves its end by hardly anything, it is made dearer. What is left by then is rounding, and
goes on rods by multiple shooting: where strings have little grip a roll-out of rods that begins at the start throws
limbs about.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.models.marionette import string_lengths
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult, Optimizer, QuadraticCost, Status, regulate
from leastaction.systems import DistanceCost, MidpointSystem
from leastaction_marionette.tracking.plan import Curve, TrackingPlan

_BY_TENSION, _BY_POSE, _BY_PLACE, _BY_MOMENTUM = 1e-4, 1.0, 1.0, 1e-3  # prices of changes
_ROUNDS, _ITERATIONS = 8, 40  # rounds, and iterations of one, at most
_TOLERANCE = 1e-2  # of a round
_SLOW, _DEARER = 0.03, 100.0  # part of what a length was off by that makes it dearer, and by which factor
_WEIGHT, _DEAREST = 1e6, 1e12  # weight of a length that is off (1/m^2), at first and at most: more is all rounding
_EXACT: Final = 1e-6  # m, by which lengths may be off before they are those of rods
_WITHIN, _MARGIN = 5e-4, 1e-2  # parts of limits, and N of tensions at most, by which these are kept more than asked
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
    if plan.ties is None:
        x, u = plan.by_lengths(result.x, result.u)
    else:
        motion = settled(plan, result)
        if motion is None:
            raise NotTiedError(
                "strings on bars: no motion is found in which all of them pull. Lower the least tension, allow bars "
                "more reach, or let hands hold more strings"
            )
        x, u = motion
        broken = broken_by(plan, x, u)
        if broken and result.success:  # it does not say that it converged
            kinds = ", ".join(sorted(broken))
            said = f"Where strings on bars keep their lengths it breaks limits of {kinds}, by as little as was found."
            result = replace(result, status=Status.INFEASIBLE, message=said)
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


def broken_by(plan: TrackingPlan, x: Array, u: Array) -> frozenset[str]:
    """Return the kinds of limits that a motion by lengths does not nearly keep to."""
    problem, limits = plan.problem, plan.limits
    broken = limits.loosened(_NEARLY).broken(problem.mechanism, problem.t, problem.pelvis, x)
    return broken if limits.keep(_pulls(problem.system, x, u), _NEARLY) else broken | {"tension"}


def settled(plan: TrackingPlan, near: OptimizationResult) -> Curve | None:
    """Return the motion nearest to one of a plan on which strings on bars are as long as they are tied, by lengths.

    It keeps to limits where such a one is found, else less nearly. None where no motion is found in which all strings
    pull.
    """
    m, system, ties, limits = plan.mechanism, plan.system, plan.ties, plan.limits
    assert ties is not None
    margin = min(_MARGIN, 0.25 * (limits.strength - limits.tension))
    inside = replace(limits.loosened(-_WITHIN), tension=limits.tension + margin, strength=limits.strength - margin)
    R = np.repeat([_BY_TENSION, _BY_PLACE], [len(plan.strings), m.nrho])
    changed, found, off = _changed(system, near.x, near.u, R), near, ties.off(near.x)
    weights, missed, motion = np.full_like(off, _WEIGHT), np.zeros_like(off), None
    with suppress(LeastActionError):
        for _ in range(_ROUNDS):
            found = Optimizer(
                system,
                DistanceCost(changed, system, ties.pairs, ties.lengths - missed, weights),
                inside.of(m, plan.problem.pelvis),
                free_start=m.coordinates,
                method="quasi-newton",
                tolerance=_TOLERANCE,
                max_iterations=_ITERATIONS,
            ).run(found)
            if found.status is Status.INTERRUPTED:  # it goes on rods as far as it has come
                break
            before, off = np.abs(off), ties.off(found.x)
            if np.abs(off).max() < _EXACT:
                motion = _on_rods(plan, found)
                if motion is not None and not broken_by(plan, *motion):
                    return motion
            slow = np.abs(off) > np.maximum(_SLOW * before, 0.01 * _EXACT)
            dearer = np.where(slow, np.minimum(_DEARER, _DEAREST / weights), 1.0)
            missed, weights = (missed + off) / dearer, weights * dearer
    with suppress(LeastActionError):
        motion = _on_rods(plan, found) or motion
    return motion


def _on_rods(plan: TrackingPlan, found: OptimizationResult) -> Curve | None:
    """Return a motion whose strings on bars hardly vary by lengths, without gaps; None where strings push."""
    problem, system = plan.problem, plan.problem.system
    x, u = plan.by_lengths(found.x, found.u)
    pull = _BY_TENSION * (2.0 * string_lengths(problem.mechanism, problem.reference[0]) / problem.dt) ** 2
    done = Optimizer(
        system,
        _changed(system, x, u, np.full(system.nu, _BY_PLACE), pull),
        free_start=problem.mechanism.coordinates,
        shooting="multiple",
        tolerance=_TOLERANCE,
        method="quasi-newton",
        max_iterations=_ITERATIONS,
    ).run((x, u))
    made = done.gap == 0.0 and _pulls(system, done.x, done.u).min() > 0.0
    return (done.x, done.u) if made else None


def _changed(system: MidpointSystem, x: Array, u: Array, R: Array, multipliers: Array | None = None) -> QuadraticCost:
    """Return what it costs that a motion is another; ``R``, ``multipliers``: weights of these, and of inputs."""
    m = system.mechanism
    prices = np.repeat([_BY_POSE, _BY_PLACE, _BY_MOMENTUM, 0.0], [m.nd, m.nrho, m.nd, m.nrho])
    Q = prices if multipliers is None else np.concatenate([prices, multipliers])
    return QuadraticCost(x, u, Q=Q, R=R, space=system.space)


def _pulls(system: MidpointSystem, x: Array, u: Array) -> Array:
    """Return the tensions of all strings over the steps (m, N) of a motion by lengths."""
    return np.stack(list(system.trajectory(x, u).tensions().values()))[:, 1:]
