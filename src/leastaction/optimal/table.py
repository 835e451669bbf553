"""The iteration table: a callback that prints one line per iteration."""

from __future__ import annotations

import sys
from functools import partial
from typing import IO, Any

from leastaction.optimal.result import IterationRecord

__all__ = ["IterationTable", "console"]

_COLUMNS = (
    ("iter", 4),
    ("method", 18),
    ("cost", 16),
    ("expected", 9),
    ("decrease", 9),
    ("step", 6),
    ("roll-outs", 9),
    ("cut at", 6),
    ("worst s", 7),
    ("at t", 7),
    ("curvature", 9),
    ("shift", 6),
    ("seconds", 8),
)


class IterationTable:
    """Prints the iterations as they happen; give it to `optimize` as the callback, one for each run.

    A full step of a perfect model decreases the cost by half of what is expected. Where a step had to be cut, the step
    of time at which the longer one ended stands under "cut at". The coarsest step of time along the iterate stands
    under "worst s", near 1 where it is sound, with the time at which it begins (s) beside it.
    One table is for one run: threads do not share it.

    Parameters
    ----------
    file : text stream, optional
        Where to; the standard output if left out. On a terminal, and if rich is installed, the table is in colour.
    then : callable, optional
        Another callback to call after printing; its answer is passed on.
    """

    def __init__(self, *, file: IO[str] | None = None, then: Any = None) -> None:
        self._file = file
        self._then = then
        self._console = console(file)
        self._has_header = False

    def __reduce__(self) -> tuple[Any, ...]:
        # A console does not go to another process; one of its own is made there.
        return partial(IterationTable, file=self._file, then=self._then), ()

    def __call__(self, record: IterationRecord) -> object:
        """Print one line; return the answer of the callback behind."""
        if not self._has_header:
            self._has_header = True
            self._print("  ".join(name.rjust(width) for name, width in _COLUMNS), "bold")
        self._print(self._line(record), _STYLES.get(record.method, ""))
        if record.note:
            self._print(f"{'':4}  {record.note}", "dim")
        return self._then(record) if self._then is not None else None

    def _line(self, record: IterationRecord) -> str:
        started = record.iteration > 0
        cells = (
            str(record.iteration),
            record.method.removesuffix("-shifted"),
            f"{record.cost:.9e}",
            f"{record.expected_decrease:.2e}" if started else "",
            f"{record.decrease:.2e}" if started else "",
            f"{record.step_length:.2g}" if started else "",
            str(record.rollouts) if started else "",
            str(record.cut_at) if record.cut_at >= 0 else "",
            "" if record.worst_step is None else f"{record.worst_s:.3g}",
            "" if record.worst_step is None else f"{record.worst_t:.4g}",
            f"{record.curvature_scale:.2g}" if record.curvature_scale else "",
            f"{record.shift:.0e}" if record.shift else "",
            f"{record.seconds:.2f}",
        )
        return "  ".join(cell.rjust(width) for cell, (_, width) in zip(cells, _COLUMNS, strict=True))

    def _print(self, line: str, style: str) -> None:
        if self._console is not None:
            self._console.print(line, style=style, markup=False, highlight=False, soft_wrap=True)
        else:
            print(line, file=self._file if self._file is not None else sys.stdout, flush=True)


_STYLES = {"newton": "green", "newton-damped": "cyan", "steepest": "yellow"}


def console(file: IO[str] | None) -> Any:
    """Return a console of rich, or None where that is not installed."""
    try:
        from rich.console import Console
    except ImportError:
        return None
    return Console(file=file)
