"""A problem file, read: the mechanism, and the arguments of `follow` that the file states."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.apps.problems import records
from leastaction.apps.problems.formulas import formula
from leastaction.apps.problems.records import FORMAT, ProblemRecord
from leastaction.apps.problems.wanted import keyframe_values, wanted_of
from leastaction.errors import ArgumentError, LeastActionError
from leastaction.io.mechanisms import Keyframe, Model, load
from leastaction.mechanics import Mechanism, MidpointVI, State, project_configuration, project_velocity
from leastaction.models import MODELS, build
from leastaction.models.marionette import rest_pose
from leastaction.numerics.arrays import Array
from leastaction.numerics.documents import Document, Place, check_format, read_document
from leastaction.optimal import Bound, Equal, FinalTime, Parameter, Periodic
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.unknowns.unknown import Unknown
from leastaction.systems import Ball, Box, HalfSpace, Keep, MidpointSystem

_AT_REST: dict[str, Callable[[Mechanism], Array]] = {"marionette": rest_pose}


def ready_model(name: str) -> Model:
    """Return a ready model by name; where it has a pose at rest, that is its keyframe ``rest``."""
    mechanism = build(name)
    poses = {"rest": _AT_REST[name](mechanism)} if name in _AT_REST else {}
    keyframes = {each: Keyframe(q=mechanism.named(q)) for each, q in poses.items()}
    return Model(
        mechanism=mechanism, name=name, keyframes=keyframes, reference=dict(keyframes["rest"].q) if keyframes else {}
    )


_MODEL_FILES = (".urdf", ".xml", ".mjcf", ".yaml", ".yml", ".json")
_MOST_STEPS = 1_000_000


@dataclass(frozen=True)
class ProblemFile:
    """A problem as a file states it.

    Attributes
    ----------
    title : str
        What it is about, in words.
    model : Model
        The mechanism, and what its file says beside it.
    t : ndarray (N+1,)
        Times (s).
    wanted : mapping of str to ndarray
        As `follow` takes it.
    weights : mapping of str to float
    limits : tuple of Limit
    start : State or None
    options : mapping
        Of `optimize`.
    plots, animation : bool
        Whether they are wanted.
    document : Document
        What was read.
    """

    title: str
    model: Model
    t: Array
    wanted: Mapping[str, Array]
    weights: Mapping[str, float]
    limits: tuple[Limit, ...]
    start: State | None
    options: Mapping[str, Any]
    plots: bool
    animation: bool
    document: Document = field(repr=False)


def load_problem(path: str | os.PathLike[str]) -> ProblemFile:
    """Read a problem file.

    Parameters
    ----------
    path : path
        In YAML (``.yaml``, ``.yml``) or JSON (``.json``). What it names lies relative to its folder.

    Raises
    ------
    ModelFileError
        For a file that is not there or is broken, and for what does not fit, with its line and place in the file.
    """
    document = read_document(path)
    check_format(document, FORMAT)
    record = document.read_as(ProblemRecord)
    at = _Places(document)
    model = at("model", partial(_model, record, document.folder))
    if record.parameters:
        changed = at("parameters", partial(model.mechanism.with_parameters, record.parameters))
        model = replace(model, mechanism=changed)
    t = at("time", partial(_times, record.time))
    wanted = wanted_of(record.wanted, model, t, document)
    system = MidpointSystem(MidpointVI(model.mechanism), t, multipliers=model.mechanism.nc > 0)
    limits = list(model.limits) if record.model_limits else []
    for index, each in enumerate(record.limits):
        limits.append(at(("limits", index), partial(_limit, each, system)))
    start = at("start", partial(_start, record.start, model)) if isinstance(record.start, records.StartPart) else None
    options = record.optimizer.given()
    if any(isinstance(limit, Periodic) for limit in limits):
        options.setdefault("free_start", True)
    unknowns = [at(("unknowns", i), partial(_unknown, each, system)) for i, each in enumerate(record.unknowns)]
    if unknowns:
        options["unknowns"] = unknowns
    return ProblemFile(
        title=record.title or Path(document.title).stem,
        model=model,
        t=t,
        wanted=wanted,
        weights=record.weights,
        limits=tuple(limits),
        start=start,
        options=options,
        plots=record.output.plots,
        animation=record.output.animation,
        document=document,
    )


class _Places:
    """Says where in the file something is wrong."""

    def __init__(self, document: Document) -> None:
        self.document = document

    def __call__(self, place: str | Place, make: Callable[[], Any]) -> Any:
        where = (place,) if isinstance(place, str) else place
        try:
            return make()
        except (LeastActionError, ImportError) as error:
            raise self.document.error(where, str(error).removeprefix(f"{where[0]}: ")) from None


def _model(record: ProblemRecord, folder: Path) -> Model:
    part = record.model
    options = {} if isinstance(part, str) else part.given("file")
    name = part if isinstance(part, str) else part.file
    if not options and name in MODELS:
        return ready_model(name)
    if Path(name).suffix.lower() not in _MODEL_FILES:
        known = ", ".join(MODELS)
        raise ArgumentError(
            f"got {name!r}, expected a file ({', '.join(_MODEL_FILES)}) or a ready model: one of {known}"
        )
    if "packages" in options:
        options["packages"] = [folder / each for each in options["packages"]]
    return load(folder / name, **options)


def _times(part: records.TimePart) -> Array:
    given = part.given("duration")
    if len(given) != 1:
        raise ArgumentError("expected either steps, their number, or dt, their length (s)")
    steps = given["steps"] if "steps" in given else part.duration / given["dt"]
    if not 0.5 <= steps <= _MOST_STEPS:
        raise ArgumentError(f"got {steps:.3g} steps, expected 1 to {_MOST_STEPS}")
    return np.linspace(0.0, part.duration, round(steps) + 1)


def _start(part: Any, model: Model) -> State:
    m = model.mechanism
    values = dict(model.reference)
    given = part.given()
    if "keyframe" in given:
        values |= keyframe_values(model, given["keyframe"])
    q = m.configuration({name: value for name, value in values.items() if name in m.variables})
    own = m.configuration(given.get("q"), default=0.0)  # or say which name is unknown
    for name in given.get("q", {}):
        q[m.variables.index(name)] = own[m.variables.index(name)]
    v = m.configuration(given.get("v"))
    vi = MidpointVI(m)
    if m.nc:
        q = project_configuration(m, q, hold=part.hold, move_kinematic=True, attempts=10).q
        v = project_velocity(m, q, v).v
    return vi.start(q, v)


def _over_time(value: Any) -> Any:
    return formula(value) if isinstance(value, str) else value


def _limit(part: Any, system: MidpointSystem) -> Limit:
    options = part.given()
    limit: Limit
    if isinstance(part, records.BoundPart):
        limit = Bound(**{key: _over_time(each) if key in ("min", "max") else each for key, each in options.items()})
    elif isinstance(part, records.EqualPart):
        limit = Equal(**{key: _over_time(each) if key == "value" else each for key, each in options.items()})
    elif isinstance(part, records.PeriodicPart):
        return Periodic(**options)
    else:
        regions = {key: _region(options[key]) for key in ("inside", "outside") if key in options}
        limit = Keep(**{**options, **regions})
    limit.rows(system, 1)  # what is wrong with it is said now
    return limit


def _region(part: Any) -> Ball | Box | HalfSpace:
    if isinstance(part, records.BoxPart):
        return Box(part.low, part.high)
    if isinstance(part, records.HalfSpacePart):
        return HalfSpace(part.normal, part.offset)
    if not any(isinstance(each, str) for each in part.center):
        return Ball(part.center, part.radius)
    axes = [formula(str(each)) for each in part.center]
    return Ball(lambda t: np.array([axis(t) for axis in axes]), part.radius)


def _unknown(part: Any, system: MidpointSystem) -> Unknown:
    made = FinalTime(**part.given()) if isinstance(part, records.FinalTimePart) else Parameter(**part.given())
    made.value_of(system)  # or say that it is unknown
    return made
