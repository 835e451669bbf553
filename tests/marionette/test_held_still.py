"""Motions that strings on bars cannot make: the puppet held still, and what is found from there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from leastaction.errors import ArgumentError, ProjectionError
from leastaction.io import Motion
from leastaction.models.marionette import REST, marionette
from leastaction.optimal import IterationRecord, OptimizationResult, Status
from leastaction_marionette import FORCED, PuppetLimits, TrackingRun, load_motion, track, walk_in_place
from leastaction_marionette.choices import Strings
from leastaction_marionette.tracking import TrackingSearch, poses, settle, tracker, tying
from leastaction_marionette.tracking.pace import Pace
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import at_rest, held_still
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.ties import FIRM, LEAST_WEIGHT
from leastaction_marionette.tracking.tracker import Tracker
from leastaction_marionette.tracking.tying import on_one_bar
from marionette.motions import PUPPET, captured


def test_a_puppet_that_is_held_still_is_near_all_that_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not only where it is to begin: an arm is raised soon, and is to stay up."""
    t = np.linspace(0.0, 0.8, 41)
    q = np.zeros((41, PUPPET.nd))
    for name, angle in REST.items():
        q[:, PUPPET.dynamic.index(name)] = angle
    arm = PUPPET.dynamic.index("rshoulder_rx")
    q[:, arm] = np.clip(5.0 * t, 0.0, 1.0)
    motion, puppet = Motion(PUPPET.dynamic, t, q, "an arm is raised"), marionette(strings="cross+hands")
    run = track(puppet, motion)
    plan = TrackingPlan(TrackingProblem(puppet, motion, FORCED, PuppetLimits(), threads=1))
    still = held_still(plan, run.plan)
    assert np.ptp(still.x, axis=0).max() == 0.0
    beginning, mean = at_rest(plan), at_rest(plan, k=None)
    assert plan.cost(tied=False).value(still.x, still.u) < 0.5 * plan.cost(tied=False).value(*beginning)
    np.testing.assert_allclose(still.x[0, arm], mean[0][0, arm], atol=1e-2)
    assert still.x[0, arm] > 0.5
    assert not still.success
    assert still.cost == plan.cost().value(still.x, still.u)

    # Where no pose near the start is held, one near the mean is; where none is at all, it says so.
    def only(*allowed: int | None) -> None:
        def sought(plan: TrackingPlan, *starts: np.ndarray, k: int | None = 0) -> tuple[np.ndarray, np.ndarray]:
            if k not in allowed:
                raise ArgumentError("no pose")
            return at_rest(plan, *starts, k=k)

        monkeypatch.setattr(poses, "at_rest", sought)

    only(None)
    np.testing.assert_array_equal(held_still(plan, run.plan).x, still.x)
    only()
    with pytest.raises(ArgumentError, match="all of them pull"):
        held_still(plan, run.plan)


def test_on_one_bar_it_begins_with_a_puppet_that_is_held_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """With longer steps at first."""
    monkeypatch.setattr(tracker, "_FEW", 10)
    weights, said = _told(monkeypatch), list[str]()
    run = track(marionette(strings="cross"), walk_in_place(0.5, 0.01), progress=said.append)
    assert run.result.success
    assert said[0] == "all strings are tied to one bar: it begins with a puppet that is held still"
    assert not any("motors" in line for line in said)
    assert weights[:2] == [(25, FIRM), (50, FIRM)]


@pytest.mark.parametrize("longer", [False, True])
@pytest.mark.parametrize("held", [False, True])
def test_where_that_leads_nowhere_it_begins_with_motors(
    held: bool, longer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where no pose is held still, or nothing is found from it: as if that had not been tried."""
    motion, puppet = walk_in_place(0.5, 0.01), marionette(strings="cross")
    if longer:
        monkeypatch.setattr(tracker, "_FEW", 10)
    weights, said, kept = _told(monkeypatch), list[str](), list[TrackingSearch]()
    holds_still, more_firmly = tying.held, tying.more_firmly

    def nothing_from(tracker: Tracker, near: OptimizationResult | None) -> tuple[Tracker, OptimizationResult]:
        if not held:
            raise (ProjectionError if longer else ArgumentError)("no pose")
        monkeypatch.setattr(tying, "more_firmly", not_tied)
        return holds_still(tracker, near)

    def not_tied(
        tracker: Tracker, result: OptimizationResult, *_: Any, **__: Any
    ) -> tuple[Tracker, OptimizationResult]:
        monkeypatch.setattr(tying, "more_firmly", more_firmly)
        return tracker, replace(result, status=Status.LINE_SEARCH_FAILED, message=tying._NOT_TIED)

    def keep(found: TrackingRun | TrackingSearch) -> None:
        if isinstance(found, TrackingSearch):
            kept.append(found)

    monkeypatch.setattr(tying, "held", nothing_from)
    run = track(puppet, motion, progress=said.append, checkpoint=keep, checkpoint_seconds=0.0)
    assert next(line for line in said[1:] if "tied more firmly" not in line).endswith(": it is sought with motors")
    assert run.result.success
    assert run.tension.min() >= 0.5
    assert weights[0] == (25 if longer else 50, LEAST_WEIGHT)
    monkeypatch.setattr(tying, "on_one_bar", lambda _: False)
    np.testing.assert_array_equal(track(puppet, motion).result.x, run.result.x)
    monkeypatch.setattr(tying, "on_one_bar", on_one_bar)
    # A search that was cut short there goes on there.
    said.clear()
    search = next(each for each in kept if each.firmness is None and each.stage == 1)
    track(search.mechanism, search.motion, resume=search, progress=said.append, max_iterations=1)
    assert said[0].startswith("motors at price")


def test_who_ends_a_search_on_one_bar_gets_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """By Ctrl-C, with longer steps or its own, or by a limit on iterations: nothing is sought with motors then."""
    monkeypatch.setattr(tracker, "_FEW", 10)
    motion, puppet, said = walk_in_place(0.5, 0.01), marionette(strings="cross"), list[str]()

    def stopped(after: int) -> TrackingRun:
        records = list[IterationRecord]()

        def callback(record: IterationRecord) -> None:
            records.append(record)
            if len(records) == after:
                raise KeyboardInterrupt

        return track(puppet, motion, progress=said.append, callback=callback)

    whole = list[int]()
    done = track(puppet, motion, callback=lambda record: whole.append(len(record.u)))
    own = whole.index(50)
    assert own > 2
    for after in (2, own + 1):
        run = stopped(after)
        assert run.result.status is Status.INTERRUPTED
        assert run.tension.min() >= 0.5
        assert len(run.result.u) == 50

    def at_the_limit(*arguments: Any, **options: Any) -> tuple[Tracker, OptimizationResult]:
        tracker, found = more_firmly(*arguments, **options)
        assert tracker.ties is not None
        tracker = replace(tracker.tied(tracker.ties.weight), left=0)
        return tracker, replace(found, status=Status.ITERATION_LIMIT)

    more_firmly = tying.more_firmly
    monkeypatch.setattr(tying, "more_firmly", at_the_limit)
    run = track(puppet, motion, progress=said.append)
    assert run.result.status is Status.ITERATION_LIMIT
    assert run.held_error == pytest.approx(done.held_error, abs=0.3)
    assert run.tension.min() >= 0.5
    assert not any("motors" in line for line in said)


@pytest.mark.parametrize("own_steps", [False, True])
def test_a_search_on_one_bar_that_is_ended_far_from_any_motion_goes_on_there(
    own_steps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit: what is kept is no puppet held still."""
    monkeypatch.setattr(tracker, "_FEW", 10)
    motion, puppet, kept, records = walk_in_place(0.5, 0.01), marionette(strings="cross"), [], list[IterationRecord]()

    def ended(record: IterationRecord) -> None:
        records.append(record)
        if len(record.u) == (50 if own_steps else 25) and record.iteration > 0:
            raise KeyboardInterrupt

    whole = track(puppet, motion)
    settled = settle.settled
    monkeypatch.setattr(settle, "settled", lambda *_: None)
    with pytest.raises(KeyboardInterrupt):
        track(puppet, motion, callback=ended, checkpoint=kept.append, checkpoint_seconds=1e9)
    search = kept[-1]
    assert isinstance(search, TrackingSearch)
    assert search.firmness == FIRM
    assert len(search.result.u) == (50 if own_steps else 25)
    monkeypatch.setattr(settle, "settled", settled)
    again = track(search.mechanism, search.motion, resume=search)
    np.testing.assert_array_equal(again.result.x, whole.result.x)
    assert again.effort.iterations == whole.effort.iterations


def test_where_nothing_is_found_from_a_puppet_held_still_it_has_its_own_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though longer ones were to be taken for what would be found from there."""
    monkeypatch.setattr(tracker, "_FEW", 10)

    def not_tied(
        tracker: Tracker, result: OptimizationResult, *_: Any, **__: Any
    ) -> tuple[Tracker, OptimizationResult]:
        return tracker, replace(result, status=Status.LINE_SEARCH_FAILED, message=tying._NOT_TIED)

    def no_pose(*_: Any) -> tuple[Tracker, OptimizationResult]:
        monkeypatch.setattr(tying, "held", holds_still)
        raise ArgumentError("no pose")

    holds_still = tying.held
    monkeypatch.setattr(tying, "more_firmly", not_tied)
    monkeypatch.setattr(tying, "held", no_pose)
    run = track(marionette(strings="cross+legs"), walk_in_place(0.5, 0.01))
    assert len(run.result.u) == 50
    assert not run.result.success
    assert run.tension.min() >= 0.5


@pytest.mark.parametrize("fails", [1, 2])
def test_where_nothing_near_a_motion_on_bars_keeps_lengths_it_begins_with_a_puppet_held_still(
    fails: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once: the pose itself is what is left."""
    settled, calls, said = settle.settled, list[int](), list[str]()

    def none_near(*arguments: Any) -> Any:
        calls.append(len(calls))
        return None if len(calls) <= fails else settled(*arguments)

    monkeypatch.setattr(settle, "settled", none_near)
    run = track(marionette(strings="cross+legs"), walk_in_place(0.5, 0.02), progress=said.append)
    assert sum("is near to what was found: it begins with a puppet that is held still" in line for line in said) == 1
    assert len(calls) == fails + 1
    assert run.tension.min() >= 0.5
    stands = bool(np.ptp(run.plan.x, axis=0).max() == 0.0)
    assert stands == any("it is held still" in line for line in said) == (fails == 2)
    assert run.result.success == (fails == 1)


def test_optimisations_on_bars_that_lead_on_end_where_they_creep(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is tied firmly with its own steps does not, nor what is on no bars: their optimisations are the last."""
    paces, tied = list[float](), list[tuple[float, bool]]()

    class Paced(Pace):
        def __init__(self, *, hardly: float = 0.0, earlier: OptimizationResult | None = None) -> None:
            super().__init__(hardly=hardly, earlier=earlier)
            paces.append(hardly)

    whole = tracker._optimised

    def optimised(it: Tracker) -> OptimizationResult:
        tied.append((np.inf if it.ties is None else it.ties.weight, it.slow is not None))
        return whole(it)

    monkeypatch.setattr(tracker, "_optimised", optimised)
    monkeypatch.setattr(tracker, "Pace", Paced)
    monkeypatch.setattr(tracker, "_FEW", 10)
    motion = walk_in_place(0.5, 0.01)
    track(marionette(strings="cross+legs"), motion)
    track(marionette(strings=7), motion, planned=True)
    assert {(LEAST_WEIGHT, True), (FIRM, True), (FIRM, False), (np.inf, False)} <= set(tied)
    for pace, (weight, slow) in zip(paces, tied, strict=True):
        assert pace == (0.002 if weight < FIRM else 0.005 if slow else 0.0)


def test_which_controls_are_one_bar_for_all_strings() -> None:
    assert [each for each in get_args(Strings) if on_one_bar(marionette(strings=each))] == ["cross"]


def _told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, float]]:
    """Return a list to which each optimisation of a motion on bars adds its steps, and what lengths weigh."""
    whole, weights = tying.improved, list[tuple[int, float]]()

    def improved(tracker: Tracker) -> tuple[Tracker, OptimizationResult]:
        tracker, result = whole(tracker)
        assert tracker.ties is not None
        weights.append((len(result.u), tracker.ties.weight))
        return tracker, result

    monkeypatch.setattr(tying, "improved", improved)
    return weights


@pytest.mark.slow
def test_a_person_who_waves_is_followed_from_a_puppet_held_still() -> None:
    """A cross has six numbers, and raises no arm alone: no motion is found on the way, and it had been held still."""
    said: list[str] = []
    motion = load_motion(captured("wave_hello.bvh"), dt=0.01).motion
    run = track(marionette(strings="cross"), motion, progress=said.append)
    assert any("begins with a puppet that is held still" in line for line in said)
    assert run.result.success
    assert run.tension.min() >= 0.5 - 1e-6
    assert run.held_error < 24.0
