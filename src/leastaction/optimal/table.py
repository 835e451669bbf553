"""The iteration table: a callback that prints one line per iteration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import IO, Any

from leastaction.errors import ArgumentError
from leastaction.numerics.public import public
from leastaction.optimal.result import IterationRecord

_COLUMNS = (
    ("iter", 4),
    ("method", 18),
    ("cost", 16),
    ("expected", 9),
    ("decrease", 9),
    ("step", 6),
    ("roll-outs", 9),
    ("cut at", 6),
    ("gap", 7),
    ("worst s", 7),
    ("at t", 7),
    ("curvature", 9),
    ("shift", 6),
    ("seconds", 8),
)


@public
class PrintedTable:
    """Prints rows as they happen, under a heading; in colour on a terminal.

    ``columns``: headings and widths. ``file``: where to. ``then``: another callback, called after printing. Threads do
    not share one.
    """

    columns: tuple[tuple[str, int], ...]

    def __init__(self, *, file: IO[str] | None = None, then: Callable[[Any], object] | None = None) -> None:
        from rich.console import Console  # here, so that to import the package is quick

        if file is not None and not callable(getattr(file, "write", None)):
            raise ArgumentError(f"file: got {type(file).__name__}, expected a text stream, such as sys.stderr")
        self._file = file
        self._then = then
        self._console = Console(file=file)
        self._has_header = False

    def __reduce__(self) -> tuple[Any, ...]:
        # A console does not go to another process; one of its own is made there.
        return partial(type(self), file=self._file, then=self._then), ()

    def tell(self, record: Any, cells: Sequence[str], style: str) -> object:
        """Print a record's row, and its note below; return the answer of the callback behind."""
        if not self._has_header:
            self._has_header = True
            self._print([name for name, _ in self.columns], "bold")
        self._print(cells, style)
        if record.note:
            self._print([f"{'':{self.columns[0][1]}}", record.note], "dim")
        return self._then(record) if self._then is not None else None

    def _print(self, cells: Sequence[str], style: str) -> None:
        line = "  ".join(cell.rjust(width) for cell, (_, width) in zip(cells, self.columns, strict=False))
        self._console.print(line, style=style, markup=False, highlight=False, soft_wrap=True)


@public
class IterationTable(PrintedTable):
    """Prints the iterations as they happen; give it to `optimize` as the callback, one for each run.

    A full step of a perfect model decreases the cost by half of what is expected. Where a step had to be cut, the step
    of time at which the longer one ended stands under "cut at". The coarsest step of time along the iterate stands
    under "worst s", near 1 where it is sound, with the time at which it begins (s) beside it; under "gap" what multiple
    shooting has still to close.
    One table is for one run: threads do not share it.

    Parameters
    ----------
    file : text stream, optional
        Where to; the standard output if left out. On a terminal the table is in colour.
    then : callable, optional
        Another callback to call after printing; its answer is passed on.
    """

    columns = _COLUMNS

    def __call__(self, record: IterationRecord) -> object:
        """Print one line; return the answer of the callback behind."""
        return self.tell(record, self._cells(record), _STYLES.get(record.method, ""))

    def _cells(self, record: IterationRecord) -> tuple[str, ...]:
        started = record.iteration > 0
        return (
            str(record.iteration),
            record.method.removesuffix("-shifted"),
            f"{record.cost:.9e}",
            f"{record.expected_decrease:.2e}" if started else "",
            f"{record.decrease:.2e}" if started else "",
            f"{record.step_length:.2g}" if started else "",
            str(record.rollouts) if started else "",
            str(record.cut_at) if record.cut_at >= 0 else "",
            f"{record.gap:.1e}" if record.gap else "",
            "" if record.worst_step is None else f"{record.worst_s:.3g}",
            "" if record.worst_step is None else f"{record.worst_t:.4g}",
            f"{record.curvature_scale:.2g}" if record.curvature_scale else "",
            f"{record.shift:.0e}" if record.shift else "",
            f"{record.seconds:.2f}",
        )


_STYLES = {"newton": "green", "newton-damped": "cyan", "steepest": "yellow"}
