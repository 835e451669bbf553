"""The modules of the package, and of what is built on it, by name."""

from __future__ import annotations

import pkgutil

import leastaction
import leastaction_marionette

MODULES = [
    info.name
    for package in (leastaction, leastaction_marionette)
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not info.name.startswith("leastaction._core") and not info.name.endswith("__main__")
]
