"""Potential energies: terms of V in L = T - V."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import as_array
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses


@dataclass(frozen=True)
class Potential(Element):
    """Base of the elements that add to the potential energy."""


@dataclass(frozen=True)
class Gravity(Potential):
    """Uniform gravity on every mass: ``V = -m g . p`` with p the centre of mass.

    Parameters
    ----------
    vector : array_like, shape (3,), optional
        Acceleration of gravity in world axes (m/s^2). Along -z by default.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the vector is not three finite numbers.
    """

    vector: Sequence[float] = (0.0, 0.0, -9.81)

    unique: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        values = as_array(self.vector, "Gravity: vector", (3,), error=DescriptionError)
        object.__setattr__(self, "vector", tuple(float(value) for value in values))

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses()

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return "gravity"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"({', '.join(f'{value:g}' for value in self.vector)}) m/s^2"

    def add_to(self, builder: Builder, context: Context) -> None:  # noqa: ARG002 - the interface
        """Add the element to the core; see `Element.add_to`."""
        builder.set_gravity(np.array(self.vector))
