"""What steps of time resolve, as a limit: where a run is stuck at steps that are too coarse."""

from __future__ import annotations

import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction.costs import OrientationCost
from leastaction.errors import ProjectionError
from leastaction.io.results import load_result, save_result
from leastaction.mechanics import Gravity, JointForce, Mechanism, MidpointVI, ball, rx, ty, tz
from leastaction.optimal import Bound, OptimizationResult, QuadraticCost, Status, WindowSystem, optimize
from leastaction.optimal.search.beginning import Beginning
from leastaction.systems import MidpointSystem

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness import certify
from benchmarks.robustness_others import OTHERS
from benchmarks.robustness_problems import PROBLEMS, Given

# What is held to here is the search among resolved motions: some of these stand on steps that are too coarse.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

BY_NAME = {problem.name: problem for problem in [*PROBLEMS, *OTHERS]}
STUCK = "acrobot, swing-up, R 1e-06, final 1e+06, rest 0"
BEGAN = "began again, among motions that the steps of time resolve"


def stuck() -> Given:
    return BY_NAME[STUCK].build()


def turned(result: OptimizationResult) -> float:
    """Return the largest angle by which a variable turns within a step (rad)."""
    return float(np.abs(np.diff(result.x[:, :2], axis=0)).max())


def test_a_minimum_among_motions_that_the_steps_of_time_resolve_says_so() -> None:
    given, notes = stuck(), list[str]()
    result = optimize(
        given.system, given.cost, initial=(given.x, given.u), callback=lambda record: notes.append(record.note)
    )
    assert result.status is Status.RESOLVED
    assert result.success
    assert sum(BEGAN in note for note in notes) == 1
    # The instants, whose angle it is, and what would help.
    assert "'elbow' would turn further within step 0 at t = 0 s" in result.message
    assert re.search(r"take steps of time \d+ times shorter, or weigh inputs", result.message)
    # The limit is told like any other, and it is kept.
    assert result.limits is not None
    (label,) = [label for label in result.limits.labels if "elbow <=" in label]
    assert label.startswith("rate of elbow <= 35")
    assert result.limits.excess <= 1e-6
    assert turned(result) == pytest.approx(0.7, rel=1e-6)
    assert result.cost == given.cost.value(result.x, result.u)
    # It is the minimum with that limit, as it is found when it is stated.
    dt = np.diff(given.system.t)[:, None]
    limit = Bound(["shoulder", "elbow"], -0.7 / dt, 0.7 / dt, of="rate")
    stated = optimize(given.system, given.cost, initial=(given.x, given.u), limits=[limit])
    assert result.cost == pytest.approx(stated.cost, rel=1e-6)
    # A run that is over stays so.
    again = optimize(given.system, given.cost, resume=result)
    assert again.status is Status.RESOLVED
    assert again.message == result.message
    np.testing.assert_array_equal(again.x, result.x)


@pytest.mark.parametrize("seed", range(3))
def test_a_search_does_not_rest_where_a_step_is_nearly_a_full_turn(seed: int) -> None:
    """A body at rest is to be turned along a curve past half a turn, where the way that is missing changes its side.

    What is cheapest turns by most of a full turn in one step. Where steps may come as close to that as they like, their
    derivatives are infinite, and whether a search ends there is a matter of rounding.
    """
    t = np.linspace(0.0, 2.0, 41)
    body = [ball("b", mass=1.0, inertia=(0.1, 0.1, 0.1), name="body")]
    m = Mechanism(body, [JointForce(f"b.w{axis}", input=axis) for axis in "xyz"])
    vi = MidpointVI(m, threads=1)
    system, x0 = MidpointSystem(vi, t), vi.start(m.configuration()).x
    cost = QuadraticCost(np.tile(x0, (41, 1)), np.zeros((40, 3)), Q=np.zeros(6), R=[1e-3] * 3, space=system)
    wanted = Rotation.from_rotvec(np.outer(0.95 * np.pi * t, [0.0, 0.0, 1.0])).as_matrix()
    missing = OrientationCost(cost, system, {"body": wanted}, {"body": 100.0})
    u = 1e-9 * np.random.default_rng(seed).standard_normal((40, 3))
    result = optimize(system, missing, initial=(x0, u))
    assert result.success, result.message


def test_the_limit_is_dropped_where_it_holds_nothing_back() -> None:
    given, notes = BY_NAME["acrobot, swing-up, R 0.001, final 1e+06, random 2"].build(), list[str]()
    weights = {"Q": given.cost.Q, "R": given.cost.R, "Q_final": given.cost.Q_final}
    cost = Own(given.cost.x_wanted, given.cost.u_wanted, **weights)
    result = optimize(
        given.system, cost, initial=(given.x, given.u), shooting="single",
        callback=lambda record: notes.append(record.note),
    )  # fmt: skip
    assert result.status is Status.CONVERGED
    assert any(BEGAN in note for note in notes)
    assert result.state is not None
    assert result.state.run.resolved is None
    assert result.limits is None
    assert certify(given, result.x, result.u).minimum


def test_a_motion_that_no_regulator_follows_is_where_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the limit, motions near a full turn of a ball may have no regulator: the run ended in its error."""

    def lost(*_: object) -> None:
        raise ProjectionError("initial: there is no regulator about it")

    given = BY_NAME["acrobot, swing-up, R 0.001, final 1e+06, random 2"].build()
    weights = {"Q": given.cost.Q, "R": given.cost.R, "Q_final": given.cost.Q_final}
    cost = Own(given.cost.x_wanted, given.cost.u_wanted, **weights)
    monkeypatch.setattr(Beginning, "go_on_from", lost)
    result = optimize(given.system, cost, initial=(given.x, given.u), shooting="single")
    assert result.status is Status.CONVERGED
    assert result.cost == cost.value(result.x, result.u)


class Own(QuadraticCost):
    """A quadratic cost, for all that the optimiser knows with terms of its own: there is no easier one."""


@pytest.mark.parametrize("how", ["memory", "pickle", "file"])
def test_a_run_within_the_limit_is_resumed_as_it_was(how: str, tmp_path: Path) -> None:
    given = stuck()
    whole = optimize(given.system, given.cost, initial=(given.x, given.u))
    began = int(np.argmax(np.diff(whole.history.cost) > 1.0))  # where it begins again, the cost rises
    for stop in (began + 3, whole.iterations - 4):
        part = optimize(given.system, given.cost, initial=(given.x, given.u), max_iterations=stop)
        assert part.status is Status.ITERATION_LIMIT
        if how == "pickle":
            part = pickle.loads(pickle.dumps(part))
        elif how == "file":
            part = load_result(save_result(tmp_path / f"{stop}.npz", part))
        rest = optimize(given.system, given.cost, resume=part)
        np.testing.assert_array_equal(rest.x, whole.x)
        np.testing.assert_array_equal(rest.K, whole.K)
        np.testing.assert_array_equal(rest.history.cost, whole.history.cost)
        assert rest.message == whole.message


def test_it_is_beside_the_limits_that_were_asked_for() -> None:
    given = stuck()
    limits = [Bound("motor", -1500.0, 1500.0)]
    result = optimize(given.system, given.cost, initial=(given.x, given.u), limits=limits)
    assert result.success, result.message
    assert np.abs(result.u).max() <= 1500.0 * (1.0 + 1e-6)


def test_what_a_system_resolves_is_that_of_its_angles() -> None:
    tree = [ty("cart", mass=1.0), [rx("pole"), [tz(-1.0, mass=1.0)]]]
    m = Mechanism(tree, [Gravity(), JointForce("cart", input="push")])
    system = MidpointSystem(MidpointVI(m), np.array([0.0, 0.1, 0.3, 0.4]))
    found = system.resolved_rates()
    assert found is not None
    names, rates = found
    assert names == ("pole",)
    np.testing.assert_allclose(rates[:, 0], [7.0, 3.5, 7.0])
    part = WindowSystem(system, 1, 3).resolved_rates()
    assert part is not None
    np.testing.assert_array_equal(part[1], rates[1:])
