"""Mechanisms, variational integrators with exact derivatives, and trajectory optimisation.

Describe a mechanism (`Mechanism`), simulate it (`MidpointVI`), steer it (`MidpointSystem`, `optimize`). The same in
continuous time: `simulate`, `MechanismSystem`, `optimize_continuous`.
See it (`show`).

What most users need has its name here. By topics there is more in `leastaction.elements`, `leastaction.expressions`,
`leastaction.limits`, `leastaction.costs`, `leastaction.starts` and `leastaction.control`. Ready mechanisms are in
`leastaction.models`, files in `leastaction.io`, pictures in `leastaction.viz`; everything else that is public in
`leastaction.mechanics`, `leastaction.optimal`, `leastaction.systems` and `leastaction.errors`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily
from leastaction._version import __version__

if TYPE_CHECKING:
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
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.control": "MPC KalmanFilter play simulate simulate_many",
            "leastaction.errors": "LeastActionError",
            "leastaction.io": "open read_motion",
            "leastaction.io.mechanisms": "load",
            "leastaction.mechanics": (
                "Body ContinuousTrajectory Damping Distance Gravity JointForce JointSpring LinearSpring Mechanism "
                "MidpointVI PointToPoint Trajectory ball equilibrium free pose prismatic project_configuration "
                "project_velocity revolute rx ry rz screw to_momentum to_velocity twist tx ty tz universal "
                "var world"
            ),
            "leastaction.optimal": (
                "Bound Equal FinalTime IterationTable OptimizationResult Parameter Periodic QuadraticCost Status "
                "Within controllability optimize optimize_continuous regulate"
            ),
            "leastaction.optimal.continuous": "ContinuousQuadraticCost regulate_continuous",
            "leastaction.systems": "Ball Keep MechanismSystem MidpointSystem Rig check_derivatives follow warm_start",
            "leastaction.viz": "show",
        },
        # Names that have moved: they are found here too, but not offered.
        moved={
            "leastaction.elements": (
                "Armature BodyWrench CoulombFriction Coupling Curve Drag ElasticString "
                "ExpressionConstraint ExpressionForce ExpressionPotential FixedOrientation HingeLoop HybridWrench "
                "InverseSquareGravity LinearDamper LinearMotor Motor NonlinearDamping NonlinearSpring PathLength "
                "PointOnLine PointOnPlane PolynomialCoupling PrescribedPath PythonConstraint PythonForce "
                "PythonFunction PythonPotential Servo SpatialWrench TendonForce TorsionalSpring"
            ),
            "leastaction.expressions": (
                "coordinate direction distance input_ parameter point rate speed unit_vector variable"
            ),
            "leastaction.limits": "Box FunctionQuantity HalfSpace",
            "leastaction.costs": "PlaceCost SmoothCost",
            "leastaction.starts": (
                "Followed StageRecord StageTable StartResult StartStatus by_tensions coarse_to_fine continuation "
                "embed receding_horizon relax"
            ),
            "leastaction.mechanics": (
                "Baumgarte ContinuousDynamics Event Feedback IntegrationStatus PrescribedMotion Projection "
                "SimulationStatus State TapeMeasure check_consistent gain_to_continuous gain_to_discrete "
                "to_continuous to_discrete"
            ),
            "leastaction.optimal": "steady_state_regulator",
            "leastaction.systems": "Played",
        },
    )

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
