"""Every public class says what threads may do with it, itself or by a class that it derives from."""

from __future__ import annotations

import dataclasses
import enum
import inspect

import pytest

import leastaction
from api.modules import public_names
from leastaction import mechanics, optimal


def classes(module: object) -> dict[str, type]:
    offered = {name: getattr(module, name) for name in module.__all__}  # type: ignore[attr-defined]
    return {name: it for name, it in offered.items() if inspect.isclass(it)}


def cannot_change(cls: type) -> bool:
    """Whether its kind says that it may be shared: no need of words in every record of results."""
    frozen = dataclasses.is_dataclass(cls) and cls.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return frozen or issubclass(cls, (enum.Enum, tuple, Exception))


PLAIN = {
    name: it
    for name, it in public_names().items()
    if inspect.isclass(it) and not issubclass(it, (enum.Enum, Exception))
    # Of the topics too, and of what has moved there from the root.
    if hasattr(leastaction, name) or not cannot_change(it)
}
ELSEWHERE = {
    name: it
    for module in (mechanics, optimal)
    for name, it in classes(module).items()
    if name not in PLAIN and not cannot_change(it)
}


@pytest.mark.parametrize(("name", "cls"), sorted((PLAIN | ELSEWHERE).items()))
def test_it_says_what_threads_may_do(name: str, cls: type) -> None:
    said = [base.__name__ for base in cls.__mro__[:-1] if "thread" in (base.__doc__ or "").lower()]
    assert said, f"{name}: its docstring does not say whether threads may share it"
