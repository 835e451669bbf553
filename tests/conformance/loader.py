"""Reads a conformance case, ``NAME.json`` and ``NAME.npz``, into a mechanism and its numbers."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from leastaction.mechanics import (
    Body,
    BodyWrench,
    Branch,
    Damping,
    Distance,
    Element,
    Gravity,
    HybridWrench,
    JointForce,
    JointSpring,
    LinearDamper,
    LinearSpring,
    Mechanism,
    PointOnPlane,
    PointToPoint,
    SpatialWrench,
    world,
)

# How each element type of the files is described in the package; a type that is not here is waited for.
ELEMENTS: dict[str, Callable[[dict[str, Any]], Element]] = {
    "gravity": lambda e: Gravity(e["vector"]),
    "linear_spring": lambda e: LinearSpring(*e["frames"], stiffness=e["k"], length=e["x0"]),
    "config_spring": lambda e: JointSpring(e["config"], stiffness=e["k"], rest=e["q0"]),
    "damping": lambda e: Damping(e["coefficients"]),
    "linear_damper": lambda e: LinearDamper(*e["frames"], coefficient=e["c"]),
    "body_wrench": lambda e: BodyWrench(e["frame"], **halves(e["wrench"])),
    "spatial_wrench": lambda e: SpatialWrench(e["frame"], **halves(e["wrench"])),
    "hybrid_wrench": lambda e: HybridWrench(e["frame"], **halves(e["wrench"])),
    "config_force": lambda e: JointForce(e["config"], input=e["input"]),
    "distance": lambda e: Distance(*e["frames"], length=e["length"]),
    "point_on_plane": lambda e: PointOnPlane(e["plane_frame"], e["point_frame"], normal=e["normal"]),
    "point_to_point_component": lambda e: PointToPoint(
        *e["frames"], axes=e["axis"], name=f"{' on '.join(e['frames'])} {e['axis']}"
    ),
}


def halves(wrench: list[float | str]) -> dict[str, list[float | str]]:
    """Return the force and the torque of a wrench ``[fx fy fz tx ty tz]``."""
    return {"force": wrench[:3], "torque": wrench[3:]}


class Case(NamedTuple):
    """A case: ``mechanism`` is None as long as ``waiting`` names element types that are not there yet."""

    mechanism: Mechanism | None
    arrays: dict[str, np.ndarray]
    waiting: list[str]


def load_case(path: str | Path) -> Case:
    """Read a case.

    Parameters
    ----------
    path : path
        The ``.json`` file; the numbers are beside it.
    """
    path = Path(path)
    data = json.loads(path.read_text())
    with np.load(path.with_suffix(".npz")) as stored:
        arrays = {name: stored[name] for name in stored.files}
    entries = [*data["potentials"], *data["forces"], *data["constraints"]]
    waiting = sorted({entry["type"] for entry in entries} - set(ELEMENTS))
    if waiting:
        return Case(None, arrays, waiting)
    mechanism = Mechanism(
        _tree(data["frames"], set(data["kinematic_configs"])),
        [ELEMENTS[entry["type"]](entry) for entry in entries],
        dynamic=data["dynamic_configs"],
        kinematic=data["kinematic_configs"],
        inputs=data["inputs"],
    )
    return Case(mechanism, arrays, waiting)


def _tree(frames: list[dict[str, Any]], kinematic: set[str]) -> Branch:
    places: dict[str, Branch] = {}
    for frame in frames:
        name, transform = frame["name"], frame["transform"]
        if transform == "world":
            places[name] = world(name)
            continue
        options: dict[str, Any] = {"name": name}
        if "mass" in frame:
            # The random cases take their moments from a range, not from bodies.
            body = Body(frame["mass"], inertia=frame.get("inertia"), allow_nonphysical=True)
            options["bodies"] = [body]
        parent = places[frame["parent"]]
        if transform == "const":
            places[name] = parent.pose(frame["matrix"], **options)
        elif "config" in frame:
            config = frame["config"]
            chain = getattr(parent, transform)
            places[name] = chain(config, kinematic=config in kinematic, **options)
        else:
            places[name] = getattr(parent, transform)(frame["value"], **options)
    return next(iter(places.values())).root
