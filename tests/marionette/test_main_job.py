"""The main job through the command line, on short motions: a folder with a motion the puppet can make."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction.mechanics import MidpointVI
from leastaction.models.marionette import marionette
from leastaction.optimal import IterationRecord, IterationTable, Status
from leastaction_marionette import load_run, walk_in_place
from marionette.puppet_bvh import write_puppet

Run = Callable[..., tuple[int, str, str]]


def test_demo_leaves_a_whole_folder(leastaction: Run, tmp_path: Path) -> None:
    code, out, err = leastaction("demo", "--duration", "0.3", "--out", tmp_path)
    assert (code, err) == (0, "")
    assert "walk in place: 30 steps" in out
    assert "lknee_rx" in out
    assert {path.name for path in tmp_path.iterdir()} == {
        "trajectory.npz",
        "summary.json",
        "summary.txt",
        "convergence.png",
        "tracking.png",
        "strings.png",
        "snapshots.png",
        "animation.html",
    }
    numbers = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert numbers["run"]["status"] == "CONVERGED"
    # The first cost is that of the motion in whose start strings push, so the last one need not be less.
    assert all(string["tension_min_N"] >= 0.5 - 1e-6 for string in numbers["strings"].values())


def test_the_result_is_a_motion_of_the_puppet(leastaction: Run, tmp_path: Path) -> None:
    leastaction("demo", "--duration", "0.3", "--out", tmp_path, "--no-plots", "--no-animation")
    run = load_run(tmp_path / "trajectory.npz")
    puppet = marionette()
    motion = run.trajectory
    assert run.mechanism.variables == puppet.variables
    assert np.abs(puppet.constraint_values(motion.q)).max() < 1e-11
    # The inputs of the file make the motion of the file.
    integrator = MidpointVI(puppet)
    start = integrator.start(motion.q[0], p=motion.p[0], t=float(motion.t[0]))
    again = integrator.simulate(start, motion.t, rho=motion.rho)
    np.testing.assert_allclose(again.q, motion.q, atol=1e-8)
    np.testing.assert_allclose(again.p, motion.p, atol=1e-7)
    pulls = np.stack([again.tensions()[name] for name in puppet.constraints], axis=1)
    # At the start there is only half a step for the first impulse to make up for.
    pulls[0] *= 2.0
    np.testing.assert_allclose(run.tension, pulls, atol=1e-4)
    # The puppet hardly leaves its place in that time, so the strings carry its weight.
    weight = 9.8 * sum(body.mass for _, body, _ in puppet.tree.bodies())
    assert run.tension.sum(axis=1).mean() == pytest.approx(weight, rel=0.1)


def test_motion_capture(leastaction: Run, tmp_path: Path) -> None:
    walk = walk_in_place(0.6, 0.02)
    motion = write_puppet(tmp_path / "walk.bvh", walk.q)
    out = tmp_path / "out"
    code, text, err = leastaction(
        "optimize",
        "marionette",
        "--motion",
        motion,
        "--duration",
        "0.3",
        "--out",
        out,
        "--no-plots",
        "--no-animation",
    )
    assert (code, err) == (0, "")
    assert "31 frames" in " ".join(text.split())  # however long the path made the line
    tracking = json.loads((out / "summary.json").read_text(encoding="utf-8"))["tracking"]
    assert tracking["joint_rms_deg"] < 3.0


def test_a_stopped_run_goes_on_as_if_it_had_not_stopped(leastaction: Run, tmp_path: Path) -> None:
    few = ("--no-plots", "--no-animation", "--tolerance", "1e-9")
    whole, half, rest = (tmp_path / name for name in ("whole", "half", "rest"))
    assert leastaction("demo", "--duration", "0.3", "--out", whole, *few)[0] == 0
    code, out, _ = leastaction("demo", "--duration", "0.3", "--out", half, "--max-iterations", "1", *few)
    assert code == 0
    assert f"--resume {half / 'trajectory.npz'}" in out
    assert load_run(half / "trajectory.npz").result.status is Status.ITERATION_LIMIT
    again = ("--resume", half / "trajectory.npz", "--out", rest)
    assert leastaction("optimize", "marionette", *again, *few)[0] == 0
    first, second = load_run(whole / "trajectory.npz"), load_run(rest / "trajectory.npz")
    assert first.result.iterations > 1
    np.testing.assert_array_equal(second.result.history.cost, first.result.history.cost)
    np.testing.assert_array_equal(second.result.x, first.result.x)
    np.testing.assert_array_equal(second.result.K, first.result.K)
    np.testing.assert_array_equal(second.trajectory.q, first.trajectory.q)
    assert second.source == first.source


def test_ctrl_c_keeps_the_last_iterate(leastaction: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = IterationTable.__call__

    def interrupt(self: IterationTable, record: IterationRecord) -> Any:
        table(self, record)
        if record.iteration == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(IterationTable, "__call__", interrupt)
    code, out, err = leastaction("demo", "--duration", "0.3", "--out", tmp_path)
    assert (code, err) == (130, "")
    assert "Go on with" in out
    result = load_run(tmp_path / "trajectory.npz").result
    assert result.status is Status.INTERRUPTED
    assert len(result.history.cost) == 2
    assert (tmp_path / "convergence.png").exists()
