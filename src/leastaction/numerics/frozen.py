"""Records that come back from a pickle or a deep copy as they were.

On that way NumPy's arrays become writable, and read-only views of mappings do not go it at all. A class whose
objects hold some says::

    __getstate__, __setstate__ = saved_state, restore_state
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array, read_only


@dataclass(frozen=True)
class _Mapping:
    """Stands for a read-only view of a mapping."""

    items: dict[Any, Any]


def freeze_arrays(self: Any) -> None:
    """Make arrays of the fields of a frozen dataclass that are declared so, which like its others cannot be written."""
    for entry in fields(self):
        value = getattr(self, entry.name)
        if entry.type in ("Array", Array) or isinstance(value, np.ndarray):
            object.__setattr__(self, entry.name, read_only(np.asarray(value)))


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
