"""Where a search among limits begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.limits.cost import LimitedCost
from leastaction.optimal.limits.leeway import may_be_obstacle
from leastaction.optimal.limits.merit import BarrierMerit
from leastaction.optimal.limits.rows import Rows, check_agreement
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.limits.stages import BarrierStages
from leastaction.optimal.options import Options

_DIGITS = 1e3 * float(np.finfo(np.float64).eps)  # least room that is told from none, in parts of a limit's size


def barrier_merit(
    system: DiscreteSystem, cost: Cost, rows: Sequence[Rows], here: Here, settings: Options, dearer: float
) -> BarrierMerit:
    """Return a cost with the barriers of limits; ``dearer``: as of `BarrierStages`."""
    check_agreement(rows, system.when)
    limited = LimitedCost(cost, rows, system.ndx, system.nu)
    stages = BarrierStages(limited.duals, settings.tolerance, _DIGITS, dearer)
    return BarrierMerit(limited, stages, here)


def depths(rows: Sequence[Rows], c: Sided, x: Array, u: Array) -> Array | float:
    """Return how deep obstacles are whose size is not known, given the values of all limits; infinity of others.

    What is seen far away from an obstacle is no measure of it: to leap through it would cost too little.
    """
    unknown = [i for i, each in enumerate(rows) if may_be_obstacle(each, x, u) and not each.scale.any()]
    if not unknown:
        return np.inf
    found = Sided(np.full(c.layout.columns.ends[-1], np.inf), c.layout.columns)
    for i in unknown:
        found[i] = rows[i].depths(c[i], x, u)
    return found.flat
