"""Datasets as objects of pandas and xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from leastaction.numerics.dataset.dataset import STEP, TIME, Dataset
from leastaction.numerics.extras import extra

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
