"""Write what the examples print into docs/gallery.md, at the end of the section of each.

python docs/images/draw_gallery.py [7 9 ...]

All of them if none is named. A test holds the page against what they print.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "gallery.md"


def main(numbers: set[int]) -> None:
    """Run these examples, or all, and write the page."""
    page = PAGE.read_text(encoding="utf-8")
    for script in sorted((ROOT / "examples").glob("[0-9]*.py")):
        number = int(script.name[:2])
        if numbers and number not in numbers:
            continue
        with tempfile.TemporaryDirectory() as pictures:
            command = [sys.executable, "-W", "error", str(script), "--out", pictures]
            printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        section = re.compile(rf"^(## {number} .*?)(?:\n```text\n.*?```\n)?(?=\n## |\Z)", re.MULTILINE | re.DOTALL)
        parts = section.search(page)
        if parts is None:
            raise SystemExit(f"{PAGE.name} has no section '## {number} ...'")
        page = f"{page[: parts.start()]}{parts[1]}\n```text\n{printed.rstrip()}\n```\n{page[parts.end() :]}"
        print(f"{script.name}: {len(printed.splitlines())} lines")
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main({int(word) for word in sys.argv[1:]})
