"""What it costs to be off a wanted motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import differences
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.names import matching
from leastaction.optimal.discrete.cost import Cost, QuadraticCost
from leastaction.systems.costs.orientations import OrientationCost
from leastaction.systems.costs.places import PlaceCost
from leastaction.systems.costs.smooth import SmoothCost
from leastaction.systems.following.kinds import WantedKind, kind_of, quaternion_of, turns_of
from leastaction.systems.midpoint import MidpointSystem

# Weights of what none is given for: of what is wanted, prescribed variables and their places to come, their
# accelerations, inputs, and the pose that reaches wanted frames.
_WANTED, _PLACE, _NEXT, _ACCELERATION, _INPUT, _POSE = 1.0, 1e-3, 1e-5, 1e-6, 1e-6, 1e-3
_LOOKS = 8  # configurations at which it is asked what moves what


def following_cost(
    system: MidpointSystem, wanted: Mapping[str, Array], x: Array, u: Array, weights: Mapping[str, float]
) -> Cost:
    """Return the price of being off a wanted motion, about a curve (x, u), given weights by names; see `follow`.

    Raises `ArgumentError`: unknown names, negative weights, an input without one.
    """
    m = system.mechanism
    # Where frames are wanted, so is the pose that reaches them, a little: what they leave open is not left to wander.
    kinds = {name: kind_of(values) for name, values in wanted.items()}
    reached = any(kind in (WantedKind.PLACE, WantedKind.ORIENTATION) for kind in kinds.values())
    value = {name: _PLACE if name in m.kinematic else _POSE * reached for name in m.variables}
    value |= dict.fromkeys(_taken_along(m, x, wanted), 0.0)
    value |= dict.fromkeys(m.inputs, _INPUT) | dict.fromkeys(wanted, _WANTED)
    value |= {f"acceleration of {name}": _ACCELERATION for name in m.kinematic}
    value |= {f"momentum of {name}": 0.0 for name in m.dynamic}
    names = list(value)
    for pattern, weight in weights.items():
        chosen = [names[i] for i in matching(names, pattern)]
        if not chosen:
            raise ArgumentError(f"weights: nothing is called {pattern!r}; {closest(pattern, names, what='names')}")
        value |= dict.fromkeys(chosen, as_number(weight, f"weights: {pattern!r}", least=0.0))
    goal, counts = x.copy(), np.ones((len(x), system.ndx))
    for name, values in wanted.items():
        if kinds[name] is WantedKind.TURN:
            at, left_out = quaternion_of(m, name), np.isnan(values[:, 0])
            goal[:, at] = np.where(left_out[:, None], x[:, at], values)
            counts[left_out, turns_of(m, name)] = 0.0
        if kinds[name] is WantedKind.VALUE:
            place, left_out = m.coordinates.index(name), np.isnan(values)
            goal[:, place] = np.where(left_out, x[:, place], values)
            counts[left_out, m.variables.index(name)] = 0.0
    Q = np.zeros(system.ndx)
    Q[: m.nv] = [value[name] if kinds.get(name, WantedKind.VALUE) is WantedKind.VALUE else 0.0 for name in m.variables]
    for name in [name for name, kind in kinds.items() if kind is WantedKind.TURN]:
        Q[turns_of(m, name)] = value[name]
    Q[m.nv : m.nv + m.nd] = [value[f"momentum of {name}"] for name in m.dynamic]
    # Of places to come a little is weighed too, as every input has to be.
    R = np.concatenate([[value[name] for name in m.inputs], np.full(m.nrho, _NEXT)])
    if (R <= 0.0).any():
        raise ArgumentError(f"weights: input {m.inputs[int(np.argmin(R))]!r} has none, expected a positive one")
    each = Q if counts.all() else (Q * counts[:-1])[:, :, None]  # a diagonal per stage
    cost: Cost = QuadraticCost(goal, u, Q=each, R=R, Q_final=Q * counts[-1], space=system)
    places = {name: values for name, values in wanted.items() if kinds[name] is WantedKind.PLACE}
    if places:
        cost = PlaceCost(cost, system, places, {name: value[name] for name in places})
    orientations = {name: values for name, values in wanted.items() if kinds[name] is WantedKind.ORIENTATION}
    if orientations:
        cost = OrientationCost(cost, system, orientations, {name: value[name] for name in orientations})
    if m.nrho:
        cost = SmoothCost(cost, system, {name: value[f"acceleration of {name}"] for name in m.kinematic})
    return cost


def _taken_along(m: Mechanism, x: Array, wanted: Mapping[str, Array]) -> list[str]:
    """Return the dynamic variables that only constraints move with the wanted frames: where to is not known of them."""
    q = x[:, : m.nq]
    moves = np.ptp(differences(m, q, np.broadcast_to(q[0], q.shape))[:, : m.nd], axis=0) > 0.0
    held, leads = np.zeros(m.nd, dtype=np.bool_), np.zeros(m.nd, dtype=np.bool_)
    for at in q[:: max(1, len(q) // _LOOKS)]:
        held |= m.constraint_jacobian(at)[:, : m.nd].any(axis=0)
        for name, values in wanted.items():
            if kind_of(values) in (WantedKind.PLACE, WantedKind.ORIENTATION):
                rows = slice(3) if kind_of(values) is WantedKind.PLACE else slice(3, 6)
                leads |= m.frame_jacobian(at, name)[rows, : m.nd].any(axis=0)
    return [m.dynamic[i] for i in np.flatnonzero(moves & held & ~leads)]
