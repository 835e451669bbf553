"""What can be saved as a file and become a table of other packages."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from leastaction.numerics.dataset.dataset import AnyArray, Column, Dataset
from leastaction.numerics.dataset.files import write
from leastaction.numerics.dataset.frames import to_pandas, to_xarray
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

    def __getitem__(self, name: str) -> AnyArray:
        """Return a column (N+1,) by name; raise an `ArgumentError` for an unknown one."""
        return self.content[name]
