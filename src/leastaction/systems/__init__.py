"""The bridges between mechanics and optimal control: a mechanism as a system that the optimisers can steer."""

from __future__ import annotations

from leastaction.systems.checks import check_derivatives
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.costs.places import PlaceCost
from leastaction.systems.costs.smooth import SmoothCost
from leastaction.systems.embedding import embed
from leastaction.systems.following import Followed, follow
from leastaction.systems.keep import Keep
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.pulled import PulledSystem
from leastaction.systems.regions import Ball, Box, HalfSpace, Region
from leastaction.systems.relaxation import by_tensions, relax
from leastaction.systems.rigs import Played, Rig, play
from leastaction.systems.warm_start import warm_start

__all__ = [
    "Ball", "Box", "Followed", "HalfSpace", "Keep", "MechanismSystem", "MidpointSystem", "PlaceCost", "Played",
    "PulledSystem", "Region", "Rig", "SmoothCost", "by_tensions", "check_derivatives", "embed", "follow", "play",
    "relax", "warm_start",
]  # fmt: skip
