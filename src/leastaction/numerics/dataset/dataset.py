"""A run or a result as plain data: named arrays with dimensions, units and names of their entries, and the rest.

Everything that is saved becomes a `Dataset` first, and every kind of file is written from one: so all hold the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.dataset.provenance import Provenance

AnyArray = NDArray[Any]

TIME: Final = "time"
"""The dimension of what has a row at every instant."""
STEP: Final = "step"
"""The dimension of what has a row for every step between two instants."""


@dataclass(frozen=True)
class Column:
    """One named value over time.

    Attributes
    ----------
    name : str
        Unique in its dataset.
    unit : str
        "" where there is none, or none that is known.
    values : ndarray, shape (N+1,) or (N,)
        At the instants, or over the steps between them.
    """

    name: str
    unit: str
    values: AnyArray


@dataclass(frozen=True, eq=False)
class Dataset:
    """Named arrays of a run or a result, with dimensions, names and units, and the rest as plain data.

    Attributes
    ----------
    kind : str
        What it is of, such as "Trajectory"; "table" of a file of columns alone.
    t : ndarray, shape (N+1,)
        Times (s).
    arrays : mapping of str to ndarray
        By name; those in another record have dotted names, such as "history.cost".
    dims : mapping of str to tuple of str
        Names of the dimensions of some arrays: "time", "step", or what their entries are.
    labels : mapping of str to tuple of str
        Names of the entries along some dimensions.
    units : mapping of str to str or tuple of str
        Of arrays: one unit, or one for each entry along the last dimension.
    content : mapping
        What is no array: numbers, texts, lists and mappings.
    system : mapping
        What the mechanism was stepped or integrated with, by name; empty where there was none.
    model : str or None
        The mechanism as text; None where there is none, or it cannot be written.
    provenance : Provenance
    """

    kind: str
    t: AnyArray
    arrays: Mapping[str, AnyArray]
    dims: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    units: Mapping[str, str | tuple[str, ...]] = field(default_factory=dict)
    content: Mapping[str, Any] = field(default_factory=dict)
    system: Mapping[str, Any] = field(default_factory=dict)
    model: str | None = None
    provenance: Provenance = field(default_factory=Provenance.now)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Every named value over time; a name that is taken already begins with that of its array."""
        found: dict[str, Column] = {}
        for array, dims in self.dims.items():
            if len(dims) == 2 and dims[0] in (TIME, STEP) and dims[1] in self.labels:
                names, values = self.labels[dims[1]], self.arrays[array]
                for i, (name, unit) in enumerate(zip(names, self.units_of(array, len(names)), strict=True)):
                    short = array.rpartition(".")[2]
                    own = name if name not in found else f"{short}.{name}"
                    found[own] = Column(own, unit, values[:, i])
        return tuple(found.values())

    def units_of(self, array: str, count: int) -> tuple[str, ...]:
        """Return the units of the entries of an array along its last dimension, of which there are ``count``."""
        unit = self.units.get(array, "")
        return (unit,) * count if isinstance(unit, str) else tuple(unit)

    def __getitem__(self, name: str) -> AnyArray:
        """Return a column by name, else an array; raise an `ArgumentError` for an unknown name."""
        named = {column.name: column.values for column in self.columns}
        if name in named or name in self.arrays:
            return named[name] if name in named else self.arrays[name]
        raise ArgumentError(
            f"unknown name {name!r}; {closest(name, (*named, *self.arrays), what='columns and arrays')}"
        )


def table(
    t: AnyArray, columns: Sequence[Column], *, kind: str = "table", content: Mapping[str, Any] | None = None
) -> Dataset:
    """Return columns (N+1,) alone as a dataset."""
    values = np.column_stack([column.values for column in columns]) if columns else np.empty((len(t), 0))
    return Dataset(
        kind=kind,
        t=t,
        arrays={"t": t, "values": values},
        dims={"t": (TIME,), "values": (TIME, "column")},
        labels={"column": tuple(column.name for column in columns)},
        units={"t": "s", "values": tuple(column.unit for column in columns)},
        content=content or {},
    )
