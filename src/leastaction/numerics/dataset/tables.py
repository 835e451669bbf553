"""Columns over time as text: a header of names and units, and a line for each instant."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError, ResultFileError
from leastaction.numerics.dataset.dataset import AnyArray, Column, Dataset, table
from leastaction.numerics.files import write_text

_MOST_BYTES: Final = 2**30
_HEADER: Final = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$", re.DOTALL)
_TIMES: Final = ("t", "time", "Time", "TIME", "T")


def write_table(dataset: Dataset, path: Path) -> Path:
    """Write the columns of a dataset; what belongs to steps is left blank in the last line.

    Numbers are as short as they can be to come back the same. Raises `ArgumentError` for a name that would not.
    """
    columns = dataset.columns
    for column in columns:
        if column.name != column.name.strip() or column.name.endswith("]") or column.name in _TIMES:
            raise ArgumentError(
                f"{path.name}: the name {column.name!r} cannot stand in the header of a table, where a unit in "
                "brackets follows and the first column is the time. Save it as .h5 or .npz, or rename it"
            )
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["t [s]", *(f"{each.name} [{each.unit}]" if each.unit else each.name for each in columns)])
    values = [each.values.tolist() for each in columns]
    for k, t in enumerate(dataset.t.tolist()):
        writer.writerow([repr(t), *(repr(each[k]) if k < len(each) else "" for each in values)])
    return write_text(path, stream.getvalue())


def read_table(source: Path) -> Dataset:
    """Return a table of a file: a first column of times, a header with names, and units in brackets where known.

    A field that is empty, or spells NaN, is NaN. Raises `ResultFileError`: the file cannot be read or is no such table;
    the message names the line.
    """
    rows = _rows(source)
    if not rows:
        raise ResultFileError(f"{source} is empty, expected a header with names and a line for each instant")
    (first, header), body = rows[0], rows[1:]
    found = [_HEADER.match(each.strip()) for each in header]
    names = [each["name"] if each else "" for each in found]
    units = [(each["unit"] or "").strip() if each else "" for each in found]
    if names[0] not in _TIMES:
        raise ResultFileError(
            f"{source}, line {first}: the first column is {names[0][:60]!r}, expected the time, such as 't [s]', and "
            "then names with their units, such as 'elbow [rad]'"
        )
    if units[0] not in ("", "s"):
        raise ResultFileError(f"{source}, line {first}: the time is in {units[0]!r}, expected seconds, 't [s]'")
    for i, name in enumerate(names):
        if not name or name in names[:i]:
            what = f"the name {name!r} comes twice" if name else f"column {i + 1} has no name"
            raise ResultFileError(f"{source}, line {first}: {what}; give every column a name of its own")
    if len(body) < 1:
        raise ResultFileError(f"{source} holds a header and no numbers, expected a line for each instant")
    values = np.empty((len(body), len(names)))
    for k, (line, row) in enumerate(body):
        if len(row) != len(names):
            raise ResultFileError(
                f"{source}, line {line}: {len(row)} fields, expected {len(names)} as in the header; is it cut short?"
            )
        values[k] = [_number(source, line, name, text) for name, text in zip(names, row, strict=True)]
    t = values[:, 0].copy()
    if not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
        k = int(np.flatnonzero(~np.isfinite(t) | np.append(False, ~(np.diff(t) > 0.0)))[0])
        raise ResultFileError(f"{source}, line {body[k][0]}: the time is {t[k]:g}, expected times that increase")
    values.setflags(write=False)
    columns = [Column(*each) for each in zip(names[1:], units[1:], _columns(values), strict=True)]
    return table(t, columns, content={"source": source.stem})


def _columns(values: AnyArray) -> list[AnyArray]:
    return [values[:, i] for i in range(1, values.shape[1])]


def _rows(source: Path) -> list[tuple[int, list[str]]]:
    """Return the rows of a file that are not empty, with the numbers of their lines."""
    try:
        with source.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        text = content.decode("utf-8-sig")
    except OSError as error:
        raise ResultFileError(
            f"cannot read {source}: {error.strerror or error}. Give a table of names over time"
        ) from error
    except UnicodeDecodeError as error:
        raise ResultFileError(f"{source} holds bytes that are no text, expected a table of names over time") from error
    if len(content) > _MOST_BYTES:
        raise ResultFileError(f"{source} is larger than {_MOST_BYTES} bytes. Cut it, or save it as .npz")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise ResultFileError(f"{source}, line {reader.line_num}: {error}; expected fields between commas") from error
    return [(line, row) for line, row in rows if any(each.strip() for each in row) and not row[0].startswith("#")]


def _number(source: Path, line: int, name: str, text: str) -> float:
    word = text.strip()
    if word == "":
        return float("nan")
    try:
        if "_" in word or not word.isascii():
            raise ValueError
        return float(word)
    except ValueError:
        raise ResultFileError(
            f"{source}, line {line}: {name} is {word[:60]!r}, expected a number, or nothing where there is none"
        ) from None
