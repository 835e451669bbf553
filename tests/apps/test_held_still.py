"""Motions that strings on bars cannot make: the puppet held still, and what is found from there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from apps.motions import PUPPET, captured
from leastaction.apps.marionette import FORCED, PuppetLimits, load_motion, track, walk_in_place
from leastaction.apps.marionette.tracking import poses, tying
from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.poses import at_rest, held_still
from leastaction.apps.marionette.tracking.problem import TrackingProblem
from leastaction.apps.marionette.tracking.ties import FIRM, LEAST_WEIGHT
from leastaction.apps.marionette.tracking.tracker import Tracker
from leastaction.apps.marionette.tracking.tying import _expected, _foretold
from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.models.marionette import REST, marionette
from leastaction.optimal import OptimizationResult, Status


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
    assert run.plan is not None
    plan = Plan(TrackingProblem(puppet, motion, FORCED, 1), FORCED, PuppetLimits())
    still = held_still(plan, run.plan)
    assert np.ptp(still.x, axis=0).max() == 0.0
    beginning, mean = at_rest(plan), at_rest(plan, k=None)
    assert plan.untied_cost().value(still.x, still.u) < 0.5 * plan.untied_cost().value(*beginning)
    np.testing.assert_allclose(still.x[0, arm], mean[0][0, arm], atol=1e-2)
    assert still.x[0, arm] > 0.5
    assert not still.success
    assert still.cost == plan.cost().value(still.x, still.u)

    # Where no pose near the start is held, one near the mean is; where none is at all, it says so.
    def only(*allowed: int | None) -> None:
        def sought(plan: Plan, *starts: np.ndarray, k: int | None = 0) -> tuple[np.ndarray, np.ndarray]:
            if k not in allowed:
                raise ArgumentError("no pose")
            return at_rest(plan, *starts, k=k)

        monkeypatch.setattr(poses, "at_rest", sought)

    only(None)
    np.testing.assert_array_equal(held_still(plan, run.plan).x, still.x)
    only()
    with pytest.raises(ArgumentError, match="all of them pull"):
        held_still(plan, run.plan)


def test_what_strings_that_are_not_to_be_tied_cost_is_foretold() -> None:
    assert _foretold([1.0], 6) == 1.0
    assert _foretold([1.0, 2.0], 5) == 2.0
    assert _foretold([1.0, 2.0, 3.5], 4) == 3.5  # hardly more than before
    assert _foretold([1.0, 2.0, 4.5], 4) == 4.5 + 4 * 2.5
    assert _foretold([1.0, 2.0, 4.5, 5.0], 3) == 5.0


def test_how_far_strings_will_vary_is_foretold() -> None:
    assert _expected([0.2, 0.2], 3) == 0.0  # lengths are still sought
    assert _expected([0.2, 0.2, 0.1], 1) == pytest.approx(0.05)
    assert _expected([0.2, 0.2, 0.1], 2) == pytest.approx(0.025)
    assert _expected([0.2, 0.1, 0.12], 2) == pytest.approx(0.12)
    assert _expected([0.01], 0) == 0.01


def test_on_one_bar_it_begins_with_a_puppet_that_is_held_still(monkeypatch: pytest.MonkeyPatch) -> None:
    """With longer steps at first; and with motors where no pose is held still, or nothing is found from it."""
    motion = walk_in_place(0.5, 0.01)
    monkeypatch.setattr(tying, "_FEW", 10)
    weights, whole = list[tuple[int, float]](), Tracker.improve

    def improve(self: Tracker) -> OptimizationResult:
        result = whole(self)
        assert self.plan is not None
        assert self.plan.ties is not None
        weights.append((len(result.u), self.plan.ties.weight))
        return result

    monkeypatch.setattr(Tracker, "improve", improve)
    said: list[str] = []
    run = track(marionette(strings="cross"), motion, progress=said.append)
    assert run.result.success
    assert said[0] == "all strings are tied to one bar: it begins with a puppet that is held still"
    assert not any("motors" in line for line in said)
    assert weights[:2] == [(25, FIRM[0]), (50, FIRM[0])]

    def held(*_: object) -> OptimizationResult:
        raise ArgumentError("no pose")

    def stuck(tracker: Tracker, near: OptimizationResult) -> OptimizationResult:
        found = holds_still(tracker, near)
        monkeypatch.setattr(tying, "_more_firmly", tie)
        return found

    def tie(*arguments: Any, **options: Any) -> OptimizationResult:
        monkeypatch.setattr(tying, "_more_firmly", more_firmly)
        return replace(arguments[1], status=Status.LINE_SEARCH_FAILED, message=tying._NOT_TIED)

    holds_still, more_firmly = tying.holds_still, tying._more_firmly
    for found in (held, stuck):
        monkeypatch.setattr(tying, "holds_still", found)
        said.clear()
        weights.clear()
        with_motors = track(marionette(strings="cross"), motion, progress=said.append)
        assert "no motion is found from there: it is sought with motors" in said
        assert any(line.startswith("motors at price") for line in said)
        assert weights[0] == (25, LEAST_WEIGHT)
        assert with_motors.result.success
        assert with_motors.tension.min() >= 0.5
        assert with_motors.held_error == pytest.approx(run.held_error, abs=0.5)
        assert with_motors.mechanism.parameters.keys() == run.mechanism.parameters.keys()


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
