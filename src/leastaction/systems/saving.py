"""What a file of a result says of a mechanism's system."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from leastaction.errors import LeastActionError
from leastaction.mechanics.mechanism.queries.units import multiplier_units
from leastaction.mechanics.mechanism.text import text_of
from leastaction.numerics.dataset import STEP, TIME, Dataset


def dataset_with_multipliers(result: Any, settings: Mapping[str, Any], *, impulses: bool) -> Dataset:
    """Return settings, the mechanism, and the multipliers along a result of it, where there are any.

    ``impulses``: whether they are of steps, in discrete time.
    """
    m = result.system.mechanism
    arrays, labels = {}, {}
    try:
        if m.nc:
            arrays, labels = {"lam": result.trajectory.lam}, {"constraint": m.constraints}
    except LeastActionError:
        pass  # The result is no motion, where multipliers would be anything.
    return Dataset(
        kind="",
        t=result.t,
        arrays=arrays,
        dims=dict.fromkeys(arrays, (STEP if impulses else TIME, "constraint")),
        labels=labels,
        units={name: multiplier_units(m, impulses=impulses) for name in arrays},
        system=settings,
        model=text_of(m),
    )
