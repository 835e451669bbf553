"""``python -m benchmarks.models FOLDER ... > docs/models.md``: what becomes of every URDF and MJCF in some folders.

A line for each file: what it is as a mechanism, and what it says that the mechanism does not have.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import leastaction
from leastaction.errors import ModelFileError
from leastaction.io.mechanisms import LeftOut

HEAD = """# Models that were tried

Made by `python -m benchmarks.models FOLDER ...`. Every file is loaded with `leastaction.load(file)`, or where that says
so with `inertia="repair"` (marked *). q: variables; u: inputs; h: constraint equations; limits: ready `Bound`s. What is
left out is counted by kind; cameras, lights, sensors and the look of planes are not listed. The dynamics of what is
there are held against Pinocchio (URDF) and MuJoCo (MJCF) in `tests/io/mechanisms/`.
"""
_SEEN = ("camera", "light", "sensor", "the look of", "mesh '", "touching geom", "collision shape", "<")


def main(folders: Iterable[str]) -> None:
    """Print the page."""
    print(HEAD)
    for folder in map(Path, folders):
        files = sorted([*folder.rglob("*.urdf"), *folder.rglob("*.xml")])
        lines, none = [], []
        for file in files:
            line = _line(file, str(file.relative_to(folder)), none)
            if line:
                lines.append(line)
        print(f"## {folder.name}\n\n{len(lines)} of {len(files)} files hold a mechanism.\n")
        print("| file | q | u | h | limits | shapes | left out |\n|---|---|---|---|---|---|---|")
        print("\n".join(lines))
        if none:
            print("\nNo mechanism is in:\n")
            print("\n".join(f"- {why}: {', '.join(names)}" for why, names in _grouped(none)))
        print()


def _line(file: Path, name: str, none: list[tuple[str, str]]) -> str:
    mark = ""
    try:
        try:
            model = leastaction.load(file)
        except ModelFileError as error:
            if "inertia='repair'" not in str(error):
                raise
            model, mark = leastaction.load(file, inertia="repair"), " *"
    except ModelFileError as error:
        none.append((_reason(str(error).removeprefix(str(file))), name))
        return ""
    m = model.mechanism
    counts = f"{m.nq} | {m.n_inputs} | {m.nc} | {len(model.limits)} | {len(model.shapes)}"
    return f"| {name}{mark} | {counts} | {_left_out(model.left_out)} |"


def _left_out(every: Iterable[LeftOut]) -> str:
    kinds = Counter(
        re.sub(r" (of the joint |of )?'[^']*'.*", "", each.name).strip()
        for each in every
        if not any(part in each.name for part in _SEEN)
    )
    return "; ".join(f"{number} x {kind}" if number > 1 else kind for kind, number in kinds.items())


def _reason(text: str) -> str:
    text = re.sub(r"^[:,\s]+(line \d+[^:]*: )?", "", text)
    text = re.split(r"[;:,] | Element ", text.removeprefix("the file holds no robot: "))[0]
    return re.sub(r"'[^']*'", "...", text)


def _grouped(none: Iterable[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    groups: dict[str, list[str]] = {}
    for why, name in none:
        groups.setdefault(why, []).append(name)
    return list(groups.items())


if __name__ == "__main__":
    main(sys.argv[1:])
