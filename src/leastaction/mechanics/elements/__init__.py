"""What acts on the frames: potentials, forces and constraints.

Every element is a small frozen object with one interface, `Element`; `Mechanism` knows no other.
"""

from __future__ import annotations

from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.constraints import Constraint, Distance, PointToPoint
from leastaction.mechanics.elements.forces import Damping, Force, JointForce
from leastaction.mechanics.elements.potentials import Gravity, Potential

__all__ = [
    "Builder",
    "Constraint",
    "Context",
    "Damping",
    "Distance",
    "Element",
    "Force",
    "Gravity",
    "JointForce",
    "PointToPoint",
    "Potential",
    "Uses",
]
