"""Any dataclass of arrays, numbers and texts as a file, and back again.

The arrays of the dataclass, and of those in it, are arrays of a NumPy archive under their dotted names, such
as ``result.history.cost``; the rest is a JSON text. `numpy.load` reads all of it. When a file is read, msgspec
holds it to the types of the dataclass. No pickled object is written or read.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Generic, TypeVar

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, ResultFileError, brief
from leastaction.numerics.dataset import Dataset, Provenance
from leastaction.numerics.dataset.archive import read_archive, write_archive
from leastaction.numerics.dataset.plain import plain, restored
from leastaction.numerics.dataset.text import FORMAT_VERSION, parsed, text_of
from leastaction.numerics.public import public

__all__ = ["FORMAT_VERSION", "Provenance", "Record", "load_record", "record_of", "save_record"]

T = TypeVar("T")


@dataclass(frozen=True)
class Record(Generic[T]):
    """What a file holds."""

    content: T
    provenance: Provenance


@public
def save_record(
    path: str | os.PathLike[str],
    content: object,
    *,
    provenance: Provenance | None = None,
    arrays: Mapping[str, ArrayLike] | None = None,
) -> Path:
    """Write a dataclass into a file; an existing file is replaced in one step.

    Parameters
    ----------
    path : path
        The file, by custom with the ending ``.npz``. The name is used as given.
    content : dataclass
        Of arrays, numbers, texts, enums, lists, sets of texts, mappings, mechanisms, and dataclasses of these. A field
        whose metadata say
        ``"recorded": False`` is left out, and has its default when the file is read.
    provenance : Provenance, optional
        Now, if not given.
    arrays : mapping of str to array, optional
        More arrays, for readers other than `load_record`.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; an older file of that name is untouched.
    ArgumentError
        Something in it is no plain data.
    """
    own: dict[str, ArrayLike] = {}
    rest = plain(content, own)
    every = {name: np.asarray(array) for name, array in {**(arrays or {}), **own}.items()}
    dataset = Dataset(
        type(content).__name__, np.empty(0), every, content=rest, provenance=provenance or Provenance.now()
    )
    return write_archive(path, text_of(dataset), every)


@public
def load_record(path: str | os.PathLike[str], *kinds: type[T]) -> Record[T]:
    """Read a dataclass from a file that `save_record` wrote.

    Parameters
    ----------
    path : path
    *kinds : type
        The dataclass, or several of which it may hold any.

    Returns
    -------
    Record
        With read-only arrays.

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, or holds something else than the
        types of the dataclass allow.
    """
    _check_kinds(kinds)
    source = Path(path)
    return record_of(source, parsed(source, read_archive(source)), *kinds)


def _check_kinds(kinds: tuple[object, ...]) -> None:
    if not kinds:
        raise ArgumentError(
            "kinds: got none, expected the class of what the file holds, such as load_record(path, Gap)"
        )
    for kind in kinds:
        if not isinstance(kind, type) or not is_dataclass(kind):
            raise ArgumentError(f"kinds: got {brief(repr(kind))}, expected dataclasses")


def record_of(source: Path, dataset: Dataset, *kinds: type[T]) -> Record[T]:
    """Return the dataclass that a dataset from a file holds; errors as of `load_record`."""
    known = {kind.__name__: kind for kind in kinds}
    if dataset.kind not in known:
        expected = " or a ".join(known)
        raise ResultFileError(f"{source} holds a {dataset.kind}, expected a {expected}. Give the file of such a run")
    try:
        content = restored(known[dataset.kind], dataset.content, dataset.arrays)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise damaged(source, error) from error
    return Record(content, dataset.provenance)


def damaged(source: Path, error: Exception) -> ResultFileError:
    """Return the error that says that a file does not hold what it should."""
    return ResultFileError(
        f"{source} is damaged or of another version: {error}. Copy it again, or run the optimisation again"
    )
