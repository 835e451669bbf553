"""What matters how much when the marionette follows a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError


@dataclass(frozen=True, kw_only=True)
class TrackingWeights:
    """Weights of the tracking cost; each multiplies half the square of an error.

    Attributes
    ----------
    joint : float
        Angle of a joint (1/rad^2).
    unheld : float
        Angle of a joint behind which no string is tied, `UNHELD` (1/rad^2).
    root : float
        Position of the pelvis (1/m^2).
    rate : float
        Velocity of every body variable, measured by its momentum and inertia (s^2/rad^2 or s^2/m^2).
    string : float
        Place of a string's upper end and its length, about the guess that goes with the motion (1/m^2).
    string_acceleration : float
        Acceleration of the same: keeps the hand that holds the strings calm (s^4/m^2).
    tension : float
        Tension of a string about what it bears at rest (1/N^2).
    marker : float
        Where markers are followed: place of the head, a hand, a foot, or the pelvis (1/m^2), in place of `root`.
    posture : float
        There, what `joint` and `unheld` are multiplied by: a little of the wanted pose for what markers leave open.
    """

    joint: float = 1.0
    unheld: float = 1.0
    root: float = 10.0
    rate: float = 1e-4
    string: float = 1e-3
    string_acceleration: float = 1e-6
    tension: float = 1e-5
    marker: float = 30.0
    posture: float = 0.1

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0):
                raise ArgumentError(f"weights: {name} is {value}, expected a finite number >= 0")
        if self.string <= 0.0:
            raise ArgumentError(
                "weights: string is 0, expected a positive weight: without one nothing says where the strings should be"
            )


GENTLE = TrackingWeights()
"""For a motion that the puppet nearly makes by itself: all joints count, the strings go where they like."""

FORCED = TrackingWeights(unheld=0.01, string=0.001, string_acceleration=3e-6)
"""For a motion that it must be made to do: what no string holds may swing."""
