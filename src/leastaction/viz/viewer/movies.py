"""Pictures and movies of scenes, made without a browser."""

from __future__ import annotations

import contextlib
import io
import struct
import subprocess
import tempfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import as_number
from leastaction.viz.scene import Scene
from leastaction.viz.viewer.painting import painted
from leastaction.viz.viewer.stage import Stage, staged
from leastaction.viz.viewer.things import DARK_LOOK, LIGHT_LOOK

_MOST_PICTURES = 3000
Picture = NDArray[np.uint8]


class Painted(NamedTuple):
    """How pictures are painted: with a dark background, with joints and their axes, with forces."""

    dark: bool = False
    joints: bool = False
    forces: bool = False


def png(scenes: Sequence[Scene], how: Painted, *, at: float | None, size: tuple[int, int]) -> bytes:
    """Return a picture of scenes side by side at a time (s), as a PNG file.

    Raises `ArgumentError`: the time is outside of the motion, or the size is none.
    """
    begin, end = _span(scenes)
    time = begin if at is None else as_number(at, "at")
    if not begin <= time <= end:
        raise ArgumentError(f"at: got {time:g} s, expected a time from {begin:g} to {end:g} s")
    return png_file(_picture(staged(scenes), time, _checked(size), how))


def gif(scenes: Sequence[Scene], how: Painted, *, size: tuple[int, int], fps: float) -> bytes:
    """Return a movie as a GIF file.

    Raises `ArgumentError`: nothing moves, or Pillow is not installed.
    """
    try:
        from PIL import Image
    except ImportError as error:
        raise ArgumentError(_missing("a .gif", "Pillow")) from error
    # Browsers show no more than 50 pictures a second, and count in hundredths of it.
    pause = max(2, round(100.0 / _rate(fps)))
    pictures = _pictures(scenes, 100.0 / pause, size, how)
    frames = [Image.fromarray(picture) for picture in pictures]
    middle = frames[len(frames) // 2].quantize(colors=255, dither=Image.Dither.NONE)
    flat = [frame.quantize(palette=middle, dither=Image.Dither.NONE) for frame in frames]
    file = io.BytesIO()
    flat[0].save(file, "GIF", save_all=True, append_images=flat[1:], duration=10 * pause, loop=0, optimize=True)
    return file.getvalue()


def mp4(scenes: Sequence[Scene], how: Painted, *, size: tuple[int, int], fps: float) -> bytes:
    """Return a movie as an MP4 file.

    Raises `ArgumentError`: nothing moves, or imageio's FFmpeg is not installed.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ArgumentError(_missing("an .mp4", "imageio[ffmpeg]")) from error
    width, height = (2 * (n // 2) for n in _checked(size))  # as the format wants it
    with tempfile.TemporaryDirectory(prefix="leastaction-") as folder:
        path = Path(folder) / "movie.mp4"
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{_rate(fps):g}", "-i", "-"]
        coded = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-movflags", "+faststart", str(path)]
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", *raw, *coded]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as coder:
            assert coder.stdin is not None
            with contextlib.suppress(BrokenPipeError):  # it says why below
                for picture in _pictures(scenes, fps, (width, height), how):
                    coder.stdin.write(picture.tobytes())
            _, told = coder.communicate()
        if coder.returncode != 0:
            raise ArgumentError(f"FFmpeg could not make the movie: {told.decode(errors='replace').strip()}")
        return path.read_bytes()


def png_file(picture: Picture) -> bytes:
    """Return a picture (height, width, 3) as a PNG file."""
    height, width, _ = picture.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    # Each row as its differences to the one above, which pack better than the colours.
    rows = np.concatenate((np.full((height, 1), 2, np.uint8), _differences(picture).reshape(height, -1)), axis=1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    packed = zlib.compress(rows.tobytes(), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def _differences(picture: Picture) -> Picture:
    above = np.concatenate((np.zeros_like(picture[:1]), picture[:-1]))
    return picture - above  # modulo 256, as the format wants it


def _picture(stages: Sequence[Stage], time: float, size: tuple[int, int], how: Painted) -> Picture:
    look = DARK_LOOK if how.dark else LIGHT_LOOK
    ends = np.linspace(0, size[0], len(stages) + 1).astype(int)
    parts = [
        painted(stage, time, look, int(right - left), size[1], joints=how.joints, forces=how.forces)
        for stage, left, right in zip(stages, ends[:-1], ends[1:], strict=True)
    ]
    return np.concatenate(parts, axis=1)


def _pictures(scenes: Sequence[Scene], fps: float, size: tuple[int, int], how: Painted) -> Iterator[Picture]:
    """Yield the pictures of a movie."""
    begin, end = _span(scenes)
    if end <= begin:
        raise ArgumentError("nothing moves here, so there is no movie of it; save a .png, a .html or a .glb")
    count = round((end - begin) * as_number(fps, "fps"))
    if not fps > 0.0 or count > _MOST_PICTURES:
        raise ArgumentError(
            f"fps: got {fps:g}, which makes {count} pictures of {end - begin:g} s; expected a positive number, and at "
            f"most {_MOST_PICTURES} pictures"
        )
    stages, checked = staged(scenes), _checked(size)
    for k in range(max(count, 1)):
        yield _picture(stages, begin + k / fps, checked, how)


def _span(scenes: Sequence[Scene]) -> tuple[float, float]:
    return min(float(scene.t[0]) for scene in scenes), max(float(scene.t[-1]) for scene in scenes)


def _rate(fps: float) -> float:
    rate = as_number(fps, "fps")
    if rate <= 0.0:
        raise ArgumentError(f"fps: got {rate:g}, expected a positive number of pictures a second")
    return rate


def _checked(size: tuple[int, int]) -> tuple[int, int]:
    width, height = size
    if min(size) < 16 or max(size) > 8192:
        raise ArgumentError(f"size: got {size!r}, expected width and height in pixels, 16 to 8192")
    return width, height


def _missing(what: str, needs: str) -> str:
    return f"{what} needs {needs}, which is not installed. Install it (pip install 'leastaction[viz]')"
