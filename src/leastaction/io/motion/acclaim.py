"""Read Acclaim motion capture: a skeleton (ASF) and a motion of it (AMC), the format of Carnegie Mellon's database.

A skeleton is a tree of bones: direction and length of each in the world as the skeleton stands, the axes that it turns
about (an orientation C, constant), and about which of these it turns (``dof``). A motion says these angles for every
frame: with M their rotation, a bone is turned against the one before it by ``C M C^-1``. For an order ``XYZ`` of the
axes, rotations are ``Rz Ry Rx``.

Read as a `Capture` the joint called as a bone is at the bone's start, where the one before it ends. Its channels are
those of C, M and C^-1, of which the first and the last do not change: nothing is converted. The root's ``position`` and
``orientation`` place a skeleton that has no motion, and are not used.

The package's own reader: no maintained one is on the package index.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import NoReturn

import numpy as np

from leastaction.errors import MotionFileError
from leastaction.io.motion.capture import Capture, Joint
from leastaction.io.motion.gaps import fill_gaps
from leastaction.io.motion.text import MotionText, is_missing, number_of, read_text, shown
from leastaction.numerics.arrays import Array, as_number

__all__ = ["FRAME_RATE", "read_amc", "skeleton_beside"]

FRAME_RATE = 120.0
"""Frames a second of a motion that does not say how many: those of Carnegie Mellon's database."""

_ROOT = "root"
_TURNS, _MOVES = ("RX", "RY", "RZ"), ("TX", "TY", "TZ")
_SECTIONS = ("version", "name", "units", "documentation", "root", "bonedata", "hierarchy", "skin")
_OF_BONES = ("id", "name", "direction", "length", "axis", "dof", "limits", "bodymass", "cofmass")
_RATES = ("SAMPLES-PER-SECOND", "FRAMES-PER-SECOND")
_FLAGS = ("FULLY-SPECIFIED", "DEGREES", "RADIANS", *_RATES)


def read_amc(
    path: str | PathLike[str],
    skeleton: str | PathLike[str] | None = None,
    *,
    frame_rate: float | None = None,
    fill: bool = True,
) -> Capture:
    """Read an Acclaim motion (AMC) of a skeleton (ASF).

    Parameters
    ----------
    path : path
        The AMC file. At least two frames. In place of a number the word NaN stands for a sample that is missing.
    skeleton : path, optional
        The ASF file; see `skeleton_beside` if left out.
    frame_rate : float, optional
        Frames a second (1/s). If left out, what the file says, or `FRAME_RATE`.
    fill : bool, optional
        Fill samples that are missing, see `fill_gaps`.

    Returns
    -------
    Capture
        Lengths in the files' unit, angles in degrees.

    Raises
    ------
    MotionFileError
        A file is missing, is none of its kind, is truncated, or does not go with the other; the message names file,
        line, what was found and expected.
    ArgumentError
        A frame rate that is not positive.
    """
    path = Path(path)
    if frame_rate is not None:
        as_number(frame_rate, "frame_rate", above=0.0)
    text = read_text(path, "an AMC")
    asf = skeleton_beside(path) if skeleton is None else Path(skeleton)
    bones = _SkeletonReader(asf, read_text(asf, "an ASF")).read()
    motion = _MotionReader(path, text, bones)
    rows = motion.read()
    capture = _capture(path, bones, rows, 1.0 / (frame_rate or motion.rate or FRAME_RATE))
    return fill_gaps(capture) if fill else capture


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
class _Bone:
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


class _SkeletonReader(MotionText):
    """One pass over the lines of an ASF file."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text)
        self.bones: dict[str, _Bone] = {}
        self.radians = False
        self.sections: dict[str, int] = {}

    def read(self) -> dict[str, _Bone]:
        """Return the bones by name, each after the one that it hangs from; the root first."""
        lines = self.content()
        section = ""
        block: _Bone | None = None
        open_since = 0
        for words in lines:
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
                block, open_since = _Bone("", self.line), self.line
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
        self.line = max(1, len(self.lines))
        if open_since:
            self.fail("the file ends here (truncated?)", f"end of what begins at line {open_since}")
        for needed in ("root", "bonedata", "hierarchy"):
            if needed not in self.sections:
                self.fail("the file ends here (truncated?)", f"a section :{needed}")
        return self.from_the_root()

    def content(self) -> Iterator[list[str]]:
        """Words of each line that has some, without comments."""
        for number, line in enumerate(self.lines, start=1):
            self.line = number
            if words := line.split("#", 1)[0].split():
                yield words

    def begin_section(self, name: str) -> str:
        if name not in _SECTIONS:
            self.fail(shown(f":{name}"), "a section: " + ", ".join(f":{each}" for each in _SECTIONS))
        if name in self.sections:
            self.fail(f"a second section :{name} (the first is at line {self.sections[name]})", "each section once")
        self.sections[name] = self.line
        if name == _ROOT:
            self.bones[_ROOT] = _Bone(_ROOT, self.line)
        return name

    def one_of(self, words: list[str], allowed: tuple[str, ...]) -> str:
        if len(words) != 2 or words[1].lower() not in allowed:
            self.fail(shown(" ".join(words)), f"{words[0]} and one of {', '.join(allowed)}")
        return words[1].lower()

    def read_of_root(self, words: list[str]) -> None:
        root, key = self.bones[_ROOT], words[0].lower()
        if key == "order":
            root.dof = tuple(word.upper() for word in words[1:])
            if set(root.dof) - {*_TURNS, *_MOVES} or len(set(root.dof)) != len(root.dof):
                self.fail(shown(" ".join(words)), f"order and each of {', '.join((*_MOVES, *_TURNS))} at most once")
            root.given.add("order")
        elif key == "axis":
            root.order = self.order_of(words[1:])
        elif key not in ("position", "orientation"):
            self.fail(shown(" ".join(words)), "order, axis, position or orientation of the root")

    def read_of_bone(self, bone: _Bone, words: list[str]) -> None:
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
            if set(bone.dof) - set(_TURNS) or len(set(bone.dof)) != len(bone.dof):
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

    def add(self, bone: _Bone) -> None:
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
            if name == _ROOT or bone.parent:
                self.fail(f"bone {name!r} hangs from {parent!r} too", "every bone but the root to hang from one other")
            bone.parent = parent
            self.bones[parent].children.append(name)

    def from_the_root(self) -> dict[str, _Bone]:
        root = self.bones[_ROOT]
        if "order" not in root.given:
            self.line = root.line
            self.fail("a root without order", "order of the root's channels")
        found: dict[str, _Bone] = {}
        waiting = [_ROOT]
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


class _MotionReader(MotionText):
    """One pass over the lines of an AMC file."""

    def __init__(self, path: Path, text: str, bones: dict[str, _Bone]) -> None:
        super().__init__(path, text)
        self.columns: dict[str, slice] = {}
        start = 0
        for name, bone in bones.items():
            if bone.dof:
                self.columns[name] = slice(start, start + len(bone.dof))
                start += len(bone.dof)
        self.width = start
        self.bones = bones
        self.turns = np.array([each in _TURNS for bone in bones.values() for each in bone.dof], dtype=bool)
        self.radians = False
        self.rate: float | None = None

    def read(self) -> Array:
        """Return the values of all frames (F, width), angles in degrees."""
        rows: list[list[float]] = []
        seen: dict[str, int] = {}
        first = 0
        for number, line in enumerate(self.lines, start=1):
            self.line = number
            words = line.split("#", 1)[0].split()
            if not words:
                continue
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
        self.line = max(1, len(self.lines))
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
            if not 0.0 < rate < np.inf:
                self.fail(shown(" ".join(words)), "a finite number of frames a second, greater than zero")
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
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        at_end = " (truncated?)" if self.line >= len(self.lines) else ""
        self.fail(f"frame {frame} ends without {', '.join(lost[:3])}{more}{at_end}", "values of every bone that turns")


def _capture(path: Path, bones: dict[str, _Bone], rows: Array, frame_time: float) -> Capture:
    """Return a motion as a capture: the turns to a bone's axes and back are channels that do not change."""
    joints: list[Joint] = []
    index: dict[str, int] = {}
    columns: list[Array] = []
    start = 0
    for name, bone in bones.items():
        own = {each: rows[:, start + i] for i, each in enumerate(bone.dof)}
        start += len(bone.dof)
        axes = bone.order[::-1]  # of Rz Ry Rx, for XYZ
        tilt = dict(zip("XYZ", bone.axis, strict=True))
        channels = [(f"{each[1]}position", values) for each, values in own.items() if each in _MOVES]
        turns = [(f"{axis}rotation", own[f"R{axis}"]) for axis in axes if f"R{axis}" in own]
        if turns and name != _ROOT:
            still = np.ones(len(rows))
            there = [(f"{axis}rotation", tilt[axis] * still) for axis in axes if tilt[axis]]
            turns = [*there, *turns, *((axis, -values) for axis, values in reversed(there))]
        channels += turns
        before = bones[bone.parent] if bone.parent else None
        index[name] = len(joints)
        joints.append(
            Joint(
                name,
                index[bone.parent] if before else -1,
                before.end if before else (0.0, 0.0, 0.0),
                tuple(each for each, _ in channels),
                bone.line,
            )
        )
        columns += [values for _, values in channels]
        if not bone.children and bone.length > 0.0:
            joints.append(Joint(_end_of(name, bones), index[name], bone.end, (), bone.line))
    values = np.stack(columns, axis=1) if columns else np.zeros((len(rows), 0))
    values.flags.writeable = False
    return Capture(str(path), tuple(joints), frame_time, values)


def _end_of(name: str, bones: dict[str, _Bone]) -> str:
    end = f"{name}_end"
    while end in bones:
        end += "_"
    return end
