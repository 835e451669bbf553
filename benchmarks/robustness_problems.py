"""Problems of trajectory optimisation that are to be solved from whatever start: mechanisms, tasks, weights, starts.

Each is a function of no arguments that builds a system, a cost and a start. None of them was chosen for being solved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from benchmarks.cases import Array
from leastaction.mechanics import (
    Body,
    BodyWrench,
    Damping,
    Distance,
    Element,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PointToPoint,
    project_configuration,
    world,
)
from leastaction.optimal import QuadraticCost
from leastaction.systems import MidpointSystem

__all__ = [
    "PROBLEMS", "QUICK", "Given", "Problem", "arm", "cart", "chain", "constant", "double_pendulum", "hung", "named",
    "posed", "puppet_arm", "quadrotor", "rod", "slider_crank", "waves",
]  # fmt: skip


@dataclass(frozen=True)
class Given:
    """What `optimize` is given: the system, the cost, and where to start."""

    system: MidpointSystem
    cost: QuadraticCost
    x: Array
    u: Array


@dataclass(frozen=True)
class Problem:
    """One problem: its name, what it is about, and the function that builds it."""

    name: str
    mechanism: str
    task: str
    start: str
    build: Callable[[], Given]


# ---- Mechanisms ---------------------------------------------------------------------------------


def rod(length: float, mass: float) -> Body:
    """Return a slender rod that points along -z."""
    across = mass * length**2 / 12.0
    return Body(mass, com=(0.0, 0.0, -0.5 * length), inertia=(across, across, 1e-3 * across))


@cache
def cart(poles: int = 1) -> Mechanism:
    """Return a cart that is pushed along y, with pendulums one behind the other."""
    place = world().ty("cart", mass=2.0)
    for k in range(poles):
        place = place.rx(f"pole{k}").tz(-0.8, name=f"bob{k}", mass=0.4)
    return Mechanism(place, [Gravity(), Damping(0.02), JointForce("cart", "push")])


@cache
def double_pendulum(actuated: str) -> Mechanism:
    """Return two rods with one motor: at the elbow an acrobot, at the shoulder a pendubot."""
    tree = world()
    shoulder = tree.rx("shoulder", bodies=[rod(1.0, 1.0)])
    shoulder.tz(-1.0).rx("elbow", bodies=[rod(0.8, 0.8)])
    return Mechanism(tree, [Gravity(), Damping(0.02), JointForce(actuated, "motor")])


@cache
def arm(axes: str) -> Mechanism:
    """Return an arm with a motor in every joint, hanging down."""
    place = world()
    elements: list[Element] = [Gravity(), Damping(0.05)]
    for k, axis in enumerate(axes):
        length, mass = 0.4, 1.5 / (1.0 + 0.3 * k)
        place = getattr(place, f"r{axis}")(
            f"joint{k}",
            bodies=[Body(mass, com=(0.02, 0.0, -0.5 * length), inertia=(0.03, 0.03, 0.01))],
        ).tz(-length, name=f"end{k}")
        elements.append(JointForce(f"joint{k}", f"motor{k}"))
    return Mechanism(place, elements)


@cache
def quadrotor() -> Mechanism:
    """Return a free body pushed by four propellers, each with the drag of its blades."""
    body = world().tx("x").ty("y").tz("z").rz("yaw").ry("pitch").rx("roll", name="hull")
    hull = body.tx(0.0, name="body", bodies=[Body(1.0, inertia=(0.02, 0.02, 0.035))])
    elements: list[Element] = [Gravity(), Damping(0.02)]
    for k, (x, y) in enumerate(((0.25, 0.0), (0.0, 0.25), (-0.25, 0.0), (0.0, -0.25))):
        hull.pose(translation=(x, y, 0.0), name=f"propeller{k}")
        thrust = f"thrust{k}"
        elements.append(BodyWrench(f"propeller{k}", force=(0.0, 0.0, thrust), name=thrust))
    return Mechanism(body, elements)


@cache
def puppet_arm(links: int) -> Mechanism:
    """Return a planar arm whose last links hang on strings that are reeled (lengths are kinematic)."""
    tree = world()
    place = tree
    for k in range(links):
        place = place.rx(f"joint{k}", bodies=[rod(0.4, 0.5)]).tz(-0.4, name=f"end{k}")
    elements: list[Element] = [Gravity(), Damping(0.05)]
    for k in range(1, links):
        tree.pose(translation=(0.0, *_HOOKS[k]), name=f"hook{k}")
        elements.append(Distance(f"end{k}", f"hook{k}", f"string{k}"))
    return Mechanism(tree, elements)


@cache
def slider_crank(torque: bool = True) -> Mechanism:
    """Return a crank that is turned, a rod, and a piston pushed by the rod's end."""
    tree = world()
    crank = tree.rx("crank", bodies=[rod(0.3, 1.0)]).tz(-0.3)
    crank.rx("rod", bodies=[rod(0.8, 0.8)]).tz(-0.8, name="pin")
    tree.tz("piston", name="piston", mass=1.0)
    driven = "crank" if torque else "piston"
    return Mechanism(
        tree,
        [
            Gravity((0.0, 9.81, 0.0)),
            Damping(0.05),
            PointToPoint("pin", "piston", "yz"),
            JointForce(driven, "drive"),
        ],
    )


@cache
def chain(links: int, moved: str) -> Mechanism:
    """Return a chain of pendulums: motors in all joints, or hung from a trolley that is moved or pushed."""
    tree = world()
    place = tree
    elements: list[Element] = [Gravity(), Damping(0.05)]
    if moved == "trolley":
        place = place.ty("trolley", kinematic=True)
    elif moved == "pushed":
        place = place.ty("trolley", mass=1.0)
        elements.append(JointForce("trolley", "push"))
    for k in range(links):
        place = place.rx(f"link{k}").tz(-0.5, mass=0.5)
        if moved == "motors":
            elements.append(JointForce(f"link{k}", f"motor{k}"))
    return Mechanism(tree, elements)


# ---- From a mechanism to a problem ----------------------------------------------------------------


def _at(m: Mechanism, values: dict[str, float]) -> Array:
    if m.nc and not m.nrho:  # a loop is closed by the variables that are not given
        held = {name: 1e3 if name in values else 1e-3 for name in m.variables}
        return np.asarray(project_configuration(m, m.configuration(values), weights=held).q)
    return np.asarray(m.configuration(values))


def hung(*angles: float) -> dict[str, float]:
    """Return joints of a puppet's arm with the lengths of its strings."""
    q = {f"joint{k}": angle for k, angle in enumerate(angles)}
    y, z = np.cumsum(0.4 * np.sin(np.cumsum(angles))), np.cumsum(-0.4 * np.cos(np.cumsum(angles)))
    for k in range(1, len(angles)):
        q[f"string{k}"] = float(np.hypot(y[k] - _HOOKS[k][0], z[k] - _HOOKS[k][1]))
    return q


_HOOKS = [(0.3 + 0.35 * k, 0.8) for k in range(4)]


def _start(kind: str, system: MidpointSystem, q0: Array, wanted: Array, seed: int, size: float) -> tuple[Array, Array]:
    """Return x, u of a start: "rest", "random" inputs, "line" (a straight line to the goal), "noise"."""
    m, N = system.integrator.mechanism, system.N
    rng = np.random.default_rng(seed)
    x = np.zeros((N + 1, m.nx))
    x[:, : m.nq] = q0
    u = np.zeros((N, m.nu + m.nrho))
    u[:, m.nu :] = q0[m.nd :]
    if kind == "rest":
        return x[0], u
    if kind == "random":
        knots = rng.normal(size=(8, m.nu + m.nrho)) * size
        for i in range(m.nu + m.nrho):
            share = 0.02 if i >= m.nu else 1.0
            u[:, i] += share * np.interp(np.linspace(0, 7, N), np.arange(8.0), knots[:, i])
        return x[0], u
    if kind == "line":
        share = np.linspace(0.0, 1.0, N + 1)[:, None]
        x[:, : m.nq] = (1.0 - share) * q0 + share * wanted[-1, : m.nq]
        return x, u
    if kind == "noise":
        x[1:, : m.nd] += rng.normal(size=(N, m.nd)) * size
        u[:, : m.nu] += rng.normal(size=(N, m.nu)) * size
        return x, u
    raise ValueError(kind)


def posed(
    m: Mechanism,
    q0: dict[str, float],
    wanted: Callable[[Array], dict[str, Array]],
    *,
    N: int,
    dt: float,
    Q: float | dict[str, float],
    final: float,
    R: float,
    kind: str,
    rates: float = 1e-2,
    seed: int = 0,
    size: float = 1.0,
) -> Given:
    t = dt * np.arange(N + 1)
    system = MidpointSystem(MidpointVI(m, threads=1), t)
    start = _at(m, q0)
    x_wanted = np.zeros((N + 1, m.nx))
    x_wanted[:, : m.nq] = start
    u_wanted = np.zeros((N, m.nu + m.nrho))
    u_wanted[:, m.nu :] = start[m.nd :]
    index = {name: i for i, name in enumerate(m.variables)}
    for name, values in wanted(t).items():
        x_wanted[:, index[name]] = values
    weight = np.full(m.nx, rates)
    weight[: m.nq] = 0.0 if isinstance(Q, dict) else Q
    weight[m.nd : m.nq] *= 1e-2
    if isinstance(Q, dict):
        for name, value in Q.items():
            weight[index[name]] = value
    last = np.full(m.nx, 0.1 * final)
    last[: m.nq] = [final * (weight[i] > 0.0) for i in range(m.nq)]
    last[m.nd : m.nq] = weight[m.nd : m.nq]
    last[m.nq + m.nd :] = weight[m.nq + m.nd :]
    cost = QuadraticCost(x_wanted, u_wanted, Q=weight, R=np.full(m.nu + m.nrho, R), Q_final=last)
    return Given(system, cost, *_start(kind, system, start, x_wanted, seed, size))


def constant(**values: float) -> Callable[[Array], dict[str, Array]]:
    return lambda t: {name: np.full(len(t), value) for name, value in values.items()}


def step_to(**values: float) -> Callable[[Array], dict[str, Array]]:
    """Return values that are asked for in the second half of the time."""
    return lambda t: {name: np.where(t > 0.5 * t[-1], value, 0.0) for name, value in values.items()}


def waves(period: float, **values: float) -> Callable[[Array], dict[str, Array]]:
    return lambda t: {
        name: value * np.sin(2.0 * np.pi * t / period * (1.0 + 0.3 * k))
        for k, (name, value) in enumerate(values.items())
    }


# ---- The problems ---------------------------------------------------------------------------------

PROBLEMS: list[Problem] = []
"""The first set: the weights and rules of the optimiser were chosen with it in sight."""


def named(
    mechanism: str,
    m: Callable[[], Mechanism],
    task: str,
    q0: dict[str, float],
    wanted: Callable[[Array], dict[str, Array]],
    kind: str,
    **options: Any,
) -> Problem:
    """Return the problem of a task with a mechanism, under a name that says how it is posed."""
    options = {"N": 150, "dt": 0.02, "Q": 1.0, "R": 1e-2, **options}
    options.setdefault("final", options["Q"] if isinstance(options["Q"], float) else 1.0)
    name = f"{mechanism}, {task}, R {options['R']:g}, final {options['final']:g}, {kind}"
    if "seed" in options:
        name += f" {options['seed']}"
    return Problem(name, mechanism, task, kind, lambda: posed(m(), q0, wanted, kind=kind, **options))


def _add(*what: Any, **options: Any) -> None:
    PROBLEMS.append(named(*what, **options))


_UP1 = constant(pole0=np.pi)
for _kind, _final, _R in (
    ("rest", 1.0, 1e-2),
    ("rest", 1e4, 1e-2),
    ("random", 1e6, 1e-2),
    ("random", 1e4, 1e-6),
    ("line", 1e4, 1e-1),
    ("noise", 1e2, 1.0),
):
    _add("cart", cart, "swing-up", {}, _UP1, _kind, final=_final, R=_R, Q=0.1)
_add("cart", cart, "swing-up on time", {}, step_to(pole0=np.pi), "rest", R=1e-4)
_add("cart", cart, "tracking", {}, waves(1.5, cart=0.5, pole0=1.5), "rest", R=1e-6, Q=10.0)
_add("cart", cart, "tracking", {}, waves(1.0, pole0=1.0), "noise", R=1e-2, Q=100.0, size=0.3)

_UP2 = constant(pole0=np.pi)
for _kind, _final, _R in (
    ("rest", 10.0, 1e-2),
    ("random", 1e4, 1e-2),
    ("line", 1e4, 1e-3),
    ("random", 1e6, 1e-4),
):
    _add(
        "double cart",
        lambda: cart(2),
        "swing-up",
        {},
        _UP2,
        _kind,
        final=_final,
        R=_R,
        Q=0.1,
        N=200,
    )
_add(
    "double cart",
    lambda: cart(2),
    "balance",
    {"pole0": np.pi - 0.3, "pole1": 0.2},
    _UP2,
    "rest",
    Q=1.0,
    final=100.0,
)
_add("double cart", lambda: cart(2), "tracking", {}, waves(1.6, cart=0.6), "rest", R=1e-6, Q=10.0)

for _motor, _name in (("elbow", "acrobot"), ("shoulder", "pendubot")):
    for _kind, _final, _R, _seed in (
        ("rest", 1e2, 1e-2, 0),
        ("random", 1e4, 1e-2, 1),
        ("random", 1e6, 1e-3, 2),
        ("line", 1e4, 1e-1, 0),
        ("noise", 1e2, 1e-2, 3),
    ):
        _add(
            _name,
            lambda motor=_motor: double_pendulum(motor),
            "swing-up",
            {},
            constant(shoulder=np.pi),
            _kind,
            final=_final,
            R=_R,
            Q=0.1,
            N=200,
            seed=_seed,
            size=0.3 if _kind == "noise" else 2.0,
        )
_add(
    "acrobot",
    lambda: double_pendulum("elbow"),
    "tracking",
    {},
    waves(2.0, elbow=1.0),
    "rest",
    R=1e-6,
    Q=10.0,
)
_add(
    "pendubot",
    lambda: double_pendulum("shoulder"),
    "tracking",
    {},
    waves(2.0, shoulder=1.0),
    "rest",
    R=1e2,
    Q=10.0,
)

_REACH = {"joint0": 1.2, "joint1": -0.8, "joint2": 0.9}
for _kind, _final, _R in (
    ("rest", 1e4, 1e-2),
    ("random", 1e6, 1e-6),
    ("line", 1e6, 1e-2),
    ("noise", 1e2, 1e-4),
):
    _add(
        "planar arm",
        lambda: arm("xxx"),
        "reaching",
        {},
        constant(**_REACH),
        _kind,
        final=_final,
        R=_R,
        Q=0.1,
        N=100,
    )
_add(
    "planar arm",
    lambda: arm("xxx"),
    "raising",
    {},
    constant(joint0=np.pi),
    "rest",
    final=1e4,
    R=1.0,
    Q=0.01,
    N=100,
)
_add(
    "planar arm",
    lambda: arm("xxx"),
    "tracking",
    {},
    waves(1.0, joint0=0.8, joint1=0.8, joint2=0.5),
    "rest",
    R=1e-6,
    Q=10.0,
    N=100,
)

_FAR = {"joint0": 1.0, "joint1": 1.5, "joint2": -1.0, "joint3": 0.7, "joint4": 1.0}
for _kind, _final, _R in (
    ("rest", 1e4, 1e-2),
    ("random", 1e4, 1e-4),
    ("line", 1e6, 1e-6),
    ("noise", 1e4, 1e-2),
):
    _add(
        "spatial arm",
        lambda: arm("zyyxy"),
        "reaching",
        {"joint1": 0.3},
        constant(**_FAR),
        _kind,
        final=_final,
        R=_R,
        Q=0.1,
        N=100,
    )
_add(
    "spatial arm",
    lambda: arm("zyyxy"),
    "tracking",
    {"joint1": 0.3},
    waves(1.2, joint0=1.0, joint1=0.8, joint3=0.6),
    "rest",
    R=1e-3,
    Q=10.0,
    N=100,
)
_add(
    "7-joint arm",
    lambda: arm("zyzyzyz"),
    "raising",
    {"joint1": 0.3},
    constant(joint1=2.6, joint3=0.5),
    "rest",
    R=1e-2,
    Q=0.1,
    final=1e4,
    N=100,
)
_add(
    "7-joint arm",
    lambda: arm("zyzyzyz"),
    "raising",
    {"joint1": 0.3},
    constant(joint1=2.6, joint3=0.5),
    "random",
    R=1e-3,
    Q=0.1,
    final=1e4,
    N=100,
    seed=4,
)

for _kind, _final, _R in (
    ("rest", 1e2, 1e-1),
    ("random", 1e4, 1e-2),
    ("line", 1e6, 1e-1),
    ("noise", 1e2, 1e-2),
):
    _add(
        "quadrotor",
        quadrotor,
        "flight",
        {},
        constant(x=2.0, y=-1.0, z=1.0, yaw=1.0),
        _kind,
        final=_final,
        R=_R,
        Q=0.1,
        N=100,
        size=0.2 if _kind == "noise" else 1.0,
    )
_add(
    "quadrotor",
    quadrotor,
    "flip",
    {},
    constant(roll=2.0 * np.pi),
    "rest",
    final=1e4,
    R=1e-2,
    Q={"roll": 0.1, "x": 1.0, "y": 1.0, "z": 1.0},
    N=100,
)
_add(
    "quadrotor",
    quadrotor,
    "tracking",
    {},
    waves(2.0, x=1.0, y=1.0, z=0.3),
    "rest",
    R=1e-6,
    Q=10.0,
    N=100,
)

_HANG2 = hung(0.6, 0.5)
for _kind, _R, _size in (
    ("rest", 1e-2, 1.0),
    ("rest", 1e-6, 1.0),
    ("random", 1e-3, 1.0),
    ("noise", 1e-2, 0.05),
):
    _add(
        "puppet arm",
        lambda: puppet_arm(2),
        "tracking",
        _HANG2,
        lambda t: {"joint0": 0.6 + 0.4 * np.sin(2 * t), "joint1": 0.5 + 0.5 * np.sin(3 * t)},
        _kind,
        R=_R,
        Q=10.0,
        size=_size,
        N=100,
    )
for _kind, _final in (("rest", 1e2), ("line", 1e4), ("random", 1e4)):
    _add(
        "puppet arm of 3",
        lambda: puppet_arm(3),
        "reaching",
        hung(0.6, 0.5, 0.3),
        constant(joint0=0.3, joint1=0.9, joint2=0.6),
        _kind,
        R=1e-2,
        Q=1.0,
        final=_final,
        N=100,
    )

_CLOSED = {"crank": 0.5}
for _kind, _R, _final in (
    ("rest", 1e-2, 1e2),
    ("random", 1e-4, 1e4),
    ("line", 1e-2, 1e4),
    ("noise", 1e-1, 1.0),
):
    _add(
        "slider-crank",
        slider_crank,
        "half a turn",
        _CLOSED,
        constant(crank=0.5 + np.pi),
        _kind,
        R=_R,
        final=_final,
        Q={"crank": 0.1},
        N=100,
        size=0.1 if _kind == "noise" else 1.0,
    )
_add(
    "slider-crank",
    slider_crank,
    "turning",
    _CLOSED,
    lambda t: {"crank": 0.5 + 4.0 * t},
    "rest",
    R=1e-6,
    Q={"crank": 10.0},
    N=100,
)
_add(
    "slider-crank",
    lambda: slider_crank(False),
    "pushed over",
    _CLOSED,
    constant(crank=0.5 - np.pi),
    "rest",
    R=1e-2,
    final=1e2,
    Q={"crank": 1.0},
    N=100,
)

_add(
    "chain of 4",
    lambda: chain(4, "trolley"),
    "travel",
    {},
    constant(trolley=1.5),
    "rest",
    R=1.0,
    final=1e4,
    Q={"link0": 1.0, "link1": 1.0, "link2": 1.0, "link3": 1.0, "trolley": 1.0},
)
_add(
    "chain of 4",
    lambda: chain(4, "trolley"),
    "tracking",
    {},
    waves(1.5, link0=0.5, link3=0.5),
    "rest",
    R=1e-2,
    Q=10.0,
)
_add(
    "chain of 4",
    lambda: chain(4, "motors"),
    "curling",
    {},
    constant(link0=1.0, link1=1.0, link2=1.0, link3=1.0),
    "random",
    R=1e-2,
    final=1e4,
    Q=0.1,
    N=100,
)
_add(
    "chain of 4",
    lambda: chain(4, "motors"),
    "raising",
    {},
    constant(link0=np.pi),
    "line",
    R=1e-3,
    final=1e4,
    Q=0.1,
    N=100,
)
_add(
    "chain of 3",
    lambda: chain(3, "pushed"),
    "swing-up",
    {},
    constant(link0=np.pi),
    "random",
    R=1e-3,
    final=1e4,
    Q=0.1,
    N=200,
    seed=5,
)
_add(
    "chain of 3",
    lambda: chain(3, "pushed"),
    "travel",
    {},
    constant(trolley=2.0),
    "noise",
    R=1e-2,
    final=1e6,
    Q=1.0,
    size=0.1,
)
_add(
    "chain of 8",
    lambda: chain(8, "motors"),
    "waves",
    {},
    waves(1.0, link0=0.5, link3=0.8, link7=1.0),
    "rest",
    R=1e-6,
    Q=10.0,
    N=80,
)
_add(
    "chain of 8",
    lambda: chain(8, "motors"),
    "raising",
    {},
    constant(link0=np.pi),
    "rest",
    R=1e-2,
    final=1e4,
    Q=0.1,
    N=80,
)

QUICK: tuple[str, ...] = ("cart", "acrobot", "slider-crank", "puppet arm")
"""The mechanisms of a quick run."""
