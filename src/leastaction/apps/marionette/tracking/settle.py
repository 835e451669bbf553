"""The motion on strings of fixed lengths that is nearest to one whose strings hardly vary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from leastaction.apps.marionette.tracking.ties import Ties
from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal import Bound, OptimizationResult, QuadraticCost, optimize
from leastaction.systems import PulledSystem

_MARGIN: Final = 5e-3  # N, above the least tension, for what the last digits of lengths change of it
_BY_TENSION, _BY_PLACE, _BY_POSE, _BY_MOMENTUM = 1e-2, 1e-2, 1.0, 1e-3  # prices of changes
# Weights of lengths; between optimisations the multipliers take over what they hold.
_WITHIN_LIMITS: Final = (1e9, 1e9, 1e10, 1e10, 1e11, 1e11)
_EXACTLY: Final = (1e12, 1e12, 1e12)
_NEARLY, _EXACT = 1e-8, 1e-9  # m
_ITERATIONS: Final = 60


class NotTiedError(ArgumentError):
    """No motion near a given one has strings of fixed lengths that all pull."""


def settled(
    system: PulledSystem, ties: Ties, x: Array, u: Array, *, inputs: Sequence[str], least: float
) -> tuple[Array, Array] | None:
    """Return a motion on which strings are as long as they are tied, none of them pulling too little.

    ``x`` (N+1, nx), ``u`` (N, nu): a motion of the system near which it is. ``inputs``: the names of its tensions.
    ``least``: of these (N). None where none is found.
    """
    before = ties.weight, ties.duals
    try:
        return _nearest(system, ties, x, u, inputs, least + _MARGIN)
    except LeastActionError:
        return None
    finally:
        ties.weight, ties.duals = before


def _nearest(
    system: PulledSystem, ties: Ties, x: Array, u: Array, inputs: Sequence[str], least: float
) -> tuple[Array, Array] | None:
    m, strings = system.integrator.mechanism, len(inputs)
    wanted = np.array(u)
    wanted[:, :strings] = np.maximum(wanted[:, :strings], least)
    Q = np.repeat([_BY_POSE, 1e-3, _BY_MOMENTUM, 0.0], [m.nd, m.nrho, m.nd, m.nrho])
    R = np.repeat([_BY_TENSION, _BY_PLACE], [strings, m.nrho])

    def tied(
        near: tuple[Array, Array], price: Array, weights: Sequence[float], bound: Bound | None
    ) -> OptimizationResult:
        cost = QuadraticCost(*near, Q=Q, R=price)
        ties.duals = np.zeros_like(ties.duals)
        found: OptimizationResult | None = None
        for weight in weights:
            ties.weight = weight
            found = optimize(
                system,
                ties.priced(cost, system),
                initial=(near[0], u) if found is None else found,
                limits=[] if bound is None else [bound],
                free_start=m.variables,
                shooting="single",
                tolerance=1e-3,
                absolute_tolerance=1e-12,
                max_iterations=_ITERATIONS,
            )
            ties.tighten(found.x)
            if np.abs(ties.off(found.x)).max() < (_EXACT if bound is None else _NEARLY):
                break
        assert found is not None
        return found

    near = tied((x, wanted), R, _WITHIN_LIMITS, Bound(inputs, min=least, of="input"))
    u = near.u
    # Moves tensions by less than the margin, and does not know of limits.
    found = tied((near.x, near.u), np.repeat([1.0, _BY_PLACE], [strings, m.nrho]), _EXACTLY, None)
    exact = np.abs(ties.off(found.x)).max() < _EXACT
    return (found.x, found.u) if exact and found.u[:, :strings].min() > 0.0 else None
