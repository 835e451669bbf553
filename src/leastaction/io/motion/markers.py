"""Markers of a capture: named places over time, of C3D and TRC files and of tables, for frames to follow."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from leastaction.errors import ArgumentError, MotionFileError, closest, some
from leastaction.io.motion.marker_tables import METRES, factor, named_apart, read_csv, read_trc
from leastaction.io.motion.motion import count_steps
from leastaction.numerics.arrays import Array, as_choice, as_number, require_mapping
from leastaction.numerics.dataset import Column, Dataset, Savable, table
from leastaction.numerics.extras import extra
from leastaction.numerics.public import public

_BLOCK: Final = 512
_MARK: Final = 0x50
_VAX: Final = 85
_BIG_ENDIAN: Final = 86


@public
@dataclass(frozen=True, eq=False)
class Markers(Savable):
    """Places of named markers over time; `follow` takes them where their names are those of frames.

    Frozen; threads may share it.

    Attributes
    ----------
    names : tuple of str
    t : ndarray, shape (F,)
        Times (s), from zero.
    places : ndarray, shape (F, n, 3)
        Of each marker in the axes of the capture (m); NaN where it was not seen.
    source : str
        Where they come from.
    """

    names: tuple[str, ...]
    t: Array
    places: Array
    source: str = ""

    def __post_init__(self) -> None:
        t, places = np.array(self.t, dtype=np.float64), np.array(self.places, dtype=np.float64)
        names = tuple(self.names)
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ArgumentError(f"names: got {twice!r} twice, expected a name of its own for each marker")
        if t.ndim != 1 or places.shape != (len(t), len(names), 3):
            raise ArgumentError(
                f"places: got shape {places.shape}, expected {(t.size, len(names), 3)}, for times and markers"
            )
        if not np.isfinite(t).all() or (np.diff(t) <= 0.0).any():
            raise ArgumentError("t: expected finite times that increase (s)")
        t.flags.writeable = places.flags.writeable = False
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "places", places)

    def dataset(self) -> Dataset:
        places = self.places.reshape(len(self.t), -1)
        names = [f"{name}.{axis}" for name in self.names for axis in "xyz"]
        columns = [Column(name, "m", values) for name, values in zip(names, places.T, strict=True)]
        return table(self.t, columns, content={"source": self.source})

    def __str__(self) -> str:
        """Say how many there are, for how long, and their names."""
        count = f"{len(self.names)} marker{'s' * (len(self.names) != 1)}"
        return f"{count} at {len(self.t)} times over {self.t[-1] - self.t[0]:g} s: {some(self.names)}"

    def __getitem__(self, name: str) -> Array:
        """Return the places (F, 3) of a marker by name (m); NaN where it was not seen."""
        return self.places[:, self._column(name)]

    def seen(self, name: str) -> float:
        """Return the share of the time at which a marker was seen, from 0 to 1."""
        return float(np.isfinite(self[name]).all(axis=1).mean())

    def renamed(self, frames: Mapping[str, str]) -> Markers:
        """Return some of the markers under other names, such as those of the frames that are to follow them.

        ``frames``: new names by those of the markers; others are left out. Raises `ArgumentError` for an unknown
        marker.
        """
        require_mapping(frames, "frames", "{'LFHD': 'head'}")
        columns = [self._column(name) for name in frames]
        return replace(self, names=tuple(frames.values()), places=self.places[:, columns])

    def resample(self, dt: float) -> Markers:
        """Return the markers at equal steps of dt (s) on straight lines; NaN where a neighbour was not seen.

        Raises `ArgumentError` for a step that is not positive, or longer than the capture.
        """
        as_number(dt, "dt", above=0.0)
        duration = float(self.t[-1] - self.t[0])
        steps = int(np.floor(duration / dt + 1e-9))
        if steps < 1 or count_steps(duration, dt) < 1:
            raise ArgumentError(f"dt: got {dt:g} s, longer than the capture of {duration:g} s")
        t = dt * np.arange(steps + 1, dtype=np.float64)
        inside = np.minimum(self.t[0] + t, self.t[-1])
        after = np.clip(np.searchsorted(self.t, inside, side="left"), 1, len(self.t) - 1)
        share = ((inside - self.t[after - 1]) / (self.t[after] - self.t[after - 1]))[:, None, None]
        # What has no share in a place may be missing.
        before, behind = self.places[after - 1], self.places[after]
        between = np.where(
            share <= 1e-9, before, np.where(share >= 1.0 - 1e-9, behind, before + share * (behind - before))
        )
        return replace(self, t=t, places=between)

    def _column(self, name: str) -> int:
        if name not in self.names:
            raise ArgumentError(f"there is no marker {name!r}; {closest(name, self.names, what='markers')}")
        return self.names.index(name)


@public
def read_markers(path: str | os.PathLike[str], *, unit: str | None = None) -> Markers:
    """Read the markers of a C3D or TRC file, or of a table (CSV).

    Analog channels and force plates are left out. A marker without a label is called by its number, "unlabelled 7";
    the second of a name "LFHD#2".

    Parameters
    ----------
    path : path
        The file. The header of a table has the time first, then three columns of each marker, ``t [s],hand.x [mm],
        hand.y [mm],hand.z [mm]``, in metres where there is no unit; a marker was not seen where a field is empty.
    unit : {"mm", "cm", "m"}, optional
        Of the places, for a file that does not say it.

    Returns
    -------
    Markers
        In m, at times from zero, in the axes of the file.

    Raises
    ------
    MotionFileError
        The file cannot be read, is none of these, holds no markers, or does not say in what unit.
    MissingExtraError
        ezc3d is not installed, which ``.c3d`` needs.
    """
    if unit is not None:
        as_choice(unit, "unit", tuple(METRES))
    source = Path(path)
    if not source.is_file():
        raise MotionFileError(
            f"{source}: is no file that can be read; expected a C3D file, a TRC or a table. Check the path."
        )
    read = {".csv": read_csv, ".trc": read_trc}.get(source.suffix.lower(), _read_c3d)
    names, t, places = read(source, unit)
    if len(names) == 0 or len(t) < 2:
        raise MotionFileError(
            f"{source}: holds {len(names)} markers at {len(t)} times, expected one or more at two or more."
        )
    try:
        return Markers(names, t - t[0], places, source.stem)
    except ArgumentError as error:
        raise MotionFileError(f"{source}: {error}") from error


def _read_c3d(source: Path, unit: str | None) -> tuple[tuple[str, ...], Array, Array]:
    """Return names, times (F,) and places (F, n, 3) in m of a C3D file."""
    _check_whole(source)
    content = _content(source)
    try:
        about = content["parameters"]["POINT"]
        points = np.asarray(content["data"]["points"], dtype=np.float64)
        residuals = np.asarray(content["data"]["meta_points"]["residuals"], dtype=np.float64)
        rate = float(about["RATE"]["value"][0])
        n, frames = points.shape[1:]
        names = _names(about, n)
        said = [str(each).strip() for each in about["UNITS"]["value"]] if "UNITS" in about else []
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise MotionFileError(
            f"{source}: lacks what a C3D file says of its markers ({error}). Export it again."
        ) from error
    if not (np.isfinite(rate) and rate > 0.0):
        raise MotionFileError(
            f"{source}: its markers have the rate {rate:g} Hz, expected a positive one. Export it again."
        )
    metres = factor(source, said[0] if said else "", unit)
    places = np.where(residuals[0] < 0.0, np.nan, points[:3]).transpose(2, 1, 0) * metres
    return names, np.arange(frames) / rate, places


def _check_whole(source: Path) -> None:
    """Raise a `MotionFileError` for a file that is shorter than its header says: ezc3d may read such a one for ever.

    The header: where the parameters begin (in blocks, from 1), the mark of the format, numbers of markers and of analog
    values a frame, the first and the last frame, a scale, negative where values are floats, where the data begin. The
    parameters: how many blocks they are, and the kind of processor, which says the order of bytes.
    """
    try:
        with source.open("rb") as file:
            header = file.read(_BLOCK)
            begin = _BLOCK * (header[0] - 1) if len(header) == _BLOCK and header[1] == _MARK else -1
            file.seek(max(begin, 0))
            about = file.read(4)
            size = file.seek(0, os.SEEK_END)
    except OSError as error:
        raise MotionFileError(f"{source}: cannot be read ({error.strerror or error}). Check the path.") from error
    least = begin + 4
    if begin >= _BLOCK and len(about) == 4:
        order = ">" if about[3] == _BIG_ENDIAN else "<"
        markers, analog, first, last = struct.unpack_from(f"{order}4H", header, 2)
        is_float = about[3] != _VAX and struct.unpack_from(f"{order}f", header, 12)[0] < 0.0
        (start,) = struct.unpack_from(f"{order}H", header, 16)
        values = (4 * markers + analog) * max(last - first + 1, 0)
        least = max(begin + _BLOCK * about[2], _BLOCK * (start - 1) + (4 if is_float else 2) * values)
    if begin < _BLOCK or size < least:
        what = "no C3D file" if begin < _BLOCK else f"cut short: {size} bytes, expected {least} by its header"
        raise MotionFileError(f"{source}: is damaged or {what}. Export or fetch the file again.")


def _content(source: Path) -> Any:
    ezc3d = extra("ezc3d", of="c3d", why=source.name)
    try:
        return ezc3d.c3d(str(source))
    # Its reader is native, and raises nearly anything for a damaged file.
    except Exception as error:
        reason = " ".join(str(error).split()).removesuffix(": iostream error")[:200]
        raise MotionFileError(
            f"{source}: is damaged, cut short or no C3D file ({reason}). Export or fetch the file again."
        ) from error


def _names(about: Any, n: int) -> tuple[str, ...]:
    """Return a name for each of n markers: files of more than 255 go on in LABELS2 and so forth."""
    lists = [about[key]["value"] for key in ("LABELS", *(f"LABELS{i}" for i in range(2, 10))) if key in about]
    labels = [str(label).strip() for each in lists for label in each][:n]
    return named_apart(labels, n)
