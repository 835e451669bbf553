"""docs/notation.md and the code have the same names: those on the page exist, and those of the core are on it."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import leastaction
from api.modules import NAMESPACES
from leastaction import _core, mechanics, optimal
from leastaction.mechanics import elements, expressions

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "notation.md").read_text("utf-8")
STUB = Path(_core.__file__).with_name("_native.pyi")
NAME = r"[A-Za-z_]\w*"

# What no table needs to explain: arguments of the builder and of the tape, which are called what they are.
SPEAKS_FOR_ITSELF = {"Tape", "MechanismBuilder"}
SAYS_WHAT_IT_IS = {"out"}  # memory for a result


def rows() -> Iterator[dict[str, str]]:
    """The rows of the tables that have columns of names, by heading."""
    heading: list[str] = []
    for line in PAGE.splitlines():
        # Bars within code part no cells.
        cells = [c.strip() for c in re.split(r"\|(?=(?:[^`]*`[^`]*`)*[^`]*$)", line.strip("|"))]
        if not line.startswith("|"):
            heading = []
        elif not heading:
            heading = cells
        elif "C++" in heading and not set(line) <= set("|-"):
            assert len(cells) == len(heading), line
            yield dict(zip(heading, cells, strict=True))


def names_in(column: str) -> list[str]:
    """Every name in the code of a column; `Class.attribute` and `Class::member` in one piece."""
    found = {
        name
        for row in rows()
        for code in re.findall("`([^`]+)`", row[column])
        for name in re.findall(rf"{NAME}(?:(?:\.|::){NAME})*", code)
    }
    return sorted(found)


@cache
def cpp() -> str:
    """The C++ with its comments, which state the mathematics."""
    return "\n".join(file.read_text("utf-8") for file in sorted((ROOT / "cpp").glob("*/*.[hc]pp")))


@cache
def public() -> dict[str, Any]:
    """The classes and functions that the packages offer, by name."""
    found = {}
    for module in (*NAMESPACES, mechanics, elements, expressions, optimal, leastaction.systems):
        offered = getattr(module, "__all__", None) or vars(module)
        found |= {name: getattr(module, name) for name in offered if not name.startswith("_")}
    return found


def arguments(function: Any) -> set[str]:
    try:
        return set(inspect.signature(function).parameters)
    except (TypeError, ValueError):  # of C
        return set()


@cache
def attributes(thing: Any) -> frozenset[str]:
    """What can be read from an object of a class, and the arguments of its methods or of a function."""
    if not inspect.isclass(thing):
        return frozenset(arguments(thing))
    found = set(dir(thing))
    for base in thing.__mro__:
        found |= set(vars(base).get("__annotations__", {}))
        for member in vars(base).values():
            found |= arguments(member) if callable(member) else set()
    return frozenset(found - {"self"})


@cache
def spoken() -> frozenset[str]:
    """Every name that users of the packages meet, and what the stub of the core says."""
    stub = re.findall(NAME, STUB.read_text("utf-8"))
    return frozenset([*public(), *stub]).union(*(attributes(it) for it in public().values()))


@pytest.mark.parametrize("name", names_in("C++"))
def test_names_of_the_core_exist(name: str) -> None:
    for part in name.split("::"):
        assert re.search(rf"\b{part}\b", cpp()), f"{part}: no such name in cpp/"


@pytest.mark.parametrize("name", names_in("Python"))
def test_names_of_the_package_exist(name: str) -> None:
    first, *rest = name.split(".")
    if rest:
        assert first in public(), f"{first} is not offered"
        assert rest[0] in attributes(public()[first]), f"{first} has no {rest[0]}"
    else:
        assert name in spoken(), f"{name} is no argument, attribute or name of the package"


def arrays_of_the_core() -> Iterator[str]:
    """The arrays that the core takes, and the sizes and arrays that it gives back."""
    for node in ast.parse(STUB.read_text("utf-8")).body:
        if isinstance(node, ast.ClassDef) and node.name not in SPEAKS_FOR_ITSELF:
            functions = [item for item in node.body if isinstance(item, ast.FunctionDef)]
        else:
            functions = [node] if isinstance(node, ast.FunctionDef) else []
        for function in functions:
            for argument in function.args.args + function.args.kwonlyargs:
                if argument.annotation and ast.unparse(argument.annotation).startswith("Annotated[NDArray"):
                    yield argument.arg
            returns = ast.unparse(function.returns) if function.returns else ""
            is_property = any(ast.unparse(d) == "property" for d in function.decorator_list)
            if is_property and ("NDArray" in returns or function.name.startswith("n_")):
                yield function.name


def members(struct: str) -> Iterator[str]:
    """The numbers and arrays of numbers of a C++ struct."""
    body = re.search(rf"struct {struct} {{(.*?)\n}};", re.sub("//.*", "", cpp()), re.DOTALL)
    assert body, struct
    for line in re.findall(r"(?:double|HessianBlock|ptrdiff_t)\*? ([\w, ]+?)(?: =.*)?;", body[1]):
        yield from (name.strip() for name in line.split(","))


CORE = {
    *arrays_of_the_core(),
    *members("LinearQuadraticProblem"),
    *members("LinearQuadraticOutput"),
} - SAYS_WHAT_IT_IS


@pytest.mark.parametrize("name", sorted(CORE))
def test_what_the_core_speaks_of_is_on_the_page(name: str) -> None:
    code = " ".join(re.findall("`([^`]+)`", PAGE))
    assert re.search(rf"\b{name}\b", code), f"docs/notation.md does not explain {name}"
