"""Problems with limits from which a search gets stuck: the ways in which it begins again, and what is stated anew."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from leastaction.io.results import load_result, save_result
from leastaction.mechanics import Distance, Gravity, JointForce, Mechanism, MidpointVI, world
from leastaction.optimal import (
    Bound,
    OptimizationResult,
    QuadraticCost,
    Status,
    optimize,
)
from leastaction.optimal.limits.limit import Limit
from leastaction.systems import HalfSpace, Keep, MidpointSystem

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.limits_cases import CASES
from benchmarks.robustness_drawn import drawn
from benchmarks.robustness_problems import PROBLEMS


def beginnings(notes: list[str]) -> list[str]:
    return [part for note in notes for part in note.split("; ") if part.startswith("began again")]


def test_what_is_stuck_within_limits_begins_again() -> None:
    """A four-bar linkage with 70 % of the drive that its minimum without limits uses: once stuck at 1e4 to 1e6."""
    given, notes = drawn(40, 32)[31].build(), list[str]()
    for most in (29.8, 29.88846638, 29.9):
        result = optimize(
            given.system, given.cost, initial=(given.x, given.u), limits=[Bound("drive", -most, most)],
            callback=lambda record: notes.append(record.note),
        )  # fmt: skip
        assert result.success, result.message
        assert result.cost < 1e3  # in one of several minima
        assert result.limits is not None
        assert min(side.value.min() for side in result.limits.sides) >= -1e-6 * most
    # Which of these is the first to lead on is up to rounding.
    ways = "where searches would lead nowhere", "among motions that the steps of time resolve"
    assert set(beginnings(notes)).intersection(f"began again, {way}" for way in ways)


def gymnast(**options: object) -> OptimizationResult:
    """Raise the legs of a gymnast who hangs on rings: of steps that are too coarse for how he would throw them."""
    tree = world()
    hand = tree.ty("hy").tz("hz", name="hand", mass=0.3)
    arm = hand.rx("arm")
    arm.tz(-0.3, mass=8.0)
    shoulder = arm.tz(-0.6).rx("shoulder")
    shoulder.tz(-0.3, mass=35.0, inertia=(1.5, 1.5, 0.1))
    hip = shoulder.tz(-0.6).rx("hip")
    hip.tz(-0.45, mass=20.0, inertia=(1.0, 1.0, 0.1))
    hip.tz(-0.9, name="feet")
    motors = [JointForce("shoulder", input="us"), JointForce("hip", input="uh")]
    m = Mechanism(tree, [Gravity(), Distance("world", "hand", 3.0, name="rings"), *motors])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 2.0, 101), multipliers=True)
    hanging, Q = np.zeros(system.nx), np.zeros(system.nx)
    hanging[: m.nq] = m.configuration({"hz": -3.0})
    wanted = np.tile(hanging, (101, 1))
    wanted[50:, m.variables.index("arm")] = 0.6 * np.pi
    Q[[m.variables.index(name) for name in ("arm", "shoulder", "hip")]] = 50.0, 1.0, 1.0
    cost = QuadraticCost(wanted, np.zeros((100, 2)), Q=Q, R=[1e-4, 1e-4])
    limits: list[Limit] = [
        Bound("us", -250.0, 250.0), Bound("uh", -200.0, 200.0), Bound("rings", min=50.0, of="tension"),
        Bound("shoulder", -0.5, 3.0), Bound("hip", -0.3, 2.2), Bound("hy", -1.0, 1.0),
        Keep("feet", inside=HalfSpace((0.0, 0.0, 1.0), -5.15)),
    ]  # fmt: skip
    if "resume" not in options:
        options["initial"] = hanging, np.zeros((100, 2))
    return optimize(system, cost, limits=limits, **options)  # type: ignore[call-overload,no-any-return]


def test_gaps_are_tried_from_the_wanted_motion_where_they_do_not_close_from_the_start(tmp_path: Path) -> None:
    """It had ended stuck, at 3081 after the motion that is held still."""
    notes: list[str] = []
    whole = gymnast(callback=lambda record: notes.append(record.note))
    assert whole.success, whole.message
    assert whole.cost < 400.0  # 310 to 328, by the variant of the core
    assert [way for way in beginnings(notes) if "gaps" in way] == ["began again, with gaps between the steps"] * 2
    for stop in (40, 90):  # with gaps from the start, and from the wanted motion
        part = gymnast(max_iterations=stop)
        rest = gymnast(resume=load_result(save_result(tmp_path / f"{stop}.npz", part)))
        np.testing.assert_array_equal(rest.x, whole.x)
        assert rest.iterations == whole.iterations


@pytest.mark.parametrize(
    ("name", "times", "most"),
    [
        # Among the walls of the last barrier, where what had not been active hardly had a price: 16, or INFEASIBLE.
        ("spatial arm, tracking, torques at most 80 %", 1.3, 14),
        ("spatial arm, tracking, torques at most 80 %", 10.0, 40),  # 161
        ("spatial arm, reaching, torques at most 60 %", 10.0, 80),  # 200, INFEASIBLE
        ("planar arm, reaching, torques at most 50 %", 10.0, 15),  # 30
        ("cart, tracking, push at most 70 %", 10.0, 14),  # 21
    ],
)
def test_what_was_found_with_other_weights_is_a_start(name: str, times: float, most: int) -> None:
    """What is active changes: barriers are worth as much at first as the cost has changed."""
    case = next(case for case in CASES if case.name == name)
    given = next(problem for problem in PROBLEMS if problem.name == case.of).build()
    free = optimize(given.system, given.cost, initial=(given.x, given.u))
    limits = case.limit(given, free).limits
    found = optimize(given.system, given.cost, initial=(given.x, given.u), limits=limits)
    was = given.cost
    assert isinstance(was, QuadraticCost)
    Q, Q_final = times * np.asarray(was.Q), times * np.asarray(was.Q_final)
    cost = QuadraticCost(was.x_wanted, was.u_wanted, Q=Q, R=was.R, Q_final=Q_final)
    result = optimize(given.system, cost, initial=found, limits=limits)
    assert result.status is Status.CONVERGED, result.message
    assert result.iterations <= most
    anew = optimize(given.system, cost, initial=(given.x, given.u), limits=limits)
    assert result.cost <= anew.cost * (1.0 + 1e-6)
