"""Plain data as text, with every float as it is, and as files that are whole or absent."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import msgspec

from leastaction.errors import ModelFileError
from leastaction.numerics.documents.dialect import dumper
from leastaction.numerics.documents.document import NOTATIONS, Notation
from leastaction.numerics.files import write_text

_WIDTH = 110


def document_text(data: Any, notation: Notation) -> str:
    """Return plain data as YAML or JSON; what is read from it is the same, bit by bit."""
    if notation == "json":
        return json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    import yaml

    return str(
        yaml.dump(data, Dumper=dumper(), sort_keys=False, allow_unicode=True, default_flow_style=None, width=_WIDTH)
    )


def schema_text(kind: Any) -> str:
    """Return the JSON schema of a type of documents: editors complete and check by it while a file is written."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(kind)}
    return json.dumps(schema, indent=1) + "\n"


def write_document(path: str | os.PathLike[str], data: Any) -> Path:
    """Write plain data as its ending says, whole or not at all.

    Returns the file. Raises `ModelFileError` for another ending than ``.yaml``, ``.yml`` and ``.json``, `OutputError`
    where the file cannot be written.
    """
    file = Path(path)
    notation = NOTATIONS.get(file.suffix.lower())
    if notation is None:
        raise ModelFileError(f"{file}: got the ending {file.suffix!r}, expected one of {', '.join(NOTATIONS)}")
    return write_text(file, document_text(data, notation))
