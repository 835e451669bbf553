"""Datasets as MATLAB's files: a structure of arrays with their names and units, and one of columns by name."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.errors import OutputError
from leastaction.numerics.dataset.dataset import Dataset
from leastaction.numerics.files import write_bytes

_LONGEST = 63  # of MATLAB's names


def write_matlab(dataset: Dataset, path: Path) -> Path:
    """Write a dataset as variables: ``t``, ``columns.<name>``, ``units.<name>``, ``names.<name>``, ``arrays.<name>``.

    Names are made such as MATLAB takes; ``names`` has the original ones.
    """
    from scipy.io import savemat

    columns = dataset.columns
    fields = _fields([column.name for column in columns])
    arrays: dict[str, Any] = {}
    for name, field in zip(dataset.arrays, _fields(list(dataset.arrays)), strict=True):
        arrays[field] = np.asarray(dataset.arrays[name])
    content: dict[str, Any] = {
        "kind": dataset.kind,
        "t": dataset.t.reshape(-1, 1),
        "columns": {field: each.values.reshape(-1, 1) for field, each in zip(fields, columns, strict=True)},
        "units": {field: each.unit for field, each in zip(fields, columns, strict=True)},
        "names": {field: each.name for field, each in zip(fields, columns, strict=True)},
        "arrays": arrays,
        "labels": dict(zip(_fields(list(dataset.labels)), map(_cells, dataset.labels.values()), strict=True)),
        "created": dataset.provenance.created,
    }
    stream = io.BytesIO()
    try:
        savemat(stream, content, long_field_names=True, oned_as="column")
    except (TypeError, ValueError, OverflowError) as error:
        raise OutputError(f"cannot write {path}: {error}. Save it as .h5, which MATLAB reads too") from error
    return write_bytes(path, stream.getvalue())


def _cells(names: tuple[str, ...]) -> Any:
    cells = np.empty(len(names), dtype=object)
    cells[:] = names
    return cells


def _fields(names: list[str]) -> list[str]:
    """Return names that MATLAB takes, each once."""
    fields: list[str] = []
    for name in names:
        field = re.sub(r"[^A-Za-z0-9_]", "_", name)
        field = (field if field[:1].isalpha() else f"x{field}")[:_LONGEST]
        taken, number = field, 1
        while taken in fields:
            number += 1
            taken = f"{field[: _LONGEST - 1 - len(str(number))]}_{number}"
        fields.append(taken)
    return fields
