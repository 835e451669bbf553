"""A rasteriser in NumPy: which triangle is seen at each pixel.

Each triangle is cut into rows of pixels, each row into pixels, all triangles at once, so that the work is that of the
pixels that are covered. What is nearest wins by the smallest key of depth and number.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array

Keys = NDArray[np.int64]
NOTHING = np.iinfo(np.int64).max
_DEPTHS = 2**30
_AT_ONCE = 4_000_000  # pixels


def visible(x: Array, y: Array, z: Array, width: int, height: int) -> NDArray[np.int64]:
    """Return the number of the triangle that is seen at each pixel, (height, width); -1 where there is none.

    ``x``, ``y`` (n, 3): corners in pixels, from the top left. ``z`` (n, 3): their depths, linear over the picture, 0
    to 1; a triangle with a corner outside of that is left out.
    """
    buffer = np.full(width * height, NOTHING, dtype=np.int64)
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    top = np.clip(np.ceil(y.min(axis=1) - 0.5), 0, height).astype(np.int64)
    bottom = np.clip(np.floor(y.max(axis=1) - 0.5) + 1, 0, height).astype(np.int64)
    seen = (np.abs(area) > 1e-12) & (bottom > top) & (z.min(axis=1) >= 0.0) & (z.max(axis=1) <= 1.0)
    seen &= (x.max(axis=1) > 0.0) & (x.min(axis=1) < width)
    which = np.flatnonzero(seen)
    rows = bottom[which] - top[which]
    for chunk in np.split(which, np.flatnonzero(np.diff(np.cumsum(rows) // 400_000)) + 1):
        _fill(chunk, x, y, z, area, top, bottom - top, width, buffer)
    numbers = np.where(buffer == NOTHING, -1, buffer & 0xFFFFFFFF)
    return numbers.reshape(height, width)


def _fill(
    which: Keys, x: Array, y: Array, z: Array, area: Array, top: Keys, rows: Keys, width: int, buffer: Keys
) -> None:
    """Put triangles into the buffer of keys."""
    count = rows[which]
    of = np.repeat(which, count)
    row = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count) + top[of]
    level = row + 0.5
    left, right = np.full(len(of), 0.0), np.full(len(of), float(width))
    for i, j in ((0, 1), (1, 2), (2, 0)):
        x0, y0, x1, y1 = x[of, i], y[of, i], x[of, j], y[of, j]
        rise = y1 - y0
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = x0 + (level - y0) / rise * (x1 - x0)
        # Inside is on the right of an edge that rises when the area is negative, and of one that falls when positive.
        lower = rise * area[of] < 0.0
        upper = rise * area[of] > 0.0
        left = np.where(lower, np.maximum(left, cut), left)
        right = np.where(upper, np.minimum(right, cut), right)
    first = np.clip(np.ceil(left - 0.5), 0, width).astype(np.int64)
    last = np.clip(np.floor(right - 0.5) + 1, 0, width).astype(np.int64)
    some = np.flatnonzero(last > first)
    of, row, first, count = of[some], row[some], first[some], (last - first)[some]
    slope_x = ((z[:, 1] - z[:, 0]) * (y[:, 2] - y[:, 0]) - (z[:, 2] - z[:, 0]) * (y[:, 1] - y[:, 0]))[of] / area[of]
    slope_y = ((z[:, 2] - z[:, 0]) * (x[:, 1] - x[:, 0]) - (z[:, 1] - z[:, 0]) * (x[:, 2] - x[:, 0]))[of] / area[of]
    start = z[of, 0] + slope_x * (first + 0.5 - x[of, 0]) + slope_y * (row + 0.5 - y[of, 0])
    for part in np.split(np.arange(len(of)), np.flatnonzero(np.diff(np.cumsum(count) // _AT_ONCE)) + 1):
        n = count[part]
        at = np.repeat(part, n)
        step = np.arange(len(at)) - np.repeat(np.cumsum(n) - n, n)
        depth = np.clip((start[at] + slope_x[at] * step) * _DEPTHS, 0, _DEPTHS).astype(np.int64)
        np.minimum.at(buffer, row[at] * width + first[at] + step, (depth << 32) | of[at])


def weights(x: Array, y: Array, px: NDArray[np.floating[Any]], py: NDArray[np.floating[Any]]) -> Array:
    """Return the weights (n, 3) of the corners of triangles (n, 3) at points in the picture (n,)."""
    area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    w1 = ((px - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (py - y[:, 0])) / area
    w2 = ((x[:, 1] - x[:, 0]) * (py - y[:, 0]) - (px - x[:, 0]) * (y[:, 1] - y[:, 0])) / area
    return np.stack((1.0 - w1 - w2, w1, w2), axis=1)
