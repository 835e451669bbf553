"""Records whose arrays cannot be written to, and that come back from a pickle or a deep copy as they were.

On that way NumPy's arrays become writable, and read-only views of mappings do not go it at all. A frozen dataclass that
holds some derives from `Frozen`; another class says::

    __getstate__, __setstate__ = saved_state, restore_state
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from leastaction.numerics.arrays import read_only

Record = TypeVar("Record")

_new: Any = object.__new__
_set = object.__setattr__


def made(kind: type[Record], **values: Any) -> Record:
    """Return a frozen dataclass of these values, as calling it does, in a fraction of the time; see `changed`.

    Fields that are left out have their defaults.
    """
    record: Record = _new(kind)
    _set(record, "__dict__", values)
    return record


def changed(record: Record, **values: Any) -> Record:
    """Return a frozen dataclass with other values, as `dataclasses.replace` does, in a fraction of the time.

    For iterations of microseconds, and classes whose fields are not checked: `__post_init__` is not called.
    """
    other: Record = _new(type(record))
    _set(other, "__dict__", {**record.__dict__, **values})
    return other


@dataclass(frozen=True)
class _Mapping:
    """Stands for a read-only view of a mapping."""

    items: dict[Any, Any]


def saved_state(self: object) -> dict[str, Any]:
    """Return the fields of an object as they go into a pickle."""
    return {
        name: _Mapping(dict(value)) if isinstance(value, MappingProxyType) else value
        for name, value in vars(self).items()
    }


def restore_state(self: object, state: dict[str, Any]) -> None:
    """Set the fields of an object, which may be frozen, from those in a pickle; no array can be written to."""
    for name, value in state.items():
        object.__setattr__(self, name, _frozen(value))


def _frozen(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, _Mapping):
        return MappingProxyType({key: _frozen(entry) for key, entry in value.items.items()})
    elif type(value) in (tuple, list):
        for entry in value:
            _frozen(entry)
    elif type(value) is dict:
        for entry in value.values():
            _frozen(entry)
    return value


def own_arrays(self: object, *names: str) -> None:
    """Replace arrays among the fields of a frozen dataclass: what their giver changes later changes nothing then."""
    for name in names:
        value = getattr(self, name)
        if isinstance(value, np.ndarray):
            object.__setattr__(self, name, read_only(value.copy()))


@cache
def _declared_arrays(kind: Any) -> frozenset[str]:
    """Return the fields of a dataclass that are declared to be arrays: short iterations make many of them."""
    return frozenset(entry.name for entry in fields(kind) if entry.type == "Array")


class Frozen:
    """What a frozen dataclass that holds arrays derives from: nobody can write to them, copied or not."""

    def __post_init__(self) -> None:
        """Make arrays of the fields that are declared so, read-only like those that are arrays already."""
        kind: Any = type(self)
        declared, held = _declared_arrays(kind), vars(self)
        for name in [name for name, value in held.items() if isinstance(value, np.ndarray) or name in declared]:
            held[name] = read_only(np.asarray(held[name]))

    __getstate__, __setstate__ = saved_state, restore_state
