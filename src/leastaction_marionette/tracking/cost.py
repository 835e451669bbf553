"""The cost of tracking: distance from a reference motion, and the acceleration of what is prescribed."""

from __future__ import annotations

import numpy as np

from leastaction.numerics import Array
from leastaction.optimal import QuadraticCost
from leastaction.systems import CostOfAccelerations


class TrackingCost(CostOfAccelerations):
    """Quadratic tracking cost with a price on the acceleration of the kinematic variables.

    The acceleration over a step is ``((rho_next - rho)/dt - v_rho)/dt``: linear in state and input, so the
    cost stays quadratic.

    Parameters
    ----------
    x_reference, u_reference, Q, R
        As in `QuadraticCost`; Q and R diagonal.
    dt : float
        Time step (s).
    rho, v_rho, rho_next : slice
        Where these are in the state and in the input.
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
        dt: float,
        rho: slice,
        v_rho: slice,
        rho_next: slice,
        acceleration: float | Array,
    ) -> None:
        super().__init__(
            QuadraticCost(x_reference, u_reference, Q=Q, R=R),
            dt=np.full(len(u_reference), dt),
            nx=x_reference.shape[1],
            nu=u_reference.shape[1],
            weights=np.array(np.broadcast_to(acceleration, rho.stop - rho.start)),
            rho=np.arange(rho.start, rho.stop),
            v_rho=np.arange(v_rho.start, v_rho.stop),
            rho_next=np.arange(rho_next.start, rho_next.stop),
        )
