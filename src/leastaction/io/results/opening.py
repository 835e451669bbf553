"""Give back a run or a result from its file."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeAlias

import msgspec
import numpy as np

from leastaction.errors import LeastActionError, ResultFileError
from leastaction.io.motion.motion import Motion
from leastaction.io.motion.table import motion_of
from leastaction.io.results.checks import check_result, check_shapes
from leastaction.io.results.continuous import check_continuous, result_of
from leastaction.io.results.record import damaged, record_of
from leastaction.io.results.systems import system_of
from leastaction.mechanics import ContinuousTrajectory, Mechanism, Trajectory
from leastaction.mechanics.mechanism.text import mechanism_of
from leastaction.numerics.arrays import require_instance
from leastaction.numerics.dataset import Dataset, Table
from leastaction.numerics.dataset.files import read
from leastaction.numerics.dataset.plain import restored, restored_fields
from leastaction.numerics.dataset.text import check_fit
from leastaction.numerics.public import public
from leastaction.optimal import OptimizationResult
from leastaction.optimal.continuous.content import ContinuousContent
from leastaction.systems import Played
from leastaction.systems.closed_loop import ClosedLoop, PredictiveInfo

Opened: TypeAlias = Trajectory | ContinuousTrajectory | OptimizationResult | Played | ClosedLoop | Motion | Table


@public
def open(  # noqa: A001 - `leastaction.open` is what it is called by
    path: str | os.PathLike[str], *, mechanism: Mechanism | None = None
) -> Opened:
    """Give back what was saved by ``run.save``, ``result.save`` or ``motion.save``.

    Parameters
    ----------
    path : path
        Of ``.h5`` and ``.npz`` everything comes back, bit by bit, but for functions: a trajectory in continuous time is
        known at its instants, and not between them. Of ``.csv`` a motion, where every column is known at every instant,
        or the table; ``.mat`` is for other programs.
    mechanism : Mechanism, optional
        Of the run or the result, for files without: of mechanisms with functions of Python. It is taken in the place of
        the file's own.

    Returns
    -------
    Trajectory, ContinuousTrajectory, OptimizationResult, Played, ClosedLoop, Motion or Table
        A result knows its `system`, as far as its mechanism is known, and `optimize` goes on with it (``resume``).

    Raises
    ------
    ResultFileError
        The file is missing, damaged, not such a file, of another format, contradicts itself, or lacks a mechanism.
    MissingExtraError
        h5py is not installed, which ``.h5`` needs.
    """
    source = Path(path)
    if mechanism is not None:
        require_instance(mechanism, "mechanism", Mechanism)
    dataset = read(source)
    opened = _OPENED.get(dataset.kind)
    if opened is None:
        is_marionette = dataset.kind.startswith(("Marionette", "Tracking"))
        advice = "leastaction_marionette.load_run reads it" if is_marionette else "Give another file"
        raise ResultFileError(f"{source} holds a {dataset.kind}, expected one of {', '.join(_OPENED)}. {advice}")
    found: Opened = opened(source, dataset, mechanism)
    return found


def _mechanism(source: Path, dataset: Dataset, given: Mechanism | None) -> Mechanism | None:
    """Return the mechanism of a file, or that which is given in its place."""
    if given is not None or dataset.model is None:
        return given
    try:
        return mechanism_of(dataset.model)
    except LeastActionError as error:
        raise ResultFileError(f"{source}: its mechanism cannot be made: {error}") from error


def _run(source: Path, dataset: Dataset, given: Mechanism | None) -> Any:
    m = _mechanism(source, dataset, given)
    if m is None:
        raise ResultFileError(
            f"{source} holds no mechanism, which has functions of Python that no file can hold. Give it: "
            "leastaction.open(path, mechanism=...)"
        )
    return run_of(source, dataset, m)


def _result(source: Path, dataset: Dataset, given: Mechanism | None) -> OptimizationResult:
    result: OptimizationResult
    if dataset.kind == ContinuousContent.__name__:
        content = record_of(source, dataset, ContinuousContent).content
        check_continuous(content, str(source))
        try:
            result = result_of(content)
        except (TypeError, ValueError, OverflowError) as error:
            raise damaged(source, error) from error
    else:
        result = record_of(source, dataset, OptimizationResult).content
        check_result(result, str(source))
    m = _mechanism(source, dataset, given)
    if m is None or not dataset.system:
        return result
    return replace(result, system=system_of(source, dataset.system, m, result))


def _loop(source: Path, dataset: Dataset, given: Mechanism | None) -> ClosedLoop:
    loop = record_of(source, dataset, ClosedLoop).content
    n, nx = len(loop.t), len(loop.state_names)
    shapes = {"x": (loop.x, (n, nx)), "u": (loop.u, (n - 1, len(loop.input_names)))}
    check_shapes(shapes, f"{n} instants", str(source))
    said = [restored(PredictiveInfo, each, {}) if isinstance(each, dict) else each for each in loop.infos]
    return replace(loop, infos=tuple(said), mechanism=_mechanism(source, dataset, given))


def _table(source: Path, dataset: Dataset, given: Mechanism | None) -> Motion | Table:  # noqa: ARG001 - as of others
    check_fit(source, dataset)
    return motion_of(dataset) or Table(dataset)


_OPENED: Final[Mapping[str, Callable[[Path, Dataset, Mechanism | None], Any]]] = {
    "OptimizationResult": _result,
    "ContinuousContent": _result,
    "Trajectory": _run,
    "ContinuousTrajectory": _run,
    "Played": _run,
    "ClosedLoop": _loop,
    "Motion": _table,
    "table": _table,
}


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
