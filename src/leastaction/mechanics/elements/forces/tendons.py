"""Tendons and strings that pull with an input: muscles, cables, winches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler, Paths
from leastaction.mechanics.elements.fields import CURVE, INPUT, PATH, not_zero
from leastaction.numerics.arrays import Array
from leastaction.numerics.curve import Curve
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class TendonForce(Force):
    """The tension of a string over via-points: ``f_i = -gain u fl(s) fv(sdot) ds/dq_i``.

    The length s is that of the straight pieces through the frames; a positive tension shortens it.

    Parameters
    ----------
    frames : sequence of str, or mapping of such to float
        Two frames or more, in the order of the string: the ends, and between them the via-points.
    input : str
        The input u: the tension (N) with the gain 1, an activation with the gain of a muscle's strength. New
        with this element, or shared with others of the same name.
    gain : float, optional
        Factor, not zero (N per unit of the input).
    force_length : Curve, optional
        Factor fl by the length (m); 1 if not given.
    force_velocity : Curve, optional
        Factor fv by the rate of the length (m/s), which is negative while the string shortens; 1 if not given.

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, the gain is zero, or a curve is none.

    Notes
    -----
    Nothing keeps the tension from being negative: bound the input where it is chosen. Consecutive frames
    must not meet, where the string has no direction.
    """

    frames: Paths = field(metadata=PATH)
    input: str = field(metadata=INPUT)
    gain: float = field(default=1.0, metadata=not_zero("as else the input does nothing"))
    force_length: Curve | None = field(default=None, metadata=CURVE)
    force_velocity: Curve | None = field(default=None, metadata=CURVE)

    called = "tendon"
    reads = "{input} along {frames}"
    seen_as = "string"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array | None:
        if isinstance(self.frames, Mapping):
            return None  # its pieces pull differently, by the length of all
        tension = self.gain * values[self.input]
        if self.force_length is not None:
            tension = tension * np.asarray(self.force_length(length), dtype=float)
        if self.force_velocity is not None:
            tension = tension * np.asarray(self.force_velocity(rate), dtype=float)
        return tension

    def describe(self) -> str:
        parts = [super().describe()]
        if self.gain != 1.0:
            parts.append(f"gain {self.gain:g}")
        if self.force_length is not None:
            parts.append("force by length")
        if self.force_velocity is not None:
            parts.append("force by velocity")
        return ", ".join(parts)

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        is_tension = self.gain == 1.0 and self.force_length is None and self.force_velocity is None
        return {self.input: "N" if is_tension else ""}

    def add_to(self, core: Compiler) -> None:
        # The sign goes into the first factor, so that the gain is what the user gave.
        fl, fv = self.force_length, self.force_velocity
        pull = core.law("polynomial", -1.0) if fl is None else core.curve(fl, core.slot(-1.0))
        by_velocity = -1 if fv is None else core.curve(fv, core.slot(1.0))
        core.force(core.path(self.frames), "gain", self.input, pull, by_velocity)
