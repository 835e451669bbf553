from leastaction.systems.checks import check_derivatives
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.costs.configurations import CostOfConfigurations
from leastaction.systems.costs.distances import DistanceCost
from leastaction.systems.costs.frames import ContinuousOrientationCost, ContinuousPlaceCost
from leastaction.systems.costs.orientations import OrientationCost
from leastaction.systems.costs.places import PlaceCost
from leastaction.systems.costs.smooth import CostOfAccelerations, SmoothCost
from leastaction.systems.costs.tracking import tracking
from leastaction.systems.embedding import embed
from leastaction.systems.following.follow import Followed, follow
from leastaction.systems.keep import Keep
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.oriented import Oriented
from leastaction.systems.path_bound import PathBound
from leastaction.systems.pointing import Pointing
from leastaction.systems.pulled import PulledSystem
from leastaction.systems.regions import Ball, Box, HalfSpace, Region
from leastaction.systems.relaxation import by_tensions, relax
from leastaction.systems.rig import Played, Rig
from leastaction.systems.warm_starts import warm_start

__all__ = [
    "Ball", "Box", "ContinuousOrientationCost", "ContinuousPlaceCost", "CostOfAccelerations", "CostOfConfigurations",
    "DistanceCost", "Followed", "HalfSpace", "Keep", "MechanismSystem", "MidpointSystem", "OrientationCost", "Oriented",
    "PathBound", "PlaceCost", "Played", "Pointing", "PulledSystem", "Region", "Rig", "SmoothCost", "by_tensions",
    "check_derivatives", "embed", "follow", "relax", "tracking", "warm_start",
]  # fmt: skip
