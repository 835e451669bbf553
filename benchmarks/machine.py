"""What the times were taken on."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

import leastaction
from leastaction import _core

_PACKAGES = ("numpy", "scipy", "pin", "example-robot-data", "mujoco", "crocoddyl")


def describe() -> dict[str, Any]:
    """Return processor, variant of the core, versions, and how busy the machine was."""
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    return {
        "cpu": _cpu(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "core_variant": _core.variant,
        "load_at_start": load,
        "versions": {"leastaction": leastaction.__version__} | _versions(),
    }


def _cpu() -> str:
    info = Path("/proc/cpuinfo")
    if info.exists():
        fields = dict(
            [part.strip() for part in line.split(":", 1)]
            for line in info.read_text().split("\n\n")[0].splitlines()
            if ":" in line
        )
        if "model name" in fields:
            # A virtual machine may say no more than the maker; family and model tell the generation.
            family, model = fields.get("cpu family", "?"), fields.get("model", "?")
            return f"{fields['model name']} (family {family}, model {model})"
    return platform.processor() or platform.machine()


def _versions() -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found
