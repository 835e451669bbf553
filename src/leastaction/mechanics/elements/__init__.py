"""What acts on the frames: potentials, forces and constraints.

Every element is a small frozen object with one interface, `Element`; `Mechanism` knows no other.
"""

from __future__ import annotations

from leastaction.mechanics.elements.base import Context, Element, Uses
from leastaction.mechanics.elements.builder import Builder
from leastaction.mechanics.elements.constraints import (
    Constraint,
    Coupling,
    Distance,
    PathLength,
    PointToPoint,
)
from leastaction.mechanics.elements.damping import (
    CoulombFriction,
    Damping,
    LinearDamper,
    NonlinearDamping,
)
from leastaction.mechanics.elements.drag import Drag
from leastaction.mechanics.elements.expression import (
    ExpressionConstraint,
    ExpressionForce,
    ExpressionPotential,
)
from leastaction.mechanics.elements.forces import Force, JointForce
from leastaction.mechanics.elements.function_check import FunctionReport, check_derivatives
from leastaction.mechanics.elements.guides import PointOnLine, PointOnPlane, PrescribedPath
from leastaction.mechanics.elements.loops import FixedOrientation, HingeLoop
from leastaction.mechanics.elements.nonlinear_springs import ElasticString, NonlinearSpring
from leastaction.mechanics.elements.potentials import Gravity, InverseSquareGravity, Potential
from leastaction.mechanics.elements.python_function import (
    PythonConstraint,
    PythonForce,
    PythonFunction,
    PythonPotential,
)
from leastaction.mechanics.elements.springs import JointSpring, LinearSpring, TorsionalSpring
from leastaction.mechanics.elements.tendons import TendonForce
from leastaction.mechanics.elements.wrenches import BodyWrench, HybridWrench, SpatialWrench, Wrench

__all__ = [
    "BodyWrench",
    "Builder",
    "Constraint",
    "Context",
    "CoulombFriction",
    "Coupling",
    "Damping",
    "Distance",
    "Drag",
    "ElasticString",
    "Element",
    "ExpressionConstraint",
    "ExpressionForce",
    "ExpressionPotential",
    "FixedOrientation",
    "Force",
    "FunctionReport",
    "Gravity",
    "HingeLoop",
    "HybridWrench",
    "InverseSquareGravity",
    "JointForce",
    "JointSpring",
    "LinearDamper",
    "LinearSpring",
    "NonlinearDamping",
    "NonlinearSpring",
    "PathLength",
    "PointOnLine",
    "PointOnPlane",
    "PointToPoint",
    "Potential",
    "PrescribedPath",
    "PythonConstraint",
    "PythonForce",
    "PythonFunction",
    "PythonPotential",
    "SpatialWrench",
    "TendonForce",
    "TorsionalSpring",
    "Uses",
    "Wrench",
    "check_derivatives",
]
