"""What can be saved as a file and become a table of other packages."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from leastaction.errors import some
from leastaction.numerics.dataset.dataset import STEP, TIME, AnyArray, Column, Dataset
from leastaction.numerics.dataset.files import write
from leastaction.numerics.extras import extra
from leastaction.numerics.public import public

if TYPE_CHECKING:
    import pandas as pd
    import xarray


@public
class Savable(ABC):
    """What can be saved as a file and become a table: runs and results."""

    @abstractmethod
    def dataset(self) -> Dataset:
        """Return all of it as plain data."""

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write it into a file, whole or not at all; an existing file is replaced in one step.

        Parameters
        ----------
        path : path
            Its ending says what is written: ``.h5`` (or ``.hdf5``) and ``.npz`` hold everything, the mechanism too,
            and `leastaction.open` gives it back bit by bit; ``.csv`` holds the columns over time, a line for each
            instant, and ``.mat`` the arrays for MATLAB.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        ArgumentError
            Another ending, or content that is no plain data.
        OutputError
            The file could not be written; an older file of that name is untouched.
        MissingExtraError
            h5py is not installed, which ``.h5`` needs.
        """
        return write(self.dataset(), path)

    def to_pandas(self) -> pd.DataFrame:
        """Return the columns over time as a table: one row for each instant, one column for each name.

        Returns
        -------
        pandas.DataFrame
            Its index is the time (s); what belongs to steps has NaN in the last row. ``.attrs["units"]`` are the units
            by column.

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        return to_pandas(self.dataset())

    def to_xarray(self) -> xarray.Dataset:
        """Return the arrays with their dimensions, names and units.

        Returns
        -------
        xarray.Dataset
            Dimensions are "time", "step" (with the time at which it begins), and what entries are, with their names.
            ``.attrs["units"]`` of an array is its unit; where entries differ, the coordinate ``<array>_units``.

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        return to_xarray(self.dataset())


@dataclass(frozen=True, eq=False)
class Table(Savable):
    """Columns over time as a file holds them, in the units that it says.

    Attributes
    ----------
    content : Dataset
        All of it.
    """

    content: Dataset = field(repr=False)

    @property
    def t(self) -> AnyArray:
        """Times (N+1,) (s)."""
        return self.content.t

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns, each with its name, its unit and its values (N+1,); NaN where there is none."""
        return self.content.columns

    def dataset(self) -> Dataset:
        return self.content

    def __str__(self) -> str:
        """Say how many columns there are, for how long, and their names and units."""
        names = [f"{each.name} [{each.unit}]" if each.unit else each.name for each in self.columns]
        return f"{len(names)} columns at {len(self.t)} times, t = {self.t[0]:g} to {self.t[-1]:g} s: {some(names)}"

    def __getitem__(self, name: str) -> AnyArray:
        """Return a column (N+1,) by name; raise an `ArgumentError` for an unknown one."""
        return self.content[name]


if TYPE_CHECKING:
    import pandas as pd
    import xarray


def to_pandas(dataset: Dataset) -> pd.DataFrame:
    """Return the columns over time; see `Savable.to_pandas`."""
    pandas = extra("pandas", of="data", why="to_pandas")
    n = len(dataset.t)
    columns = {}
    for column in dataset.columns:
        values = np.full(n, np.nan)
        values[: len(column.values)] = column.values
        columns[column.name] = values
    frame: pd.DataFrame = pandas.DataFrame(columns, index=pandas.Index(np.array(dataset.t), name="t"))
    frame.attrs = {"kind": dataset.kind, "units": {column.name: column.unit for column in dataset.columns}}
    return frame


def to_xarray(dataset: Dataset) -> xarray.Dataset:
    """Return the arrays that have dimensions; see `Savable.to_xarray`."""
    module = extra("xarray", of="data", why="to_xarray")
    coords: dict[str, Any] = {TIME: (TIME, np.array(dataset.t), {"units": "s"})}
    used = {dim for dims in dataset.dims.values() for dim in dims}
    if STEP in used:
        coords[STEP] = (STEP, np.array(dataset.t[:-1]), {"units": "s", "long_name": "time at which the step begins"})
    coords |= {dim: list(names) for dim, names in dataset.labels.items() if dim in used}
    variables: dict[str, Any] = {}
    for name, dims in dataset.dims.items():
        short = name.rpartition(".")[2]
        if short == "t":
            continue  # the coordinate
        unit = dataset.units.get(name, "")
        about = {}
        if isinstance(unit, str):
            about["units"] = unit
        else:
            coords[f"{short}_units"] = (dims[-1], list(unit))
        variables[short] = (dims, np.array(dataset.arrays[name]), about)
    attributes = {"kind": dataset.kind, "created": dataset.provenance.created}
    found: xarray.Dataset = module.Dataset(variables, coords=coords, attrs=attributes)
    return found
