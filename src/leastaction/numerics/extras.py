"""Packages that not everybody wants, imported where they are used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from leastaction.errors import MissingExtraError


def extra(module: str, *, of: str, why: str) -> Any:
    """Return a module that comes with an extra of the package.

    ``of``: the extra. ``why``: what needs it, for the message. Raises `MissingExtraError` where it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{why} needs {module}, which cannot be imported ({error}). Install it: pip install 'leastaction[{of}]'"
        ) from error
