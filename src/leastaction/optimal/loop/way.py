"""A way to begin again, as the loop knows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from leastaction.optimal.loop.ending import Outcome
from leastaction.optimal.loop.run import Run


def _as_it_is(run: Run, outcome: Outcome) -> Outcome:  # noqa: ARG001
    """Return the outcome."""
    return outcome


@dataclass(frozen=True)
class Way:
    """A way to begin again, where a run is about to get lost or is stuck.

    It has no state of its own: what it remembers is in the run, and goes with the result.

    Attributes
    ----------
    name : str
        How options name it.
    applies : callable
        ``applies(run, outcome)`` returns whether it is worth trying where a stage ended with an outcome, or before the
        next iteration, if that is None.
    begin : callable
        ``begin(run, outcome)`` begins again, and returns whether that could be done. If not, the run stands where it
        stood.
    ahead : tuple of int
        Iterations made before which it may be worth trying though no stage has ended.
    judge : callable
        ``judge(run, outcome)`` returns how a run has ended at the minimum of its last stage.
    """

    name: str
    applies: Callable[[Run, Outcome | None], bool]
    begin: Callable[[Run, Outcome | None], bool]
    ahead: tuple[int, ...] = ()
    judge: Callable[[Run, Outcome], Outcome] = _as_it_is
