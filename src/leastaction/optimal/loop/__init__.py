"""The iteration of the projection-operator optimiser, for problems in discrete and in continuous time.

What trajectories are made of is left to a `Problem` (`problem`). A `Run` is how far it has come (`run`); of it the loop
chooses the method of every direction (`directions`), searches along it (`search`), goes from stage to stage of the
problem (`stages`) and says how it ended (`ending`).
"""

from __future__ import annotations

from leastaction.optimal.loop.loop import Callback, Loop
from leastaction.optimal.loop.problem import (
    Clock,
    DescentModels,
    Direction,
    ModelSolution,
    OneStage,
    Problem,
    SearchReport,
    Stages,
    Steps,
    along_parabola,
)

__all__ = [
    "Callback", "Clock", "DescentModels", "Direction", "Loop", "ModelSolution", "OneStage", "Problem", "SearchReport",
    "Stages", "Steps", "along_parabola",
]  # fmt: skip
