"""A first trajectory of a plan by dynamic embedding (dissertation 6.6.1).

Every joint gets a motor, with which any motion can be followed; the motors are made ever more expensive, and are then
taken away: the gaps that this leaves between the steps are for the optimiser to close.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from leastaction.errors import ProjectionError
from leastaction.numerics import Array, smooth_rise
from leastaction.optimal import Cost, OptimizationResult, Status
from leastaction.systems import PulledSystem
from leastaction_marionette.tracking.found import TrackingSearch
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.poses import at_rest
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.tracking.tracker import Tracker
from leastaction_marionette.turns import on_the_way

PRICES: Final = (1e-3, 1e-2, 1e-1, 1.0)
"""Prices of a motor's square on the way to the motion without motors."""

_ITERATIONS, _LAST_ITERATIONS = 12, 80  # at each price, and without motors
_SET_OUT = 5  # steps within which a motion that begins fast is picked up from rest
_KINDS: Final = ("tension", "joints")  # of limits that are stated while motors help
_INSIDE = 0.1  # of the mean tension at rest, by which tensions are above their least to begin with
# Tolerance of the search: where barriers stay high, each stage leaves room for the next. Without motors it is that of a
# motion which is hardly improved with shorter steps of time.
_ROUGHLY, _WITHOUT_MOTORS = 0.1, 0.02


def with_motors(tracker: Tracker, *, begun: TrackingSearch | None = None) -> Tracker:
    """Return a tracker that starts from what motors on all joints lead to, which become ever more expensive.

    Where they lead nowhere, that begins with a puppet that is held still; raises `ArgumentError` where strings hold it
    nowhere. ``begun``: a search that was cut short. What is found after every stage is kept, and where Ctrl-C ends one.
    """
    first, result = (0, None) if begun is None else (begun.stage, begun.result)
    # A search that had to take the plan's own steps goes on with them.
    own = result is not None and len(result.u) == tracker.plan.system.N
    coarse = tracker if own else tracker.with_longer_steps()
    plan, effort = coarse.plan, tracker.effort
    motors = range(len(plan.strings), len(plan.strings) + plan.mechanism.nd)

    def keep(stage: int, found: OptimizationResult, *, at_once: bool = False) -> None:
        so_far = replace(tracker, effort=effort)
        tracker.kept(lambda: so_far.as_search(found, counted=True, stage=stage), at_once=at_once)

    def solved(system: PulledSystem, cost: Cost, start: Curve, **how: Any) -> OptimizationResult:
        found = optimize(system, cost, initial=start, free_start=plan.mechanism.coordinates, **how)
        if found.status is Status.INTERRUPTED:
            # Ctrl-C, which a single optimisation only ends early, ends them all.
            if result is not None:
                keep(number, result, at_once=True)
            raise KeyboardInterrupt
        return found

    number, how = first, {"limits": plan.stated(_KINDS), "tolerance": _ROUGHLY, "max_iterations": _ITERATIONS}
    try:
        for number, price in enumerate(PRICES[first:], start=first):
            # Duals of an earlier stage are those of cheaper motors: each stage finds its own.
            start = driven(plan) if result is None else (result.x, result.u)
            result = solved(plan.by_motors, plan.cost(motor=price), start, **how)
            effort = effort.plus(result, scale=None)
            keep(number + 1, result)
            most = float(np.max(np.sqrt(np.mean(result.u[:, motors] ** 2, axis=0))))
            tracker.say(f"motors at price {price:g}: the strongest gives {most:.2g} N or N m (rms)")
        assert result is not None
        start = result.x, np.delete(result.u, motors, axis=1)
    except ProjectionError:
        tracker.say("motors lead to no motion: it begins with a puppet that is held still")
        start = at_rest(plan)
    number, how = len(PRICES), {"tolerance": _WITHOUT_MOTORS, "max_iterations": _LAST_ITERATIONS}
    found = solved(plan.system, plan.cost(), start, limits=plan.stated(), **how)
    tracker.say(f"without motors: cost {found.cost:.4g}")
    start, effort = (found.x, found.u), effort.plus(found, scale=coarse.scale)
    if tracker.ties is not None:
        if coarse.slow is not None:  # what is still to be tied is not worth short steps
            tracker.say(f"strings on bars are tied with steps of {plan.dt:.3g} s at first")
        return replace(coarse, start=start, effort=effort)
    if coarse.slow is not None:
        start = tracker.plan.inside(*tracker.plan.finer(plan, *start), plan.cost().value(*start) * coarse.scale)
    return replace(tracker, start=start, effort=effort)


def driven(plan: TrackingPlan) -> Curve:
    """Return the wanted motion from rest with the motors that make it: behind the tensions among the inputs.

    Of two configurations each step of the midpoint rule says with which momenta it begins and ends; both are linear in
    what the motors give. What begins fast is picked up within a few steps.
    """
    m, dt, core = plan.mechanism, plan.dt, plan.by_motors.integrator.core
    # On its limit a tension has a barrier like a wall, from which no direction leads away.
    tensions = np.clip(plan.u_reference[:, : len(plan.strings)], *plan.tensions_inside(_INSIDE))
    q = plan.x_reference[:, : m.nq]
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
