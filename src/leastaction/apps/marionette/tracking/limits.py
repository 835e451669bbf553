"""What a motion of the marionette has to keep to."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import JOINT_LIMITS, strings_of
from leastaction.numerics.arrays import Array
from leastaction.optimal import Bound, Limit

KINDS: Final = ("tension", "joints", "speed", "acceleration", "reach")
"""The kinds of limits, of which those are stated that a motion would break."""

_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class PuppetLimits:
    """Limits on strings, joints, and the hands or machines that move the strings' upper ends.

    Attributes
    ----------
    tension : float
        Least tension of every string at every instant (N). 0 or more: strings pull.
    joints : mapping of name to (float, float)
        Least and largest angles (rad).
    speed, acceleration : float
        Largest of the upper ends along x and along y (m/s, m/s^2); infinite for none.
    reach : float
        How far the upper ends may be from above the wanted place of the pelvis, along x and along y (m).
    """

    tension: float = 0.5
    joints: Mapping[str, tuple[float, float]] = field(default_factory=lambda: JOINT_LIMITS)
    speed: float = 8.0
    acceleration: float = 150.0
    reach: float = 2.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.tension) and self.tension >= 0.0):
            raise ArgumentError(f"limits: tension is {self.tension}, expected a finite number >= 0 (N): strings pull")
        for name in ("speed", "acceleration", "reach"):
            if not getattr(self, name) > 0.0:
                raise ArgumentError(f"limits: {name} is {getattr(self, name)}, expected a number > 0")
        for name, (least, most) in self.joints.items():
            if not least < most:
                raise ArgumentError(f"limits: {name} is to stay between {least} and {most}, expected the least first")

    def of(self, mechanism: Mechanism, pelvis: Array, kinds: Collection[str]) -> list[Limit]:
        """Return limits of a marionette, by lengths or by tensions.

        ``pelvis`` (N+1, 2): the wanted place over the ground. ``kinds``: which of `KINDS`.
        """
        strings = strings_of(mechanism)
        x, y = [s.x for s in strings], [s.y for s in strings]
        most = self.acceleration
        skip = 1 if mechanism.constraints else 0  # by tensions the start is free, and limits hold there too
        by_kind: dict[str, list[Limit]] = {
            "tension": [
                Bound([s.name for s in strings], min=self.tension, of="tension" if mechanism.constraints else "input")
            ],
            "joints": [Bound(name, least, most, of="variable") for name, (least, most) in self.joints.items()],
            # A rate over a step is part of the next state.
            "speed": [Bound([f"v_{name}" for name in (*x, *y)], -self.speed, self.speed, of="state")],
            "acceleration": [Bound([*x, *y], -most, most, of="acceleration")],
            "reach": [
                Bound(names, place - self.reach, place + self.reach, of="variable")
                for names, place in ((x, pelvis[skip:, 0]), (y, pelvis[skip:, 1]))
            ],
        }
        return [limit for kind in KINDS if kind in kinds for limit in by_kind[kind]]

    def broken(self, mechanism: Mechanism, t: Array, pelvis: Array, x: Array) -> frozenset[str]:
        """Return which kinds of limits a motion x (N+1, nx) does not keep to, besides that of the tensions."""
        m = mechanism
        found = set()
        for name, (least, most) in self.joints.items():
            angle = x[1:, m.variables.index(name)]
            if angle.min() < least - _TOLERANCE or angle.max() > most + _TOLERANCE:
                found.add("joints")
        dt = float(t[1] - t[0])
        for axis, ends in enumerate(zip(*((s.x, s.y) for s in strings_of(m)), strict=True)):
            place = x[:, [m.variables.index(name) for name in ends]]
            speed = np.diff(place, axis=0, prepend=place[:1]) / dt
            if np.abs(place - pelvis[:, axis, None])[1:].max() > self.reach + _TOLERANCE:
                found.add("reach")
            if np.abs(speed).max() > self.speed * (1.0 + _TOLERANCE):
                found.add("speed")
            if np.abs(np.diff(speed, axis=0)).max() / dt > self.acceleration * (1.0 + _TOLERANCE):
                found.add("acceleration")
        return frozenset(found)
