"""Read Biovision Hierarchy (BVH) motion capture files, strictly.

A BVH file is a tree of joints (constant ``OFFSET`` from the parent, list of ``CHANNELS``) and a table with one row of
channel values per frame. In the frame of its parent a joint is at its offset, or at its position channels where it has
them, and is turned by the product of its rotation channels in the order of the file: ``CHANNELS 3 Zrotation Yrotation
Xrotation`` is ``R = Rz Ry Rx``. Angles are in degrees in the file and stay so in `Capture.values`.

The package's own reader, because the readers on the package index that were tried (pybvh 0.9 among them) refuse joints
with position channels or with fewer than three rotations, which common exporters write, let NaN through, and do not
name the line of a broken row. The tests hold the forward kinematics against pybvh where it is installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path

import numpy as np

from leastaction.io.motion.capture import Capture, Joint
from leastaction.io.motion.gaps import fill_gaps
from leastaction.io.motion.text import LONGEST, SHORTEST, MotionText, is_missing, number_of, read_text, shown
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

CHANNEL_NAMES = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")
_CHANNEL_BY_LOWER = {name.lower(): name for name in CHANNEL_NAMES}


@public
def read_bvh(path: str | PathLike[str], *, fill: bool = True) -> Capture:
    """Read a BVH file.

    In the table of the motion NaN, however it is spelled, stands for a sample that is missing. A number of frames that
    is off by one, as some programs count them, is in `Capture.notes`.

    Parameters
    ----------
    path : path
        The file. At least two frames; any skeleton, any channel order.
    fill : bool, optional
        Fill samples that are missing, see `fill_gaps`: `Capture.gaps` says which. Else the values are as in the file.

    Raises
    ------
    MotionFileError
        The file is missing, is no BVH file, is truncated, lacks every sample of a joint, or holds something else than
        what the format asks for at some line; the message names file, line, what was found and expected.
    """
    path = Path(path)
    capture = _BvhReader(path, read_text(path, "a BVH")).read()
    return fill_gaps(capture) if fill else capture


class _BvhReader(MotionText):
    """One pass over the lines of a BVH file."""

    def __init__(self, path: Path, text: str) -> None:
        super().__init__(path, text)
        self.row = 0  # index of the next unread line of the motion table
        self.joints: list[Joint] = []
        self.declared: dict[str, int] = {}  # the line of every joint, by its name

    def read(self) -> Capture:
        tokens = self.hierarchy_lines()
        _, first = self.following(tokens, "the word HIERARCHY, with which a BVH file begins")
        if first[0].upper() != "HIERARCHY":
            self.fail(f"the file begins with {shown(' '.join(first))}", "the word HIERARCHY: this is no BVH file")
        self.read_hierarchy(tokens)
        n_frames = self.read_header("Frames:", "Frames: followed by the number of frames")
        frame_time = self.read_header("Frame Time:", "Frame Time: followed by seconds per frame")
        if n_frames != int(n_frames) or n_frames < 2:
            self.line -= 1
            self.fail(f"{n_frames:g} frames are declared", "a whole number of frames, 2 or more")
        if not SHORTEST <= frame_time <= LONGEST:
            self.fail(f"the frame time is {frame_time:g} s", f"a time greater than zero, {SHORTEST:g} to {LONGEST:g} s")
        values = self.read_rows(int(n_frames))
        values.flags.writeable = False
        notes: tuple[str, ...] = ()
        if len(values) != n_frames:
            notes = (f"{int(n_frames)} frames are declared and {len(values)} are there, which were read",)
        return Capture(str(self.path), tuple(self.joints), frame_time, values, notes=notes)

    def hierarchy_lines(self) -> Iterator[tuple[int, list[str]]]:
        """Words of each line up to MOTION, braces as lines of their own."""
        for number, line in enumerate(self.lines, start=1):
            self.row = number
            for part in line.replace("{", "\n{\n").replace("}", "\n}\n").split("\n"):
                if words := part.split():
                    yield number, words

    def following(self, tokens: Iterator[tuple[int, list[str]]], expected: str) -> tuple[int, list[str]]:
        try:
            number, words = next(tokens)
        except StopIteration:
            self.line = max(1, len(self.lines))
            if not self.joints:
                self.fail("the file ends here", f"{expected}: this is no BVH file")
            self.fail("the file ends here, in the hierarchy (truncated?)", expected)
        self.line = number
        return number, words

    def read_hierarchy(self, tokens: Iterator[tuple[int, list[str]]]) -> None:
        open_joints: list[int] = []
        while True:
            number, words = self.following(tokens, "ROOT, JOINT, End Site, } or MOTION")
            key = words[0].upper()
            if key == "MOTION" and self.joints and not open_joints:
                return
            if key == "ROOT" and not self.joints:
                open_joints.append(self.read_joint(tokens, -1, self.new_name(words)))
            elif key == "JOINT" and open_joints:
                open_joints.append(self.read_joint(tokens, open_joints[-1], self.new_name(words)))
            elif key == "END" and open_joints:
                self.read_end_site(tokens, open_joints[-1], number)
            elif key == "}" and open_joints:
                open_joints.pop()
            elif key == "ROOT":
                self.fail("a second ROOT", "one skeleton per file")
            elif key == "MOTION" and open_joints:
                self.fail("MOTION", f"}} to close joint {self.joints[open_joints[-1]].name!r}")
            else:
                where = "ROOT" if not self.joints else "MOTION"
                if open_joints:
                    where = "JOINT, End Site or }"
                self.fail(shown(" ".join(words)), where)

    def new_name(self, words: list[str]) -> str:
        name = " ".join(words[1:])
        if not name:
            self.fail(f"{words[0]} without a name", f"{words[0]} and the joint's name")
        if name in self.declared:
            self.fail(
                f"a second joint called {name!r} (the first is at line {self.declared[name]})",
                "every joint to have a name of its own",
            )
        return name

    def read_joint(self, tokens: Iterator[tuple[int, list[str]]], parent: int, name: str) -> int:
        line = self.line
        self.expect_brace(tokens, "{", name)
        offset = self.read_offset(tokens, name)
        _, words = self.following(tokens, f"CHANNELS of joint {name!r}")
        if words[0].upper() != "CHANNELS":
            self.fail(shown(" ".join(words)), f"CHANNELS of joint {name!r}")
        listed = words[2:]
        if len(words) < 2 or words[1] != str(len(listed)):
            declared = words[1] if len(words) > 1 else "nothing"
            self.fail(
                f"CHANNELS of joint {name!r} declares {declared} and lists {len(listed)}",
                "the number of channels and as many channel names",
            )
        channels = tuple(_CHANNEL_BY_LOWER.get(word.lower(), "") for word in listed)
        for word, channel in zip(listed, channels, strict=True):
            if not channel:
                self.fail(f"joint {name!r} has a channel {shown(word)}", "one of " + ", ".join(CHANNEL_NAMES))
        if len(set(channels)) != len(channels):
            self.fail(f"joint {name!r} lists a channel twice", "each channel once")
        return self.add(Joint(name, parent, offset, channels, line))

    def add(self, joint: Joint) -> int:
        self.joints.append(joint)
        self.declared[joint.name] = joint.line
        return len(self.joints) - 1

    def read_end_site(self, tokens: Iterator[tuple[int, list[str]]], parent: int, line: int) -> None:
        name = f"{self.joints[parent].name}_end"
        while name in self.declared:
            name += "_"
        self.expect_brace(tokens, "{", name)
        offset = self.read_offset(tokens, name)
        self.expect_brace(tokens, "}", name)
        self.add(Joint(name, parent, offset, (), line))

    def expect_brace(self, tokens: Iterator[tuple[int, list[str]]], brace: str, name: str) -> None:
        _, words = self.following(tokens, f"{brace} of {name!r}")
        if words != [brace]:
            self.fail(shown(" ".join(words)), f"{brace} of {name!r}")

    def read_offset(self, tokens: Iterator[tuple[int, list[str]]], name: str) -> tuple[float, float, float]:
        expected = f"OFFSET of {name!r} with three finite numbers"
        _, words = self.following(tokens, expected)
        numbers = [number_of(word) for word in words[1:]]
        if words[0].upper() != "OFFSET" or len(numbers) != 3 or not np.all(np.isfinite(numbers)):
            self.fail(shown(" ".join(words)), expected)
        return numbers[0], numbers[1], numbers[2]

    def read_header(self, key: str, expected: str) -> float:
        while self.row < len(self.lines) and not self.lines[self.row].strip():
            self.row += 1
        self.line = self.row + 1
        if self.row >= len(self.lines):
            self.line = len(self.lines)
            self.fail("the file ends here (truncated?)", expected)
        words = " ".join(self.lines[self.row].split())
        self.row += 1
        value = number_of(words[len(key) :])
        if not words.lower().startswith(key.lower()) or not np.isfinite(value):
            self.fail(shown(words), expected)
        return value

    def read_rows(self, n_frames: int) -> Array:
        n_channels = sum(len(joint.channels) for joint in self.joints)
        rows: list[list[float]] = []
        last = len(self.lines)
        while last > self.row and not self.lines[last - 1].strip():
            last -= 1
        for number in range(self.row, last):
            words = self.lines[number].split()
            if not words:
                continue
            self.line = number + 1
            frame = len(rows) + 1
            if frame > n_frames + 1:
                self.fail(f"a row for frame {frame}", f"{n_frames} frames, as declared")
            if len(words) != n_channels:
                cut = " (truncated?)" if number == last - 1 and frame < n_frames else ""
                self.fail(
                    f"frame {frame} has {len(words)} values{cut}",
                    f"{n_channels}, one for each channel of the hierarchy",
                )
            row = [number_of(word) for word in words]
            bad = next((i for i, value in enumerate(row) if not np.isfinite(value) and not is_missing(words[i])), None)
            if bad is not None:
                self.fail(f"value {bad + 1} of frame {frame} is {shown(words[bad])}", "a finite number")
            rows.append(row)
        if len(rows) < max(n_frames - 1, 2):
            self.line = len(self.lines)
            self.fail(f"the file ends after {len(rows)} frames (truncated?)", f"{n_frames} frames, as declared")
        return np.array(rows, dtype=np.float64)
