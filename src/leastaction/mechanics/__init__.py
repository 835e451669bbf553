"""Mechanisms: how they are described, compiled and asked."""

from __future__ import annotations

from leastaction.mechanics.assembly import (
    ConfigurationProjection,
    VelocityProjection,
    check_consistent,
    project_configuration,
    project_velocity,
)
from leastaction.mechanics.bodies import Body
from leastaction.mechanics.branch import Branch, world
from leastaction.mechanics.elements import (
    Constraint,
    Damping,
    Distance,
    Element,
    Force,
    Gravity,
    JointForce,
    PointToPoint,
    Potential,
)
from leastaction.mechanics.frames import Frame, pose, rx, ry, rz, tx, ty, tz
from leastaction.mechanics.mechanism import Energy, Mechanism
from leastaction.mechanics.midpoint import MidpointVI
from leastaction.mechanics.step import Step, StepDerivatives, StepTensors
from leastaction.mechanics.trajectory import SimulationStatus, State, Trajectory

__all__ = [
    "Body",
    "Branch",
    "ConfigurationProjection",
    "Constraint",
    "Damping",
    "Distance",
    "Element",
    "Energy",
    "Force",
    "Frame",
    "Gravity",
    "JointForce",
    "Mechanism",
    "MidpointVI",
    "PointToPoint",
    "Potential",
    "SimulationStatus",
    "State",
    "Step",
    "StepDerivatives",
    "StepTensors",
    "Trajectory",
    "VelocityProjection",
    "check_consistent",
    "pose",
    "project_configuration",
    "project_velocity",
    "rx",
    "ry",
    "rz",
    "tx",
    "ty",
    "tz",
    "world",
]
