"""Skeletons of Acclaim's (ASF files)."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Final

import numpy as np

from leastaction.errors import MotionFileError
from leastaction.io.motion.text import MotionText, number_of, read_text, shown

ROOT: Final = "root"
TURNS: Final = ("RX", "RY", "RZ")
MOVES: Final = ("TX", "TY", "TZ")
_SECTIONS = ("version", "name", "units", "documentation", "root", "bonedata", "hierarchy", "skin")
_OF_BONES = ("id", "name", "direction", "length", "axis", "dof", "limits", "bodymass", "cofmass")


def skeleton_beside(path: str | PathLike[str]) -> Path:
    """Return the skeleton that goes with a motion: the only ASF file in its folder whose name its own begins with.

    So ``02_01.amc`` and ``02_01_walk.amc`` find ``02.asf``; the longest such name counts. A folder with a single
    ASF file needs no such name.

    Raises
    ------
    MotionFileError
        There is none.
    """
    path = Path(path)
    try:
        found = sorted(each for each in path.parent.iterdir() if each.suffix.lower() == ".asf")
    except OSError:
        found = []
    named = [each for each in found if path.stem.lower().startswith(each.stem.lower())]
    if named:
        return max(named, key=lambda each: len(each.stem))
    if len(found) == 1:
        return found[0]
    there = f"there are {len(found)}, none of such a name" if found else "there is none"
    raise MotionFileError(
        f"{path}: no skeleton beside it: {there}; expected an ASF file whose name the motion's begins with. "
        "Name the skeleton (--skeleton FILE)."
    )


@dataclass
class AcclaimBone:
    """A bone of a skeleton; the root is one of no length."""

    name: str
    line: int
    direction: tuple[float, ...] = (0.0, 0.0, 0.0)
    length: float = 0.0
    axis: tuple[float, ...] = (0.0, 0.0, 0.0)  # degrees
    order: str = "XYZ"
    dof: tuple[str, ...] = ()
    parent: str = ""
    children: list[str] = field(default_factory=list)
    given: set[str] = field(default_factory=set)

    @property
    def end(self) -> tuple[float, float, float]:
        """Where it ends, seen from its start."""
        x, y, z = (self.length * each for each in self.direction)
        return x, y, z


def read_skeleton(path: Path) -> dict[str, AcclaimBone]:
    """Return the bones of an ASF file by name, each after the one that it hangs from; the root first.

    Raises `MotionFileError`: the file is missing, is none of its kind, is truncated, or contradicts itself.
    """
    return _SkeletonReader(path, read_text(path, "an ASF")).read()


class _SkeletonReader(MotionText):
    """One pass over the lines of an ASF file."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text)
        self.bones: dict[str, AcclaimBone] = {}
        self.radians = False
        self.sections: dict[str, int] = {}

    def read(self) -> dict[str, AcclaimBone]:
        section = ""
        block: AcclaimBone | None = None
        open_since = 0
        for words in self.uncommented():
            key = words[0].lower()
            if key.startswith(":"):
                if open_since:
                    self.fail(shown(" ".join(words)), f"end of what begins at line {open_since}")
                section = self.begin_section(key[1:])
            elif not section:
                self.fail(
                    f"the file begins with {shown(' '.join(words))}",
                    "a section such as :version: this is no ASF skeleton",
                )
            elif section in ("bonedata", "hierarchy") and key == "begin" and not open_since:
                block, open_since = AcclaimBone("", self.line), self.line
            elif section in ("bonedata", "hierarchy") and key == "end" and open_since:
                if section == "bonedata" and block is not None:
                    self.add(block)
                open_since = 0
            elif section == "bonedata" and block is not None and open_since:
                self.read_of_bone(block, words)
            elif section == "hierarchy" and open_since:
                self.read_children(words)
            elif section in ("bonedata", "hierarchy"):
                self.fail(shown(" ".join(words)), "begin")
            elif section == "root":
                self.read_of_root(words)
            elif section == "units" and key == "angle":
                self.radians = self.one_of(words, ("deg", "rad")) == "rad"
        if open_since:
            self.fail("the file ends here (truncated?)", f"end of what begins at line {open_since}")
        for needed in ("root", "bonedata", "hierarchy"):
            if needed not in self.sections:
                self.fail("the file ends here (truncated?)", f"a section :{needed}")
        return self.from_the_root()

    def begin_section(self, name: str) -> str:
        if name not in _SECTIONS:
            self.fail(shown(f":{name}"), "a section: " + ", ".join(f":{each}" for each in _SECTIONS))
        if name in self.sections:
            self.fail(f"a second section :{name} (the first is at line {self.sections[name]})", "each section once")
        self.sections[name] = self.line
        if name == ROOT:
            self.bones[ROOT] = AcclaimBone(ROOT, self.line)
        return name

    def one_of(self, words: list[str], allowed: tuple[str, ...]) -> str:
        if len(words) != 2 or words[1].lower() not in allowed:
            self.fail(shown(" ".join(words)), f"{words[0]} and one of {', '.join(allowed)}")
        return words[1].lower()

    def read_of_root(self, words: list[str]) -> None:
        root, key = self.bones[ROOT], words[0].lower()
        if key == "order":
            root.dof = tuple(word.upper() for word in words[1:])
            if set(root.dof) - {*TURNS, *MOVES} or len(set(root.dof)) != len(root.dof):
                self.fail(shown(" ".join(words)), f"order and each of {', '.join((*MOVES, *TURNS))} at most once")
            root.given.add("order")
        elif key == "axis":
            root.order = self.order_of(words[1:])
        elif key not in ("position", "orientation"):
            self.fail(shown(" ".join(words)), "order, axis, position or orientation of the root")

    def read_of_bone(self, bone: AcclaimBone, words: list[str]) -> None:
        key = words[0].lower()
        if key.startswith("("):  # a further line of limits
            return
        if key not in _OF_BONES:
            self.fail(shown(" ".join(words)), f"one of {', '.join(_OF_BONES)}, or end")
        if key in bone.given:
            self.fail(f"a second {key} of bone {bone.name!r}", f"one {key}")
        bone.given.add(key)
        if key == "name":
            if len(words) != 2:
                self.fail(shown(" ".join(words)), "name and the bone's name")
            bone.name = words[1]
        elif key == "direction":
            bone.direction = self.numbers(words[1:], 3, "direction with three finite numbers")
        elif key == "length":
            (bone.length,) = self.numbers(words[1:], 1, "length with one finite number, zero or more")
            if bone.length < 0.0:
                self.fail(f"length {bone.length:g}", "zero or more")
        elif key == "axis":
            bone.axis = self.numbers(words[1:4], 3, "axis with three finite numbers and an order such as XYZ")
            bone.order = self.order_of(words[4:])
        elif key == "dof":
            bone.dof = tuple(word.upper() for word in words[1:])
            if set(bone.dof) - set(TURNS) or len(set(bone.dof)) != len(bone.dof):
                self.fail(shown(" ".join(words)), "dof and each of rx, ry, rz at most once")

    def numbers(self, words: list[str], count: int, expected: str) -> tuple[float, ...]:
        found = tuple(number_of(word) for word in words)
        if len(found) != count or not np.all(np.isfinite(found)):
            self.fail(shown(" ".join(words)), expected)
        return found

    def order_of(self, words: list[str]) -> str:
        order = "".join(words).upper()
        if sorted(order) != ["X", "Y", "Z"]:
            self.fail(shown(" ".join(words)), "an order of the axes such as XYZ")
        return order

    def add(self, bone: AcclaimBone) -> None:
        self.line, last = bone.line, self.line
        for needed in ("name", "direction", "length", "axis"):
            if needed not in bone.given:
                self.fail(f"bone {bone.name!r} without {needed}", f"{needed} of every bone")
        if bone.name in self.bones:
            self.fail(
                f"a second bone called {bone.name!r} (the first is at line {self.bones[bone.name].line})",
                "every bone to have a name of its own",
            )
        self.bones[bone.name] = bone
        self.line = last

    def read_children(self, words: list[str]) -> None:
        for name in words:
            if name not in self.bones:
                self.fail(f"{shown(name)} is no bone", "names of bones of :bonedata")
        parent, *children = words
        for name in children:
            bone = self.bones[name]
            if name == ROOT or bone.parent:
                self.fail(f"bone {name!r} hangs from {parent!r} too", "every bone but the root to hang from one other")
            bone.parent = parent
            self.bones[parent].children.append(name)

    def from_the_root(self) -> dict[str, AcclaimBone]:
        root = self.bones[ROOT]
        if "order" not in root.given:
            self.line = root.line
            self.fail("a root without order", "order of the root's channels")
        found: dict[str, AcclaimBone] = {}
        waiting = [ROOT]
        while waiting:
            name = waiting.pop()
            found[name] = self.bones[name]
            waiting.extend(reversed(self.bones[name].children))
        for name, bone in self.bones.items():
            if name not in found:
                self.line = bone.line
                self.fail(f"bone {name!r} does not hang from the root", "a place in :hierarchy for every bone")
            if self.radians:
                x, y, z = np.rad2deg(bone.axis)
                bone.axis = float(x), float(y), float(z)
        return found
