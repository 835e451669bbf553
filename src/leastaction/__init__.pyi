from leastaction._version import __version__ as __version__
from leastaction.control import MPC, KalmanFilter, play, simulate, simulate_many
from leastaction.errors import LeastActionError
from leastaction.io import open as open  # noqa: A004 - as `gzip.open` is
from leastaction.io import read_motion
from leastaction.io.mechanisms import load
from leastaction.mechanics import (
    Body,
    ContinuousTrajectory,
    Damping,
    Distance,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    ball,
    equilibrium,
    free,
    pose,
    prismatic,
    project_configuration,
    project_velocity,
    revolute,
    rx,
    ry,
    rz,
    screw,
    to_momentum,
    to_velocity,
    twist,
    tx,
    ty,
    tz,
    universal,
    var,
    world,
)
from leastaction.optimal import (
    Bound,
    Equal,
    FinalTime,
    IterationTable,
    OptimizationResult,
    Parameter,
    Periodic,
    QuadraticCost,
    Status,
    Within,
    controllability,
    optimize,
    optimize_continuous,
    regulate,
)
from leastaction.optimal.continuous import ContinuousQuadraticCost, regulate_continuous
from leastaction.systems import (
    Ball,
    Keep,
    MechanismSystem,
    MidpointSystem,
    Rig,
    check_derivatives,
    follow,
    warm_start,
)
from leastaction.viz import show

__all__ = [  # noqa: RUF022 - by topics
    # Describe a mechanism
    "Body", "Mechanism", "ball", "free", "pose", "prismatic", "revolute", "rx", "ry", "rz", "screw", "twist", "tx",
    "ty", "tz", "universal", "var", "world",
    # What acts on nearly every mechanism; all elements are in `elements`, symbols in `expressions`
    "Damping", "Distance", "Gravity", "JointForce", "JointSpring", "LinearSpring", "PointToPoint",
    # Put it together, and let it move
    "ContinuousTrajectory", "MidpointVI", "Trajectory", "equilibrium", "project_configuration", "project_velocity",
    "simulate", "to_momentum", "to_velocity",
    # Steer it; more is in `costs`, `limits`, `starts` and `control`
    "Ball", "Bound", "ContinuousQuadraticCost", "Equal", "FinalTime", "IterationTable", "Keep", "MechanismSystem",
    "MidpointSystem", "OptimizationResult", "Parameter", "Periodic", "QuadraticCost", "Status", "Within",
    "check_derivatives", "controllability", "follow", "optimize", "optimize_continuous", "regulate",
    "regulate_continuous", "warm_start",
    # Control it, and run many at once; more is in `control`
    "KalmanFilter", "MPC", "simulate_many",
    # Try it on a machine, look at it, keep it; `open` is here as well, but no `import *` hides Python's own
    "Rig", "load", "play", "read_motion", "show",
    # What can go wrong, and what this is
    "LeastActionError", "__version__",
]  # fmt: skip
