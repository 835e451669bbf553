"""`View`: scenes that show themselves."""

from __future__ import annotations

import html
import os
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from leastaction.errors import ArgumentError, brief
from leastaction.numerics.arrays import as_count, as_number
from leastaction.numerics.files import write_bytes, write_text
from leastaction.numerics.public import public
from leastaction.viz.scene import Scene
from leastaction.viz.viewer.animation import animation_page

_NOTEBOOK_HEIGHT: Final = 480


def _pixels(size: Any) -> tuple[int, int]:
    if not isinstance(size, Sequence) or len(size) != 2:
        raise ArgumentError(f"size: got {brief(repr(size))}, expected width and height in pixels, such as (1200, 800)")
    width, height = (as_count(each, "size", 1) for each in size)
    if width * height > _MOST_PIXELS:
        raise ArgumentError(f"size: got {width} times {height} pixels, expected at most {_MOST_PIXELS}")
    return width, height


_MOST_PIXELS = 10**8


@public
@dataclass(frozen=True)
class View:
    """What `show` returns: scenes side by side, which show themselves in a notebook, a browser or a file.

    Attributes
    ----------
    scenes : tuple of Scene
        What is drawn.
    joints, forces : bool
        Whether joints and forces are shown from the start.
    """

    scenes: tuple[Scene, ...]
    joints: bool = False
    forces: bool = False

    def __repr__(self) -> str:
        """Say what is shown, and what to do with it."""
        shown = ", ".join(repr(scene.title) for scene in self.scenes)
        return f"<View of {shown}: .open() shows it in the browser, .save('view.html') writes it>"

    def page(self) -> str:
        """Return the page as HTML: one text that asks for nothing else."""
        return animation_page(self.scenes, joints=self.joints, forces=self.forces)

    def _repr_html_(self) -> str:
        """Show it in a notebook, in a frame of its own."""
        return (
            f'<iframe srcdoc="{html.escape(self.page(), quote=True)}" title="{html.escape(self.scenes[0].title)}" '
            f'style="width:100%;height:{_NOTEBOOK_HEIGHT}px;border:0" allowfullscreen></iframe>'
        )

    def seen_from(self, azimuth: float, elevation: float = 16.0, *, nearer: float = 1.0) -> View:
        """Return the same, seen from elsewhere: pages at first, where a mouse turns them, pictures and movies always.

        Parameters
        ----------
        azimuth : float
            Where it is seen from, about the vertical (degrees): 0 from where x points to, 90 from where y does.
        elevation : float, optional
            How far from above (degrees).
        nearer : float, optional
            How many times nearer than where all of a pose is in sight: more than 1 for what is wide and low.

        Raises
        ------
        ArgumentError
            What is no number, an elevation beyond straight from above or below, or nothing to be nearer by.
        """
        turn, tilt = as_number(azimuth, "azimuth"), as_number(elevation, "elevation")
        if not -90.0 <= tilt <= 90.0:
            raise ArgumentError(f"elevation: got {tilt:g} degrees, expected -90 to 90")
        close = as_number(nearer, "nearer", above=0.0)
        scenes = (replace(each, azimuth=turn, elevation=tilt, nearer=close) for each in self.scenes)
        return replace(self, scenes=tuple(scenes))

    def open(self) -> Path:
        """Show it in the browser.

        Returns
        -------
        Path
            The page, in the folder for temporary files.
        """
        folder = Path(tempfile.mkdtemp(prefix="leastaction-"))
        path = write_text(folder / "view.html", self.page())
        webbrowser.open(path.as_uri())
        return path

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        at: float | None = None,
        size: tuple[int, int] | None = None,
        fps: float = 25.0,
        dark: bool = False,
    ) -> Path:
        """Write it to a file, whole or not at all; no browser is needed for any.

        Parameters
        ----------
        path : path-like
            The ending says what is written: ``.html`` the page, ``.png`` a picture, ``.gif`` and ``.mp4`` movies,
            ``.glb`` a glTF scene with its motion, for other programs.
        at : float, optional
            Time of a picture (s); its beginning if not given.
        size : tuple of int, optional
            Width and height in pixels; 1200 by 800 of pictures and 720 by 480 of movies if not given.
        fps : float, optional
            Pictures a second of a movie; a .gif has 50 at the most.
        dark : bool, optional
            Whether pictures and movies have a dark background.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        ArgumentError
            The ending is none of these, the time is outside, a movie is to be made of what stands still, or what
            writes it is not installed.
        OutputError
            The file could not be written; nothing was changed.
        """
        from leastaction.viz.viewer.gltf import glb
        from leastaction.viz.viewer.movies import Painted, gif, mp4, png

        if size is not None:
            size = _pixels(size)
        still, moving, how = size or (1200, 800), size or (720, 480), Painted(dark, self.joints, self.forces)
        made: dict[str, Callable[[], bytes]] = {
            ".html": lambda: self.page().encode("utf-8"),
            ".png": lambda: png(self.scenes, how, at=at, size=still),
            ".gif": lambda: gif(self.scenes, how, size=moving, fps=fps),
            ".mp4": lambda: mp4(self.scenes, how, size=moving, fps=fps),
            ".glb": lambda: glb(self.scenes),
        }
        ending = Path(path).suffix.lower()
        if ending not in made:
            raise ArgumentError(f"{Path(path).name}: got the ending {ending!r}, expected one of {', '.join(made)}")
        return write_bytes(path, made[ending]())
