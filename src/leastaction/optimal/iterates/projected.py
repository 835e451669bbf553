"""The trajectory that takes the place of a curve: its projection."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

import numpy as np

from leastaction.errors import LeastActionError, ProjectionError, StepError
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.linear_quadratic import Workspace, regulate
from leastaction.optimal.discrete.projection import linearize_along_curve
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.iterates.models import Models
from leastaction.optimal.space import StateSpace, apart

_ROUNDING = 1e-8  # distance of a trajectory from a curve that it is, in parts of its states
_DEAR = 10.0  # ratio of the cost of a projection to that of its inputs alone, above which the projection diverged


def projection_of(models: Models, xbar: Array, ubar: Array, gain: Array) -> Rollout:
    """Return the projection of a curve by some gains.

    Raises
    ------
    ProjectionError
        If it does not come to the end.
    """
    system = models.system
    with models.work.clock.rollout:
        rollout = system.rollout(xbar[0], xbar, ubar, gain, 0, system.N)
    models.work.rollouts += 1
    if not rollout.complete:
        raise ProjectionError(
            f"initial: the roll-out failed after {rollout.steps_done} of {system.N} steps: "
            f"{_why(system, rollout, xbar, ubar, gain)}. Give a trajectory of the system (such as one it simulated), "
            "or a curve that stays closer to one."
        )
    return rollout


def _why(system: DiscreteSystem, rollout: Rollout, xbar: Array, ubar: Array, gain: Array) -> str | None:
    """Return why a roll-out ended, in the words of the step if it has some: it looks closer than a roll-out."""
    k = rollout.steps_done
    x = rollout.x[k]
    try:
        system.f(x, ubar[k] - gain[k] @ system.difference(x, xbar[k]), k)
    except StepError as error:
        return str(error).removesuffix(".")
    except ArithmeticError:  # the roll-out has failed already
        pass
    return rollout.failure


def project_curve(models: Models, made: Rollout | None = None) -> None:
    """Put a trajectory in the place of the curve where the iterate is to be, with what it costs.

    A trajectory is its own projection, and what was computed along it stays valid. Of a curve that is none, the
    gains of the cost's regulator may lead far away or nowhere: then the cheapest of several projections is taken.
    ``made``: the roll-out that the curve is, if it is known to be one.
    """
    system, here, cost = models.system, models.here, models.merit.cost
    x, u = here.x, here.u
    N, ndx, nu = system.N, system.ndx, system.nu
    found: list[tuple[float, Rollout, Array]] = []
    failure = ""

    def follow(choose: Callable[[], Array]) -> tuple[Rollout, Array] | None:
        nonlocal failure
        try:
            gain = choose()
            return made or projection_of(models, x, u, gain), gain
        except LeastActionError as error:
            failure = str(error)
        return None

    def weigh(followed: tuple[Rollout, Array] | None) -> None:
        if followed is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                value = cost.value(followed[0].x, followed[0].u)
            found.append((value if isfinite(value) else np.inf, *followed))

    def regulator() -> Array:
        if models.own is not None and models.own.is_users:
            return models.own.gains(linearize_along_curve(system, x, u), Workspace(N, ndx, nu))
        models.quasi_newton = solution = models.solve("quasi-newton", models.work.held)
        return solution.K if solution.definite else regulate(*models.linearize())

    first = follow(regulator)
    if first is not None and (made is not None or _is_same(models.space, first[0].x, x)):
        here.worst_step, here.gain, here.value = first[0].worst_step, first[1], cost.value(x, u)
        return
    models.forget()
    weigh(first)
    weigh(follow(lambda: np.zeros((N, nu, ndx))))
    if not found or found[0][0] > _DEAR * found[-1][0]:
        # The regulator above may not even exist where the curve's next states are no ends of steps.
        along = linearize_along_curve(system, x, u)
        Q, R, _, Q_final = cost.convex_hessian(x, u)
        weigh(follow(lambda: regulate(*along, Q=Q, R=R, Q_final=Q_final)))
        weigh(follow(lambda: regulate(*along)))
    else:
        del found[1:]
    if not found:
        raise ProjectionError(f"initial: {failure.removeprefix('initial: ')}")
    value, projected, here.gain = min(found, key=lambda each: each[0])
    here.move(projected.x, projected.u, projected.worst_step)
    here.value = value if isfinite(value) else cost.value(here.x, here.u)


def _is_same(space: StateSpace | None, x: Array, curve: Array) -> bool:
    """Whether the states of a trajectory are those of a curve, but for rounding."""
    return float(np.abs(apart(space, x, curve)).max()) <= _ROUNDING * (1.0 + float(np.abs(curve).max()))
