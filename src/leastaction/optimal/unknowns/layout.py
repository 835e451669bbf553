"""Where constants are in the state of an extended system, and what of its own state they are kept of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.optimal.quantity import Instants, as_slice


@dataclass(frozen=True, eq=False)
class ConstantsLayout:
    """Places in ``y = [x of the system; parameters p; copies c of entries of the first state; copies of rotations]``.

    ``copied``, ``copied_moves`` (m,): entries of x that are copied, and the directions that move them; ``kept``,
    ``kept_moves``: the same, as slices where they follow each other, which copies nothing. ``turns`` (n, 2): first
    number and first direction of each rotation that is copied; ``turned``, ``turned_moves``: all of these.
    ``at_copies``, ``at_turns``: where copies begin in y; ``at_copied_moves``: where their directions begin in a
    difference.
    """

    copied: Instants
    copied_moves: Instants
    kept: Any
    kept_moves: Any
    turns: Any
    turned: Instants
    turned_moves: Instants
    at_copies: int
    at_turns: int
    at_copied_moves: int

    @classmethod
    def of(
        cls,
        system: Any,
        parameters: int,
        copied: Sequence[int],
        moves: Sequence[int] | None,
        turns: Sequence[tuple[int, int]],
    ) -> ConstantsLayout:
        """Return the places of a number of parameters, and of copies of a system's state; see `Extended`."""
        entries = np.array(copied, dtype=np.intp)
        directions = entries if moves is None else np.array(moves, dtype=np.intp)
        first = np.array(turns, dtype=np.intp).reshape(-1, 2)
        numbers, turning = (first[:, [i]] + np.arange(n) for i, n in ((0, 4), (1, 3)))
        at_copies = system.nx + parameters
        return cls(
            copied=entries,
            copied_moves=directions,
            kept=as_slice(entries),
            kept_moves=as_slice(directions),
            turns=first,
            turned=numbers.ravel(),
            turned_moves=turning.ravel(),
            at_copies=at_copies,
            at_turns=at_copies + len(entries),
            at_copied_moves=system.ndx + parameters,
        )
