"""When something was made, and with which programs."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata

from leastaction._version import __version__
from leastaction.numerics.public import public


@public
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
