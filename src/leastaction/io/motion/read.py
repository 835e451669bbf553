"""Read a motion capture file of any kind that there is a reader for."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io.motion.acclaim import read_amc
from leastaction.io.motion.bvh import read_bvh
from leastaction.io.motion.capture import Capture
from leastaction.io.motion.motion import Motion
from leastaction.io.motion.table import Between, read_table_motion
from leastaction.numerics.public import public


@public
def read_motion(path: str | PathLike[str], *, gaps: Between | None = None) -> Motion:
    """Read a motion of named variables over time from a table of text (CSV).

    Parameters
    ----------
    path : path
        A header with the time first, then names and their units, ``t [s],elbow [deg],torso_tx [mm]``, and a line for
        each instant. Degrees, millimetres and centimetres become radians and metres; a name without a unit is taken as
        it is. Lines that begin with # are left out. `Motion.save` writes such a file. Of a capture by its skeleton
        (``.bvh``, ``.amc``) see `read_capture`, of one by its markers (``.c3d``, ``.trc``) `read_markers`.
    gaps : {"linear", "spline"}, optional
        Fill what is missing (NaN, or nothing between two commas) on straight lines, or on the cubic spline through what
        is known; before and after that the nearest value is held. Without it a gap is an error.

    Returns
    -------
    Motion
        In rad and m.

    Raises
    ------
    MotionFileError
        The file cannot be read or is no such table; the message names the line.
    ArgumentError
        Another word for `gaps`.
    """
    kind = Path(path).suffix.lower()
    for endings, reader in (((".bvh", ".amc", ".asf"), "read_capture"), ((".c3d", ".trc"), "read_markers")):
        if kind in endings:
            raise MotionFileError(
                f"{path}: is a capture, expected a table of named variables. `leastaction.io.{reader}` reads it"
            )
    return read_table_motion(path, gaps)


@public
def read_capture(
    path: str | PathLike[str],
    *,
    skeleton: str | PathLike[str] | None = None,
    frame_rate: float | None = None,
    fill: bool = True,
) -> Capture:
    """Read a captured motion: Acclaim's where the file's name ends in ``.amc``, else BVH.

    Parameters
    ----------
    path : path
        The file.
    skeleton, frame_rate
        Of an AMC file, see `read_amc`.
    fill : bool, optional
        Fill samples that are missing, see `fill_gaps`.

    Raises
    ------
    MotionFileError
        As of `read_bvh` and `read_amc`; or the file is a skeleton without a motion.
    ArgumentError
        A skeleton or a frame rate for a file that holds its own.
    """
    kind = Path(path).suffix.lower()
    if kind == ".amc":
        return read_amc(path, skeleton=skeleton, frame_rate=frame_rate, fill=fill)
    if kind == ".asf":
        raise MotionFileError(f"{path}: is a skeleton, expected a motion. Give the AMC file that goes with it.")
    for name, given in (("skeleton", skeleton), ("frame_rate", frame_rate)):
        if given is not None:
            raise ArgumentError(f"{name}: got {given} for {path}, which holds its own; only AMC files want one")
    return read_bvh(path, fill=fill)
