"""Datasets as HDF5: arrays in groups, with their dimensions, names and units as attributes, and the text beside them.

Other programs read names and units at each array. What this package reads is the text and the arrays.
"""

from __future__ import annotations

import io
import zlib
from pathlib import Path
from typing import Any, Final

import numpy as np

from leastaction.errors import ArgumentError, OutputError, ResultFileError
from leastaction.numerics.dataset.archive import Archive, reading
from leastaction.numerics.dataset.dataset import AnyArray, Dataset
from leastaction.numerics.dataset.text import text_of
from leastaction.numerics.extras import extra
from leastaction.numerics.files import write_bytes

_TEXT: Final = "leastaction_record"
_CHECK: Final = "leastaction_record_crc32"
_KINDS: Final = "biuf"
_MOST_ARRAYS: Final = 1000
_MOST_DEPTH: Final = 32


def write_hdf5(dataset: Dataset, path: Path) -> Path:
    """Write a dataset; an existing file is replaced in one step."""
    h5py = extra("h5py", of="data", why=f"{path.name}")
    text = text_of(dataset)
    stream = io.BytesIO()
    try:
        with h5py.File(stream, "w") as file:
            file.attrs["kind"] = dataset.kind
            file.create_dataset(_TEXT, data=text, dtype=h5py.string_dtype())
            file.attrs[_CHECK] = zlib.crc32(text.encode())
            for name, given in dataset.arrays.items():
                array = np.asarray(given)
                if array.dtype.kind not in _KINDS:
                    raise ArgumentError(f"{name}: got an array of {array.dtype}, expected real numbers")
                # Sums by which damage is seen.
                written = file.create_dataset(
                    name.replace(".", "/"), data=array, fletcher32=array.size > 0 < array.ndim
                )
                _describe(written, dataset, name)
    except (OSError, RuntimeError, ValueError) as error:
        if isinstance(error, ArgumentError):
            raise
        raise OutputError(f"cannot write {path}: {error}. Save it as .npz") from error
    return write_bytes(path, stream.getvalue())


def read_hdf5(source: Path) -> Archive:
    """Return text and arrays of a file, read-only; raise a `ResultFileError` where it is none of these."""
    h5py = extra("h5py", of="data", why=f"{source.name}")
    with reading(source) as size, h5py.File(source, "r") as file:
        if _TEXT not in file:
            raise ResultFileError(
                f"{source} is no result of leastaction: it lacks {_TEXT}. Give the file of an earlier run"
            )
        text = str(file[_TEXT].asstr()[()])
        if zlib.crc32(text.encode()) != int(file.attrs[_CHECK]):
            raise ValueError("its text has changed")
        arrays: dict[str, AnyArray] = {}
        _read(h5py, file, "", arrays, size)
    return Archive(text, arrays)


def _describe(written: Any, dataset: Dataset, name: str) -> None:
    """Write dimensions, names and units of an array beside it, as far as its attributes have room for them."""
    dims = dataset.dims.get(name, ())
    about: dict[str, Any] = {"dimensions": list(dims)} if dims else {}
    if name in dataset.units:
        about["units"] = dataset.units[name]
    for dim in dims:
        if dim in dataset.labels:
            about[f"names of {dim}"] = list(dataset.labels[dim])
    for key, value in about.items():
        if sum(map(len, value)) < 2**14:
            written.attrs[key] = value if isinstance(value, str) else [str(each) for each in value]


def _read(h5py: Any, group: Any, prefix: str, arrays: dict[str, AnyArray], size: int, depth: int = 0) -> None:
    """Read the arrays of a group; none that lies in another file, or unfolds into more than this one is."""
    for name in group:
        if prefix == "" and name == _TEXT:
            continue
        if not isinstance(group.get(name, getlink=True), h5py.HardLink) or depth > _MOST_DEPTH:
            raise ValueError(f"{prefix}{name} is a link")
        entry = group[name]
        if isinstance(entry, h5py.Group):
            _read(h5py, entry, f"{prefix}{name}.", arrays, size, depth + 1)
            continue
        if entry.is_virtual or entry.external is not None or entry.dtype.kind not in _KINDS:
            raise ValueError(f"{prefix}{name} holds no plain numbers")
        if entry.nbytes > size or len(arrays) >= _MOST_ARRAYS:
            raise ValueError(f"{prefix}{name} claims to hold {entry.nbytes} bytes in a file of {size}")
        array = np.asarray(entry[()])
        array.setflags(write=False)
        arrays[f"{prefix}{name}"] = array
