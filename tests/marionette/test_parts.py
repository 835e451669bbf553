"""Long motions are followed part by part, and the parts joined."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from leastaction.errors import ArgumentError, ResultFileError
from leastaction.models.marionette import marionette
from leastaction.optimal import OptimizationResult, Status, optimize
from leastaction_marionette import walk_in_place
from leastaction_marionette.tracking import (
    FORCED,
    PuppetLimits,
    TrackingRun,
    TrackingSearch,
    load_unfinished,
    parts,
    save_search,
    track,
    tracker,
)
from leastaction_marionette.tracking.parts import joined, parts_of
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem

PUPPET = marionette(strings=9)
OPTIONS = {"planned": True, "checkpoint_seconds": 0.0}


@pytest.fixture
def three_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a motion of five seconds be long."""
    monkeypatch.setattr(parts, "LONG", 4.0)
    monkeypatch.setattr(parts, "_PART", 2.5)
    monkeypatch.setattr(parts, "_OVERLAP", 1.2)


@pytest.mark.parametrize(("duration", "dt"), [(30.0, 0.01), (31.7, 0.01), (63.58, 0.01), (600.0, 0.02), (200.0, 0.5)])
def test_parts_are_alike_and_overlap(duration: float, dt: float) -> None:
    t = np.linspace(0.0, duration, round(duration / dt) + 1)
    found = parts_of(t)
    assert len(found) > 1
    assert found[0][0] == 0
    assert found[-1][1] == len(t) - 1
    for (start, stop), (after, _) in pairwise(found):
        assert stop - after == round(3.0 / dt)
        assert (stop - start) * dt == pytest.approx(15.0, abs=3.0)


def test_a_motion_that_is_not_long_is_one_part() -> None:
    assert parts_of(np.linspace(0.0, 29.9, 2991)) == [(0, 2990)]


def test_what_agrees_is_joined_as_it_is_and_else_passes_over() -> None:
    t = np.arange(31.0)
    x, u = np.stack([np.sin(t), t], axis=1), np.cos(t[:-1, None])
    same = joined((x[:21], u[:20]), (x[11:], u[11:]), 11)
    np.testing.assert_allclose(same[0], x, atol=1e-15)
    np.testing.assert_allclose(same[1], u, atol=1e-15)
    # Of what differs the first is left, and the second reached, in the middle third of where they overlap.
    x_after = x[11:] + 1.0
    passed = joined((x[:21], u[:20]), (x_after, u[11:]), 11)[0] - x
    np.testing.assert_array_equal(passed[:14], 0.0)
    np.testing.assert_allclose(passed[18:], 1.0, atol=1e-14)
    assert (np.diff(passed[:, 0]) >= -1e-12).all()


@pytest.mark.usefixtures("three_parts")
def test_a_long_motion_ends_as_near_as_by_one_search(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    by_parts = track(PUPPET, walk_in_place(5.0, 0.02), progress=said.append, **OPTIONS)
    told = [each for each in said if each.startswith("part ")]
    assert len(told) == 3
    assert told[0].startswith("part 1 of 3, from 0 to 2.4")
    assert told[-1].endswith("to 5 s:")
    monkeypatch.setattr(parts, "LONG", 30.0)
    whole = track(PUPPET, walk_in_place(5.0, 0.02), **OPTIONS)
    assert by_parts.result.status is whole.result.status is Status.CONVERGED
    # In another minimum, which is one percent cheaper here.
    assert by_parts.plan.cost < 1.05 * whole.plan.cost
    assert by_parts.tension.min() >= 0.5 - 1e-6
    assert by_parts.effort.optimisations > 3 * 4


@pytest.mark.usefixtures("three_parts")
def test_parts_that_are_followed_are_not_followed_again(tmp_path: Path) -> None:
    """Ended by Ctrl-C after the second part, and gone on with from a file."""
    path, motion = tmp_path / "search.npz", walk_in_place(5.0, 0.02)
    whole = track(PUPPET, motion, **OPTIONS)

    def checkpoint(found: TrackingRun | TrackingSearch) -> None:
        if isinstance(found, TrackingSearch):
            save_search(path, found)
            if found.parts and len(found.result.u) > 150:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, motion, checkpoint=checkpoint, **OPTIONS)
    search = load_unfinished(path)
    assert isinstance(search, TrackingSearch)
    assert search.parts
    assert 150 < len(search.result.u) < 250
    said: list[str] = []
    run = track(PUPPET, search.motion, resume=search, progress=said.append, **OPTIONS)
    assert said[0].startswith("part 3 of 3")
    np.testing.assert_array_equal(run.result.x, whole.result.x)
    assert run.effort == whole.effort
    # A file that contradicts itself says so.
    save_search(path, replace(search, result=replace(search.result, u=search.result.u[:, 1:])))
    with pytest.raises(ResultFileError, match="contradicts itself"):
        load_unfinished(path)


@pytest.mark.usefixtures("three_parts")
def test_where_a_part_leads_nowhere_the_motion_is_followed_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(_: object) -> None:
        raise ArgumentError("strings hold the puppet nowhere")

    monkeypatch.setattr(parts, "with_motors", nowhere)
    said: list[str] = []
    run = track(PUPPET, walk_in_place(5.0, 0.02), progress=said.append, **OPTIONS)
    assert said[1] == "it cannot be followed by itself: strings hold the puppet nowhere"
    assert said[2].startswith("motors at price 0.001")
    assert run.result.status is Status.CONVERGED


@pytest.mark.usefixtures("three_parts")
def test_where_parts_cannot_be_joined_it_begins_with_a_puppet_that_hangs(monkeypatch: pytest.MonkeyPatch) -> None:
    def apart(before: Curve, after: Curve, start: int) -> Curve:
        x, u = joined(before, after, start)
        return x + 1e3 * np.sin(np.arange(x.size)).reshape(x.shape), u

    monkeypatch.setattr(parts, "joined", apart)
    said: list[str] = []
    run = track(PUPPET, walk_in_place(5.0, 0.02), progress=said.append, **OPTIONS)
    assert any("begins with a puppet that is held still" in line for line in said)
    assert run.tension.min() >= 0.0


@pytest.mark.usefixtures("three_parts")
@pytest.mark.parametrize("iterations", [500, 0])
def test_gaps_between_parts_are_closed(iterations: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a limb swings otherwise in the one than in the other; without iterations feedback closes them."""
    index = PUPPET.dynamic.index("lknee_rx")

    def bent(before: Curve, after: Curve, start: int) -> Curve:
        x, u = joined(before, after, start)
        x[125:, index] -= 0.1
        return x, u

    monkeypatch.setattr(parts, "joined", bent)
    run = track(PUPPET, walk_in_place(5.0, 0.02), max_iterations=iterations, **OPTIONS)
    assert run.result.gap == 0.0
    wanted = TrackingPlan(TrackingProblem(PUPPET, run.motion, FORCED, PuppetLimits()))
    made = wanted.system.step_each(run.plan.x, run.plan.u).x
    np.testing.assert_allclose(made, run.plan.x[1:], atol=1e-9)
    assert run.tension.min() >= 0.0
    if iterations:
        assert run.result.status is Status.CONVERGED


@pytest.mark.usefixtures("three_parts")
def test_ctrl_c_while_parts_are_joined_keeps_them_all(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*arguments: object, **options: object) -> OptimizationResult:
        if options["shooting"] == "auto":
            return optimize(*arguments, **options)
        found = optimize(*arguments, **options | {"max_iterations": 0})
        return replace(found, status=Status.INTERRUPTED)

    monkeypatch.setattr(tracker, "optimize", stopped)
    kept: list[TrackingRun | TrackingSearch] = []
    with pytest.raises(KeyboardInterrupt):
        track(PUPPET, walk_in_place(5.0, 0.02), checkpoint=kept.append, **OPTIONS)
    assert isinstance(kept[-1], TrackingSearch)
    assert kept[-1].parts
    assert len(kept[-1].result.u) == 250
