"""Runs of the marionette, and searches, as files: records as they are."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from leastaction.errors import LeastActionError, ResultFileError
from leastaction.io import check_result, load_record, save_record
from leastaction.models.marionette import CONTROLS, axes_of, held_strings, marionette, set_of
from leastaction.optimal import OptimizationResult
from leastaction_marionette.tracking.found import TrackingRun, TrackingSearch
from leastaction_marionette.tracking.motors import PRICES
from leastaction_marionette.tracking.problem import body_columns


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
    arrays = {name: getattr(run.trajectory, name) for name in ("t", "q", "p", "lam")}
    arrays |= {"tension": run.tension, "reference": run.reference}
    return save_record(path, run, provenance=run.provenance, arrays=arrays)


def save_search(path: str | os.PathLike[str], search: TrackingSearch) -> Path:
    """Write a search for a first trajectory into a file; an existing file is replaced in one step.

    Raises `OutputError` if the file could not be written; an older file of that name is untouched then.
    """
    return save_record(path, search, provenance=search.provenance)


def load_run(path: str | os.PathLike[str]) -> TrackingRun:
    """Read a run of the marionette.

    Parameters
    ----------
    path : path
        A file that `save_run` wrote.

    Returns
    -------
    TrackingRun

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, or contradicts itself.
    """
    run = _loaded(path, TrackingRun)
    assert isinstance(run, TrackingRun)
    return run


def load_unfinished(path: str | os.PathLike[str]) -> TrackingRun | TrackingSearch:
    """Read what `track` can go on with: a run of the marionette, or a search for its first trajectory.

    Raises `ResultFileError` as `load_run` does.
    """
    return _loaded(path, TrackingRun, TrackingSearch)


def _loaded(path: str | os.PathLike[str], *kinds: type[TrackingRun | TrackingSearch]) -> TrackingRun | TrackingSearch:
    try:
        record = load_record(path, *kinds)
        found = record.content
        check_result(found.result, str(path))
        _check(found)
    except ResultFileError:
        raise
    except LeastActionError as error:
        raise ResultFileError(f"{path} contradicts itself: {error}. Run the optimisation again") from error
    object.__setattr__(found, "provenance", record.provenance)
    return found


def _check(found: TrackingRun | TrackingSearch) -> None:
    """Raise an error unless a record is of a marionette, and its parts fit each other."""
    m, N = found.mechanism, len(found.motion.t) - 1
    body_columns(m, found.motion)
    own = marionette(strings=set_of(m), axes=axes_of(m))
    if (m.coordinates, m.constraints, set(m.parameters)) != (own.coordinates, own.constraints, set(own.parameters)):
        raise LeastActionError("its mechanism is no marionette")
    # By tensions: no lengths among the variables. Inputs are tensions, motors, and places of the upper ends.
    moved, body = m.nrho - len(held_strings(m)), m.first_rho + m.nd
    planned = (body + 2 * moved, m.nc + moved)
    if isinstance(found, TrackingRun):
        _check_sizes("result", found.result, N, m.nx + m.nc, m.nrho)
        _check_sizes("plan", found.plan, N, *planned)
        return
    steps, tying = len(found.result.u), found.firmness is not None
    if tying and not (set_of(m) in CONTROLS and 0.0 < (found.firmness or 0.0) < np.inf):
        raise LeastActionError(f"strings on bars that are tied with a weight of {found.firmness} are none")
    if not (0 < steps <= N if found.parts else steps in (N, N // 2)):
        raise LeastActionError(f"a search with {steps} steps for a motion of {N} is none")
    with_motors = not (tying or found.parts)
    if with_motors and not 0 < found.stage <= len(PRICES):
        raise LeastActionError(f"a search at stage {found.stage} is none")
    _check_sizes("result", found.result, steps, planned[0], planned[1] + m.nd * with_motors)


def _check_sizes(name: str, result: OptimizationResult, steps: int, nx: int, nu: int) -> None:
    for which, array, shape in (("x", result.x, (steps + 1, nx)), ("u", result.u, (steps, nu))):
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise LeastActionError(f"{name}.{which} has shape {array.shape}, expected {shape} finite numbers")
