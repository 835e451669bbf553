"""The compiled numerical core, in the variant that suits this CPU best.

The same C++ sources are compiled for several instruction sets: ``baseline`` (the plain platform),
``v3`` (AVX2 and FMA) and ``v4`` (AVX-512). Importing this package loads one of them and re-exports
its names. The environment variable ``LEASTACTION_CORE`` overrides the choice, for comparison and
for reproducing a result to the last bit: variants agree to rounding only.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from leastaction._core._native import *  # noqa: F403

_cpu = importlib.import_module(f"{__name__}._cpu")

VARIANTS = ("baseline", "v3", "v4")
"""Names of the variants that a build may hold, slowest first."""


def _is_built(variant: str) -> bool:
    return importlib.util.find_spec(f"{__name__}._{variant}") is not None


def available_variants() -> tuple[str, ...]:
    """Return the variants that this build holds and this CPU can run, slowest first."""
    return tuple(v for v in VARIANTS if _cpu.supports(v) and _is_built(v))


def _choose(wanted: str | None) -> str:
    available = available_variants()
    if not available:
        raise ImportError(
            "leastaction has no compiled core that this CPU can run: got none of "
            f"{', '.join(VARIANTS)}. Build it with 'make build' or reinstall the package."
        )
    if not wanted:
        return available[-1]
    if wanted in available:
        return wanted
    if wanted not in VARIANTS:
        reason = "no such variant"
    elif not _cpu.supports(wanted):
        reason = "this CPU cannot run it"
    else:
        reason = "this build does not hold it"
    raise ImportError(
        f"LEASTACTION_CORE: got {wanted!r} ({reason}), expected one of {', '.join(available)}. "
        "Unset it to let leastaction choose."
    )


def _export(variant: str) -> list[str]:
    """Make the public names of a variant names of this package; return them."""
    native = importlib.import_module(f"{__name__}._{variant}")
    names = [name for name in vars(native) if not name.startswith("_")]
    for name in names:
        value = getattr(native, name)
        if isinstance(value, type):
            # Say leastaction._core, whatever the variant: error messages read better and a
            # pickle made here loads on a machine that picks another variant.
            value.__module__ = __name__
        globals()[name] = value
    return names


variant: str = _choose(os.environ.get("LEASTACTION_CORE"))
"""The variant in use."""

__all__ = ["VARIANTS", "available_variants", "variant"]
__all__ += _export(variant)
