"""Curves to begin with that are no trajectories: the inputs that they need, and straight lines to their ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Samples
from leastaction.optimal.space import apart, moved_by, sizes_of

_ROUNDS = 3  # iterations of Gauss and Newton's method, for equations that are nearly linear


def needed_inputs(system: DiscreteSystem, x: Array, u: Array) -> Array:
    """Return the inputs (N, nu) with which the steps of a curve come closest to its next states, in the states' sizes.

    Of all such inputs those that are nearest to u; u itself where a step cannot be made.
    """
    space = system.charts()
    size = sizes_of(space, x)
    best, least = u, np.inf
    for _ in range(_ROUNDS):
        try:
            made = system.step_each(x, u)
            if not made.complete:
                break
            missed = apart(space, x[1:], made.x) / size
            off = float(np.sum(missed**2))
            if not off < least:
                break
            best, least = u, off
            slopes = system.linearize_each(x, u, made.x).B / size[:, None]
        except LeastActionError:
            break
        u = u + np.einsum("kui,ki->ku", np.linalg.pinv(slopes), missed)
    return read_only(best)


def line_to(system: DiscreteSystem, x: Array, wanted: Array | None, rows: Sequence[Rows]) -> Array:
    """Return the straight line (N+1, nx) from a state to the wanted last state.

    Where equations of the last state are violated there, it is moved onto them by as little as possible.
    """
    N, ndx, space = system.N, system.ndx, system.charts()
    last = np.array(x if wanted is None else wanted)
    equations = [each for each in rows if each.equal and each.sign > 0.0 and each.quantity.of_state and N in each.k]
    for _ in range(_ROUNDS if equations else 0):
        at = Samples(np.array([N]), read_only(last[None].copy()), np.empty((1, 0)), np.empty((1, 0)))
        missed, slopes = [], []
        for each in equations:
            missed.append(each.bounds[each.k == N][0] - each.quantity.values(at)[0])
            slopes.append(each.quantity.whole_jacobian(at, ndx, 0)[0])
        last = moved_by(space, last, np.linalg.lstsq(np.concatenate(slopes), np.concatenate(missed), rcond=None)[0])
    part = np.linspace(0.0, 1.0, N + 1)[:, None]
    return read_only(moved_by(space, np.tile(x, (N + 1, 1)), part * apart(space, last, x)))
