"""A first trajectory of a plan by dynamic embedding (dissertation 6.6.1).

Every joint gets a motor, with which any motion can be followed; the motors are made ever more expensive until they do
next to nothing, and are then taken away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from leastaction.errors import ProjectionError
from leastaction.io import Motion
from leastaction.numerics import Array, smooth_rise
from leastaction.optimal import IterationRecord, OptimizationResult, Status
from leastaction_marionette.tracking.found import Effort
from leastaction_marionette.tracking.limits import FIRST_KINDS
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.poses import at_rest, hanging
from leastaction_marionette.tracking.stage import optimize
from leastaction_marionette.turns import on_the_way, unit

# Prices of a motor's square on the way to the motion without motors, and the iterations at each.
PRICES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3, 1e4)
_ITERATIONS, _LAST_ITERATIONS = 12, 80
STAGES = len(PRICES) + 1
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
    motors = range(len(plan.strings), len(plan.strings) + plan.mechanism.nd)

    def solved(
        start: Curve, number: int, price: float | None, kinds: frozenset[str] = FIRST_KINDS, **options: Any
    ) -> OptimizationResult:
        found = optimize(
            plan.system if price is None else plan.by_motors,
            plan.cost(motor=price),
            initial=start,
            limits=plan.limits.of(plan.mechanism, plan.problem.pelvis, kinds),
            free_start=plan.mechanism.coordinates,
            tolerance=_WITHOUT_MOTORS if price is None else _ROUGHLY,
            max_iterations=_LAST_ITERATIONS if price is None else _ITERATIONS,
            **options,
        )
        if found.status is Status.INTERRUPTED:
            # Ctrl-C, which a single optimisation only ends early, ends them all.
            if result is not None:
                keep(number, result, effort, True)
            raise KeyboardInterrupt
        return found

    for number in range(stage, STAGES):
        if result is not None and number >= _RELEASED:
            # Without motors the motion would break the limits that they lead beyond by far: they are stated at once.
            kinds, most = FIRST_KINDS | plan.broken(result.x), _JUMP * result.cost

            def lost(record: IterationRecord, most: float = most) -> bool:
                return record.iteration == 0 and not record.cost < most

            found = None
            with suppress(ProjectionError):
                start = result.x, np.delete(result.u, motors, axis=1)
                found = solved(start, number, None, kinds, callback=lost)
            if found is not None and found.status is not Status.STOPPED_BY_CALLBACK:
                effort = effort.plus(found, scale=scale)
                say(f"without motors: cost {found.cost:.4g}")
                return *_unless_still(plan, found.x, found.u, say), effort
        if number == len(PRICES):
            break
        price = PRICES[number]
        # Duals of an earlier stage are those of cheaper motors: each stage finds its own.
        for start in _starts(plan) if result is None else [(result.x, result.u)]:
            with suppress(ProjectionError):
                result = solved(start, number, price)
                break
        if result is None:
            at_rest(plan)  # or strings that cannot hold the puppet are the reason
            raise ProjectionError("track: no motion of the puppet with motors is near to the wanted one")
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


def _unless_still(plan: TrackingPlan, x: Array, u: Array, say: Callable[[str], object]) -> Curve:
    """Return a motion; that of a puppet which hangs still, where it is nearer to the wanted one.

    Where strings are too few for what the motors did, the motion without them is violent, and leads nowhere.
    """
    xs, us = plan.hung()
    if len(us) < plan.system.N or plan.cost().value(xs, us) > plan.cost().value(x, u):
        return x, u
    say("a puppet that hangs still is nearer: it begins with that")
    return xs, us


def _starts(plan: TrackingPlan) -> Iterator[Curve]:
    """Yield the wanted motion with the motors that make it, then ever smoother ones, at last the first pose held."""
    # On its limit a tension has a barrier like a wall, from which no direction leads away.
    names, q = plan.mechanism.coordinates, plan.x_reference[:, : plan.mechanism.nq]
    tensions = np.clip(plan.u_reference[:, : len(plan.strings)], *plan.tensions_inside(_INSIDE))
    motion = Motion(names, plan.t, q)
    for cutoff in _CUTOFFS:
        yield driven(plan, unit(names, motion.low_pass(cutoff).q), tensions)
    yield driven(plan, np.tile(q[0], (len(q), 1)), tensions)


def driven(plan: TrackingPlan, q: Array, tensions: Array) -> Curve:
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
