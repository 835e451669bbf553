"""Draw the pictures of docs/plots.md by running its code: each block's figure is the picture behind it.

python docs/images/draw_plots.py
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from leastaction.viz import save_png

PAGE = Path(__file__).parents[1] / "plots.md"


def main() -> None:
    """Run every block and save its figure."""
    for block, picture in re.findall(
        r"```python\n(.*?)```\n+!\[[^]]*\]\(([^)]+)\)", PAGE.read_text("utf-8"), re.DOTALL
    ):
        names: dict[str, Any] = {}
        exec(compile(block, PAGE.name, "exec"), names)
        print(save_png(names["figure"], PAGE.parent / picture, dpi=100), names.get("result", names.get("run", "")))


if __name__ == "__main__":
    main()
