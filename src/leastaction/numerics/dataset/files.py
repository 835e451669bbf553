"""Datasets as files of every kind, by their endings: written whole or not at all, read with care."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from leastaction.errors import ArgumentError, ResultFileError
from leastaction.numerics.dataset.archive import read_archive, write_archive
from leastaction.numerics.dataset.dataset import Dataset
from leastaction.numerics.dataset.hdf5 import read_hdf5, write_hdf5
from leastaction.numerics.dataset.matlab import write_matlab
from leastaction.numerics.dataset.tables import read_table, write_table
from leastaction.numerics.dataset.text import parsed, text_of

_MAGIC: Final = ((b"\x89HDF\r\n\x1a\n", ".h5"), (b"PK", ".npz"))
_AGAIN: Final = "Copy it again, or run the optimisation again"


def write(dataset: Dataset, path: str | os.PathLike[str]) -> Path:
    """Write a dataset as its ending says; see `Savable.save`."""
    target = Path(path)
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        known = ", ".join(_WRITERS)
        raise ArgumentError(
            f"path: got {target.name!r}, whose ending {target.suffix!r} says nothing, expected one of {known}"
        )
    return writer(dataset, target)


def read(path: str | os.PathLike[str]) -> Dataset:
    """Read a dataset from a file that `write` wrote, of any kind but ``.mat``, or any table in a ``.csv``.

    Raises `ResultFileError`: the file is missing, damaged, none of these, or of another format.
    """
    source = Path(path)
    kind = _kind_of(source)
    if kind == ".h5":
        return parsed(source, read_hdf5(source))
    if kind == ".npz":
        return parsed(source, read_archive(source))
    return read_table(source)


def _kind_of(source: Path) -> str:
    """Return the ending of the kind of file that this is, by its first bytes, else by its name."""
    ending = source.suffix.lower()
    if ending == ".mat":
        raise ResultFileError(
            f"{source} is a file for MATLAB, which holds too little to go on with. Open the .h5 or .npz of the same run"
        )
    begin = b""
    if source.is_file():
        try:
            with source.open("rb") as file:
                begin = file.read(8)
        except OSError as error:
            raise ResultFileError(
                f"cannot read {source}: {error.strerror or error}. Give the file of an earlier run"
            ) from error
    for magic, kind in _MAGIC:
        if begin.startswith(magic):
            return kind
    if ending in (".h5", ".hdf5") and source.is_file():
        raise ResultFileError(f"{source} is damaged, cut short or no HDF5 file. {_AGAIN}")
    if ending not in _WRITERS and source.is_file():
        raise ResultFileError(
            f"{source} is no run and no result, which end in {', '.join(_WRITERS)}. Models are for leastaction.load, "
            "motions for leastaction.read_motion, captures for leastaction.io.read_capture"
        )
    return ".csv" if ending == ".csv" else ".npz"


def _write_archive(dataset: Dataset, path: Path) -> Path:
    return write_archive(path, text_of(dataset), dataset.arrays)


_WRITERS: Final[Mapping[str, Callable[[Dataset, Path], Path]]] = {
    ".h5": write_hdf5, ".hdf5": write_hdf5, ".npz": _write_archive, ".csv": write_table, ".mat": write_matlab,
}  # fmt: skip
