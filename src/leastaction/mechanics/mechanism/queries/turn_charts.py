"""How turns of quaternions come into functions: written once, on jets, for derivatives of any order.

The core has angles a, b, c of turns about x, y, z behind a rotation R, all zero, and their rates. Derivatives are taken
by a turn d in the body, ``R exp(d)``, and by the angular velocity w in its axes (J: cpp/elements/rate_force.hpp)::

    exp(d) = rx(a) ry(b) rz(c),    w = J(a, b, c) (a', b', c')

Of a step from R1 to R2 the middle is ``R1 exp(phi/2)``, where w is ``phi/dt``, and turns alpha and beta of both ends
change it by ``exp(phi) = exp(-alpha) R1^-1 R2 exp(beta)``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.jets import Jet

Jets = Sequence[Jet]


def turned_state(y: Jets) -> Jets:
    """Return the angles, and their rates where there is an angular velocity, by ``y = [d; w]`` or d alone."""
    angles = _angles(_exponential(y[:3]))
    return [*angles, *(_rates(angles, y[3:]) if len(y) > 3 else ())]


def pushed_state(y: Jets, w: Jets) -> Jets:
    """Return the rates that belong to an angular velocity w: how turns count in forces on the angles."""
    return _rates(_angles(_exponential(y[:3])), w)


@dataclass(frozen=True)
class TurnedStep:
    """A step over rotations (n, 4) less than half a turn, whose scalars are positive, in dt (s)."""

    rotations: Array
    dt: float

    def __call__(self, y: Jets) -> Jets:
        """Return the turn of the middle and the angular velocity there, by those of the ends, ``y = [alpha; beta]``."""
        phi, middle = self.moved(y)
        _, before = self.moved([Jet({})] * 6)
        return [*_logarithm(_product(_inverse(before), middle)), *(each * (1.0 / self.dt) for each in phi)]

    def moved(self, y: Jets, start: Jets = (), end: Jets = ()) -> tuple[Jets, Jets]:
        """Return phi, and the rotation from R1 to the middle, where the ends are turned by y, then by more."""
        alpha, beta = (
            _product(_exponential(turn), _exponential(more)) if more else _exponential(turn)
            for turn, more in ((y[:3], start), (y[3:], end))
        )
        across = [Jet({0: each.reshape(-1, 1, 1, 1)}) for each in self.rotations.T]
        turn = _product(_product(_inverse(alpha), across), beta)
        scale = (2.0 + 2.0 * turn[0]).power(-0.5)
        return _logarithm(turn), _product(alpha, [(1.0 + turn[0]) * scale, *(each * scale for each in turn[1:])])


@dataclass(frozen=True)
class PushedStep:
    """How turns of one end of a step, 0 the start or 1 the end, count in forces at the middle, which they turn."""

    step: TurnedStep
    side: int

    def __call__(self, y: Jets, w: Jets) -> Jets:
        """Return what that end turned by w turns the middle by, times dt."""
        mark = 1 << max((key.bit_length() for each in (*y, *w) for key in each.parts), default=0)  # one more direction
        turn = [each * Jet({mark: np.ones(())}) for each in w]
        (_, middle), (_, there) = self.step.moved(y), self.step.moved(y, *((), turn) if self.side else (turn,))
        return [2.0 * self.step.dt * each.along(mark) for each in _product(_inverse(middle), there)[1:]]


# Quaternions, scalar first.


def _product(p: Jets, q: Jets) -> Jets:
    (w, x, y, z), (a, b, c, d) = p, q
    return [
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c + y * a + z * b - x * d,
        w * d + z * a + x * c - y * b,
    ]


def _inverse(q: Jets) -> Jets:
    return [q[0], *(-each for each in q[1:])]


def _exponential(turn: Jets) -> Jets:
    """Return the rotation by a vector that is zero where nothing moves: series in its square to the fourth order."""
    square = sum((each * each for each in turn), Jet({}))
    cosine, sine = (
        [0.5**odd * (-0.25) ** k * factorial(k) / factorial(2 * k + odd) for k in range(3)] for odd in (0, 1)
    )
    scale = square.through(sine)
    return [square.through(cosine), *(each * scale for each in turn)]


def _logarithm(q: Jets) -> Jets:
    """Return the vector of a rotation less than half a turn whose scalar is positive."""
    scale = 2.0 * q[0].through(_angle_by_sine(q[0].value))
    return [each * scale for each in q[1:]]


_SERIES = [np.cumprod([1.0, *((n + 1.0) / (2.0 * n + 3.0) for n in range(27))])]
for _ in range(4):
    _SERIES.append(-np.polynomial.polynomial.polyder(_SERIES[-1]))


def _angle_by_sine(w: Array) -> list[Array]:
    """Return ``A = acos(w)/sqrt(1 - w^2)`` and four derivatives (cpp/elements/rotation_vector.hpp)."""
    x = np.maximum(1.0 - w, 0.0)
    series = [np.polynomial.polynomial.polyval(x, each) for each in _SERIES]
    far = np.minimum(w, 0.8)  # where the series is not as good
    square = (1.0 - far) * (1.0 + far)
    closed = [np.arccos(far) / np.sqrt(square)]
    closed.append((far * closed[0] - 1.0) / square)
    for k in (2, 3, 4):
        closed.append(((2 * k - 1) * far * closed[-1] + (k - 1) ** 2 * closed[-2]) / square)
    return [np.where(x < 0.3, near, other) for near, other in zip(series, closed, strict=True)]


# The chart of a, b and c.


def _angles(q: Jets) -> Jets:
    """Return a, b and c of a rotation that is none where nothing moves."""
    w, x, y, z = q
    a = 2.0 * (w * x - y * z) * (1.0 - 2.0 * (x * x + y * y)).power(-1.0)
    c = 2.0 * (w * z - x * y) * (1.0 - 2.0 * (y * y + z * z)).power(-1.0)
    arctan, arcsin = (0.0, 1.0, 0.0, -2.0, 0.0), (0.0, 1.0, 0.0, 1.0, 0.0)
    return [a.through(arctan), (2.0 * (w * y + x * z)).through(arcsin), c.through(arctan)]


def _rates(angles: Jets, w: Jets) -> Jets:
    """Return a', b' and c' of an angular velocity."""
    sine, cosine = (0.0, 1.0, 0.0, -1.0, 0.0), (1.0, 0.0, -1.0, 0.0, 1.0)
    (s, c), (sz, cz) = ((each.through(sine), each.through(cosine)) for each in angles[1:])
    along = cz * w[0] - sz * w[1]
    a = along * c.power(-1.0)
    return [a, sz * w[0] + cz * w[1], w[2] - s * a]
