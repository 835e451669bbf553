"""Motions of Acclaim's (AMC files)."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import numpy as np

from leastaction.errors import some
from leastaction.io.motion.acclaim.skeleton import TURNS, AcclaimBone
from leastaction.io.motion.text import LONGEST, SHORTEST, MotionText, is_missing, number_of, shown
from leastaction.numerics.arrays import Array

_RATES = ("SAMPLES-PER-SECOND", "FRAMES-PER-SECOND")
_FLAGS = ("FULLY-SPECIFIED", "DEGREES", "RADIANS", *_RATES)


def read_values(path: Path, text: str, bones: dict[str, AcclaimBone]) -> tuple[Array, float | None]:
    """Return the values (F, width) of an AMC file's frames, angles in degrees, and its frames a second if it says them.

    ``text``: what is in the file. ``bones``: of its skeleton, in whose order the values come. Raises `MotionFileError`:
    the file is none of its kind, is truncated, or does not go with the skeleton.
    """
    reader = _MotionReader(path, text, bones)
    return reader.read(), reader.rate


class _MotionReader(MotionText):
    """One pass over the lines of an AMC file."""

    def __init__(self, path: Path, text: str, bones: dict[str, AcclaimBone]) -> None:
        super().__init__(path, text)
        self.columns: dict[str, slice] = {}
        start = 0
        for name, bone in bones.items():
            if bone.dof:
                self.columns[name] = slice(start, start + len(bone.dof))
                start += len(bone.dof)
        self.width = start
        self.bones = bones
        self.turns = np.array([each in TURNS for bone in bones.values() for each in bone.dof], dtype=bool)
        self.radians = False
        self.rate: float | None = None

    def read(self) -> Array:
        rows: list[list[float]] = []
        seen: dict[str, int] = {}
        first = 0
        for words in self.uncommented():
            if words[0].startswith(":"):
                self.read_flag(words, begun=bool(rows))
            elif len(words) == 1 and words[0].isascii() and words[0].isdigit():
                frame = int(words[0][:18])
                first = first if rows else frame
                if rows:
                    self.check_whole(seen, first + len(rows) - 1)
                if frame != first + len(rows):
                    self.fail(f"frame {shown(words[0])}", f"frame {first + len(rows)}: frames one after the other")
                rows.append([np.nan] * self.width)
                seen = {}
            elif not rows:
                self.fail(f"{shown(' '.join(words))} before the first frame", "the number of a frame: is this AMC?")
            else:
                self.read_bone(words, rows[-1], seen)
        if rows:
            self.check_whole(seen, first + len(rows) - 1)
        if len(rows) < 2:
            self.fail(f"the file ends after {len(rows)} frames (truncated?)", "two frames or more")
        values = np.array(rows, dtype=np.float64)
        if self.radians:
            values[:, self.turns] = np.rad2deg(values[:, self.turns])
        return values

    def read_flag(self, words: list[str], *, begun: bool) -> None:
        flag = words[0][1:].upper()
        if begun or flag not in _FLAGS:
            where = " before the first frame" if begun else ""
            self.fail(shown(" ".join(words)), "one of " + ", ".join(f":{each}" for each in _FLAGS) + where)
        if flag in _RATES:
            rate = number_of(words[1]) if len(words) == 2 else float("nan")
            if not 1.0 / LONGEST <= rate <= 1.0 / SHORTEST:
                self.fail(
                    shown(" ".join(words)), f"a number of frames a second, {1.0 / LONGEST:g} to {1.0 / SHORTEST:g}"
                )
            self.rate = rate
        elif flag in ("DEGREES", "RADIANS"):
            self.radians = flag == "RADIANS"

    def read_bone(self, words: list[str], row: list[float], seen: dict[str, int]) -> None:
        name = words[0]
        place = self.columns.get(name)
        if place is None:
            self.no_values(name)
        if name in seen:
            self.fail(f"bone {name!r} again (it is at line {seen[name]} too)", "each bone once in a frame")
        seen[name] = self.line
        count = place.stop - place.start
        if len(words) - 1 != count:
            axes = " ".join(self.bones[name].dof).lower()
            self.fail(f"bone {name!r} has {len(words) - 1} values", f"{count} ({axes}), as the skeleton says")
        values = [number_of(word) for word in words[1:]]
        for word, value in zip(words[1:], values, strict=True):
            if not np.isfinite(value) and not is_missing(word):
                self.fail(f"a value of bone {name!r} is {shown(word)}", "a finite number")
        row[place] = values

    def no_values(self, name: str) -> NoReturn:
        if name in self.bones:
            self.fail(f"values of bone {shown(name)}", "none: the skeleton says that it does not turn")
        self.fail(f"{shown(name)} is no bone of the skeleton", "a bone, or the number of the next frame")

    def check_whole(self, seen: dict[str, int], frame: int) -> None:
        if len(seen) == len(self.columns):
            return
        lost = [name for name in self.columns if name not in seen]
        at_end = " (truncated?)" if self.line >= len(self.lines) else ""
        self.fail(f"frame {frame} ends without {some(lost, 3)}{at_end}", "values of every bone that turns")
