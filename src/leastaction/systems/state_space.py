"""Where the states of a mechanism live: vectors, and unit quaternions among them."""

from __future__ import annotations

from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.optimal.space import ProductSpace, Rotations, StateSpace, Vectors


def space_of_states(m: Mechanism, *, beside: int = 0) -> StateSpace | None:
    """Return how states of q and as many velocities or momenta differ; None where they are plain vectors.

    ``beside``: how many plain numbers come behind them.
    """
    if not m.tree.rotations:
        return None
    firsts = {rotation.quaternion[0] for rotation in m.tree.rotations}
    parts: list[StateSpace] = []
    plain, i = 0, 0
    while i < m.nq:
        if m.coordinates[i] in firsts:
            parts += [Vectors(plain), Rotations()] if plain else [Rotations()]
            plain, i = 0, i + 4
        else:
            plain, i = plain + 1, i + 1
    return ProductSpace(*parts, Vectors(plain + m.nv + beside))
