"""Markers from text: tables of places over time (CSV), and the TRC files of motion capture systems."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from leastaction.errors import MotionFileError, ResultFileError
from leastaction.io.motion.text import MotionText, is_missing, number_of, read_text
from leastaction.numerics.arrays import Array
from leastaction.numerics.dataset.tables import read_table

METRES: Final[Mapping[str, float]] = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Units of places, in metres."""

_AXES: Final = (".x", ".y", ".z")
_BEFORE: Final = 5  # lines of a TRC before its numbers


def factor(source: Path, said: str, unit: str | None) -> float:
    """Return the unit of places in metres: what the user says, else what the file does."""
    own = unit if unit is not None else said
    if own not in METRES:
        raise MotionFileError(
            f"{source}: its places are in {own!r}, expected one of {', '.join(METRES)}. Say it: "
            "read_markers(path, unit='mm')"
        )
    return METRES[own]


def named_apart(labels: list[str], n: int) -> tuple[str, ...]:
    """Return a name for each of n markers: those without a label are numbered, as is the second of a name."""
    names: list[str] = []
    for i, label in enumerate([*labels, *[""] * n][:n]):
        name, number = label or f"unlabelled {i + 1}", 1
        while name in names:
            number += 1
            name = f"{label}#{number}"
        names.append(name)
    return tuple(names)


def read_csv(source: Path, unit: str | None) -> tuple[tuple[str, ...], Array, Array]:
    """Return names, times (F,) and places (F, n, 3) in m of a table with columns such as ``hand.x [mm]``."""
    try:
        table = read_table(source)
    except ResultFileError as error:
        raise MotionFileError(str(error)) from error
    columns = {each.name: each for each in table.columns}
    names = tuple(dict.fromkeys(name.removesuffix(end) for name in columns for end in _AXES if name.endswith(end)))
    wanted = [name + end for name in names for end in _AXES]
    if set(wanted) != set(columns):
        odd = next(iter(set(wanted) ^ set(columns)))
        raise MotionFileError(
            f"{source}: {'lacks' if odd in wanted else 'has'} a column {odd!r}, expected the time and three of each "
            "marker, such as 'hand.x [mm]', 'hand.y [mm]', 'hand.z [mm]'"
        )
    values = [columns[name].values * factor(source, columns[name].unit or "m", unit) for name in wanted]
    return names, table.t, np.stack(values, axis=1).reshape(len(table.t), len(names), 3)


class _TrcLines(MotionText):
    """The lines of a TRC."""


def read_trc(source: Path, unit: str | None) -> tuple[tuple[str, ...], Array, Array]:
    """Return names, times (F,) and places (F, n, 3) in m of a TRC; an empty field is a marker that was not seen."""
    text = _TrcLines(source, read_text(source, "a TRC"))
    rows = [line.split("\t") for line in text.lines]
    text.line = 1
    if not rows or not rows[0][0].startswith("PathFileType"):
        text.fail(f"the file begins with {text.lines[0][:60] if rows else ''!r}", "PathFileType: this is no TRC")
    if len(rows) < _BEFORE:
        text.fail(f"the file has {len(rows)} lines", "five before the numbers: it is cut short")
    about = dict(zip((key.strip() for key in rows[1]), (value.strip() for value in rows[2]), strict=False))
    labels = [field.strip() for field in rows[3][2:] if field.strip()]
    metres, width = factor(source, about.get("Units", ""), unit), 3 * len(labels)
    t, places = [], []
    for number, row in enumerate(rows[_BEFORE:], start=_BEFORE + 1):
        text.line = number
        if not any(field.strip() for field in row):
            continue
        fields = [field.strip() for field in row[1:]] + [""] * (width + 1)
        if any(fields[width + 1 :]):
            text.fail(f"{len(row)} fields", f"at most {width + 2}, for {len(labels)} markers")
        for field in fields[: width + 1]:
            if not np.isfinite(number_of(field)) and field and not is_missing(field):
                text.fail(f"got {field[:60]!r}", "a number, or nothing where a marker was not seen")
        time, *numbers = map(number_of, fields[: width + 1])
        t.append(time)
        places.append(numbers)
    return named_apart(labels, len(labels)), np.array(t), metres * np.array(places).reshape(len(t), len(labels), 3)
