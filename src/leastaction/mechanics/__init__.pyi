from leastaction.mechanics.configuration.assembly import (
    ConfigurationProjection,
    VelocityProjection,
    check_consistent,
    project_configuration,
    project_velocity,
)
from leastaction.mechanics.configuration.contradiction import Contradiction, find_contradiction
from leastaction.mechanics.configuration.equilibrium import Equilibrium, Stability, equilibrium
from leastaction.mechanics.continuous.acceleration import (
    AccelerationDerivatives,
    Accelerations,
    AccelerationTensors,
)
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.events import Event, EventRecord
from leastaction.mechanics.continuous.legendre import legendre_jacobian, to_momentum, to_velocity
from leastaction.mechanics.continuous.prescribed import PrescribedMotion
from leastaction.mechanics.continuous.signals import Feedback
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.stabilisation import Baumgarte, Drift, Projection
from leastaction.mechanics.continuous.trajectory import ContinuousState, ContinuousTrajectory, IntegrationStatus
from leastaction.mechanics.conversion import gain_to_continuous, gain_to_discrete, to_continuous, to_discrete
from leastaction.mechanics.description.affine import Affine, var
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.branch import Branch, world
from leastaction.mechanics.description.compositions import Composition, ball, free, universal
from leastaction.mechanics.description.frames import Frame, rx, ry, rz, tx, ty, tz
from leastaction.mechanics.description.joints import prismatic, revolute, screw, twist
from leastaction.mechanics.description.poses import pose
from leastaction.mechanics.discrete.balance import DiscreteBalance
from leastaction.mechanics.discrete.configuration_by import configuration_by
from leastaction.mechanics.discrete.linearization import StepDerivatives, StepTensors
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.sensitivity import Sensitivity
from leastaction.mechanics.discrete.step_sensitivity import StepSensitivity, momentum_by
from leastaction.mechanics.discrete.trajectory import SimulationStatus, State, Step, Trajectory
from leastaction.mechanics.elements import (
    Armature,
    BodyWrench,
    Constraint,
    CoulombFriction,
    Coupling,
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
    Wrench,
    check_function,
)
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.function_derivatives import FunctionDerivatives
from leastaction.mechanics.mechanism.queries.masses import Energy
from leastaction.mechanics.mechanism.queries.moved_points import MovedPoints
from leastaction.mechanics.mechanism.tape_measure import TapeMeasure
from leastaction.numerics.curve import Curve

__all__ = [
    "AccelerationDerivatives", "AccelerationTensors", "Accelerations", "Affine", "Armature", "Baumgarte", "Body",
    "BodyWrench", "Branch", "Composition", "ConfigurationProjection", "Constraint", "ContinuousDynamics",
    "ContinuousState", "ContinuousTrajectory", "Contradiction", "CoulombFriction", "Coupling", "Curve", "Damping",
    "DiscreteBalance", "Distance", "Drag", "Drift", "ElasticString", "Element", "Energy", "Equilibrium", "Event",
    "EventRecord", "ExpressionConstraint", "ExpressionForce", "ExpressionPotential", "Feedback", "FixedOrientation",
    "Force", "Frame", "FunctionDerivatives", "FunctionReport", "Gravity", "HingeLoop", "HybridWrench",
    "IntegrationStatus", "InverseSquareGravity", "JointForce", "JointSpring", "LinearDamper", "LinearMotor",
    "LinearSpring", "Mechanism", "MidpointVI", "Motor", "MovedPoints", "NonlinearDamping", "NonlinearSpring",
    "PathLength", "PointOnLine", "PointOnPlane", "PointToPoint", "PolynomialCoupling", "Potential",
    "PrescribedMotion", "PrescribedPath", "Projection", "PythonConstraint", "PythonForce", "PythonFunction",
    "PythonPotential", "Sensitivity", "Servo", "SimulationStatus", "SpatialWrench", "Stability", "State", "Step",
    "StepDerivatives", "StepSensitivity", "StepTensors", "TapeMeasure", "TendonForce", "TorsionalSpring",
    "Trajectory", "VelocityProjection", "Wrench", "ball", "check_consistent", "check_function",
    "configuration_by", "equilibrium",
    "find_contradiction", "free", "gain_to_continuous", "gain_to_discrete", "legendre_jacobian",
    "momentum_by", "pose", "prismatic", "project_configuration", "project_velocity", "revolute",
    "rx", "ry", "rz", "screw", "simulate", "to_continuous", "to_discrete", "to_momentum", "to_velocity",
    "twist", "tx", "ty", "tz", "universal", "var", "world",
]  # fmt: skip
