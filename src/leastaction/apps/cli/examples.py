"""The example scripts: where they are, what each is for, and how one is run.

They are the numbered scripts of the folder ``examples`` of the source tree; a built package has them in ``apps``.
"""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from leastaction.errors import ArgumentError, closest

# In a built package, and in the source tree that an editable install runs from.
_PLACES = (Path(__file__).parents[1] / "examples", Path(__file__).parents[4] / "examples")


@dataclass(frozen=True)
class Example:
    """One script: its number, its name, what it is for in a line, and its file."""

    number: int
    name: str
    about: str
    file: Path


def find_examples() -> list[Example]:
    """Return the scripts in the order of their numbers, or complain if this package was put together without them."""
    for place in _PLACES:
        files = sorted(place.glob("[0-9][0-9]_*.py"))
        if files:
            return [_read(file) for file in files]
    raise ArgumentError(
        "this installation has no examples: they were left out when it was packed. They are the folder examples of the "
        "source tree"
    )


def find_example(wanted: str) -> Example:
    """Return the script of a number, or of a name or a beginning of it that only one has; complain if there is none."""
    known = find_examples()
    if wanted.isdecimal():
        found = [example for example in known if example.number == int(wanted)]
    else:
        name = wanted.removesuffix(".py").lstrip("0123456789_").replace("-", "_")
        found = [example for example in known if example.name == name]
        found = found or [example for example in known if name and example.name.startswith(name)]
    if len(found) == 1:
        return found[0]
    names = [example.name for example in known]
    if found:
        raise ArgumentError(f"example {wanted!r} may be {' or '.join(example.name for example in found)}: say which")
    raise ArgumentError(
        f"there is no example {wanted!r}, numbers go from {known[0].number} to {known[-1].number}; "
        f"{closest(wanted, names, what='names')}"
    )


def run_example(example: Example, output: Path) -> None:
    """Run a script: it prints what it finds, and writes its picture into a folder.

    Raises `ArgumentError`: if it needs a package that is not installed.
    """
    name = f"leastaction_example_{example.name}"
    spec = importlib.util.spec_from_file_location(name, example.file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its dataclasses look there
    try:
        spec.loader.exec_module(module)
        module.main(output)
    except ModuleNotFoundError as error:
        raise ArgumentError(
            f"example {example.name} needs {error.name}, which is not installed. Try: pip install "
            f"'leastaction[viz,{_extra_of(error.name)}]'"
        ) from error
    finally:
        del sys.modules[name]


def _extra_of(module: str | None) -> str:
    """Return the extra of the package that a module comes with."""
    with suppress(PackageNotFoundError):
        for line in requires("leastaction") or []:
            found = re.match(r"([\w-]+).*extra == \W(\w+)", line)
            if found is not None and found[1] == module and found[2] not in ("test", "oracles", "dev"):
                return found[2]
    return "expressions"


def _read(file: Path) -> Example:
    about = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return Example(int(file.stem[:2]), file.stem[3:], about.partition("\n")[0].removesuffix("."), file)
