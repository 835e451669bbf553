"""What elements of a mechanism look like along a motion: cords with their tensions, and forces as arrows."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from leastaction.mechanics import Mechanism
from leastaction.mechanics.elements.looks import Push
from leastaction.mechanics.mechanism.trajectory import BaseTrajectory
from leastaction.numerics.arrays import Array
from leastaction.viz.scene import Arrow, Cord


def cords_of(mechanism: Mechanism) -> list[Cord]:
    """Return the strings, springs, dampers and motors of a mechanism; one that has several lines numbers them."""
    found = []
    for name, element in mechanism.elements.items():
        for i, look in enumerate(element.looks):
            first, *via, last = look.frames
            called = name if i == 0 else f"{name} {i + 1}"
            found.append(Cord(name=called, start=first, end=last, via=tuple(via), kind=look.kind))
    return found


class Actions:
    """Tensions and forces along a motion, at any times.

    What is known of a step is the force in its middle, and is brought to the times on straight lines; a multiplier of
    discrete time is an impulse, and is divided by the length of its step.

    ``run``: the motion. ``t`` (n,), ``q`` (n, nq): the times, and the configurations then.
    """

    def __init__(self, run: BaseTrajectory[Any], t: Array, q: Array) -> None:
        self.m, self.t, self.q = run.mechanism, t, q
        self._own = run.t
        steps = np.diff(run.t)[:, None] if len(run.lam) < len(run.t) else 1.0
        self.inputs = dict(zip(self.m.inputs, self._at_instants(run.inputs).T, strict=True))
        self.lam = dict(zip(self.m.constraints, self._at_instants(run.lam / steps).T, strict=True))

    def _at_instants(self, values: Array) -> Array:
        """Return values of each step, or at the run's instants, at the times."""
        own = self._own if len(values) == len(self._own) else 0.5 * (self._own[1:] + self._own[:-1])
        if not len(own):  # a run whose first step could not be made: nothing acts that is known
            return np.zeros((len(self.t), values.shape[1]))
        columns = [np.interp(self.t, own, column) for column in values.T]
        return np.array(columns).reshape(values.shape[1], len(self.t)).T

    def tension(self) -> dict[str, Array]:
        """Return the tension (N+1,) of every cord of which it is known, by its name."""
        found: dict[str, Array] = {}
        values = {**dict(zip(self.m.coordinates, self.q.T, strict=True)), **self.inputs}
        for name, element in self.m.elements.items():
            if not element.looks:
                continue
            if name in self.lam:
                pull = element.tension(self.lam[name], np.ones(len(self.t)), values)
            else:
                places = self.m.positions(self.q, list(element.looks[0].frames))
                length = np.linalg.norm(np.diff(places, axis=1), axis=2).sum(axis=1)
                pull = element.pull(length, self._rate(length), values)
            if pull is not None:
                found[name] = np.broadcast_to(pull, self.t.shape).astype(float)
        return found

    def _rate(self, length: Array) -> Array:
        return np.gradient(length, self.t) if len(self.t) > 1 else np.zeros(1)

    def arrows(self) -> list[Arrow]:
        """Return the forces and torques of inputs, and the reactions of constraints, in world axes."""
        found: list[Arrow] = []
        for name, element in self.m.elements.items():
            for push in element.pushes:
                found += self._of_joints(name, push) if push.joint else [self._of_frame(name, push, element.equations)]
        return [arrow for arrow in found if arrow.vector.any()]

    def _sum(self, name: str, push: Push, equations: tuple[str, ...] = ()) -> Array:
        total = np.zeros((len(self.t), 3))
        for direction, source in push.terms:
            if not isinstance(source, str):
                value: Array | float = source
            else:
                value = self.lam[name + source] if source in equations else self.inputs[source]
            total += np.multiply.outer(np.broadcast_to(value, self.t.shape), np.array(direction))
        return total

    def _of_frame(self, name: str, push: Push, equations: tuple[str, ...]) -> Arrow:
        vector = self._sum(name, push, equations)
        if push.axes is not None:
            vector = np.einsum("nij,nj->ni", self.m.frame_pose(self.q, push.axes)[:, :3, :3], vector)
        kind: Literal["force", "torque", "reaction"] = (
            "reaction" if equations else "torque" if push.turning else "force"
        )
        return Arrow(name=name, kind=kind, place=self.m.positions(self.q, [push.on])[:, 0], vector=vector)

    def _of_joints(self, name: str, push: Push) -> list[Arrow]:
        """Return the arrows along the axes of all joints that a variable moves."""
        size = self._sum(name, push)[:, 0]
        found = []
        for joint in self.m.tree.joints:
            if push.on in joint.variables:
                factor = dict(joint.coordinate.terms)[push.on]
                v, w = joint.twist[:3], joint.twist[3:]
                pose = self.m.frame_pose(self.q, self.m.tree.frames[joint.frame].name)
                point = np.cross(w, v) / (w @ w) if w.any() else np.zeros(3)
                axis = pose[:, :3, :3] @ (np.sign(factor) * (w if w.any() else v))
                place = pose[:, :3, :3] @ point + pose[:, :3, 3]
                kind: Literal["force", "torque"] = "torque" if w.any() else "force"
                found.append(Arrow(name=name, kind=kind, place=place, vector=size[:, None] * axis))
        return found
