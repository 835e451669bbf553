"""The JSON schema of a problem file; `python -m leastaction.apps.problems.schema` writes it anew."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from leastaction.apps.problems.records import ProblemRecord
from leastaction.numerics.documents import schema_text
from leastaction.numerics.files import write_text

SCHEMA_FILE: Final = Path(__file__).with_name("problem.schema.json")

if __name__ == "__main__":
    write_text(SCHEMA_FILE, schema_text(ProblemRecord))
