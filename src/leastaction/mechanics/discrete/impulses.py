"""What steps take from the momentum at their starts, and what they lead to at their ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.numerics.arrays import Array


class Impulses(NamedTuple):
    """Impulses on all variables, prescribed ones too, (N, nv) each; of turns of quaternions in the body's axes.

    ``before``: D1Ld + fd-, at the starts of steps, with forces at the instants. ``after``: D2Ld + fd+, at their ends.
    ``held``: Dh^T lam, at their starts. On what moves freely ``after[k-1] + before[k] - held[k]`` is zero.
    """

    before: Array
    after: Array
    held: Array


def impulses_along(
    vi: Integrator, t: Array, q: Array, inputs: Array, lam: Array, *, first_share: float = 1.0
) -> Impulses:
    """Return the impulses of steps between configurations q (N+1, nq) under inputs (N, n_inputs), multipliers lam.

    ``first_share``: the part of the first step for which forces at the instants act at its start.
    """
    m, core = vi.mechanism, vi.core
    before, after, held = (np.empty((len(inputs), m.nv)) for _ in range(3))
    q, inputs = np.ascontiguousarray(q), np.ascontiguousarray(inputs)
    for k, dt in enumerate(np.diff(t).tolist()):
        share = dt * (first_share if k == 0 else 1.0)
        taken, after[k] = core.momenta(q[k], q[k + 1], inputs[k], dt, share, t[k])
        before[k] = -taken
        held[k] = lam[k] @ m.at_time(t[k]).constraint_jacobian(q[k])
    return Impulses(before, after, held)
