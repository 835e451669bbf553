"""Problem files: what ships is solved from the shell, and what is wrong in one is said with its line and place."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction import Mechanism, Status
from leastaction.apps.cli.app import main
from leastaction.apps.problems import load_problem
from leastaction.apps.problems.formulas import formula
from leastaction.apps.problems.records import ProblemRecord
from leastaction.apps.problems.report import RESULT
from leastaction.apps.problems.run import solve
from leastaction.apps.problems.schema import SCHEMA_FILE
from leastaction.errors import ArgumentError, ModelFileError
from leastaction.io.mechanisms import load as load_model
from leastaction.io.results import open as open_result
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.documents import schema_text

EXAMPLES = Path(__file__).parents[2] / "examples" / "problems"
PROBLEMS = ["arm_reaching", "cart_pendulum", "four_bar", "marionette"]

GOOD = """\
leastaction: problem 1
title: A cart goes to and fro
model: cart.yaml
time: {duration: 1.0, dt: 0.02}
start: {q: {theta: 0.1}}
wanted:
  - {type: formula, name: x, value: "0.2*sin(pi*t)"}
weights: {x: 10.0, x-force: 1e-4}
limits:
  - {type: Bound, names: x-force, min: -50, max: 50}
optimizer: {max_iterations: 50}
output: {plots: false, animation: false}
"""
FIRST = "  - {type: formula"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    cart_pendulum().save(tmp_path / "cart.yaml")
    return tmp_path


def write(folder: Path, text: str) -> Path:
    path = folder / "problem.yaml"
    path.write_text(text)
    return path


def command(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(words)
    return int(ended.value.code or 0)


def test_all_that_ships_is_tried() -> None:
    assert sorted(path.stem for path in EXAMPLES.glob("*.yaml") if "problem 1" in path.read_text()) == PROBLEMS


@pytest.mark.parametrize("name", PROBLEMS)
def test_what_ships_is_solved(name: str) -> None:
    problem = load_problem(EXAMPLES / f"{name}.yaml")
    found = solve(problem)
    assert found.result.success
    assert found.result.limits is not None
    assert found.result.limits.excess < 1e-5
    if name == "cart_pendulum":
        assert found["theta"][-1] == pytest.approx(np.pi, abs=1e-6)
        assert np.abs(found.trajectory.inputs).max() <= 60.0 + 1e-6
    elif name == "arm_reaching":
        hand = found.trajectory.mechanism.positions(found.trajectory.q, ["hand"])[:, 0]
        np.testing.assert_allclose(hand[-1], [0.55, 0.45, 0.0], atol=5e-3)
        assert np.linalg.norm(hand - [0.2, -0.15, 0.0], axis=1).min() > 0.1 - 1e-6
    elif name == "four_bar":
        assert found["crank"][-1] - found["crank"][0] == pytest.approx(2.0 * np.pi, abs=1e-3)
    else:
        assert found.errors["lelbow_rx"] < 0.05
        assert min(each.min() for each in found.trajectory.tensions().values()) > 0.19


def test_the_shell_solves_a_problem_and_fills_a_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    text = GOOD.replace("plots: false, animation: false", "plots: true")
    out = folder / "out"
    assert command("optimize", str(write(folder, text)), "--out", str(out)) == 0
    printed = capsys.readouterr().out
    assert "A cart goes to and fro" in printed
    assert "CONVERGED" in printed
    names = {path.name for path in out.iterdir()}
    assert names == {
        "result.npz", "motion.csv", "motion.html", "summary.json", "summary.txt", "convergence.png", "tracking.png",
        "limits.png",
    }  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "CONVERGED"
    assert summary["errors (rms, rad or m)"]["x"] < 0.05
    assert (out / "motion.csv").read_text().startswith("t [s],x [m],theta [rad],")
    result = open_result(out / RESULT)
    assert result["theta"].tolist() == result.x[:, 1].tolist()
    # What was made can be wanted: the motion that it writes is one that it reads.
    again = GOOD.replace('{type: formula, name: x, value: "0.2*sin(pi*t)"}', "{type: file, file: out/motion.csv}")
    wanted = load_problem(write(folder, again)).wanted
    assert set(wanted) == {"x", "theta"}
    assert wanted["x"].tolist() == result.x[:, 0].tolist()
    assert wanted["theta"].tolist() == result.x[:, 1].tolist()


def test_a_run_goes_on_where_it_was(folder: Path) -> None:
    path, out = EXAMPLES / "cart_pendulum.yaml", folder / "out"
    whole = solve(load_problem(path)).result
    quiet = ("--out", str(out), "--no-plots", "--no-animation")
    assert command("optimize", str(path), *quiet, "--max-iterations", "5") == 0
    first = open_result(out / RESULT)
    assert first.status is Status.ITERATION_LIMIT
    assert command("optimize", str(path), *quiet, "--resume", str(out / RESULT)) == 0
    result = open_result(out / RESULT)
    assert result.success
    assert result.cost == pytest.approx(whole.cost, rel=1e-6)
    assert command("optimize", str(path), *quiet, "--resume", str(out / "motion.csv")) == 2
    longer = write(folder, GOOD.replace("duration: 1.0", "duration: 2.0"))
    assert command("optimize", str(longer), "--out", str(out), "--resume", str(out / RESULT)) == 2


WAITS = """
import sys, time
from leastaction.apps.cli import main
from leastaction.optimal import IterationTable

told = IterationTable.__call__

def waits(self, record):
    told(self, record)
    if record.iteration == 1:
        sys.stdout.flush()
        time.sleep(60.0)  # until it is interrupted

IterationTable.__call__ = waits
main()
"""  # the command, which waits after its first iteration


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_keeps_the_last_iterate(folder: Path) -> None:
    arguments = [sys.executable, "-c", WAITS, "optimize", str(write(folder, GOOD)), "--out", str(folder / "out")]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.split()[:1] == ["1"]:  # the first iteration
                break
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        assert process.wait(60) == 130, rest
    assert "INTERRUPTED" in rest
    assert "Go on with: leastaction optimize" in rest
    assert open_result(folder / "out" / RESULT).status is Status.INTERRUPTED
    assert (folder / "out" / "motion.csv").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("model: cart.yaml", "model: cart", r"line 3: model: got 'cart', expected a file .* or a ready model: one of"),
        ("model: cart.yaml", "model: none.yaml", r"line 3: model: .*none\.yaml"),
        ("model: cart.yaml", "model: 7", r"line 3: model: got 7, expected text or a mapping"),
        ("model: cart.yaml", "model: {file: cart.yaml, fixd: []}", r"line 3: model\.fixd: unknown key; did you mean"),
        ("title:", "titel:", r"line 2: titel: unknown key; did you mean 'title'"),
        ("dt: 0.02", "dt: 20 ms", r"line 4: time\.dt: got '20 ms', expected a number; without a unit"),
        ("dt: 0.02", "dt: -1", r"line 4: time\.dt: got -1, expected a number > 0"),
        ("dt: 0.02", "dt: 1e-9", r"line 4: time: got 1e\+09 steps"),
        (", dt: 0.02", "", r"line 4: time: expected either steps"),
        ("q: {theta: 0.1}", "q: {thta: 0.1}", r"line 5: start: values: unknown name 'thta'; did you mean 'theta'"),
        ("q: {theta: 0.1}", "q: {theta: .nan}", r"line 5: start: .*nan"),
        ("q: {theta: 0.1}", "keyframe: home", r"line 5: start: unknown keyframe 'home'"),
        ("type: formula", "type: formel", r"wanted\[0\]\.type: got 'formel'; did you mean 'formula'"),
        ("name: x, value", "name: xx, value", r"line 7: wanted\[0\]: .*unknown variable or frame 'xx'"),
        ("0.2*sin(pi*t)", "0.2*sine(t)", r"wanted\[0\]: 'sine\(t\)': expected numbers, t, pi"),
        ("0.2*sin(pi*t)", "log(t - 5)", r"wanted\[0\]: the formula 'log\(t - 5\)' has no value at t = 0 s"),
        ("0.2*sin(pi*t)", "__import__('os')", r"wanted\[0\]: .*expected numbers"),
        ("name: x, value", "name: bob, value", r"wanted\[0\]: 'bob': got 1 formulas, expected 3"),
        ("x-force: 1e-4", "x-force: 1e-4, pole: 1.0", r"line 8: weights: nothing is called 'pole'"),
        ("x-force: 1e-4", "x-force: heavy", r"line 8: weights\.x-force: got 'heavy', expected a number"),
        ("names: x-force", "names: y-force", r"line 10: limits\[0\]: .*'y-force'"),
        ("min: -50, max: 50", "at: end", r"line 10: limits\[0\]: .*got neither min nor max"),
        ("min: -50, max: 50", "min: 50, max: -50", r"line 10: limits\[0\]: "),
        ("min: -50, max: 50", "mim: -50", r"line 10: limits\[0\]\.mim: unknown key; did you mean 'min'"),
        ("max_iterations: 50", "method: magic", r"line 11: optimizer\.method: got 'magic'; the choices are 'auto'"),
        ("output: {", "unknowns: [{type: Parameter, name: bob.mas}]\noutput: {", r"line 12: unknowns\[0\]: .*'bob"),
        ("problem 1", "mechanism 1", r"line 1: leastaction: got 'mechanism 1', expected 'problem 1'"),
        ("wanted:", "wnated:", r"wnated: unknown key; did you mean 'wanted'"),
        (FIRST, "  - {type: file, file: none.csv}\n" + FIRST, r"line 7: wanted\[0\]: .*no such file"),
        (FIRST, "  - {type: capture, file: none.bvh, frames: {bob: Hand}}\n" + FIRST, r"none\.bvh"),
        (FIRST, "  - {type: keyframes, name: x, points: [[9, 0]]}\n" + FIRST, r"some from 0 to 1 s"),
        (FIRST, "  - {type: keyframes, name: x, points: [[1, 0, 3]]}\n" + FIRST, r"\.points\[0\]"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place(folder: Path, old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(ModelFileError, match=message):
        solve(load_problem(write(folder, GOOD.replace(old, new, 1))))


def test_the_shell_says_in_a_line_what_is_wrong(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "out"
    for words, said in (
        ((str(write(folder, GOOD.replace("title:", "titel:"))),), "titel: unknown key"),
        ((str(folder / "none.yaml"),), "there is no such file"),
        (("marionete",), "expected a problem file"),
        ((str(folder / "problem.yaml"), "--motion", "walk.bvh"), "--motion"),
    ):
        assert command("optimize", *words, "--out", str(out)) == 2
        assert said in capsys.readouterr().err.replace("\n", " ")
        assert not out.exists()
    file = folder / "file"
    file.touch()
    assert command("optimize", str(write(folder, GOOD)), "--out", str(file)) == 2


def test_wanted_columns_of_files(folder: Path) -> None:
    t = np.linspace(0.0, 1.0, 11)
    rows = ["t, pole, bob.x,bob.y,bob.z", *(f"{a},{90 * a},{a},,0.0" for a in t)]
    (folder / "wanted.csv").write_text("\n".join(rows))
    np.savez(folder / "wanted.npz", t=t, bob=np.stack([t, t, t], axis=1), x=t**2)
    line = '{type: formula, name: x, value: "0.2*sin(pi*t)"}'

    def wanted(part: str) -> Any:
        return load_problem(write(folder, GOOD.replace(line, part))).wanted

    found = wanted("{type: file, file: wanted.csv, columns: {theta: pole, bob: bob}, degrees: [theta]}")
    np.testing.assert_allclose(found["theta"], np.linspace(0.0, np.pi / 2.0, 51), atol=1e-12)
    assert np.isnan(found["bob"][:, 1]).all()
    np.testing.assert_allclose(found["bob"][:, 0], np.linspace(0.0, 1.0, 51), atol=1e-12)
    found = wanted("{type: file, file: wanted.npz}")
    assert set(found) == {"x", "bob"}
    rows = ["t [s],theta [deg],bob.x [mm],bob.y [m],bob.z [cm],pull [N]", *(f"{a},{90 * a},{1e3 * a},,0,5" for a in t)]
    (folder / "wanted.csv").write_text("\n".join(rows))
    for part in ("{type: file, file: wanted.csv}", "{type: file, file: wanted.csv, degrees: [theta]}"):
        found = wanted(part)
        np.testing.assert_allclose(found["theta"], np.linspace(0.0, np.pi / 2.0, 51), atol=1e-12)
        np.testing.assert_allclose(found["bob"][:, 0], np.linspace(0.0, 1.0, 51), atol=1e-12)
    with pytest.raises(ModelFileError, match="pull is in 'N', expected one of rad, m, mm"):
        wanted("{type: file, file: wanted.csv, columns: {x: pull}}")
    (folder / "wanted.csv").write_text("t,theta [rad]\n0,0\n1,1\n")
    with pytest.raises(ModelFileError, match="theta is in 'rad', but degrees says that it is in degrees"):
        wanted("{type: file, file: wanted.csv, degrees: [theta]}")
    (folder / "wanted.csv").write_text("t,theta\n0,0\n1,fast\n")
    with pytest.raises(ModelFileError, match=r"wanted\.csv, line 3: theta is 'fast', expected a number"):
        wanted("{type: file, file: wanted.csv}")
    (folder / "wanted.npz").write_bytes((folder / "wanted.npz").read_bytes()[:100])
    with pytest.raises(ModelFileError, match="it is no NPZ"):
        wanted("{type: file, file: wanted.npz}")


def test_wanted_places_of_a_capture(folder: Path) -> None:
    (folder / "hand.bvh").write_text(
        """HIERARCHY
ROOT Hips
{
 OFFSET 0 0 0
 CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
 JOINT Hand
 {
  OFFSET 10 20 30
  CHANNELS 3 Zrotation Xrotation Yrotation
  End Site
  {
   OFFSET 1 0 0
  }
 }
}
MOTION
Frames: 3
Frame Time: 0.5
0 0 0 0 0 0 0 0 0
1 0 0 0 0 0 0 0 0
2 0 0 0 0 0 0 0 0
"""
    )
    line = '{type: formula, name: x, value: "0.2*sin(pi*t)"}'
    part = "{type: capture, file: hand.bvh, frames: {bob: Hand}, offset: [1, 0, 0]}"
    places = load_problem(write(folder, GOOD.replace(line, part))).wanted["bob"]
    # y up in the file, z up here; centimetres there.
    np.testing.assert_allclose(places[0], [1.3, 0.1, 0.2])
    np.testing.assert_allclose(places[-1], [1.3, 0.12, 0.2])


def test_keyframes_parameters_and_unknowns(folder: Path) -> None:
    line = '{type: formula, name: x, value: "0.2*sin(pi*t)"}'
    points = "{type: keyframes, name: x, points: [[0.0, 0.0], [0.5, 0.3], [1.0, 0.3]]"
    free = load_problem(write(folder, GOOD.replace(line, points + "}"))).wanted["x"]
    assert np.flatnonzero(~np.isnan(free)).tolist() == [0, 25, 50]
    smooth = load_problem(write(folder, GOOD.replace(line, points + ", between: smooth}"))).wanted["x"]
    assert smooth[[0, 25, 50]].tolist() == [0.0, 0.3, 0.3]
    assert np.all(np.diff(smooth) >= 0.0)
    text = GOOD.replace("time:", "parameters: {bob.mass: 2.5}\ntime:")
    text += "unknowns: [{type: Parameter, name: bob.mass, min: 0.5, max: 3.0, weight: 1.0}]\n"
    problem = load_problem(write(folder, text))
    assert problem.model.mechanism.parameters["bob.mass"] == 2.5
    found = solve(problem)
    assert found.result.success
    assert 0.5 <= found.result.unknowns["bob.mass"] <= 3.0


def test_formulas() -> None:
    t = np.linspace(0.0, 2.0, 7)
    assert formula("1 + 2*t**2 - -3")(t).tolist() == (1 + 2 * t**2 + 3).tolist()
    assert formula("smooth(t, 0.5, 1.5)")(np.array([0.0, 0.5, 1.0, 1.5, 2.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert formula("max(t, 1)")(0.25) == 1.0
    for bad in ("t +", "x", "t.real", "lambda: 1", "'a'", "sin(t, t, t, t)", "open('x')", ""):
        with pytest.raises(ArgumentError):
            formula(bad)


def test_the_schema_that_is_shipped_is_the_one_of_the_code() -> None:
    assert SCHEMA_FILE.read_text() == schema_text(ProblemRecord), (
        "write it anew: python -m leastaction.apps.problems.schema"
    )


def test_mechanism_files_of_the_examples_are_as_they_are_written() -> None:
    for name in ("arm", "four_bar_linkage"):
        mechanism = Mechanism.load(EXAMPLES / f"{name}.yaml")
        assert mechanism.nd == (2 if name == "arm" else 3)


def test_the_files_that_the_docs_show_are_read(folder: Path) -> None:
    page = (EXAMPLES.parents[1] / "docs" / "files.md").read_text("utf-8")
    blocks = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 3
    for block in blocks:
        path = write(folder, block)
        if "mechanism 1" in block:
            assert Mechanism.load(path).nd == 2
        else:
            assert load_problem(path).title == load_problem(EXAMPLES / "cart_pendulum.yaml").title


def test_a_model_of_a_file_with_its_limits(folder: Path) -> None:
    arm = EXAMPLES.parent / "models" / "arm.urdf"
    text = f"""
leastaction: problem 1
model: {{file: {json.dumps(str(arm))}}}
model_limits: true
time: {{duration: 0.5, steps: 25}}
wanted: [{{type: constant, name: %s, value: 0.2}}]
start: {{q: {{}}}}
"""
    name = load_model(arm).mechanism.variables[0]
    problem = load_problem(write(folder, text % json.dumps(name)))
    assert problem.limits == load_model(arm).limits
    assert solve(problem).result.success
