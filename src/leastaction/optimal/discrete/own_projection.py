"""Gains of the projection that are not those of the descent direction: given, or of a regulator with weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.cost import as_weight
from leastaction.optimal.discrete.linear_quadratic import Workspace, regulate
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.options import Options
from leastaction.optimal.system import Linearization


class OwnProjection:
    """Gains (N, nu, ndx) that are given, or those of a regulator with weights about each iterate.

    ``given``: gains, or weights of `regulate` by name; identities where these are left out. ``is_users``: whether what
    is given to start from is projected by it too.
    """

    def __init__(self, given: Any, system: DiscreteSystem, *, is_users: bool = True) -> None:
        self.is_users = is_users
        N, ndx, nu = system.N, system.ndx, system.nu
        self.fixed: Array | None = None
        self.weights: dict[str, Array] = {}
        if not isinstance(given, Mapping):
            self.fixed = as_array(given, "projection", (N, nu, ndx), meaning="(N, nu, nx), gains").copy()
            return
        for name, weight in given.items():
            n, stages = (nu if name == "R" else ndx), (None if name == "Q_final" else N)
            # On a mesh, inputs cost what the states after them do.
            self.weights[name] = as_weight(weight, f"projection: {name}", n, stages=stages, definite=False)

    def gains(self, linearization: Linearization, workspace: Workspace) -> Array:
        """Return the gains about a trajectory; fixed ones, or written to the workspace."""
        if self.fixed is not None:
            return self.fixed
        A, B = linearization
        try:
            return regulate(A, B, **self.weights, workspace=workspace)
        except ArgumentError as error:
            raise ArgumentError(f"projection: {error}") from None


def with_projection(
    settings: Options, system: DiscreteSystem, moved: Callable[[Array], Array], padded: Callable[[Array], Array]
) -> Options:
    """Return options for a system around another one: gains and weights of a projection act on that one's states.

    ``moved``: returns rows (..., ndx) by the outer states, given those by the inner ones; ``padded``: weights.
    """
    given = settings.projection
    if given is None:
        return settings
    N, n = system.N, system.ndx
    if not isinstance(given, Mapping):
        K = as_array(given, "projection", (N, system.nu, n), meaning="(N, nu, nx), gains")
        return settings.changed(projection=moved(K))
    weights = dict(given)
    for name in {"Q", "Q_final"}.intersection(weights):
        stages = None if name == "Q_final" else N
        weights[name] = padded(as_weight(weights[name], f"projection: {name}", n, stages=stages, definite=False))
    return settings.changed(projection=weights)


def own_projection(settings: Options, system: DiscreteSystem) -> OwnProjection | None:
    """Return what a run projects by, if it is not by the gains of its directions."""
    if settings.projection is not None:
        return OwnProjection(settings.projection, system)
    return OwnProjection({}, system, is_users=False) if settings.regulator == "lqr" else None
