"""Drives with feedback of their own: servos, and whatever force is affine in place, rate and input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler, Scalar
from leastaction.mechanics.elements.fields import DYNAMIC_SUM_OR_PATH, INPUT, number
from leastaction.mechanics.elements.scalars import unit_of
from leastaction.mechanics.elements.units import force_along, rate_of
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class Servo(Force):
    """A drive along a scalar s whose force is affine in the input, in s and in its rate.

    ``f_i = F ds/dq_i`` with ``F = (gain + gain_by_place s + gain_by_rate s') u + offset - stiffness s - damping s'``.

    A servo of place with the gain k, ``F = k (u - s) - c s'``, is ``gain=k, stiffness=k, damping=c``; one of speed,
    ``F = k (u - s')``, is ``gain=k, damping=k``.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is: a dynamic variable, a sum of some by their factors, or the length of a path through the origins of
        frames, or of several with a factor each, as in `TendonForce`.
    input : str
        The input u, such as the wanted place; new with this element, or shared with others of the same name.
    gain : float, optional
        Force by the input (N or N m per unit of the input).
    offset, stiffness, damping : float, optional
        The force without input, place and rate; what drives back to s = 0; what opposes the rate. No such term, and no
        such parameter, where not given.
    gain_by_place, gain_by_rate : float, optional
        What the gain grows with; likewise.

    Raises
    ------
    DescriptionError
        If the input has no gain at all, a number is not finite, or ``on`` is none of these.

    Notes
    -----
    The feedback is a force, not a spring: it has no energy of its own. Any number may be negative.
    """

    on: Scalar = field(metadata=DYNAMIC_SUM_OR_PATH)
    input: str = field(metadata=INPUT)
    gain: float = field(default=1.0, metadata=number())
    offset: float | None = field(default=None, metadata=number())
    stiffness: float | None = field(default=None, metadata=number())
    damping: float | None = field(default=None, metadata=number())
    gain_by_place: float | None = field(default=None, metadata=number())
    gain_by_rate: float | None = field(default=None, metadata=number())

    called = "servo"
    needs_dynamic = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.gain or self.gain_by_place or self.gain_by_rate):
            raise DescriptionError(
                f"{self.label}: every gain is zero, so the input {self.input!r} does nothing; give gain=, or "
                "say what is left as a spring and damping"
            )

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        unit = unit_of(self.on, of)
        if self.stiffness == self.gain:
            return {self.input: unit}
        if self.damping == self.gain and self.stiffness is None:
            return {self.input: rate_of(unit)}
        return {self.input: force_along(unit) if self.gain == 1.0 else ""}

    def describe(self) -> str:
        numbers = {n: x for n, x in self.numbers.items() if not n.startswith("factors.")}
        on = next(kind.show(value) for name, kind, value in self._held() if name == "on")
        return f"{self.input} on {on}, " + ", ".join(f"{n.replace('_', ' ')} {x:g}" for n, x in numbers.items())

    def add_to(self, core: Compiler) -> None:
        s = core.along(self.on)
        against, along = core.law("linear", -1.0), core.law("linear", 1.0)
        core.force(s, "gain", self.input)
        if self.gain_by_place is not None:
            core.force(s, "gain_by_place", self.input, by_place=along)
        if self.gain_by_rate is not None:
            core.force(s, "gain_by_rate", self.input, by_rate=along)
        if self.offset is not None:
            core.force(s, "offset")
        if self.stiffness is not None:
            core.force(s, "stiffness", by_place=against)
        if self.damping is not None:
            core.force(s, "damping", by_rate=against)
