"""Problems drawn by chance for `benchmarks.robustness --drawn SEED`: nothing was chosen with any of them in sight.

Every draw has a mechanism with other masses, a task, steps of time, weights and a start, each independent of the
others, whether or not they suit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.cases import Array
from benchmarks.robustness_further import (
    crane,
    elastic_arm,
    four_bar,
    furuta,
    gymnast,
    planar_quadrotor,
    wheel_pendulum,
)
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
    slider_crank,
    waves,
)
from leastaction.mechanics import Mechanism

__all__ = ["drawn"]

Wanted = Callable[[Array], dict[str, Array]]
Task = tuple[str, Callable[[], Mechanism], str, dict[str, float], Wanted, dict[str, Any]]


def _swing_up(name: str, m: Callable[[], Mechanism], variable: str) -> Callable[[np.random.Generator], Task]:
    return lambda rng: (name, m, "swing-up", {}, constant(**{variable: np.pi}), {"N": int(rng.integers(120, 240))})


def _cart(rng: np.random.Generator) -> Task:
    poles = int(rng.integers(1, 4))
    name, m = f"cart with {poles} poles", lambda: cart(poles)
    kind = rng.integers(3)
    if kind == 0 and poles < 3:
        return _swing_up(name, m, "pole0")(rng)
    if kind == 1:
        tilt = {f"pole{k}": float(rng.normal()) * 0.2 for k in range(poles)}
        tilt["pole0"] += np.pi
        return name, m, "balance", tilt, constant(pole0=np.pi), {}
    return name, m, "tracking", {}, waves(rng.uniform(1.0, 2.0), cart=rng.uniform(0.2, 1.0)), {}


def _double_pendulum(rng: np.random.Generator) -> Task:
    motor, other, name = (("elbow", "shoulder", "acrobot"), ("shoulder", "elbow", "pendubot"))[rng.integers(2)]
    m = lambda: double_pendulum(motor)  # noqa: E731
    if rng.integers(3):
        return _swing_up(name, m, "shoulder")(rng)
    tracked = motor if rng.integers(2) else other
    return name, m, f"tracking by the {tracked}", {}, waves(2.0, **{tracked: rng.uniform(0.5, 1.5)}), {"N": 200}


def _arm(rng: np.random.Generator) -> Task:
    n = int(rng.integers(2, 8))
    axes = "x" * n if n < 4 and rng.integers(2) else "".join(rng.choice(list("xyz"), n))
    goal = {f"joint{k}": float(rng.uniform(-2.0, 2.0)) for k in range(n)}
    name, m = f"arm {axes}", lambda: arm(axes)
    if rng.integers(3):
        return name, m, "reaching", {"joint1": 0.3}, constant(**goal), {"N": 100}
    return name, m, "tracking", {}, waves(rng.uniform(0.8, 2.0), **goal), {"N": 100}


def _quadrotor(rng: np.random.Generator) -> Task:
    flat = bool(rng.integers(2))
    m = planar_quadrotor if flat else quadrotor
    name, places = ("planar quadrotor", "yz") if flat else ("quadrotor", "xyz")
    goal = {place: float(rng.uniform(-3.0, 3.0)) for place in places}
    kind = rng.integers(3)
    if kind == 0:
        rest = {"roll": 0.1, **dict.fromkeys(places, 1.0)}
        return name, m, "flip", {}, constant(roll=2.0 * np.pi), {"N": 100, "Q": rest}
    if kind == 1:
        return name, m, "flight", {}, constant(**goal), {"N": 100}
    return name, m, "tracking", {}, waves(rng.uniform(1.5, 3.0), **{k: 0.3 * v for k, v in goal.items()}), {"N": 100}


def _puppet_arm(rng: np.random.Generator) -> Task:
    links = int(rng.integers(2, 4))
    at = rng.uniform([0.3, 0.3, 0.1], [0.7, 0.7, 0.5])[:links]
    to = {f"joint{k}": float(a + rng.uniform(-0.5, 0.5)) for k, a in enumerate(at)}
    name, m = f"puppet arm of {links}", lambda: puppet_arm(links)
    if rng.integers(2):
        return name, m, "reaching", hung(*at), constant(**to), {"N": 100}
    swing: Wanted = lambda t: {k: at[i] + (v - at[i]) * np.sin(2.5 * t) for i, (k, v) in enumerate(to.items())}  # noqa: E731
    return name, m, "tracking", hung(*at), swing, {"N": 100, "Q": 10.0}


def _slider_crank(rng: np.random.Generator) -> Task:
    turned = bool(rng.integers(4))
    start, turn = float(rng.uniform(0.2, 2.8)), float(rng.uniform(1.5, 9.0)) * rng.choice([-1.0, 1.0])
    name, m = "slider-crank" + "" if turned else "pushed slider-crank", lambda: slider_crank(turned)
    weight = {"N": 100, "Q": {"crank": float(rng.choice([0.1, 10.0]))}}
    if rng.integers(2):
        return name, m, "turn", {"crank": start}, constant(crank=start + turn), weight
    return name, m, "turning", {"crank": start}, lambda t: {"crank": start + turn * t / 2.0}, weight


def _chain(rng: np.random.Generator) -> Task:
    n, moved = int(rng.integers(2, 7)), str(rng.choice(["motors", "trolley", "pushed"]))
    name, m = f"chain of {n} ({moved})", lambda: chain(n, moved)
    if moved == "motors":
        if rng.integers(2):
            return name, m, "curling", {}, constant(**{f"link{k}": rng.uniform(0.3, 1.2) for k in range(n)}), {"N": 100}
        return name, m, "raising", {}, constant(link0=np.pi), {"N": 100}
    if moved == "pushed" and n < 4 and rng.integers(2):
        return _swing_up(name, m, "link0")(rng)
    if rng.integers(2):
        return name, m, "travel", {}, constant(trolley=float(rng.uniform(0.5, 2.5))), {}
    return name, m, "tracking", {}, waves(rng.uniform(1.2, 2.5), link0=rng.uniform(0.3, 0.8)), {"Q": 10.0}


def _others(rng: np.random.Generator) -> Task:
    which = rng.integers(7)
    if which < 3:
        return [
            _swing_up("furuta", furuta, "pole"),
            _swing_up("wheel pendulum", wheel_pendulum, "pole"),
            _swing_up("gymnast", gymnast, "hands"),
        ][which](rng)
    if which == 3:
        goal = {"cart": float(rng.uniform(-3.0, 3.0)), "hoist": float(rng.uniform(-1.5, -0.4))}
        return "crane", crane, "travel", {"hoist": -0.8}, constant(**goal), {}
    if which == 4:
        return "elastic arm", elastic_arm, "raising", {}, constant(motor0=np.pi), {"N": 120}
    if which == 5:
        turn = float(rng.uniform(2.0, 8.0))
        return "four-bar", four_bar, "turn", {"a": 0.5}, constant(a=0.5 + turn), {"Q": {"a": 0.1}}
    return "loaded planar quadrotor", lambda: planar_quadrotor(True), "flight", {}, constant(y=2.0, z=1.0), {}


_TASKS = (_cart, _double_pendulum, _arm, _quadrotor, _puppet_arm, _slider_crank, _chain, _others)


def _heavier(m: Callable[[], Mechanism], seed: int) -> Callable[[], Mechanism]:
    """Return a mechanism whose point masses are others."""

    def made() -> Mechanism:
        mechanism, rng = m(), np.random.default_rng(seed)
        masses = {k: v for k, v in mechanism.parameters.items() if k.endswith(".mass")}
        return mechanism.with_parameters({k: float(v) * float(np.exp(0.3 * rng.normal())) for k, v in masses.items()})

    return made


def drawn(seed: int, n: int = 40) -> list[Problem]:
    """Return problems drawn by a seed; each kind of mechanism equally often."""
    problems = []
    for i in range(n):
        rng = np.random.default_rng([seed, i])
        name, m, task, at, wanted, own = _TASKS[i % len(_TASKS)](rng)
        kind = str(rng.choice(["rest", "random", "line", "noise"]))
        chosen = {
            "Q": float(rng.choice([0.1, 1.0])),
            "final": float(rng.choice([1.0, 1e2, 1e4, 1e6])),
            "R": float(rng.choice([1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0])),
            "size": float(rng.choice([0.03, 0.1] if kind == "noise" else [0.3, 1.0, 3.0])),
            "dt": float(rng.choice([0.01, 0.02])),
            "seed": 1000 * seed + i,
            **own,
        }
        problems.append(named(name, _heavier(m, 1000 * seed + i), task, at, wanted, kind, **chosen))
    return problems
