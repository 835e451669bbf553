"""Multiple shooting: iterates with gaps between their steps, which close on the way to the same minimum."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from leastaction import (
    Ball,
    Bound,
    Box,
    Damping,
    Distance,
    Equal,
    Gravity,
    IterationTable,
    JointForce,
    Keep,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    Status,
    optimize,
    project_configuration,
    rx,
    tz,
    world,
)
from leastaction.errors import ArgumentError, StepError
from leastaction.io.results import load_result, save_result
from leastaction.optimal import ContinuousQuadraticCost, FunctionSystem, LinearSystem, solve_linear_quadratic
from leastaction.optimal.discrete import step_by_step
from leastaction.optimal.discrete.linear_quadratic import sweep_forward
from leastaction.optimal.iterates.gap_filter import Filter, OpenCurve
from leastaction.optimal.line_search import Refusal
from leastaction.optimal.search import beginning
from leastaction.optimal.search.problem import DiscreteProblem
from optimal.systems import CartPendulum, is_trajectory

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness import certify
from benchmarks.robustness_further import FURTHER
from benchmarks.robustness_problems import PROBLEMS, cart, constant, double_pendulum, posed, waves

# Hard problems by few steps, for the search: shorter steps would have other minima.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

BY_NAME = {problem.name: problem for problem in PROBLEMS + FURTHER}


@pytest.mark.parametrize("free_start", [False, True])
def test_corrections_of_a_step_close_all_that_was_missed_as_cheaply_as_can_be(rng, monkeypatch, free_start):
    """Each is the minimum of the step's own model with these gaps too, solved with what that kept."""
    N, nx = 20, 3
    A, B = rng.normal(size=(N, nx, nx)) / 2.0, rng.normal(size=(N, nx, 2))
    system = LinearSystem(A, B)
    cost = QuadraticCost(rng.normal(size=(N + 1, nx)), np.zeros((N, 2)), Q=[1.0, 0.5, 2.0], R=[0.1, 0.3])
    start = rng.normal(size=(N + 1, nx)), rng.normal(size=(N, 2))
    settings = optimize(system, cost, initial=(np.zeros((N + 1, nx)), np.zeros((N, 2))), max_iterations=0).settings
    problem = DiscreteProblem(system, cost, settings, (), free_start, "at once")
    problem.start(start)
    curve = problem.parts.here.curve
    direction = problem.steps.direction("quasi-newton", problem.models.minimise("quasi-newton", 0.0), 0.0)
    missed, moved = [0.1 * rng.normal(size=(N, nx)) for _ in range(3)], []

    def off(dx, du, length):
        moved.append((dx, du))
        gaps = missed[len(moved) - 1]
        theta = curve.theta * (2.0 - 0.1 * len(moved))
        return curve._replace(gaps=gaps, theta=theta, length=length) if len(moved) < 3 else Refusal("enough")

    monkeypatch.setattr(problem.parts.steps, "_moved", off)
    monkeypatch.setattr(problem.parts.steps, "_judge", lambda *_: Refusal("never"))
    assert isinstance(problem.steps.simulate(direction, 1.0, np.inf), Refusal)
    assert len(moved) == 3
    q, r, q_final = cost.gradient(*start)
    for (dx, du), more in zip(moved, (0.0, missed[0], missed[0] + missed[1]), strict=True):
        model = solve_linear_quadratic(
            A, B, Q=cost.Q, R=cost.R, Q_final=cost.Q_final, q=q, r=r, q_final=q_final, c=curve.gaps + more
        )  # fmt: skip
        wanted = sweep_forward(A, B, model, direction.dx0, c=curve.gaps + more)
        np.testing.assert_allclose(dx, wanted[0], rtol=0, atol=1e-10 * np.abs(wanted[0]).max())
        np.testing.assert_allclose(du, wanted[1], rtol=0, atol=1e-10 * np.abs(wanted[1]).max())


def balancing(N, poles=4, R=1e-2):
    """Return poles one on top of the other, to be balanced by the cart; all that is known is where they are to be."""
    q0 = {"pole0": np.pi - 0.1, "pole1": 0.1} if poles > 1 else {"pole0": np.pi - 0.1}
    return posed(
        cart(poles), q0, constant(pole0=np.pi), N=N, dt=0.02, Q=0.1, final=1e4, R=R, kind="line"
    )  # fmt: skip


def test_a_full_step_closes_the_gaps_of_linear_dynamics(rng):
    N, A, B = 20, np.array([[1.0, 0.1], [0.3, 1.0]]), np.array([[0.0], [0.1]])
    system = LinearSystem(A, B, N=N)
    cost = QuadraticCost(rng.normal(size=(N + 1, 2)), np.zeros((N, 1)), Q=[1.0, 0.5], R=[0.1], Q_final=[5.0, 1.0])
    x, u = rng.normal(size=(N + 1, 2)), rng.normal(size=(N, 1))
    gaps = x[:-1] @ A.T + u @ B.T - x[1:]
    records = []
    result = optimize(system, cost, initial=(x, u), shooting="multiple", callback=records.append)
    assert result.status is Status.CONVERGED
    assert records[0].gap == pytest.approx((np.abs(gaps) / (1.0 + np.abs(x).max(axis=0))).max())
    assert [record.gap < 1e-12 for record in records] == [False] + [True] * (len(records) - 1)
    # The minimum over the curves is that of one linear-quadratic problem with the gaps as its drift.
    q, r, q_final = cost.gradient(x, u)
    every = (np.repeat(each[None], N, axis=0) for each in (A, B))
    A, B = (np.ascontiguousarray(each) for each in every)
    model = solve_linear_quadratic(
        A, B, Q=cost.Q, R=cost.R, Q_final=cost.Q_final, q=q, r=r, q_final=q_final, c=gaps
    )  # fmt: skip
    dx, du = sweep_forward(A, B, model, c=gaps)
    np.testing.assert_allclose(result.x, x + dx, atol=1e-10)
    np.testing.assert_allclose(result.u, u + du, atol=1e-10)
    assert is_trajectory(system, result.x, result.u)
    assert result.gap == 0.0


SAME = [
    "cart, swing-up, R 0.01, final 10000, rest",
    "cart, tracking, R 0.01, final 100, noise",
    "double cart, swing-up, R 0.001, final 10000, line",
    "planar arm, reaching, R 0.01, final 1e+06, line",
    "puppet arm of 3, reaching, R 0.01, final 10000, line",
    "slider-crank, half a turn, R 0.01, final 10000, line",
    "quadrotor, flight, R 0.01, final 100, noise",
]


@pytest.mark.parametrize("name", SAME)
def test_the_minimum_is_that_over_trajectories(name):
    given = BY_NAME[name].build()
    how = {"initial": (given.x, given.u), "tolerance": 1e-11}
    ours = optimize(given.system, given.cost, shooting="multiple", **how)
    other = optimize(given.system, given.cost, **how)
    assert ours.status is other.status is Status.CONVERGED
    assert ours.cost == pytest.approx(other.cost, rel=1e-7)
    np.testing.assert_allclose(ours.x, other.x, rtol=1e-4, atol=1e-4)
    assert certify(given, ours.x, ours.u).minimum
    assert is_trajectory(given.system, ours.x, ours.u)
    assert ours.gap == 0.0
    assert ours.history.gap[-1] < 1e-6


@pytest.mark.parametrize("N", [150, 300])
def test_poles_are_balanced_from_where_they_are_to_be(N):
    """An unstable motion over a long time: the projection of the wanted one leads far away."""
    given = balancing(N)
    start = given.x, given.u
    alone = optimize(given.system, given.cost, initial=start, shooting="single", max_iterations=60)
    assert alone.status is Status.ITERATION_LIMIT
    result = optimize(given.system, given.cost, initial=start, shooting="multiple", max_iterations=10)
    assert result.status is Status.CONVERGED
    assert result.cost < 0.1 * alone.cost
    assert certify(given, result.x, result.u).minimum
    assert is_trajectory(given.system, result.x, result.u)


class Raised(QuadraticCost):
    """A cost that is dearer by one, whatever the motion."""

    def final_value(self, x):
        return super().final_value(x) + 1.0


def test_gaps_are_closed_where_that_gains_next_to_nothing():
    """There is no minimum before, however little a step is expected to gain of a cost that nothing changes."""
    given = balancing(300)
    part = {name: 1e-14 * np.asarray(getattr(given.cost, name)) for name in ("Q", "R", "Q_final")}
    cost, records = Raised(given.cost.x_wanted, given.cost.u_wanted, **part), []
    result = optimize(
        given.system, cost, initial=(given.x, given.u), shooting="multiple", callback=records.append
    )  # fmt: skip
    assert result.status is Status.CONVERGED, result.message
    assert is_trajectory(given.system, result.x, result.u)
    assert all(record.step_length == 1.0 for record in records[1:])
    assert [record.gap < 1e-6 for record in records] == [False] * (len(records) - 1) + [True]


@pytest.mark.parametrize(
    ("name", "cost"),
    [
        # Steps of time are coarse for it: rounding decides between minima, one of them at what the steps resolve.
        ("slider-crank, two turns, R 0.001, final 10000, rest", None),
        ("double cart, swing-up, R 0.001, final 10000, line", 84.6),
    ],
)
def test_it_needs_few_iterations_from_a_curve(name, cost):
    given = BY_NAME[name].build()
    result = optimize(given.system, given.cost, initial=(given.x, given.u), shooting="multiple", max_iterations=250)
    assert result.success, result.message
    if result.status is Status.CONVERGED:
        assert certify(given, result.x, result.u).minimum
    if cost is not None:
        assert result.status is Status.CONVERGED
        assert result.cost == pytest.approx(cost, rel=1e-5)
        assert result.iterations < 40


def test_steps_of_a_curve_are_those_of_f(rng):
    given = BY_NAME["puppet arm of 3, reaching, R 0.01, final 10000, line"].build()
    system = MidpointSystem(given.system.integrator, given.system.t, multipliers=True)
    x = np.zeros((system.N + 1, system.nx))
    x[:, : given.system.nx] = given.x[0]
    x += 1e-3 * rng.normal(size=x.shape)
    made = system.step_each(x, given.u)
    assert made.complete, made.failure
    assert made.worst_step is not None
    plain = step_by_step.step_each(system, x, given.u)
    np.testing.assert_allclose(made.x, plain.x, rtol=1e-9, atol=1e-9)
    ours, other = system.linearize_each(x, given.u, made.x), step_by_step.linearize(system, x, given.u)
    z = rng.normal(size=(system.N, system.nx))
    for mine, theirs in zip((*ours, ours.curvature(z)), (*other, other.curvature(z)), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-6 * np.abs(theirs).max())


@pytest.fixture
def never_lost(monkeypatch):
    """Let no projection count as lost, so that first steps have to tell that a start leads nowhere."""
    monkeypatch.setattr(beginning, "_LOST", np.inf)


def test_a_curve_whose_projection_is_lost_is_begun_with_gaps():
    given = balancing(150)
    records = []
    result = optimize(given.system, given.cost, initial=(given.x, given.u), callback=records.append)
    assert result.status is Status.CONVERGED
    assert result.iterations < 15
    assert certify(given, result.x, result.u).minimum
    assert records[0].note == "begins with gaps between its steps, as its projection is lost"
    assert records[0].gap > 0.0
    near = optimize(given.system, given.cost, initial=(result.x, result.u + 1e-3), max_iterations=0)
    assert near.gap == 0.0  # what can be followed is


@pytest.mark.usefixtures("never_lost")
def test_the_automatic_choice_takes_gaps_where_first_steps_are_short():
    given = balancing(150)
    records = []
    result = optimize(given.system, given.cost, initial=(given.x, given.u), callback=records.append)
    assert result.status is Status.CONVERGED
    assert result.iterations < 30
    assert certify(given, result.x, result.u).minimum
    (began,) = [record.iteration for record in records if "began again, with gaps" in record.note]
    assert began == 15
    assert [record.iteration for record in records if record.gap > 1e-6] == list(range(15, result.iterations))
    alone = optimize(
        given.system, given.cost, initial=(given.x, given.u), method="quasi-newton", max_iterations=30
    )  # fmt: skip
    assert alone.history.gap.max() == 0.0


@pytest.mark.usefixtures("never_lost")
@pytest.mark.parametrize("stops", [[14], [15], [17], [15, 1, 1]])
def test_a_run_that_takes_gaps_by_itself_goes_on_as_if_never_stopped(stops, tmp_path):
    given = balancing(150)
    start = given.x, given.u
    whole = optimize(given.system, given.cost, initial=start)
    part = optimize(given.system, given.cost, initial=start, max_iterations=stops[0])
    for more in stops[1:]:
        part = optimize(given.system, given.cost, resume=part, max_iterations=more)
    # Until the gaps are closed, what is returned is what was there before.
    assert part.status is Status.ITERATION_LIMIT
    assert part.gap == 0.0
    assert "Gaps are still open" in part.message
    assert is_trajectory(given.system, part.x, part.u)
    assert part.cost == given.cost.value(part.x, part.u)
    part = load_result(save_result(tmp_path / "part.npz", part))
    rest = optimize(given.system, given.cost, resume=part)
    np.testing.assert_array_equal(rest.x, whole.x)
    np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
    kept = []

    def keep(record):
        kept.append(record.snapshot())
        return record.iteration == stops[0]

    optimize(given.system, given.cost, initial=start, callback=keep)
    rest = optimize(given.system, given.cost, resume=kept[-1])
    np.testing.assert_array_equal(rest.x, whole.x)


def test_a_start_that_cannot_be_simulated_is_begun_with_gaps():
    """Random inputs throw it about until no step can be made any more."""
    given = posed(
        double_pendulum("elbow"), {}, waves(2.0, shoulder=1.0), N=200, dt=0.02, Q=1.0, final=1e4, R=1e-2,
        kind="random", seed=3, size=40.0,
    )  # fmt: skip
    start = given.x, given.u
    with pytest.raises(ArgumentError, match="roll-out failed"):
        optimize(given.system, given.cost, initial=start, shooting="single")
    records = []
    result = optimize(given.system, given.cost, initial=start, callback=records.append)
    assert "begins with gaps" in records[0].note
    assert records[0].gap > 0.0
    assert result.status is Status.CONVERGED
    assert certify(given, result.x, result.u).minimum
    assert is_trajectory(given.system, result.x, result.u)


def test_gaps_that_do_not_close_are_left_for_where_it_stood():
    given = BY_NAME["chain of 3, swing-up, R 0.001, final 10000, random 5"].build()
    records = []
    optimize(
        given.system, given.cost, initial=(given.x, given.u), callback=records.append, max_iterations=60
    )  # fmt: skip
    opened = [record.iteration for record in records if record.gap > 0.0]
    assert opened[0] == 15
    assert opened[-1] < 60
    after = records[opened[-1] + 1]
    assert after.gap == 0.0
    assert "times as dear as asked for" in after.note


def pendulum(N=50, dt=0.02):
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity(), JointForce("a", "motor")])
    return MidpointSystem(MidpointVI(m, threads=1), dt * np.arange(N + 1))


def test_threads_change_nothing():
    given = balancing(40)
    m = given.system.integrator.mechanism
    results = [
        MidpointSystem(MidpointVI(m, threads=threads), given.system.t).step_each(given.x, given.u).x
        for threads in (1, 2, 3)
    ]
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_a_curve_whose_steps_cannot_be_made_is_projected_and_says_so():
    given = BY_NAME["double cart, balance, R 0.01, final 100, rest"].build()
    system, N, u = given.system, given.system.N, given.u
    x = np.zeros((N + 1, system.nx))
    x[20, -1] = 1e3
    made = system.step_each(x, u)
    assert made.steps_done == len(made.x) == 20
    assert "step 20 at t = 0.4 s" in made.failure
    cost = QuadraticCost(np.zeros((N + 1, system.nx)), np.zeros((N, 1)), Q=np.ones(system.nx), R=[0.1])
    records = []
    result = optimize(
        system, cost, initial=(x, u), shooting="multiple", callback=records.append, max_iterations=1
    )  # fmt: skip
    assert result.gap == 0.0
    assert "projected at once" in records[0].note
    assert "step 20" in records[0].note


def test_an_end_with_gaps_says_so_and_can_be_resumed(tmp_path):
    given = balancing(150)
    start = given.x, given.u
    whole = optimize(given.system, given.cost, initial=start, shooting="multiple")
    part = optimize(given.system, given.cost, initial=start, shooting="multiple", max_iterations=2)
    assert part.status is Status.ITERATION_LIMIT
    assert 1e-4 < part.gap < 1.0
    assert part.history.gap[-1] == part.gap
    assert "Gaps are still open" in part.message
    assert "at t = " in part.message
    assert load_result(save_result(tmp_path / "part.npz", part)).gap == part.gap
    with pytest.raises(ArgumentError, match="resume: got a result with open gaps"):
        optimize(given.system, given.cost, resume=part, shooting="single")
    rest = optimize(given.system, given.cost, resume=part, shooting="multiple")
    assert rest.status is Status.CONVERGED
    assert rest.cost == pytest.approx(whole.cost, rel=1e-9)
    again = optimize(given.system, given.cost, resume=rest, shooting="multiple")
    assert again.iterations <= rest.iterations + 1


def test_the_initial_state_may_be_found_too():
    given = balancing(100, poles=1)
    how = {"initial": (given.x, given.u), "free_start": ["p_cart", "p_pole0"]}
    ours = optimize(given.system, given.cost, shooting="multiple", **how)
    other = optimize(given.system, given.cost, **how)
    assert ours.status is Status.CONVERGED
    assert ours.cost == pytest.approx(other.cost, rel=1e-7)
    assert np.abs(ours.x[0] - given.x[0])[2:].max() > 1e-3
    np.testing.assert_array_equal(ours.x[0, :2], given.x[0, :2])


def test_the_table_shows_gaps(capsys):
    given = balancing(40)
    optimize(given.system, given.cost, initial=(given.x, given.u), shooting="multiple", callback=IterationTable())
    lines = capsys.readouterr().out.splitlines()
    place = lines[0].index("gap")
    assert "e-" in lines[1][place - 4 : place + 3]


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"shooting": "single shooting"}, "shooting: got 'single shooting', expected 'auto', 'single' or 'multiple'"),
        ({"shooting": "multiple", "initial": (np.zeros((3, 4)), np.zeros((20, 1)))}, "initial x"),
    ],
)
def test_what_is_wrong_is_named(changed, match):
    cost = QuadraticCost(np.zeros((21, 4)), np.zeros((20, 1)), Q=np.ones(4), R=[1.0])
    given = {"initial": (np.zeros(4), np.zeros((20, 1))), **changed}
    with pytest.raises(ArgumentError, match=match):
        optimize(CartPendulum(20, 0.02), cost, **given)


def test_continuous_time_has_none():
    m = pendulum().integrator.mechanism
    cost = ContinuousQuadraticCost(np.zeros(2), np.zeros(1), Q=[1.0, 0.1], R=[1.0])
    with pytest.raises(ArgumentError, match="shooting: got 'multiple' for a continuous system"):
        optimize(
            MechanismSystem(m), cost, initial=(np.zeros(2), np.zeros(1)), horizon=(0.0, 1.0), shooting="multiple"
        )  # fmt: skip


# ---- With limits -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bounded():
    """Four poles on a cart whose push may not be as large as it would be without limits."""
    given = balancing(150)
    free = optimize(given.system, given.cost, initial=(given.x, given.u), shooting="multiple")
    most = 0.8 * np.abs(free.u).max()
    return given, [Bound("push", -most, most)], most


def test_gaps_close_within_limits_where_trajectories_lead_nowhere(bounded):
    given, limits, most = bounded
    start = given.x, given.u
    alone = optimize(given.system, given.cost, initial=start, limits=limits, shooting="single", max_iterations=60)
    assert not alone.success
    records = []
    result = optimize(
        given.system, given.cost, initial=start, limits=limits, shooting="multiple", callback=records.append
    )  # fmt: skip
    assert result.status is Status.CONVERGED
    assert result.iterations < 30
    assert records[0].gap > 0.01
    assert result.gap == 0.0
    assert is_trajectory(given.system, result.x, result.u)
    assert np.abs(result.u).max() <= most * (1.0 + 1e-9)
    assert result.limits.excess < 1e-8
    assert sum(int(side.active.sum()) for side in result.limits.sides) > 0
    # It is a minimum of the search over trajectories too.
    again = optimize(given.system, given.cost, initial=result, limits=limits, shooting="single")
    assert again.status is Status.CONVERGED
    assert again.cost == pytest.approx(result.cost, rel=1e-8)


@pytest.mark.parametrize("part", [0.7, 0.75, 0.85])
def test_the_automatic_choice_takes_gaps_within_limits(bounded, part):
    """Trajectories lead to minima that cost many times as much, or nowhere, as rounding has it."""
    given, _, most = bounded
    limits = [Bound("push", -most * part / 0.8, most * part / 0.8)]
    records = []
    result = optimize(
        given.system, given.cost, initial=(given.x, given.u), limits=limits, callback=records.append
    )  # fmt: skip
    assert result.status is Status.CONVERGED
    assert any("began again, with gaps" in record.note for record in records)
    assert result.iterations < 150
    best = optimize(given.system, given.cost, initial=(given.x, given.u), limits=limits, shooting="multiple")
    assert result.cost == pytest.approx(best.cost, rel=1e-8)


@pytest.mark.usefixtures("never_lost")
def test_a_run_that_is_stopped_within_limits_while_it_tries_gaps_returns_where_it_stood(bounded, tmp_path):
    given, _, most = bounded
    start, limits = (given.x, given.u), [Bound("push", -0.75 / 0.8 * most, 0.75 / 0.8 * most)]
    records = []
    whole = optimize(given.system, given.cost, initial=start, limits=limits, callback=records.append)
    began = next(record.iteration for record in records if "began again, with gaps" in record.note)
    before = optimize(
        given.system, given.cost, initial=start, limits=limits, max_iterations=began - 1, shooting="single"
    )
    part = optimize(given.system, given.cost, initial=start, limits=limits, max_iterations=began)
    assert "Gaps are still open" in part.message
    np.testing.assert_array_equal(part.x, before.x)
    assert part.cost == before.cost
    assert part.gap == 0.0
    assert "the trajectory that it had come to before" in part.message
    np.testing.assert_array_equal(part.limits.sides[0].value, before.limits.sides[0].value)
    part = load_result(save_result(tmp_path / "part.npz", part))
    rest = optimize(given.system, given.cost, resume=part, limits=limits, max_iterations=400)
    np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
    np.testing.assert_array_equal(rest.x, whole.x)


@pytest.mark.parametrize(
    "name", ["cart, swing-up, R 0.01, final 10000, rest", "cart, tracking, R 0.01, final 100, noise"]
)
def test_limits_have_the_same_minimum_with_gaps(name):
    given = BY_NAME[name].build()
    free = optimize(given.system, given.cost, initial=(given.x, given.u))
    place = given.system.quantity("variable").names[0]
    least, most = 0.8 * free.x[:, 0].min(), 0.8 * free.x[:, 0].max() + 1e-3
    limits = [Bound(place, least, most, of="variable")]
    costs = [
        optimize(given.system, given.cost, initial=(given.x, given.u), limits=limits, shooting=how).cost
        for how in ("single", "multiple")
    ]
    assert costs[0] == pytest.approx(costs[1], rel=1e-8)
    assert costs[0] > free.cost * (1.0 + 1e-6)


@pytest.mark.parametrize("stop", [1, 2, 4])
def test_a_run_with_gaps_and_limits_goes_on_as_if_never_stopped(bounded, stop, tmp_path):
    given, limits, _ = bounded
    how = {"limits": limits, "shooting": "multiple"}
    whole = optimize(given.system, given.cost, initial=(given.x, given.u), **how)
    part = optimize(given.system, given.cost, initial=(given.x, given.u), max_iterations=stop, **how)
    assert part.gap > 1e-6
    assert "Gaps are still open" in part.message
    part = load_result(save_result(tmp_path / "part.npz", part))
    rest = optimize(given.system, given.cost, resume=part, **how)
    np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
    np.testing.assert_array_equal(rest.x, whole.x)
    np.testing.assert_array_equal(rest.limits.sides[0].dual, whole.limits.sides[0].dual)


def delta() -> Mechanism:
    """A robot of three arms, whose platform hangs on three rods."""
    tree, elements = world(), [Gravity(), Damping(0.01)]
    platform = tree.tx("x").ty("y").tz("z", name="platform", mass=0.3)
    for i in range(3):
        c, s = np.cos(2.0 * np.pi * i / 3.0), np.sin(2.0 * np.pi * i / 3.0)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        arm = tree.pose(translation=(0.15 * c, 0.15 * s, 0.0), rotation=turned).ry(f"arm{i}")
        arm.tx(0.1, mass=0.2, inertia=(1e-4, 5e-4, 5e-4))
        arm.tx(0.2, name=f"elbow{i}", mass=0.05)
        platform.pose(translation=(0.05 * c, 0.05 * s, 0.0), name=f"joint{i}")
        elements += [Distance(f"elbow{i}", f"joint{i}", 0.45), JointForce(f"arm{i}", input=f"motor{i}")]
    return Mechanism(tree, elements)


def test_where_a_state_alone_leads_nowhere_it_is_held_with_gaps() -> None:
    """Without torques the platform falls and its arms turn over: few searches within limits come back from there."""
    m = delta()
    arms = {f"arm{i}": 0.2 for i in range(3)}
    q = project_configuration(m, m.configuration({"z": -0.4, **arms}), hold=["x", "y", "z"]).q
    system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 0.5, 101))
    wanted = np.tile(system.integrator.start(q).x, (101, 1))
    goal = [0.15, 0.1, -0.4]
    start, wanted[:, :3] = (wanted[0].copy(), np.zeros((100, 3))), goal
    held_from = np.vstack([start[0], wanted[1:]])
    weights = np.r_[1.0, 1.0, 1.0, np.zeros(9)]
    cost = QuadraticCost(wanted, np.zeros((100, 3)), Q=weights, R=[1e-3] * 3, Q_final=1e4 * weights)
    limits = [
        Bound("motor*", -3.0, 3.0), Bound("arm*", -0.6, 1.3), Bound("x", max=0.05, at=[0.2, 0.25]),
        Keep("platform", outside=Ball((0.075, 0.05, -0.4), 0.06)),
        Keep("platform", inside=Box((-0.3, -0.3, -0.55), (0.3, 0.3, -0.3))),
        Equal(["x", "y", "z"], goal), Equal(list(arms), 0.0, of="rate"),
    ]  # fmt: skip
    alone = optimize(system, cost, initial=start, limits=limits, shooting="single")
    records = []
    result = optimize(system, cost, initial=start, limits=limits, callback=records.append)
    assert result.status is Status.CONVERGED, result.message
    # Which searches come back by themselves is a matter of rounding.
    assert any("began again, with gaps" in record.note for record in records) or alone.success
    assert result.limits.excess < 1e-8
    # Beside equations as dear as at the start it ended 3e-6 above.
    held = optimize(system, cost, initial=(held_from, start[1]), limits=limits, shooting="multiple")
    assert result.cost == pytest.approx(held.cost, rel=1e-7)
    assert result.cost == pytest.approx(0.5481465, rel=1e-6)  # what Ipopt finds from the straight line to the goal


def test_gaps_that_hardly_shrink_are_not_closed_at_any_price():
    """By the penalty with which a step is one of descent all of them may cost so much; ten times that is too much."""
    nothing = np.zeros((2, 1))

    def curve(theta, cost):
        return OpenCurve(nothing, nothing[:1], nothing[:1], nothing[:1], theta, theta, cost, None, cost)

    now, penalty = curve(theta=1.0, cost=2.0), 3.0
    takes = partial(Filter(1.0).takes, now, length=1.0, fall=-1.0, noise=0.0, penalty=penalty)
    assert takes(curve(theta=0.9, cost=31.9))
    assert not takes(curve(theta=0.9, cost=32.1))
    assert not takes(curve(theta=0.9, cost=np.nan))
    assert takes(curve(theta=0.9, cost=32.1), noise=0.2)
    # What is dear there need not be with other gaps.
    assert takes(curve(theta=0.9, cost=32.1), penalty=3.1)
    assert not Filter(1.0).takes(curve(0.5, 2.0), curve(0.45, 17.1), length=1.0, fall=-1.0, noise=0.0, penalty=penalty)


def test_gaps_that_cannot_close_end_a_run_in_words_where_no_start_can_be_rolled_out(tmp_path):
    """There is no motion: from everywhere two steps lead to where none can be made."""

    def drifts(x, u, k):
        if abs(x[0]) > 5.0:
            raise StepError("too far out", t=k, residuals={}, iteration=0)
        return x + 3.0 + 0.1 * np.sin(u)

    def derivatives(x, u, k):
        return np.eye(1), 0.1 * np.diag(np.cos(u))

    N = 8
    system = FunctionSystem(drifts, nx=1, nu=1, N=N, derivatives=derivatives)
    still = np.zeros((N + 1, 1)), np.zeros((N, 1))
    cost = QuadraticCost(*still, Q=[1.0], R=[0.1])
    result = optimize(system, cost, initial=still)
    assert result.status is Status.LINE_SEARCH_FAILED
    assert "too far out" in result.message
    assert "Gaps are still open" in result.message
    assert result.gap > 1.0
    assert np.isfinite(result.x).all()
    again = optimize(system, cost, resume=load_result(save_result(tmp_path / "open.npz", result)))
    assert again.status is result.status
    assert 1.0 < again.gap <= result.gap
