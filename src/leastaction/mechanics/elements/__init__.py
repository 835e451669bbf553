"""What acts on the frames: potentials, forces and constraints.

Every element is a small frozen object with one interface, `Element`; `Mechanism` knows no other.
"""

from __future__ import annotations

from leastaction.mechanics.elements.base import Constraint, Element, Force, Potential
from leastaction.mechanics.elements.compiler import Compiler, Parts
from leastaction.mechanics.elements.constraints.distances import (
    Coupling,
    Distance,
    PathLength,
    PointToPoint,
    PolynomialCoupling,
)
from leastaction.mechanics.elements.constraints.guides import PointOnLine, PointOnPlane, PrescribedPath
from leastaction.mechanics.elements.constraints.loops import FixedOrientation, HingeLoop
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.custom.expression import ExpressionConstraint, ExpressionForce, ExpressionPotential
from leastaction.mechanics.elements.custom.function_check import FunctionReport, check_function
from leastaction.mechanics.elements.custom.python_function import (
    PythonConstraint,
    PythonForce,
    PythonFunction,
    PythonPotential,
)
from leastaction.mechanics.elements.forces.damping import CoulombFriction, Damping, LinearDamper, NonlinearDamping
from leastaction.mechanics.elements.forces.drag import Drag
from leastaction.mechanics.elements.forces.motors import JointForce, LinearMotor, Motor
from leastaction.mechanics.elements.forces.servos import Servo
from leastaction.mechanics.elements.forces.tendons import TendonForce
from leastaction.mechanics.elements.forces.wrenches import BodyWrench, HybridWrench, SpatialWrench, Wrench
from leastaction.mechanics.elements.kinds import Uses
from leastaction.mechanics.elements.looks import Look, Push
from leastaction.mechanics.elements.potentials.gravity import Gravity, InverseSquareGravity
from leastaction.mechanics.elements.potentials.springs import (
    ElasticString,
    JointSpring,
    LinearSpring,
    NonlinearSpring,
    TorsionalSpring,
)
from leastaction.mechanics.elements.rotors import Armature

__all__ = [
    "Armature", "BodyWrench", "Compiler", "Constraint", "Context", "CoulombFriction", "Coupling", "Damping",
    "Distance", "Drag", "ElasticString", "Element", "ExpressionConstraint", "ExpressionForce", "ExpressionPotential",
    "FixedOrientation", "Force", "FunctionReport", "Gravity", "HingeLoop", "HybridWrench", "InverseSquareGravity",
    "JointForce", "JointSpring", "LinearDamper", "LinearMotor", "LinearSpring", "Look", "Motor", "NonlinearDamping",
    "NonlinearSpring", "Parts", "PathLength", "PointOnLine", "PointOnPlane", "PointToPoint", "PolynomialCoupling",
    "Potential", "PrescribedPath", "Push", "PythonConstraint", "PythonForce", "PythonFunction", "PythonPotential",
    "Servo", "SpatialWrench", "TendonForce", "TorsionalSpring", "Uses", "Wrench", "check_function",
]  # fmt: skip
