"""Inertia that is geared to variables and no body of the tree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from leastaction.mechanics.elements.base import Element
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.fields import SUM, positive
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class Armature(Element):
    """The rotor of a drive, geared to a variable or to a sum of some: ``T = J/2 s'^2``.

    Geared n to one, a rotor of the inertia j is ``J = n^2 j`` on the variable of its joint, the "armature" or
    "reflected inertia" of a catalogue; or j on ``{"joint": n}``.

    Parameters
    ----------
    variable : str or mapping of str to float
        The variable s, or the factors of the sum ``s = sum of factor q``.
    inertia : float
        The inertia J (kg m^2, or kg for a slide).

    Raises
    ------
    DescriptionError
        If the inertia is not positive, a factor is zero, or a number is not finite.

    Notes
    -----
    It counts in the energy, in the momenta of the variables and in the mass matrix, in all equations of motion. It
    has no place: mass, centre of mass and `total_momentum` of the mechanism do not know of it, and no weight or
    gyroscopic torque comes from it. For those give the rotor a frame and a body of its own.
    """

    variable: str | Mapping[str, float] = field(metadata=SUM)
    inertia: float = field(metadata=positive("as a rotor opposes being accelerated", unit="kg m^2"))

    called = "armature"
    reads = "{variable}, {inertia}"

    @property
    def geared(self) -> Mapping[str, float]:
        return {self.variable: 1.0} if isinstance(self.variable, str) else self.variable

    def add_to(self, core: Compiler) -> None:
        core.rotor(self.variable, "inertia")
