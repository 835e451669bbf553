"""A projection that a user gives, on a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.collocation.cost import AnyCollocationCost
from leastaction.optimal.collocation.layout import NodeLayout
from leastaction.optimal.collocation.mesh import STAGES, RadauMesh
from leastaction.optimal.continuous.own_projection import checked_gains, weights_as_cost
from leastaction.optimal.continuous.system import ContinuousSystem


def projection_on(given: Any, system: ContinuousSystem, mesh: RadauMesh, layout: NodeLayout) -> Any:
    """Return gains or weights in continuous time as those of the discrete system on a mesh.

    Gains act on the deviation at the beginning of a piece, at all of its points.
    """
    gains = checked_gains(given, system)
    N, nx, nu = mesh.N, system.nx, system.nu
    if gains is not None:
        K: Array = np.zeros((N, STAGES * nu, layout.nz))
        K[:, :, :nx] = gains(mesh.t.ravel()).reshape(N, STAGES * nu, nx)
        return K
    cost = weights_as_cost(given, system, float(mesh.breaks[0]), float(mesh.breaks[-1]))
    Q, R, _, Q_final = AnyCollocationCost(cost, mesh, layout).hessian(
        np.zeros((N + 1, layout.nz)), np.zeros((N, STAGES * nu))
    )
    return {"Q": Q, "R": R, "Q_final": Q_final}
