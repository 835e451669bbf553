"""The modules of the package, and of what is built on it, by name."""

from __future__ import annotations

import pkgutil
from typing import Any

import leastaction
import leastaction_marionette
from leastaction import costs, elements, expressions, limits, starts

# Where users look for names: the root, and what is sorted by topics.
NAMESPACES = (leastaction, elements, expressions, limits, costs, starts)

MODULES = [
    info.name
    for package in (leastaction, leastaction_marionette)
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    if not info.name.startswith("leastaction._core") and not info.name.endswith("__main__")
]


def public_names() -> dict[str, Any]:
    """Return what the root and the namespaces offer, and what has moved from the root to other places, by name."""
    found = {name: getattr(module, name) for module in NAMESPACES for name in module.__all__}
    return {**found, **{name: getattr(leastaction, name) for name in MOVED}}


MOVED = (
    "Baumgarte", "ContinuousDynamics", "Event", "Feedback", "IntegrationStatus", "Played", "PrescribedMotion",
    "Projection", "SimulationStatus", "State", "TapeMeasure", "check_consistent", "gain_to_continuous",
    "gain_to_discrete", "steady_state_regulator", "to_continuous", "to_discrete",
)  # fmt: skip
"""Names that the root still finds, of `leastaction.mechanics`, `leastaction.optimal` and `leastaction.systems`."""
