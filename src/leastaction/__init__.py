"""Mechanisms, variational integrators with exact derivatives, and trajectory optimisation.

Describe a mechanism (`Mechanism`), simulate it (`MidpointVI`), steer it (`MidpointSystem`, `optimize`).
Ready mechanisms are in `leastaction.models`, files in `leastaction.io`, pictures in `leastaction.viz`.
"""

from __future__ import annotations

from leastaction._version import __version__
from leastaction.errors import LeastActionError
from leastaction.mechanics import (
    Body,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PointToPoint,
    SimulationStatus,
    State,
    Trajectory,
    check_consistent,
    pose,
    project_configuration,
    project_velocity,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
    world,
)
from leastaction.optimal import (
    IterationTable,
    OptimizationResult,
    QuadraticCost,
    Status,
    optimize,
    regulate,
)
from leastaction.systems import MidpointSystem

__all__ = [
    "Body",
    "Damping",
    "Distance",
    "Gravity",
    "IterationTable",
    "JointForce",
    "LeastActionError",
    "Mechanism",
    "MidpointSystem",
    "MidpointVI",
    "OptimizationResult",
    "PointToPoint",
    "QuadraticCost",
    "SimulationStatus",
    "State",
    "Status",
    "Trajectory",
    "__version__",
    "check_consistent",
    "optimize",
    "pose",
    "project_configuration",
    "project_velocity",
    "regulate",
    "rx",
    "ry",
    "rz",
    "tx",
    "ty",
    "tz",
    "world",
]
