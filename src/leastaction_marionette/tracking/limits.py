"""What a motion of the marionette has to keep to."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.models.marionette import JOINT_LIMITS, heading, strings_of
from leastaction.models.puppet_controls import ends_of
from leastaction.numerics import Array, restore_state, saved_state
from leastaction.optimal import Bound, Limit

KINDS: Final = ("tension", "joints", "speed", "acceleration", "reach")
"""The kinds of limits, of which those are stated that a motion would break."""

FIRST_KINDS: Final = frozenset({"tension", "joints"})
"""Those of any plan."""

_TOLERANCE: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class PuppetLimits:
    """Limits on strings, joints, and the hands or machines that move the strings' upper ends, or bars with them.

    Attributes
    ----------
    tension : float
        Least tension of every string at every instant (N). 0 or more: strings pull.
    strength : float
        Most tension of every string at every instant (N): with more it breaks; infinite for none.
    joints : mapping of name to (float, float)
        Least and largest angles (rad).
    speed, acceleration : float
        Largest of the upper ends, or middles of bars, along x, y and z (m/s, m/s^2); infinite for none.
    reach : float
        How far these may be from above the wanted place of the pelvis, along x and along y (m).
    lift : float
        How far the middle of a bar may be above and below the plane of the hands (m).
    tilt : float
        How far a bar may be turned about y, and about x, from level (rad); less than a right angle.
    turn : float
        How far it may be turned about the vertical from where the pelvis is wanted to face (rad).
    turn_speed, turn_acceleration : float
        Largest of a bar's turns about each axis (rad/s, rad/s^2); infinite for none.
    """

    tension: float = 0.5
    strength: float = math.inf
    joints: Mapping[str, tuple[float, float]] = field(default_factory=lambda: JOINT_LIMITS)
    speed: float = 8.0
    acceleration: float = 150.0
    reach: float = 2.0
    lift: float = 0.5
    tilt: float = math.radians(57.0)
    turn: float = math.radians(86.0)
    turn_speed: float = 12.0
    turn_acceleration: float = 300.0

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        if not (np.isfinite(self.tension) and self.tension >= 0.0):
            raise ArgumentError(f"limits: tension is {self.tension}, expected a finite number >= 0 (N): strings pull")
        if not self.strength > self.tension:
            raise ArgumentError(
                f"limits: strength is {self.strength}, expected more than the least tension, {self.tension} (N)"
            )
        for name in ("speed", "acceleration", "reach", "lift", "turn", "turn_speed", "turn_acceleration"):
            if not getattr(self, name) > 0.0:
                raise ArgumentError(f"limits: {name} is {getattr(self, name)}, expected a number > 0")
        if not 0.0 < self.tilt < 0.5 * np.pi:
            raise ArgumentError(f"limits: tilt is {self.tilt}, expected more than 0 and less than a right angle (rad)")
        for name, (least, most) in self.joints.items():
            if not least < most:
                raise ArgumentError(f"limits: {name} is to stay between {least} and {most}, expected the least first")

    def of(self, mechanism: Mechanism, pelvis: Array, kinds: Collection[str]) -> list[Limit]:
        """Return limits of a marionette, by lengths or by tensions.

        ``pelvis`` (N+1, 3): what `pelvis_of` says. ``kinds``: which of `KINDS`.
        """
        ends = ends_of(mechanism)
        skip = 1 if mechanism.constraints else 0  # by tensions the start is free, and limits hold there too
        by_kind: dict[str, list[Limit]] = {
            "tension": [self._of_tensions(mechanism, len(pelvis) - 1)],
            "joints": [Bound(name, *angles, of="variable") for name, angles in self.joints_of(mechanism).items()],
            # A rate over a step is part of the next state.
            "speed": [
                Bound([f"v_{name}" for name in names], -most, most, of="state")
                for names, most in (((*ends.x, *ends.y, *ends.z), self.speed), (ends.angles, self.turn_speed))
                if names
            ],
            "acceleration": [
                Bound(names, -most, most, of="acceleration")
                for names, most in (
                    ((*ends.x, *ends.y, *ends.z), self.acceleration),
                    (ends.angles, self.turn_acceleration),
                )
                if names
            ],
            "reach": [
                *(
                    Bound(names, place - most, place + most, of="variable")
                    for names, place, most in zip(
                        (ends.x, ends.y, ends.headings),
                        pelvis[skip:].T,
                        (self.reach, self.reach, self.turn),
                        strict=True,
                    )
                    if names
                ),
                *(
                    Bound(names, -most, most, of="variable")
                    for names, most in ((ends.z, self.lift), (ends.tilts, self.tilt))
                    if names
                ),
            ],
        }
        return [limit for kind in KINDS if kind in kinds for limit in by_kind[kind]]

    def _of_tensions(self, mechanism: Mechanism, steps: int) -> Limit:
        """Return the limit of the tensions in a number of steps, by constraints or by inputs."""
        names, most = [s.name for s in strings_of(mechanism)], np.full(steps, self.strength)
        if not mechanism.constraints:
            return Bound(names, self.tension, self.strength, of="input")
        # The first impulse of a constraint is that of half a step; the least is stated as it is there too.
        most[0] *= 0.5
        return Bound(names, self.tension, most, of="tension")

    def joints_of(self, mechanism: Mechanism) -> dict[str, tuple[float, float]]:
        """Return the least and largest angles of those joints that a mechanism has: ball joints need none."""
        return {name: angles for name, angles in self.joints.items() if name in mechanism.coordinates}

    def keep(self, tension: Array, share: float = 0.0) -> bool:
        """Return whether tensions (N) keep to their limits, but for a share of these."""
        least, most = (1.0 - share) * self.tension, (1.0 + share) * self.strength
        return bool(tension.min() >= least and tension.max() <= most)

    def loosened(self, share: float) -> PuppetLimits:
        """Return limits wider by a share of each; angles of joints by a share of a radian; tensions as they are."""
        more = 1.0 + share
        return replace(
            self,
            joints={name: (least - share, most + share) for name, (least, most) in self.joints.items()},
            tilt=min(more * self.tilt, 0.5 * np.pi * (1.0 - 1e-9)),
            **{
                name: more * getattr(self, name)
                for name in ("speed", "acceleration", "reach", "lift", "turn", "turn_speed", "turn_acceleration")
            },
        )

    def broken(self, mechanism: Mechanism, t: Array, pelvis: Array, x: Array) -> frozenset[str]:
        """Return which kinds of limits a motion x (N+1, nx) does not keep to, besides that of the tensions."""
        m, ends = mechanism, ends_of(mechanism)
        found = set()
        for name, (least, most) in self.joints_of(m).items():
            angle = x[1:, m.coordinates.index(name)]
            if angle.min() < least - _TOLERANCE or angle.max() > most + _TOLERANCE:
                found.add("joints")
        dt = float(t[1] - t[0])

        def away(names: tuple[str, ...], wanted: Array | float, reach: float) -> None:
            place = x[:, [m.coordinates.index(name) for name in names]]
            if np.abs(place - wanted)[1:].max(initial=0.0) > reach + _TOLERANCE:
                found.add("reach")

        def fast(names: tuple[str, ...], most_speed: float, most: float) -> None:
            place = x[:, [m.coordinates.index(name) for name in names]]
            speed = np.diff(place, axis=0, prepend=place[:1]) / dt
            if np.abs(speed).max(initial=0.0) > most_speed * (1.0 + _TOLERANCE):
                found.add("speed")
            if np.abs(np.diff(speed, axis=0)).max(initial=0.0) / dt > most * (1.0 + _TOLERANCE):
                found.add("acceleration")

        away(ends.x, pelvis[:, :1], self.reach)
        away(ends.y, pelvis[:, 1:2], self.reach)
        away(ends.headings, pelvis[:, 2:], self.turn)
        away(ends.z, 0.0, self.lift)
        away(ends.tilts, 0.0, self.tilt)
        fast((*ends.x, *ends.y, *ends.z), self.speed, self.acceleration)
        fast(ends.angles, self.turn_speed, self.turn_acceleration)
        return frozenset(found)


def pelvis_of(mechanism: Mechanism, reference: Array) -> Array:
    """Return where a reference (N+1, nq) wants the pelvis over the ground (m), and how it faces (rad): (N+1, 3)."""
    place = reference[:, [mechanism.coordinates.index(name) for name in ("torso_tx", "torso_ty")]]
    return np.column_stack([place, heading(mechanism, reference)])
