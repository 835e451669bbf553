"""Read a motion capture file of any kind that there is a reader for."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io.motion.acclaim import read_amc
from leastaction.io.motion.bvh import read_bvh
from leastaction.io.motion.capture import Capture


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
