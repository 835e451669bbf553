"""Mechanisms, variational integrators with exact derivatives, and trajectory optimisation.

Describe a mechanism (`Mechanism`), simulate it (`MidpointVI`), steer it (`MidpointSystem`, `optimize`). The same in
continuous time: `simulate`, `MechanismSystem`, `optimize_continuous`.
See it (`show`). Ready mechanisms are in `leastaction.models`, files in `leastaction.io`, pictures in `leastaction.viz`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily
from leastaction._version import __version__

if TYPE_CHECKING:
    from leastaction.errors import LeastActionError
    from leastaction.io import open, read_motion  # noqa: A004 - as `gzip.open` is
    from leastaction.io.mechanisms import load
    from leastaction.mechanics import (
        Armature,
        Baumgarte,
        Body,
        BodyWrench,
        ContinuousDynamics,
        ContinuousTrajectory,
        CoulombFriction,
        Coupling,
        Curve,
        Damping,
        Distance,
        Drag,
        ElasticString,
        Event,
        ExpressionConstraint,
        ExpressionForce,
        ExpressionPotential,
        Feedback,
        FixedOrientation,
        Gravity,
        HingeLoop,
        HybridWrench,
        IntegrationStatus,
        InverseSquareGravity,
        JointForce,
        JointSpring,
        LinearDamper,
        LinearMotor,
        LinearSpring,
        Mechanism,
        MidpointVI,
        Motor,
        NonlinearDamping,
        NonlinearSpring,
        PathLength,
        PointOnLine,
        PointOnPlane,
        PointToPoint,
        PolynomialCoupling,
        PrescribedMotion,
        PrescribedPath,
        Projection,
        PythonConstraint,
        PythonForce,
        PythonFunction,
        PythonPotential,
        Servo,
        SimulationStatus,
        SpatialWrench,
        State,
        TapeMeasure,
        TendonForce,
        TorsionalSpring,
        Trajectory,
        ball,
        check_consistent,
        equilibrium,
        free,
        gain_to_continuous,
        gain_to_discrete,
        pose,
        prismatic,
        project_configuration,
        project_velocity,
        revolute,
        rx,
        ry,
        rz,
        screw,
        simulate,
        to_continuous,
        to_discrete,
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
    from leastaction.mechanics.expressions import (
        coordinate,
        direction,
        distance,
        input_,
        parameter,
        point,
        rate,
        speed,
        unit_vector,
        variable,
    )
    from leastaction.optimal import (
        Bound,
        Equal,
        FinalTime,
        FunctionQuantity,
        IterationTable,
        OptimizationResult,
        Parameter,
        Periodic,
        QuadraticCost,
        StageRecord,
        StageTable,
        StartResult,
        StartStatus,
        Status,
        Within,
        coarse_to_fine,
        continuation,
        controllability,
        optimize,
        optimize_continuous,
        receding_horizon,
        regulate,
    )
    from leastaction.optimal.continuous import ContinuousQuadraticCost, regulate_continuous, steady_state_regulator
    from leastaction.systems import (
        Ball,
        Box,
        Followed,
        HalfSpace,
        Keep,
        MechanismSystem,
        MidpointSystem,
        PlaceCost,
        Played,
        Rig,
        SmoothCost,
        by_tensions,
        check_derivatives,
        embed,
        follow,
        play,
        relax,
        warm_start,
    )
    from leastaction.viz import show
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.errors": "LeastActionError",
            "leastaction.io": "open read_motion",
            "leastaction.io.mechanisms": "load",
            "leastaction.mechanics": (
                "Armature Baumgarte Body BodyWrench ContinuousDynamics ContinuousTrajectory CoulombFriction Coupling "
                "Curve Damping Distance Drag ElasticString Event ExpressionConstraint ExpressionForce "
                "ExpressionPotential Feedback FixedOrientation Gravity HingeLoop HybridWrench IntegrationStatus "
                "InverseSquareGravity JointForce JointSpring LinearDamper LinearMotor LinearSpring Mechanism "
                "MidpointVI Motor NonlinearDamping NonlinearSpring PathLength PointOnLine PointOnPlane PointToPoint "
                "PolynomialCoupling PrescribedMotion PrescribedPath Projection PythonConstraint PythonForce "
                "PythonFunction PythonPotential Servo SimulationStatus SpatialWrench State TapeMeasure TendonForce "
                "TorsionalSpring Trajectory ball check_consistent equilibrium free gain_to_continuous "
                "gain_to_discrete pose prismatic project_configuration project_velocity revolute rx ry rz screw "
                "simulate to_continuous to_discrete to_momentum to_velocity twist tx ty tz universal var world"
            ),
            "leastaction.mechanics.expressions": (
                "coordinate direction distance input_ parameter point rate speed unit_vector variable"
            ),
            "leastaction.optimal": (
                "Bound Equal FinalTime FunctionQuantity IterationTable OptimizationResult Parameter Periodic "
                "QuadraticCost StageRecord StageTable StartResult StartStatus Status Within coarse_to_fine "
                "continuation controllability optimize optimize_continuous receding_horizon regulate"
            ),
            "leastaction.optimal.continuous": "ContinuousQuadraticCost regulate_continuous steady_state_regulator",
            "leastaction.systems": (
                "Ball Box Followed HalfSpace Keep MechanismSystem MidpointSystem PlaceCost Played Rig SmoothCost "
                "by_tensions check_derivatives embed follow play relax warm_start"
            ),
            "leastaction.viz": "show",
        },
    )

__all__ = [
    "Armature", "Ball", "Baumgarte", "Body", "BodyWrench", "Bound", "Box", "ContinuousDynamics",
    "ContinuousQuadraticCost", "ContinuousTrajectory", "CoulombFriction", "Coupling", "Curve", "Damping",
    "Distance", "Drag", "ElasticString", "Equal", "Event", "ExpressionConstraint", "ExpressionForce",
    "ExpressionPotential", "Feedback", "FinalTime", "FixedOrientation", "Followed", "FunctionQuantity", "Gravity",
    "HalfSpace", "HingeLoop", "HybridWrench", "IntegrationStatus", "InverseSquareGravity", "IterationTable",
    "JointForce", "JointSpring", "Keep", "LeastActionError", "LinearDamper", "LinearMotor", "LinearSpring",
    "Mechanism", "MechanismSystem", "MidpointSystem", "MidpointVI", "Motor", "NonlinearDamping", "NonlinearSpring",
    "OptimizationResult", "Parameter", "PathLength", "Periodic", "PlaceCost", "Played", "PointOnLine",
    "PointOnPlane", "PointToPoint", "PolynomialCoupling", "PrescribedMotion", "PrescribedPath", "Projection",
    "PythonConstraint", "PythonForce", "PythonFunction", "PythonPotential", "QuadraticCost", "Rig", "Servo",
    "SimulationStatus", "SmoothCost", "SpatialWrench", "StageRecord", "StageTable", "StartResult", "StartStatus",
    "State", "Status", "TapeMeasure", "TendonForce", "TorsionalSpring", "Trajectory", "Within", "__version__",
    "ball", "by_tensions", "check_consistent", "check_derivatives", "coarse_to_fine", "continuation",
    "controllability", "coordinate", "direction", "distance", "embed", "equilibrium", "follow", "free",
    "gain_to_continuous", "gain_to_discrete", "input_", "load", "open", "optimize", "optimize_continuous",
    "parameter", "play", "point", "pose", "prismatic", "project_configuration", "project_velocity", "rate",
    "read_motion", "receding_horizon", "regulate", "regulate_continuous", "relax", "revolute", "rx", "ry", "rz",
    "screw", "show", "simulate", "speed", "steady_state_regulator", "to_continuous", "to_discrete", "to_momentum",
    "to_velocity", "twist", "tx", "ty", "tz", "unit_vector", "universal", "var", "variable", "warm_start", "world",
]  # fmt: skip
