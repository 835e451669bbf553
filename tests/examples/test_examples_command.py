"""`leastaction examples` lists the example scripts and runs one, from the source tree and from a built package."""

from __future__ import annotations

from pathlib import Path

import pytest

from leastaction.apps.cli import examples as listing
from leastaction.apps.cli import main
from leastaction.apps.cli.examples import find_example, find_examples
from leastaction.errors import ArgumentError

ROOT = Path(__file__).parents[2]


def run(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    captured = capsys.readouterr()
    assert isinstance(ended.value.code, int)
    return ended.value.code, captured.out, captured.err


def test_they_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "examples")
    assert (code, err) == (0, "")
    scripts = sorted((ROOT / "examples").glob("[0-9]*.py"))
    assert len(find_examples()) == len(scripts)
    for number, script in enumerate(scripts, 1):
        assert f"{number}  {script.stem[3:]}: " in out
    assert "identify_cart_pendulum: Identify a pendulum on a cart" in out


@pytest.mark.parametrize("name", ["3", "03", "finger_tendons", "finger-tendons", "finger", "03_finger_tendons.py"])
def test_one_is_found_by_number_or_name(name: str) -> None:
    assert find_example(name).file.name == "03_finger_tendons.py"


@pytest.mark.parametrize(
    ("name", "message"),
    [("99", "no example '99', numbers go from 1 to"), ("fingers", "'fingers'.*finger_tendons"), ("", "no example ''")],
)
def test_what_is_not_there_is_told(capsys: pytest.CaptureFixture[str], name: str, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        find_example(name)
    code, _, err = run(capsys, "examples", name)
    assert code == 2
    assert err.startswith("error:")


def test_one_is_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    folder = tmp_path / "new"
    code, out, _ = run(capsys, "examples", "assembly", "--out", folder)
    assert code == 0
    assert "it swings with" in out
    assert (folder / "04_assembly_and_equilibrium.png").is_file()


def test_a_package_that_is_missing_is_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "01_needy.py").write_text('"""Needs what is not there."""\nimport not_there_at_all\n', encoding="utf-8")
    monkeypatch.setattr(listing, "_PLACES", (tmp_path,))
    code, _, err = run(capsys, "examples", 1, "--out", tmp_path)
    assert code == 2
    assert "needs not_there_at_all, which is not installed" in " ".join(err.split())
    assert listing._extra_of("matplotlib") == "viz"


def test_a_built_package_has_them_and_one_without_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The place that a build installs them to is the first that is looked at."""
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    installed = "DESTINATION leastaction/apps/examples)"
    assert installed in cmake
    assert listing._PLACES[0].parts[-3:] == ("leastaction", "apps", "examples")
    monkeypatch.setattr(listing, "_PLACES", (tmp_path,))
    with pytest.raises(ArgumentError, match="no examples: they were left out"):
        find_examples()
