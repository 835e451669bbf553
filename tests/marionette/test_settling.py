"""The motion on strings of fixed lengths near one whose strings hardly vary."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from leastaction.models.marionette import marionette
from leastaction.numerics import Array
from leastaction.optimal import OptimizationResult, Optimizer, Status
from leastaction_marionette import FORCED, PuppetLimits, TrackingRun, track, walk_in_place
from leastaction_marionette.tracking import settle
from leastaction_marionette.tracking.plan import Curve, TrackingPlan
from leastaction_marionette.tracking.problem import TrackingProblem


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    return track(marionette(strings="cross"), walk_in_place(0.5, 0.02))


def loose(run: TrackingRun) -> tuple[TrackingPlan, OptimizationResult]:
    """Return the plan of a run, and a motion whose strings vary by a tenth of a millimetre."""
    plan = TrackingPlan(TrackingProblem(run.mechanism, run.motion, FORCED, PuppetLimits()))
    x = np.array(run.plan.x)
    x[:, plan.mechanism.variables.index("cross-z")] += 1e-4 * np.sin(np.arange(len(x)))
    return plan, replace(run.plan, x=x, limits=None, state=None)


def settled(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch, **changed: float
) -> tuple[list[float], list[str], Curve | None]:
    """Return what lengths are off by at most after each round, the methods of all iterations, and the motion."""
    (plan, near), off, methods = loose(run), list[float](), list[str]()

    class Told(Optimizer):
        def run(self, *given: Any, **named: Any) -> OptimizationResult:
            found = super().run(*given, **named)
            methods.extend(found.history.method)
            if self.system is plan.system:
                assert plan.ties is not None
                off.append(float(np.abs(plan.ties.off(found.x)).max()))
            return found

    monkeypatch.setattr(settle, "Optimizer", Told)
    for name, value in changed.items():
        monkeypatch.setattr(settle, name, value)
    return off, methods, settle.settled(plan, near)


def test_what_lengths_are_off_by_is_made_up_for_in_the_next_round(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As far as is asked for."""
    off, _, _ = settled(run, monkeypatch)
    assert off[-1] < 1e-6
    assert len(off) < 5
    further, _, _ = settled(run, monkeypatch, _EXACT=1e-7)
    assert further[-1] < 1e-7


def test_settling_leaves_no_saddle_for_a_minimum(run: TrackingRun, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of a thousandth down negative curvature took most of its time, where the motion was found."""
    assert set(settled(run, monkeypatch)[1]) == {"quasi-newton"}


def test_what_was_tied_loosely_is_settled_nearby(run: TrackingRun, monkeypatch: pytest.MonkeyPatch) -> None:
    """By changes that are hardly more than what lengths are off by, within all limits."""
    (plan, near), (_, _, found) = loose(run), settled(run, monkeypatch)
    assert found is not None
    moved: Array = found[0][:, plan.columns] - near.x[:, : plan.mechanism.nq]
    assert 1e-6 < np.abs(moved).max() < 0.02
    assert settle.broken_by(plan, *found) == frozenset()


def test_one_interrupt_ends_all_rounds(run: TrackingRun, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was found until then goes on rods."""
    plan, near = loose(run)
    rounds = list[OptimizationResult]()

    class Interrupted(Optimizer):
        def run(self, *given: Any, **named: Any) -> OptimizationResult:
            found = super().run(*given, **named)
            if self.system is not plan.system:
                return found
            rounds.append(replace(found, status=Status.INTERRUPTED))
            return rounds[-1]

    monkeypatch.setattr(settle, "Optimizer", Interrupted)
    monkeypatch.setattr(settle, "_EXACT", 0.0)
    settle.settled(plan, near)
    assert len(rounds) == 1
