"""MuJoCo's muscles as forces along tendons: force by length and velocity, and what a stretched muscle does by itself.

With the length L and the velocity V of the muscle in units of its optimal length L0 (and of L0 ``vmax`` a second), it
pulls with ``F (FL(L) FV(V) u + FP(L))``. All three are polynomials by pieces, taken over as such: those of MuJoCo's
`mju_muscleGain` and `mju_muscleBias`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf.scalars import Along
from leastaction.io.mechanisms.model import LeftOut
from leastaction.io.mechanisms.names import Names
from leastaction.mechanics import Coupling, Curve, Mechanism, NonlinearSpring, PathLength, TendonForce
from leastaction.mechanics.elements import Element
from leastaction.numerics.arrays import Array

Bare = Callable[[Sequence[Element]], Mechanism]
"""Makes the mechanism of the file with some elements alone, and the armatures of its joints."""

SAMPLES = 2000


@dataclass(frozen=True)
class MusclePart:
    """The numbers of a muscle: ``range`` of lengths (in L0), ``force`` (N), limits of its curves."""

    range: tuple[float, float]
    force: float
    scale: float
    lmin: float
    lmax: float
    vmax: float
    fpmax: float
    fvmax: float

    @classmethod
    def of(cls, parameters: Sequence[float]) -> MusclePart:
        """Return a muscle from the parameters of its gain or bias."""
        low, high, *rest = map(float, parameters[:9])
        return cls((low, high), *rest)


def muscle(
    actuator: Any, name: str, along: Along, input_: str, names: Names, bare: Bare, left_out: list[LeftOut]
) -> Iterator[Element]:
    """Yield the forces of a muscle; ``along``: its length, as the actuator counts it."""
    part = MusclePart.of(actuator.gainprm)
    low, high = map(float, actuator.lengthrange)
    if low == high:
        low, high = _range_of(along, names, bare)
        if high - low <= 1e-9 * abs(high):
            why = f"its tendon has {low:.4g} m wherever its joints are within their limits; it needs a lengthrange"
            left_out.append(LeftOut(f"actuator {name!r}", why))
            return
        why = f"it is found by {SAMPLES} samples of the joints' limits: {low:.4g} to {high:.4g} m"
        left_out.append(LeftOut(f"lengthrange of the actuator {name!r}", why))
    force = part.force
    if force < 0.0:
        force = part.scale / _acceleration(along, names, bare)
    optimal = (high - low) / (part.range[1] - part.range[0])
    rest = low - part.range[0] * optimal  # length at which L is zero
    yield TendonForce(
        along.scalar,
        input_,
        force,
        _scaled(*_by_length(part), optimal, rest),
        _scaled(*_by_velocity(part), optimal * part.vmax, 0.0),
        name=f"muscle.{name}",
    )
    passive = MusclePart.of(actuator.biasprm)
    if passive.fpmax > 0.0:
        size = force if passive.force < 0.0 else passive.force
        yield NonlinearSpring(along.scalar, _scaled(*_passive(passive, size), optimal, rest), name=f"passive.{name}")


def _by_length(p: MusclePart) -> tuple[list[float], list[list[float]]]:
    """FL: four parabolas from ``lmin`` over 1 to ``lmax``, and zero outside."""
    a, b = (p.lmin + 1.0) / 2.0, (p.lmax + 1.0) / 2.0
    breaks = [p.lmin - 1.0, p.lmin, a, 1.0, b, p.lmax, p.lmax + 1.0]
    rise, fall = 1.0 / (1.0 - a), 1.0 / (b - 1.0)
    first, last = 1.0 / (a - p.lmin), 1.0 / (p.lmax - b)
    return breaks, [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5 * first**2],
        [0.5, rise, -0.5 * rise**2],  # 1 - x^2/2 with x = 1 - (L - a) rise
        [1.0, 0.0, -0.5 * fall**2],
        [0.5, -last, 0.5 * last**2],  # x^2/2 with x = 1 - (L - b) last
        [0.0, 0.0, 0.0],
    ]


def _by_velocity(p: MusclePart) -> tuple[list[float], list[list[float]]]:
    """FV: zero while it shortens too fast, 1 at rest, ``fvmax`` while it is stretched fast."""
    y = p.fvmax - 1.0
    breaks, pieces = [-2.0, -1.0, 0.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    if y > 0.0:
        breaks.append(y)
        pieces.append([p.fvmax - y, 2.0, -1.0 / y])
    return [*breaks, breaks[-1] + 1.0], [*pieces, [p.fvmax, 0.0, 0.0]]


def _passive(p: MusclePart, force: float) -> tuple[list[float], list[list[float]]]:
    """FP: nothing up to 1, then a parabola, then a line."""
    b = (p.lmax + 1.0) / 2.0
    size, width = force * p.fpmax, b - 1.0
    return [0.0, 1.0, b, b + 1.0], [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5 * size / width**2],
        [0.5 * size, size / width, 0.0],
    ]


def _scaled(breaks: list[float], pieces: list[list[float]], unit: float, start: float) -> Curve:
    """Return a curve of ``(x - start) / unit`` as one of x."""
    powers = unit ** -np.arange(len(pieces[0]), dtype=float)
    return Curve.from_pieces(start + unit * np.array(breaks), np.array(pieces) * powers)


def _measured(along: Along, bare: Bare) -> Mechanism:
    terms: Any = along.terms
    held = PathLength(terms, 1.0, name="length") if along.of_paths else Coupling(terms, 1.0, name="length")
    return bare([held])


def _range_of(along: Along, names: Names, bare: Bare) -> tuple[float, float]:
    """Return the least and the largest length within the limits of the joints that change it."""
    m = _measured(along, bare)
    q = np.tile(_reference(m, names), (SAMPLES, 1))
    rng = np.random.default_rng(0)
    for name in along.movers & names.values.keys():
        value, (low, high) = names.values[name], names.joints[name].range
        if value.plain and low is not None and high is not None:
            share = rng.uniform(-0.2, 1.2, SAMPLES).clip(0.0, 1.0)  # many of them at the limits
            q[:, m.coordinates.index(value.names[0])] = low + (high - low) * share
    lengths = np.asarray(m.constraint_residuals(q)["length"]) + 1.0
    return float(lengths.min()), float(lengths.max())


def _acceleration(along: Along, names: Names, bare: Bare) -> float:
    """Return the size of the accelerations that a tension of 1 N causes at the reference."""
    return float(np.linalg.norm(_response(along, names, bare)[1]))


def inertia_along(along: Along, names: Names, bare: Bare) -> float:
    """Return what a force along the scalar moves at the reference."""
    slopes, accelerations = _response(along, names, bare)
    return float(1.0 / (slopes @ accelerations))


def _response(along: Along, names: Names, bare: Bare) -> tuple[Array, Array]:
    """Return the slopes of the scalar, and the accelerations by a force of one along it."""
    m = _measured(along, bare)
    q = _reference(m, names)
    slopes = m.constraint_jacobian(q)[0, : m.nd]
    accelerations: Array = np.asarray(np.linalg.solve(m.mass_matrix(q)[: m.nd, : m.nd], slopes), dtype=np.float64)
    return slopes, accelerations


def slack_length(along: Along, names: Names, bare: Bare) -> float:
    """Return the length where the springs of all joints are slack, which a tendon's own has by default."""
    own = {n: names.joints[n].rest for n in names.values if n in names.joints and names.is_own(n)}
    if not along.of_paths:
        return along.offset + sum(factor * own[str(name)] for name, factor in along.terms.items())
    m = _measured(along, bare)
    return 1.0 + float(m.constraint_residuals(m.configuration(own))["length"])


def _reference(m: Mechanism, names: Names) -> Array:
    """Return the configuration in which the file draws it, ball and free joints at zero."""
    own = {n: names.joints[n].reference for n in names.values if n in names.joints and names.is_own(n)}
    return np.asarray(m.configuration(own))
