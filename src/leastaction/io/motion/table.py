"""Motions as tables of text: a header of names and units, a line for each instant."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal, get_args

import numpy as np
from scipy.interpolate import CubicSpline

from leastaction.errors import MotionFileError, ResultFileError
from leastaction.io.motion.motion import Motion
from leastaction.numerics.arrays import Array, as_choice
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.dataset.tables import read_table

UNITS: Final[Mapping[str, float]] = {
    "": 1.0, "rad": 1.0, "m": 1.0, "mm": 1e-3, "cm": 1e-2, "deg": np.pi / 180.0, "degrees": np.pi / 180.0,
    "°": np.pi / 180.0, "radians": 1.0, "metres": 1.0, "meters": 1.0,
}  # fmt: skip
"""What a unit in a header is in rad or m; a column without one is taken as it is."""


Between = Literal["linear", "spline"]
"""How values that are missing follow from those before and after: on straight lines, or on the cubic spline."""

_ROTATION = tuple(f".q{letter}" for letter in "wxyz")  # ends of the names of a rotation's numbers


def read_table_motion(path: str | os.PathLike[str], gaps: Between | None = None) -> Motion:
    """Read a motion from a table; ``gaps``: as of `read_motion`.

    Raises `MotionFileError`: the file cannot be read, or is no table of angles and lengths that are known throughout,
    or of which nothing is known that gaps could be filled from.
    """
    source = Path(path)
    if gaps is not None:
        as_choice(gaps, "gaps", get_args(Between))
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
        if len(missing) == len(table.t):
            raise MotionFileError(f"{source}: {column.name} has no value that is known; leave the column out")
        if len(missing) and gaps is None:
            raise MotionFileError(
                f"{source}: {column.name} is {column.values[missing[0]]} at t = {table.t[missing[0]]:g} s, expected "
                "finite values; leave the column out, or have gaps filled: gaps='linear' or gaps='spline'"
            )
    found = motion_of(table, gaps)
    if found is None:
        raise MotionFileError(f"{source}: holds {len(table.t)} instant, expected two or more")
    return found


def _filled(table: Dataset, between: Between) -> dict[str, Array]:
    """Return the columns of a table by name, with what is missing filled from what is before and after.

    At the ends the nearest value is held. Rotations that are four numbers are filled as a whole, of unit length.
    """
    values = {column.name: np.array(column.values, dtype=np.float64) for column in table.columns}
    for name in values:
        joint = name.removesuffix(_ROTATION[0])
        together = [f"{joint}{end}" for end in _ROTATION] if name.endswith(_ROTATION[0]) else []
        if together and all(each in values for each in together):
            rows = np.stack([values[each] for each in together], axis=1)
            rows[~np.isfinite(rows).all(axis=1)] = np.nan
            values.update(zip(together, _filled_rotations(table.t, rows, between).T, strict=True))
    return {name: _filled_numbers(table.t, numbers, between) for name, numbers in values.items()}


def _filled_rotations(t: Array, rows: Array, between: Between) -> Array:
    """Return quaternions (N+1, 4) with the rows filled that are not known; both signs of one are the same rotation."""
    known = np.flatnonzero(np.isfinite(rows).all(axis=1))
    if len(known) in (0, len(t)):
        return rows
    same = np.sum(rows[known[1:]] * rows[known[:-1]], axis=1) >= 0.0
    signs = np.cumprod(np.concatenate([[1.0], np.where(same, 1.0, -1.0)]))
    turned = np.full_like(rows, np.nan)
    turned[known] = signs[:, None] * rows[known]
    found = np.stack([_filled_numbers(t, numbers, between) for numbers in turned.T], axis=1)
    found /= np.linalg.norm(found, axis=1)[:, None]
    # What is known stays as it is written; what is filled has the sign of what is before.
    before = np.clip(np.searchsorted(known, np.arange(len(t)), side="right") - 1, 0, None)
    found *= signs[before][:, None]
    found[known] = rows[known]
    return found


def _filled_numbers(t: Array, values: Array, between: Between) -> Array:
    """Return values (N+1,) with those filled that are not known."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    inside = np.clip(t[~known], t[known][0], t[known][-1])
    filled = values.copy()
    if between == "linear" or known.sum() < 3:
        filled[~known] = np.interp(inside, t[known], values[known])
    else:
        filled[~known] = CubicSpline(t[known], values[known])(inside)
    return filled


def motion_of(table: Dataset, gaps: Between | None = None) -> Motion | None:
    """Return a table as a motion, in rad and m; None where a column is something else, or not known throughout.

    ``gaps``: how they are filled.
    """
    columns = table.columns
    values = {each.name: each.values for each in columns} if gaps is None else _filled(table, gaps)
    known = all(each.unit in UNITS and np.isfinite(values[each.name]).all() for each in columns)
    if not known or len(table.t) < 2 or not columns:
        return None
    q = np.column_stack([values[each.name] * UNITS[each.unit] for each in columns])
    return Motion(tuple(each.name for each in columns), table.t, q, str(table.content.get("source", "")))
