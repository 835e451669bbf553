"""The JSON schema of a mechanism's file.

`python -m leastaction.mechanics.mechanism.record.schema` writes it anew, when frames or elements have changed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from leastaction.mechanics.mechanism.record.mechanism import mechanism_type
from leastaction.numerics.documents import schema_text
from leastaction.numerics.files import write_text

SCHEMA_FILE: Final = Path(__file__).with_name("mechanism.schema.json")

if __name__ == "__main__":
    write_text(SCHEMA_FILE, schema_text(mechanism_type()))
