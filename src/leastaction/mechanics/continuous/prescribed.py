"""What is prescribed in a simulation in continuous time: a curve of kinematic coordinates with two derivatives.

A rotation that is a quaternion is prescribed as a curve of four numbers q, whose length is without effect: with
``s = q^-1 q'`` its angular velocity is ``w = 2 vec s``, and ``w' = 2 vec(q^-1 q'' - s s)``, in the axes of the body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.mechanism.arguments import unit_quaternions
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import prescribed_rotations, turns_for_quaternions
from leastaction.numerics.arrays import Array, as_array, as_count, as_times
from leastaction.numerics.public import public
from leastaction.numerics.rotations import body_accelerations, body_rates, continued

_AGREE = 1e-6  # by how much a start may be off a prescribed motion, relative to its size (at least 1)
_LEAST = 0.1  # length of a quaternion on a curve: a shorter one is on its way from q to -q


@public
@dataclass(frozen=True)
class PrescribedMotion:
    """A twice differentiable motion of the kinematic variables.

    Frozen: threads may share it where they may share its functions.

    Attributes
    ----------
    value, velocity, acceleration : callable
        Functions of time that return arrays (nq - first_rho,): the kinematic coordinates (m or rad), and their first
        and second derivatives by time. Of a rotation that is a quaternion these are its four numbers, scalar first,
        along a smooth curve on one side (never a leap from q to -q), and what they change by; their length says
        nothing. Its angular velocity w in the body's own axes makes them ``q' = q (0, w) / 2``.
    """

    value: Callable[[float], ArrayLike]
    velocity: Callable[[float], ArrayLike]
    acceleration: Callable[[float], ArrayLike]

    @classmethod
    def from_spline(cls, spline: Any) -> PrescribedMotion:
        """Return a motion along a spline of SciPy, or anything else with ``derivative(order)``."""
        if not callable(spline) or not callable(getattr(spline, "derivative", None)):
            raise ArgumentError(
                f"spline: got {type(spline).__name__}, expected a spline, with a method derivative(order)"
            )
        return cls(spline, spline.derivative(1), spline.derivative(2))

    @classmethod
    def through(cls, t: ArrayLike, rho: ArrayLike, *, degree: int = 5) -> PrescribedMotion:
        """Return the interpolating spline through rows of kinematic variables.

        Parameters
        ----------
        t : array_like, shape (N+1,)
            Times (s), increasing.
        rho : array_like, shape (N+1, nq - first_rho)
            Kinematic coordinates at these times (m or rad). Of quaternions q and -q, which are the same rotation, the
            one that is nearer to the row before.
        degree : int, optional
            Degree of the spline, 3 or 5; cubic, and through two or three rows a line or a parabola, where there
            are too few rows for more.
        """
        times = as_times(t)
        if as_count(degree, "degree", 3) not in (3, 5):
            raise ArgumentError(f"degree: got {degree!r}, expected 3 or 5")
        rows = as_array(rho, "rho", (len(times), None))
        enough = degree == 5 and len(times) > 5
        from scipy.interpolate import CubicSpline, make_interp_spline  # slow to import

        spline = make_interp_spline(times, rows, k=5) if enough else CubicSpline(times, rows)
        return cls.from_spline(spline)


class Prescribed:
    """A prescribed motion of one mechanism's kinematic variables. It holds no state.

    ``motion``: the curve of its kinematic coordinates.
    """

    def __init__(self, mechanism: Mechanism, motion: PrescribedMotion) -> None:
        self.mechanism, self.motion = mechanism, motion
        self.names = mechanism.coordinates[mechanism.first_rho :]
        self.rotations = prescribed_rotations(mechanism)

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the coordinates (nq - first_rho,), quaternions of unit length, and the velocities (nrho,)."""
        places, rates = self._value(t), self._velocity(t)
        if not self.rotations:
            return places, rates
        places, v = places.copy(), turns_for_quaternions(self.mechanism, rates)
        for rotation, place, turn in self.rotations:
            q, length = places[place : place + 4], float(np.linalg.norm(places[place : place + 4]))
            if not length > _LEAST:
                raise ArgumentError(
                    f"rho({t:g}): the quaternion of {rotation.name!r} has the length {length:.3g}, expected about 1 "
                    "all along; q and -q are the same rotation, but a curve must stay with one of them"
                )
            v[turn : turn + 3] = body_rates(q, rates[place : place + 4])
            places[place : place + 4] = q / length
        return places, v

    def acceleration(self, t: float) -> Array:
        """Return the accelerations (nrho,)."""
        bent = self._checked(self.motion.acceleration(t), f"the acceleration of rho({t:g})")
        if not self.rotations:
            return bent
        places, rates, a = self._value(t), self._velocity(t), turns_for_quaternions(self.mechanism, bent)
        for _, place, turn in self.rotations:
            here = slice(place, place + 4)
            a[turn : turn + 3] = body_accelerations(places[here], rates[here], bent[here])
        return a

    def start(self, q: Array, v: Array, t: float, *, at_rest: bool) -> tuple[Array, Array]:
        """Return a start on the motion; `ArgumentError` unless it was there. ``at_rest``: no velocity was given."""
        m = self.mechanism
        places, v_rho = self.at(t)
        there = np.concatenate([q[: m.first_rho], places])
        for _, place, _ in self.rotations:
            here = slice(m.first_rho + place, m.first_rho + place + 4)
            there[here] = continued(np.stack([q[here], there[here]]))[1]
        _agree(q[m.first_rho :], there[m.first_rho :], self.names, "q0")
        if not at_rest:
            _agree(v[m.nd :], v_rho, m.kinematic, "v0")
        return there, np.concatenate([v[: m.nd], v_rho])

    def _value(self, t: float) -> Array:
        return self._checked(self.motion.value(t), f"rho({t:g})")

    def _velocity(self, t: float) -> Array:
        return self._checked(self.motion.velocity(t), f"the velocity of rho({t:g})")

    def _checked(self, given: ArrayLike, what: str) -> Array:
        return as_array(given, what, (len(self.names),), names=self.names)


def as_prescribed(m: Mechanism, rho: object, times: Array, rest: Callable[[], Array]) -> Prescribed:
    """Return the prescribed motion that a user gives as one, as a spline, as rows at the instants, or these by name.

    ``rest``: gives the coordinates (nq - first_rho,) of the start, where those stay that have no motion.
    """
    if isinstance(rho, Mapping):
        return Prescribed(m, _put_together(m, rho, times, rest()))
    known = _as_curve(rho, "rho")
    if known is not None:
        return Prescribed(m, known)
    names = m.coordinates[m.first_rho :]
    return through_rows(m, times, as_array(rho, "rho", (len(times), len(names)), names=names))


def _as_curve(rho: object, what: str) -> PrescribedMotion | None:
    """Return what has derivatives by time as a prescribed motion; None for numbers."""
    if isinstance(rho, PrescribedMotion):
        return rho
    if callable(rho) and callable(getattr(rho, "derivative", None)):
        return PrescribedMotion.from_spline(rho)
    if callable(rho):
        raise ArgumentError(
            f"{what}: got the function {rho!r}, which says nothing of its derivatives; give a PrescribedMotion "
            "of value, velocity and acceleration, a spline of SciPy, rows at the instants, or accelerations "
            "as rho_a="
        )
    return None


def _put_together(m: Mechanism, rho: Mapping[str, Any], times: Array, rest: Array) -> PrescribedMotion:
    """Return motions of some coordinates by their names, of rotations by those of their joints; others stay."""
    names = m.coordinates[m.first_rho :]
    places = {name: slice(i, i + 1) for i, name in enumerate(names)}
    balls = {rotation.name: rotation for rotation, _, _ in prescribed_rotations(m)}
    places.update({rotation.name: slice(i, i + 4) for rotation, i, _ in prescribed_rotations(m)})
    held, moves = rest.copy(), list[tuple[slice, PrescribedMotion]]()
    for name, given in rho.items():
        if name not in places:
            raise unknown("name", name, places, "rho")
        here, what = places[name], f"rho[{name!r}]"
        curve = _as_curve(given, what)
        row = () if name not in balls else (4,)
        if curve is None:
            values = as_array(given, what, row, (len(times), *row))
            if values.shape == row:
                held[here] = values
                continue
            rows = values.reshape(len(times), -1)
            if name in balls:
                rows = continued(unit_quaternions(balls[name], rows, what))
            curve = PrescribedMotion.through(times, rows)
        moves.append((here, curve))

    def along(order: str, start: Array) -> Callable[[float], Array]:
        def value(t: float) -> Array:
            whole = start.copy()
            for here, curve in moves:
                whole[here] = getattr(curve, order)(t)
            return whole

        return value

    still = np.zeros(len(names))
    return PrescribedMotion(along("value", held), along("velocity", still), along("acceleration", still))


def through_rows(m: Mechanism, times: Array, rows: Array, *, degree: int = 5) -> Prescribed:
    """Return the motion along a spline through rows (N+1, nq - first_rho), of quaternions either of both signs."""
    rows = rows.copy()
    for rotation, place, _ in prescribed_rotations(m):
        here = slice(place, place + 4)
        rows[:, here] = continued(unit_quaternions(rotation, rows[:, here], "rho"))
    return Prescribed(m, PrescribedMotion.through(times, rows, degree=degree))


def _agree(given: Array, wanted: Array, names: Sequence[str], what: str) -> None:
    """Raise unless a start agrees with a prescribed motion."""
    off = np.abs(given - wanted) / np.maximum(1.0, np.abs(wanted))
    if np.any(off > _AGREE):
        i = int(np.argmax(off))
        raise ArgumentError(
            f"{what}: the start has {names[i]!r} at {given[i]:.6g}, but the prescribed motion has it at "
            f"{wanted[i]:.6g}; they must agree"
        )
