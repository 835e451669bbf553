"""Every public function, class, method and property says what it does, itself or by the base that asks the question."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from functools import cached_property

import pytest

from api.modules import MODULES


def offered(owner: type, module: str) -> Iterator[tuple[str, object]]:
    """Yield what a module, or a class of it, defines and does not hide."""
    for name, found in list(vars(owner).items()):
        if name.startswith("_"):
            continue
        inner = found.__func__ if isinstance(found, (classmethod, staticmethod)) else found
        if isinstance(inner, (property, cached_property)) or (
            (inspect.isfunction(inner) or inspect.isclass(inner)) and inner.__module__ == module
        ):
            yield name, getattr(owner, name)


def unsaid(owner: type, module: str) -> list[str]:
    """Return the names of what says nothing; `inspect.getdoc` looks for a method's words in the bases too."""
    found = []
    for name, it in offered(owner, module):
        if not inspect.getdoc(it):
            found.append(name)
        if inspect.isclass(it):
            found += [f"{name}.{inner}" for inner in unsaid(it, module)]
    return found


@pytest.mark.parametrize("name", MODULES)
def test_what_is_offered_says_what_it_does(name: str) -> None:
    module = importlib.import_module(name)
    assert inspect.getdoc(module)
    assert not unsaid(module, name)  # type: ignore[arg-type]


class Base:
    """A base."""

    def asked(self) -> None:
        """Say what is asked."""


class Own(Base):
    """Of its own."""

    def asked(self) -> None:
        pass

    def silent(self) -> None:
        pass

    @property
    def also_silent(self) -> int:
        return 1


def test_silence_is_found() -> None:
    assert unsaid(Own, __name__) == ["silent", "also_silent"]
