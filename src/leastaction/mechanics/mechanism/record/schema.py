"""The JSON schema of a mechanism's file: editors complete and check by it while a file is written.

`python -m leastaction.mechanics.mechanism.record.schema` writes it anew, when frames or elements have changed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import msgspec

from leastaction.mechanics.mechanism.record.mechanism import mechanism_type
from leastaction.numerics.files import write_text

SCHEMA_FILE: Final = Path(__file__).with_name("mechanism.schema.json")


def schema_text(kind: Any) -> str:
    """Return the JSON schema of a type of files."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **msgspec.json.schema(kind)}
    return json.dumps(schema, indent=1) + "\n"


if __name__ == "__main__":
    write_text(SCHEMA_FILE, schema_text(mechanism_type()))
