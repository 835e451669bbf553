"""The command line: help that reads well, errors of one line, and a folder with everything in it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from leastaction import __version__
from leastaction.models.marionette import STRINGS, hang_strings, marionette
from leastaction_marionette import TrackingRun, load_run, save_run, track, walk_in_place
from leastaction_marionette.command.report import TRAJECTORY, write_report

Output = tuple[int, str, str]


@pytest.fixture(scope="module")
def run() -> TrackingRun:
    """A run of the marionette, of 20 steps."""
    return track(marionette(), walk_in_place(0.2, 0.01))


@pytest.fixture(scope="module")
def made_up(run: TrackingRun) -> TrackingRun:
    """The same with a left knee that is 2 degrees off, and a string that pushes for a quarter of the time."""
    mechanism, trajectory = run.mechanism, run.trajectory
    q = run.reference.copy()
    q[:, mechanism.variables.index("lknee_rx")] += np.radians(2.0)
    q = hang_strings(mechanism, q)
    tension = np.full((trajectory.steps, mechanism.nc), 12.0)
    tension[:5, 0] = -3.0
    lengths = q[:-1, [mechanism.variables.index(string.length) for string in STRINGS]]
    lam = tension * 0.01 / (2.0 * lengths)
    lam[0] /= 2.0
    return replace(run, trajectory=replace(trajectory, q=q, lam=lam))


def test_help_names_every_command(leastaction) -> None:
    code, out, err = leastaction("--help")
    assert (code, err) == (0, "")
    for command in ("demo", "optimize", "info", "draw", "--version"):
        assert command in out
    assert "leastaction demo --out" in out


def test_help_of_a_command_names_its_options(leastaction) -> None:
    code, out, _ = leastaction("optimize", "--help")
    assert code == 0
    for word in ("marionette", "--motion", "--out", "--method", "--resume", "--max-iterations"):
        assert word in out
    code, out, _ = leastaction("optimize", "marionette", "--help")
    assert code == 0
    for option in ("--motion", "--mapping", "--out", "--dt", "--duration", "--method", "--resume"):
        assert option in out
    assert "--max-iterations" in out
    assert "--no-animation" in out


def test_version(leastaction) -> None:
    assert leastaction("--version") == (0, f"{__version__}\n", "")


def test_help_is_quick() -> None:
    # The commands import what they need when they run, so that help does not wait for all of it.
    code = """
import sys
from leastaction.apps.cli import main
try:
    main(["optimize", "marionette", "--help"])
finally:
    loaded = sorted({"scipy", "matplotlib"} & set(sys.modules))
    assert not loaded, loaded
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["optimise"], "optimise"),
        (["demo"], "--out"),
        (["demo", "--out", "x", "--speed", "3"], "--speed"),
        (["optimize", "chair", "--out", "x"], "marionette"),
        (["optimize", "marionette", "--out", "x", "--method", "guess"], "quasi-newton"),
        (["optimize", "marionette", "--out", "x", "--dt", "soon"], "soon"),
        (["optimize", "marionette", "--out", "x", "--mapping", "m.toml"], "--motion"),
        (["optimize", "marionette", "--out", "x", "--resume", "r", "--motion", "m"], "--resume"),
        (["info", "absent.npz"], "absent.npz"),
        (["demo", "--out", "x", "--dt", "1e-9"], "steps"),
        (["demo", "--out", "x", "--dt", "1e-300"], "steps"),
        (["demo", "--out", "x", "--duration", "1e9"], "steps"),
        (["demo", "--out", "x", "--duration", "1e5"], "steps"),
        (["optimize", "marionette", "--out", "x", "--duration", "1e300"], "steps"),
        (
            ["optimize", "marionette", "--out", "x", "--speed", "fast"],
            "got 'fast', expected a number such as 0.5",
        ),
    ],
)
def test_bad_words_are_one_line_and_code_2(
    leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = leastaction(*words)
    assert code == 2
    assert out == ""
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err
    assert err.count("\n") <= 2
    assert list(tmp_path.iterdir()) == []


def test_a_motion_file_that_is_none(leastaction, tmp_path: Path) -> None:
    motion = tmp_path / "walk.bvh"
    motion.write_text("HIERARCHY\nROOT Hips\n{\n", encoding="utf-8")
    out = tmp_path / "out"
    code, _, err = leastaction("optimize", "marionette", "--motion", motion, "--out", out)
    assert code == 2
    assert err.startswith("error: ")
    assert "walk.bvh" in err
    code, _, err = leastaction("optimize", "marionette", "--motion", tmp_path / "no", "--out", out)
    assert code == 2
    assert err.startswith("error: ")
    # Nothing is left behind, and what was there stays.
    assert not out.exists()
    out.mkdir()
    leastaction("optimize", "marionette", "--motion", motion, "--out", out / "below" / "it")
    assert list(out.iterdir()) == []


def test_the_folder_is_checked_before_the_run(leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def must_not_run(*arguments: object, **options: object) -> None:
        raise AssertionError("the run started")

    monkeypatch.setattr("leastaction_marionette.command.session.run", must_not_run)
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    code, _, err = leastaction("demo", "--out", file / "below")
    assert code == 2
    assert "cannot make the output folder" in err


def test_missing_matplotlib_is_said_before_the_run(
    leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, _, err = leastaction("demo", "--out", tmp_path / "out")
    assert code == 2
    assert "leastaction[viz]" in err
    assert not (tmp_path / "out").exists()


def test_ctrl_c_before_there_is_a_result(leastaction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("leastaction_marionette.command.session.run", interrupt)
    code, _, err = leastaction("demo", "--out", tmp_path / "out")
    assert code == 130
    assert "interrupted" in err
    assert not (tmp_path / "out").exists()


def test_a_report_holds_everything(made_up: TrackingRun, tmp_path: Path) -> None:
    names: list[str] = []
    write_report(made_up, tmp_path, progress=names.append)
    assert sorted(names) == sorted(path.name for path in tmp_path.iterdir())
    assert set(names) == {
        "summary.json",
        "summary.txt",
        "convergence.png",
        "tracking.png",
        "strings.png",
        "snapshots.png",
        "animation.html",
    }
    assert all(path.stat().st_size > 200 for path in tmp_path.iterdir())


def test_the_numbers_of_a_report(made_up: TrackingRun, tmp_path: Path) -> None:
    write_report(made_up, tmp_path, plots=False, animation=False)
    assert len(list(tmp_path.iterdir())) == 2
    numbers = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    knee = numbers["tracking"]["variables"]["lknee_rx"]
    assert knee["unit"] == "deg"
    assert knee["rms"] == pytest.approx(2.0)
    assert numbers["tracking"]["joint_rms_deg"] == pytest.approx(2.0 / np.sqrt(19.0))
    assert numbers["tracking"]["variables"]["torso_tx"]["unit"] == "m"
    assert numbers["strings"]["right_leg_string"]["slack_percent"] == pytest.approx(25.0)
    assert numbers["strings"]["left_leg_string"]["tension_min_N"] == pytest.approx(12.0)
    text = (tmp_path / "summary.txt").read_text(encoding="utf-8")
    assert "lknee_rx" in text
    assert "2.00°" in text
    assert "25.0 %" in text
    assert "\x1b" not in text


def test_info_and_draw(leastaction, run: TrackingRun, tmp_path: Path) -> None:
    path = save_run(tmp_path / "run.npz", run)
    code, out, err = leastaction("info", path)
    assert (code, err) == (0, "")
    for part in ("marionette: 20 steps", "CONVERGED", "lknee_rx", "right leg", "walk in place"):
        assert part in out
    code, out, err = leastaction("draw", path, "--out", tmp_path / "again", "--no-plots")
    assert (code, err) == (0, "")
    assert "animation.html" in out
    assert not (tmp_path / "again" / TRAJECTORY).exists()
    (tmp_path / "again" / TRAJECTORY).write_bytes(path.read_bytes())
    again = ("draw", path, "--out", tmp_path / "again", "--no-plots")
    assert leastaction(*again)[0] == 0
    (tmp_path / "again" / TRAJECTORY).write_bytes(b"another run")
    code, _, err = leastaction(*again)
    assert code == 2
    assert "is another run" in err


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("motion.t", lambda t: t[::-1], "strictly increasing times"),
        ("motion.t", lambda t: np.where(np.arange(len(t)) == 3, np.nan, t), "finite"),
        ("motion.t", lambda t: t + 0j, "complex128, expected float64"),
        ("motion.t", lambda t: t[:-1], "run.npz is damaged"),
        ("motion.t", lambda t: t[None], "run.npz is damaged"),
        ("motion.t", lambda t: t[:0], "run.npz is damaged"),
        ("motion.q", lambda q: q[:, 1:], "run.npz is damaged"),
        ("motion.q", lambda q: q * np.inf, "finite"),
        ("motion.q", lambda q: q.astype("f4"), "float32, expected float64"),
        ("result.x", lambda x: x[:, 1:], "contradicts itself"),
        ("result.x", lambda x: 1e6 * x, ""),
        ("result.u", lambda u: u * np.nan, "not finite"),
    ],
)
def test_a_run_file_of_nonsense_is_one_line(
    leastaction, run: TrackingRun, tmp_path: Path, name: str, change, message: str
) -> None:
    path = save_run(tmp_path / "run.npz", run)
    with np.load(path) as archive:
        arrays = dict(archive)
    with np.errstate(invalid="ignore"):
        arrays[name] = change(arrays[name])
    np.savez(path, **arrays)
    code, out, err = leastaction("info", path)
    if message:
        assert (code, out) == (2, "")
        assert err.startswith("error: ")
        assert message in err
        assert err.count("\n") == 1
    else:  # finite and of the right shape, so it is shown for what it is
        assert "Traceback" not in err


def test_a_run_of_another_puppet_comes_back_with_it(tmp_path: Path) -> None:
    heavy = marionette(damping=0.3)
    motion = walk_in_place(0.1, 0.01)
    run = track(heavy, motion, max_iterations=1)
    back = load_run(save_run(tmp_path / "run.npz", run))
    assert back.mechanism.parameters == heavy.parameters
    assert back.mechanism.parameters != marionette().parameters
    np.testing.assert_array_equal(back.trajectory.lam, run.trajectory.lam)
    assert back.provenance == run.provenance
