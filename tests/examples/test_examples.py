"""The scripts in ``examples/`` run, draw their pictures, and what they say is so."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.image import imread

from leastaction.mechanics import Stability

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(path.stem for path in EXAMPLES.glob("[0-9]*.py"))


def load(script: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return a script as a module; its name begins with a number, so that it cannot be imported."""
    name = f"example_{script}"
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{script}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)  # its dataclasses look there
    spec.loader.exec_module(module)
    return module


def test_the_scripts_are_numbered_and_say_what_they_are_for() -> None:
    assert [int(script[:2]) for script in SCRIPTS] == list(range(1, len(SCRIPTS) + 1))
    for script in SCRIPTS:
        text = (EXAMPLES / f"{script}.py").read_text(encoding="utf-8")
        assert re.match(r'"""[A-Z].*\.\n\n', text), script
        assert f"python examples/{script}.py --output" in text, script


@pytest.mark.parametrize("script", SCRIPTS)
def test_it_runs_from_the_command_line(script: str, tmp_path: Path) -> None:
    output = tmp_path / "pictures"
    run = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / f"{script}.py", "--output", output],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert 3 <= len(run.stdout.splitlines()) <= 20
    assert [path.name for path in output.iterdir()] == [f"{script}.png"]
    picture = imread(output / f"{script}.png")
    assert picture.shape[0] > 500
    assert picture.shape[1] > 800
    assert 0.02 < np.mean(picture[:, :, :3].min(axis=2) < 0.9) < 0.5  # neither empty nor full


def test_identification(monkeypatch: pytest.MonkeyPatch) -> None:
    example = load("01_identify_cart_pendulum", monkeypatch)
    found = example.identify(example.measurements())
    off = np.abs(found.numbers - example.TRUTH) / found.errors
    assert np.all(off < 4.0)
    # The errors are those of noise on so many measurements, and small enough to have found something.
    assert np.all(found.errors < 0.05 * np.abs(example.TRUTH))
    assert found.chi2 == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / 400))
    # Exact derivatives take a simulation an iteration; differences one more for every number, or two.
    counts = found.simulations
    assert 3.0 * counts["exact"] < counts["2-point"] < counts["3-point"]
    assert 1e-9 < found.jacobian_errors["3-point"] < found.jacobian_errors["2-point"] < 1e-2


def test_identification_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The standard errors are right: over many noises the estimates scatter as they say."""
    example = load("01_identify_cart_pendulum", monkeypatch)
    clean = example.Fit(np.zeros((1, 2))).simulate(example.TRUTH).q[:: example.MEASURED]
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(40):
        fit = example.Fit(clean + example.NOISE * rng.standard_normal(clean.shape))
        # One Gauss-Newton step from the truth: as far as noise that small takes the estimate.
        jacobian, residuals = fit.jacobian(example.TRUTH), fit.residuals(example.TRUTH)
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        step = -covariance @ jacobian.T @ residuals
        scores.append(step / np.sqrt(np.diag(covariance)))
    spread = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all(spread > 0.65)
    assert np.all(spread < 1.4)


def test_user_elements(monkeypatch: pytest.MonkeyPatch) -> None:
    example = load("02_user_elements", monkeypatch)
    result = example.check(example.turn_cam(), example.levitate(), example.run_down())
    assert result.cam_error < 1e-12
    assert result.cam_energy < 1e-5
    assert abs(result.current_error) < 1e-8
    assert result.nut_error < 1e-4
    # Two turns, the ball where it is wanted, and the nut down by about half a metre.
    assert result.cam["angle"][-1] > 4.0 * np.pi
    assert -1e3 * result.ball["z"][-1] == pytest.approx(16.0, abs=1e-3)
    assert result.nut["z"][-1] == pytest.approx(-0.49, abs=0.02)


def test_finger(monkeypatch: pytest.MonkeyPatch) -> None:
    example = load("03_finger_tendons", monkeypatch)
    result = example.simulate()
    assert result.virtual_work < 1e-9
    assert result.rest < 1e-9
    # Bent by the flexor, stretched by the extensor; a tendon that shortens makes the other longer.
    t = result.motion.t
    held, end = np.searchsorted(t, 0.45), -1
    assert np.all(result.motion.q[held] > np.radians(45.0))
    assert np.all(np.abs(result.motion.q[end]) < np.radians(15.0))
    flexor, extensor = (result.lengths[name] for name in ("flexor", "extensor"))
    assert flexor[held] < flexor[0] - 0.015
    assert extensor[held] > extensor[0] + 0.005
    assert min(pull.min() for pull in result.tensions.values()) >= 0.0


def test_assembly_and_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    example = load("04_assembly_and_equilibrium", monkeypatch)
    result = example.solve()
    assert result.gap < 1e-12
    assert np.abs(result.closed - example.GUESS).max() < 0.4
    assert result.rest.stability is Stability.STABLE
    assert result.other.stability is Stability.UNSTABLE
    assert result.rest.potential < result.other.potential
    assert result.rest.residual < 1e-9
    # A swing of 4 mrad is as fast as the linear one to its square.
    np.testing.assert_allclose(result.frequencies, result.rest.frequencies / (2.0 * np.pi), rtol=2e-4)
