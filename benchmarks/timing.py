"""How a time is taken, and the row that holds it."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

Answer = TypeVar("Answer")

BUDGET = 0.3
"""Seconds that repeats of something short may take: it is disturbed most, so it is repeated most often."""


@dataclass(frozen=True)
class Timing:
    """Seconds of one call: the best of the repeats counts, the median tells how noisy they were."""

    best: float
    median: float
    repeats: int

    def __truediv__(self, count: float) -> Timing:
        return Timing(self.best / count, self.median / count, self.repeats)


def best_of(
    call: Callable[[], object],
    *,
    budget: float = 1.0,
    least: int = 3,
    most: int = 1000,
    prepare: Callable[[], object] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Timing:
    """Return the time of a call, after one that does not count.

    Parameters
    ----------
    call : callable
        What is timed.
    budget : float
        Seconds that the repeats may take together.
    least, most : int
        Limits on the number of repeats, whatever they take.
    prepare : callable, optional
        Called before every repeat, outside the clock.
    clock : callable
        Seconds since some time; `time.thread_time` counts little of what else runs on the machine.
    """
    times: list[float] = []
    began = time.perf_counter()
    collecting = gc.isenabled()
    gc.disable()
    try:
        for repeat in range(most + 1):
            if prepare is not None:
                prepare()
            start = clock()
            call()
            times.append(clock() - start)
            if repeat == 0:
                began = time.perf_counter()
            elif repeat >= least and time.perf_counter() - began > budget:
                break
    finally:
        if collecting:
            gc.enable()
    return Timing(min(times[1:]), statistics.median(times[1:]), len(times) - 1)


def fastest(call: Callable[[], Answer], rounds: int) -> tuple[Answer, float]:
    """Return what a call returns, and the least processor time (s) of so many calls, and as many as fit a `BUDGET`."""
    best, spent, done = float("inf"), 0.0, 0
    while done < rounds or spent < BUDGET:
        began = time.process_time()
        answer = call()
        taken = time.process_time() - began
        best, spent, done = min(best, taken), spent + taken, done + 1
    return answer, best


@dataclass(frozen=True)
class Row:
    """One line of the table.

    ``value``: in seconds, or a plain number where ``unit`` is "". ``per``: of what, "step", "solve", ...
    ``threads``: 0 where that has no meaning. ``target`` and ``dissertation`` are in the unit of the value,
    None where design or dissertation name none. ``reference``: another program, measured for comparison.
    """

    group: str
    name: str
    value: float
    per: str = ""
    unit: str = "s"
    threads: int = 1
    target: float | None = None
    dissertation: float | None = None
    reference: bool = False
    note: str = ""
    median: float | None = None
    repeats: int | None = None
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Absent:
    """A row that could not be measured, and why."""

    group: str
    name: str
    reason: str


def timed(group: str, name: str, timing: Timing, per: str, **others: Any) -> Row:
    """Return the row of a timing."""
    return Row(group, name, timing.best, per, median=timing.median, repeats=timing.repeats, **others)
