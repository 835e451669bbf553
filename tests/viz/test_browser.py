"""Pages in a real browser: nothing is complained of, the time bar moves the bodies, keys do what they say."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from leastaction import Mechanism, ball, screw, show, tx, ty, tz
from leastaction.viz import View
from viz import scenes
from viz.chromium import PROGRAM, Browser

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium to look at pages with"),
]
PLACE = "panels[0].got.at(...panels[0].frame(time), panels[0].got.names.indexOf('B0'))"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenes.four_bar().save(tmp_path_factory.mktemp("page") / "four-bar.html")


def pixels(browser: Browser, keep_as: str = "") -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    from PIL import Image

    seen = browser.picture()
    if folder := os.environ.get("LEASTACTION_PICTURES"):
        Path(folder, f"{keep_as}.png").write_bytes(seen)
    return np.asarray(Image.open(io.BytesIO(seen)).convert("RGB"))


def painted(picture: np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]) -> float:
    """Return the share of the middle of a picture that is no background."""
    middle = picture[100:480, 100:800].astype(int)
    return float(np.mean(np.ptp(middle, axis=2) > 25) + np.mean(middle.max(axis=2) < 110))


def test_the_time_bar_moves_the_bodies(browser: Browser, page: Path) -> None:
    browser.show(page, "#t=0")
    first, before = browser.compute(PLACE), pixels(browser, "four-bar")
    run = scenes.four_bar_run()
    places = run.mechanism.positions(run.q, ["B0"])[:, 0]
    np.testing.assert_allclose([first[0], first[2]], places[0, [0, 1]], atol=1e-3)  # y is up there
    browser.compute("(e => { e.value = 0.5; e.dispatchEvent(new Event('input')); })(document.getElementById('slider'))")
    assert browser.compute("time") == pytest.approx(1.0)
    there = browser.compute(PLACE)
    np.testing.assert_allclose([there[0], there[2]], places[40, [0, 1]], atol=5e-3)
    turned = browser.compute(
        "panels[0].poses.at(...panels[0].frame(time), panels[0].poses.names.indexOf('rz(crank1)'))"
    )
    pose = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ run.mechanism.frame_pose(run.q[40], "rz(crank1)")[:3]
    np.testing.assert_allclose(np.reshape(turned, (4, 3)).T, pose, atol=5e-3)
    browser.compute("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")
    after = pixels(browser)
    assert np.mean(np.ptp(np.abs(before.astype(int) - after), axis=2) > 20) > 0.005
    assert browser.complaints == []


def test_keys(browser: Browser, page: Path) -> None:
    browser.show(page, "#t=1")
    assert browser.compute("playing") is False
    assert browser.compute("time") == 1.0
    browser.press("ArrowRight")
    later = browser.compute("time")
    assert later > 1.0
    browser.press("ArrowLeft")
    assert browser.compute("time") < later
    for key, name in (("r", "reference"), ("p", "trace"), ("j", "joints"), ("o", "forces")):
        shown = browser.compute(f"show.{name}")
        browser.press(key)
        assert browser.compute(f"show.{name}") is not shown
    light = browser.compute("theme")
    browser.press("d")
    assert browser.compute("theme") != light
    browser.press(" ", "Space")
    assert browser.compute("playing") is True
    browser.press("End")
    assert browser.compute("[playing, time]") == [False, 2.0]
    assert browser.complaints == []


def test_dragging_turns_and_two_fingers_zoom(browser: Browser, page: Path) -> None:
    browser.show(page, "#t=1")
    before = browser.compute("[yaw, pitch, far]")
    for kind, x, y in (("mousePressed", 300, 300), ("mouseMoved", 380, 330), ("mouseReleased", 380, 330)):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
    after = browser.compute("[yaw, pitch, far]")
    assert after[0] == pytest.approx(before[0] - 0.64, abs=1e-6)
    assert after[2] == before[2]
    for kind, apart in (("touchStart", 50), ("touchMove", 60), ("touchMove", 100), ("touchEnd", None)):
        points = [] if apart is None else [{"x": 400 - apart, "y": 300, "id": 0}, {"x": 400 + apart, "y": 300, "id": 1}]
        browser.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    assert browser.compute("far") < 0.8 * before[2]
    assert browser.complaints == []


def test_a_phone_in_the_dark(browser: Browser, page: Path) -> None:
    metrics = {"width": 390, "height": 780, "deviceScaleFactor": 2, "mobile": True}
    browser.ask("Emulation.setDeviceMetricsOverride", **metrics)
    try:
        browser.show(page, "#t=1&theme=dark")
        picture = pixels(browser, "phone")
        assert picture.shape[:2] == (1560, 780)
        assert np.median(picture) < 60
        assert browser.compute("document.documentElement.scrollWidth <= innerWidth")
        assert browser.complaints == []
    finally:
        browser.ask("Emulation.clearDeviceMetricsOverride")


@pytest.mark.parametrize("what", ["suspended", "bent_hand", "hexapod", "ur5", "go2", "talos"])
def test_what_it_looks_like(browser: Browser, tmp_path: Path, what: str) -> None:
    makers: dict[str, Callable[[], View]] = {
        "suspended": scenes.suspended,
        "bent_hand": scenes.bent_hand,
        "hexapod": scenes.hexapod,
    }
    view = makers[what]() if what in makers else scenes.robot(what)
    browser.show(view.save(tmp_path / "page.html"), "#t=0.6")
    assert painted(pixels(browser, what)) > 0.01
    assert browser.compute("document.getElementById('missing').hidden")
    assert browser.complaints == []


def test_sliders_move_the_joints(browser: Browser, tmp_path: Path) -> None:
    m = Mechanism(
        [
            tx("x", name="cart", mass=1.0),
            [
                screw("s", axis=(0, 1, 1), point=(0.1, 0, 0.2), pitch=0.3, mass=1.0),
                [
                    ty(0.5),
                    [ball("b", axes="xyz"), [tx({"x": -0.5, "s": 0.2}, offset=0.3), [tz(0.4, name="tip", mass=1.0)]]],
                ],
            ],
        ]
    )
    browser.show(show(m, up="y").save(tmp_path / "page.html"))
    browser.press("m")
    assert not browser.compute("document.getElementById('sliders').hidden")
    q = np.linspace(-0.4, 0.45, m.nq)
    for i, value in enumerate(q):
        slider = f"document.querySelectorAll('#sliders input')[{i}]"
        browser.compute(
            f"(e => {{ e.step = 'any'; e.value = {value}; e.dispatchEvent(new Event('input')); }})({slider})"
        )
    place = browser.compute("panels[0].got.at(0, 0, panels[0].got.names.indexOf('tip'))")
    x, y, z = m.positions(q, ["tip"])[0]
    np.testing.assert_allclose(place, [x, -z, y], atol=1e-6)
    assert browser.complaints == []


def test_two_side_by_side(browser: Browser, tmp_path: Path) -> None:
    run = scenes.four_bar_run()
    view = show(run, beside=scenes.suspended().scenes[0], title="One")
    browser.show(view.save(tmp_path / "page.html"), "#t=0.6&joints=1&forces=1")
    picture = pixels(browser, "beside")
    for half in (picture[80:480, :450], picture[80:480, 450:]):
        assert np.mean(np.ptp(half.astype(int), axis=2) > 40) > 0.005
    assert browser.complaints == []


def test_a_notebook_shows_it_in_a_frame(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "notebook.html"
    page.write_text(f"<!DOCTYPE html><script>const draw = () => 0;</script>{scenes.four_bar()._repr_html_()}")
    browser.show(page)
    inner = "document.querySelector('iframe').contentWindow"
    rows = f"{inner}.document.getElementById('rows')?.rows.length"
    browser.compute(f"new Promise(done => {{ const wait = () => {rows} ? done(1) : setTimeout(wait, 50); wait(); }})")
    assert browser.compute(f"{inner}.document.querySelector('h1').textContent") == "Four-bar"
    assert browser.complaints == []
