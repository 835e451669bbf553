"""What a motion of the marionette has to keep to."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism, MidpointVI
from leastaction.models.marionette import JOINT_LIMITS, heading, strings_of
from leastaction.models.puppet_controls import ends_of
from leastaction.numerics import Array, restore_state, saved_state
from leastaction.optimal import Bound, Limit, PricedLimit, PricedLimits, QuadraticCost
from leastaction.systems import MidpointSystem

KINDS: Final = ("tension", "joints", "speed", "acceleration", "reach")
"""The kinds of limits."""

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

    def of(
        self, mechanism: Mechanism, pelvis: Array, kinds: Collection[str] = KINDS, *, free_start: bool | None = None
    ) -> list[Limit]:
        """Return limits of a marionette, by lengths or by tensions.

        ``pelvis`` (N+1, 3): what `pelvis_of` says. ``kinds``: which of `KINDS`. ``free_start``: whether they hold at
        the start too; if not given, by tensions, where that is free.
        """
        ends = ends_of(mechanism)
        by_tension = not mechanism.constraints
        skip = 0 if (by_tension if free_start is None else free_start) else 1
        places, strings = (*ends.x, *ends.y, *ends.z), [s.name for s in strings_of(mechanism)]
        strength = np.full(len(pelvis) - 1, self.strength)
        strength[0] *= 1.0 if by_tension else 0.5  # the first impulse of a constraint is that of half a step
        wanted = pelvis[skip:].T
        by_kind: dict[str, list[tuple[Sequence[str], Array | float, Array | float, str]]] = {
            "tension": [(strings, self.tension, strength, "input" if by_tension else "tension")],
            "joints": [((name,), *angles, "variable") for name, angles in self.joints_of(mechanism).items()],
            # A rate over a step is part of the next state.
            "speed": [
                ([f"v_{name}" for name in names], -most, most, "state")
                for names, most in ((places, self.speed), (ends.angles, self.turn_speed))
            ],
            "acceleration": [
                (names, -most, most, "acceleration")
                for names, most in ((places, self.acceleration), (ends.angles, self.turn_acceleration))
            ],
            "reach": [
                (ends.x, wanted[0] - self.reach, wanted[0] + self.reach, "variable"),
                (ends.y, wanted[1] - self.reach, wanted[1] + self.reach, "variable"),
                (ends.headings, wanted[2] - self.turn, wanted[2] + self.turn, "variable"),
                (ends.z, -self.lift, self.lift, "variable"),
                (ends.tilts, -self.tilt, self.tilt, "variable"),
            ],
        }
        return [
            Bound(names, least, most, of=what)
            for kind in KINDS
            if kind in kinds
            for names, least, most, what in by_kind[kind]
            if names and (np.isfinite(least).any() or np.isfinite(most).any())
        ]

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
        m = mechanism
        system = MidpointSystem(MidpointVI(m), t, multipliers=bool(m.constraints))
        u = np.hstack([np.zeros((system.N, m.n_inputs)), x[1:, m.first_rho : m.nq]])
        none = QuadraticCost(x, u, Q=np.zeros(system.ndx), R=np.ones(system.nu), space=system.space)

        def off(kind: str) -> float:
            own = self.loosened(_TOLERANCE).of(m, pelvis, {kind}, free_start=False)
            return PricedLimits(none, system, [PricedLimit(limit, 1.0) for limit in own]).off(x, u)

        return frozenset(kind for kind in KINDS if kind != "tension" and off(kind) > 0.0)


def pelvis_of(mechanism: Mechanism, reference: Array) -> Array:
    """Return where a reference (N+1, nq) wants the pelvis over the ground (m), and how it faces (rad): (N+1, 3)."""
    place = reference[:, [mechanism.coordinates.index(name) for name in ("torso_tx", "torso_ty")]]
    return np.column_stack([place, heading(mechanism, reference)])
