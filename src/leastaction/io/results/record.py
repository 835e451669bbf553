"""Any dataclass of arrays, numbers and texts as a file, and back again.

The arrays of the dataclass, and of those in it, are arrays of a NumPy archive under their dotted names, such
as ``result.history.cost``; the rest is a JSON text. `numpy.load` reads all of it. When a file is read, msgspec
holds it to the types of the dataclass. No pickled object is written or read.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from datetime import UTC, datetime
from enum import Enum
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, Final, Generic, Literal, TypeVar, get_args, get_type_hints

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction._version import __version__
from leastaction.errors import ArgumentError, ResultFileError
from leastaction.io.results.archive import read_archive, write_archive

T = TypeVar("T")

FORMAT_VERSION: Final = 2


@dataclass(frozen=True)
class Provenance:
    """When something was made, and with which programs.

    ``created``: ISO 8601. ``versions``: of Python, the platform, and the packages that a result depends on.
    """

    created: str
    versions: Mapping[str, str]

    @classmethod
    def now(cls) -> Provenance:
        """Return the provenance of what is being made."""
        packages = {name: metadata.version(name) for name in ("numpy", "scipy")}
        programs = {"python": platform.python_version(), "platform": platform.platform()}
        return cls(
            datetime.now(UTC).isoformat(timespec="seconds"), {"leastaction": __version__, **packages, **programs}
        )


@dataclass(frozen=True)
class Record(Generic[T]):
    """What a file holds."""

    content: T
    provenance: Provenance


class _Format(msgspec.Struct):
    """As much of the text as says whether the rest can be understood."""

    format: Literal["leastaction run"]
    format_version: Annotated[int, msgspec.Meta(ge=1)]
    versions: dict[str, str]


class _Text(_Format):
    kind: str
    created: str
    content: dict[str, Any]


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
        Of arrays, numbers, texts, enums, lists, mappings, and dataclasses of these. A field whose metadata say
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
    origin = provenance or Provenance.now()
    own: dict[str, ArrayLike] = {}
    text = {
        "format": "leastaction run",
        "format_version": FORMAT_VERSION,
        "versions": dict(origin.versions),
        "kind": type(content).__name__,
        "created": origin.created,
        "content": _without_arrays(content, "", own),
    }
    try:
        encoded = msgspec.json.encode(text).decode()
    except (TypeError, ValueError, RecursionError) as error:
        raise ArgumentError(
            f"{type(content).__name__}: only arrays, numbers, texts, lists, mappings and dataclasses of "
            f"these can be saved ({error})"
        ) from error
    return write_archive(path, encoded, {**(arrays or {}), **own})


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
    source = Path(path)
    archive = read_archive(source)
    try:
        found = msgspec.json.decode(archive.text, type=_Format)
        if found.format_version != FORMAT_VERSION:
            raise _unknown_format(source, found)
        text = msgspec.json.decode(archive.text, type=_Text)
        known = {kind.__name__: kind for kind in kinds}
        if text.kind not in known:
            expected = " or a ".join(known)
            raise ResultFileError(f"{source} holds a {text.kind}, expected a {expected}. Give the file of such a run")
        kind = known[text.kind]
        for name, array in archive.arrays.items():
            _put(text.content, name.split("."), array)
        _name_members(kind, text.content)
        content = msgspec.convert(text.content, kind, dec_hook=_checked_array)
    except ResultFileError:
        raise
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ResultFileError(
            f"{source} is damaged or of another version: {error}. Copy it again, or run the optimisation again"
        ) from error
    return Record(content, Provenance(text.created, text.versions))


def _unknown_format(source: Path, found: _Format) -> ResultFileError:
    maker = found.versions.get("leastaction", "another version")
    advice = (
        f"Upgrade leastaction (it was written by {maker})"
        if found.format_version > FORMAT_VERSION
        else f"Run the optimisation again (it was written by {maker}); numpy.load still reads its arrays"
    )
    return ResultFileError(
        f"{source} has format {found.format_version}, this leastaction reads {FORMAT_VERSION}. {advice}"
    )


def _without_arrays(value: Any, name: str, arrays: dict[str, ArrayLike]) -> Any:
    """Return a value as JSON can hold it; its arrays, and numbers that JSON does not know, go to `arrays`."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) or (isinstance(value, float) and not isfinite(value)):
        arrays[name] = value
        return None
    if is_dataclass(value):
        kept = [field.name for field in fields(value) if field.metadata.get("recorded", True)]
        value = {name: getattr(value, name) for name in kept}
    if isinstance(value, Mapping):
        prefix = f"{name}." if name else ""
        return {key: _without_arrays(v, f"{prefix}{key}", arrays) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_arrays(v, f"{name}.{i}", arrays) for i, v in enumerate(value)]
    return value.name if isinstance(value, Enum) else value


def _put(content: Any, path: list[str], array: NDArray[Any]) -> None:
    """Put an array where it was taken from; one that was not taken from there is left out."""
    for part in path[:-1]:
        if isinstance(content, list) and part.isdecimal() and int(part) < len(content):
            content = content[int(part)]
        else:
            content = content.get(part) if isinstance(content, dict) else None
    if isinstance(content, dict) and path[-1] in content:
        content[path[-1]] = array.item() if array.shape == () else array


def _name_members(kind: Any, content: Any) -> None:
    """Replace the names of enums' members by the members, of a dataclass and those in it."""
    for name, hint in get_type_hints(kind).items():
        if isinstance(content, dict) and name in content:
            if type(None) in get_args(hint):
                hint = next(kind for kind in get_args(hint) if kind is not type(None))
            if is_dataclass(hint):
                _name_members(hint, content[name])
            elif isinstance(hint, type) and issubclass(hint, Enum):
                content[name] = hint[content[name]]


def _checked_array(kind: Any, value: Any) -> NDArray[Any]:
    """Return an array if it is of the type that the field asks for."""
    if not isinstance(value, np.ndarray):
        raise ValueError("an array is missing")
    (expected,) = get_args(get_args(kind)[1])
    if value.dtype != expected:
        raise ValueError(f"an array of {value.dtype}, expected {np.dtype(expected)}")
    return value
