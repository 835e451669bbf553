"""The motion by tensions, on strings of fixed lengths, that is nearest to one whose strings hardly vary.

For motions that rods do not make: theirs push, or throw limbs about, where strings have lost their grip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from leastaction.apps.marionette.tracking.ties import Ties
from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal import QuadraticCost, optimize
from leastaction.systems import PulledSystem

_MARGIN: Final = 5e-3  # N, above the least tension, at which those that fall below it are held
_BY_TENSION, _BY_PLACE, _BY_POSE, _BY_MOMENTUM = 1e-2, 1e-2, 1.0, 1e-3  # prices of changes
_DEARER, _DEAREST = 1e2, 1e6  # for tensions that fall below their least
_WEIGHTS: Final = (1e10, 1e12, 1e12)  # of lengths; between optimisations multipliers take over what they hold
_ROUNDS: Final = 7
_EXACT, _ENOUGH, _HOPELESS = 1e-9, 1e-8, 1e-6  # m
_ITERATIONS: Final = 40


def settled_by_tensions(
    system: PulledSystem, ties: Ties, x: Array, u: Array, *, inputs: Sequence[str], least: float
) -> tuple[Array, Array] | None:
    """Return a motion on which strings are as long as they are tied, none of them pulling too little.

    ``x`` (N+1, nx), ``u`` (N, nu): a motion of the system near which it is. ``inputs``: the names of its tensions.
    ``least``: of these (N). None where none is found.
    """
    before = ties.weight, ties.duals
    try:
        return _nearest(system, ties, x, u, inputs, least)
    except LeastActionError:
        return None
    finally:
        ties.weight, ties.duals = before


def _nearest(
    system: PulledSystem, ties: Ties, x: Array, u: Array, inputs: Sequence[str], least: float
) -> tuple[Array, Array] | None:
    m, strings = system.integrator.mechanism, len(inputs)
    wanted = np.array(u)
    wanted[:, :strings] = np.maximum(wanted[:, :strings], least + _MARGIN)
    Q = np.repeat([_BY_POSE, 1e-3, _BY_MOMENTUM, 0.0], [m.nd, m.nrho, m.nd, m.nrho])
    R = np.tile(np.repeat([_BY_TENSION, _BY_PLACE], [strings, m.nrho]), (len(u), 1))
    near: tuple[Array, Array] = (x, u)
    best: tuple[Array, Array] | None = None  # of those that are exact, where strings pull most
    # A limit's barrier would be all that counts where so little changes; prices of what falls below it are enough.
    for _ in range(_ROUNDS):
        cost = QuadraticCost(x, wanted, Q=Q, R=R[:, :, None])
        ties.duals = np.zeros_like(ties.duals)
        for weight in _WEIGHTS:
            ties.weight = weight
            found = optimize(
                system,
                ties.priced(cost, system),
                initial=near,
                free_start=m.variables,
                shooting="single",
                tolerance=1e-3,
                absolute_tolerance=1e-12,
                max_iterations=_ITERATIONS,
            )
            near = found.x, found.u
            ties.tighten(found.x)
            if np.abs(ties.off(found.x)).max() < _EXACT:
                break
        pulls, off = found.u[:, :strings], np.abs(ties.off(found.x)).max()
        low = pulls < least
        if off > _HOPELESS:
            break
        if off < _ENOUGH and (best is None or pulls.min() > best[1][:, :strings].min()):
            best = near
        if best is near and off < _EXACT and not low.any():
            break
        R[:, :strings][low] = np.minimum(_DEARER * R[:, :strings][low], _DEAREST)
        wanted[:, :strings][low] = least + _MARGIN
    return best if best is not None and best[1][:, :strings].min() > 0.0 else None
