"""Names of a package that are loaded when they are first used (PEP 562), so that importing the package costs little."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any


def lazily(
    package: str, modules: Mapping[str, str], *, moved: Mapping[str, str] = MappingProxyType({})
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package: names by the module that has them, separated by spaces.

    The package's own modules are names too, as if they had been imported. ``moved`` are names that have another place
    now: they are still found, and not listed.
    """
    offered = {name: module for module, names in modules.items() for name in names.split()}
    hidden = {name: module for module, names in moved.items() for name in names.split()}

    def __getattr__(name: str) -> Any:
        module = offered.get(name) or hidden.get(name)
        if module is not None:
            value = getattr(import_module(module), name)
        elif not name.startswith("_") and find_spec(f"{package}.{name}") is not None:
            value = import_module(f"{package}.{name}")
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=sys.modules[package])
        setattr(sys.modules[package], name, value)
        return value

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[package]), *offered}.difference(hidden))

    return __getattr__, __dir__
