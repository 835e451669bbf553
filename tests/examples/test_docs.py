"""The code in the pages of docs/ runs, and what the pages point to exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from examples.printed import assert_printed
from leastaction import _core
from leastaction.apps.cli import main

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
CODE = [
    pytest.param(page, block, id=f"{page.stem}-{number}")
    for page in DOCS
    for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text("utf-8"), re.DOTALL))
]


# What a block needs beside the package, by what it says.
NEEDS = {
    "sympy": r"(import|from) sympy\b", "jax": r"(import|from) jax\b", "h5py": r"\.h5\b", "pandas": "to_pandas",
    "xarray": "to_xarray", "mujoco": r"\.(xml|urdf)\b", "ezc3d": r"\bezc3d\b",
}  # fmt: skip


@pytest.mark.parametrize(("page", "block"), CODE)
def test_the_code_runs(page: Path, block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for optional, words in NEEDS.items():
        if re.search(words, block):
            pytest.importorskip(optional)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)  # where it may write
    exec(compile(block, page.name, "exec"), {})


def test_the_commands_print_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "command_line.md").read_text("utf-8")
    shown = re.findall(r"```sh\nleastaction ([^\n]*)\n```\n\n```\n(.*?)```", page, re.DOTALL)
    assert len(shown) == 5
    for words, printed in shown:
        with pytest.raises(SystemExit) as ended:
            main(words.split())
        assert ended.value.code == 0
        assert_printed(printed.replace("core v4", f"core {_core.variant}"), capsys.readouterr().out)


@pytest.mark.parametrize("page", DOCS, ids=lambda page: page.stem)
def test_what_it_points_to_exists(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).is_file(), target


@pytest.mark.parametrize("page", [*DOCS, *ROOT.glob("*.md")], ids=lambda page: page.stem)
def test_the_places_in_the_tree_that_it_names_exist(page: Path) -> None:
    if page.stem == "CHANGELOG":  # it tells of places that were
        return
    for place in re.findall(r"`((?:cpp|src|tests|docs|benchmarks|examples)/[\w/.]+)`", page.read_text("utf-8")):
        assert list(ROOT.glob(place.rstrip("/") + "*")), f"{page.name}: no {place}"
