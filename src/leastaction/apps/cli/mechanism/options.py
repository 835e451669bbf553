"""Options of every command that takes a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

MODEL = Group("Model", sort_key=1)
STATE = Group("Configuration", sort_key=2)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """How a model's file is read.

    Parameters
    ----------
    floating
        Let the base of a URDF move freely; it stands in the world otherwise.
    fixed
        Joints to be held at their reference, each with an option of its own.
    package
        Folders in which package:// is looked for.
    repair
        Give bodies whose inertia cannot be the nearest one that can, in place of an error.
    strict
        Make everything that cannot be taken over from the file an error.
    """

    floating: Annotated[bool, Parameter(group=MODEL, negative=())] = False
    fixed: Annotated[tuple[str, ...], Parameter(group=MODEL, negative=())] = ()
    package: Annotated[tuple[Path, ...], Parameter(group=MODEL, negative=())] = ()
    repair: Annotated[bool, Parameter(group=MODEL, negative=())] = False
    strict: Annotated[bool, Parameter(group=MODEL, negative=())] = False


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class PoseOptions:
    """Which configuration is meant.

    Parameters
    ----------
    at
        Keyframe of the file.
    set
        Value of a variable, such as elbow=0.5 or elbow=30deg (rad or m); may be given again. Loops are closed
        from there.
    """

    at: Annotated[str | None, Parameter(group=STATE)] = None
    set: Annotated[tuple[str, ...], Parameter(group=STATE, negative=())] = ()
