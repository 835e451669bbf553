"""Kinds of problems that `benchmarks.robustness_drawn` does not draw: springs, prescribed sliders, turns of any size.

Written as a stranger would, without a look at what converges. A body's angles that pass where two of its axes are
parallel, and swing-ups whose motor costs next to nothing (they want impulses), are among them.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np

from benchmarks.cases import Array
from benchmarks.robustness_problems import (
    Problem,
    arm,
    constant,
    double_pendulum,
    named,
    quadrotor,
    rod,
)
from leastaction.mechanics import (
    Body,
    BodyWrench,
    Damping,
    Distance,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    world,
)

__all__ = ["OTHERS"]


# ---- Mechanisms ---------------------------------------------------------------------------------


@cache
def sprung_carts() -> Mechanism:
    """Return a cart on a spring, and one with a pendulum, both pushed."""
    tree = world()
    tree.ty("a", mass=1.0)
    tree.ty("c", mass=0.5).rx("pole").tz(-0.7, mass=0.3)
    forces = [JointForce("a", "push a"), JointForce("c", "push c")]
    return Mechanism(tree, [Gravity(), Damping(0.05), JointSpring("a", stiffness=30.0), *forces])


@cache
def pogo() -> Mechanism:
    """Return a leg that a spring and a motor stretch, on a hip with a motor."""
    tree = world()
    tree.rx("lean", bodies=[rod(0.3, 0.5)]).tz("leg").tz(0.0, mass=2.0, name="body")
    motors = [JointForce("leg", "push"), JointForce("lean", "torque")]
    return Mechanism(tree, [Gravity(), Damping(0.1), JointSpring("leg", stiffness=200.0), *motors])


@cache
def sprung_double_pendulum(actuated: str) -> Mechanism:
    """Return two rods with a spring at the elbow, dampers and one motor."""
    tree = world()
    tree.rx("shoulder", bodies=[rod(1.0, 1.0)]).tz(-1.0).rx("elbow", bodies=[rod(0.8, 0.8)])
    spring = JointSpring("elbow", stiffness=5.0)
    return Mechanism(tree, [Gravity(), Damping(0.2), spring, JointForce(actuated, "motor")])


@cache
def poles_on_sliders(axes: str, poles: int) -> Mechanism:
    """Return pendulums one behind the other on sliders along these axes, whose motion is prescribed."""
    place = world()
    for axis in axes:
        place = getattr(place, f"t{axis}")(f"slider {axis}", kinematic=True)
    for k in range(poles):
        place = place.rx(f"pole{k}").tz(-0.5, mass=0.4)
    return Mechanism(place, [Gravity(), Damping(0.02)])


@cache
def carried_load() -> Mechanism:
    """Return a mass that hangs by a rope from a hook whose motion is prescribed."""
    tree = world()
    tree.ty("hook y", kinematic=True).tz("hook z", kinematic=True, name="hook")
    tree.tx("x").ty("y").tz("z", mass=1.0, name="load")
    return Mechanism(tree, [Gravity(), Damping(0.05), Distance("hook", "load", 1.0)])


@cache
def elastic_rope() -> Mechanism:
    """Return a cart that is pushed, and a bob that hangs from it by a spring."""
    tree = world()
    tree.ty("cart", mass=1.0, name="cart")
    tree.ty("y").tz("z", mass=0.5, name="bob")
    rope = LinearSpring("cart", "bob", 100.0, 0.6)
    return Mechanism(tree, [Gravity(), Damping(0.05), rope, JointForce("cart", "push")])


@cache
def pushed_body() -> Mechanism:
    """Return a free body under three forces and three torques."""
    hull = world().tx("x").ty("y").tz("z").rz("yaw").ry("pitch").rx("roll", name="hull")
    hull.tx(0.0, name="body", bodies=[Body(1.0, inertia=(0.02, 0.03, 0.04))])
    wrench = BodyWrench("body", force=("fx", "fy", "fz"), torque=("tx", "ty", "tz"))
    return Mechanism(hull, [Gravity(), Damping(0.02), wrench])


# ---- The problems -------------------------------------------------------------------------------

OTHERS: list[Problem] = []


def _add(*what: Any, **options: Any) -> None:
    OTHERS.append(named(*what, **options))


def _carried(t: Array) -> dict[str, Array]:
    return {"y": 0.8 * np.sin(3.0 * t), "x": 0.3 * np.sin(2.0 * t), "z": np.full(len(t), -1.0)}


_UP = constant(shoulder=np.pi)
for _name, _motor in (("acrobot", "elbow"), ("pendubot", "shoulder")):
    _plain = partial(double_pendulum, _motor)
    _sprung = partial(sprung_double_pendulum, _motor)
    for _kind, _N, _seed in (("rest", 150, 0), ("random", 200, 1), ("line", 250, 0), ("noise", 200, 3)):
        _hard: dict[str, Any] = {"final": 1e6, "R": 1e-6, "N": _N, "Q": 0.1, "seed": _seed}
        _add(_name, _plain, "swing-up", {}, _UP, _kind, size=0.1 if _kind == "noise" else 1.0, **_hard)
    _add(f"sprung {_name}", _sprung, "swing-up", {}, _UP, "random", final=1e6, R=1e-4, N=200, Q=0.1, seed=5)

_TURN = {"x": 0.1, "y": 0.1, "z": 0.1, "roll": 1.0, "pitch": 0.1, "yaw": 1.0}
_FLIP, _OVER = constant(roll=2.0 * np.pi, yaw=2.5, x=2.0, z=1.0), constant(pitch=np.pi, z=2.0)
for _kind in ("rest", "random", "line", "noise"):
    _small: dict[str, Any] = {"N": 100, "size": 0.1}
    _add("quadrotor", quadrotor, "flip and yaw", {}, _FLIP, _kind, Q=_TURN, R=1e-3, final=1e6, seed=1, **_small)
    _add("quadrotor", quadrotor, "over", {}, _OVER, _kind, Q=_TURN | {"pitch": 1.0}, final=1e4, seed=2, **_small)
_FAR = constant(x=5.0, y=-4.0, z=3.0, yaw=3.0, roll=2.5)
_THROUGH = constant(x=1.0, pitch=3.0, roll=1.0)
_add("pushed body", pushed_body, "far", {}, _FAR, "line", R=1e-3, final=1e6, N=100)
_add("pushed body", pushed_body, "over", {}, _THROUGH, "line", R=1e-3, final=1e6, N=100)
_add("pushed body", pushed_body, "over", {}, _THROUGH, "rest", R=1e-6, final=1e4, N=100)

_TURNS = {f"joint{k}": angle for k, angle in enumerate((4.0, -2.5, 3.0, -4.0, 2.0, 3.5, -3.0))}
_RAISED = constant(joint0=3.0, joint1=np.pi, joint2=0.0)
for _kind, _R in (("rest", 1e-6), ("line", 1e-3), ("noise", 1e-1), ("random", 1.0)):
    _bent: dict[str, Any] = {"N": 100, "R": _R, "final": 1e6, "seed": 4, "size": 0.3}
    _add("arm zyxzyxz", partial(arm, "zyxzyxz"), "far", {"joint1": 0.3}, constant(**_TURNS), _kind, **_bent)
    _add("arm zxx", partial(arm, "zxx"), "raising", {"joint1": 0.3}, _RAISED, _kind, **_bent)

for _kind, _R in (("rest", 1e-6), ("random", 1e-2), ("line", 1.0), ("noise", 1e-4)):
    _how: dict[str, Any] = {"R": _R, "seed": 3, "final": 1e4}
    for _name, _axes, _poles, _at in (
        ("pole on a slider", "y", 1, 0.0),
        ("two poles on a slider", "y", 2, 0.0),
        ("pole on a lift", "z", 1, 0.1),
        ("two poles on a cross slide", "yz", 2, 0.0),
    ):
        _on = partial(poles_on_sliders, _axes, _poles)
        _add(_name, _on, "swing-up", {"pole0": _at}, constant(pole0=np.pi), _kind, Q=0.1, N=200, size=0.1, **_how)
    _add("load", carried_load, "carried", {"z": -1.0}, _carried, _kind, Q=10.0, N=100, size=0.03, **_how)
    _add("elastic rope", elastic_rope, "over", {"z": -0.65}, constant(y=0.3, z=0.65), _kind, Q=0.1, size=0.1, **_how)
    _how["final"] = 1e6
    _leant = constant(lean=np.pi / 2.0, leg=0.6)
    _add("pogo", pogo, "leaning", {"leg": 0.1}, _leant, _kind, Q=0.1, size=0.1, **_how)
    _swung = constant(pole=np.pi, a=0.5)
    _add("sprung carts", sprung_carts, "swing-up", {}, _swung, _kind, Q=0.1, size=0.3, **_how)
