"""Names of a package that are loaded when they are first used (PEP 562), so that importing the package costs little."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any


def by_stub(
    package: str, *, moved: Mapping[str, str] = MappingProxyType({})
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package, by what its stub says to type checkers.

    ``__init__.pyi`` imports every name from the module that has it. The package's own modules are names too, as if they
    had been imported. ``moved``: names, separated by spaces, that have another place now, by that module: they are
    still found, and not listed.
    """
    offered, exported = _stated(package)
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

    return __getattr__, __dir__, exported


def _stated(package: str) -> tuple[dict[str, str], list[str]]:
    """Return the names that a package's stub imports, by name the module, and those that it exports."""
    spec: Any = sys.modules[package].__spec__
    offered, exported = dict[str, str](), list[str]()
    for node in ast.parse(spec.loader.get_data(f"{spec.origin}i")).body:
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            offered |= {each.name: node.module for each in node.names}
        elif isinstance(node, ast.Assign):  # to __all__
            exported = ast.literal_eval(node.value)
    return offered, exported
