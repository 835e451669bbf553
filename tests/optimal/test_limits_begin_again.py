"""Problems with limits from which a search gets stuck: the ways in which it begins again, and what is stated anew."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from leastaction.io.results import load_result, save_result
from leastaction.mechanics import (
    Distance,
    ExpressionPotential,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    rx,
    tx,
    ty,
    tz,
    world,
)
from leastaction.mechanics.expressions import variable
from leastaction.optimal import (
    Bound,
    Equal,
    OptimizationResult,
    QuadraticCost,
    Status,
    optimize,
)
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.ways.curves import line_to, needed_inputs
from leastaction.systems import HalfSpace, Keep, MidpointSystem

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.limits_cases import CASES
from benchmarks.robustness_drawn import drawn
from benchmarks.robustness_problems import PROBLEMS

# Hard problems by few steps, for the search: shorter steps would have other minima.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]


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


def over_a_hill() -> tuple[MidpointSystem, QuadraticCost, list[Limit], np.ndarray, np.ndarray]:
    """A mass of 1 kg, rest to rest, 10 m in 6 s, over a hill of 20 J that is steeper than the push."""
    N, T = 150, 6.0
    hill = ExpressionPotential(20.0 * sp.exp(-((variable("x") - 2.0) ** 2)), name="hill")
    m = Mechanism([tx("x", mass=1.0)], [hill, JointForce("x", "F")])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, T, N + 1))
    line = np.column_stack([np.linspace(0.0, 10.0, N + 1), np.full(N + 1, 10.0 / T)])
    line[[0, -1], 1] = 0.0
    cost = QuadraticCost(np.zeros((N + 1, 2)), np.zeros((N, 1)), Q=[0.0, 0.0], R=[2.0 * T / N])
    return (
        system,
        cost,
        [Bound("F", -10.0, 12.0), Equal("x", 10.0), Equal("x", 0.0, of="momentum")],
        line,
        0.0 * line[1:, :1],
    )


@pytest.mark.parametrize(
    ("start", "shooting", "expected"),
    # From the line that is what Ipopt finds, from the same one.
    [("line", "auto", 60.356), ("line", "multiple", 60.356), ("rest", "auto", 60.356), ("rest", "multiple", 60.356)],
)
def test_the_foot_of_a_hill_is_not_where_it_ends(start: str, shooting: str, expected: float, tmp_path: Path) -> None:
    """A stationary point of the violation: it was called infeasible, though the curve that was given leads across."""
    system, cost, limits, line, u = over_a_hill()
    initial = (line if start == "line" else line[0], u)
    whole = optimize(system, cost, initial=initial, limits=limits, shooting=shooting)
    assert whole.status is Status.CONVERGED, whole.message
    assert whole.cost == pytest.approx(expected, rel=1e-4)
    without = optimize(system, cost, initial=initial, limits=limits, shooting=shooting, without=["gaps"])
    assert without.status is Status.INFEASIBLE
    part = optimize(system, cost, initial=initial, limits=limits, shooting=shooting, max_iterations=20)
    rest = optimize(
        system, cost, resume=load_result(save_result(tmp_path / "part.npz", part)), limits=limits, shooting=shooting
    )
    np.testing.assert_array_equal(rest.x, whole.x)
    assert rest.iterations == whole.iterations


@pytest.mark.parametrize(
    ("lengths", "masses", "T", "start", "end", "most"),
    # Ipopt finds some motion from one start of four, or two.
    [
        ((0.9, 0.5), (0.5, 0.7), 2.5, (0.4, 0.4), (-1.8, 0.3), 4.0),
        ((0.9, 0.7), (1.2, 0.6), 3.0, (0.4, -0.3), (3.2, -1.0), 8.0),
    ],
)
def test_a_dead_point_is_not_where_it_ends(
    lengths: tuple[float, float], masses: tuple[float, float], T: float, start: tuple[float, float],
    end: tuple[float, float], most: float,
) -> None:  # fmt: skip
    """An acrobot with a weak motor at the elbow comes to rest, from a state alone: it was called infeasible."""
    N, (l1, l2), (m1, m2) = 100, lengths, masses
    m = Mechanism(
        [rx("a"), [tz(-l1, mass=m1), tz(-l1), [rx("b"), [tz(-l2, mass=m2)]]]], [Gravity(), JointForce("b", input="u")]
    )
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, T, N + 1))
    wanted = np.tile([*end, 0.0, 0.0], (N + 1, 1))
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[5.0, 1.0, 0.0, 0.0], R=[0.02])
    limits = [Bound("u", -most, most), Equal("a", end[0]), Equal("*", 0.0, of="momentum")]
    result = optimize(system, cost, initial=([*start, 0.0, 0.0], np.zeros((N, 1))), limits=limits)
    assert result.success, result.message
    assert abs(result["u"]).max() <= most * (1.0 + 1e-6)
    assert result["a"][-1] == pytest.approx(end[0], abs=1e-6)


def test_limits_that_cannot_be_met_are_told_all_the_same() -> None:
    """10 m in 1 s, where the push leads no further than 3: after the given curve was tried too."""
    m = Mechanism([tx("x", mass=1.0)], [JointForce("x", "F")])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 1.0, 41))
    cost = QuadraticCost(np.zeros((41, 2)), np.zeros((40, 1)), Q=[0.0, 0.0], R=[1.0])
    limits = [Bound("F", -6.0, 6.0), Equal("x", 10.0)]
    result = optimize(system, cost, initial=(np.zeros(2), np.zeros((40, 1))), limits=limits)
    assert result.status is Status.INFEASIBLE
    assert result.state is not None
    assert "gaps for unmet limits" in result.state.run.taken
    assert result["x"][-1] == pytest.approx(3.0, rel=0.02)  # 1/2 F/m T^2


@pytest.mark.parametrize("at", [(0.3, -0.4), (-0.2, 0.1)])
def test_the_optimum_of_a_convex_problem_is_one(at: tuple[float, float]) -> None:
    """A point mass that falls freely at first: prices of so dear a start drowned all else in rounding."""
    N, dt, g, mass = 80, 0.035, 9.81, 1.1
    m = Mechanism(
        [ty("y"), [tz("z", mass=mass)]],
        [Gravity((0.0, 0.0, -g)), JointForce("y", input="u"), JointForce("z", input="w")],
    )
    system = MidpointSystem(MidpointVI(m), dt * np.arange(N + 1))
    start, goal = np.array([*at, 0.0, 0.0]), np.array([0.5, 0.9, 0.0, 0.0])
    Q, R = np.array([4.0, 9.0, 0.0, 0.0]), np.array([0.03, 0.01])
    cost = QuadraticCost(np.tile(goal, (N + 1, 1)), np.zeros((N, 2)), Q=Q, R=R)
    limits = [Bound("u", -30.0, 30.0), Equal("*", 0.0, of="momentum")]
    result = optimize(system, cost, initial=(start, np.zeros((N, 2))), limits=limits)
    assert result.status is Status.CONVERGED, result.message
    # The same by its conditions of optimality, as one linear equation.
    A, B, drift = np.eye(4), np.zeros((4, 2)), np.array([0.0, -0.5 * dt**2 * g, 0.0, -mass * dt * g])
    A[:2, 2:], B[:2], B[2:] = dt / mass * np.eye(2), 0.5 * dt**2 / mass * np.eye(2), dt * np.eye(2)
    moves, free = np.zeros((N + 1, 4, 2 * N)), np.tile(start, (N + 1, 1))
    for k in range(N):
        moves[k + 1], free[k + 1] = A @ moves[k], A @ free[k] + drift
        moves[k + 1][:, 2 * k : 2 * k + 2] += B
    H = np.einsum("kia,i,kib->ab", moves, Q, moves) + np.diag(np.tile(R, N))
    gradient = np.einsum("kia,i,ki->a", moves, Q, free - goal)
    E = moves[-1, 2:]
    K = np.block([[H, E.T], [E, np.zeros((2, 2))]])
    u = np.linalg.solve(K, -np.concatenate([gradient, free[-1, 2:]]))[: 2 * N].reshape(N, 2)
    np.testing.assert_allclose(result.u, u, atol=1e-4)


def test_inputs_that_a_curve_needs_are_those_of_the_trajectory_that_it_is() -> None:
    system, _, limits, line, u = over_a_hill()
    push = 3.0 * np.sin(np.linspace(0.0, 5.0, len(u)))[:, None]
    run = system.rollout(np.zeros(2), line, push, np.zeros((len(u), 1, 2)), 0, len(u))
    np.testing.assert_allclose(needed_inputs(system, run.x, u), push, atol=1e-9)
    rows = [row for limit in limits for row in limit.rows(system, 1)]
    np.testing.assert_allclose(line_to(system, np.zeros(2), None, rows)[[0, -1]], [[0.0, 0.0], [10.0, 0.0]], atol=1e-12)
