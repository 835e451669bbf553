"""Where a simulated ball joint comes near the singularity of its Euler angles.

Let ``d`` be how far the middle angle is from a singular one. The outer and the inner axis enclose that angle,
so an angular velocity ``w`` of the joint takes angle rates up to ``w / sin(d)``, and the least eigenvalue of the
mass matrix of the two angles falls as ``1 - cos(d)``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import SingularityWarning
from leastaction.mechanics.description.tree import BallAngles
from leastaction.numerics.arrays import Array
from leastaction.numerics.warn import warn

# At 0.05 rad (2.9 degrees) the angles turn up to 20 times as fast as the joint: a time step that resolves 20
# steps a radian of motion then takes the angles a radian a step. Well outside, the angles do as well as any.
NEAR = 0.05

# Farther away it depends on the time step. A body that turned by 5 rad/s with steps of 10 ms was off by 2e-3 to
# 6e-3 rad after a second where its outer and inner angle moved by less than 0.15 rad a step, and by 1e-2 to 0.2 rad
# where they moved by more than 0.2 rad, which so near is more than twice as fast as the joint turns.
WIDE = 0.4
FAST = 0.2


class SingularityWatch:
    """Looks at the configurations of a simulation for ball joints near their singularity.

    ``balls``: those of the mechanism; only those are looked at whose singularity matters. ``variables``: names of the
    entries of q.
    """

    def __init__(self, balls: Sequence[BallAngles], variables: Sequence[str]) -> None:
        self.balls = tuple(ball for ball in balls if ball.watched)
        column = {name: index for index, name in enumerate(variables)}
        # The middle angles less the singular ones, in half turns: singular where they are whole numbers.
        self._factors = np.zeros((len(variables), len(self.balls)))
        self._offsets = np.zeros(len(self.balls))
        self._outer, self._inner = np.zeros_like(self._factors), np.zeros_like(self._factors)
        for index, ball in enumerate(self.balls):
            middle = ball.angles[1]
            self._offsets[index] = (middle.offset - ball.singular) / np.pi
            for name, factor in middle.terms:
                self._factors[column[name], index] = factor / np.pi
            for angle, factors in ((ball.angles[0], self._outer), (ball.angles[2], self._inner)):
                for name, factor in angle.terms:
                    factors[column[name], index] = factor

    def look(self, t: Array, q: Array, *, before: Array | None = None) -> tuple[str, ...]:
        """Warn of every ball joint that comes near its singularity or goes through it between two instants.

        Near is where the accuracy suffers: so near that angles are not determined, or farther away where its
        outer and inner angle move too fast for the time step.

        ``t`` (N+1,): times (s); a single one says nothing of the step. ``q`` (N+1, nq): configurations. ``before``
        (nq,): the configuration before the first one, which has been looked at. Returns the warnings. Warns
        `SingularityWarning` once for every joint: its name, its middle angle, and the step and the time when it came
        near.
        """
        if not self.balls:
            return ()
        turns = q @ self._factors + self._offsets
        distance = np.abs(turns - np.rint(turns)) * np.pi
        near = distance < NEAR
        motion = np.diff(q, axis=0, prepend=q[:1] if before is None else before[None, :])
        fast = np.maximum(np.abs(motion @ self._outer), np.abs(motion @ self._inner)) > FAST
        near |= fast & (distance < WIDE)
        # A change of the floor means that a singular angle was passed.
        near[1:] |= np.floor(turns[1:]) != np.floor(turns[:-1])
        if not near.any():
            return ()
        found = []
        for index, ball in enumerate(self.balls):
            if near[:, index].any():
                k = int(np.argmax(near[:, index]))
                step = f"step {k}, " if len(t) > 1 else ""
                found.append(_message(ball, float(turns[k, index]), f"{step}t = {t[k]:.6g} s"))
                warn(found[-1], SingularityWarning)
        return tuple(found)


def _message(ball: BallAngles, turns: float, when: str) -> str:
    outer, middle, inner = ball.angles
    offset = np.degrees(ball.singular)
    return (
        f"the ball joint {ball.name!r} came near the singularity of its angles at {when}: its middle angle "
        f"({middle}) is {180.0 * turns + offset:.2f} degrees there, and at {180.0 * round(turns) + offset:.0f} its "
        f"outer and inner axis are parallel, so that {outer} and {inner} are not determined. Give the joint "
        "other axes= so that its motion stays away from there; a smaller time step helps to pass by"
    )
