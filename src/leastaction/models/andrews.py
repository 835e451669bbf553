"""Andrews' squeezing mechanism: seven bodies in the plane, closed by three loops, driven through thousands of g.

The mechanism of the test set of initial value problems (Bari), there "Andrews' squeezing mechanism", index 3,
after Giles, Manning and Schiehlen; sizes, masses and variables are those of the test set (SI units).
"""

from __future__ import annotations

from leastaction.mechanics import Body, JointForce, LinearSpring, Mechanism, PointToPoint, world
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

A, B, C = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
"""The pivots on the ground, and the fixed end of the spring (m)."""

MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
TORQUE = 0.033
"""The constant torque that drives the crank (N m)."""

START = {
    "beta": -0.0617138900142764496358948458001,
    "Theta": 0.0,
    "gamma": 0.455279819163070380255912382449,
    "Phi": 0.222668390165885884674473185609,
    "delta": 0.487364979543842550225598953530,
    "Omega": -0.222668390165885884674473185609,
    "epsilon": 1.23054744454982119249735015568,
}
"""The consistent configuration at rest from which the test set starts (rad)."""


@public
def andrews() -> Mechanism:
    """Return Andrews' squeezing mechanism.

    Body 1 is the crank; body 2 turns on its end and carries the point P, in which bodies 3, 4 and 6 meet.
    Body 3 turns about B and is pulled by the spring to C; bodies 5 and 7 turn about A and carry bodies 4
    and 6. Six loop equations leave one degree of freedom. There is no gravity.

    Returns
    -------
    Mechanism
        With the angles ``beta``, ``Theta``, ``gamma``, ``Phi``, ``delta``, ``Omega``, ``epsilon`` and the input
        ``torque`` on the crank (N m), to be held at `TORQUE`.
    """
    tree = world()
    crank = tree.rz("beta", bodies=[_body(0, 0.00092, 0.0)])
    crank.tx(0.007).rz("Theta", bodies=[_body(1, -0.0115, 0.0)]).tx(-0.028, name="P")

    swing = tree.pose(translation=(*B, 0.0), name="B").rz("gamma", bodies=[_body(2, 0.01043, -0.01874)])
    swing.ty(-0.035, name="P3")
    swing.pose(translation=(0.02, -0.018, 0.0), name="D")

    pivot = tree.pose(translation=(*A, 0.0), name="A")
    upper = pivot.rz("delta", bodies=[_body(4, 0.02308, 0.00916)])
    upper.tx(0.04).rz("Phi", bodies=[_body(3, 0.0, -(0.02 - 0.01421))]).ty(-0.02, name="P4")
    lower = pivot.rz("epsilon", bodies=[_body(6, -0.00449, -0.01228)])
    lower.ty(-0.04).rz("Omega", bodies=[_body(5, 0.02 - 0.01421, 0.0)]).tx(0.02, name="P6")

    tree.pose(translation=(*C, 0.0), name="C")
    loops = [PointToPoint("P", f"P{body}", "xy", name=f"loop{body}") for body in (3, 4, 6)]
    return Mechanism(
        tree,
        [*loops, LinearSpring("D", "C", 4530.0, 0.07785, name="spring"), JointForce("beta", input="torque")],
        dynamic=list(START),
    )


@public
def start(mechanism: Mechanism) -> Array:
    """Return the configuration `START` of the mechanism that `andrews` returns, shape (nq,)."""
    return mechanism.configuration(START)


def _body(index: int, x: float, y: float) -> Body:
    """Return a body by its centre of mass; of its inertia only the part about z matters."""
    moment = INERTIAS[index]
    return Body(MASSES[index], com=(x, y, 0.0), inertia=(moment / 2.0, moment / 2.0, moment))
