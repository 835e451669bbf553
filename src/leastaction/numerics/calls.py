"""Calls of functions that a user gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from leastaction.errors import ArgumentError, brief


def called(function: Callable[..., Any], what: str, *arguments: Any) -> Any:
    """Return what a user's function returns; what it raises passes, but where it cannot be called with the arguments.

    ``what``: what it is, for the message.
    """
    try:
        return function(*arguments)
    except TypeError as error:
        traceback = error.__traceback__
        if traceback is not None and traceback.tb_next is not None:
            raise
        raise ArgumentError(
            f"{what}: got {brief(repr(function))}, expected a function of {len(arguments)} arguments: {error}"
        ) from error
