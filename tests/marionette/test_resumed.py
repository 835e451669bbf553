"""A run of the marionette that is stopped and gone on with is the same run, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction.io import Motion
from leastaction.models.marionette import Hanging, marionette
from leastaction.optimal import IterationRecord
from leastaction_marionette import TrackingRun, TrackingSearch, load_unfinished, save_run, save_search, track
from leastaction_marionette.tracking import tracker
from marionette.motions import leap

CASES: dict[str, tuple[Hanging, dict[str, Any]]] = {
    "hanging": (6, {"tolerance": 1e-9}),
    "planned by tensions": (6, {"planned": True, "tolerance": 1e-6}),
    "nine strings": (9, {"planned": True, "tolerance": 1e-6}),
    "markers": (9, {"planned": True, "follow": "markers", "tolerance": 1e-6}),
    "bars": ("cross+legs", {}),
    "one bar": ("cross", {}),
}


def wanted(name: str) -> Motion:
    from leastaction_marionette import walk_in_place

    return walk_in_place(0.5, 0.02) if name in ("hanging", "bars", "one bar") else leap(0.3, 0.02)


class Stopped(Exception):
    """The program ends without a word."""


def stopped(name: str, iteration: int) -> TrackingRun | TrackingSearch | None:
    """Return what is kept of a run that is stopped after some iterations of all its optimisations with a record."""
    strings, options = CASES[name]
    kept: list[TrackingRun | TrackingSearch] = []
    seen = [0]

    def callback(record: IterationRecord) -> None:
        seen[0] += 1
        if seen[0] > iteration:
            raise Stopped

    try:
        track(
            marionette(strings=strings),
            wanted(name),
            callback=callback,
            checkpoint=kept.append,
            checkpoint_seconds=0.0,
            **options,
        )
    except Stopped:
        return kept[-1] if kept else None
    return None


@pytest.mark.parametrize("name", CASES)
def test_a_run_that_is_stopped_anywhere_is_the_same_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    monkeypatch.setattr(tracker, "_FEW", 10)
    strings, options = CASES[name]
    records: list[IterationRecord] = []
    whole = track(marionette(strings=strings), wanted(name), callback=records.append, **options)
    first, second = rng.choice(np.arange(2, len(records)), size=2, replace=False)
    for iteration, from_file in ((int(first), False), (int(second), True)):
        kept = stopped(name, iteration)
        if kept is None:  # motors were at work, and nothing was found yet
            continue
        if from_file:
            path = tmp_path / "kept.npz"
            kept = load_unfinished(save_run(path, kept) if isinstance(kept, TrackingRun) else save_search(path, kept))
        how = {key: value for key, value in options.items() if key == "tolerance"}
        again = track(kept.mechanism, kept.motion, resume=kept, **how)
        np.testing.assert_array_equal(again.result.x, whole.result.x, err_msg=f"stopped at {iteration}")
        np.testing.assert_array_equal(again.result.u, whole.result.u)
        assert again.result.status is whole.result.status
        assert again.effort == whole.effort
