"""Files in other formats: which kind a file is, by its ending, and what it can become."""

from __future__ import annotations

from pathlib import Path

from leastaction.apps.cli.mechanism.options import ModelOptions
from leastaction.apps.cli.mechanism.source import MODEL_FILES, model_of
from leastaction.errors import ArgumentError
from leastaction.models import MODELS

_RUNS = (".h5", ".npz")
MARKER_FILES = (".c3d", ".trc")
"""Endings of captures by markers."""

_MOTIONS = (".bvh", ".amc", ".csv", *MARKER_FILES)
_TARGETS = {"model": (".yaml", ".yml", ".json"), "run": (".h5", ".npz", ".csv", ".mat"), "motion": (".csv",)}


def converted(source: Path, target: Path, options: ModelOptions | None = None) -> Path:
    """Write what a file holds in the format that another's ending says; return the file written.

    Raises `ArgumentError`: endings that do not go together.
    """
    kind = _kind(source)
    if target.suffix.lower() not in _TARGETS[kind]:
        raise ArgumentError(
            f"got {source.name} and {target.name}: a {kind} is written as {', '.join(_TARGETS[kind])}, "
            f"not as {target.suffix or 'a file without an ending'}"
        )
    if kind == "model":
        return model_of(str(source), options).mechanism.save(target)
    if kind == "run":
        from leastaction.io import open as open_file

        return open_file(source).save(target)
    from leastaction.io import read_capture, read_markers, read_motion

    if source.suffix.lower() in MARKER_FILES:
        return read_markers(source).save(target)
    motion = read_motion(source) if source.suffix.lower() == ".csv" else read_capture(source).motion()
    return motion.save(target)


def _kind(source: Path) -> str:
    if str(source) in MODELS:
        return "model"
    for kind, endings in (("model", MODEL_FILES), ("run", _RUNS), ("motion", _MOTIONS)):
        if source.suffix.lower() in endings:
            return kind
    known = ", ".join((*MODEL_FILES, *_RUNS, *_MOTIONS))
    raise ArgumentError(f"got {source.name}, expected a file that ends in one of {known}, or the name of a ready model")
