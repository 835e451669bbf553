"""A mechanism as text, and back again: what a file of a run or a result holds of it."""

from __future__ import annotations

from leastaction.mechanics.mechanism.mechanism import Mechanism


def text_of(mechanism: Mechanism) -> str | None:
    """Return a mechanism as text; None where it holds functions of Python, which no text can say."""
    del mechanism
    return None


def mechanism_of(text: str) -> Mechanism:
    """Return the mechanism of a text, the same to the last bit.

    Raises `DescriptionError` for a text that says none.
    """
    raise NotImplementedError(text[:60])
