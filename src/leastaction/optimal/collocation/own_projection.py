"""A projection that a user gives, on a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.charts import CostInCharts
from leastaction.optimal.collocation.cost import AnyCollocationCost
from leastaction.optimal.collocation.mesh import STAGES
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.continuous.own_projection import checked_gains, weights_as_cost
from leastaction.optimal.discrete.cost import Cost


def projection_on(given: Any, on_mesh: CollocationSystem, x: Array, u: Array) -> Any:
    """Return gains or weights in continuous time as those of the discrete system on a mesh.

    Gains act on the deviation at the beginning of a piece, at all of its points. Where states are no plain vectors,
    what is given is by their numbers, and what is returned by differences, about the states and inputs x, u.
    """
    system, mesh, layout, space = on_mesh.system, on_mesh.mesh, on_mesh.layout, on_mesh.system.space
    gains = checked_gains(given, system)
    N, nx, nu = mesh.N, system.nx, system.nu
    if gains is not None:
        rows = gains(mesh.t.ravel()).reshape(N, STAGES * nu, nx)
        if space is not None:
            rows = rows @ space.plus_derivative(x[:-1, :nx])
        K: Array = np.zeros((N, STAGES * nu, on_mesh.ndx))
        K[:, :, : rows.shape[2]] = rows
        return K
    weights = weights_as_cost(given, system, float(mesh.breaks[0]), float(mesh.breaks[-1]))
    cost: Cost = AnyCollocationCost(weights, mesh, layout)
    if on_mesh.space is not None:
        cost = CostInCharts(cost, on_mesh.space)
    Q, R, _, Q_final = cost.convex_hessian(x, u)
    return {"Q": Q, "R": R, "Q_final": Q_final}
