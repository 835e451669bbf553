"""`Found`: what a part of an MJCF comes to in a mechanism."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.io.mechanisms.model import LeftOut
from leastaction.mechanics.elements import Element
from leastaction.optimal import Bound
from leastaction.systems import PathBound


@dataclass(frozen=True)
class Found:
    """Elements, limits of their inputs, what is left out.

    ``inputs``: of actuators, the input that each has become, in their order; None for one that has none.
    """

    elements: tuple[Element, ...] = ()
    limits: tuple[Bound | PathBound, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    inputs: tuple[str | None, ...] = ()

    def __add__(self, other: Found) -> Found:
        return Found(
            self.elements + other.elements,
            self.limits + other.limits,
            self.left_out + other.left_out,
            self.inputs + other.inputs,
        )
