"""What is wanted over time, as a problem file says: by names of variables and frames, NaN where nothing is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from leastaction.apps.problems import records
from leastaction.apps.problems.formulas import formula
from leastaction.errors import ArgumentError, LeastActionError, ResultFileError, unknown
from leastaction.io.mechanisms import Model
from leastaction.io.motion import forward_kinematics, read_capture
from leastaction.io.motion.table import UNITS
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.dataset.tables import read_table
from leastaction.numerics.documents import Document, Place
from leastaction.numerics.names import matching


def wanted_of(parts: Sequence[Any], model: Model, t: Array, document: Document) -> dict[str, Array]:
    """Return what is wanted: (N+1,) of variables, (N+1, 3) of frames.

    Raises `ModelFileError`: with the place of what is wrong.
    """
    found: dict[str, Array] = {}
    for index, part in enumerate(parts):
        place: Place = ("wanted", index)
        try:
            values = _values(part, model, t, document.folder)
        except (LeastActionError, OSError) as error:
            raise document.error(place, str(error)) from None
        for name, each in values.items():
            found[name] = _together(found[name], each) if name in found else each
    return found


def _together(first: Array, second: Array) -> Array:
    """Return what is wanted by two parts: the later one where both say something."""
    return np.where(np.isnan(second), first, second)


def _values(part: Any, model: Model, t: Array, folder: Path) -> dict[str, Array]:
    m = model.mechanism
    if isinstance(part, records.PosesPart):
        return _poses(part, model, t)
    if isinstance(part, records.FilePart):
        return _file(part, m, t, folder)
    if isinstance(part, records.CapturePart):
        return _capture(part, m, t, folder)
    width = _width(m, part.name)
    if isinstance(part, records.ConstantPart):
        return {part.name: np.tile(_entry(part.value, width, part.name), (len(t), 1)[: 1 + (width == 3)])}
    if isinstance(part, records.KeyframesPart):
        instants = np.array([_number(pair[0]) for pair in part.points])
        values = np.array([_entry(pair[1], width, part.name) for pair in part.points])
        return {part.name: _between(instants, values, t, part.between)}
    texts = part.value if isinstance(part.value, list) else [part.value]
    if len(texts) != width:
        raise ArgumentError(f"{part.name!r}: got {len(texts)} formulas, expected {width}")
    columns = np.stack([formula(str(text))(t) for text in texts], axis=1)
    start = t[0] if not isinstance(part.start, float) else part.start
    end = t[-1] if not isinstance(part.end, float) else part.end
    columns = np.where(((t >= start) & (t <= end))[:, None], columns, np.nan)
    return {part.name: columns if width == 3 else columns[:, 0]}


def _width(m: Mechanism, name: str) -> int:
    """Return how many numbers are wanted of a name: of a variable one, of a frame three."""
    if name in m.variables:
        return 1
    if name in m.frames:
        return 3
    raise unknown("variable or frame", name, (*m.variables, *m.frames))


def _entry(value: Any, width: int, name: str) -> Any:
    entries = value if isinstance(value, list) else [value]
    if len(entries) != width:
        kind = "the place of a frame, three numbers" if width == 3 else "the value of a variable, one number"
        raise ArgumentError(f"{name!r}: got {value}, expected {kind}")
    if not np.all(np.isfinite(entries)):
        raise ArgumentError(f"{name!r}: got {value}, expected finite numbers")
    return np.array(entries) if width == 3 else entries[0]


def _number(value: Any) -> float:
    if isinstance(value, list) or not np.isfinite(value):
        raise ArgumentError(f"got the time {value}, expected a number of seconds")
    return float(value)


def _between(instants: Array, values: Array, t: Array, how: str) -> Array:
    """Return values at some instants as wanted over time: nothing between them, or the smooth curve through them."""
    slack = 0.5 * float(np.diff(t).max()) + 1e-9
    if np.any(np.diff(instants) <= 0.0):
        raise ArgumentError(f"points: got the times {instants.tolist()}, expected increasing ones")
    if instants[0] < t[0] - slack or instants[-1] > t[-1] + slack:
        raise ArgumentError(
            f"points: got times from {instants[0]:g} to {instants[-1]:g} s, expected some from {t[0]:g} to {t[-1]:g} s"
        )
    goal = np.full((len(t), *values.shape[1:]), np.nan)
    if how == "free" or len(instants) == 1:
        goal[[int(np.argmin(np.abs(t - at))) for at in instants]] = values
        return goal
    from scipy.interpolate import PchipInterpolator

    inside = (t >= instants[0] - 1e-9) & (t <= instants[-1] + 1e-9)
    goal[inside] = PchipInterpolator(instants, values)(t[inside])
    return goal


def _poses(part: records.PosesPart, model: Model, t: Array) -> dict[str, Array]:
    instants = np.array([at for at, _ in part.points])
    for _, name in part.points:
        if name not in model.keyframes:
            raise unknown("keyframe", name, model.keyframes)
    poses = [model.keyframes[name].q for _, name in part.points]
    variables = model.mechanism.variables
    patterns = part.names if isinstance(part.names, list) else ["*"]
    chosen = {index for pattern in patterns for index in _matching(variables, pattern)}
    named = [name for i, name in enumerate(variables) if i in chosen and all(name in pose for pose in poses)]
    return {name: _between(instants, np.array([pose[name] for pose in poses]), t, part.between) for name in named}


def _matching(variables: Sequence[str], pattern: str) -> list[int]:
    found = matching(variables, pattern)
    if not found:
        raise unknown("variable", pattern, variables, "names")
    return found


def _file(part: records.FilePart, m: Mechanism, t: Array, folder: Path) -> dict[str, Array]:
    path = folder / part.file
    table, units = _table(path)
    if "t" not in table:
        raise ArgumentError(f"{path}: it has no column t, the times (s)")
    times = table.pop("t")
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0.0):
        raise ArgumentError(f"{path}: t: expected increasing times, two at least")
    names = part.columns if isinstance(part.columns, dict) else None
    if names is None:
        stems = dict.fromkeys(name.rpartition(".")[0] if name[-2:] in (".x", ".y", ".z") else name for name in table)
        names = {name: name for name in (*table, *stems) if name in m.variables or name in m.frames}
        if not names:
            raise ArgumentError(f"{path}: none of {', '.join(table)} is a variable or a frame of the mechanism")
    found = {}
    for name, column in names.items():
        width = _width(m, name)
        columns = [column] if width == 1 or column in table else [f"{column}.{axis}" for axis in "xyz"]
        for each in columns:
            if each not in table:
                raise unknown("column", each, table, str(path))
        turned = name in part.degrees
        given = [_in_rad_or_m(path, table[each], each, units.get(each, ""), degrees=turned) for each in columns]
        values = np.stack(given, axis=-1)
        values = values[..., 0] if values.shape[-1] == 1 else values
        if values.shape != ((len(times),) if width == 1 else (len(times), 3)):
            raise ArgumentError(f"{path}: {column!r}: got shape {values.shape} for {len(times)} times")
        found[name] = _at(times, values, t)
    return found


def _at(times: Array, values: Array, t: Array) -> Array:
    """Return samples at other times, linear between them; NaN where there are none."""
    columns = values.reshape(len(times), -1)
    made = np.stack([np.interp(t, times, column, left=np.nan, right=np.nan) for column in columns.T], axis=1)
    return made.reshape(len(t), *values.shape[1:])


def _table(path: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """Return columns by name, the times first as "t", and the units that a header says."""
    kind = path.suffix.lower()
    if not path.is_file():
        raise ArgumentError(f"{path}: there is no such file")
    if kind == ".npz":
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
                return {name: np.asarray(stored[name], dtype=np.float64) for name in stored.files}, {}
        except Exception as error:
            raise ArgumentError(f"{path}: it is no NPZ of numbers: {error}") from None
    if kind != ".csv":
        raise ArgumentError(f"{path}: got the ending {kind!r}, expected .csv or .npz")
    try:
        table = read_table(path)
    except ResultFileError as error:
        raise ArgumentError(str(error)) from None
    columns = {"t": table.t, **{each.name: each.values for each in table.columns}}
    return columns, {each.name: each.unit for each in table.columns if each.unit}


def _in_rad_or_m(path: Path, values: Array, column: str, unit: str, *, degrees: bool) -> Array:
    """Return a column without its unit; ``degrees``: the problem says that it is in degrees."""
    if unit not in UNITS:
        raise ArgumentError(f"{path}: {column} is in {unit!r}, expected one of {', '.join(filter(None, UNITS))}")
    if degrees and unit and UNITS[unit] != UNITS["deg"]:
        raise ArgumentError(f"{path}: {column} is in {unit!r}, but degrees says that it is in degrees; leave that out")
    return values * (UNITS["deg"] if degrees else UNITS[unit])


def _capture(part: records.CapturePart, m: Mechanism, t: Array, folder: Path) -> dict[str, Array]:
    skeleton = folder / part.skeleton if isinstance(part.skeleton, str) else None
    rate = part.frame_rate if isinstance(part.frame_rate, float) else None
    capture = read_capture(folder / part.file, skeleton=skeleton, frame_rate=rate)
    positions: Array = forward_kinematics(capture)[0]
    names = [joint.name for joint in capture.joints]
    times: Array = np.arange(len(positions), dtype=np.float64) * (capture.frame_time / part.speed)
    # A rotation of the axes in their order, by which one becomes the other.
    shift = ("xyz".index(part.upwards) - "xyz".index(part.up)) % 3
    offset = np.asarray(part.offset) if isinstance(part.offset, list) else np.zeros(3)
    found = {}
    for frame, joint in part.frames.items():
        if _width(m, frame) != 3:
            raise ArgumentError(f"{frame!r} is a variable, expected a frame, whose place the capture gives")
        if joint not in names:
            raise unknown("joint", joint, names, part.file)
        places: Array = np.roll(positions[:, names.index(joint)], shift, axis=1)
        found[frame] = _at(times, np.asarray(part.scale * places + offset, dtype=np.float64), t)
    return found


def keyframe_values(model: Model, name: str) -> Mapping[str, float]:
    """Return the configuration of a model's keyframe by variable."""
    if name not in model.keyframes:
        raise unknown("keyframe", name, model.keyframes)
    return model.keyframes[name].q
