"""Where rounding eats the motion: far from the origin doubles are so wide apart that a step moves by few of them.

Velocities over a step of dt are then off by ``spacing(q) / dt``. What that makes of a motion is told by its energy, as
that of such velocities against the largest of the run, or against what forces make of the start in its time.
"""

from __future__ import annotations

import numpy as np

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array

_SMALL = 1e-8  # m/s or rad/s: velocities off by less are not looked at
_EATEN = 1e-9  # of the energy of a run; of that of one that failed
_EATEN_AT_FAILURE = 1e-13
_AT_REST = 1e-12  # of what rounding makes: there is no motion to be eaten


def eaten(m: Mechanism, t: Array, q: Array, u: Array, kinetic: float, *, failed: bool = False) -> str:
    """Return a sentence on what rounding does to a run of at least a step; empty where it does little.

    ``t`` (N+1,), ``q`` (N+1, nq): of the run. ``u`` (n_inputs,): inputs at its start. ``kinetic``: the largest kinetic
    energy. ``failed``: it ended in a step that could not be made, for which less may be the reason.
    """
    at_ends = np.maximum(np.abs(q[0]), np.abs(q[-1]))
    place = {name: i for i, name in enumerate(m.coordinates)}
    largest = np.array([at_ends[place[name]] if name in place else 0.0 for name in m.variables])
    dt = float(np.diff(t).min())
    with np.errstate(all="ignore"):
        off = np.spacing(largest) / dt
        if not off.max(initial=0.0) > _SMALL:
            return ""
        still = np.zeros(m.nv)
        M = np.asarray(m.core.hessian(q[0], still)[2])
        push = (np.asarray(m.core.gradient(q[0], still)[0]) + np.asarray(m.core.force(q[0], still, u)))[: m.nd]
        a = np.linalg.lstsq(M[: m.nd, : m.nd], push, rcond=None)[0] if np.isfinite(M).all() else push
        by_forces = 0.5 * abs(float(a @ push)) * float(t[-1] - t[0]) ** 2
        parts = 0.5 * np.abs(np.diag(M)) * off**2
        # So far away that no inertia is left of the differences of large numbers.
        lost = bool(np.any(np.diag(M)[: m.nd] < 0.0))
    i = int(np.argmax(parts))
    moves = max(kinetic, by_forces)
    if not lost and (moves < _AT_REST * parts[i] or not parts[i] > (_EATEN_AT_FAILURE if failed else _EATEN) * moves):
        return ""
    return (
        f"rounding eats the motion: {m.variables[i]!r} is at {largest[i]:.3g}, where numbers are "
        f"{np.spacing(largest[i]):.2g} apart, so that its velocity over a step of {dt:.3g} s is off by {off[i]:.2g}; "
        "measure it from somewhere nearer (a constant frame before its joint), or take longer steps"
    )
