"""Runs of the marionette as files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from leastaction.apps.marionette.tracking.run import TrackingRun
from leastaction.errors import LeastActionError, ResultFileError
from leastaction.io.results import check_result, load_record, save_record
from leastaction.mechanics import MidpointVI
from leastaction.models.marionette import marionette
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult
from leastaction.systems import MidpointSystem


@dataclass(frozen=True, kw_only=True)
class MarionetteRun:
    """What a file holds of a `TrackingRun`: all that the rest follows from.

    ``numbers`` are the parameters of the mechanism that are not those of `marionette`.
    """

    source: str
    numbers: Mapping[str, float]
    t: Array
    reference: Array
    embedded: bool
    result: OptimizationResult


def save_run(path: str | os.PathLike[str], run: TrackingRun) -> Path:
    """Write a run of the marionette into a file; an existing file is replaced in one step.

    Parameters
    ----------
    path : path
        The file, by custom ``trajectory.npz``. `numpy.load` reads it too: besides the optimiser's result (``result.x``,
        ``result.u``, ``result.K``, ...) it holds ``t``, ``q``, ``p``, ``lam``, ``tension`` and the ``reference``.
    run : TrackingRun

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; an older file of that name is untouched.
    """
    standard, trajectory = marionette().parameters, run.trajectory
    content = MarionetteRun(
        source=run.source,
        numbers={k: v for k, v in run.mechanism.parameters.items() if standard.get(k) != v},
        t=trajectory.t,
        reference=run.reference,
        embedded=run.embedded,
        result=run.result,
    )
    arrays = {name: getattr(trajectory, name) for name in ("q", "p", "lam")}
    return save_record(path, content, provenance=run.provenance, arrays={**arrays, "tension": run.tension})


def load_run(path: str | os.PathLike[str]) -> TrackingRun:
    """Read a run of the marionette.

    Parameters
    ----------
    path : path
        A file that `save_run` wrote.

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, or contradicts itself.
    """
    record = load_record(path, MarionetteRun)
    saved = record.content
    check_result(saved.result, str(path))
    try:
        mechanism = marionette()
        if saved.numbers:
            mechanism = mechanism.with_parameters(saved.numbers)
        system = MidpointSystem(MidpointVI(mechanism), saved.t, multipliers=True)
        expected = {
            "reference": (saved.reference, (system.N + 1, mechanism.nq)),
            "result.x": (saved.result.x, (system.N + 1, system.nx)),
            "result.u": (saved.result.u, (system.N, system.nu)),
        }
        for name, (array, shape) in expected.items():
            if array.shape != shape or not np.all(np.isfinite(array)):
                raise ResultFileError(f"{name} has shape {array.shape}, expected {shape} finite numbers")
        return TrackingRun(
            mechanism=mechanism,
            source=saved.source,
            reference=saved.reference,
            embedded=saved.embedded,
            trajectory=system.trajectory(saved.result.x, saved.result.u),
            result=saved.result,
            provenance=record.provenance,
        )
    except LeastActionError as error:
        raise ResultFileError(f"{path} contradicts itself: {error}. Run the optimisation again") from error
