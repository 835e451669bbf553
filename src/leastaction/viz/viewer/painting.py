"""Pictures of a stage without a browser: light, shadow, floor and ghosts as the page has them (page/painter.js)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from leastaction.numerics.arrays import Array
from leastaction.viz.viewer import things as placing
from leastaction.viz.viewer.raster import visible, weights
from leastaction.viz.viewer.stage import Stage
from leastaction.viz.viewer.things import Look3D, Thing

_SHADOW = 1024
_FINER = 2  # pixels along each side of a pixel of the picture


@dataclass(frozen=True)
class Camera:
    """Where a picture is seen from: ``eye`` (3,), ``axes`` (3, 3) right, up, ahead; ``lens`` in pixels; its size."""

    eye: Array
    axes: Array
    lens: float
    width: int
    height: int
    near: float
    far: float

    def picture(self, places: Array) -> tuple[Array, Array, Array, Array]:
        """Return x and y (pixels), a depth from 0 to 1 that is linear over the picture, and the distance ahead."""
        right, up, ahead = ((places - self.eye) @ self.axes.T).T
        safe = np.maximum(ahead, 1e-9)
        z = np.where(ahead > self.near, (self.far / (self.far - self.near)) * (1.0 - self.near / safe), -1.0)
        return 0.5 * self.width + self.lens * right / safe, 0.5 * self.height - self.lens * up / safe, z, ahead

    def thin(self, place: Array, pixels: float) -> float:
        """Return half the thickness of what is to be so many pixels thick in the picture."""
        ahead = float((place - self.eye) @ self.axes[2])
        return 0.5 * pixels * _FINER * max(ahead, self.near) / self.lens


def camera_of(stage: Stage, time: float, width: int, height: int) -> Camera:
    """Return the camera of a picture, as that of the page is at first."""
    scene = stage.scene
    spot = placing.at_time(scene.points[scene.focus], scene.t, time) if scene.focus else stage.centre
    centre = np.array([spot[0], spot[1], stage.floor + 0.5 * stage.height])
    yaw, pitch, far = np.radians(scene.azimuth), np.radians(scene.elevation), 1.45 * stage.size / scene.nearer
    c, s, cy, sy = np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    axes = np.array([[-sy, cy, 0.0], [-s * cy, -s * sy, c], [-c * cy, -c * sy, -s]])
    return Camera(
        centre - far * axes[2],
        axes,
        1.25 * min(height, 1.15 * width),
        width,
        height,
        0.02 * far,
        far + 12.0 * stage.size,
    )


def painted(
    stage: Stage, time: float, look: Look3D, width: int, height: int, *, joints: bool, forces: bool
) -> NDArray[np.uint8]:
    """Return a picture of a stage at a time, (height, width, 3)."""
    camera = camera_of(stage, time, _FINER * width, _FINER * height)
    solid = placing.bodies(stage, time) + placing.cords(stage, time, look, camera.thin)
    solid += placing.rails(stage, time)
    hinges = placing.joints(stage, time, look) if joints else []  # seen through what is around them
    solid += placing.arrows(stage, time, look, camera.thin) if forces else []
    ghost = placing.bodies(stage, time, ghost=look.ghost)
    paths = placing.traces(stage, time, look, camera.thin)
    yaw = np.radians(stage.scene.azimuth) - 0.65
    light = np.array([0.6 * np.cos(yaw), 0.6 * np.sin(yaw), 1.0])
    light /= np.linalg.norm(light)
    lamp = _Lamp(stage, camera, light, [each for each in solid if not each.flat])
    # The floor has no sharp edges of its own, so the picture's own pixels do for it.
    coarse = replace(camera, lens=camera.lens / _FINER, width=width, height=height)
    image = np.repeat(np.repeat(_ground(stage, coarse, look, lamp), _FINER, axis=0), _FINER, axis=1)
    depth = np.full(image.shape[:2], np.inf)
    for layer, amid in ((ghost, False), (solid, True), (paths, True), (hinges, False)):
        _lay(layer, camera, look, lamp, image, depth if amid else np.full(image.shape[:2], np.inf))
    parts = [image[i::_FINER, j::_FINER] for i in range(_FINER) for j in range(_FINER)]
    fine = sum(parts) / len(parts)
    return np.asarray(np.clip(fine, 0.0, 1.0) * 255.0 + 0.5, dtype=np.uint8)


def _lay(layer: Sequence[Thing], camera: Camera, look: Look3D, lamp: _Lamp, image: Array, depth: Array) -> None:
    """Paint things over a picture, where they are nearer than what is there; only the nearest of them is seen."""
    if not layer:
        return
    mesh = _Mesh(layer)
    x, y, z, ahead = camera.picture(mesh.p)
    index = mesh.triangles
    number = visible(x[index], y[index], z[index], camera.width, camera.height)
    row, column = np.nonzero(number >= 0)
    seen = index[number[row, column]]
    share = weights(x[seen], y[seen], column + 0.5, row + 0.5) / ahead[seen]
    far = 1.0 / share.sum(axis=1)
    nearer = far < depth[row, column]
    row, column, seen, far = row[nearer], column[nearer], seen[nearer], far[nearer]
    share = share[nearer] * far[:, None]
    place = np.einsum("nk,nkc->nc", share, mesh.p[seen])
    smooth = np.einsum("nk,nkc->nc", share, mesh.n[seen])
    corners = mesh.p[seen]
    sharp = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    of = mesh.thing[number[row, column]]
    colour = _lit(place, _unit(smooth), _unit(sharp), mesh.colour[of], mesh.flat[of], camera, look, lamp)
    alpha = mesh.colour[of][:, 3:]
    image[row, column] = alpha * colour + (1.0 - alpha) * image[row, column]
    whole = alpha[:, 0] >= 1.0
    depth[row[whole], column[whole]] = far[whole]


def _unit(v: Array) -> Array:
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1), 1e-300)[:, None])


class _Mesh:
    """Things as one mesh: vertices, normals, triangles, the thing of each triangle, and what things have."""

    def __init__(self, layer: Sequence[Thing]) -> None:
        starts = np.cumsum([0, *(len(each.vertices) for each in layer)])
        self.p = np.concatenate([each.vertices for each in layer])
        self.n = np.concatenate([each.normals for each in layer])
        self.triangles = np.concatenate([e.solid.triangles + s for e, s in zip(layer, starts[:-1], strict=True)])
        self.thing = np.repeat(np.arange(len(layer)), [len(each.solid.triangles) for each in layer])
        self.colour = np.array([each.colour for each in layer])
        self.flat = np.array([each.flat for each in layer])


class _Lamp:
    """The light, and what it does not reach: a picture of depths that is seen along it."""

    def __init__(self, stage: Stage, camera: Camera, light: Array, layer: Sequence[Thing]) -> None:
        self.light = light
        x = np.cross([0.0, 0.0, 1.0], light)
        x /= np.linalg.norm(x)
        self.axes = np.array([x, np.cross(light, x), light])
        self.reach = 1.1 * stage.size
        middle = camera.eye + 1.45 * stage.size * camera.axes[2]
        self.middle = np.array([middle[0], middle[1], stage.floor + 0.4 * self.reach])
        self.lift = 6.0 * self.reach / _SHADOW
        self.depth = np.full((_SHADOW, _SHADOW), np.inf)
        if layer:
            mesh = _Mesh(layer)
            px, py, depth = self._seen(mesh.p)
            index = mesh.triangles
            number = visible(px[index], py[index], 0.5 + depth[index] / (8.0 * self.reach), _SHADOW, _SHADOW)
            row, column = np.nonzero(number >= 0)
            seen = index[number[row, column]]
            share = weights(px[seen], py[seen], column + 0.5, row + 0.5)
            self.depth[row, column] = np.sum(share * depth[seen], axis=1)
        self.near = np.zeros((_SHADOW, _SHADOW), dtype=bool)  # something is there, or within two pixels
        there = np.pad(np.isfinite(self.depth[3:-3, 3:-3]), 3)
        for dx in range(-2, 3):
            for dy in range(-2, 3):
                self.near |= np.roll(there, (dx, dy), axis=(0, 1))

    def _seen(self, places: Array) -> tuple[Array, Array, Array]:
        """Return x, y in the lamp's picture (pixels), and the distance along its light."""
        a, b, c = self.axes @ (places - self.middle).T
        scale = 0.5 * _SHADOW / self.reach
        return 0.5 * _SHADOW + scale * a, 0.5 * _SHADOW + scale * b, -c

    def reaches(self, places: Array) -> Array:
        """Return how much of the light reaches places (n, 3), 0 to 1; soft at the edges of shadows."""
        px, py, depth = self._seen(places)
        i, j = (np.clip(p, 0, _SHADOW - 1).astype(int) for p in (py, px))
        found = np.ones(len(places))
        near = np.flatnonzero(self.near[i, j])  # elsewhere nothing is in its way
        px, py, depth = px[near], py[near], depth[near]
        total = np.zeros(len(near))
        for dx in (-1.5, -0.5, 0.5, 1.5):
            for dy in (-1.5, -0.5, 0.5, 1.5):
                i, j = (np.clip(p, 0, _SHADOW - 1).astype(int) for p in (py + dy, px + dx))
                total += depth <= self.depth[i, j] + 0.5 * self.lift
        found[near] = total / 16.0
        return found


def _lit(
    place: Array, smooth: Array, sharp: Array, colour: Array, flat: Array, camera: Camera, look: Look3D, lamp: _Lamp
) -> Array:
    """Return the colours of places of a surface, (n, 3), as the page's shader does."""
    view = _unit(camera.eye - place)
    f = sharp * np.where(np.sum(sharp * view, axis=1) < 0.0, -1.0, 1.0)[:, None]
    m = smooth * np.where(np.sum(smooth * f, axis=1) < 0.0, -1.0, 1.0)[:, None]
    blend = _step(0.55, 0.8, np.sum(m * f, axis=1))[:, None]
    m = _unit(f + blend * (m - f))
    base = colour[:, :3] ** 2.2
    facing = np.maximum(m @ lamp.light, 0.0)
    sun = 1.0 + _step(0.02, 0.3, facing) * (lamp.reaches(place + lamp.lift * m) - 1.0)
    sun = np.where(facing > 0.0, sun, 0.0)
    sky = look.earth + (0.5 + 0.5 * m[:, 2:]) * (look.ambient - look.earth)
    shown = base * (sky + 0.8 * (facing * sun)[:, None])
    half = _unit(lamp.light + view)
    shown += (0.10 * sun * np.maximum(np.sum(m * half, axis=1), 0.0) ** 40)[:, None]
    shown += 0.05 * ((1.0 - np.maximum(np.sum(m * view, axis=1), 0.0)) ** 3)[:, None] * look.ambient
    return np.asarray((shown + flat[:, None] * (base - shown)) ** (1.0 / 2.2))


def _step(low: float, high: float, x: Array) -> Array:
    """Return GLSL's smoothstep."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _ground(stage: Stage, camera: Camera, look: Look3D, lamp: _Lamp) -> Array:
    """Return the background: sky and paper, the floor's grid and the shadow on it."""
    height = np.linspace(0.0, 1.0, camera.height)[:, None, None]
    image = np.broadcast_to(look.sky + height * (look.paper - look.sky), (camera.height, camera.width, 3)).copy()
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    ray = np.stack(
        ((x - 0.5 * camera.width) / camera.lens, (0.5 * camera.height - y) / camera.lens, np.ones_like(x)), -1
    )
    ray = ray @ camera.axes
    drop = stage.floor - camera.eye[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = drop / ray[..., 2]
    cell = grid_of(stage.size)
    reach = max(9.0 * cell, 3.0 * stage.size)
    at = camera.eye[:2] + along[..., None] * ray[..., :2]
    middle = camera.eye[:2] + 1.45 * stage.size * camera.axes[2][:2]
    far = np.linalg.norm(at - middle, axis=-1) / reach
    seen = (along > 0.0) & (far < 1.0)
    g = at / cell
    wide = [np.abs(np.gradient(g[..., c], axis=0)) + np.abs(np.gradient(g[..., c], axis=1)) for c in (0, 1)]
    apart = [np.abs((g[..., c] - 0.5) % 1.0 - 0.5) / np.maximum(wide[c], 1e-9) for c in (0, 1)]
    line = np.clip(1.1 - np.minimum(*apart), 0.0, 1.0) * np.clip(1.0 - 2.5 * np.maximum(*wide), 0.0, 1.0)
    row, column = np.nonzero(seen)
    fade = 1.0 - far[row, column]
    places = np.column_stack((at[row, column], np.full(len(row), stage.floor)))
    dark = (1.0 - lamp.reaches(places)) * look.shade * _step(0.0, 0.25, fade)
    a = (0.8 * line[row, column] * fade)[:, None]
    image[row, column] = (image[row, column] * (1.0 - a) + a * look.line) * (1.0 - dark[:, None])
    return image


def grid_of(size: float) -> float:
    """Return the side of the floor's squares (m)."""
    power = float(10.0 ** np.floor(np.log10(size)))
    return power * (0.25 if size < 2.5 * power else 0.5 if size < 5.0 * power else 1.0)
