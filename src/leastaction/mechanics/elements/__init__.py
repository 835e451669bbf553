"""What acts on the frames: potentials, forces and constraints.

Every element is a small frozen object with one interface, `Element`; `Mechanism` knows no other.
"""

from __future__ import annotations

from leastaction.mechanics.elements.base import Context, Element, Uses
from leastaction.mechanics.elements.builder import Builder
from leastaction.mechanics.elements.constraints.distances import (
    Constraint,
    Coupling,
    Distance,
    PathLength,
    PointToPoint,
)
from leastaction.mechanics.elements.constraints.guides import (
    PointOnLine,
    PointOnPlane,
    PrescribedPath,
)
from leastaction.mechanics.elements.constraints.loops import FixedOrientation, HingeLoop
from leastaction.mechanics.elements.custom.expression import (
    ExpressionConstraint,
    ExpressionForce,
    ExpressionPotential,
)
from leastaction.mechanics.elements.custom.function_check import FunctionReport, check_derivatives
from leastaction.mechanics.elements.custom.python_function import (
    PythonConstraint,
    PythonForce,
    PythonFunction,
    PythonPotential,
)
from leastaction.mechanics.elements.forces.damping import (
    CoulombFriction,
    Damping,
    LinearDamper,
    NonlinearDamping,
)
from leastaction.mechanics.elements.forces.drag import Drag
from leastaction.mechanics.elements.forces.joint_forces import Force, JointForce
from leastaction.mechanics.elements.forces.tendons import TendonForce
from leastaction.mechanics.elements.forces.wrenches import (
    BodyWrench,
    HybridWrench,
    SpatialWrench,
    Wrench,
)
from leastaction.mechanics.elements.potentials.gravity import (
    Gravity,
    InverseSquareGravity,
    Potential,
)
from leastaction.mechanics.elements.potentials.nonlinear_springs import (
    ElasticString,
    NonlinearSpring,
)
from leastaction.mechanics.elements.potentials.springs import (
    JointSpring,
    LinearSpring,
    TorsionalSpring,
)

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
