"""Motions as tables of text: a header of names and units, a line for each instant."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from leastaction.errors import MotionFileError, ResultFileError
from leastaction.io.motion.motion import Motion
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.dataset.tables import read_table

UNITS: Final[Mapping[str, float]] = {
    "": 1.0, "rad": 1.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "deg": np.pi / 180.0, "degrees": np.pi / 180.0,
    "°": np.pi / 180.0, "radians": 1.0, "metres": 1.0, "meters": 1.0,
}  # fmt: skip
"""What a unit in a header is in rad or m; a column without one is taken as it is."""


def read_table_motion(path: str | os.PathLike[str]) -> Motion:
    """Read a motion from a table.

    Raises `MotionFileError`: the file cannot be read, or is no table of angles and lengths that are known throughout.
    """
    source = Path(path)
    try:
        table = read_table(source)
    except ResultFileError as error:
        raise MotionFileError(str(error)) from error
    if not table.columns:
        raise MotionFileError(f"{source}: holds no columns but the time, expected some with names")
    for column in table.columns:
        if column.unit not in UNITS:
            raise MotionFileError(
                f"{source}: {column.name} is in {column.unit!r}, expected an angle or a length: "
                f"{', '.join(filter(None, UNITS))}"
            )
        missing = np.flatnonzero(~np.isfinite(column.values))
        if len(missing):
            raise MotionFileError(
                f"{source}: {column.name} is {column.values[missing[0]]} at t = {table.t[missing[0]]:g} s, expected "
                "finite values; leave the column out, or fill it"
            )
    found = motion_of(table)
    if found is None:
        raise MotionFileError(f"{source}: holds {len(table.t)} instant, expected two or more")
    return found


def motion_of(table: Dataset) -> Motion | None:
    """Return a table as a motion, in rad and m; None where a column is something else, or not known throughout."""
    columns = table.columns
    known = all(each.unit in UNITS and np.isfinite(each.values).all() for each in columns)
    if not known or len(table.t) < 2 or not columns:
        return None
    q = np.column_stack([each.values * UNITS[each.unit] for each in columns])
    return Motion(tuple(each.name for each in columns), table.t, q, str(table.content.get("source", "")))
