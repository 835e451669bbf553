"""The README's example runs and does what the README says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_example(capsys: pytest.CaptureFixture[str]) -> None:
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 1
    names: dict[str, Any] = {}
    exec(compile(blocks[0], "README.md", "exec"), names)
    assert "CONVERGED" in capsys.readouterr().out
    result, integrator, t = names["result"], names["vi"], names["t"]
    assert result.K.shape == (500, 1, 4)
    # It stands at the end, with little left of its swing.
    assert result.x[-50:, 1] == pytest.approx(np.pi, abs=0.1)
    # And the inputs alone make that motion.
    again = integrator.simulate(integrator.start([0.0, 0.0]), t, inputs=result.u)
    np.testing.assert_allclose(again.q, result.x[:, :2], atol=1e-6)


def test_what_it_points_to_exists() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if "://" not in target:
            assert (ROOT / target).is_file(), target


def test_the_commands_it_names_exist() -> None:
    app = (ROOT / "src" / "leastaction" / "apps" / "cli" / "app.py").read_text(encoding="utf-8")
    commands = set(re.findall(r"(?:`|bin/)leastaction ([a-z]+) ", README))
    assert commands == {"demo", "optimize", "info", "draw", "examples"}
    for command in commands:
        assert f"def {command}(" in app
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"(?:^|`)make ([a-z]+)", README, re.MULTILINE)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
