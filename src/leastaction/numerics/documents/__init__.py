"""Files that people write: YAML and JSON, read with the place of every mistake, written whole or not at all."""

from __future__ import annotations

from leastaction.numerics.documents.document import Document, Place, document_of, read_document, shown
from leastaction.numerics.documents.writing import document_text, write_document

__all__ = ["Document", "Place", "document_of", "document_text", "read_document", "shown", "write_document"]
