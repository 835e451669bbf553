"""A text and named arrays in one NumPy ``.npz`` file, and such files from anywhere read with care.

Sizes come first: nothing is read that is not as large as the file says and the file is not as large as.
So no array is made for a shape without content, and nothing can unfold into more than lies on the disk.
"""

from __future__ import annotations

import io
import math
import os
import stat
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError, ResultFileError
from leastaction.numerics.files import atomic_write
from leastaction.numerics.names import check_name

AnyArray = NDArray[Any]

_TEXT: Final = "leastaction_record"
_MOST_BYTES: Final = 16 * 2**30
_MOST_TEXT_BYTES: Final = 16 * 2**20
_MOST_ENTRIES: Final = 1000
_HEADER_READERS: Final = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
_KINDS: Final = "biufcU"  # plain numbers and text; an object would have to be unpickled


class Archive(NamedTuple):
    """What an archive holds."""

    text: str
    arrays: dict[str, AnyArray]


def write_archive(path: str | os.PathLike[str], text: str, arrays: Mapping[str, ArrayLike]) -> Path:
    """Write an archive; an existing file is replaced in one step.

    Raises `OutputError`: the file could not be written; an older file of that name is untouched. Raises
    `ArgumentError`: an array holds neither numbers nor text.
    """
    plain = {check_name(name, "arrays"): np.asarray(value) for name, value in arrays.items()}
    for name, array in plain.items():
        if array.dtype.kind not in _KINDS:
            raise ArgumentError(f"{name}: got an array of {array.dtype}, expected numbers or text")
    with atomic_write(path) as stream:
        # Not compressed: gains are noise to a compressor, which saves a twentieth and takes longer than
        # the run; and what is not compressed cannot unfold.
        np.savez(stream, **{_TEXT: np.array(text)}, **plain)  # type: ignore[arg-type]
    return Path(path)


def read_archive(path: str | os.PathLike[str]) -> Archive:
    """Read an archive; its arrays are read-only.

    Raises `ResultFileError`: the file is missing, damaged, or none of these archives; the message says which.
    """
    source = Path(path)
    with reading(source) as size, zipfile.ZipFile(source) as file:
        entries = _judged(source, file, size)
        text = _array(file.read(entries.pop(_TEXT)))
        arrays = {name: _array(file.read(entry)) for name, entry in entries.items()}
    if text.dtype.kind != "U" or text.shape != ():
        raise ResultFileError(
            f"{source} is damaged: {_TEXT} is an array {text.shape} of {text.dtype}, expected a text. "
            "Copy it again, or run the optimisation again"
        )
    return Archive(str(text), arrays)


@contextmanager
def reading(source: Path) -> Iterator[int]:
    """Yield the size of a file that is read; raise a `ResultFileError` for whatever its readers raise."""
    try:
        about = source.stat()
        if not stat.S_ISREG(about.st_mode):
            raise ResultFileError(f"cannot read {source}: it is no regular file. Give the file of an earlier run")
        yield about.st_size
    except ResultFileError:
        raise
    except OSError as error:
        reason = " ".join(str(error.strerror or error).split())[:200]
        raise ResultFileError(
            f"cannot read {source}: {reason}. It is damaged, cut short or not there; give the file of an earlier run"
        ) from error
    # A damaged file makes its readers raise nearly anything; to the caller it is all the same.
    except Exception as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ResultFileError(
            f"{source} is damaged, cut short or no result of leastaction ({reason}). "
            "Copy it again, or run the optimisation again"
        ) from error


def _judged(source: Path, file: zipfile.ZipFile, size: int) -> dict[str, zipfile.ZipInfo]:
    """Return the entries by the names of their arrays, if all of them may be read."""
    entries = {entry.filename.removesuffix(".npy"): entry for entry in file.infolist()}
    if _TEXT not in entries:
        raise ResultFileError(
            f"{source} is no result of leastaction: it lacks {_TEXT}. Give the file of an earlier run"
        )
    if packed := [n for n, entry in entries.items() if entry.compress_type != zipfile.ZIP_STORED]:
        raise ResultFileError(f"{source}: {packed[0]} is compressed, expected plain arrays. Save them with numpy.savez")
    total = sum(entry.file_size for entry in file.infolist())
    if (
        total > min(size, _MOST_BYTES)
        or len(file.infolist()) > _MOST_ENTRIES
        or entries[_TEXT].file_size > _MOST_TEXT_BYTES
    ):
        raise ResultFileError(
            f"{source} claims to hold {total} bytes in {len(file.infolist())} arrays, in a file of {size} "
            f"bytes; expected at most {_MOST_ENTRIES} arrays and {_MOST_BYTES} bytes. "
            "It is damaged or no result of leastaction"
        )
    return entries


def _array(content: bytes) -> AnyArray:
    """Return the array of one entry; its bytes are not copied."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADER_READERS:
        raise ValueError(f"an array in NumPy's format {version}")
    shape, by_columns, dtype = _HEADER_READERS[version](stream)
    if dtype.kind not in _KINDS:
        raise ValueError(f"an array of {dtype}, expected numbers or text")
    start = stream.tell()
    if math.prod(shape) * dtype.itemsize != len(content) - start:
        raise ValueError(f"an array {shape} of {dtype} in {len(content) - start} bytes")
    flat = np.frombuffer(content, dtype, offset=start)
    return flat.reshape(shape, order="F" if by_columns else "C")
