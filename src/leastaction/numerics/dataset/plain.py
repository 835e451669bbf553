"""Dataclasses as plain data and arrays, and back again.

The arrays of a dataclass, and of those in it, are kept under their dotted names, such as ``history.cost``; the rest is
what JSON can hold. On the way back msgspec holds it to the types of the dataclass. Of a class that `said_by_text` was
told of, a text stands for the object. A field whose metadata say ``"recorded": False`` is left out; ``"earlier": (name,
function)`` says under which name older files have it, and what makes what it is now of that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from math import isfinite
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")

_TEXTS: dict[type, tuple[Callable[[Any], str | None], Callable[[str], Any]]] = {}

_SEPARATORS = (("%", "%25"), (".", "%2E"), ("/", "%2F"))  # of dotted names, and of paths in files of groups


def said_by_text(kind: type, text_of: Callable[[Any], str | None], of_text: Callable[[str], Any]) -> None:
    """Let a text stand for objects of a class, where they are in dataclasses; None for what no text says."""
    _TEXTS[kind] = text_of, of_text


def plain(value: Any, arrays: dict[str, ArrayLike], name: str = "") -> Any:
    """Return a value as JSON can hold it; its arrays, and numbers that JSON does not know, go to `arrays`."""
    if isinstance(value, np.generic):
        value = value.item()
    if type(value) in _TEXTS:
        return _TEXTS[type(value)][0](value)
    if isinstance(value, np.ndarray) or (isinstance(value, float) and not isfinite(value)):
        arrays[name] = value
        return None
    prefix = f"{name}." if name else ""
    if is_dataclass(value):
        return {each: plain(getattr(value, each), arrays, f"{prefix}{each}") for each in recorded(type(value))}
    if isinstance(value, Mapping):
        return {_escaped(key): plain(v, arrays, f"{prefix}{_escaped(key)}") for key, v in value.items()}
    if isinstance(value, (list, tuple, frozenset)):
        value = sorted(value) if isinstance(value, frozenset) else value
        return [plain(v, arrays, f"{name}.{i}") for i, v in enumerate(value)]
    return value.name if isinstance(value, Enum) else value


def recorded(kind: Any) -> list[str]:
    """Return the names of the fields of a dataclass that are not left out."""
    return [field.name for field in fields(kind) if field.metadata.get("recorded", True)]


def restored(kind: type[T], content: Any, arrays: Mapping[str, NDArray[Any]]) -> T:
    """Return the dataclass of plain data and arrays, which are put into the data first.

    Raises `msgspec.ValidationError`, `KeyError`, `TypeError` or `ValueError` for what is of other types.
    """
    _filled(content, arrays)
    found: T = _converted(kind, content)
    return found


def restored_fields(kind: Any, content: Any, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the recorded fields of a dataclass that has others too; errors as of `restored`."""
    _filled(content, arrays)
    hints = get_type_hints(kind)
    return {name: _converted(hints[name], content[name]) for name in recorded(kind) if name in content}


def _filled(content: Any, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, array in arrays.items():
        _put(content, name.split("."), array)


def _converted(kind: Any, content: Any) -> Any:
    # As a value of a mapping, so that the kind itself may be an enum, or a union.
    holder = {"value": content}
    _name_members({"value": kind}.items(), holder)
    return msgspec.convert(holder["value"], kind, dec_hook=_checked)


def _escaped(key: Any) -> Any:
    """Return a key that separates nothing where it stands in a dotted name."""
    if isinstance(key, str):
        for each, escaped in _SEPARATORS:
            key = key.replace(each, escaped)
    return key


def _unescaped(key: Any) -> Any:
    if isinstance(key, str):
        for each, escaped in reversed(_SEPARATORS):
            key = key.replace(escaped, each)
    return key


def _put(content: Any, path: list[str], array: NDArray[Any]) -> None:
    """Put an array where it was taken from; one that was not taken from there is left out."""
    for part in path[:-1]:
        if isinstance(content, list) and part.isdecimal() and int(part) < len(content):
            content = content[int(part)]
        else:
            content = content.get(part) if isinstance(content, dict) else None
    last: Any = path[-1]
    if isinstance(content, list):
        last = int(last) if last.isdecimal() and int(last) < len(content) else None
    if (isinstance(content, dict) and last in content) or (isinstance(content, list) and last is not None):
        content[last] = array.item() if array.shape == () else array


def _name_members(hints: Iterable[tuple[str, Any]], content: Any) -> None:
    """Replace the names of enums' members by the members, and the escaped keys of mappings by the keys."""
    for name, hint in hints:
        if isinstance(content, dict) and name in content:
            content[name] = _named_in(hint, content[name])


def _named_in(hint: Any, value: Any) -> Any:
    if type(None) in get_args(hint):
        hint = next(kind for kind in get_args(hint) if kind is not type(None))
    if is_dataclass(hint):
        _renew(hint, value)
        _name_members(get_type_hints(hint).items(), value)
    elif isinstance(hint, type) and issubclass(hint, Enum):
        return hint[value]
    elif isinstance(value, dict):
        return {_unescaped(key): entry for key, entry in value.items()}
    return value


def _renew(kind: Any, content: Any) -> None:
    """Put what older files have under another name to the fields of a dataclass that know what to make of it."""
    for field in fields(kind):
        name, made_of = field.metadata.get("earlier", ("", None))
        if made_of is not None and isinstance(content, dict) and name in content:
            content[field.name] = made_of(content.pop(name))


def _checked(kind: Any, value: Any) -> Any:
    """Return an array if it is of the type that the field asks for, or the object that a text stands for."""
    if kind in _TEXTS:
        if not isinstance(value, str):
            raise ValueError(f"the text of a {kind.__name__} is missing")
        return _TEXTS[kind][1](value)
    if not isinstance(value, np.ndarray):
        raise ValueError("an array is missing")
    (expected,) = get_args(get_args(kind)[1])
    if value.dtype != expected:
        raise ValueError(f"an array of {value.dtype}, expected {np.dtype(expected)}")
    return value
