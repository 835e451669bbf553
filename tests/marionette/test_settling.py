"""The motion on strings of fixed lengths near one whose strings hardly vary."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from leastaction.models.marionette import marionette
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult
from leastaction_marionette import FORCED, PuppetLimits, TrackingRun, track, walk_in_place
from leastaction_marionette.tracking import settle
from leastaction_marionette.tracking.problem import TrackingProblem


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    return track(marionette(strings="cross"), walk_in_place(0.5, 0.02))


def test_settling_goes_on_near_a_motion_where_convex_models_do_not_lead_to_it(
    run: TrackingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all derivatives, for the same price; and from the motion that was given where that fails."""
    problem = TrackingProblem(run.mechanism, run.motion, FORCED, PuppetLimits())
    begun, whole = list[tuple[str, Array]](), settle._found
    fails = 0

    def found(problem: Any, cost: Any, x: Array, u: Array, method: Any) -> OptimizationResult | None:
        begun.append((method, x))
        if len(begun) == 1:
            near = whole(problem, cost, x, u, method)
            assert near is not None
            return replace(near, x=x + 1e-5)
        return None if len(begun) <= 1 + fails else whole(problem, cost, x, u, method)

    monkeypatch.setattr(settle, "_found", found)
    x, u = run.result.x, run.result.u
    for fails in (0, 1):
        begun.clear()
        assert settle.settled(problem, x, u) is not None
        assert [method for method, _ in begun[: 2 + fails]] == ["quasi-newton", "auto", "auto"][: 2 + fails]
        np.testing.assert_array_equal(begun[1][1], x + 1e-5)
        if fails:
            np.testing.assert_array_equal(begun[2][1], x)


def test_settling_leaves_no_saddle_for_a_minimum(run: TrackingRun, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of a thousandth down negative curvature took most of its time, where the motion was found."""
    told, whole = list[Any](), settle.optimize

    def optimised(*arguments: Any, callback: Any, **options: Any) -> OptimizationResult:
        told.append(callback)
        return whole(*arguments, callback=callback, **options)

    monkeypatch.setattr(settle, "optimize", optimised)
    problem = TrackingProblem(run.mechanism, run.motion, FORCED, PuppetLimits())
    assert settle.settled(problem, run.result.x, run.result.u) is not None
    assert told
    for ends in told:
        assert ends(SimpleNamespace(method="negative-curvature"))
        assert not ends(SimpleNamespace(method="newton-damped"))
