"""The modules of the package, by name."""

from __future__ import annotations

import pkgutil

import leastaction

MODULES = [
    info.name
    for info in pkgutil.walk_packages(leastaction.__path__, "leastaction.")
    if not info.name.startswith("leastaction._core") and not info.name.endswith("__main__")
]
