"""The cost of tracking: distance from a reference motion, and the acceleration of what is prescribed."""

from __future__ import annotations

import numpy as np

from leastaction.numerics import Array
from leastaction.optimal import QuadraticCost
from leastaction.systems import CostOfAccelerations, MidpointSystem


class TrackingCost(CostOfAccelerations):
    """Quadratic tracking cost with a price on the acceleration of the kinematic variables.

    The acceleration over a step is ``((rho_next - rho)/dt - v_rho)/dt``: linear in state and input, so the
    cost stays quadratic.

    Parameters
    ----------
    x_reference, u_reference, Q, R
        As in `QuadraticCost`; Q and R diagonal.
    system : MidpointSystem
        What is steered; its steps of time are all as long.
    acceleration : float or array_like (nrho,)
        Weight of half the squared acceleration of each.
    """

    can_be_eased = False  # a puppet whose strings move at no effort falls, and leads to no motion that pulls

    def __init__(
        self,
        x_reference: Array,
        u_reference: Array,
        *,
        Q: Array,
        R: Array,
        system: MidpointSystem,
        acceleration: float | Array,
    ) -> None:
        m, each = system.mechanism, np.arange(system.mechanism.nrho)
        self.Q, self.R = Q, R
        super().__init__(
            QuadraticCost(x_reference, u_reference, Q=Q, R=R, space=system.space),
            dt=np.diff(system.t),
            nx=system.nx,
            nu=system.nu,
            weights=np.array(np.broadcast_to(acceleration, m.nrho)),
            rho=m.first_rho + each,
            v_rho=m.nq + m.nd + each,
            rho_next=m.n_inputs + each,
            ndx=system.ndx,
            moves=np.stack([m.nd + each, m.nv + m.nd + each]),
        )
