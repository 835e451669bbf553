"""The marionette on control bars: strings of fixed lengths, tied to rigid bars whose poses are prescribed."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from leastaction.apps.cli import main
from leastaction.errors import ArgumentError, ProjectionError, ResultFileError
from leastaction.models.marionette import (
    CONTROLS,
    PLANE_HEIGHT,
    STRING_SETS,
    UNHELD,
    Control,
    PuppetString,
    bars_of,
    hang_strings,
    held_strings,
    marionette,
    set_of,
    string_lengths,
    strings_of,
    tie_strings,
    tied_strings,
)
from leastaction.models.puppet_controls import ends_of
from leastaction.optimal import (
    Bound,
    Cost,
    CostGradient,
    OptimizationResult,
    Optimizer,
    PricedLimit,
    PricedLimits,
    QuadraticCost,
    Status,
    check_derivatives,
)
from leastaction.optimal.quantity import Samples
from leastaction.systems import MidpointSystem
from leastaction_marionette import (
    FORCED,
    PuppetLimits,
    TrackingRun,
    load_run,
    marionette_scene,
    plot_bars,
    resting,
    save_run,
    track,
    walk_in_place,
)
from leastaction_marionette.choices import Strings
from leastaction_marionette.command.summary import run_summary
from leastaction_marionette.command.tables import as_text, summary_tables
from leastaction_marionette.tracking import (
    TrackingSearch,
    load_unfinished,
    save_search,
    settle,
    tracker,
    tying,
)
from leastaction_marionette.tracking.limits import pelvis_of
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem, unheld
from leastaction_marionette.tracking.ties import FIRM
from leastaction_marionette.tracking.tracker import Tracker

_LEAST = 0.5  # N


def walk() -> TrackingRun:
    motion = walk_in_place(1.0, 0.02)
    return track(marionette(strings="cross"), motion)


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    """A second of a walk with all strings on the cross."""
    return walk()


def planned(run: TrackingRun, limits: PuppetLimits) -> TrackingPlan:
    """Return the plan of a run, with other limits."""
    return TrackingPlan(TrackingProblem(run.mechanism, run.motion, FORCED, limits))


@pytest.mark.parametrize("control", CONTROLS)
def test_every_control_is_the_puppet_of_seven_strings_on_bars(control: Control) -> None:
    m, by_tension = marionette(strings=control), marionette(strings=control, by="tension")
    assert set_of(m) == set_of(by_tension) == control
    assert m.constraints == by_tension.inputs == tuple(string.name for string in STRING_SETS[7])
    assert strings_of(m) == strings_of(by_tension)
    assert bars_of(m) == bars_of(by_tension) == CONTROLS[control]
    tied = {name for bar in bars_of(m) for name in bar.ends}
    assert {string.name for string in tied_strings(m)} == tied
    assert {string.name for string in held_strings(m)} == set(m.constraints) - tied
    assert ("hands" in control) == (len(held_strings(m)) == 2)
    ends = ends_of(m)
    moved = {*ends.x, *ends.y, *ends.z, *ends.angles, *(string.length for string in held_strings(m))}
    assert moved == set(m.kinematic)
    assert unheld(m) == UNHELD


def test_the_command_line_offers_all_of_them() -> None:
    assert set(get_args(Strings)) == {*STRING_SETS, *CONTROLS}


@pytest.mark.parametrize("count", STRING_SETS)
def test_hands_hold_sets_of_strings(count: int) -> None:
    m = marionette(strings=count)  # type: ignore[arg-type]
    assert bars_of(m) == tied_strings(m) == ()
    assert strings_of(m) == held_strings(m)
    assert tie_strings(m, np.zeros(m.nq)) is m


@pytest.mark.parametrize("control", CONTROLS)
def test_a_bar_is_rigid_and_goes_where_its_variables_say(control: Control) -> None:
    m = marionette(strings=control)
    q = np.random.default_rng(1).uniform(-0.7, 0.7, (5, m.nq))
    for bar in bars_of(m):
        controls = {string.name: string.control for string in strings_of(m)}
        places = m.positions(q, [controls[name] for name in bar.ends])
        flat = np.array([(x, y, 0.0) for x, y in bar.ends.values()])
        for i, each in enumerate(flat):
            apart = np.linalg.norm(places - places[:, i : i + 1], axis=2)
            np.testing.assert_allclose(apart, np.tile(np.linalg.norm(flat - each, axis=1), (5, 1)), atol=1e-12)
        at = {name: q[:, m.variables.index(name)] for name in bar.variables}
        x, y, z = bar.places
        np.testing.assert_allclose(
            m.positions(q, [bar.name])[:, 0], np.stack([at[x], at[y], PLANE_HEIGHT + at[z]], axis=1), atol=1e-12
        )
        # About z, then y, then x: the bar's own axes in the world.
        turn = m.frame_pose(q, bar.name)[:, :3, :3]
        np.testing.assert_allclose(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]), at[bar.angles[0]], atol=1e-12)
        np.testing.assert_allclose(-np.arcsin(turn[:, 2, 0]), at[bar.angles[1]], atol=1e-12)


def test_bars_go_with_the_pelvis_and_strings_are_tied_where_they_are() -> None:
    m = marionette(strings="cross+legs+hands")
    q = np.zeros((2, m.nq))
    for name, value in {"torso_tx": 0.3, "torso_ty": -0.2, "torso_tz": 0.1, "torso_rz": np.pi / 2}.items():
        q[1, m.variables.index(name)] = value
    hung = hang_strings(m, q)
    values = dict(zip(m.variables, hung[1], strict=True))
    assert [values[f"cross-{each}"] for each in ("x", "y", "z", "rz", "ry", "rx")] == [0.3, -0.2, 0, np.pi / 2, 0, 0]
    # The leg bar is 0.3 m ahead, which is to the left of a puppet's place that has turned left.
    np.testing.assert_allclose([values["legs-x"], values["legs-y"]], [0.0, -0.2], atol=1e-12)
    tied = tie_strings(m, hung)
    expected = string_lengths(m, hung).mean(axis=0)
    for string, length in zip(strings_of(m), expected, strict=True):
        if not isinstance(string, PuppetString):
            assert tied.parameters[string.length] == pytest.approx(length, rel=1e-14)
    # As it comes it stands straight under a level control.
    assert np.abs(m.constraint_values(hung[0])).max() < 1e-12


def test_the_price_of_lengths_has_its_derivatives() -> None:
    motion = walk_in_place(0.2, 0.02)
    m = marionette(strings="cross+legs")
    plan = TrackingPlan(TrackingProblem(m, motion, FORCED, PuppetLimits(), threads=1))
    assert plan.ties is not None
    plan.ties.weight = 50.0
    x = plan.x_reference + np.random.default_rng(4).normal(0.0, 0.02, plan.x_reference.shape)
    assert check_derivatives(plan.system, x, plan.u_reference, cost=plan.cost(), tolerance=1e-6).ok
    # What it adds is w c^2 / 2 with c = (d^2 - L^2) / (2 L), by lengths measured elsewhere.
    q = np.zeros((len(x), m.nq))
    q[:, [m.variables.index(name) for name in plan.mechanism.variables]] = x[:, : plan.mechanism.nq]
    d, L = string_lengths(m, q), np.array([m.parameters[string.length] for string in tied_strings(m)])
    c = (d**2 - L**2) / (2.0 * L)
    added = 25.0 * np.sum(c**2)
    without = plan.tracking_cost().value(x, plan.u_reference)
    assert plan.cost().value(x, plan.u_reference) == pytest.approx(without + added, rel=1e-12)


def test_a_walk_on_the_cross_keeps_the_lengths_and_every_limit(run: TrackingRun) -> None:
    m, limits = run.mechanism, PuppetLimits()
    assert run.result.success
    assert run.embedded
    lengths = string_lengths(m, run.trajectory.q)
    expected = [m.parameters[string.length] for string in tied_strings(m)]
    np.testing.assert_allclose(lengths, np.tile(expected, (len(lengths), 1)), rtol=0.0, atol=1e-9)
    assert run.tension.min() >= _LEAST
    assert limits.broken(m, run.trajectory.t, pelvis_of(m, run.reference), run.result.x) == frozenset()
    assert run.held_error < 4.0
    # The bar moves: it is what the puppet follows by.
    assert max(np.ptp(run.trajectory[name]) for name in CONTROLS["cross"][0].variables) > 0.01


def test_strings_that_keep_their_lengths_leave_no_limit_broken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion near the planned one is sought within limits; where it is found without them the run says so."""
    limits = PuppetLimits(speed=0.4, tilt=0.15)

    def broken(run: TrackingRun, share: float) -> frozenset[str]:
        pelvis = pelvis_of(run.mechanism, run.reference)
        return limits.loosened(share).broken(run.mechanism, run.trajectory.t, pelvis, run.result.x)

    run = track(marionette(strings="cross"), walk_in_place(0.5, 0.02), limits=limits)
    assert run.result.success
    assert broken(run, 0.0) == frozenset()
    assert run.tension.min() >= limits.tension
    speed = max(np.abs(np.diff(run.trajectory[f"cross-{axis}"])).max() for axis in "xyz") / 0.02
    assert speed > 0.999 * limits.speed  # as fast as it may

    class Unlimited(Optimizer):
        def __init__(self, system: MidpointSystem, cost: Cost, *limits: object, **named: Any) -> None:
            super().__init__(system, cost, **named)

    monkeypatch.setattr(settle, "Optimizer", Unlimited)
    without = track(marionette(strings="cross"), walk_in_place(0.5, 0.02), limits=limits)
    assert broken(without, 1e-3) == {"speed"}
    assert without.result.status is Status.INFEASIBLE
    assert "it breaks limits of speed" in without.result.message


def test_the_price_of_broken_limits_has_its_derivatives(run: TrackingRun) -> None:
    problem = TrackingProblem(run.mechanism, run.motion, FORCED, PuppetLimits())
    system, x, u = problem.system, run.result.x, run.result.u
    chance, m = np.random.default_rng(0), run.mechanism
    x, u = x + 1e-3 * chance.normal(size=x.shape), u + 1e-3 * chance.normal(size=u.shape)
    none = QuadraticCost(x, u, Q=np.zeros(system.nx), R=np.full(system.nu, 1e-9))
    priced = [
        PricedLimit(Bound([s.name for s in strings_of(m)], min=50.0, of="tension"), 1e-3),
        PricedLimit(Bound("cross-x", -1e-4, 1e-4, of="acceleration"), 1e-3),
        PricedLimit(Bound("lknee_rx", max=-1.0, of="variable"), 3.0),
    ]
    cost = PricedLimits(none, system, priced)
    lengths = np.array([m.parameters[string.length] for string in tied_strings(m)])
    order = [[s.name for s in tied_strings(m)].index(name) for name in m.constraints]
    tensions = x[1:, m.nx :] * 2.0 * lengths[order] / problem.dt
    knee = x[1:, m.variables.index("lknee_rx")]
    accelerations = system.quantity("acceleration").select([m.kinematic.index("cross-x")])
    made = accelerations.values(Samples(np.arange(system.N), x[:-1], u, x[1:]))
    assert cost.value(x, u) == pytest.approx(
        5e-4 * np.sum(np.maximum(50.0 - tensions, 0.0) ** 2)
        + 1.5 * np.sum(np.maximum(knee + 1.0, 0.0) ** 2)
        + 5e-4 * np.sum(np.maximum(np.abs(made) - 1e-4, 0.0) ** 2),
        rel=1e-9,
    )
    assert cost.off(x, u) == pytest.approx(max((50.0 - tensions).max(), (knee + 1.0).max(), np.abs(made).max() - 1e-4))
    dx, du = chance.normal(size=x.shape), chance.normal(size=u.shape)
    slope, step = cost.gradient(x, u), 1e-6

    def along(a: CostGradient) -> float:
        return float(np.sum(a.q * dx[:-1]) + np.sum(a.r * du) + a.q_final @ dx[-1])

    rise = cost.value(x + step * dx, u + step * du) - cost.value(x - step * dx, u - step * du)
    assert along(slope) == pytest.approx(rise / (2.0 * step), rel=1e-5)
    bent = cost.convex_hessian(x, u)
    curved = (
        np.einsum("ki,kij,kj->", dx[:-1], bent.Q, dx[:-1])
        + np.einsum("ki,kij,kj->", du, bent.R, du)
        + 2.0 * np.einsum("ki,kij,kj->", dx[:-1], bent.S, du)
        + dx[-1] @ bent.Q_final @ dx[-1]
    )
    more, less = cost.gradient(x + step * dx, u + step * du), cost.gradient(x - step * dx, u - step * du)
    assert curved == pytest.approx((along(more) - along(less)) / (2.0 * step), rel=1e-3)


def test_the_motion_is_one_of_the_puppet_on_rods(run: TrackingRun) -> None:
    """By the integrator with constraints, which knows nothing of plans by tensions."""
    problem = TrackingProblem(run.mechanism, run.motion, FORCED, PuppetLimits())
    done = problem.system.step_each(run.result.x, run.result.u)
    assert done.complete
    np.testing.assert_allclose(done.x[:, : run.mechanism.nq], run.result.x[1:, : run.mechanism.nq], atol=1e-7)


def test_a_round_that_leads_nowhere_does_not_lose_what_an_earlier_one_found(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stands, as near to the lengths of strings as it is."""
    plan, runs = planned(run, PuppetLimits(tension=5.0)), list[int]()

    class Lost(Optimizer):
        def run(self, *given: Any, **named: Any) -> OptimizationResult:
            if self.system is plan.system:
                runs.append(len(runs))
                if len(runs) > 1:
                    raise ProjectionError("lost")
            return super().run(*given, **named)

    monkeypatch.setattr(settle, "Optimizer", Lost)
    monkeypatch.setattr(settle, "_EXACT", 0.0)  # so that one round is not enough
    found = settle.settled(plan, run.plan)
    assert runs == [0, 1]
    assert found is not None
    pulls = np.stack(list(plan.problem.system.trajectory(*found).tensions().values()))
    assert pulls[:, 1:].min() > _LEAST


def test_strings_that_keep_their_lengths_pull_no_more_than_they_bear(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A motion near one whose strings pull by more; and a run that was not brought to it does not say it converged."""
    most = float(run.tension.max())
    limits = PuppetLimits(strength=0.9 * most)
    plan = planned(run, limits)
    found = settle.settled(plan, run.plan)
    assert found is not None
    pulls = np.stack(list(plan.problem.system.trajectory(*found).tensions().values()))
    assert 0.8 * most < pulls.max() <= limits.strength
    monkeypatch.setattr(settle, "settled", lambda *_: (run.result.x, run.result.u))
    for strength, status in ((1.1 * most, Status.CONVERGED), (0.9 * most, Status.INFEASIBLE)):
        ended = settle.by_lengths(planned(run, PuppetLimits(strength=strength)), run.plan)
        assert ended.status is status
    assert "limits of tension" in ended.message


def test_a_run_on_bars_comes_back_from_its_file_and_goes_on(run: TrackingRun, tmp_path: Path) -> None:
    loaded = load_run(save_run(tmp_path / "run.npz", run))
    assert loaded.mechanism.parameters == run.mechanism.parameters
    assert set_of(loaded.mechanism) == "cross"
    np.testing.assert_array_equal(loaded.tension, run.tension)
    again = track(loaded.mechanism, loaded.motion, resume=loaded)
    assert again.result.success
    assert again.mechanism.parameters == run.mechanism.parameters
    assert again.tension.min() >= _LEAST
    assert again.held_error == pytest.approx(run.held_error, abs=0.1)


@pytest.mark.parametrize(("dt", "iterations"), [(0.02, 1), (0.02, 4), (0.01, 1)])
def test_a_run_cut_short_is_an_answer_too(dt: float, iterations: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker, "_FEW", 10)
    run = track(marionette(strings="cross+legs"), walk_in_place(0.4, dt), max_iterations=iterations)
    assert len(run.result.u) == round(0.4 / dt)
    assert run.tension.min() >= _LEAST
    lengths = string_lengths(run.mechanism, run.trajectory.q)
    assert np.ptp(lengths, axis=0).max() < 1e-9
    again = track(run.mechanism, run.motion, resume=run)
    assert again.tension.min() >= _LEAST
    assert again.held_error < run.held_error + 0.1


def test_strings_are_tied_loosely_with_longer_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """And firmly with the motion's own: the answer is that of a search with these alone."""
    motion, ends = walk_in_place(0.5, 0.01), dict[int, list[float]]()
    whole = tying.improved

    def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
        tracker, result = whole(tracker)
        assert tracker.ties is not None
        ends.setdefault(len(result.u), []).append(tracker.ties.weight)
        return tracker, result

    monkeypatch.setattr(tying, "improved", improved)
    alone = track(marionette(strings="cross+legs"), motion)
    assert set(ends) == {50}
    ends.clear()
    monkeypatch.setattr(tracker, "_FEW", 10)
    run = track(marionette(strings="cross+legs"), motion)
    assert run.result.success
    assert set(ends) == {25, 50}
    assert max(ends[25]) == FIRM == min(ends[50])
    assert len(run.result.u) == len(run.trajectory.t) - 1 == 50
    assert np.ptp(string_lengths(run.mechanism, run.trajectory.q), axis=0).max() < 1e-9
    assert run.tension.min() >= _LEAST
    assert run.held_error < alone.held_error + 0.05


def test_strings_are_tied_nomore_firmly_than_they_need_to_be() -> None:
    """Where rounding of what lengths cost looks like negative curvature, a motion that was found is no failure."""
    said: list[str] = []
    run = track(marionette(strings="cross+legs"), walk_in_place(0.4, 0.02), progress=said.append)
    assert run.result.success
    assert not any("cannot be tied" in line for line in said)
    assert np.ptp(string_lengths(run.mechanism, run.trajectory.q), axis=0).max() < 1e-9


def test_strings_that_vary_by_less_than_a_millimetre_are_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lengths are exact then, and limits are kept."""
    monkeypatch.setattr(tying, "on_one_bar", lambda _: False)  # it begins with motors
    said: list[str] = []
    run = track(marionette(strings="cross"), walk_in_place(0.5, 0.02), progress=said.append)
    off = float(said[-1].split("vary by ")[1].split(" mm")[0])
    assert off > 0.01
    assert run.result.success
    assert np.ptp(string_lengths(run.mechanism, run.trajectory.q), axis=0).max() < 1e-9
    pelvis = pelvis_of(run.mechanism, run.reference)
    assert PuppetLimits().broken(run.mechanism, run.trajectory.t, pelvis, run.result.x) == frozenset()
    assert run.tension.min() >= _LEAST


@pytest.mark.parametrize(("dt", "after"), [(0.02, 1), (0.02, 3), (0.01, 1), (0.01, 6)])
def test_what_is_found_while_strings_are_tied_is_kept_and_gone_on_with(
    dt: float, after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the program ends then: with the lengths that strings had, as if it had not ended."""
    monkeypatch.setattr(tracker, "_FEW", 10)
    motion, kept = walk_in_place(0.4, dt), list[TrackingSearch]()

    class Killed(Exception):
        """The program ends without a word."""

    def checkpoint(found: TrackingRun | TrackingSearch) -> None:
        if isinstance(found, TrackingSearch) and found.firmness is not None:
            kept.append(found)
            if len(kept) == after:
                raise Killed

    with pytest.raises(Killed):
        track(marionette(strings="cross+legs"), motion, checkpoint=checkpoint, checkpoint_seconds=0.0)
    path = save_search(tmp_path / "search.npz", kept[-1])
    search = load_unfinished(path)
    assert isinstance(search, TrackingSearch)
    assert search.firmness == kept[-1].firmness
    assert len(search.result.u) == 20
    assert search.mechanism.parameters == kept[-1].mechanism.parameters
    run = track(search.mechanism, search.motion, resume=search)
    whole = track(marionette(strings="cross+legs"), motion)
    np.testing.assert_array_equal(run.result.x, whole.result.x)
    assert run.effort.iterations == whole.effort.iterations
    for wrong in ({"firmness": -1.0}, {"firmness": 1.0, "mechanism": marionette()}):
        save_search(tmp_path / "wrong.npz", replace(search, **wrong))  # type: ignore[arg-type]
        with pytest.raises(ResultFileError, match="contradicts itself"):
            load_unfinished(tmp_path / "wrong.npz")
    with pytest.raises(ArgumentError, match="tied to bars"):
        track(marionette(), motion, resume=replace(search, mechanism=marionette()))


def test_a_motion_on_which_strings_cannot_be_tied_ends_in_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a search ends at the edge of what a step of time can follow. Gone on with, hardly more is gained."""
    made, whole = 0, tying.improved

    def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
        nonlocal made
        made += 1
        if made > 1:
            raise ProjectionError("lost")
        return whole(tracker)

    monkeypatch.setattr(tying, "improved", improved)
    monkeypatch.setattr(tying, "on_one_bar", lambda _: False)  # it begins with motors
    said: list[str] = []
    run = track(marionette(strings="cross"), walk_in_place(0.4, 0.02), progress=said.append)
    assert any("cannot be tied more firmly: lost" in line for line in said)
    assert not run.result.success
    assert run.tension.min() >= _LEAST
    assert np.ptp(string_lengths(run.mechanism, run.trajectory.q), axis=0).max() < 1e-9
    still = np.ptp(run.trajectory.q, axis=0).max() < 1e-2
    assert ("held still" if still else "could not be tied") in run.result.message
    monkeypatch.undo()
    again = track(run.mechanism, run.motion, resume=run)
    assert again.tension.min() >= _LEAST
    assert again.result.success
    assert again.held_error == pytest.approx(run.held_error, abs=0.03)


def test_what_is_still_to_be_tied_need_not_be_a_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that creeps while strings are tied loosely goes on to tie them, where it stands."""
    tied: list[OptimizationResult] = []

    def with_lengths_of(tracker: Tracker, result: OptimizationResult) -> Tracker:
        tied.append(result)
        return whole(tracker, result)

    whole = tying.with_lengths_of
    monkeypatch.setattr(tying, "with_lengths_of", with_lengths_of)
    monkeypatch.setattr(Pace, "creeps", lambda *_: not tied)
    said: list[str] = []
    run = track(marionette(strings="cross+legs"), walk_in_place(0.4, 0.02), progress=said.append)
    assert tied[0].iterations == 0
    assert tied[0].status is Status.ITERATION_LIMIT
    assert not any("is held still" in line for line in said)
    assert run.result.success


@pytest.mark.slow
def test_what_bars_and_hands_of_their_own_buy() -> None:
    motion = walk_in_place(2.5, 0.02)
    runs = {control: track(marionette(strings=control), motion) for control in CONTROLS}
    for control, run in runs.items():
        assert run.result.success, control
        assert run.tension.min() >= _LEAST, control
        lengths = dict(zip(run.mechanism.constraints, string_lengths(run.mechanism, run.trajectory.q).T, strict=True))
        assert max(np.ptp(lengths[string.name]) for string in tied_strings(run.mechanism)) < 1e-9
    off = {control: run.held_error for control, run in runs.items()}
    assert off["cross+legs+hands"] < min(off["cross+legs"], off["cross+hands"])
    assert max(off["cross+legs"], off["cross+hands"]) < off["cross"]
    assert off["cross+legs+hands"] < 1.0


def test_bars_keep_to_the_tilt_that_is_allowed(run: TrackingRun) -> None:
    tilts = ends_of(run.mechanism).tilts
    free = max(np.abs(run.trajectory[name]).max() for name in tilts)
    most = 0.4 * free
    held = track(marionette(strings="cross"), run.motion, limits=PuppetLimits(tilt=most))
    assert max(np.abs(held.trajectory[name]).max() for name in tilts) < most + 1e-4
    assert held.held_error > run.held_error
    assert held.tension.min() >= _LEAST


def test_what_bars_can_hold_at_rest_has_their_lengths(run: TrackingRun) -> None:
    rest = resting(run, instants=2)
    assert rest.missing == 0
    np.testing.assert_allclose(
        string_lengths(run.mechanism, rest.q),
        np.tile([run.mechanism.parameters[s.length] for s in tied_strings(run.mechanism)], (2, 1)),
        atol=1e-5,
    )
    assert rest.tension.min() >= _LEAST - 1e-9


def test_the_scene_and_the_summary_have_the_bars(run: TrackingRun) -> None:
    scene = marionette_scene(run)
    # The ends of all strings are on drawn beams.
    ends = np.array([scene.points[name][0] for bone in scene.bones for name in (bone.start, bone.end)])
    for string in strings_of(run.mechanism):
        assert np.linalg.norm(ends - scene.points[string.control][0], axis=1).min() < 1e-12
    assert scene.ghost is not None
    assert "cross_beam_of_back_string" not in scene.ghost  # nothing is wanted of the bar
    assert "lhand" in scene.ghost
    summary = run_summary(run)
    assert set(summary["bars"]) == {"cross"}
    turned = summary["bars"]["cross"]["rx"]
    assert turned["max"] == pytest.approx(np.rad2deg(run.trajectory["cross-rx"].max()))
    assert summary["limits_broken"] == []
    text = as_text(summary_tables(summary))
    assert "Bars" in text
    assert "tilted back" in text


def test_limits_that_a_settled_motion_breaks_are_told(run: TrackingRun) -> None:
    """Strings on bars are settled after the search, which keeps to them."""
    assert run_summary(run)["limits_broken"] == []
    speed = float(max(np.abs(np.diff(run.trajectory[name])).max() for name in ("cross-x", "cross-y", "cross-z"))) / 0.02
    for share, said in ((1.01, []), (1.1, ["speed"])):
        other = replace(run, limits=PuppetLimits(speed=speed / share))
        broken = run_summary(other)["limits_broken"]
        assert len(broken) == len(said)
        assert all("speed" in each for each in broken)


def test_bars_and_runs_on_them_can_be_pickled(run: TrackingRun) -> None:
    for bars in CONTROLS.values():
        assert pickle.loads(pickle.dumps(bars)) == copy.deepcopy(bars) == bars
    with pytest.raises(TypeError):
        CONTROLS["cross"][0].ends["back_string"] = (0.0, 0.0)  # type: ignore[index]
    again = pickle.loads(pickle.dumps(run))
    assert set_of(again.mechanism) == "cross"
    np.testing.assert_array_equal(again.tension, run.tension)


def test_poses_of_bars_are_drawn(run: TrackingRun) -> None:
    figure = plot_bars(run)
    places, turns = figure.axes
    ahead = next(line for line in places.lines if line.get_label() == "ahead")
    wanted = run.reference[:, run.mechanism.variables.index("torso_ty")]
    yaw = run.reference[:, run.mechanism.variables.index("torso_rz")]
    assert np.abs(yaw).max() < 0.1
    np.testing.assert_allclose(ahead.get_ydata(), run.trajectory["cross-y"] - wanted, atol=0.1 * np.ptp(wanted) + 5e-3)
    tilted = next(line for line in turns.lines if line.get_label() == "tilted back")
    np.testing.assert_allclose(tilted.get_ydata(), np.rad2deg(run.trajectory["cross-rx"]))
    with pytest.raises(ArgumentError, match="held by hands"):
        plot_bars(track(marionette(), walk_in_place(0.2, 0.02), max_iterations=1))


def test_bad_controls_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ArgumentError, match=r"'croos'.*'cross\+legs'"):
        marionette(strings="croos")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="tilt is 2"):
        PuppetLimits(tilt=2.0)
    for name in ("lift", "turn", "turn_speed", "turn_acceleration"):
        with pytest.raises(ArgumentError, match=f"{name} is 0"):
            PuppetLimits(**{name: 0.0})  # type: ignore[arg-type]
    for words, said in (
        (["--strings", "croos"], "cross+legs+hands"),
        (["--strings", "cross", "--tilt", "100"], "tilt is 1.7"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["optimize", "marionette", "--out", str(tmp_path / "x"), *words])
        assert ended.value.code == 2
        assert said in capsys.readouterr().err
