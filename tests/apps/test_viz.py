"""Pictures: they are made whole, they show what they are given, and they refuse what does not fit."""

from __future__ import annotations

import base64
import json
import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from leastaction import viz
from leastaction.errors import ArgumentError, OutputError
from leastaction.models.four_bars import at_angle, four_bars
from leastaction.viz import Bone, Cord, Scene

N = 60
TIMES = np.linspace(0.0, 1.5, N + 1)


def _size(path: Path) -> tuple[int, int]:
    """Width and height of a PNG file, from its header."""
    content = path.read_bytes()
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    assert content.rstrip().endswith(b"IEND\xaeB`\x82")
    width, height = struct.unpack(">II", content[16:24])
    return width, height


@pytest.fixture
def scene() -> Scene:
    """A ball on an arm, hung on one string that goes slack in the second half."""
    swing = 0.5 * np.sin(4.0 * TIMES)
    hand = np.column_stack((np.sin(swing), 0.2 * TIMES, 1.0 - np.cos(swing)))
    top = hand + np.array([0.0, 0.0, 1.0])
    shoulder = np.column_stack((0.0 * TIMES, 0.2 * TIMES, 1.0 + 0.0 * TIMES))
    return Scene(
        t=TIMES,
        points={"shoulder": shoulder, "hand": hand, "top": top},
        bones=(
            Bone(start="shoulder", end="hand", radius=0.05),
            Bone(start="hand", end="hand", radius=0.1),
        ),
        cords=(Cord(name="string <1>", start="hand", end="top"),),
        ghost={"shoulder": shoulder, "hand": hand + 0.02},
        tension={"string <1>": np.linspace(20.0, -20.0, N)},
        error=np.abs(swing),
        traces=("hand",),
        title="Arm </script> & ball",
    )


def _data(page: str) -> dict[str, Any]:
    """The data of an animation page, as the browser reads it."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    (data,) = json.loads(found.group(1))["panels"]
    assert isinstance(data, dict)
    return data


def test_tracking_errors_are_in_degrees_and_metres() -> None:
    reference = np.zeros((N + 1, 3))
    got = np.zeros((N + 1, 3))
    got[:, 0] = 0.1
    got[:, 1] = np.radians(3.0) * np.where(np.arange(N + 1) % 2 == 0, 1.0, -1.0)
    got[-1, 2] = np.radians(-7.0)
    errors = viz.tracking_errors(reference, got, ["tx", "hip", "knee"], lengths=["tx"])
    assert errors.units == ("m", "deg", "deg")
    np.testing.assert_allclose(errors.rms, [0.1, 3.0, 7.0 / np.sqrt(N + 1)], rtol=1e-12)
    np.testing.assert_allclose(errors.largest, [0.1, 3.0, 7.0], rtol=1e-12)
    np.testing.assert_allclose(errors.over_time[[0, -1]], [3.0 / 2**0.5, (29.0) ** 0.5], rtol=1e-12)
    np.testing.assert_allclose(errors.joint_rms, np.sqrt((errors.over_time**2).mean()), rtol=1e-12)


def test_tracking_has_a_panel_for_each_variable(tmp_path: Path, rng: np.random.Generator) -> None:
    names = [f"joint {i}" for i in range(6)]
    reference = rng.normal(size=(N + 1, 6))
    got = reference + np.radians(2.0)
    groups = {"Leg": names[:5], "Arm": names[5:]}
    figure = viz.plot_tracking(TIMES, reference, got, names, lengths=names[:1], groups=groups)
    titles = {axes.get_title(loc="left"): axes.get_title(loc="right") for axes in figure.axes}
    assert titles["joint 0"] == "rms 0.0349 m"
    assert all(titles[name] == "rms 2.00°" for name in names[1:])
    panel = next(axes for axes in figure.axes if axes.get_title(loc="left") == "joint 3")
    np.testing.assert_allclose(panel.lines[1].get_ydata(), np.degrees(got[:, 3]))
    assert _size(viz.save_png(figure, tmp_path / "t.png", dpi=40))[0] > 400


def test_tracking_refuses_what_does_not_fit() -> None:
    q = np.zeros((N + 1, 2))
    with pytest.raises(ArgumentError, match=r"\(N\+1, 3\)"):
        viz.plot_tracking(TIMES, q, q, ["a", "b", "c"])
    with pytest.raises(ArgumentError, match="t has shape"):
        viz.plot_tracking(TIMES[1:], q, q, ["a", "b"])
    with pytest.raises(ArgumentError, match="group 'Leg' names c"):
        viz.plot_tracking(TIMES, q, q, ["a", "b"], groups={"Leg": ["c"]})
    with pytest.raises(ArgumentError, match="lengths names c"):
        viz.tracking_errors(q, q, ["a", "b"], lengths=["c"])
    with pytest.raises(ArgumentError, match="nothing to draw"):
        viz.plot_tracking(TIMES, q, q, ["a", "b"], groups={})


def test_strings_say_which_are_slack(tmp_path: Path) -> None:
    tension = np.column_stack((np.full(N, 5.0), np.where(np.arange(N) < N // 4, -1.0, 1.0)))
    length = np.ones((N + 1, 2))
    figure = viz.plot_strings(TIMES, length, tension, ["left", "right"])
    titles = [axes.get_title(loc="right") for axes in figure.axes]
    assert titles[0] == "never slack, least 5.0 N"
    assert titles[2] == "slack 25.0 % of the time"
    red = [patch for patch in figure.axes[2].patches if patch.get_alpha() == 0.13]
    assert len(red) == 1
    assert not figure.axes[0].patches
    _size(viz.save_png(figure, tmp_path / "s.png", dpi=40))
    with pytest.raises(ArgumentError, match="do not fit"):
        viz.plot_strings(TIMES, length, tension[:-1], ["left", "right"])


def test_snapshots(scene: Scene, tmp_path: Path) -> None:
    figure = viz.plot_snapshots(scene, times=[0.1, 1.4], ceiling=1.5, title="Arm")
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.texts] == ["0.10 s", "1.40 s"]
    # Two bones and the reference one behind, twice; the string is slack at the second time only.
    assert len(axes.patches) == 2 * (2 + 2)
    dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert len(dashed) == 1
    width, height = _size(viz.save_png(figure, tmp_path / "p.png", dpi=50))
    assert width == 600
    assert height > 100
    with pytest.raises(ArgumentError, match=r"0 to 1\.5 s, got \[2\.0\]"):
        viz.plot_snapshots(scene, times=[2.0])
    with pytest.raises(ArgumentError, match="one or more"):
        viz.plot_snapshots(scene, count=0)


def test_animation_is_one_file_that_asks_for_nothing(scene: Scene, tmp_path: Path) -> None:
    path = viz.write_animation(scene, tmp_path / "a.html")
    page = path.read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>")
    assert re.search(r"https?:|src=|@import|url\(|fetch\(|XMLHttpRequest|WebSocket", page) is None
    assert "{{" not in page
    # Names and titles cannot break out of the page.
    assert page.count("</script>") == 2
    assert "Arm &lt;/script&gt; &amp; ball" in page


def test_animation_keeps_the_positions(scene: Scene) -> None:
    data = _data(viz.animation_page(scene))
    t = np.frombuffer(base64.b64decode(data["t"]), "<f4")
    assert np.isin(t, TIMES.astype("f4")).all()
    codes = np.frombuffer(base64.b64decode(data["points"]["codes"]), "<u2").reshape(len(t), 3, 3)
    points = np.array(data["low"]) + codes * np.array(data["step"])
    expected = np.stack([scene.points[name] for name in data["points"]["names"]], axis=1)
    shown = np.stack([[np.interp(TIMES, t, column) for column in path.T] for path in np.moveaxis(points, 1, 0)])
    np.testing.assert_allclose(shown.transpose(2, 0, 1), expected, atol=3e-3)  # of a scene of 2 m
    assert data["cords"] == [[[1, 2], "string <1>", "string", 0]]
    # The reference pose has no top, and both bones.
    assert data["ghost"]["names"] == ["shoulder", "hand"]
    assert data["ghostBones"] == [[0, 1, 0.05], [1, 1, 0.1]]
    tension = np.frombuffer(base64.b64decode(data["tension"][0]), "<f4")
    assert tension[0] > 19.0
    assert tension[-1] < -19.0


def test_a_scene_of_any_mechanism() -> None:
    mechanism = four_bars(1)
    q = np.array([at_angle(mechanism, angle, 0.0)[0] for angle in np.linspace(0.5, 1.5, 11)])
    t = np.linspace(0.0, 1.0, 11)
    made = viz.mechanism_scene(mechanism, t, q, reference=q + 0.1, title="Four bars")
    # A bar wherever a frame is apart from the one that carries it, and none where it only turns.
    assert {(bone.start, bone.end) for bone in made.bones} == {
        ("rz(crank0)", "B0"),
        ("rz(coupler0)", "C0"),
        ("world", "A1"),
        ("rz(crank1)", "B1"),
    }
    np.testing.assert_allclose(made.points["B0"], mechanism.positions(q, ["B0"])[:, 0])
    assert made.ghost is not None
    np.testing.assert_allclose(made.ghost["C0"], mechanism.positions(q + 0.1, ["C0"])[:, 0])
    assert len(_data(viz.animation_page(made))["bones"]) == 4
    cord = Cord(name="spring", start="B0", end="A1")
    pulled = viz.mechanism_scene(mechanism, t, q, bones=(), cords=[cord], tension=np.ones((10, 1)), focus="C0")
    assert pulled.tension is not None
    assert set(pulled.points) == {"B0", "A1", "C0"}
    with pytest.raises(ArgumentError, match=r"tension: got shape \(10,\), expected \(any, 1\)"):
        viz.mechanism_scene(mechanism, t, q, cords=[cord], tension=np.ones(10))
    with pytest.raises(ArgumentError, match="elbow"):
        viz.mechanism_scene(mechanism, t, q, focus="elbow")


def test_scene_refuses_what_does_not_fit(scene: Scene) -> None:
    points = dict(scene.points)
    bad: list[tuple[str, dict[str, Any]]] = [
        ("no point is called elbow", {"bones": (Bone(start="elbow", end="hand", radius=0.1),)}),
        ("no point is called elbow", {"focus": "elbow"}),
        ("'hand' must be", {"points": points | {"hand": np.full((N + 1, 3), np.nan)}}),
        ("ghost point 'hand'", {"ghost": {"hand": np.zeros((3, 3))}}),
        ("growing times", {"t": TIMES[::-1]}),
        ("at least one point", {"points": {}, "bones": (), "cords": ()}),
        ("fits no cord", {"tension": {"other": np.zeros(N)}}),
        ("error has shape", {"error": np.zeros(3)}),
    ]
    for message, change in bad:
        fields = {name: getattr(scene, name) for name in scene.__dataclass_fields__} | change
        with pytest.raises(ArgumentError, match=re.escape(message)):
            Scene(**fields)


def test_pictures_leave_matplotlib_alone(scene: Scene, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    viz.save_png(viz.plot_snapshots(scene, count=2), tmp_path / "p.png", dpi=40)
    assert dict(mpl.rcParams) == before
    assert not mpl.get_backend().lower().startswith("tk")


def test_importing_the_package_does_not_import_matplotlib() -> None:
    code = "import sys, leastaction.viz; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_picture_that_cannot_be_written(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        viz.write_animation(scene, tmp_path / "absent" / "a.html")
    with pytest.raises(OutputError, match="cannot write"):
        viz.save_png(Figure(), tmp_path / "absent" / "a.png")
