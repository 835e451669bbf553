"""A mechanism as text, and back again: what a file of a run or a result holds of it."""

from __future__ import annotations

from leastaction.errors import ModelFileError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.dataset.plain import said_by_text


def text_of(mechanism: Mechanism) -> str | None:
    """Return a mechanism as text, as its file in JSON holds it; None where it has elements that no file can say."""
    from leastaction.mechanics.mechanism.record.mechanism import plan_data  # here, so that to import is quick
    from leastaction.numerics.documents.writing import document_text

    try:
        return document_text(plan_data(mechanism._plan), "json")
    except ModelFileError:
        return None


def mechanism_of(text: str) -> Mechanism:
    """Return the mechanism of a text, the same to the last bit.

    Raises `DescriptionError` for a text that says none.
    """
    from leastaction.mechanics.mechanism.record.mechanism import plan_of
    from leastaction.numerics.documents.document import document_of

    return Mechanism._of(plan_of(document_of(text, "json", title="the mechanism in it")))


said_by_text(Mechanism, text_of, mechanism_of)
