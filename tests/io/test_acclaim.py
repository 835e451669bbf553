"""Acclaim's files, ASF and AMC: read as the same motion in BVH is, and refused with a line where they are broken."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from leastaction.apps.cli import main
from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io import forward_kinematics, read_amc, read_bvh, read_capture
from leastaction_marionette import load_motion, retarget
from marionette import puppet_asf, puppet_bvh
from marionette.motions import captured
from marionette.puppet_bvh import waving

Change = Callable[[list[str]], list[str]]


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    return puppet_asf.write_puppet(tmp_path / "walk.amc", waving(3))


@pytest.mark.parametrize("order", ["XYZ", "ZXY", "YZX"])
@pytest.mark.parametrize("radians", [False, True])
def test_a_puppet_is_the_same_in_both_formats(tmp_path: Path, order: str, radians: bool) -> None:
    q = waving()
    amc = read_amc(puppet_asf.write_puppet(tmp_path / "a.amc", q, order=order, radians=radians), frame_rate=50.0)
    bvh = read_bvh(puppet_bvh.write_puppet(tmp_path / "a.bvh", q, frame_time=0.02))
    assert amc.n_frames == len(q)
    one, other = retarget(amc), retarget(bvh)
    np.testing.assert_allclose(one.motion.t, other.motion.t, atol=1e-12)
    np.testing.assert_allclose(one.motion.q, other.motion.q, atol=1e-9)
    assert one.joints["left_hip"] == "lfemur"
    assert one.scale == pytest.approx(0.0254)
    # The tip of a foot is an end site: 10 cm ahead of the ankle, in inches.
    places, _ = forward_kinematics(amc)
    tip = places[:, amc.index("lfoot_end")] - places[:, amc.index("lfoot")]
    np.testing.assert_allclose(np.linalg.norm(tip, axis=1), 0.1 / 0.0254)


def test_the_frame_rate_is_given_or_said_or_that_of_the_database(tmp_path: Path) -> None:
    silent = puppet_asf.write_puppet(tmp_path / "a.amc", waving(3))
    assert read_amc(silent).frame_time == pytest.approx(1.0 / 120.0)
    told = puppet_asf.write_puppet(tmp_path / "b.amc", waving(3), rate=60.0)
    assert read_amc(told).frame_time == pytest.approx(1.0 / 60.0)
    assert read_amc(told, frame_rate=30.0).frame_time == pytest.approx(1.0 / 30.0)
    with pytest.raises(ArgumentError, match="frame_rate"):
        read_amc(told, frame_rate=0.0)


def test_the_skeleton_is_found_beside_the_motion(tmp_path: Path) -> None:
    asf = puppet_asf.write_puppet(tmp_path / "02.amc", waving(3)).with_suffix(".asf")
    motion = (tmp_path / "02.amc").rename(tmp_path / "02_01_walk.AMC")
    assert read_capture(motion).n_frames == 3
    (tmp_path / "0.asf").write_text("not this one")
    assert read_capture(motion).n_frames == 3
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    asf = asf.rename(elsewhere / "skeleton.asf")
    (tmp_path / "0.asf").unlink()
    with pytest.raises(MotionFileError, match=r"no skeleton beside it: there is none.*--skeleton FILE"):
        read_capture(motion)
    assert read_capture(motion, skeleton=asf).n_frames == 3
    # With a single one in its folder no name is needed, with two it is.
    motion = motion.rename(elsewhere / "motion.amc")
    assert read_capture(motion).n_frames == 3
    (elsewhere / "other.asf").write_text("")
    with pytest.raises(MotionFileError, match="there are 2, none of such a name"):
        read_capture(motion)
    with pytest.raises(MotionFileError, match="is a skeleton, expected a motion"):
        read_capture(asf)
    with pytest.raises(ArgumentError, match=r"skeleton: got .* which holds its own"):
        read_capture(puppet_bvh.write_puppet(tmp_path / "a.bvh", waving()), skeleton=asf)


@pytest.mark.parametrize("word", ["nan", "-1.#IND00", "1.#QNAN", "+1.#SNAN", "-1.#J"])
def test_values_of_bones_with_one_angle_are_missing(tmp_path: Path, word: str) -> None:
    """What stands behind # in a value is no comment, so that it is not read as the digit before."""
    path = puppet_asf.write_puppet(tmp_path / "a.amc", waving(20))
    lines = path.read_text().splitlines()
    k = [i for i, line in enumerate(lines) if line.startswith("rradius ")][5]
    text = lines[k]
    for after in (" # the rest is a comment: 1.#IND", "# so is this"):
        path.write_text("\n".join([*lines[:k], text + after, *lines[k + 1 :]]))
        assert not np.isnan(read_amc(path, fill=False).values).any()
    path.write_text("\n".join([*lines[:k], f"rradius {word} # lost", *lines[k + 1 :]]))
    values = read_amc(path, fill=False).values
    assert np.isnan(values).sum() == 1
    assert "missing samples (not numbers) of rradius" in read_amc(path).describe_gaps()


def test_samples_that_are_missing_are_filled(tmp_path: Path) -> None:
    path = puppet_asf.write_puppet(tmp_path / "a.amc", waving(20))
    lines = path.read_text().splitlines()
    at = [i for i, line in enumerate(lines) if line.startswith("lfemur ")]
    for i in at[5:8]:
        lines[i] = "lfemur NaN nan -nan(ind)"
    whole = read_amc(path)
    path.write_text("\n".join(lines))
    filled = read_amc(path)
    assert "filled 3 missing samples (not numbers) of lfemur" in filled.describe_gaps()
    assert np.isnan(read_amc(path, fill=False).values).sum() == 9
    assert np.abs(filled.values - whole.values).max() < 10.0


def replaced(old: str, *new: str) -> Change:
    """Replace the first line whose words begin with `old` by `new`."""

    def change(lines: list[str]) -> list[str]:
        index = next(i for i, line in enumerate(lines) if " ".join(line.split()).startswith(old))
        return [*lines[:index], *new, *lines[index + 1 :]]

    return change


BROKEN_MOTION: dict[str, tuple[Change, str]] = {
    "empty": (lambda _: [], "line 1: the file ends after 0 frames"),
    "prose": (lambda _: ["Dear reader,"], "line 1: 'Dear reader,' before the first frame"),
    "one frame": (lambda x: x[: x.index("2")], "the file ends after 1 frames"),
    "a frame left out": (replaced("2"), "again|expected frame"),
    "frames out of order": (replaced("2", "7"), "frame '7'; expected frame 2"),
    "a bone left out": (replaced("rfemur"), "frame 1 ends without rfemur"),
    "a bone twice": (lambda x: [*x, x[-1]], "bone 'rradius' again"),
    "a bone of another skeleton": (replaced("lfemur", "tail 1 2 3"), "'tail' is no bone of the skeleton"),
    "a bone that does not turn": (replaced("lfemur", "lfoot 1"), "values of bone 'lfoot'; expected none"),
    "a value too few": (replaced("lfemur", "lfemur 1 2"), "'lfemur' has 2 values; expected 3 .rx ry rz."),
    "a word": (replaced("lfemur", "lfemur 1 two 3"), "a value of bone 'lfemur' is 'two'"),
    "infinite": (replaced("lfemur", "lfemur 1 inf 3"), "a value of bone 'lfemur' is 'inf'"),
    "infinite to Microsoft": (replaced("lfemur", "lfemur 1 1.#INF 3"), "a value of bone 'lfemur' is '1.#INF'"),
    "a hash in a value": (replaced("lfemur", "lfemur 1 12.#5 3"), "a value of bone 'lfemur' is '12.#5'"),
    "unknown flag": (replaced(":DEGREES", ":GRADIANS"), "':GRADIANS'; expected one of :FULLY-SPECIFIED"),
    "flag among frames": (replaced("2", ":DEGREES"), "before the first frame"),
    "no rate": (replaced(":DEGREES", ":SAMPLES-PER-SECOND -3"), "a number of frames a second"),
    "a rate beyond all numbers": (replaced(":DEGREES", ":SAMPLES-PER-SECOND 1e308"), "a number of frames a second"),
    "cut": (lambda x: x[:-2], "frame 3 ends without rhumerus, rradius .truncated"),
}


@pytest.mark.parametrize("case", BROKEN_MOTION)
def test_a_broken_motion_is_named_with_line_and_expectation(walk: Path, case: str) -> None:
    change, message = BROKEN_MOTION[case]
    walk.write_text("\n".join(change(walk.read_text().splitlines())))
    with pytest.raises(MotionFileError, match=message) as caught:
        read_amc(walk)
    assert re.search(r"walk\.amc, line \d+: ", str(caught.value))
    assert "expected" in str(caught.value)


BROKEN_SKELETON: dict[str, tuple[Change, str]] = {
    "empty": (lambda _: [], "truncated.*expected a section :root"),
    "prose": (lambda _: ["Dear reader,"], "begins with 'Dear reader,'.*this is no ASF skeleton"),
    "unknown section": (replaced(":units", ":unites"), "':unites'; expected a section: :version"),
    "section twice": (replaced(":units", ":version 1"), "a second section :version .the first is at line"),
    "no hierarchy": (lambda x: x[: x.index(":hierarchy")], "expected a section :hierarchy"),
    "no begin": (replaced("begin"), "expected begin"),
    "no end": (lambda x: x[:-1], "truncated.*expected end of what begins at line"),
    "bone not closed": (lambda x: x[: x.index(":hierarchy") - 1] + x[x.index(":hierarchy") :], "expected end of what"),
    "unknown word": (replaced("length 3", "width 3"), "'width 3'; expected one of id, name"),
    "no direction": (replaced("direction"), "without direction"),
    "two numbers": (replaced("direction", "direction 1 2"), "three finite numbers"),
    "negative": (replaced("length 3", "length -3"), "length -3; expected zero or more"),
    "not a number": (replaced("length 3", "length nan"), "one finite number"),
    "axis without order": (replaced("axis", "axis 0 0 0"), "an order of the axes such as XYZ"),
    "axis twice in order": (replaced("axis", "axis XYY"), "an order of the axes such as XYZ"),
    "dof of lengths": (replaced("dof", "dof rx l"), "each of rx, ry, rz at most once"),
    "order twice": (replaced("order", "order TX TX"), "at most once"),
    "no order": (replaced("order"), "a root without order"),
    "a name twice": (replaced("name ltibia", "name lfemur"), "a second bone called 'lfemur'"),
    "no name": (replaced("name ltibia"), "bone '' without name"),
    "a key twice": (replaced("name ltibia", "name a", "name b"), "a second name of bone 'a'"),
    "unknown child": (replaced("lfemur ltibia", "lfemur tail"), "'tail' is no bone"),
    "a child of two": (replaced("lfemur ltibia", "lfemur lfoot"), "bone 'lfoot' hangs from 'ltibia' too|hangs from"),
    "not in the tree": (replaced("ltibia lfoot"), "bone 'lfoot' does not hang from the root"),
    "a ring": (replaced("root", "ltibia lhipjoint", "root rhipjoint"), "does not hang from the root|hangs from"),
    "unit of angles": (replaced("angle", "angle turns"), "angle and one of deg, rad"),
}


@pytest.mark.parametrize("case", BROKEN_SKELETON)
def test_a_broken_skeleton_is_named_with_line_and_expectation(walk: Path, case: str) -> None:
    change, message = BROKEN_SKELETON[case]
    path = walk.with_suffix(".asf")
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(MotionFileError, match=message) as caught:
        read_amc(walk)
    assert re.search(r"walk\.asf, line \d+: ", str(caught.value))


def test_files_cut_anywhere_are_refused(walk: Path) -> None:
    for path in (walk, walk.with_suffix(".asf")):
        data = path.read_bytes()
        for keep in range(0, len(data) - 24, 41):
            path.write_bytes(data[:keep])
            with pytest.raises(MotionFileError, match=r"walk\.a(mc|sf), line"):
                read_amc(walk)
        path.write_bytes(data)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=some.data())
def test_damaged_files_are_read_or_refused(walk: Path, data: some.DataObject) -> None:
    whole = {path: path.read_bytes() for path in (walk, walk.with_suffix(".asf"))}
    path = data.draw(some.sampled_from(sorted(whole)))
    lines = whole[path].decode().splitlines()
    at = data.draw(some.integers(0, len(lines) - 1))
    words = lines[at].split() or [""]
    i = data.draw(some.integers(0, len(words) - 1))
    words[i] = data.draw(
        some.sampled_from(["", "nan", "1e999", "-", "begin", "end", ":root", "root", "7", "(", "dof", "1_0", "XYZ"])
        | some.text(max_size=8)
    )
    path.write_text("\n".join([*lines[:at], " ".join(words), *lines[at + 1 :]]), encoding="utf-8")
    try:
        capture = read_amc(walk, fill=False)
    except MotionFileError as error:
        said = str(error)
    else:
        said = str(path.parent)
        assert capture.n_frames >= 2
        forward_kinematics(capture)
    finally:
        path.write_bytes(whole[path])
    assert said.startswith(str(path.parent))


def test_what_is_no_text_or_no_file(walk: Path, tmp_path: Path) -> None:
    walk.with_suffix(".asf").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(MotionFileError, match=r"walk\.asf: holds bytes that are no text; expected an ASF"):
        read_amc(walk)
    with pytest.raises(MotionFileError, match=r"none\.amc: cannot be read"):
        read_amc(tmp_path / "none.amc")
    with pytest.raises(MotionFileError, match=r"none\.asf: cannot be read"):
        read_amc(walk, skeleton=tmp_path / "none.asf")


def test_reading_takes_time_in_proportion_to_bones_and_frames(tmp_path: Path) -> None:
    def write(name: str, bones: int, frames: int) -> Path:
        names = [f"b{i}" for i in range(bones)]
        block = "begin\nname {}\ndirection 0 1 0\nlength 1\naxis 0 0 20 XYZ\ndof rx\nend"
        chain = "\n".join(f"{a} {b}" for a, b in zip(["root", *names], names, strict=False))
        (tmp_path / f"{name}.asf").write_text(
            ":root\norder TX TY TZ RX RY RZ\n:bonedata\n"
            + "\n".join(block.format(each) for each in names)
            + f"\n:hierarchy\nbegin\n{chain}\nend\n"
        )
        row = "root 0 0 0 0 0 0\n" + "\n".join(f"{each} 1" for each in names)
        path = tmp_path / f"{name}.amc"
        path.write_text(":DEGREES\n" + "\n".join(f"{k}\n{row}" for k in range(1, frames + 1)) + "\n")
        return path

    for few, many in (((20, 20), (200, 20)), ((20, 20), (20, 200))):
        paths = write("few", *few), write("many", *many)
        best = [np.inf, np.inf]
        for _ in range(20):  # others on this machine can only lengthen a measurement
            for i, path in enumerate(paths):
                began = time.process_time()
                read_amc(path, fill=False)
                best[i] = min(best[i], time.process_time() - began)
            # Ten times as much: a hundred times the time, were it quadratic.
            if best[1] < 20.0 * best[0]:
                break
        else:
            pytest.fail(f"{few} and {many} bones and frames take {best} s")


def test_an_amc_file_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = puppet_asf.write_puppet(tmp_path / "a.amc", waving(40))
    words = ["optimize", "marionette", "--out", str(tmp_path / "out"), "--no-animation", "--no-plots", "--dt", "0.02"]
    words += ["--trim", "0", "0.3", "--max-iterations", "1"]
    asf = path.with_suffix(".asf").rename(tmp_path / "skeleton.asf")
    with pytest.raises(SystemExit) as ended:
        main([*words, "--motion", str(path), "--skeleton", str(asf), "--frame-rate", "50"])
    assert ended.value.code == 0
    assert "40 frames, 0.78 s" in " ".join(capsys.readouterr().out.split())
    with pytest.raises(SystemExit):
        main([*words, "--skeleton", str(asf)])
    assert "--skeleton belongs to a motion capture file" in capsys.readouterr().err


def test_the_walk_of_the_database_in_both_formats() -> None:
    """The BVH file is a conversion: its person is 6.31 % larger, and was fitted to the markers anew."""
    amc, bvh = captured("cmu_02_01_walk.amc"), captured("cmu_02_01_walk.bvh")
    one, other = read_amc(amc), read_bvh(bvh)
    assert one.n_frames == other.n_frames == 343
    assert one.frame_time == pytest.approx(other.frame_time, rel=1e-4)
    (places, _), (others, _) = forward_kinematics(one), forward_kinematics(other)
    centimetres = 2.54 / 0.45

    def apart(bone: str, joint: str) -> np.ndarray:
        far = places[:, one.index(bone)] - others[:, other.index(joint)] / 1.0631
        return np.asarray(centimetres * np.linalg.norm(far, axis=1))

    assert apart("root", "Hips").max() < 0.01
    for side, name in (("l", "Left"), ("r", "Right")):
        for bone, joint in (("femur", "UpLeg"), ("tibia", "Leg"), ("foot", "Foot")):
            assert apart(side + bone, name + joint).max() < 5.5
        # Its collar bones begin at another vertebra: arms are 13 cm off, at all times.
        for bone, joint in (("humerus", "Arm"), ("radius", "ForeArm"), ("wrist", "Hand")):
            assert np.ptp(apart(side + bone, name + joint)) < 1.0
    # Bones point the same way, but for what the fit did to legs.
    from_amc, from_bvh = retarget(one), retarget(other)
    for bone, direction in from_amc.directions.items():
        cosine = np.sum(direction * from_bvh.directions[bone], axis=1)
        assert np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < (1.5 if "forearm" in bone else 8.0)
    assert (from_amc.up, from_amc.forward) == ("y", "z")
    # The conversion rounds the frame's time down, and with it the number of steps.
    durations = [load_motion(each, dt=0.02, markers=True).motion.duration for each in (amc, bvh)]
    assert durations[0] == pytest.approx(durations[1], abs=0.021)
