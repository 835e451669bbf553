"""Drag of a moving medium on a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.reading import number, positive, three
from leastaction.mechanics.expressions.tapes import TapeWriter, dot
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class Drag(Force):
    """Drag on the origin of a frame: ``F = -c (|w|^2 + e^2)^((n-1)/2) w`` with ``w = pdot - wind``.

    With the exponent n = 2 the drag of a body in air, ``c = rho A cd / 2``; with n = 1 viscous drag.

    Parameters
    ----------
    frame : str
        The frame.
    coefficient : float
        The coefficient c (N s^n/m^n; kg/m for n = 2).
    exponent : float, optional
        The exponent n of the speed, 1 or more.
    wind : array_like, shape (3,), optional
        Velocity of the medium in world axes (m/s).
    smoothing : float, optional
        The speed e under which the drag goes over to a viscous one (m/s), so that it is smooth at rest.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the coefficient or the smoothing is not positive, the exponent less than 1, or the wind not
        three numbers.

    Notes
    -----
    The parameters are ``"drag.coefficient"``, ``"drag.exponent"``, ``"drag.smoothing"`` and the wind's
    ``"drag.wind.x"``, ``"drag.wind.y"``, ``"drag.wind.z"``.
    """

    frame: str
    coefficient: float
    exponent: float = 2.0
    wind: Sequence[float] = (0.0, 0.0, 0.0)
    smoothing: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        title = self.title
        check_name(self.frame, f"{title}: frame")
        coefficient = positive(
            self.coefficient, f"{title}: coefficient", "as drag opposes the motion"
        )
        exponent = number(self.exponent, f"{title}: exponent")
        if exponent < 1.0:
            raise DescriptionError(
                f"{title}: exponent: got {exponent:g}, expected 1 (viscous) or more, such as 2 for air"
            )
        smoothing = positive(
            self.smoothing, f"{title}: smoothing", "the speed under which the drag is viscous"
        )
        object.__setattr__(self, "coefficient", coefficient)
        object.__setattr__(self, "exponent", exponent)
        object.__setattr__(self, "wind", three(self.wind, f"{title}: wind"))
        object.__setattr__(self, "smoothing", smoothing)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=(self.frame,))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"drag({self.frame})"

    def describe(self) -> str:
        """Return the values in a few words."""
        wind = f", wind ({', '.join(f'{w:g}' for w in self.wind)}) m/s" if any(self.wind) else ""
        return f"{self.frame}, coefficient {self.coefficient:g}, exponent {self.exponent:g}{wind}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_moved(
            context,
            context.moving(self.frame),
            f"moves {self.frame!r}, so drag on it does nothing; remove it or choose another frame",
        )

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        axis = parameter.removeprefix("wind.")
        if axis == parameter:
            return super().with_number(parameter, value)
        wind = {**dict(zip("xyz", self.wind, strict=True)), axis: value}
        return replace(self, wind=tuple(wind.values()))

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        point = context.point(builder, self.frame)
        origin = context.point(builder, context.world)
        place = [
            builder.component_coordinate(
                point, origin, context.direction(builder, context.world, axis)
            )
            for axis in np.eye(3)
        ]
        numbers = [
            context.parameter(builder, self, field, getattr(self, field))
            for field in ("coefficient", "exponent", "smoothing")
        ]
        wind = [
            context.parameter(builder, self, f"wind.{axis}", value)
            for axis, value in zip("xyz", self.wind, strict=True)
        ]
        tape = _drag_along_the_first()
        for axis in range(3):
            # The same tape for every component: the one it acts along comes first.
            turn = [axis, (axis + 1) % 3, (axis + 2) % 3]
            slots = [*numbers, *(wind[i] for i in turn)]
            builder.add_tape_force([place[i] for i in turn], [], tape, slots)


def _drag_along_the_first() -> Any:
    """Return the component of the drag along the first of three axes, as a tape.

    Inputs: three places, their rates, coefficient, exponent, smoothing, the wind along the three axes.
    """
    tape = TapeWriter(12)
    rates, (c, n, e), wind = tape.inputs[3:6], tape.inputs[6:9], tape.inputs[9:]
    w = [rate - blows for rate, blows in zip(rates, wind, strict=True)]
    size = dot(w, w) + e * e
    half = (n - tape.constant(1.0)) * 0.5
    factor = c * tape.apply("exp", half * tape.apply("log", size))
    return tape.end(-(factor * w[0]))
