"""A run as a table for people and as JSON for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any, TextIO

from benchmarks import unit
from benchmarks.suite import Measured
from benchmarks.timing import Row

HEADER = ("what", "time", "per", "thr.", "target", "/ target", "/ unit", "vs C 2012", "")


def progress(stream: TextIO) -> Callable[[str], None]:
    """Return a function that tells which group is being measured, silent where nobody watches."""

    def tell(name: str) -> None:
        if stream.isatty():
            print(f"measuring {name} ...", file=stream, flush=True)

    return tell


def as_json(measured: Measured) -> str:
    """Return one JSON object. Times are in seconds, ratios plain; README.md lists the fields."""
    return json.dumps(
        _finite(
            {
                "format": 1,
                "machine": measured.machine,
                "mechanism": measured.case,
                "quick": measured.quick,
                "unit": _unit(measured),
                "rows": [_row(row, measured.unit) for row in measured.rows],
                "absent": [vars(row) for row in measured.absent],
            }
        ),
        indent=1,
        allow_nan=False,
    )


def print_table(measured: Measured) -> None:
    """Print the table, with rich where it is installed."""
    lines = [_cells(row, measured.unit) for row in measured.rows]
    groups = [row.group for row in measured.rows]
    about = _about(measured)
    try:
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        _print_plain(about, lines, groups)
        return
    console = Console()
    if not console.is_terminal:
        _print_plain(about, lines, groups)
        return
    for line in about:
        console.print(line, markup=False, highlight=False)
    table = Table(*HEADER, box=None, pad_edge=False)
    for column in table.columns[1:8]:
        column.justify = "right"
    for index, (cells, row) in enumerate(zip(lines, measured.rows, strict=True)):
        ratio = _ratio(row.value, row.target)
        style = None
        if row.reference:
            style = "dim"
        elif ratio is not None:
            style = "green" if ratio <= 1.0 else "red"
        last = index + 1 == len(groups) or groups[index + 1] != groups[index]
        table.add_row(*cells, style=style, end_section=last)
    console.print(table)


def _print_plain(about: list[str], lines: list[tuple[str, ...]], groups: list[str]) -> None:
    print("\n".join(about))
    widths = [max(len(cells[i]) for cells in [HEADER, *lines]) for i in range(len(HEADER) - 1)]
    previous = None
    for group, cells in zip(["", *groups], [HEADER, *lines], strict=True):
        if group != previous:
            print()
        previous = group
        padded = [cells[0].ljust(widths[0])]
        padded += [cell.rjust(width) for cell, width in zip(cells[1:8], widths[1:], strict=True)]
        print("  ".join([*padded, cells[8]]).rstrip())


def _about(measured: Measured) -> list[str]:
    m = measured.machine
    versions = ", ".join(f"{name} {v}" for name, v in m["versions"].items() if v)
    lines = [
        f"{m['cpu']}, {m['cores']} cores, load {m['load_at_start']}; core variant "
        f"{m['core_variant']}; Python {m['python']}; {versions}",
        f"marionette: {measured.case}. Best of several repeats; rows with one thread use one core.",
    ]
    if measured.quick:
        lines.append("quick run: short problems and few repeats, not to be compared with anything")
    u = _unit(measured)
    if u is not None:
        lines.append(
            f"unit: Pinocchio computeRNEADerivatives, Talos: {_time(u['before'])} before, "
            f"{_time(u['after'])} after (drift {100 * u['drift']:+.0f} %); "
            f"{_time(u['at_design'])} when the targets were set"
        )
    lines += [f"absent: {row.name} ({row.reason})" for row in measured.absent]
    return lines


def _unit(measured: Measured) -> dict[str, Any] | None:
    before, after = measured.unit_before, measured.unit_after
    if before is None or after is None:
        return None
    return {
        "what": "Pinocchio computeRNEADerivatives on Talos (38 DOF)",
        "before": before.best,
        "after": after.best,
        "drift": after.best / before.best - 1.0,
        "value": measured.unit,
        "at_design": unit.AT_DESIGN,
    }


def _row(row: Row, of_unit: float | None) -> dict[str, Any]:
    """Return a row with its ratios."""
    fields = dict(vars(row))
    is_time = row.unit == "s"
    to_target = _ratio(row.value, row.target)
    drifted = None
    if to_target is not None:
        # As if this machine were as fast as the one that the targets were set on.
        scale = unit.AT_DESIGN / of_unit if is_time and of_unit else 1.0
        drifted = to_target * scale
    return fields | {
        "ratio_to_target": to_target,
        "ratio_to_target_by_unit": drifted,
        "ratio_to_unit": _ratio(row.value, of_unit) if is_time else None,
        "speedup_over_dissertation": _ratio(row.dissertation, row.value),
    }


def _cells(row: Row, of_unit: float | None) -> tuple[str, ...]:
    fields = _row(row, of_unit)
    show = _time if row.unit == "s" else "{:.2f}".format
    speedup = fields["speedup_over_dissertation"]
    return (
        row.name,
        show(row.value),
        row.per,
        str(row.threads) if row.unit == "s" and not row.reference else "",
        "" if row.target is None else f"<= {show(row.target)}",
        _number(fields["ratio_to_target"]),
        _number(fields["ratio_to_unit"]),
        "" if speedup is None else f"{speedup:.0f} x" if speedup >= 10 else f"{speedup:.1f} x",
        row.note,
    )


def _finite(value: Any) -> Any:
    """Return the same with null for what JSON has no number for."""
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _ratio(value: float | None, by: float | None) -> float | None:
    return None if value is None or by is None else value / by


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.2f}" if value < 100 else f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _time(seconds: float) -> str:
    for size, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if seconds >= size:
            return f"{seconds / size:.3g} {name}" if seconds < 100 * size else f"{seconds / size:.0f} {name}"
    return f"{seconds / 1e-9:.3g} ns"
