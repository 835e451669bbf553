"""The benchmarks run, and what they print is one JSON object with sound numbers."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks import against, many, timing

import leastaction

ROOT = Path(__file__).resolve().parents[2]
GROUPS = {"step", "chain", "lq", "marionette", "cart"}


def run(*arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def measured() -> dict[str, Any]:
    return json.loads(run("--quick", "--json"))


@pytest.mark.parametrize(("seconds", "rounds", "repeats"), [(1.0, 3, 3), (0.11, 1, 3), (0.05, 2, 6), (0.05, 8, 8)])
def test_what_is_short_is_repeated_more_often(
    seconds: float, rounds: int, repeats: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For 0.3 s altogether; the fastest counts, and what came last is returned."""
    now, calls = 0.0, 0

    def call() -> int:
        nonlocal now, calls
        calls += 1
        now += seconds + 0.03 * (calls == 1)
        return calls

    monkeypatch.setattr(timing.time, "process_time", lambda: now)
    assert timing.fastest(call, rounds) == (repeats, pytest.approx(seconds))


def rows_of(measured: dict[str, Any], group: str) -> list[dict[str, Any]]:
    return [row for row in measured["rows"] if row["group"] == group]


def test_every_group_of_ours_was_measured(measured):
    # Only other programs may be absent.
    failed = [row for row in measured["absent"] if row["group"] in GROUPS and "failed" in row["reason"]]
    assert failed == []
    assert {row["group"] for row in measured["rows"]} >= GROUPS
    assert measured["quick"] is True


def test_rows_have_names_of_their_own_and_positive_values(measured):
    names = [(row["group"], row["name"]) for row in measured["rows"]]
    assert len(set(names)) == len(names)
    for row in measured["rows"]:
        assert math.isfinite(row["value"]), row
        assert row["value"] > 0.0, row
        if row["median"] is not None:
            assert row["median"] >= row["value"], row


def test_ratios_are_those_of_the_times(measured):
    unit = measured["unit"]
    for row in measured["rows"]:
        if row["target"] is not None:
            assert row["ratio_to_target"] == pytest.approx(row["value"] / row["target"])
        if row["dissertation"] is not None:
            ratio = row["dissertation"] / row["value"]
            assert row["speedup_over_dissertation"] == pytest.approx(ratio)
        if unit is not None and row["unit"] == "s":
            assert row["ratio_to_unit"] == pytest.approx(row["value"] / unit["value"])
    if unit is not None:
        assert unit["value"] == min(unit["before"], unit["after"])


def test_the_step_is_that_of_the_stored_motion(measured):
    if measured["mechanism"] != "marionette_strings":
        pytest.skip("the conformance cases are not here")
    (left,) = [row for row in rows_of(measured, "step") if row["name"] == "step, left split"]
    assert left["details"]["largest_difference"] < 1e-8


def test_a_step_takes_what_a_hand_timed_roll_out_takes(measured):
    """The clock itself: within a factor that no noise, but any wrong division by steps, exceeds."""
    import time

    import numpy as np

    from leastaction import models
    from leastaction.mechanics import MidpointVI

    integrator = MidpointVI(models.build("marionette"), threads=1)
    start = integrator.start(models.marionette.rest_pose(integrator.mechanism))
    t = 0.01 * np.arange(201)
    integrator.simulate(start, t)
    times = []
    for _ in range(5):
        began = time.perf_counter()
        integrator.simulate(start, t)
        times.append((time.perf_counter() - began) / 200)
    (step,) = [row for row in rows_of(measured, "step") if row["name"] == "step"]
    assert 0.1 < step["value"] / min(times) < 10.0


def test_short_problems_are_not_held_against_targets(measured):
    for group in ("lq", "marionette", "cart"):
        assert all(row["target"] is None for row in rows_of(measured, group))


def test_only_measures_one_group_and_the_text_names_it():
    text = run("--quick", "--only", "chain")
    assert "chain of 40 links" in text
    assert "slope in log-log" in text
    assert "marionette optimisation" not in text


def test_an_unknown_group_is_refused():
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--only", "nothing"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert "marionette" in done.stderr


def test_captures_that_are_absent_are_skipped(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.captures", "--dt", "0.05", "--iterations", "1", str(tmp_path / "none.bvh")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("none.bvh: skipped") == 1
    walk = done.stdout.splitlines()[-1]
    assert walk.startswith("made-up walk")
    assert "MISSED: converges" in walk
    assert "no string pushes" not in walk


def test_trials_side_by_side_are_weighed_against_those_that_follow() -> None:
    """Of five roll-outs two follow a refusal; at the cost of one they would save one, of the half of the time."""
    trials = many.Trials(np.array([1.0, 1.0, 3.0]), share=0.5)
    assert trials.gain(1.0) == pytest.approx(0.1)
    assert trials.gain(3.0) == pytest.approx(-0.1)
    found = many.searches(2)
    assert found.rollouts.min() == 1.0
    assert found.rollouts.max() > 1.0
    assert 0.0 < found.share < 1.0


def test_another_build_is_timed_beside_this_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Beside itself the ratios are about one; a folder without the package is refused."""
    package = str(Path(leastaction.__file__).parents[1])
    monkeypatch.setattr(sys, "argv", ["against", package, "--rounds", "1", "--only", "pendulum"])
    assert against.main() == 0
    times = np.array(capsys.readouterr().out.splitlines()[-1].split()[1:], dtype=float).reshape(3, 3)
    np.testing.assert_allclose(times[:, 2], times[:, 0] / times[:, 1], rtol=0.02)
    assert (times[:, 2] > 0.1).all()
    assert (times[:, 2] < 10.0).all()
    monkeypatch.setattr(sys, "argv", ["against", str(tmp_path)])
    with pytest.raises(SystemExit):
        against.main()
    assert "no leastaction in" in capsys.readouterr().err
