"""Samples that a capture lacks: found, filled, and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leastaction.io import Capture, Gap, read_bvh
from leastaction.io.motion import fill_gaps
from leastaction_marionette import load_motion
from marionette.puppet_bvh import waving, write_puppet


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    return write_puppet(tmp_path / "whole.bvh", waving())


def changed(path: Path, change: object) -> Path:
    """Write the file again with another table of its motion."""
    head, _, table = path.read_text().partition("Frame Time:")
    first, *lines = table.splitlines()
    rows = [line.split() for line in lines if line.strip()]
    change(rows)  # type: ignore[operator]
    other = path.with_name("changed.bvh")
    other.write_text("\n".join([f"{head}Frame Time:{first}", *(" ".join(row) for row in rows)]) + "\n")
    return other


def columns(capture: Capture, name: str) -> list[int]:
    before = sum(len(joint.channels) for joint in capture.joints[: capture.index(name)])
    return list(range(before, before + len(capture.joints[capture.index(name)].channels)))


def largest(a: Capture, b: Capture) -> float:
    return float(np.abs(a.values - b.values).max())


def test_a_whole_capture_stays_what_it_is(whole: Path) -> None:
    capture = read_bvh(whole)
    assert capture.gaps == ()
    assert capture.describe_gaps() == ""
    assert fill_gaps(capture) is capture
    assert "filled" not in load_motion(whole).summary()


@pytest.mark.parametrize(
    "word",
    ["nan", "NaN", "-nan(ind)", "nan(0x8000)", "NaNQ", "-1.#IND00", "1.#QNAN", "1,#SNAN0", "-1.#IO", "1.#R", "1.#J"],
)
def test_words_that_are_no_numbers(whole: Path, word: str) -> None:
    true = read_bvh(whole)
    arm = columns(true, "LeftArm")

    def lose(rows: list[list[str]]) -> None:
        for k in range(20, 24):
            rows[k][arm[1]] = word

    found = read_bvh(changed(whole, lose))
    assert found.gaps == (Gap("LeftArm", 20, 23, "not numbers"),)
    assert largest(found, true) < 1.0
    others = [i for i in range(true.values.shape[1]) if i not in arm]
    np.testing.assert_array_equal(found.values[:, others], true.values[:, others])
    assert np.isnan(read_bvh(changed(whole, lose), fill=False).values).sum() == 4
    summary = load_motion(changed(whole, lose)).summary()
    assert "filled 4 missing samples (not numbers) of LeftArm; the longest gap is" in summary


def test_at_the_ends_what_is_known_is_held(whole: Path) -> None:
    true = read_bvh(whole)
    arm = columns(true, "LeftArm")

    def lose(rows: list[list[str]]) -> None:
        for k in (0, 1, -1):
            rows[k][arm[0]] = "nan"

    found = read_bvh(changed(whole, lose))
    assert [(gap.first, gap.last) for gap in found.gaps] == [(0, 1), (59, 59)]
    np.testing.assert_allclose(found.values[:2, arm], true.values[[2, 2]][:, arm], atol=1e-9)
    np.testing.assert_allclose(found.values[-1, arm], true.values[-2, arm], atol=1e-9)


def test_frames_and_joints_of_zeros(whole: Path) -> None:
    true = read_bvh(whole)
    still = np.abs(true.values[:, columns(true, "LeftArm")]).max(axis=1)
    k = int(np.argmax(still[5:50])) + 5

    def lose(rows: list[list[str]]) -> None:
        rows[30] = ["0.0"] * len(rows[30])
        for i in columns(true, "LeftArm"):
            rows[k][i] = "0"

    assert k not in (29, 30, 31)
    found = read_bvh(changed(whole, lose))
    assert set(found.gaps) == {Gap("", 30, 30, "zeros"), Gap("LeftArm", k, k, "zeros")}
    assert largest(found, true) < 1.0
    # A first frame of zeros is a pose to calibrate by.
    assert read_bvh(changed(whole, lambda rows: rows.insert(0, rows.pop(0) and ["0"] * len(rows[0])))).gaps == ()


def test_frames_written_again(whole: Path) -> None:
    true = read_bvh(whole)

    def lose(rows: list[list[str]]) -> None:
        for k in range(25, 29):
            rows[k] = rows[24]

    found = read_bvh(changed(whole, lose))
    assert found.gaps == (Gap("", 25, 28, "repeated"),)
    assert largest(found, true) < 2.0
    assert "of the whole body" in found.describe_gaps()


def test_a_pose_that_is_held_is_no_gap(whole: Path) -> None:
    rest, step = 20, 12

    def hold(rows: list[list[str]]) -> None:
        # It comes to rest, stays, and goes on, all smoothly.
        table = np.array(rows, dtype=np.float64)
        place = np.concatenate([np.linspace(0.0, 1.0, step) ** 2 * 3.0, np.full(rest, 3.0)])
        place = np.concatenate(
            [place[:step][::-1] * -1.0 + 3.0, np.full(rest, 3.0), 3.0 + place[:step], [7.0, 8.0, 9.0]]
        )
        at = np.interp(np.arange(len(rows)), np.arange(len(place)), place)
        low = np.minimum(at.astype(int), len(rows) - 2)
        table = table[low] + (at - low)[:, None] * (table[low + 1] - table[low])
        rows[:] = [[repr(float(value)) for value in row] for row in table]

    assert read_bvh(changed(whole, hold)).gaps == ()


def test_angles_are_filled_the_short_way_round() -> None:
    whole_turn = np.array([[170.0, 0.0, 0.0], [np.nan] * 3, [-170.0, 0.0, 0.0]])
    from leastaction.io import Joint

    joints = (Joint("Hips", -1, (0.0, 0.0, 0.0), ("Zrotation", "Yrotation", "Xrotation"), 1),)
    found = fill_gaps(Capture("made up", joints, 0.01, whole_turn))
    np.testing.assert_allclose(found.values[1], [180.0, 0.0, 0.0], atol=1e-9)
    # An angle that is counted on goes on.
    counted = fill_gaps(
        Capture("made up", joints, 0.01, np.array([[355.0, 0.0, 0.0], [np.nan] * 3, [365.0, 0.0, 0.0]]))
    )
    np.testing.assert_allclose(counted.values[1], [360.0, 0.0, 0.0], atol=1e-9)
    one = (Joint("Hips", -1, (0.0, 0.0, 0.0), ("Zrotation",), 1),)
    assert fill_gaps(Capture("made up", one, 0.01, whole_turn[:, :1])).values[1, 0] == pytest.approx(180.0)


@pytest.mark.parametrize("leap", [120.0, -170.0, 400.0])
def test_a_joint_that_leaps_away_and_back_has_no_sample_there(whole: Path, leap: float) -> None:
    true = read_bvh(whole)
    arm = columns(true, "LeftArm")

    def lose(rows: list[list[str]]) -> None:
        for k in (20, 21):
            rows[k][arm[1]] = repr(float(rows[k][arm[1]]) + leap)

    assert fill_gaps(read_bvh(changed(whole, lose), fill=False)).gaps == (Gap("LeftArm", 20, 21, "leaps"),)
    assert largest(read_bvh(changed(whole, lose)), true) < 2.0


def test_a_root_that_leaps_away_and_back_has_no_sample_there(whole: Path) -> None:
    true = read_bvh(whole)

    def lose(rows: list[list[str]]) -> None:
        rows[30][0] = repr(float(rows[30][0]) + 1.0)

    assert read_bvh(changed(whole, lose)).gaps == (Gap("Hips", 30, 30, "leaps"),)
    assert largest(read_bvh(changed(whole, lose)), true) < 2.0
    # One that goes there and stays is somewhere else.
    away = changed(whole, lambda rows: [row.__setitem__(0, repr(float(row[0]) + 1.0)) for row in rows[30:]])
    assert read_bvh(away).gaps == ()


def test_channels_that_leap_by_whole_turns_have_not_moved(whole: Path) -> None:
    true, rng = read_bvh(whole), np.random.default_rng(0)

    def turn(rows: list[list[str]]) -> None:
        for row in rows:
            for i in columns(true, "LeftArm") + columns(true, "LeftHand"):
                row[i] = repr(float(row[i]) + 360.0 * float(rng.integers(-1, 2)))

    assert read_bvh(changed(whole, turn)).gaps == ()


def test_zeros_on_the_way_are_samples(whole: Path) -> None:
    """A joint that turns through zero is there for a frame; one that leaps once does not lose its rest."""
    true = read_bvh(whole)
    arm, hand = columns(true, "LeftArm"), columns(true, "LeftHand")

    def through(rows: list[list[str]]) -> None:
        for k, row in enumerate(rows):
            for i in arm:
                row[i] = repr(10.0 * (k - 30)) if i == arm[0] else "0"
            for i in hand:
                row[i] = "120" if k == 20 and i == hand[1] else "0"

    assert read_bvh(changed(whole, through)).gaps == (Gap("LeftHand", 20, 20, "leaps"),)
