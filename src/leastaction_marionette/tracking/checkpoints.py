"""How often a run is kept, in case that the program ends."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, TypeVar

_SHARE = 0.05  # of the time may go into checkpoints

Kept = TypeVar("Kept")


class Checkpoints(Generic[Kept]):
    """Hands on what is to be kept, not too often. For one thread.

    ``keep``: what is done with it; None: nothing. ``seconds``: least time between two of these calls, longer where they
    would take more than a twentieth of all time; 0: no pause.
    """

    def __init__(self, keep: Callable[[Kept], object] | None, seconds: float) -> None:
        self.keep, self.seconds = keep, seconds
        self.due = time.perf_counter() + seconds

    def __call__(self, now: Callable[[], Kept], *, at_once: bool = False) -> None:
        """Keep what ``now`` gives, which is asked only if it is time, or where this is the last chance."""
        began = time.perf_counter()
        if self.keep is None or (began < self.due and not at_once):
            return
        self.keep(now())
        after = time.perf_counter()
        pause = max(self.seconds, (after - began) / _SHARE)
        self.due = after + (pause if self.seconds > 0.0 else 0.0)
