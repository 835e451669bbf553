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

from leastaction._names import by_stub
from leastaction._version import __version__ as __version__

# Names that have moved: they are found here too, but not offered.
_MOVED = {
    "leastaction.elements": (
        "Armature BodyWrench CoulombFriction Coupling Curve Drag ElasticString "
        "ExpressionConstraint ExpressionForce ExpressionPotential FixedOrientation HingeLoop HybridWrench "
        "InverseSquareGravity LinearDamper LinearMotor Motor NonlinearDamping NonlinearSpring PathLength "
        "PointOnLine PointOnPlane PolynomialCoupling PrescribedPath PythonConstraint PythonForce "
        "PythonFunction PythonPotential Servo SpatialWrench TendonForce TorsionalSpring"
    ),
    "leastaction.expressions": ("coordinate direction distance input_ parameter point rate speed unit_vector variable"),
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
}

__getattr__, __dir__, __all__ = by_stub(__name__, moved=_MOVED)
