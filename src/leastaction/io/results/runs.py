"""Runs of a mechanism that are read from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from leastaction.errors import ResultFileError
from leastaction.io.results.checks import check_shapes
from leastaction.io.results.record import damaged
from leastaction.mechanics import ContinuousTrajectory, Mechanism, Trajectory
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.dataset.plain import restored_fields
from leastaction.systems import Played

_KINDS: Final = {kind.__name__: kind for kind in (Trajectory, ContinuousTrajectory, Played)}


def run_of(source: Path, dataset: Dataset, m: Mechanism) -> Trajectory | ContinuousTrajectory | Played:
    """Return a run of a mechanism; raise a `ResultFileError` for what contradicts itself, or the mechanism."""
    kind: Any = _KINDS[dataset.kind]
    try:
        values = restored_fields(kind, dataset.content, dataset.arrays)
        run: Trajectory | ContinuousTrajectory | Played = kind(mechanism=m, **values)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise damaged(source, error) from error
    for dim, names in (("variable", m.variables), ("input", m.inputs), ("constraint", m.constraints)):
        if dim in dataset.labels and dataset.labels[dim] != names:
            raise ResultFileError(
                f"{source}: its {dim}s are {', '.join(dataset.labels[dim])}, expected those of the mechanism: "
                f"{', '.join(names)}. Give the run's own mechanism"
            )
    n = len(run.t)
    at = n if dataset.kind == "ContinuousTrajectory" else max(n - 1, 0)
    wanted = {
        "t": (n,), "q": (n, m.nq), "p": (n, m.nd), "v_rho": (n, m.nrho), "v": (n, m.nv), "a": (n, m.nv),
        "inputs": (at, m.n_inputs), "lam": (at, m.nc), "x": (n, m.nx), "u": (at, m.n_inputs + m.nrho),
    }  # fmt: skip
    shapes = {name: (value, wanted[name]) for name, value in values.items() if name in wanted}
    check_shapes(shapes, f"{n} instants of {m!r}", str(source))
    if (np.diff(run.t) <= 0.0).any():
        raise ResultFileError(f"{source} is damaged: t does not increase. Copy it again")
    return run
