"""The memory that the iterations of a discrete problem work in, and what is counted of them."""

from __future__ import annotations

from leastaction.optimal.discrete.linear_quadratic import Workspace
from leastaction.optimal.loop import Clock
from leastaction.optimal.system import Linearization


class Work:
    """Memory that one run after the other works in.

    ``clock``, ``rollouts``: of this run; roll-outs are those beside line searches. ``free``: where the next
    linear-quadratic problem is solved. ``held``: where the gains of the last projection stand, which outlive it,
    because the adjoint needs them. ``spare``: where others are solved meanwhile. ``last``: where those are whose
    solution nobody keeps. ``linearization``: the last one, which the next is written over.
    """

    def __init__(self, N: int, nx: int, nu: int, *, clock: Clock | None = None) -> None:
        self.clock = clock or Clock()
        self.rollouts = 0
        self.free, self.held, self.spare, self.last = (Workspace(N, nx, nu) for _ in range(4))
        self._lqr: Workspace | None = None
        self._sizes = (N, nx, nu)
        self.linearization: Linearization | None = None

    @property
    def lqr(self) -> Workspace:
        """Where the projection's own gains are found."""
        if self._lqr is None:
            self._lqr = Workspace(*self._sizes)
        return self._lqr

    def renew(self) -> None:
        """Begin to count anew."""
        self.clock = Clock()
        self.rollouts = 0

    def count_on(self, other: Work) -> None:
        """Go on counting where another was."""
        self.clock, self.rollouts = other.clock, other.rollouts

    def hold(self) -> None:
        """Keep the solution in `free`, over which the next one would be written, as the one that is `held`."""
        self.free, self.held = self.held, self.free

    def take_spare(self) -> None:
        """Take the solution in `spare` for the one in `free`."""
        self.free, self.spare = self.spare, self.free
