"""Files that people write: YAML and JSON, read with the place of every mistake, written whole or not at all."""

from __future__ import annotations

from leastaction.numerics.documents.document import (
    NOTATIONS,
    Document,
    Place,
    check_format,
    document_of,
    read_document,
    shown,
)
from leastaction.numerics.documents.writing import document_text, schema_text, write_document

__all__ = [
    "NOTATIONS",
    "Document",
    "Place",
    "check_format",
    "document_of",
    "document_text",
    "read_document",
    "schema_text",
    "shown",
    "write_document",
]
