"""Elements: what acts on a mechanism, and what it keeps to.

Potentials, forces and constraints, those of a user's own among them (`ExpressionForce`, `PythonForce`, and their like;
`Potential`, `Force` and `Constraint` are what they all derive from). The few that nearly every mechanism has are names
of `leastaction` too.
"""

from __future__ import annotations

from leastaction.mechanics import (
    Armature,
    BodyWrench,
    Constraint,
    CoulombFriction,
    Coupling,
    Curve,
    Damping,
    Distance,
    Drag,
    ElasticString,
    Element,
    ExpressionConstraint,
    ExpressionForce,
    ExpressionPotential,
    FixedOrientation,
    Force,
    FunctionReport,
    Gravity,
    HingeLoop,
    HybridWrench,
    InverseSquareGravity,
    JointForce,
    JointSpring,
    LinearDamper,
    LinearMotor,
    LinearSpring,
    Motor,
    NonlinearDamping,
    NonlinearSpring,
    PathLength,
    PointOnLine,
    PointOnPlane,
    PointToPoint,
    PolynomialCoupling,
    Potential,
    PrescribedPath,
    PythonConstraint,
    PythonForce,
    PythonFunction,
    PythonPotential,
    Servo,
    SpatialWrench,
    TendonForce,
    TorsionalSpring,
    check_function,
)

__all__ = [  # noqa: RUF022 - by topics
    # Potentials
    "ElasticString", "ExpressionPotential", "Gravity", "InverseSquareGravity", "JointSpring", "LinearSpring",
    "NonlinearSpring", "PythonPotential", "TorsionalSpring",
    # Forces
    "Armature", "BodyWrench", "CoulombFriction", "Damping", "Drag", "ExpressionForce", "HybridWrench", "JointForce",
    "LinearDamper", "LinearMotor", "Motor", "NonlinearDamping", "PythonForce", "Servo", "SpatialWrench", "TendonForce",
    # Constraints
    "Coupling", "Distance", "ExpressionConstraint", "FixedOrientation", "HingeLoop", "PathLength", "PointOnLine",
    "PointOnPlane", "PointToPoint", "PolynomialCoupling", "PrescribedPath", "PythonConstraint",
    # What they are made of
    "Constraint", "Curve", "Element", "Force", "FunctionReport", "Potential", "PythonFunction",
    "check_function",
]  # fmt: skip
