"""Broken motion files, mappings and arguments: a typed error that says where, what and what to do."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from leastaction.errors import ArgumentError, LeastActionError, MotionFileError
from leastaction.io import Motion, read_bvh
from leastaction_marionette import (
    VARIABLES,
    load_motion,
    map_joints,
    read_mapping,
    retarget,
    walk_in_place,
)
from marionette.puppet_bvh import CMU_NAMES, Convention, waving, write_puppet

Change = Callable[[list[str]], list[str]]


def replaced(old: str, new: str) -> Change:
    """Replace the first line that begins with `old` by `new`."""

    def change(lines: list[str]) -> list[str]:
        index = next(i for i, line in enumerate(lines) if line.startswith(old))
        return [*lines[:index], new, *lines[index + 1 :]]

    return change


def word_of_last_frame(new: str | None) -> Change:
    def change(lines: list[str]) -> list[str]:
        words = lines[-1].split()
        words[4:5] = [] if new is None else [new]
        return [*lines[:-1], " ".join(words)]

    return change


BROKEN: dict[str, tuple[Change, str]] = {
    "empty": (lambda _: [], "line 1: the file ends here; expected the word HIERARCHY"),
    "prose": (
        lambda _: ["Dear reader,", "hello"],
        "begins with 'Dear reader,'.*this is no BVH file",
    ),
    "cut in the hierarchy": (lambda x: x[:30], "line 30: the file ends here, in the hierarchy"),
    "cut before the motion": (
        lambda x: x[: x.index("MOTION") + 1],
        "truncated.*expected Frames: followed by",
    ),
    "cut between frames": (lambda x: x[:-7], "ends after 53 frames .truncated.*60 frames"),
    "cut in a frame": (
        lambda x: [*x[:-7], x[-7][: len(x[-7]) // 2].rsplit(" ", 1)[0]],
        r"frame 54 has \d+ values .truncated.*; expected 42",
    ),
    "value missing": (word_of_last_frame(None), "frame 60 has 41 values; expected 42"),
    "word in a frame": (word_of_last_frame("abc"), "value 5 of frame 60 is 'abc'.*finite number"),
    "NaN in every frame": (
        lambda x: [*x[:-60], *(" ".join(["nan"] * 42) for _ in range(60))],
        "'Hips' has no sample that is known",
    ),
    "infinity in a frame": (word_of_last_frame("-inf"), "value 5 of frame 60 is '-inf'"),
    "underscore in a number": (
        word_of_last_frame("1_0"),
        "value 5 of frame 60 is '1_0'.*finite number",
    ),
    "other digits": (word_of_last_frame("\u0661\u0662"), "value 5 of frame 60 is '\u0661\u0662'"),
    "underscore in the frames": (replaced("Frames:", "Frames: 6_0"), "expected Frames: followed"),
    "underscore in an offset": (
        replaced("OFFSET", "OFFSET 0 0 1_0"),
        "OFFSET of 'Hips' with three",
    ),
    "two frames too many": (lambda x: [*x, x[-1], x[-1]], "a row for frame 62; expected 60 frames"),
    "two frames too few": (lambda x: x[:-2], "ends after 58 frames .truncated.*60 frames"),
    "wrong channel count": (
        replaced("CHANNELS 3", "CHANNELS 4 Zrotation Yrotation Xrotation"),
        "CHANNELS of joint 'LeftUpLeg' declares 4 and lists 3",
    ),
    "unknown channel": (
        replaced("CHANNELS 3", "CHANNELS 3 Zrotation Wrotation Xrotation"),
        "joint 'LeftUpLeg' has a channel 'Wrotation'; expected one of Xposition",
    ),
    "channel twice": (
        replaced("CHANNELS 3", "CHANNELS 3 Zrotation Zrotation Xrotation"),
        "joint 'LeftUpLeg' lists a channel twice",
    ),
    "fewer channels than values": (
        replaced("CHANNELS 3", "CHANNELS 2 Zrotation Yrotation"),
        "frame 1 has 42 values; expected 41",
    ),
    "joint twice": (
        replaced("JOINT RightLeg", "JOINT LeftLeg"),
        "a second joint called 'LeftLeg' .the first is at line",
    ),
    "offset of two numbers": (replaced("OFFSET", "OFFSET 0 0"), "OFFSET of 'Hips' with three"),
    "offset NaN": (replaced("OFFSET", "OFFSET 0 0 nan"), "OFFSET of 'Hips' with three finite"),
    "joint without a name": (replaced("JOINT LeftLeg", "JOINT"), "JOINT without a name"),
    "one brace too few": (replaced("}", ""), "MOTION; expected } to close joint 'Hips'"),
    "two roots": (replaced("MOTION", "ROOT Other"), "a second ROOT; expected one skeleton"),
    "no frames": (replaced("Frames:", "Frames: 0"), "0 frames are declared.*2 or more"),
    "one frame": (replaced("Frames:", "Frames: 1"), "1 frames are declared.*2 or more"),
    "frames in words": (replaced("Frames:", "Frames: many"), "expected Frames: followed by"),
    "frame time zero": (replaced("Frame Time:", "Frame Time: 0"), "frame time is 0 s.*greater"),
    "frame time negative": (replaced("Frame Time:", "Frame Time: -0.01"), "frame time is -0.01 s"),
    "frame time too short": (replaced("Frame Time:", "Frame Time: 1e-320"), "frame time is 9.99989e-321 s; expected"),
    "frame time too long": (replaced("Frame Time:", "Frame Time: 1e300"), "frame time is 1e.300 s; expected"),
    "frame time missing": (replaced("Frame Time:", ""), "expected Frame Time: followed by"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_named_with_line_and_expectation(tmp_path: Path, case: str) -> None:
    change, message = BROKEN[case]
    path = write_puppet(tmp_path / "broken.bvh", waving())
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(MotionFileError, match=message) as caught:
        read_bvh(path)
    assert re.search(r"broken\.bvh, line \d+: ", str(caught.value))
    assert "expected" in str(caught.value)


@pytest.mark.parametrize(("change", "frames"), [(lambda x: [*x, x[-1]], 61), (lambda x: x[:-1], 59)])
def test_a_number_of_frames_that_is_off_by_one_is_noted(tmp_path: Path, change: Change, frames: int) -> None:
    path = write_puppet(tmp_path / "off.bvh", waving())
    path.write_text("\n".join(change(path.read_text().splitlines())))
    read = read_bvh(path)
    assert read.n_frames == frames
    assert read.notes == (f"60 frames are declared and {frames} are there, which were read",)
    assert read.notes[0] in read.describe_gaps()


def test_a_mapping_of_many_dots_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(".".join("a" * 50_000) + " = 1")
    began = time.process_time()
    with pytest.raises(MotionFileError, match=r"has 49999 dots, expected .* which nests nothing"):
        read_mapping(path)
    assert time.process_time() - began < 1.0


def test_the_line_is_the_right_one(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "broken.bvh", waving())
    lines = word_of_last_frame("abc")(path.read_text().splitlines())
    path.write_text("\n".join(lines))
    with pytest.raises(MotionFileError, match=f"line {len(lines)}: value 5"):
        read_bvh(path)
    number = next(i for i, line in enumerate(lines, 1) if line.startswith("CHANNELS 3"))
    path.write_text("\n".join(replaced("CHANNELS 3", "CHANNELS 3 a b")(lines)))
    with pytest.raises(MotionFileError, match=f"line {number}: CHANNELS"):
        read_bvh(path)


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "cut.bvh", waving(3))
    data = path.read_bytes()
    # A cut inside the last number leaves a whole file; before it, every cut is seen.
    for keep in range(0, len(data) - 24, 41):
        path.write_bytes(data[:keep])
        with pytest.raises(MotionFileError, match=r"cut\.bvh, line"):
            read_bvh(path)


def test_what_is_no_text_or_no_file(tmp_path: Path) -> None:
    path = tmp_path / "picture.bvh"
    path.write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(MotionFileError, match=r"picture\.bvh: holds bytes that are no text"):
        read_bvh(path)
    with pytest.raises(MotionFileError, match=r"nowhere\.bvh: cannot be read .No such file"):
        read_bvh(tmp_path / "nowhere.bvh")
    with pytest.raises(MotionFileError, match="cannot be read"):
        read_bvh(tmp_path)
    assert issubclass(MotionFileError, (LeastActionError, ValueError))


def test_what_could_not_be_mapped_is_listed_with_guesses(tmp_path: Path) -> None:
    names = dict(CMU_NAMES, left_knee="LeftLegg", right_wrist="Paw")
    path = write_puppet(tmp_path / "odd.bvh", waving(), convention=Convention(names=names))
    with pytest.raises(MotionFileError) as caught:
        map_joints(read_bvh(path))
    message = str(caught.value)
    assert re.search(r"left_knee: looked for LeftLeg, .*perhaps 'LeftLegg'", message)
    assert re.search(r"right_wrist: looked for RightHand", message)
    assert "left_hip: looked for" not in message
    assert "The file's joints are: Hips, LeftUpLeg, LeftLegg, LeftFoot" in message
    assert "--mapping FILE" in message
    assert '[joints]\nleft_knee = "LeftLegg"\nright_wrist = "' in message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[joints\n", "is no TOML"),
        ("", r"no table \[joints\]"),
        ("[bones]\nleft_hip = 'a'\n", "has the entries bones"),
        ("[joints]\nleft_hipp = 'a'\n", "unknown role 'left_hipp'; did you mean left_hip"),
        ("[joints]\nleft_hip = 3\n", "role left_hip is 3; expected a joint name"),
        ("[joints]\nleft_hip = [3]\n", r"role left_hip is \[3\]; expected a joint name"),
        ("joints = 3\n", r"no table \[joints\]"),
        ("[joints]\nleft_hip = " + "[" * 5000 + "]" * 5000, "is no TOML"),
        ("[joints]\nleft_hip = " + "1" * 5000, "is no TOML"),
        ("# " + "x" * 1_000_000, "expected a joint mapping file of at most"),
    ],
)
def test_a_broken_mapping_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text)
    with pytest.raises(MotionFileError, match=message) as caught:
        read_mapping(path)
    assert "map.toml" in str(caught.value)
    with pytest.raises(MotionFileError, match="cannot be read"):
        read_mapping(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left_hip = 'Nobody'", "left_hip: looked for Nobody"),
        ("left_hip = 'RightUpLeg'", "left_hip and right_hip are both mapped to .*'RightUpLeg'"),
        (
            "left_knee = 'Hips'",
            "left_knee is mapped to 'Hips', which does not hang from 'LeftUpLeg'",
        ),
        ("left_wrist = 'LeftHand_end'\nleft_elbow = 'LeftHand'", "two ends of left_forearm are at"),
    ],
)
def test_a_mapping_that_does_not_fit(tmp_path: Path, text: str, message: str) -> None:
    bvh = write_puppet(tmp_path / "a.bvh", waving())
    path = tmp_path / "map.toml"
    path.write_text("[joints]\n" + text)
    with pytest.raises(MotionFileError, match=message):
        load_motion(bvh, mapping=path)


def skeleton(joints: int) -> str:
    """Return a BVH file of a hip with so many joints on it, each with an end."""
    limb = """JOINT {0}
{{
OFFSET 1 0 0
CHANNELS 3 Zrotation Yrotation Xrotation
End Site
{{
OFFSET 1 0 0
}}
}}
"""
    head = "HIERARCHY\nROOT hips\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n"
    row = " ".join(["0"] * (3 * joints + 1)) + "\n"
    limbs = "".join(limb.format(f"joint{i}") for i in range(joints))
    return f"{head}{limbs}}}\nMOTION\nFrames: 2\nFrame Time: 0.01\n{row}{row}"


def test_reading_takes_time_in_proportion_to_the_joints(tmp_path: Path) -> None:
    best = {500: np.inf, 5000: np.inf}
    paths = {joints: tmp_path / f"{joints}.bvh" for joints in best}
    for joints, path in paths.items():
        path.write_text(skeleton(joints), encoding="ascii")
    for _ in range(20):  # others on this machine can only lengthen a measurement
        for joints, path in paths.items():
            began = time.process_time()
            assert len(read_bvh(path).joints) == 2 * joints + 1
            best[joints] = min(best[joints], time.process_time() - began)
        # Ten times the joints: a hundred times the time, were it quadratic.
        if best[5000] < 20.0 * best[500]:
            return
    pytest.fail(f"500 and 5000 joints take {best} s")


def test_a_skeleton_of_many_joints_is_refused_in_few_words(tmp_path: Path) -> None:
    path = tmp_path / "many.bvh"
    path.write_text(skeleton(5000), encoding="ascii")
    with pytest.raises(MotionFileError, match="could not be found by their names") as caught:
        map_joints(read_bvh(path))
    assert "and 4801 more." in str(caught.value)
    assert len(str(caught.value)) < 10_000


def test_captures_without_direction(tmp_path: Path) -> None:
    q = waving()
    capture = read_bvh(write_puppet(tmp_path / "a.bvh", q))
    with pytest.raises(ArgumentError, match="heading: got 'north', expected 'facing'"):
        retarget(capture, heading="north")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="expected two different axes"):
        retarget(capture, up="y", forward="-y")
    with pytest.raises(ArgumentError, match="axis: got 'w'"):
        retarget(capture, up="w")  # type: ignore[arg-type]
    q[:, :2] = 0.0
    with pytest.raises(MotionFileError, match="hardly leaves the spot"):
        retarget(read_bvh(write_puppet(tmp_path / "b.bvh", q)), heading="travel")
    with pytest.raises(ArgumentError, match="trim: got 2 to 1 s, expected a part of the capture's"):
        load_motion(tmp_path / "a.bvh", trim=(2.0, 1.0))
    with pytest.raises(ArgumentError, match="speed: got 0"):
        load_motion(tmp_path / "a.bvh", speed=0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((("a", "a"), [0, 1], np.zeros((2, 2))), "names: a given twice"),
        ((("a",), [0], np.zeros((1, 1))), r"t: got shape \(1,\)"),
        ((("a",), [0, 1], np.zeros((2, 2))), r"q: got shape \(2, 2\), expected \(2, 1\)"),
        ((("a",), [0, 0], np.zeros((2, 1))), "strictly increasing"),
        ((("a",), [0, np.nan], np.zeros((2, 1))), "strictly increasing"),
        ((("a",), [0, 1], np.array([[0.0], [np.nan]])), "q: a is nan at t = 1 s"),
    ],
)
def test_a_motion_of_bad_arrays(arguments: tuple, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Motion(*arguments)


def test_bad_arguments_of_a_motion() -> None:
    motion = walk_in_place(1.0)
    for value in (0.0, -0.01, np.nan, np.inf):
        with pytest.raises(ArgumentError, match="dt: got"):
            motion.resample(value)
        with pytest.raises(ArgumentError, match="cutoff: got"):
            motion.low_pass(value)
    with pytest.raises(ArgumentError, match="longer than the motion"):
        motion.resample(3.0)
    with pytest.raises(ArgumentError, match=r"cutoff: got 6 Hz for samples at 1e\+11 Hz, expected 1e-06 of that"):
        dataclasses.replace(motion, t=motion.t * 1e-9).low_pass(6.0)
    with pytest.raises(ArgumentError, match=r"pose: got shape \(3,\), expected 22"):
        motion.lead_in(np.zeros(3), 1.0)
    with pytest.raises(ArgumentError, match="no variable 'knee'"):
        motion.lead_in({"knee": 1.0}, 1.0)
    with pytest.raises(ArgumentError, match="seconds: got -1"):
        motion.ease_in(-1.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 0.0}, "duration: got 0.0"),
        ({"dt": -0.01}, "dt: got -0.01"),
        ({"dt": float("nan")}, "dt: got nan"),
        ({"duration": 0.001}, "dt: got 0.01 s, expected less"),
        ({"stride": 2.0}, "stride: got 2.0"),
        ({"rest": {"lhip": 1.0}}, "rest: unknown variables lhip"),
    ],
)
def test_bad_arguments_of_the_walk(options: dict, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        walk_in_place(**options)


def test_bad_options_of_a_file(tmp_path: Path) -> None:
    path = write_puppet(tmp_path / "a.bvh", waving())
    with pytest.raises(ArgumentError, match="start: got 'jump', expected 'rest' or 'moving'"):
        load_motion(path, start="jump")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="dt: got 0"):
        load_motion(path, dt=0)
    assert load_motion(path, dt=0.01, cutoff=None).motion.names == VARIABLES
