"""The README's example runs and does what the README says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def run_blocks(folder: Path) -> list[dict[str, Any]]:
    """Return the names of each block of Python, run in a folder that has the models of the examples."""
    (folder / "examples").mkdir()
    (folder / "examples" / "models").symlink_to(ROOT / "examples" / "models")
    found = []
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        names: dict[str, Any] = {}
        exec(compile(block, "README.md", "exec"), names)
        found.append(names)
    return found


def test_the_examples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    arm, four_bar = run_blocks(tmp_path)
    assert "CONVERGED" in capsys.readouterr().out
    drawn, t = arm["drawn"], arm["t"]
    assert drawn.errors["tip"] < 2e-3
    # The torques alone make that motion, and no limit is passed.
    again = arm["la"].MidpointVI(arm["arm"].mechanism).simulate(arm["start"], t, inputs=drawn.trajectory.inputs)
    np.testing.assert_allclose(again.q, drawn.trajectory.q, atol=1e-6)
    assert all((side.value > -1e-9).all() for side in drawn.result.limits.sides)
    run, mechanism = four_bar["run"], four_bar["four_bar"]
    assert run.steps == 4999
    assert np.abs(mechanism.constraint_values(run.q)).max() < 1e-14
    for page in ("arm.html", "four_bar.html"):
        assert (tmp_path / page).stat().st_size > 50_000


@pytest.mark.parametrize("block", re.findall(r"```python\n(.*?)```", README, re.DOTALL))
def test_an_example_is_of_twenty_lines(block: str) -> None:
    assert len([line for line in block.splitlines() if line.strip()]) <= 20


def test_what_it_points_to_exists() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if "://" not in target:
            assert (ROOT / target).is_file(), target


def test_the_commands_it_names_exist() -> None:
    from leastaction.apps.cli.app import program

    commands = set(re.findall(r"(?:`|bin/)leastaction ([a-z]+) ", README))
    assert commands >= {"demo", "optimize", "info", "draw", "examples", "view", "simulate", "lqr", "check", "convert"}
    assert commands <= set(program())
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"(?:^|`)make ([a-z]+)", README, re.MULTILINE)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
