"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from leastaction.optimal.options import Method

OPTIMISER = Group("Optimiser", sort_key=3)
OUTPUT = Group("Output", sort_key=4)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OptimiserOptions:
    """How the optimiser works.

    Parameters
    ----------
    method
        Descent direction. auto: quasi-Newton at first, Newton when its model fits. A direction that
        cannot be followed is replaced by a simpler one.
    max_iterations
        Iterations after which to stop.
    tolerance
        Stop when the next step promises to lower the cost by less than this part of it.
    checkpoint
        Seconds after which the run is kept as it stands, again and again, in case that it is cut off.
    """

    method: Annotated[Method, Parameter(group=OPTIMISER)] = "auto"
    max_iterations: Annotated[int, Parameter(group=OPTIMISER)] = 500
    tolerance: Annotated[float | None, Parameter(group=OPTIMISER)] = None
    checkpoint: Annotated[float, Parameter(group=OPTIMISER)] = 10.0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """What is written.

    Parameters
    ----------
    out
        Folder for the results. It is made where needed and checked before the run starts.
    plots
        Draw convergence, tracking, strings and snapshots (PNG).
    animation
        Make the animation (HTML).
    """

    out: Annotated[Path, Parameter(group=OUTPUT)]
    plots: Annotated[bool, Parameter(group=OUTPUT)] = True
    animation: Annotated[bool, Parameter(group=OUTPUT)] = True
