"""A pendulum on a cart (dissertation 6.7.1)."""

from __future__ import annotations

from leastaction.mechanics import Damping, Element, Gravity, JointForce, Mechanism, rz, tx, ty
from leastaction.numerics.public import public


@public
def cart_pendulum(
    *,
    cart_mass: float = 10.0,
    bob_mass: float = 1.0,
    length: float = 1.0,
    damping: float = 0.01,
    pivot_torque: bool = False,
) -> Mechanism:
    """Return a cart that rolls along x with a point-mass pendulum on it.

    The pendulum hangs along -y at ``theta = 0`` and turns about z. The input ``x-force`` pushes the cart.

    Parameters
    ----------
    cart_mass, bob_mass : float, optional
        Masses (kg).
    length : float, optional
        Length of the pendulum (m).
    damping : float, optional
        Damping of both variables (N s/m and N m s/rad).
    pivot_torque : bool, optional
        Add a second input ``theta-force``, a torque at the pivot (N m).

    Returns
    -------
    Mechanism
        With the variables ``x`` and ``theta``, and the frames ``cart`` and ``bob``.
    """
    elements: list[Element] = [Gravity((0.0, -9.8, 0.0)), Damping(damping), JointForce("x", input="x-force")]
    if pivot_torque:
        elements.append(JointForce("theta", input="theta-force"))
    return Mechanism(
        [tx("x", name="cart", mass=cart_mass), [
            rz("theta"), [
                ty(-length, name="bob", mass=bob_mass),
            ],
        ]],
        elements,
    )  # fmt: skip
