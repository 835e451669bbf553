"""Markers of C3D files, held to what ezc3d writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import leastaction as la
from leastaction.errors import ArgumentError, MissingExtraError, MotionFileError
from leastaction.io import Markers, read_markers
from leastaction.io.motion import markers
from leastaction.numerics import extras

LABELS = ("hand", "LFHD", "LFHD", "")


def write_c3d(
    path: Path, points: np.ndarray, labels: tuple[str, ...] = LABELS, *, unit: str = "mm", rate: float = 50.0
) -> Path:
    """Write places (F, n, 3) in a unit; NaN where a marker was not seen."""
    ezc3d = pytest.importorskip("ezc3d")
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [rate]
    content["parameters"]["POINT"]["LABELS"]["value"] = labels
    content["parameters"]["POINT"]["UNITS"]["value"] = [unit] if unit else []
    content["data"]["points"] = np.vstack([points.transpose(2, 1, 0), np.ones((1, *points.shape[1::-1]))])
    content["parameters"]["ANALOG"]["RATE"]["value"] = [100.0]
    content["parameters"]["ANALOG"]["LABELS"]["value"] = ("force",)
    content["data"]["analogs"] = np.arange(2.0 * len(points))[None, None]
    content.write(str(path))
    return path


@pytest.fixture
def points() -> np.ndarray:
    """Places in mm that a float of 32 bits holds exactly, the second marker hidden at times."""
    places = np.arange(6 * 4 * 3, dtype=np.float64).reshape(6, 4, 3) * 0.5
    places[1:3, 1] = np.nan
    return places


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e-3), ("m", 1.0), ("cm", 1e-2)])
def test_names_units_rate_and_gaps(points: np.ndarray, unit: str, factor: float, tmp_path: Path) -> None:
    found = read_markers(write_c3d(tmp_path / "walk.c3d", points, unit=unit))
    assert found.names == ("hand", "LFHD", "LFHD#2", "unlabelled 4")
    np.testing.assert_allclose(found.t, np.arange(6) / 50.0, atol=1e-15)
    np.testing.assert_allclose(found.places, points * factor, rtol=1e-15)
    np.testing.assert_array_equal(found["hand"], found.places[:, 0])
    assert found.seen("LFHD") == pytest.approx(4 / 6)
    assert found.seen("hand") == 1.0
    assert found.source == "walk"
    with pytest.raises(ArgumentError, match="there is no marker 'LFH'; did you mean 'LFHD'"):
        found["LFH"]
    chosen = found.renamed({"LFHD": "head", "hand": "wrist"})
    assert chosen.names == ("head", "wrist")
    np.testing.assert_array_equal(chosen["head"], found["LFHD"])


def test_resampled_on_straight_lines_and_not_into_gaps(points: np.ndarray, tmp_path: Path) -> None:
    found = read_markers(write_c3d(tmp_path / "walk.c3d", points, unit="m"))
    half = found.resample(0.01)
    np.testing.assert_allclose(half["hand"][::2], found["hand"], rtol=1e-12)
    np.testing.assert_allclose(half["hand"][1::2], 0.5 * (found["hand"][1:] + found["hand"][:-1]), rtol=1e-12)
    assert np.isnan(half["LFHD"]).all(axis=1).tolist() == [False, True, True, True, True, True] + [False] * 5
    with pytest.raises(ArgumentError, match="dt: got 1 s, longer than the capture"):
        found.resample(1.0)


def test_frames_follow_markers_by_name(tmp_path: Path) -> None:
    m = la.Mechanism(
        [la.ry("shoulder", name="upper"), [la.tz(-1.0, name="hand", mass=1.0)]],
        [la.Gravity(), la.JointForce("shoulder", "motor"), la.Damping(0.1)],
    )
    t = np.arange(11) / 50.0
    angle = 0.2 * np.sin(3.0 * t)
    places = np.stack([-np.sin(angle), 0.0 * t, -np.cos(angle)], axis=1)
    places[4:6] = np.nan
    found = la.follow(
        m, read_markers(write_c3d(tmp_path / "a.c3d", 1e3 * places[:, None], ("LWRA",))).renamed({"LWRA": "hand"})
    )
    assert found.errors["hand"] < 1e-2
    np.testing.assert_allclose(found["shoulder"], angle, atol=2e-2)


def test_bad_files(points: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_c3d(tmp_path / "walk.c3d", points)
    for name, content in (
        ("empty.c3d", b""),
        ("text.c3d", b"HIERARCHY\nROOT Hips\n" * 100),
        ("short.c3d", path.read_bytes()[:700]),
        ("shorter.c3d", path.read_bytes()[:-300]),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MotionFileError, match=rf"{name}: is damaged or (no C3D file|cut short)"):
            read_markers(tmp_path / name)
    with pytest.raises(MotionFileError, match=r"absent\.c3d: is no file"):
        read_markers(tmp_path / "absent.c3d")
    with pytest.raises(MotionFileError, match=r"are in 'in', expected one of mm, cm, m\. Say it"):
        read_markers(write_c3d(tmp_path / "inch.c3d", points, unit="in"))
    assert read_markers(tmp_path / "inch.c3d", unit="mm").places[0, 0, 1] == 0.5e-3
    with pytest.raises(ArgumentError, match="unit: got 'inch'"):
        read_markers(path, unit="inch")
    with pytest.raises(MotionFileError, match="holds 4 markers at 1 times"):
        read_markers(write_c3d(tmp_path / "one.c3d", points[:1]))

    content = markers._content(path)
    content["parameters"]["POINT"]["RATE"]["value"] = [0.0]
    with monkeypatch.context() as patch:
        patch.setattr(markers, "_content", lambda source: content)
        with pytest.raises(MotionFileError, match="rate 0 Hz"):
            read_markers(path)

    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr(extras, "import_module", absent)
    with pytest.raises(MissingExtraError, match=r"needs ezc3d.*pip install 'leastaction\[c3d\]'"):
        read_markers(path)


def test_what_are_no_markers() -> None:
    t = np.array([0.0, 1.0])
    with pytest.raises(ArgumentError, match="'a' twice"):
        Markers(("a", "a"), t, np.zeros((2, 2, 3)))
    with pytest.raises(ArgumentError, match=r"places: got shape \(2, 1, 2\)"):
        Markers(("a",), t, np.zeros((2, 1, 2)))
    with pytest.raises(ArgumentError, match="times that increase"):
        Markers(("a",), t[::-1], np.zeros((2, 1, 3)))
