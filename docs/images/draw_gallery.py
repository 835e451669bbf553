"""Write what the examples print into docs/gallery.md, into the sections that show it, and keep their pictures.

python docs/images/draw_gallery.py [7 9 ...]

All of them if none is named. A test holds the page against what they print.
"""

from __future__ import annotations

import re
import shutil
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
            shutil.copy(Path(pictures) / f"{script.stem}.png", Path(__file__).with_name(f"gallery_{script.stem}.png"))
        found = re.search(rf"^## {number} .*?(?=\n## |\Z)", page, re.MULTILINE | re.DOTALL)
        if found is None:
            raise SystemExit(f"{PAGE.name} has no section '## {number} ...'")
        block = f"```text\n{printed.rstrip()}\n```\n"
        section = re.sub(r"```text\n.*?```\n", lambda _, block=block: block, found[0], flags=re.DOTALL)
        page = f"{page[: found.start()]}{section}{page[found.end() :]}"
        PAGE.write_text(page, encoding="utf-8")
        print(f"{script.name}: {len(printed.splitlines())} lines")


if __name__ == "__main__":
    main({int(word) for word in sys.argv[1:]})
