"""A run that is stopped and goes on is the run that was never stopped, to the last bit."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction.io.results import load_result, save_result
from leastaction.mechanics import (
    Damping,
    Gravity,
    JointForce,
    JointSpring,
    Mechanism,
    MidpointVI,
    rx,
    tx,
    ty,
    tz,
)
from leastaction.optimal import (
    Bound,
    ContinuousQuadraticCost,
    Equal,
    FinalTime,
    LinearContinuousSystem,
    OptimizationResult,
    Periodic,
    QuadraticCost,
    optimize,
)
from leastaction.systems import Ball, Keep, MechanismSystem, MidpointSystem

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness_curves import CURVES
from benchmarks.robustness_drawn import drawn
from benchmarks.robustness_others import OTHERS

# Problems drawn by chance, for the search: some of their minima stand on steps that are too coarse.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

MOST = 250
Problem = tuple[Any, Any, Any, dict[str, Any]]


def assert_resumed(
    solve: Callable[..., OptimizationResult], initial: Any, seed: int, tmp_path: Path, stops: int = 2
) -> None:
    """Stop a run at random iterations, one after the other, and go on from memory and from files."""
    rng = np.random.default_rng(seed)
    whole = solve(initial=initial, max_iterations=MOST)
    if whole.iterations < 2:
        return
    for i, stop in enumerate(sorted(set(rng.integers(1, whole.iterations, stops).tolist()))):
        part = solve(initial=initial, max_iterations=stop)
        if (seed + i) % 2:
            part = load_result(save_result(tmp_path / f"{stop}.npz", part))
        else:
            part = pickle.loads(pickle.dumps(part))
        rest = solve(resume=part, max_iterations=MOST - stop)
        for name in ("x", "u", "K"):
            np.testing.assert_array_equal(getattr(rest, name), getattr(whole, name), err_msg=f"{name}, from {stop}")
        np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
        assert (rest.status, rest.message) == (whole.status, whole.message)


@pytest.mark.parametrize("number", range(40))
def test_problems_drawn_by_chance(number: int, tmp_path: Path) -> None:
    given = drawn(34)[number].build()
    assert_resumed(
        lambda **options: optimize(given.system, given.cost, **options), (given.x, given.u), number, tmp_path, stops=1
    )


def cart(N: int = 101, T: float = 2.0) -> Problem:
    tree = [ty("cart", mass=2.0), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]]
    m = Mechanism(tree, [Gravity(), JointForce("cart", input="push")])
    system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, T, N))
    wanted = np.zeros((N, 4))
    wanted[N // 3 :, 1] = np.pi
    cost = QuadraticCost(wanted, np.zeros((N - 1, 1)), Q=[0.1, 10.0, 0.0, 0.0], R=[0.001])
    return system, cost, (np.zeros(4), np.zeros((N - 1, 1))), {}


def limited() -> Problem:
    end = [Equal("pole", np.pi), Equal("*", 0.0, of="momentum")]
    return *cart(151, 3.0)[:3], {"limits": [Bound("push", -40.0, 40.0), Bound("cart", -1.0, 1.0), *end]}


def past_obstacles() -> Problem:
    t, m = np.linspace(0.0, 3.0, 61), Mechanism(
        [ty("y"), [tz("z", mass=1.0, name="drone")]],
        [Gravity(), JointForce("y", input="fy"), JointForce("z", input="fz")],
    )  # fmt: skip
    system, wanted, hover = (
        MidpointSystem(MidpointVI(m, threads=1), t),
        np.zeros((61, 4)),
        np.tile([0.0, 9.81], (60, 1)),
    )
    wanted[:, 0] = t
    balls = [Keep("drone", outside=Ball((0.0, y, 0.02), 0.3)) for y in (0.8, 1.8)]
    cost = QuadraticCost(wanted, hover, Q=[1.0, 1.0, 0.0, 0.0], R=[0.01, 0.01])
    return system, cost, (np.zeros(4), hover), {"limits": [*balls, Equal(["z", "y"], [0.0, 3.0])]}


def infeasible() -> Problem:
    return *cart(61, 1.0)[:3], {"limits": [Bound("push", -2.0, 2.0), Equal("pole", np.pi)]}


def free() -> Problem:
    limits = [Bound("push", -10.0, 10.0), Equal("pole", 2.0)]
    return *cart(81, 1.5)[:3], {"free_start": ["p_pole", "pole"], "limits": limits}


def in_least_time() -> Problem:
    system, _, initial, _ = cart(61)
    cost = QuadraticCost(np.zeros((61, 4)), np.zeros((60, 1)), Q=[0.0] * 4, R=[1e-3])
    limits = [Bound("push", -20.0, 20.0), Equal("cart", 1.0), Equal("pole", 0.0), Equal("*", 0.0, of="momentum")]
    return system, cost, initial, {"limits": limits, "unknowns": [FinalTime(price=1.0)]}


def returning() -> Problem:
    elements = [JointSpring("x", 4.0, name="spring"), Damping(0.2), JointForce("x", input="push")]
    t = np.linspace(0.0, 2.0, 81)
    system = MidpointSystem(MidpointVI(Mechanism([tx("x", mass=1.0)], elements), threads=1), t)
    wanted = np.zeros((81, 2))
    wanted[:, 0] = np.sin(np.pi * t) + 0.2 * np.sin(3.0 * np.pi * t)
    cost = QuadraticCost(wanted, np.zeros((80, 1)), Q=[1.0, 0.0], R=[0.01])
    limits = [Periodic("*"), Bound("push", -3.0, 3.0)]
    return system, cost, (np.zeros(2), np.zeros((80, 1))), {"free_start": True, "limits": limits}


def with_gaps() -> Problem:
    given = CURVES[0].build()
    return given.system, given.cost, (given.x, given.u), {"shooting": "multiple"}


def gaps_and_limits() -> Problem:
    system, cost, (x, u), _ = cart()
    line = np.tile(x, (len(u) + 1, 1))
    line[:, 1] = np.linspace(0.0, np.pi, len(line))
    return system, cost, (line, u), {"shooting": "multiple", "limits": [Bound("push", -60.0, 60.0)]}


def resolved() -> Problem:
    given = next(p for p in OTHERS if p.name == "acrobot, swing-up, R 1e-06, final 1e+06, rest 0").build()
    return given.system, given.cost, (given.x, given.u), {}


def continuous(**options: Any) -> Problem:
    system, cost = MechanismSystem(cart()[0].mechanism), ContinuousQuadraticCost(
        [1.0, 0.0, 0.0, 0.0], [0.0], Q=[1.0, 5.0, 0.1, 0.1], R=[0.01], Q_final=[100.0] * 4
    )  # fmt: skip
    return system, cost, (np.zeros(4), np.zeros(1)), {"horizon": (0.0, 2.0), **options}


def on_a_mesh() -> Problem:
    return continuous(collocate=True)


def on_a_mesh_within_limits() -> Problem:
    return continuous(limits=[Bound("push", -10.0, 10.0), Equal("cart", 0.8)])


def on_a_mesh_from_anywhere() -> Problem:
    return continuous(limits=[Bound("push", -10.0, 10.0)], free_start=["pole"])


def too_short_on_a_mesh() -> Problem:
    """A horizon in which nothing can be reached: it begins again."""
    system = LinearContinuousSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[0.1])
    options = {"limits": [Bound("u[0]", -1.0, 1.0), Equal(["x[0]", "x[1]"], [1.0, 0.0])], "horizon": (0.0, 0.1)}
    return system, cost, (np.zeros(2), np.zeros(1)), {**options, "unknowns": [FinalTime(price=1.0)]}


def bryson_and_denham() -> Problem:
    system = LinearContinuousSystem([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]])
    cost = ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[0.0, 0.0], R=[1.0])
    limits = [Bound("x[0]", max=0.1), Equal("x[0]", 0.0), Equal("x[1]", -1.0)]
    return system, cost, ([0.0, 1.0], [-2.0]), {"horizon": (0.0, 1.0), "limits": limits}


@pytest.mark.parametrize(
    "make",
    [
        cart, limited, past_obstacles, infeasible, free, in_least_time, returning, with_gaps, gaps_and_limits, resolved,
        on_a_mesh, on_a_mesh_within_limits, on_a_mesh_from_anywhere, bryson_and_denham, too_short_on_a_mesh,
    ],
)  # fmt: skip
def test_problems_of_each_kind(make: Callable[[], Problem], tmp_path: Path) -> None:
    system, cost, initial, options = make()
    horizon = options.pop("horizon", None)

    def solve(**more: Any) -> OptimizationResult:
        if horizon is not None and "initial" in more:
            more["horizon"] = horizon
        return optimize(system, cost, **options, **more)

    assert_resumed(solve, initial, len(make.__name__), tmp_path)
