"""Forces that take energy: damping and friction of joints, dampers between frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler, Scalar
from leastaction.mechanics.elements.fields import DYNAMIC_SUM_OR_PATH, END, positive
from leastaction.mechanics.elements.kinds import Kind, Number, Several, Uses
from leastaction.mechanics.elements.scalars import Factors
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

_COEFFICIENT = Number(lambda c: c >= 0.0, "zero or more", "as damping opposes the motion")


@dataclass(frozen=True)
class _Coefficients(Kind):
    """A coefficient for every dynamic variable, or some by name."""

    def read(self, value: object, what: str) -> float | Factors:
        if not isinstance(value, Mapping):
            return _COEFFICIENT.read(value, f"{what}: the coefficient of every variable")
        named = Factors()
        for name, given in value.items():
            check_name(name, f"{what}: a variable's name")
            named[name] = _COEFFICIENT.read(given, f"{what}: the coefficient of {name}")
        return named

    def uses(self, value: float | Factors) -> Uses:
        return Uses(dynamic=tuple(value)) if isinstance(value, Mapping) else Uses()


@public
@dataclass(frozen=True)
class Damping(Force):
    """Linear damping of the dynamic variables: ``f_i = -c_i v_i``.

    Of a joint whose rotation is a quaternion, of its angular velocities, ``"hip.wx"``.

    Parameters
    ----------
    coefficients : float or mapping of str to float
        The coefficient of every dynamic variable, or of those that are named (N s/m or N m s/rad).
    default : float, optional
        The coefficient of the dynamic variables that are not named.

    Raises
    ------
    DescriptionError
        If a coefficient is negative or not finite.

    Notes
    -----
    The parameters are ``"damping.<variable>"``.
    """

    coefficients: float | Mapping[str, float] = field(metadata={"kind": _Coefficients()})
    default: float = field(default=0.0, metadata={"kind": _COEFFICIENT})

    called = "damping"

    def __post_init__(self) -> None:
        one = self.coefficients
        other: Any = self.default  # anything yet: an array is refused by what checks the fields
        if not isinstance(one, Mapping) and not isinstance(other, np.ndarray) and other != 0.0:
            raise DescriptionError(
                f"{self.title}: default: got {self.default!r} together with one coefficient for every "
                "variable; give a mapping of names to coefficients, or leave it out"
            )
        super().__post_init__()
        if not isinstance(self.coefficients, Mapping):
            object.__setattr__(self, "default", self.coefficients)
            object.__setattr__(self, "coefficients", Factors())

    @property
    def named(self) -> Mapping[str, float]:
        """The coefficients that were given by name; `default` holds for the other variables."""
        assert isinstance(self.coefficients, Mapping)
        return self.coefficients

    def describe(self) -> str:
        parts = [f"{name} {value:g}" for name, value in self.named.items()]
        if self.default or not parts:
            parts.append(f"{'others' if parts else 'every dynamic variable'} {self.default:g}")
        return ", ".join(parts)

    def with_number(self, parameter: str, value: float) -> Damping:
        return replace(self, coefficients={**self.named, parameter: value})

    def add_to(self, core: Compiler) -> None:
        for index, name in enumerate(core.context.dynamic):
            # A zero that was written is a parameter; one that was left out is no damping.
            if name in self.named or self.default != 0.0:
                c = self.named.get(name, self.default)
                if name in core.context.turns:
                    core.force_by_rate(name, -1.0, by_rate=core.builder.law("linear", [core.parameter(name, c)]))
                else:
                    core.record(name, core.builder.add_damping(index, c))


@dataclass(frozen=True)
class _OddPowers(Several):
    """The coefficients c1, c3, ... of odd powers; the last is positive."""

    def read(self, value: object, what: str) -> tuple[float, ...]:
        text = isinstance(value, (str, bytes))
        if text or not isinstance(value, Sequence) or not 1 <= len(value) <= 8:
            raise DescriptionError(f"{what}: expected a list of one to eight numbers c1, c3, c5, ..., got {value!r}")
        last = Number(lambda c: c > 0.0, "a positive number", "as the last one opposes fast motion")
        kinds = [Number()] * (len(value) - 1) + [last]
        return tuple(
            kind.read(c, f"{what}: c{2 * i + 1}") for i, (kind, c) in enumerate(zip(kinds, value, strict=True))
        )

    def named(self, field: str, count: int) -> list[str]:
        return [f"c{2 * i + 1}" for i in range(count)]


@public
@dataclass(frozen=True)
class NonlinearDamping(Force):
    """Damping by odd powers of a rate: ``f_i = -(c1 s' + c3 s'^3 + c5 s'^5 + ...) ds/dq_i``.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is: a dynamic variable, a sum of some by their factors, or the length of a path through the origins of
        frames, or of several with a factor each, as in `TendonForce`.
    coefficients : sequence of float
        c1, c3, c5, ... (N s/m, N s^3/m^3, ... or with N m and rad). Some may be negative, as in an oscillator
        that excites itself; the last is positive, so that fast motion is opposed.

    Raises
    ------
    DescriptionError
        If there are no coefficients or more than eight, or the last is not positive.

    Notes
    -----
    The parameters are ``"nonlinear_damping.c1"`` and so on.
    """

    on: Scalar = field(metadata=DYNAMIC_SUM_OR_PATH)
    coefficients: Sequence[float] = field(metadata={"kind": _OddPowers()})

    called = "nonlinear_damping"
    needs_dynamic = True
    reads = "{on}, {coefficients}"

    def add_to(self, core: Compiler) -> None:
        powers = [c for i in range(len(self.coefficients)) for c in (0.0, f"c{2 * i + 1}")]
        core.force_by_rate(self.on, -1.0, by_rate=core.law("polynomial", *powers))


@public
@dataclass(frozen=True)
class CoulombFriction(Force):
    """Dry friction, smoothed: ``f_i = -F tanh(s' / v0) ds/dq_i``.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is, as in `NonlinearDamping`: for a dynamic variable alone, s' is its velocity.
    force : float
        The friction F of fast motion (N or N m).
    speed : float
        The velocity v0 over which it turns round (m/s or rad/s): at v0 it is 0.76 F. Slower than that it is
        a viscous drag of F/v0, so under a small load the joint creeps instead of sticking.

    Raises
    ------
    DescriptionError
        If the force or the speed is not positive.

    Notes
    -----
    The smaller the speed, the stiffer the equations: a step should not change s' by much more than v0.
    """

    on: Scalar = field(metadata=DYNAMIC_SUM_OR_PATH)
    force: float = field(metadata=positive("as friction opposes the motion"))
    speed: float = field(metadata=positive("the velocity over which the friction turns round"))

    called = "friction"
    needs_dynamic = True
    reads = "{on}, {force} beyond a speed of {speed}"

    def add_to(self, core: Compiler) -> None:
        core.force_by_rate(self.on, -1.0, by_rate=core.law("tanh", "force", "speed"))


@public
@dataclass(frozen=True)
class LinearDamper(Force):
    """A damper between two frames: ``f_i = -c sdot ds/dq_i`` with ``s = |p1 - p2|``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends. They must not meet, where the damper has no direction.
    coefficient : float
        The coefficient c (N s/m).

    Raises
    ------
    DescriptionError
        If both ends are the same frame or the coefficient is not positive.
    """

    frame1: str = field(metadata=END)
    frame2: str = field(metadata=END)
    coefficient: float = field(metadata=positive("as a damper opposes the motion", unit="N s/m"))

    called = "damper"
    reads = "{frame1} to {frame2}, {coefficient}"
    task = "give way to the damper"
    seen_as = "damper"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array:
        return self.coefficient * rate

    def add_to(self, core: Compiler) -> None:
        length = core.path((self.frame1, self.frame2))
        core.force(length, -1.0, by_rate=core.law("linear", "coefficient"))
