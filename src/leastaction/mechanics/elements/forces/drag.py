"""Drag of a moving medium on a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from leastaction import _core
from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.fields import FRAME, VECTOR, number, positive
from leastaction.mechanics.expressions.tapes import TapeWriter, dot
from leastaction.numerics.public import public


@public
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

    Raises
    ------
    DescriptionError
        If the coefficient or the smoothing is not positive, the exponent less than 1, or the wind not three numbers.

    Notes
    -----
    The parameters are ``"drag.coefficient"``, ``"drag.exponent"``, ``"drag.smoothing"`` and the wind's
    ``"drag.wind.x"``, ``"drag.wind.y"``, ``"drag.wind.z"``.
    """

    frame: str = field(metadata=FRAME)
    coefficient: float = field(metadata=positive("as drag opposes the motion"))
    exponent: float = field(
        default=2.0, metadata=number(lambda n: n >= 1.0, "1 (viscous) or more", "such as 2 for air")
    )
    wind: Sequence[float] = field(default=(0.0, 0.0, 0.0), metadata=VECTOR)
    smoothing: float = field(default=1e-3, metadata=positive("the speed under which the drag is viscous", unit="m/s"))

    called = "drag"
    reads = "{frame}, coefficient {coefficient}, exponent {exponent}"
    task = "follow the drag"

    def describe(self) -> str:
        wind = f", wind ({', '.join(f'{w:g}' for w in self.wind)}) m/s" if any(self.wind) else ""
        return super().describe() + wind

    def add_to(self, core: Compiler) -> None:
        world = core.context.world
        place = [core.component(self.frame, world, world, axis) for axis in np.eye(3)]
        numbers = [core.slot(name) for name in ("coefficient", "exponent", "smoothing")]
        wind = [core.slot(f"wind.{axis}") for axis in "xyz"]
        tape = _drag_along_the_first()
        for axis in range(3):
            # The same tape for every component: the one it acts along comes first.
            turn = [axis, (axis + 1) % 3, (axis + 2) % 3]
            slots = [*numbers, *(wind[i] for i in turn)]
            core.tape_force([place[i] for i in turn], [], tape, slots)


def _drag_along_the_first() -> _core.Tape:
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
