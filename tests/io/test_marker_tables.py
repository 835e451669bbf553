"""Markers from text: tables with gaps, TRC files, and frames that follow them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from leastaction import Gravity, JointForce, Mechanism, follow, read_motion, ry, tz
from leastaction.apps.cli.mechanism.conversion import converted
from leastaction.apps.cli.mechanism.description import text_of
from leastaction.errors import ArgumentError, MotionFileError
from leastaction.io import read_markers

TABLE = "t [s],hand.x [mm],hand.y [mm],hand.z [mm]\n1,0,0,-400\n1.5,20,0,-399.5\n1.75,,,\n2,40,0,-398\n"
TRC = "\n".join([
    "PathFileType\t4\t(X/Y/Z)\tx.trc",
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
    "50\t50\t4\t3\tmm\t50\t1\t4",
    "Frame#\tTime\tHAND\t\t\tELB\t\t\tELB\t\t",
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3",
    "",
    "1\t0.50\t0\t0\t-400\t1\t2\t3\t4\t5\t6\t",
    "2\t0.52\t5\t0\t-399\t1\t2\t3\tNaN\tNaN\tNaN",
    "3\t0.54\t\t\t\t1\t2\t3",
    "4\t0.56",
    "",
])  # fmt: skip


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_of_places_is_markers_with_gaps_that_a_frame_follows(tmp_path: Path) -> None:
    markers = read_markers(written(tmp_path / "hand.csv", TABLE))
    assert markers.names == ("hand",)
    np.testing.assert_allclose(markers.t, [0.0, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(
        markers["hand"][[0, 1, 3]], [[0.0, 0.0, -0.4], [0.02, 0.0, -0.3995], [0.04, 0.0, -0.398]]
    )
    assert np.isnan(markers["hand"][2]).all()
    assert str(markers) == "1 marker at 4 times over 1 s: hand"
    arm = Mechanism([ry("elbow"), [tz(-0.4, name="hand", mass=1.0)]], [Gravity(), JointForce("elbow", "motor")])
    assert follow(arm, markers).errors["hand"] < 1e-4
    whole = read_motion(written(tmp_path / "whole.csv", TABLE.replace("1.75,,,\n", "")))  # columns of one place
    assert str(whole) == "3 variables at 3 times over 1 s: hand.x, hand.y, hand.z"
    assert follow(arm, whole).errors["hand"] < 1e-4


JOINTS = "t [s],elbow [deg],lift\n0,,0\n1,10,1\n2,,4\n3,30,\n4,NaN,16\n5,50,25\n"


def test_gaps_of_joints_are_filled_where_that_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path / "joints.csv", JOINTS)
    with pytest.raises(MotionFileError, match=r"elbow is nan at t = 0 s.*gaps='linear' or gaps='spline'"):
        read_motion(path)
    lines, spline = read_motion(path, gaps="linear"), read_motion(path, gaps="spline")
    for each in (lines, spline):
        np.testing.assert_allclose(np.rad2deg(each["elbow"]), [10.0, 10.0, 20.0, 30.0, 40.0, 50.0], atol=1e-12)
    assert lines["lift"][3] == 10.0
    assert spline["lift"][3] == pytest.approx(9.0)  # through a parabola
    with pytest.raises(ArgumentError, match="gaps: got 'cubic', expected 'linear' or 'spline'"):
        read_motion(path, gaps="cubic")
    with pytest.raises(MotionFileError, match="elbow has no value that is known"):
        read_motion(written(tmp_path / "none.csv", "t [s],elbow\n0,\n1,nan\n"), gaps="linear")


@pytest.mark.parametrize("gaps", ["linear", "spline"])
def test_gaps_of_rotations_are_filled_as_rotations(gaps: str, tmp_path: Path) -> None:
    """A turn about one axis at a steady speed, whose quaternions change their sign as sensors' do."""
    t = np.linspace(0.0, 1.0, 11)
    rotation = np.stack([np.cos(t), np.sin(t), 0.0 * t, 0.0 * t], axis=1)
    rotation[4:] *= -1.0
    shown = rotation.copy()
    shown[[0, 5, 8]] = np.nan
    shown[3, 2] = np.nan  # one number is lost
    text = "t,hip.qw,hip.qx,hip.qy,hip.qz\n" + "".join(
        ",".join("" if np.isnan(each) else repr(float(each)) for each in (when, *row)) + "\n"
        for when, row in zip(t, shown, strict=True)
    )
    found = read_motion(written(tmp_path / "turn.csv", text), gaps=gaps).q
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(found[1:], rotation[1:], atol=1e-4)
    np.testing.assert_array_equal(found[0], rotation[1])


def test_a_trc_has_names_units_and_what_was_not_seen(tmp_path: Path) -> None:
    markers = read_markers(written(tmp_path / "x.trc", TRC))
    assert markers.names == ("HAND", "ELB", "ELB#2")
    np.testing.assert_allclose(markers.t, [0.0, 0.02, 0.04, 0.06], atol=1e-12)
    np.testing.assert_allclose(markers["HAND"][1], [0.005, 0.0, -0.399])
    assert [markers.seen(name) for name in markers.names] == [0.5, 0.75, 0.25]
    assert read_markers(tmp_path / "x.trc", unit="m")["HAND"][1, 0] == 5.0


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.trc", TRC.replace("mm", "inch"), "its places are in 'inch', expected one of mm, cm, m"),
        ("a.trc", TRC.replace("-399", "x"), r"line 8: got 'x'; expected a number, or nothing where a marker was not"),
        ("a.trc", TRC.replace("6\t\n", "6\t7\n"), "line 7: 12 fields; expected at most 11, for 3 markers"),
        ("a.trc", TRC.replace("0.52", "0.5"), "expected finite times that increase"),
        ("a.trc", TRC[:90], "the file has 2 lines; expected five before the numbers"),
        ("a.trc", "HIERARCHY", "the file begins with 'HIERARCHY'; expected PathFileType: this is no TRC"),
        ("a.trc", "", "expected PathFileType"),
        ("a.trc", TRC.partition("2\t0.52")[0], "holds 3 markers at 1 times, expected one or more at two or more"),
        (
            "a.csv",
            TABLE.replace("hand.z", "hand.u"),
            r"(lacks a column 'hand\.z'|has a column 'hand\.u'), expected the time",
        ),
        ("a.csv", TABLE.replace("mm", "deg"), "its places are in 'deg'"),
        ("a.csv", TABLE.replace("1.5", "0.5"), "expected times that increase"),
        ("a.csv", "t [s],bend [deg]\n0,1\n1,2\n", "has a column 'bend'"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(MotionFileError, match=message):
        read_markers(written(tmp_path / name, text))


def test_a_trc_is_no_table_of_variables(tmp_path: Path) -> None:
    with pytest.raises(MotionFileError, match=r"leastaction\.io\.read_markers"):
        read_motion(written(tmp_path / "x.trc", TRC))


def test_markers_are_saved_as_a_table_that_is_read_again(tmp_path: Path) -> None:
    markers = read_markers(written(tmp_path / "x.trc", TRC))
    again = read_markers(markers.save(tmp_path / "x.csv"))
    assert again.names == markers.names
    np.testing.assert_array_equal(again.places, markers.places)
    assert text_of(str(tmp_path / "x.trc")).plain == "3 markers at 4 times over 0.06 s: HAND, ELB, ELB#2"
    converted(tmp_path / "x.trc", tmp_path / "y.csv")
    assert (tmp_path / "y.csv").read_bytes() == (tmp_path / "x.csv").read_bytes()
