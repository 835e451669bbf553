"""A first trajectory of a plan by dynamic embedding (dissertation 6.6.1).

Every joint gets a motor, with which any motion can be followed; the motors are made ever more expensive until they do
next to nothing, and are then taken away.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from leastaction.errors import ProjectionError
from leastaction.io import Motion
from leastaction.numerics import Array, smooth_rise
from leastaction.optimal import IterationRecord, OptimizationResult, Status
from leastaction_marionette.tracking.found import Effort
from leastaction_marionette.tracking.limits import FIRST_KINDS
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import at_rest, hanging
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.turns import on_the_way, unit

# Prices of a motor's square on the way to the motion without motors, and the iterations at each.
PRICES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3, 1e4)
_ITERATIONS, _LAST_ITERATIONS = 12, 80
SEARCH_STAGES = len(PRICES) + 1
"""Optimisations that a search takes at most, one after the other: one at each price, and one without motors."""

_RELEASED = 4  # stage from which on it is tried whether the motion goes on without motors
_JUMP = 2.0  # times the cost with motors may that without be at first
_CUTOFFS = (1e6, 8.0, 4.0, 2.0, 1.0)  # Hz, of ever smoother motions to begin with; the first leaves it as it is
_SET_OUT = 5  # steps within which a motion that begins fast is picked up from rest
_INSIDE = 0.1  # of the mean tension at rest, by which tensions are above their least to begin with
# Tolerance of the search: where barriers stay high, each stage leaves room for the next. Without motors it is that of a
# motion which is hardly improved with shorter steps of time.
_ROUGHLY, _WITHOUT_MOTORS = 0.1, 0.02

Keep = Callable[[int, OptimizationResult, Effort, bool], None]


def search(
    plan: TrackingPlan,
    say: Callable[[str], object],
    *,
    stage: int = 0,
    result: OptimizationResult | None = None,
    effort: Effort,
    scale: float,
    keep: Keep,
) -> tuple[Array, Array, Effort]:
    """Return a first trajectory found with motors on all joints that become ever more expensive, and the effort.

    ``say``: told what each stage came to. ``stage``, ``result``, ``effort``: the stage to begin with, what the one
    before it found, and what was spent until then. ``scale``: as of `Effort.plus`. ``keep``: told of these three after
    every stage, and where Ctrl-C ends one, which is the fourth argument. Raises `ArgumentError` where nothing was found
    and strings hold the puppet nowhere.
    """
    m, strings = plan.mechanism, len(plan.strings)
    motors = range(strings, strings + m.nd)
    options = _options(plan)

    def ended(found: OptimizationResult, number: int) -> OptimizationResult:
        if found.status is Status.INTERRUPTED:
            # Ctrl-C, which a single optimisation only ends early, ends them all.
            if result is not None:
                keep(number, result, effort, True)
            raise KeyboardInterrupt
        return found

    for number in range(stage, SEARCH_STAGES):
        if result is not None and number >= _RELEASED:
            stated = plan.broken(result.x)
            found = ended(_release(plan, result, motors, stated), number)
            if found.status is not Status.STOPPED_BY_CALLBACK:
                effort = effort.plus(found, scale=scale)
                say(f"without motors: cost {found.cost:.4g}")
                within = ended(_within(plan, found, stated), number)
                if within is not found:
                    effort = effort.plus(within, scale=scale)
                return *_unless_still(plan, within.x, within.u, say), effort
        if number == len(PRICES):
            break
        price = PRICES[number]
        # Duals of an earlier stage are those of cheaper motors: each stage finds its own.
        solve = partial(optimize, plan.by_motors, plan.cost(motor=price), max_iterations=_ITERATIONS, **options)
        found = _begun(plan, solve) if result is None else solve(initial=(result.x, result.u))
        result = ended(found, number)
        effort = effort.plus(result, scale=None)
        keep(number + 1, result, effort, False)
        most = float(np.max(np.sqrt(np.mean(result.u[:, motors] ** 2, axis=0))))
        say(f"motors at price {price:g}: the strongest gives {most:.2g} N or N m (rms)")
    assert result is not None
    # Motors that do next to nothing are still missed: what the strings do by themselves is where the rest begins.
    x, u = result.x, np.delete(result.u, motors, axis=1)
    say("without motors: not found in the search")
    for gains in plan.regulators(x, u):
        xs, us = plan.clipped(x, u, gains)
        if len(us) == plan.system.N:
            return *_unless_still(plan, xs, us, say), effort
    return *hanging(plan), effort


def _unless_still(plan: TrackingPlan, x: Array, u: Array, say: Callable[[str], object]) -> tuple[Array, Array]:
    """Return a motion; that of a puppet which hangs still, where it is nearer to the wanted one.

    Where strings are too few for what the motors did, the motion without them is violent, and leads nowhere.
    """
    xs, us = plan.hung()
    if len(us) < plan.system.N or plan.cost().value(xs, us) > plan.cost().value(x, u):
        return x, u
    say("a puppet that hangs still is nearer: it begins with that")
    return xs, us


def _begun(plan: TrackingPlan, solve: Callable[..., OptimizationResult]) -> OptimizationResult:
    """Return what the first stage finds from the wanted motion, or a smoother one where steps cannot follow it."""
    # On its limit a tension has a barrier like a wall, from which no direction leads away.
    least, most = plan.tensions_inside(_INSIDE)
    q = plan.x_reference[:, : plan.mechanism.nq]
    tensions = np.clip(plan.u_reference[:, : len(plan.strings)], least, most)
    for cutoff in _CUTOFFS:
        names = plan.mechanism.coordinates
        smooth = unit(names, Motion(names, plan.t, q).low_pass(cutoff).q)
        with suppress(ProjectionError):
            return solve(initial=driven(plan, smooth, tensions))
    try:
        return solve(initial=driven(plan, np.tile(q[0], (len(q), 1)), tensions))
    except ProjectionError:
        at_rest(plan)  # or strings that cannot hold the puppet are the reason
        raise


def _options(plan: TrackingPlan, more: Collection[str] = (), tolerance: float = _ROUGHLY) -> dict[str, Any]:
    """Return options of a stage: limits of the first kinds and `more`, what is free of the start, the tolerance."""
    return {
        "limits": plan.limits.of(plan.mechanism, plan.problem.pelvis, {*FIRST_KINDS, *more}),
        "free_start": plan.free_start,
        "tolerance": tolerance,
    }


def _release(
    plan: TrackingPlan, result: OptimizationResult, motors: range, stated: frozenset[str]
) -> OptimizationResult:
    """Return what is found without motors from where they did something; stopped at once where that is far off.

    ``stated``: kinds of limits that the motion with motors breaks. Without motors it would break them by far, and
    the way back from there is long.
    """
    most = _JUMP * result.cost

    def lost(record: IterationRecord) -> bool:
        return record.iteration == 0 and not record.cost < most

    try:
        return optimize(
            plan.system,
            plan.cost(),
            initial=(result.x, np.delete(result.u, motors, axis=1)),
            callback=lost,
            max_iterations=_LAST_ITERATIONS,
            **_options(plan, stated, _WITHOUT_MOTORS),
        )
    except ProjectionError:
        return replace(result, status=Status.STOPPED_BY_CALLBACK)


def _within(plan: TrackingPlan, result: OptimizationResult, stated: frozenset[str]) -> OptimizationResult:
    """Return a motion without motors that keeps to limits which one that was found breaks, and to those stated."""
    kinds = stated | plan.broken(result.x)
    if kinds == stated:
        return result
    return optimize(
        plan.system,
        plan.cost(),
        initial=(result.x, result.u),
        max_iterations=_LAST_ITERATIONS,
        **_options(plan, kinds, _WITHOUT_MOTORS),
    )


def driven(plan: TrackingPlan, q: Array, tensions: Array) -> tuple[Array, Array]:
    """Return a motion q (N+1, nq) from rest with the motors that make it: behind the tensions among the inputs.

    Of two configurations each step of the midpoint rule says with which momenta it begins and ends; both are linear in
    what the motors give. What begins fast is picked up within a few steps.
    """
    m, dt, core = plan.mechanism, plan.dt, plan.by_motors.integrator.core
    q = np.ascontiguousarray(
        on_the_way(m.coordinates, q[0], q, smooth_rise(np.arange(len(plan.t)) / _SET_OUT)[:, None])
    )
    motors, states = np.empty((len(tensions), m.nd)), plan.states(q)
    p = plan.x_reference[0, m.nq : m.nq + m.nd]
    for k, pull in enumerate(tensions):
        states[k, m.nq : m.nq + m.nd] = p

        def ends(forces: Array, k: int = k, pull: Array = pull) -> Array:
            both = core.momenta(q[k], q[k + 1], np.concatenate([pull, forces]), dt, (0.5 if k == 0 else 1.0) * dt)
            return np.stack(both)[:, : m.nd]

        free = ends(np.zeros(m.nd))
        by_start, by_end = np.stack([ends(one) - free for one in np.eye(m.nd)], axis=2)
        motors[k] = np.linalg.solve(by_start, p - free[0])
        p = free[1] + by_end @ motors[k]
    states[-1, m.nq : m.nq + m.nd] = p
    return states, np.hstack([tensions, motors, q[1:, m.first_rho :]])
