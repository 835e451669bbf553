"""Scenes as one self-contained HTML page: no file from anywhere else, no server."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Final

from leastaction.errors import ArgumentError
from leastaction.numerics.files import write_text
from leastaction.numerics.public import public
from leastaction.viz.scene import Scene
from leastaction.viz.viewer.page_data import page_data
from leastaction.viz.viewer.stage import staged

_SCRIPTS: Final = ("motion", "vectors", "painter", "view", "scene", "panels", "sliders", "controls")


@public
def animation_page(scenes: Scene | Sequence[Scene], *, joints: bool = False, forces: bool = False) -> str:
    """Return an HTML page that shows a scene in any browser, straight from the disk.

    The page turns with the mouse, zooms with the wheel, plays, pauses, slows down and scrubs; it shows the mechanism,
    its strings coloured by tension (slack ones dashed), the reference as a translucent ghost, the paths of chosen
    points, joints and forces on demand, when limits are active, the time and the tracking error. Appending ``#t=2.5``
    to its address opens it paused at 2.5 s; ``theme=dark``, ``yaw=90``, ``joints=1`` and ``forces=1`` work the same
    way.

    Parameters
    ----------
    scenes
        What to draw; several stand side by side and move together.
    joints, forces
        Whether joints and forces are shown from the start.

    Returns
    -------
    str
        The page. Places are rounded to 1/65535 of the scene's size (0.2 mm for a scene of 12 m), and to a thousandth of
        the size of what moves between samples, which lie close where it moves fast.

    Raises
    ------
    ArgumentError
        The mesh of a shape cannot be read.
    """
    shown = (scenes,) if isinstance(scenes, Scene) else tuple(scenes)
    if not shown:
        raise ArgumentError("scenes: got none, expected one at least")
    data = {**page_data(staged(shown)), "joints": joints, "forces": forces}
    folder = resources.files("leastaction.viz.viewer").joinpath("page")

    def read(name: str) -> str:
        return folder.joinpath(name).read_text(encoding="utf-8")

    # Inside a script element only "<" could end the data early.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    page = read("page.html").replace("{{style}}", read("style.css"))
    page = page.replace("{{script}}", "".join(read(f"{name}.js") for name in _SCRIPTS))
    title = " | ".join(dict.fromkeys(scene.title for scene in shown))
    return page.replace("{{title}}", html.escape(title)).replace("{{data}}", text)


@public
def write_animation(scenes: Scene | Sequence[Scene], path: str | os.PathLike[str]) -> Path:
    """Write `animation_page` to a file, whole or not at all.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    OutputError
        The file could not be written; nothing was changed.
    """
    return write_text(path, animation_page(scenes))
