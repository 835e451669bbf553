"""Applications in packages of their own, whose commands stand beside those for any mechanism.

A package states them as entry points of the group `GROUP`: each is a module that has what an `Application` has.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, Protocol

from cyclopts import App
from rich.console import RenderableType

GROUP: Final = "leastaction.applications"
"""Where packages state their applications (``[project.entry-points."leastaction.applications"]``)."""


class Application(Protocol):
    """What the command line asks of an application. Its module is imported for ``--help``, so it imports little."""

    RECORDS: frozenset[str]
    """What its files hold: names of the dataclasses that it saves by `leastaction.io.save_record`."""

    def add_commands(self, app: App) -> None:
        """Add commands to the program, or to one of its commands: ``app["optimize"]``."""

    def text_of(self, file: Path) -> RenderableType:
        """Return what is in a file of a run, to print; raises `ResultFileError` if it cannot be used."""

    def facts_of(self, file: Path) -> dict[str, Any]:
        """Return the same as plain data."""


@cache
def applications() -> tuple[Application, ...]:
    """Return the applications of all packages that are installed, by their names."""
    return tuple(point.load() for point in sorted(entry_points(group=GROUP), key=lambda point: point.name))
