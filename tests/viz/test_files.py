"""Files of views: pages under three megabytes, pictures, movies and glTF, whole or not at all."""

from __future__ import annotations

import base64
import json
import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leastaction import Mechanism, rz, show, tx
from leastaction.errors import ArgumentError, OutputError
from leastaction.mechanics.description.shapes import Shape
from leastaction.viz import View
from leastaction.viz.viewer import solids
from leastaction.viz.viewer.collada import read_collada
from leastaction.viz.viewer.meshes import decimated, welded
from leastaction.viz.viewer.raster import visible
from leastaction.viz.viewer.solids import Solid
from viz import scenes

ARM = Mechanism([rz("a", name="arm", mass=1.0), [tx(1.0, name="hand", mass=1.0)]])
COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
<asset><unit meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert>
<diffuse><color>1 0.5 0 1</color></diffuse></lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="12">0 0 0 100 0 0 100 200 0 0 200 0</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<polylist count="1" material="orange"><input semantic="VERTEX" source="#v" offset="0"/>
<vcount>4</vcount><p>0 1 2 3</p></polylist></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>0 0 300</translate>
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="orange" target="#m"/>
</technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


@pytest.mark.parametrize("name", ["talos", "ur5"])
def test_a_robot_with_meshes_stays_under_three_megabytes(name: str) -> None:
    view = scenes.robot(name)
    assert any(shape.kind == "mesh" for shape in view.scenes[0].shapes)
    assert 5e5 < len(view.page().encode()) < 3e6


def test_a_page_asks_for_nothing() -> None:
    page = scenes.four_bar().page()
    assert re.search(r"https?:|src=|@import|url\(|fetch\(|XMLHttpRequest|WebSocket", page) is None
    assert "{{" not in page
    notebook = scenes.four_bar()._repr_html_()
    assert notebook.startswith("<iframe srcdoc=")
    assert notebook.count('"') == 6  # of the frame's own attributes: those of the page are escaped


def test_the_page_has_the_poses() -> None:
    run = scenes.four_bar_run()
    box = Shape(frame="B0", kind="box", size=[0.2, 0.1, 0.1])
    page = show(run, shapes=[box]).page()
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    (panel,) = json.loads(found.group(1))["panels"]

    def read(text: str, kind: str, width: int) -> np.ndarray[Any, Any]:
        return np.frombuffer(base64.b64decode(text), kind).reshape(-1, len(panel["poses"]["names"]), width)

    t = np.frombuffer(base64.b64decode(panel["t"]), "<f4")
    k = panel["poses"]["names"].index("B0")
    place = np.array(panel["low"]) + np.array(panel["step"]) * read(panel["poses"]["codes"], "<u2", 3)[:, k]
    x, y, z, w = read(panel["poses"]["turns"], "<i2", 4)[:, k].T / 32767.0
    at = run.mechanism.frame_pose(np.column_stack([np.interp(t, run.t, c) for c in run.q.T]), "B0")
    np.testing.assert_allclose(place[:, [0, 2]], at[:, :2, 3], atol=2e-4)
    np.testing.assert_allclose(1 - 2 * (y**2 + z**2), at[:, 0, 0], atol=1e-4)  # x of the frame along x
    np.testing.assert_allclose(2 * (x * z - w * y), at[:, 1, 0], atol=1e-4)  # and along y, which is up
    assert panel["solids"][0][2][:1] == [0.2]


def test_pictures_show_what_is_there(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    ball = Shape(frame="hand", kind="sphere", size=[0.3], color=(1.0, 0.0, 0.0, 1.0))
    view = show(ARM, shapes=[ball])
    path = view.save(tmp_path / "ball.png", size=(300, 200))
    picture = np.asarray(image.open(path)).astype(int)
    assert picture.shape == (200, 300, 3)
    red = picture[..., 0] - picture[..., 1] > 80
    rows, columns = np.nonzero(red)
    assert abs(columns.mean() - 150) < 3  # the camera looks at it
    width, height = np.ptp(columns), np.ptp(rows)
    assert abs(width - height) <= 3
    assert red.sum() == pytest.approx(np.pi / 4 * (width + 1) * (height + 1), rel=0.05)
    dark = np.asarray(image.open(view.save(tmp_path / "dark.png", size=(300, 200), dark=True)))
    assert np.median(dark) < 60 < 200 < np.median(picture)


def test_pictures_are_seen_from_where_one_likes(tmp_path: Path) -> None:
    """A thin bar along x: in full from the side, hardly from where x points to; twice as long from half as far."""
    image = pytest.importorskip("PIL.Image")
    bar = Shape(frame="world", kind="box", size=[0.5, 0.01, 0.01], color=(1.0, 0.0, 0.0, 1.0))
    view = show(Mechanism([tx("x", name="body", mass=1.0)]), shapes=[bar])

    def length(**where: float) -> int:
        path = view.seen_from(**where).save(tmp_path / "bar.png", size=(400, 200))
        picture = np.asarray(image.open(path)).astype(int)
        return int(np.ptp(np.nonzero(picture[..., 0] - picture[..., 1] > 80)[1]))

    whole = length(azimuth=90.0, elevation=0.0)
    assert length(azimuth=0.0, elevation=0.0) < 0.2 * whole
    assert length(azimuth=90.0, elevation=0.0, nearer=2.0) == pytest.approx(2.0 * whole, rel=0.05)
    assert view.seen_from(30.0).scenes[0].azimuth == 30.0
    page = view.seen_from(30.0, nearer=2.0).page()
    assert '"nearer":2.0' in page.replace(" ", "")
    with pytest.raises(ArgumentError, match="elevation: got 120 degrees, expected -90 to 90"):
        view.seen_from(0.0, 120.0)
    with pytest.raises(ArgumentError, match="nearer: got 0"):
        view.seen_from(0.0, nearer=0.0)


def test_the_nearest_triangle_is_seen() -> None:
    x = np.array([[0.0, 20.0, 0.0], [0.0, 20.0, 0.0], [5.0, 15.0, 5.0]])
    y = np.array([[0.0, 0.0, 20.0], [0.0, 0.0, 20.0], [5.0, 5.0, 15.0]])
    z = np.array([[0.5, 0.5, 0.5], [0.2, 0.8, 0.2], [1.5, 0.5, 0.5]])
    seen = visible(x, y, z, 24, 22)
    assert (seen == 2).sum() == 0  # behind the camera
    i, j = np.mgrid[0:22, 0:24] + 0.5
    inside = i + j < 19.9
    assert (seen[inside] >= 0).all()
    assert (seen[i + j > 20.1] == -1).all()
    np.testing.assert_array_equal(seen[inside] == 1, (0.2 + 0.6 * j / 20.0 < 0.5)[inside])


def test_movies_move(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    view = scenes.four_bar()
    with image.open(view.save(tmp_path / "run.gif", size=(120, 80), fps=5.0)) as movie:
        assert movie.n_frames == 10
        first = np.asarray(movie.convert("RGB")).astype(int)
        movie.seek(5)
        assert np.mean(np.abs(np.asarray(movie.convert("RGB")).astype(int) - first).max(axis=2) > 40) > 0.01


def test_mp4(tmp_path: Path) -> None:
    reader = pytest.importorskip("imageio_ffmpeg")
    path = scenes.four_bar().save(tmp_path / "run.mp4", size=(121, 80), fps=5.0)
    command = [reader.get_ffmpeg_exe(), "-loglevel", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    frames = subprocess.run(command, capture_output=True, check=True).stdout
    assert len(frames) == 10 * 120 * 80 * 3


def _glb(content: bytes) -> tuple[dict[str, Any], bytes]:
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    start = 20 + size
    binary, kind = struct.unpack_from("<I4s", content, start)
    assert kind == b"BIN\0"
    assert start + 8 + binary == len(content)
    return json.loads(content[20:start]), content[start + 8 :]


def test_gltf_moves_as_the_run(tmp_path: Path) -> None:
    run = scenes.four_bar_run()
    box = Shape(frame="B0", kind="box", size=[0.2, 0.1, 0.1], pose=np.eye(4))
    view = show(run, shapes=[box])
    file, binary = _glb(view.save(tmp_path / "run.glb").read_bytes())

    def values(k: int) -> np.ndarray[Any, Any]:
        accessor = file["accessors"][k]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        at = file["bufferViews"][accessor["bufferView"]]["byteOffset"]
        return np.frombuffer(binary, "<f4", accessor["count"] * width, at).reshape(-1, width)

    (animation,) = file["animations"]
    channel = next(c for c in animation["channels"] if c["target"]["path"] == "translation")
    sampler = animation["samplers"][channel["sampler"]]
    t, place = values(sampler["input"])[:, 0], values(sampler["output"])
    q = np.column_stack([np.interp(t, run.t, column) for column in run.q.T])
    expected = run.mechanism.positions(q, ["B0"])[:, 0]
    np.testing.assert_allclose(place[:, [0, 2]], expected[:, :2], atol=2e-6)
    root = file["nodes"][file["scenes"][0]["nodes"][0]]
    x, y, z, w = root["rotation"]
    turned = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    np.testing.assert_allclose(turned, [0, 1, 0], atol=1e-12)  # z is up here, y there


def test_gltf_is_read_by_others(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mirrored = Shape(
        frame="arm", kind="mesh", size=[-2.0, 1.0, 1.0], vertices=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        triangles=[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
    )  # fmt: skip
    read = trimesh.load(show(ARM, shapes=[mirrored], up="z").save(tmp_path / "m.glb"))
    np.testing.assert_allclose(read.bounds, [[-2, 0, -1], [0, 1, 0]], atol=1e-6)


def test_collada(tmp_path: Path) -> None:
    path = tmp_path / "sheet.dae"
    path.write_text(COLLADA)
    (piece,) = read_collada(path)
    assert piece.colour == (1.0, 0.5, 0.0, 1.0)
    np.testing.assert_allclose(piece.solid.p, [[0, -3, 0], [1, -3, 0], [1, -3, 2], [0, -3, 2]])
    assert piece.solid.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    for text, message in (("<a", "cannot be read"), ("<COLLADA/>", "no triangles")):
        path.write_text(text)
        with pytest.raises(ArgumentError, match=message):
            read_collada(path)


def test_meshes_get_fewer_triangles_and_keep_their_form() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    height = np.linspace(-0.5, 0.5, 101)
    p = np.array([[np.cos(a), np.sin(a), z] for z in height for a in angle])
    fine = Solid(p, solids._surface(101, 400, closed=True))
    (coarse,) = decimated([(fine, 1.0)], 6000)
    assert 3000 < len(coarse.triangles) <= 6000
    np.testing.assert_allclose(np.hypot(coarse.p[:, 0], coarse.p[:, 1]), 1.0, atol=5e-3)
    assert decimated([(fine, 1.0)], 10**6)[0].triangles.shape == fine.triangles.shape
    loose = Solid(fine.p[fine.triangles].reshape(-1, 3), np.arange(3 * len(fine.triangles)).reshape(-1, 3))
    assert len(welded(loose).p) == len(p)
    # A small mesh beside a large one keeps something.
    small = Solid(0.001 * p, fine.triangles)
    assert len(decimated([(fine, 1.0), (small, 1.0)], 6000)[1].triangles) >= 60


def test_files_that_cannot_be_made(tmp_path: Path) -> None:
    view = show(ARM)
    with pytest.raises(ArgumentError, match=r"the ending '\.jpg', expected one of \.html, \.png, \.gif, \.mp4, \.glb"):
        view.save(tmp_path / "a.jpg")
    with pytest.raises(ArgumentError, match="nothing moves here"):
        view.save(tmp_path / "a.gif")
    with pytest.raises(ArgumentError, match=r"at: got 9 s, expected a time from 0 to 0 s"):
        view.save(tmp_path / "a.png", at=9.0)
    with pytest.raises(ArgumentError, match="size"):
        view.save(tmp_path / "a.png", size=(3, 4))
    for fps in (0.0, 1e9):
        with pytest.raises(ArgumentError, match="fps"):
            scenes.four_bar().save(tmp_path / "a.mp4", fps=fps)
    assert not list(tmp_path.iterdir())
    with pytest.raises(OutputError, match="cannot write"):
        view.save(tmp_path / "absent" / "a.html")


@pytest.mark.parametrize(("ending", "missing"), [("gif", "PIL"), ("mp4", "imageio_ffmpeg")])
def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ending: str, missing: str) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ArgumentError, match=r"pip install 'leastaction\[viz\]'"):
        scenes.four_bar().save(tmp_path / f"a.{ending}", size=(32, 32))


def test_a_still_picture_needs_nothing_else() -> None:
    code = (
        "import sys\n"
        "for name in ('matplotlib', 'PIL', 'imageio', 'imageio_ffmpeg', 'trimesh'): sys.modules[name] = None\n"
        "from leastaction import Mechanism, rz, show\n"
        "m = Mechanism([rz('a', mass=1.0, inertia=[0.1] * 3)])\n"
        "from leastaction.viz.viewer.movies import Painted, png\n"
        "print(len(png(show(m).scenes, Painted(joints=True, forces=True), at=None, size=(64, 48))))"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 100


def test_it_opens_in_the_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    path = show(ARM, title="Arm").open()
    assert opened == [path.as_uri()]
    assert "Arm" in path.read_text("utf-8")
    assert isinstance(show(ARM), View)
