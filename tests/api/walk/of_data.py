"""Right calls of classes whose objects are made by the package: each field of an object is put wrong in its turn."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import leastaction as la
from api.walk.scenes import continuous, followed, found, integrator, run, steps
from api.walk.values import Call
from leastaction import optimal, viz


def calls() -> dict[str, Call]:
    """Return a class and the fields of an object of it, by name."""
    played = la.play(steps(), found(), la.Rig(delay=0.0, substeps=1))
    started = optimal.receding_horizon(steps(), _price(), initial=(found().x[0], found().u), window=3, max_iterations=1)
    errors = viz.tracking_errors(np.zeros((6, 2)), np.ones((6, 2)), ["a", "b"])
    mark = viz.JointMark(name="j", kind="hinge", frame="a", point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]))
    made: list[Any] = [
        run(), continuous(), integrator().start([0.3, 0.8]), found(), followed(), played, started, started.stages[0],
        errors, mark,
    ]  # fmt: skip
    return {type(each).__name__: (type(each), fields_of(each)) for each in made}


def fields_of(it: Any) -> dict[str, Any]:
    return {each.name: getattr(it, each.name) for each in dataclasses.fields(it) if each.init}


def _price() -> la.QuadraticCost:
    s = steps()
    return la.QuadraticCost(np.zeros((s.N + 1, s.nx)), np.zeros((s.N, s.nu)), Q=np.ones(s.nx), R=np.eye(s.nu))
