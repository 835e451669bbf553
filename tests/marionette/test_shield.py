"""A run outlives its terminal: whatever ends the program or its output, what was found is on the disk."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from leastaction.optimal import Status
from leastaction_marionette import load_run
from leastaction_marionette.tracking import TrackingSearch, load_unfinished

SHORT = ("demo", "--duration", "0.2", "--no-plots", "--no-animation")
LONG = ("demo", "--duration", "10", "--no-plots", "--no-animation", "--tolerance", "1e-12")


# A test run in the background, or under nohup, hands signals down as ignored.
HEARD = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
"""


def command(words: Sequence[object], *, before: str = "") -> list[str]:
    """Return the command line as a process of its own, with lines of Python to run first."""
    code = f"{HEARD}\n{before}\nfrom leastaction_command import main\nmain()"
    return [sys.executable, "-c", code, *map(str, words)]


def run(words: Sequence[object], *, before: str = "", **options: object) -> tuple[int, str, str]:
    """Run the command line to its end: its exit code, output and error output."""
    done = subprocess.run(  # type: ignore[call-overload]
        command(words, before=before),
        **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options},
        check=False,
    )
    assert "Traceback" not in (done.stderr or "")
    return done.returncode, done.stdout or "", done.stderr or ""


# The program stands still after its first line that matches until it is told to go on, so that a signal comes exactly
# there, however fast the program and however busy the machine.
HELD = """
import re, sys
pattern, write = re.compile({!r}), sys.stdout.write
def held(text):
    global pattern
    done = write(text)
    if pattern is not None and pattern.search(text):
        pattern = None
        sys.stdout.flush()
        sys.stdin.readline()
    return done
sys.stdout.write = held
"""


def run_until(pattern: str, words: Sequence[object], number: signal.Signals, *, before: str = "") -> tuple[int, str]:
    """Run the command line and send it a signal after a line of its output: exit code and error output."""
    process = subprocess.Popen(
        command(words, before=before + HELD.format(pattern)),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert any(re.search(pattern, line) for line in process.stdout), "the line never came"
    process.send_signal(number)
    _, errors = process.communicate("go on\n", timeout=120)
    assert "Traceback" not in errors
    return process.returncode, errors


def test_a_reader_that_goes_away(tmp_path: Path) -> None:
    with subprocess.Popen(
        command([*SHORT, "--out", tmp_path]),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert "marionette follows" in process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(timeout=120) == 0
    assert load_run(tmp_path / "trajectory.npz").result.status is Status.CONVERGED
    assert (tmp_path / "summary.txt").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_into_a_full_disk(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        code, _, errors = run([*SHORT, "--out", tmp_path], stdout=full)
        assert code == 1
        assert errors == "error: the output could not be printed (No space left on device)\n"
        assert load_run(tmp_path / "trajectory.npz").result.status is Status.CONVERGED
        assert (tmp_path / "summary.txt").exists()
        # Nor do errors that cannot be printed end in a mess.
        assert run(["info", "absent.npz"], stdout=full, stderr=full)[0] == 2


def test_output_that_is_closed_or_knows_no_degrees(tmp_path: Path) -> None:
    closed = "import os, sys\nsys.stdout = sys.stderr = None"
    assert run([*SHORT, "--out", tmp_path], before=closed)[0] == 0
    plain = {**os.environ, "PYTHONIOENCODING": "ascii"}
    code, out, errors = run(["info", tmp_path / "trajectory.npz"], env=plain)
    assert (code, errors) == (0, "")
    assert "Tracking error: rms" in out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_keeps_the_last_iterate(tmp_path: Path, number: signal.Signals) -> None:
    code, errors = run_until(r"^ +1 ", [*LONG, "--out", tmp_path], number)
    assert (code, errors) == (130, "")
    result = load_run(tmp_path / "trajectory.npz").result
    assert result.status is Status.INTERRUPTED
    assert result.iterations >= 1
    assert (tmp_path / "summary.txt").exists()


def test_a_signal_before_there_is_anything(tmp_path: Path) -> None:
    code, errors = run_until("marionette follows", [*LONG, "--out", tmp_path], signal.SIGTERM)
    assert code == 130
    assert errors == "error: interrupted before there was a result to keep\n"
    assert list(tmp_path.iterdir()) == []


# No motion is followed directly.
SOUGHT = """
import leastaction_marionette.tracking.problem as problem
problem.TrackingProblem.hang = lambda self: None
"""


def test_a_signal_while_a_first_trajectory_is_sought(tmp_path: Path) -> None:
    words = ["demo", "--duration", "0.3", "--no-plots", "--no-animation", "--checkpoint", "0", "--out", tmp_path]
    code, errors = run_until("motors at price 0.001", words, signal.SIGTERM, before=SOUGHT)
    path = tmp_path / "search.npz"
    assert code == 130
    assert f"interrupted; the search for a first trajectory is in {path}" in errors
    assert f"--resume {path}" in errors
    search = load_unfinished(path)
    assert isinstance(search, TrackingSearch)
    again = ["optimize", "marionette", "--resume", path, "--max-iterations", "1", *words[3:]]
    code, out, errors = run(again)
    assert (code, errors) == (0, "")
    assert "motors at price 1:" in out
    assert "without motors:" in out
    assert load_run(tmp_path / "trajectory.npz").embedded
    assert not path.exists()


def test_ctrl_c_while_the_package_is_imported() -> None:
    before = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "leastaction.apps":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
"""
    code, out, errors = run(["--help"], before=before)
    assert (code, out) == (130, "")
    assert errors == "error: interrupted before there was a result to keep\n"


def test_a_killed_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    words = ["demo", "--duration", "2", "--no-plots", "--no-animation", "--checkpoint", "0"]
    assert run([*words, "--out", whole])[0] == 0
    code, _ = run_until(r"^ +3 ", [*words, "--out", cut], signal.SIGKILL)
    assert code == -signal.SIGKILL
    stopped = load_run(cut / "trajectory.npz").result
    assert stopped.status is Status.STOPPED_BY_CALLBACK
    assert stopped.iterations >= 2
    assert "kept on the way" in run(["info", cut / "trajectory.npz"])[1]
    again = ["optimize", "marionette", "--resume", cut / "trajectory.npz", "--out", cut, *words[3:]]
    assert run(again)[0] == 0
    first, second = (load_run(folder / "trajectory.npz") for folder in (whole, cut))
    assert first.result.iterations > stopped.iterations
    for name in ("x", "u", "K"):
        a, b = getattr(first.result, name), getattr(second.result, name)
        np.testing.assert_array_equal(b, a, err_msg=name)
    np.testing.assert_array_equal(second.result.history.cost, first.result.history.cost)
    assert {path.name for path in cut.iterdir()} == {
        "trajectory.npz",
        "summary.json",
        "summary.txt",
    }


FULL = """
import errno, os
import leastaction.numerics.files as files
real = files.atomic_write
def atomic_write(path):
    if os.path.basename(os.path.dirname(os.path.abspath(path))) == "out":
        raise files.OutputError(f"cannot write {path}: " + os.strerror(errno.ENOSPC))
    return real(path)
files.atomic_write = atomic_write
"""


def test_a_full_disk_sends_the_run_elsewhere(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    words = [*SHORT, "--out", tmp_path / "out", "--checkpoint", "0"]
    code, out, errors = run(words, before=FULL, cwd=elsewhere)
    assert code == 1
    assert "Tracking error" in out
    (kept,) = elsewhere.iterdir()
    assert errors.startswith("error: cannot write")
    assert f"No space left on device. The run is in {kept}\n" in errors
    assert load_run(kept).result.status is Status.CONVERGED


def test_a_full_disk_leaves_an_earlier_run_as_it_was(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    for each in (folder, elsewhere):
        each.mkdir()
    for name in ("tracking.png", "animation.html", "trajectory.npz"):
        (folder / name).write_text("of an earlier run", encoding="utf-8")
    code, _, _ = run([*SHORT, "--out", folder, "--checkpoint", "0"], before=FULL, cwd=elsewhere)
    assert code == 1
    assert {path.name for path in folder.iterdir()} == {"tracking.png", "animation.html", "trajectory.npz"}


PICTURES = """
import os, signal
import leastaction_marionette.command.report as report
from leastaction.errors import OutputError
def plot_convergence(*arguments, **options):
    {}
report.plot_convergence = plot_convergence
"""


def test_ctrl_c_while_pictures_are_drawn(tmp_path: Path) -> None:
    interrupting = PICTURES.format("os.kill(os.getpid(), signal.SIGINT)")
    words = ["demo", "--duration", "0.2", "--out", tmp_path]
    code, _, errors = run(words, before=interrupting)
    assert code == 130
    assert f"the run as far as it went is in {tmp_path / 'trajectory.npz'}" in errors
    assert "leastaction draw" in errors
    assert errors.count("\n") == 1
    assert load_run(tmp_path / "trajectory.npz").result.status is Status.CONVERGED


def test_a_picture_that_cannot_be_written(tmp_path: Path) -> None:
    failing = PICTURES.format("raise OutputError('cannot write convergence.png: full')")
    code, out, errors = run(["demo", "--duration", "0.2", "--out", tmp_path], before=failing)
    assert code == 1
    assert "Tracking error" in out
    assert errors == (
        f"error: cannot write convergence.png: full. The run itself is in {tmp_path / 'trajectory.npz'}\n"
    )


def test_old_pictures_do_not_stay_beside_a_new_trajectory(tmp_path: Path) -> None:
    for name in ("tracking.png", "animation.html", "mine.png"):
        (tmp_path / name).write_text("old", encoding="utf-8")
    # A run that comes to nothing leaves everything as it is.
    assert run([*SHORT, "--out", tmp_path, "--dt", "1"])[0] == 2
    assert (tmp_path / "tracking.png").exists()
    assert run([*SHORT, "--out", tmp_path])[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "trajectory.npz",
        "summary.json",
        "summary.txt",
        "mine.png",
    }
