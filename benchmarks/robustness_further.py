"""A second set of problems for `benchmarks.robustness`: other mechanisms, and harder starts of the same ones.

None of them was in sight when the optimiser's rules were first chosen: with those, 31 of 53 ended in a minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from benchmarks.robustness_problems import (
    Problem,
    arm,
    cart,
    chain,
    constant,
    double_pendulum,
    hung,
    named,
    puppet_arm,
    quadrotor,
    rod,
    slider_crank,
    waves,
)
from leastaction.mechanics import (
    Body,
    BodyWrench,
    Damping,
    Distance,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    PointToPoint,
    world,
)

__all__ = ["FURTHER"]


# ---- Mechanisms ---------------------------------------------------------------------------------


@cache
def furuta() -> Mechanism:
    """Return a pendulum at the end of an arm that a motor turns about the vertical."""
    tree = world()
    swivel = tree.rz("arm", bodies=[Body(0.5, com=(0.15, 0.0, 0.0), inertia=(1e-3, 5e-3, 5e-3))]).tx(0.3)
    swivel.rx("pole", bodies=[rod(0.5, 0.3)])
    return Mechanism(tree, [Gravity(), Damping(0.01), JointForce("arm", "motor")])


@cache
def wheel_pendulum() -> Mechanism:
    """Return a pendulum with a motor that turns a wheel at its end."""
    tree = world()
    tree.rx("pole", bodies=[rod(0.5, 0.5)]).tz(-0.5).rx("wheel", bodies=[Body(0.5, inertia=(2e-3, 1e-3, 1e-3))])
    return Mechanism(tree, [Gravity(), Damping(0.005), JointForce("wheel", "motor")])


@cache
def gymnast() -> Mechanism:
    """Return three rods that hang from a bar, with motors at shoulders and hips but none at the hands."""
    tree = world()
    shoulders = tree.rx("hands", bodies=[rod(0.6, 1.0)]).tz(-0.6).rx("shoulders", bodies=[rod(0.6, 2.0)])
    shoulders.tz(-0.6).rx("hips", bodies=[rod(0.8, 1.5)])
    motors = [JointForce("shoulders", "shoulder motor"), JointForce("hips", "hip motor")]
    return Mechanism(tree, [Gravity(), Damping(0.02), *motors])


@cache
def planar_quadrotor(load: bool = False) -> Mechanism:
    """Return a body in a plane on two thrusts; with a load that hangs from it, if asked for."""
    place = world().ty("y").tz("z")
    hull = place.rx("roll", name="hull")
    hull.tx(0.0, name="body", bodies=[Body(1.0, inertia=(0.02, 0.02, 0.035))])
    elements: list[Element] = [Gravity(), Damping(0.02)]
    for k, side in enumerate((0.25, -0.25)):
        hull.pose(translation=(0.0, side, 0.0), name=f"propeller{k}")
        elements.append(BodyWrench(f"propeller{k}", force=(0.0, 0.0, f"thrust{k}"), name=f"thrust{k}"))
    if load:
        place.rx("swing").tz(-0.7, mass=0.3)
    return Mechanism(place, elements)


@cache
def crane() -> Mechanism:
    """Return a cart that is pushed, with a load on a winch."""
    tree = world()
    tree.ty("cart", mass=2.0).rx("swing").tz("hoist", name="load", mass=1.0)
    return Mechanism(tree, [Gravity(), Damping(0.05), JointForce("cart", "push"), JointForce("hoist", "winch")])


@cache
def elastic_arm() -> Mechanism:
    """Return two links, each behind a spring that a motor turns."""
    tree = world()
    place = tree
    elements: list[Element] = [Gravity(), Damping(0.02)]
    for k in range(2):
        motor = place.rx(f"motor{k}", bodies=[Body(0.05, inertia=(0.01, 0.01, 0.01))])
        place = motor.rx(f"link{k}", bodies=[rod(0.5, 1.0 / (k + 1))]).tz(-0.5)
        elements += [JointSpring(f"link{k}", stiffness=50.0), JointForce(f"motor{k}", f"torque{k}")]
    return Mechanism(tree, elements)


@cache
def four_bar() -> Mechanism:
    """Return a four-bar linkage whose first bar is driven."""
    tree = world()
    tree.rx("a", bodies=[rod(0.3, 0.5)]).tz(-0.3).rx("b", bodies=[rod(0.9, 0.8)]).tz(-0.9, name="tip")
    tree.ty(0.8).rx("c", bodies=[rod(0.7, 0.8)]).tz(-0.7, name="end")
    return Mechanism(tree, [Gravity(), Damping(0.05), PointToPoint("tip", "end", "yz"), JointForce("a", "drive")])


@cache
def bob_on_rope() -> Mechanism:
    """Return a cart and a bob in Cartesian coordinates, tied by a rope of constant length."""
    tree = world()
    tree.ty("cart", mass=1.0, name="cart")
    tree.ty("bob y").tz("bob z", name="bob", mass=0.5)
    return Mechanism(tree, [Gravity(), Damping(0.02), Distance("cart", "bob", 0.6), JointForce("cart", "push")])


@cache
def spherical_pendulum(*, pushed: bool) -> Mechanism:
    """Return a spherical pendulum in a hand: a mass that forces push, or one whose place is prescribed."""
    if pushed:
        hand = world().tx("x").ty("y", name="hand", mass=1.0)
        forces: list[Element] = [JointForce("x", "fx"), JointForce("y", "fy")]
    else:
        hand = world().tx("x", kinematic=True).ty("y", kinematic=True)
        forces = []
    return Mechanism(hand.rx("a").ry("b").tz(-0.6, mass=0.4), [Gravity(), Damping(0.02), *forces])


# ---- The problems -------------------------------------------------------------------------------

FURTHER: list[Problem] = []


def _add(
    mechanism: str,
    m: Callable[[], Mechanism],
    task: str,
    wanted: dict[str, float] | Callable[[Any], Any],
    *kinds: tuple[str, dict[str, Any]],
    at: dict[str, float] | None = None,
    **options: Any,
) -> None:
    """Add a problem for each kind of start, with options of its own."""
    motion = constant(**wanted) if isinstance(wanted, dict) else wanted
    for kind, own in kinds:
        FURTHER.append(named(mechanism, m, task, at or {}, motion, kind, **{**options, **own}))


_UP = {"pole": np.pi}
_add(
    "furuta", furuta, "swing-up", _UP,
    ("rest", {"final": 1e4, "R": 1e-2}),
    ("random", {"final": 1e6, "R": 1e-4, "seed": 1}),
    ("line", {"final": 1e4, "R": 1e-1}),
    ("random", {"final": 1e2, "R": 1e-6, "seed": 7, "size": 0.2}),
    Q=0.1,
)  # fmt: skip
_add(
    "wheel pendulum", wheel_pendulum, "swing-up", _UP,
    ("rest", {"final": 1e4, "R": 1e-1}),
    ("random", {"final": 1e6, "R": 1e-2, "seed": 3}),
    ("line", {"final": 1e2, "R": 1.0}),
    Q={"pole": 0.1},
)  # fmt: skip
_add(
    "gymnast", gymnast, "swing-up", {"hands": np.pi},
    ("rest", {"final": 1e4, "R": 1e-3}),
    ("random", {"final": 1e4, "R": 1e-2, "seed": 1, "size": 3.0}),
    ("line", {"final": 1e6, "R": 1e-3}),
    Q=0.1, N=200,
)  # fmt: skip
_add(
    "planar quadrotor", planar_quadrotor, "flip", {"roll": 2.0 * np.pi},
    ("rest", {"final": 1e4, "R": 1e-3}),
    Q={"roll": 0.1, "y": 1.0, "z": 1.0}, N=100,
)  # fmt: skip
_add(
    "planar quadrotor", planar_quadrotor, "flight", {"y": 3.0, "z": 2.0},
    ("random", {"final": 1e6, "R": 1e-2, "seed": 2, "size": 3.0}),
    Q=0.1, N=100,
)  # fmt: skip
_LOADED = ("planar quadrotor with load", lambda: planar_quadrotor(True))
_add(*_LOADED, "flight", {"y": 3.0, "z": 1.0}, ("rest", {}), final=1e4, Q=0.1)
_add(*_LOADED, "load up", {"swing": np.pi}, ("random", {"seed": 5, "size": 2.0}), final=1e4, Q=0.1)
_add(
    "crane", crane, "travel", {"cart": 2.0, "hoist": -0.5},
    ("rest", {"final": 1e4, "R": 1e-3}),
    ("line", {"final": 1e6, "R": 1e-1}),
    at={"hoist": -0.8},
)  # fmt: skip
_add(
    "elastic arm", elastic_arm, "raising", {"motor0": np.pi},
    ("rest", {"R": 1e-2}),
    ("random", {"R": 1e-4, "seed": 1, "size": 3.0}),
    Q=0.1, final=1e4,
)  # fmt: skip
_add(
    "four-bar", four_bar, "a turn", {"a": 0.5 + 2.0 * np.pi},
    ("rest", {"final": 1e2, "R": 1e-2}),
    ("random", {"final": 1e4, "R": 1e-3, "seed": 1}),
    at={"a": 0.5}, Q={"a": 0.1},
)  # fmt: skip
_add(
    "triple cart", lambda: cart(3), "swing-up", {"pole0": np.pi},
    ("rest", {"final": 1e2, "R": 1e-3}),
    ("random", {"final": 1e4, "R": 1e-2, "seed": 3}),
    Q=0.1, N=200,
)  # fmt: skip
_add(
    "triple cart", lambda: cart(3), "balance", {"pole0": np.pi}, ("rest", {}),
    at={"pole0": np.pi - 0.1, "pole1": 0.1}, final=1e2,
)  # fmt: skip
_add(
    "bob on a rope", bob_on_rope, "tracking", waves(1.5, cart=0.6), ("rest", {}),
    at={"bob z": -0.6}, Q={"cart": 10.0}, R=1e-6,
)  # fmt: skip
_add(
    "spherical pendulum", lambda: spherical_pendulum(pushed=True), "swing-up", {"a": np.pi},
    ("rest", {"R": 1e-2}),
    ("random", {"R": 1e-3, "seed": 2}),
    final=1e4, Q=0.1,
)  # fmt: skip
_HAND = ("spherical pendulum in a hand", lambda: spherical_pendulum(pushed=False))
_add(*_HAND, "swing", waves(1.2, a=0.8, b=0.5), ("rest", {}), Q=10.0)
_add(*_HAND, "over", {"a": np.pi}, ("random", {"seed": 1}), R=1e-1, Q=0.1, final=1e4)
for _motor, _name, _R in (("elbow", "acrobot", 1e-3), ("shoulder", "pendubot", 1e-6)):
    _add(
        _name, lambda motor=_motor: double_pendulum(motor), "swing-up", {"shoulder": np.pi},
        *[("random", {"seed": seed}) for seed in (11, 12, 13)],
        R=_R, final=1e6, Q=0.1, N=200, size=2.0,
    )  # fmt: skip
_add(
    "chain of 3", lambda: chain(3, "pushed"), "swing-up", {"link0": np.pi},
    ("random", {"R": 1e-3, "final": 1e4, "seed": 6}),
    ("random", {"R": 1e-3, "final": 1e4, "seed": 7}),
    ("rest", {"R": 1e-2, "final": 1e2}),
    Q=0.1, N=200,
)  # fmt: skip
_ARM6 = ("6-joint arm", lambda: arm("zyyxyx"))
_add(*_ARM6, "raising", {"joint1": 2.8, "joint2": 0.5}, ("rest", {}), at={"joint1": 0.3}, Q=0.1, final=1e4, N=100)
_add(
    *_ARM6, "reaching", {"joint0": 1.5, "joint1": 2.0, "joint2": -1.5, "joint4": 1.0},
    ("random", {"R": 1e-3, "final": 1e6, "seed": 3}),
    ("line", {"R": 1e-6, "final": 1e4}),
    at={"joint1": 0.3}, Q=0.1, N=100,
)  # fmt: skip
_ARM7 = ("7-joint arm", lambda: arm("zyzyzyz"))
_add(
    *_ARM7, "raising", {"joint1": 2.6, "joint3": 0.5},
    ("random", {"R": 1e-2, "final": 1e4, "seed": 8, "size": 3.0}),
    ("line", {"R": 1e-4, "final": 1e6}),
    at={"joint1": 0.3}, Q=0.1, N=100,
)  # fmt: skip
_add(
    *_ARM7, "reaching", {"joint1": 1.2, "joint3": 1.0, "joint5": -0.7},
    ("noise", {"seed": 8, "size": 0.1}),
    at={"joint1": 0.3}, Q=0.1, final=1e4, N=100,
)  # fmt: skip
_add(
    "chain of 6", lambda: chain(6, "motors"), "raising", {"link0": np.pi},
    ("rest", {"R": 1e-2, "final": 1e4, "N": 80}),
    ("random", {"R": 1e-3, "final": 1e2, "N": 120, "seed": 4}),
    Q=0.1,
)  # fmt: skip
_add(
    "chain of 8", lambda: chain(8, "motors"), "curling", {f"link{k}": 0.6 for k in range(8)},
    ("rest", {"R": 1e-4, "final": 1e4}),
    Q=0.1, N=80,
)  # fmt: skip
_add(
    "chain of 5", lambda: chain(5, "trolley"), "swing", {"trolley": 1.0, "link0": 0.0},
    ("random", {"seed": 2}),
    final=1e4,
)  # fmt: skip
_add(
    "quadrotor", quadrotor, "flight", {"x": -2.0, "y": 2.0, "z": 3.0, "yaw": -2.0},
    ("random", {"R": 1e-3, "seed": 9, "size": 3.0}),
    final=1e6, Q=0.1, N=100,
)  # fmt: skip
_add(
    "quadrotor", quadrotor, "flip", {"roll": 2.0 * np.pi},
    ("random", {"R": 1e-1, "seed": 3}),
    final=1e4, Q={"roll": 0.1, "x": 1.0, "y": 1.0, "z": 1.0}, N=100,
)  # fmt: skip
_add(
    "puppet arm of 3", lambda: puppet_arm(3), "reaching", {"joint0": 0.2, "joint1": 1.2, "joint2": 0.3},
    ("noise", {"R": 1e-4, "size": 0.02}),
    at=hung(0.6, 0.5, 0.3), final=1e4, N=100,
)  # fmt: skip
_add(
    "slider-crank", slider_crank, "two turns", {"crank": 0.5 + 4.0 * np.pi},
    ("rest", {"R": 1e-3}),
    at={"crank": 0.5}, final=1e4, Q={"crank": 0.1}, N=100,
)  # fmt: skip
_add(
    "cart", cart, "swing-up", {"pole0": np.pi},
    ("random", {"R": 1e-1, "seed": 21, "size": 5.0}),
    final=1e6, Q=0.1,
)  # fmt: skip
_add(
    "double cart", lambda: cart(2), "swing-up", {"pole0": np.pi},
    ("random", {"R": 1e-6, "seed": 22, "size": 3.0}),
    final=1e4, Q=0.1, N=200,
)  # fmt: skip
