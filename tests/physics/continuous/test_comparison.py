"""The comparison of methods runs, and says what the laws of the methods demand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

ROOT = Path(__file__).resolve().parents[3]


def test_a_quick_comparison_prints_a_table_and_draws(tmp_path) -> None:
    command = [sys.executable, "-m", "benchmarks.comparison", "--quick"]
    done = subprocess.run(
        [*command, "--only", "scissor_lift", "--images", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    picture = tmp_path / "comparison_scissor_lift.png"
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines() if line.startswith("| ")
    ]
    rows = {(method, setting): numbers for method, setting, *numbers in cells[1:]}
    coarse, fine = (float(rows["midpoint VI", f"{n} steps"][1]) for n in (120, 240))
    assert coarse / fine == pytest.approx(4.0, abs=0.5), "second order"
    drift = {key: float(numbers[3]) for key, numbers in rows.items()}
    assert drift["midpoint VI", "120 steps"] < 1e-13
    assert drift["DOP853", "rtol 0.001"] < 1e-13
    assert drift["RK4", "120 steps"] > 1e-6, "nothing holds it on the constraints"
