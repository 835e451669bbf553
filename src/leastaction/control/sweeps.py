"""One task for many values, on several processes: what is done is kept, and a sweep that was ended goes on from there.

The processes are joblib's: on a cluster its back-ends (``joblib.parallel_config(backend="dask")``) take their place.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from leastaction.errors import ArgumentError, LeastActionError, SweepError
from leastaction.numerics.arrays import as_count
from leastaction.numerics.extras import extra
from leastaction.numerics.files import prepare_output_folder, write_bytes
from leastaction.numerics.public import public
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.optimization import optimize
from leastaction.optimal.options import check_settings


@public
@dataclass(frozen=True)
class Failed:
    """What stands in the place of the result of a task that failed. ``error``: what it raised, in words."""

    error: str

    def __bool__(self) -> bool:
        return False


@public
def sweep(
    task: Callable[[Any], Any],
    values: Sequence[Any],
    *,
    workers: int = -1,
    keep: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """Return what a task gives for many values, in their order, computed on several processes.

    Parameters
    ----------
    task : callable
        ``task(value) -> result``: the same result for the same value, both of which can be pickled.
    values : sequence
    workers : int, optional
        Processes; -1: as many as there are cores. 1: none, all is done here.
    keep : path, optional
        A folder, made if need be, in which each result is kept as it comes. A sweep of the same values that is begun
        again with it does what is missing. Results are pickles: give no folder of somebody whom you do not trust.
    progress : callable, optional
        Called with the number of results that there are, and of all.

    Returns
    -------
    list
        A result for each value; a `Failed` where the task raised a `LeastActionError`.

    Raises
    ------
    ArgumentError
        What is no function, or no sequence.
    SweepError
        Worker processes died, killed or out of memory; it holds what was done.
    MissingExtraError
        joblib is not installed.
    OutputError
        A result could not be kept.

    Examples
    --------
    >>> from leastaction.control import sweep
    >>> sweep(abs, [-1, 2, -3], workers=1)
    [1, 2, 3]
    """
    if not callable(task):
        raise ArgumentError(f"task: got {type(task).__name__}, expected a function of one value")
    given = list(values)
    processes = workers if workers == -1 else as_count(workers, "workers, -1 for one on each core", 1)
    folder = None if keep is None else prepare_output_folder(keep)
    done = dict(_kept(folder, given)) if folder is not None else {}
    todo = [i for i in range(len(given)) if i not in done]
    if progress is not None:
        progress(len(done), len(given))
    for i, result in _results(task, given, todo, processes, done):
        done[i] = result
        if folder is not None:
            _keep(folder, i, given[i], result)
        if progress is not None:
            progress(len(done), len(given))
    return [done[i] for i in range(len(given))]


@public
def optimize_many(
    system: DiscreteSystem | ContinuousSystem,
    cost: Any,
    starts: Sequence[Any],
    *,
    workers: int = -1,
    keep: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> list[Any]:
    """Return the optima from many starts, computed on several processes.

    Parameters
    ----------
    system, cost
        As of `optimize`.
    starts : sequence
        Each as `initial` of `optimize`.
    workers, keep, progress
        As of `sweep`.
    **settings
        Limits and all else that `optimize` takes.

    Returns
    -------
    list of OptimizationResult
        In the order of the starts; a `Failed` in place of those whose start leads nowhere.

    Raises
    ------
    ArgumentError, SweepError, MissingExtraError, OutputError
        As of `sweep`.
    """
    if not isinstance(system, (DiscreteSystem, ContinuousSystem)):
        raise ArgumentError(f"system: got {type(system).__name__}, expected a discrete or a continuous system")
    check_settings(settings)
    return sweep(_Optimization(system, cost, settings), starts, workers=workers, keep=keep, progress=progress)


@dataclass(frozen=True, eq=False)
class _Optimization:
    """An optimisation as a task of its start."""

    system: Any
    cost: Any
    settings: dict[str, Any]

    def __call__(self, start: Any) -> Any:
        how: Any = optimize
        return how(self.system, self.cost, initial=start, **self.settings)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A task that says which value it was, and of an error that is meant what it says."""

    task: Callable[[Any], Any]

    def __call__(self, i: int, value: Any) -> tuple[int, Any]:
        try:
            return i, self.task(value)
        except LeastActionError as error:
            return i, Failed(f"{type(error).__name__}: {error}")


def _results(
    task: Callable[[Any], Any], values: list[Any], todo: list[int], workers: int, done: dict[int, Any]
) -> Iterator[tuple[int, Any]]:
    """Yield results as they come."""
    attempt = _Attempt(task)
    if workers == 1 or len(todo) < 2:
        for i in todo:
            yield attempt(i, values[i])
        return
    joblib = extra("joblib", of="parallel", why="a sweep on several processes")
    from concurrent.futures import BrokenExecutor

    pool = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")
    found = pool(joblib.delayed(attempt)(i, values[i]) for i in todo)
    try:
        for each in found:  # noqa: UP028 - so that it is closed below, and not here
            yield each
    except BrokenExecutor as error:
        reason = str(error).partition(". ")[0]
        raise SweepError(
            f"worker processes died after {len(done)} of {len(values)} results: killed, or out of memory ({reason}). "
            "Give fewer workers; with `keep` the sweep goes on where it was",
            done=dict(done),
        ) from error
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of results that nobody waits for, where a sweep was ended
            found.close()


def _mark(value: Any) -> str:
    """Return what tells a value from others."""
    return hashlib.sha256(pickle.dumps(value, protocol=4)).hexdigest()


def _kept(folder: Path, values: list[Any]) -> Iterator[tuple[int, Any]]:
    """Yield the results that are kept in a folder, of those values that are the same still."""
    for i, value in enumerate(values):
        path = folder / f"{i:06d}.pickle"
        with suppress(OSError, EOFError, pickle.UnpicklingError, AttributeError, ImportError):
            mark, result = pickle.loads(path.read_bytes())
            if mark == _mark(value):
                yield i, result


def _keep(folder: Path, i: int, value: Any, result: Any) -> None:
    """Keep a result, whole or not at all."""
    write_bytes(folder / f"{i:06d}.pickle", pickle.dumps((_mark(value), result), protocol=4))
