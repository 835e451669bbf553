"""Where a command takes its mechanism from: a file, or a ready model by name; and the configuration that is meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from leastaction.apps.cli.mechanism.options import ModelOptions, PoseOptions
from leastaction.errors import ArgumentError, closest, unknown
from leastaction.io.mechanisms import Model, load
from leastaction.mechanics import project_configuration
from leastaction.models import MODELS, build
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import matching

MODEL_FILES = (".urdf", ".xml", ".mjcf", ".yaml", ".yml", ".json")


def model_of(source: str, options: ModelOptions | None = None) -> Model:
    """Return the model of a file, or the ready one of a name.

    Raises `ArgumentError`: what is neither.
    """
    if source in MODELS:
        return Model(name=source, mechanism=build(source))
    options = options or ModelOptions()
    path = Path(source)
    if path.suffix and path.suffix.lower() not in MODEL_FILES:
        raise ArgumentError(
            f"got {source}, expected a model: a file that ends in {', '.join(MODEL_FILES)}, or the name of a ready one"
        )
    if not path.suffix and not path.exists():
        known = closest(source, MODELS, what="ready models")
        raise ArgumentError(f"there is no file {source!r}, and no ready model of that name; {known}")
    return load(
        path,
        floating=options.floating,
        fixed=options.fixed,
        packages=options.package,
        inertia="repair" if options.repair else "strict",
        strict=options.strict,
    )


def configuration_of(model: Model, options: PoseOptions | None = None) -> Array:
    """Return the configuration (nq,) that is meant, on the constraints.

    Raises `ArgumentError`: an unknown keyframe or variable, or a loop that cannot be closed from there.
    """
    options = options or PoseOptions()
    m = model.mechanism
    if options.at is not None and options.at not in model.keyframes:
        raise unknown("keyframe", options.at, model.keyframes)
    q = m.configuration(model.reference if options.at is None else model.keyframes[options.at].q)
    values = numbers_by_name(options.set, m.variables, "--set")
    for name, value in values.items():
        q[m.variables.index(name)] = value
    if m.nc == 0:
        return q
    held = [name for name in values if name in m.dynamic]
    return project_configuration(m, q, hold=held, move_kinematic=True, attempts=10).q


def numbers_by_name(words: Iterable[str], known: Sequence[str], option: str) -> dict[str, float]:
    """Return values by name from words such as ``elbow=30deg``; the names may be patterns.

    Raises `ArgumentError`: a word of another form, or a name that nothing has.
    """
    values: dict[str, float] = {}
    for word in words:
        pattern, equals, text = word.partition("=")
        degrees = text.endswith("deg")
        try:
            number = float(text.removesuffix("deg"))
        except ValueError:
            number = np.nan
        if not equals or not np.isfinite(number):
            raise ArgumentError(f"{option}: got {word!r}, expected a name and a number, elbow=0.5 or elbow=30deg")
        found = matching(known, pattern)
        if not found:
            raise ArgumentError(f"{option}: {unknown('name', pattern, known)}")
        values.update({known[i]: float(np.radians(number)) if degrees else number for i in found})
    return values


def left_out(model: Model) -> list[dict[str, str]]:
    """Return what was not taken over from a model's file."""
    return [{"name": each.name, "why": each.why} for each in model.left_out]
