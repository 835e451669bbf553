"""Runs of the marionette as files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np

from leastaction.errors import LeastActionError, ResultFileError
from leastaction.io import Motion, Provenance, check_result, load_record, save_record
from leastaction.mechanics import Mechanism, MidpointVI
from leastaction.models.marionette import (
    CONTROLS,
    JOINT_LIMITS,
    STRING_SETS,
    Hanging,
    axes_of,
    held_strings,
    marionette,
    set_of,
    strings_of,
)
from leastaction.models.puppet_controls import ends_of
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult
from leastaction.systems import MidpointSystem
from leastaction_marionette.choices import Axes, Follow
from leastaction_marionette.markers import MARKERS, wanted_markers, with_places
from leastaction_marionette.tracking.found import Effort, FollowedParts, TrackingRun, TrackingSearch
from leastaction_marionette.tracking.limits import KINDS, PuppetLimits
from leastaction_marionette.tracking.motors import PRICES
from leastaction_marionette.tracking.problem import body_columns
from leastaction_marionette.turns import body_of


@dataclass(frozen=True, kw_only=True)
class MarionetteRun:
    """What a file holds of a `TrackingRun`: all that the rest follows from.

    ``numbers`` are the parameters of the mechanism that are not those of `marionette`, ``strings`` how many it has,
    ``control`` which of `CONTROLS` it hangs on, if any.
    ``kinds`` are those of the limits that were stated; files of earlier versions leave them to the limits' labels.
    """

    source: str
    numbers: Mapping[str, float]
    t: Array
    reference: Array
    embedded: bool
    result: OptimizationResult
    plan: OptimizationResult | None = None
    strings: int = 6
    control: str = ""
    kinds: tuple[str, ...] | None = None
    unfinished: OptimizationResult | None = None
    follow: str = "joints"
    markers: Array | None = None
    effort: Effort | None = None
    limits: PuppetLimits | None = None
    axes: Axes = "zyx"


@dataclass(frozen=True, kw_only=True)
class MarionetteSearch:
    """What a file holds of a `TrackingSearch`; ``body`` are the columns of its motion, ``markers`` its own.

    Files of earlier versions have no ``firmness``, no ``kinds`` and no ``parts``.
    """

    source: str
    numbers: Mapping[str, float]
    t: Array
    body: Array
    stage: int
    result: OptimizationResult
    strings: int = 6
    control: str = ""
    follow: str = "joints"
    markers: Array | None = None
    effort: Effort | None = None
    firmness: float | None = None
    kinds: tuple[str, ...] = ()
    parts: FollowedParts | None = None
    axes: Axes = "zyx"


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
    trajectory = run.trajectory
    content = MarionetteRun(
        source=run.source,
        numbers=_numbers(run.mechanism),
        t=trajectory.t,
        reference=run.reference,
        embedded=run.embedded,
        result=run.result,
        plan=run.plan,
        strings=run.mechanism.nc,
        control=_control(run.mechanism),
        kinds=tuple(sorted(run.kinds)),
        unfinished=run.unfinished,
        follow=run.follow,
        markers=run.markers,
        effort=run.effort,
        limits=run.limits,
        axes=axes_of(run.mechanism),
    )
    arrays = {name: getattr(trajectory, name) for name in ("q", "p", "lam")}
    return save_record(path, content, provenance=run.provenance, arrays={**arrays, "tension": run.tension})


def save_search(path: str | os.PathLike[str], search: TrackingSearch) -> Path:
    """Write a search for a first trajectory into a file; an existing file is replaced in one step.

    Raises `OutputError` if the file could not be written; an older file of that name is untouched then.
    """
    content = MarionetteSearch(
        source=search.motion.source,
        numbers=_numbers(search.mechanism),
        t=search.motion.t,
        body=body_columns(search.mechanism, search.motion),
        stage=search.stage,
        result=search.result,
        strings=search.mechanism.nc,
        control=_control(search.mechanism),
        follow=search.follow,
        markers=wanted_markers(search.motion),
        effort=search.effort,
        firmness=search.firmness,
        kinds=tuple(sorted(search.kinds)),
        parts=search.parts,
        axes=axes_of(search.mechanism),
    )
    return save_record(path, content, provenance=search.provenance)


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
    record = load_record(path, MarionetteRun)
    return _run_of(path, record.content, record.provenance)


def load_unfinished(path: str | os.PathLike[str]) -> TrackingRun | TrackingSearch:
    """Read what `track` can go on with: a run of the marionette, or a search for its first trajectory.

    Raises `ResultFileError` as `load_run` does.
    """
    kinds: tuple[type[MarionetteRun | MarionetteSearch], ...] = (MarionetteRun, MarionetteSearch)
    record = load_record(path, *kinds)
    if isinstance(record.content, MarionetteRun):
        return _run_of(path, record.content, record.provenance)
    return _search_of(path, record.content, record.provenance)


def _numbers(mechanism: Mechanism) -> dict[str, float]:
    """Return the parameters of a mechanism that are not those of `marionette`."""
    standard = _mechanism(mechanism.nc, {}, _control(mechanism), axes_of(mechanism)).parameters
    return {name: value for name, value in mechanism.parameters.items() if standard.get(name) != value}


def _control(mechanism: Mechanism) -> str:
    """Return which of `CONTROLS` a marionette hangs on; nothing where hands hold all strings."""
    hanging = set_of(mechanism)
    return hanging if isinstance(hanging, str) else ""


def _mechanism(strings: int, numbers: Mapping[str, float], control: str = "", axes: Axes = "zyx") -> Mechanism:
    known: tuple[Hanging, ...] = tuple(CONTROLS) if control else tuple(STRING_SETS)
    hanging = next((each for each in known if each == (control or strings)), None)
    if hanging is None:
        what = f"a control called {control!r}" if control else f"{strings} strings"
        raise ResultFileError(f"a marionette on {what} is none")
    mechanism = marionette(strings=hanging, axes=axes)
    return mechanism.with_parameters(numbers) if numbers else mechanism


def _check(arrays: Mapping[str, tuple[Array, tuple[int, ...]]]) -> None:
    for name, (array, shape) in arrays.items():
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise ResultFileError(f"{name} has shape {array.shape}, expected {shape} finite numbers")


def _run_of(path: str | os.PathLike[str], saved: MarionetteRun, provenance: Provenance) -> TrackingRun:
    check_result(saved.result, str(path))
    try:
        mechanism = _mechanism(saved.strings, saved.numbers, saved.control, saved.axes)
        system = MidpointSystem(MidpointVI(mechanism), saved.t, multipliers=True)
        _check(
            {
                "reference": (saved.reference, (system.N + 1, mechanism.nq)),
                "result.x": (saved.result.x, (system.N + 1, system.nx)),
                "result.u": (saved.result.u, (system.N, system.nu)),
            }
        )
        _check_markers(saved, system.N)
        return TrackingRun(
            mechanism=mechanism,
            source=saved.source,
            reference=saved.reference,
            embedded=saved.embedded,
            trajectory=system.trajectory(saved.result.x, saved.result.u),
            result=saved.result,
            plan=saved.plan,
            kinds=_kinds_of(saved, mechanism),
            unfinished=saved.unfinished,
            follow=_follow_of(saved),
            markers=saved.markers,
            effort=saved.effort,
            limits=saved.limits,
            provenance=provenance,
        )
    except LeastActionError as error:
        raise _contradiction(path, error) from error


def _known_kinds(kinds: tuple[str, ...]) -> frozenset[str]:
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown:
        raise ResultFileError(f"limits of the kinds {', '.join(unknown)} are none; the kinds are {', '.join(KINDS)}")
    return frozenset(kinds)


def _kinds_of(saved: MarionetteRun, mechanism: Mechanism) -> frozenset[str]:
    """Return the kinds of limits that were stated; of a file without them, those that its limits' labels are of."""
    if saved.kinds is not None:
        return _known_kinds(saved.kinds)
    found = (saved.plan or saved.result).limits
    labels = () if found is None else found.labels
    string, end = strings_of(mechanism)[0], ends_of(mechanism).x[0]
    signs = {
        "tension": (f"{string.name} ", f"tension of {string.name} "),
        "joints": tuple(f"{name} " for name in JOINT_LIMITS),
        "speed": (f"v_{end} ",),
        "acceleration": (f"acceleration of {end} ",),
        "reach": (f"{end} ",),
    }
    return frozenset(kind for kind, sign in signs.items() if any(label.startswith(sign) for label in labels))


def _search_of(path: str | os.PathLike[str], saved: MarionetteSearch, provenance: Provenance) -> TrackingSearch:
    check_result(saved.result, str(path))
    try:
        mechanism = _mechanism(saved.strings, saved.numbers, saved.control, saved.axes)
        # By tensions: no lengths among the variables. Inputs are tensions, motors, and places of the upper ends.
        N, strings = len(saved.t) - 1, mechanism.nc
        moved = mechanism.nrho - len(held_strings(mechanism))
        tying, parts = saved.firmness is not None, saved.parts
        first, nd = mechanism.first_rho, mechanism.nd
        nx, inputs = first + nd + 2 * moved, strings + moved + (0 if tying or parts is not None else nd)
        if parts is not None:
            done = len(parts.u)
            if not 0 < done <= N or saved.stage != 0 or tying:
                raise ResultFileError(f"a search with {done} steps that are followed, of {N}, is none")
            _check({"parts.x": (parts.x, (done + 1, nx)), "parts.u": (parts.u, (done, inputs))})
        elif not 0 < saved.stage <= len(PRICES) + tying:
            raise ResultFileError(f"a search at stage {saved.stage} is none")
        if tying and not (mechanism.nc and saved.control and 0.0 < cast("float", saved.firmness) < np.inf):
            raise ResultFileError(f"strings on bars that are tied with a weight of {saved.firmness} are none")
        steps = len(saved.result.u)
        if steps not in (N, N // 2) and parts is None:
            raise ResultFileError(f"a search with {steps} steps for a motion of {N} is none")
        _check(
            {
                "body": (saved.body, (N + 1, first)),
                "result.x": (saved.result.x, (steps + 1, nx)),
                "result.u": (saved.result.u, (steps, inputs)),
            }
        )
        _check_markers(saved, N)
        motion = Motion(body_of(mechanism), saved.t, saved.body, saved.source)
        if saved.markers is not None:
            motion = with_places(motion, saved.markers)
        return TrackingSearch(
            mechanism=mechanism,
            motion=motion,
            stage=saved.stage,
            result=saved.result,
            follow=_follow_of(saved),
            effort=saved.effort or Effort(),
            firmness=saved.firmness,
            kinds=_known_kinds(saved.kinds),
            parts=saved.parts,
            provenance=provenance,
        )
    except LeastActionError as error:
        raise _contradiction(path, error) from error


def _follow_of(saved: MarionetteRun | MarionetteSearch) -> Follow:
    for known in get_args(Follow):
        if known == saved.follow:
            return cast("Follow", known)
    raise ResultFileError(f"a run that follows {saved.follow!r} is none")


def _check_markers(saved: MarionetteRun | MarionetteSearch, N: int) -> None:
    if saved.markers is not None:
        _check({"markers": (saved.markers, (N + 1, len(MARKERS), 3))})


def _contradiction(path: str | os.PathLike[str], error: LeastActionError) -> ResultFileError:
    return ResultFileError(f"{path} contradicts itself: {error}. Run the optimisation again")
