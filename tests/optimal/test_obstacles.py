"""Obstacles that stand in the middle of the way: they are passed beside, and not leapt through between two instants."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from leastaction.io.results import load_result, save_result
from leastaction.mechanics import Damping, Gravity, JointForce, JointSpring, Mechanism, MidpointVI, ry, tx, ty, tz
from leastaction.optimal import (
    Bound,
    Equal,
    FunctionQuantity,
    OptimizationResult,
    Periodic,
    QuadraticCost,
    Within,
    optimize,
)
from leastaction.optimal.loop.directions import Directions
from leastaction.optimal.loop.run import Run
from leastaction.optimal.schedule import NewtonSchedule
from leastaction.systems import Ball, Box, HalfSpace, Keep, MidpointSystem

N, RADIUS = 100, 0.25


@pytest.fixture(scope="module")
def slider() -> MidpointSystem:
    puck = Mechanism(
        [tx("x"), [tz("z", mass=1.0, name="puck")]], [JointForce("x", input="fx"), JointForce("z", input="fz")]
    )
    return MidpointSystem(MidpointVI(puck), np.linspace(0.0, 2.0, N + 1))


def straight(system: MidpointSystem) -> tuple[np.ndarray, np.ndarray]:
    """The way from 0 to 2 m along x, without inputs."""
    s = system.t / 2.0
    x = np.zeros((N + 1, 4))
    x[:, 0] = 2.0 * (3.0 * s**2 - 2.0 * s**3)
    return x, np.zeros((N, 2))


def passed(system: MidpointSystem, centers: list[tuple[float, float]], **options: Any) -> OptimizationResult:
    """Follow the straight way past balls."""
    x, u = straight(system)
    cost = QuadraticCost(x, u, Q=[100.0, 100.0, 0.0, 0.0], R=[0.01, 0.01])
    limits = [Keep("puck", outside=Ball((a, 0.0, b), RADIUS)) for a, b in centers]
    if "resume" not in options:
        options["initial"] = options.get("initial", (x, u))
    return optimize(system, cost, limits=limits, **options)


@pytest.mark.parametrize("aside", [0.0, 0.02, -0.1])
def test_what_stands_in_the_middle_is_passed_beside(slider: MidpointSystem, aside: float) -> None:
    result = passed(slider, [(1.0, aside)])
    assert result.success, result.message
    assert result.iterations <= 50  # 12 to 25; 193 where the ball is whole from the beginning, and right in the middle
    distance = np.hypot(result.x[:, 0] - 1.0, result.x[:, 1] - aside)
    assert distance.min() >= RADIUS - 1e-6
    assert np.hypot(*np.diff(result.x[:, :2], axis=0).T).max() < 0.1  # nothing is leapt through
    if aside:
        assert result.x[50, 1] * aside < 0.0  # on the shorter way
    else:
        # From a way that already leads around on one side or the other, the same minimum is found.
        around, u = straight(slider)
        around[:, 1] = 0.4 * np.sin(np.pi * around[:, 0] / 2.0)
        assert result.cost == pytest.approx(passed(slider, [(1.0, 0.0)], initial=(around, u)).cost, rel=1e-7)


def test_three_in_a_row(slider: MidpointSystem) -> None:
    """With balls that are whole from the beginning these limits were said to contradict each other."""
    places = [0.5, 1.0, 1.5]
    result = passed(slider, [(a, 0.0) for a in places])
    assert result.success, result.message
    assert result.iterations <= 80
    for place in places:
        assert np.hypot(result.x[:, 0] - place, result.x[:, 1]).min() >= RADIUS - 1e-6


def test_a_start_that_stays_where_it_is_says_nothing_of_the_side(slider: MidpointSystem) -> None:
    """From rest to rest past three balls in a row: a search that heads through them leapt, for 1349 instead of 2.2."""
    still, u = np.zeros((N + 1, 4)), np.zeros((N, 2))
    effort = QuadraticCost(still, u, Q=np.zeros(4), R=[0.01, 0.01])
    ends = [Equal("x", 2.0), Equal("z", 0.0), Equal("*", 0.0, of="momentum")]
    balls = [Keep("puck", outside=Ball((a, 0.0, 0.0), RADIUS)) for a in (0.5, 1.0, 1.5)]
    result = optimize(slider, effort, limits=[*balls, *ends], initial=(still, u))
    assert result.success, result.message
    assert result.cost < 2.3
    # A detour is a start that does say: it is left on its side, and not looked at without obstacles.
    s = slider.t / 2.0
    around = still.copy()
    around[:, 0] = 2.0 * (3.0 * s**2 - 2.0 * s**3)
    around[:, 1] = -0.6 * np.sin(np.pi * s)
    below = optimize(slider, effort, limits=[*balls, *ends], initial=result, max_iterations=0)
    assert below.limits is not None
    assert below.limits.barrier is not None
    assert below.limits.barrier.part == 0.0
    found = passed(slider, [(1.0, 0.0)], initial=(around, u))
    assert found.success
    assert found.x[50, 1] < 0.0


def test_a_run_that_is_stopped_while_obstacles_grow_goes_on(slider: MidpointSystem, tmp_path: Path) -> None:
    whole = passed(slider, [(1.0, 0.0)])
    part = passed(slider, [(1.0, 0.0)], max_iterations=3)
    assert part.limits is not None
    assert part.limits.barrier is not None
    assert 0.0 < part.limits.barrier.part <= 1.0
    # What is told is how far the motion is inside of the whole ball.
    d = np.hypot(part.x[1:, 0] - 1.0, part.x[1:, 1])
    told = part.limits.sides[0].value[:, 0]
    np.testing.assert_allclose(told, (d**2 - RADIUS**2) / (2.0 * RADIUS), atol=1e-12)
    assert told.min() < -0.05
    assert "Limits are still violated" in part.message
    rest = passed(slider, [(1.0, 0.0)], resume=load_result(save_result(tmp_path / "part.npz", part)))
    np.testing.assert_array_equal(rest.x, whole.x)
    np.testing.assert_array_equal(rest.u, whole.u)
    assert rest.iterations == whole.iterations


def test_a_result_that_was_saved_before_there_was_any_leeway_is_read(slider: MidpointSystem, tmp_path: Path) -> None:
    whole = passed(slider, [(1.0, 0.02)])
    with np.load(save_result(tmp_path / "now.npz", whole)) as saved:
        told = dict(saved)
    named = json.loads(str(told["leastaction_record"]))
    barrier = named["content"]["limits"]["barrier"]
    assert barrier.pop("part") == 0.0
    barrier.pop("leeway")
    del told["limits.barrier.leeway"]
    np.savez(tmp_path / "earlier.npz", **(told | {"leastaction_record": np.array(json.dumps(named))}))
    again = passed(slider, [(1.0, 0.02)], resume=load_result(tmp_path / "earlier.npz"))
    assert again.success
    assert again.cost == pytest.approx(whole.cost, rel=1e-12)


def test_a_start_inside_of_what_it_has_to_stay_in_needs_no_leeway(slider: MidpointSystem) -> None:
    """A region that a motion is to be brought into is no obstacle: it is not made larger first."""
    x, u = straight(slider)
    cost = QuadraticCost(x, u, Q=[100.0, 100.0, 0.0, 0.0], R=[0.01, 0.01])
    inside = [Keep("puck", inside=Ball((0.0, 0.0, 0.0), 1.0))]
    part = optimize(slider, cost, limits=inside, initial=(x, u), max_iterations=1)
    assert part.limits is not None
    assert part.limits.barrier is not None
    assert part.limits.barrier.part == 0.0


def test_regions_say_where_they_are_in_plain_numbers() -> None:
    assert Ball(np.array([0.3, -0.95, 0.0]), 0.2).names == ("within 0.2 m of (0.3, -0.95, 0)",)
    assert Ball(lambda t: (t, 0.0, 0.0), 0.2).names == ("within 0.2 m of a moving point",)
    assert HalfSpace((0.0, -2.0, 0.0), 1.5).names == ("inside of the plane (0, -2, 0) . p = 1.5",)
    assert Box((0.0, -np.inf, -np.inf), (np.inf, np.inf, np.inf)).names == ("x >= 0 m",)


def test_a_step_that_misses_what_was_expected_by_everything_foretells_nothing() -> None:
    """A leap through an obstacle came to 1e200 times what was expected, the square of which is no number."""
    before = NewtonSchedule()
    directions = Directions(cast("Run", SimpleNamespace(goal=1e-9)))
    assert directions.foretold(before, 1.0, 1e200) is None


@pytest.mark.parametrize("own", [False, True])
def test_a_motion_that_grazes_a_small_ball_stays_on_its_side(own: bool) -> None:
    """What is seen from far away is no measure of a small ball: it was leapt through, for 28.8 instead of 0.91."""
    tree = [tx("x", mass=1.0), [ry("a"), [tz(-0.5, mass=0.2, name="bob")]]]
    t = np.linspace(0.0, 1.5, N + 1)
    wanted = np.zeros((N + 1, 4))
    wanted[:, 1] = 0.5 * np.sin(2.0 * np.pi * t / 1.5)
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[0.1, 10.0, 1e-3, 1e-3], R=[0.01])

    def squared(x: np.ndarray) -> np.ndarray:
        return (x[:, 0] - 0.5 * np.sin(x[:, 1]) - 0.2) ** 2 + (0.45 - 0.5 * np.cos(x[:, 1])) ** 2

    ball = Within(FunctionQuantity("squared", squared), min=0.05**2) if own else None
    ball = ball or Keep("bob", outside=Ball((0.2, 0.0, -0.45), 0.05))
    limits = [Periodic("*"), Bound("f", -2.0, 2.0), ball, Bound("x", -0.3, 0.3, of="rate")]

    def best(stiffness: float, initial: Any) -> OptimizationResult:
        elements = [Gravity(), JointForce("x", input="f"), JointSpring("x", stiffness), Damping(0.05)]
        system = MidpointSystem(MidpointVI(Mechanism(tree, elements)), t)
        return optimize(system, cost, initial=initial, limits=limits, free_start=True)

    before = best(5.0, (np.zeros(4), np.zeros((N, 1))))
    for warm in (before, (before.x, before.u), (before.x[0], before.u)):
        result = best(6.0, warm)
        assert result.success, result.message
        assert result.cost == pytest.approx(0.90899003, rel=1e-6)


def test_an_obstacle_that_stands_between_is_passed_from_where_there_is_none() -> None:
    """A start that hovers is caught before a ball that moves: its limits were said to contradict each other."""
    t = np.linspace(0.0, 3.0, 91)
    frames = [ty("y"), [tz("z", mass=1.0, name="drone")]]
    drone = Mechanism(frames, [Gravity(), JointForce("y", input="fy"), JointForce("z", input="fz")])
    system = MidpointSystem(MidpointVI(drone), t)
    wanted, hovers = np.zeros((91, 4)), np.tile([0.0, 9.81], (90, 1))
    wanted[:, 0] = t * 2.0 / 3.0
    cost = QuadraticCost(wanted, hovers, Q=[1.0, 1.0, 0.0, 0.0], R=[0.01, 0.01])
    limits = [
        Bound("fz", 5.0, lambda t: 14.0 if t < 1.0 else 11.0),
        Bound("fy", np.linspace(-4.0, -1.0, 90), np.linspace(2.0, 3.0, 90)),
        Equal("z", 0.6, at=1.5),
        Equal(["z", "y"], [0.0, 2.0]),
        Equal(["y", "z"], 0.0, of="rate", at="end"),
        Keep("drone", outside=Ball(lambda t: (0.0, 1.2, 0.3 - 0.1 * t), 0.3)),
    ]
    result = optimize(system, cost, initial=(np.zeros(4), hovers), limits=limits)
    free = optimize(system, cost, initial=(np.zeros(4), hovers), limits=limits[:-1])
    assert result.success, result.message
    assert free.cost < result.cost < 1.01 * free.cost
