"""What a picture of a mechanism needs: points over time, and bones and cords between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array

_SLENDERNESS = 0.04  # radius of a bone that none was given for, by the mean length of the bones


@dataclass(frozen=True, kw_only=True)
class Bone:
    """A rounded bar between two points, or a ball where both are the same.

    Parameters
    ----------
    start, end
        Names of the two points.
    radius
        Half the thickness, m.
    """

    start: str
    end: str
    radius: float


@dataclass(frozen=True, kw_only=True)
class Cord:
    """A thin line between two points, coloured by its tension where that is known.

    Parameters
    ----------
    name
        What it is called; the key of its tension.
    start, end
        Names of the two points; ``end`` is where it is held.
    """

    name: str
    start: str
    end: str


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A mechanism in motion, ready to be drawn; z points up.

    Parameters
    ----------
    t
        Times, (N+1,), s, growing.
    points
        Names of the points and their positions, each (N+1, 3), m.
    bones, cords
        What is drawn between the points.
    ghost
        Positions of the reference pose, under the same names, for as many points as are known; bones
        whose two points are in it are drawn a second time, translucent.
    tension
        Tension of each cord by its name, (N,) or (N+1,), N; negative is slack.
    error
        Tracking error at each time, (N+1,), degrees.
    traces
        Names of the points whose paths are drawn.
    focus
        Name of the point that the camera follows; the first one when empty.
    ground
        Height of the floor, m; the lowest point of any bone when None.
    title
        Heading.

    Raises
    ------
    ArgumentError
        An array has the wrong shape or holds NaN, or a name is unknown.
    """

    t: Array
    points: Mapping[str, Array]
    bones: tuple[Bone, ...]
    cords: tuple[Cord, ...] = ()
    ghost: Mapping[str, Array] | None = None
    tension: Mapping[str, Array] | None = None
    error: Array | None = None
    traces: tuple[str, ...] = ()
    focus: str = ""
    ground: float | None = None
    title: str = "leastaction"

    def __post_init__(self) -> None:
        """Check names, shapes and values."""
        n = self.t.size
        if self.t.ndim != 1 or n < 2 or not np.all(np.diff(self.t) > 0.0):
            raise ArgumentError(f"t must be at least two growing times, got shape {self.t.shape}")
        if not self.points:
            raise ArgumentError("a scene needs at least one point")
        for label, group in (("point", self.points), ("ghost point", self.ghost or {})):
            for name, path in group.items():
                if path.shape != (n, 3) or not np.all(np.isfinite(path)):
                    raise ArgumentError(f"{label} {name!r} must be ({n}, 3) finite numbers, got {path.shape}")
        lines: tuple[Bone | Cord, ...] = (*self.bones, *self.cords)
        used = {name for line in lines for name in (line.start, line.end)}
        used |= {*self.traces, self.focus or next(iter(self.points))}
        if unknown := sorted(used - set(self.points)):
            raise ArgumentError(f"no point is called {', '.join(unknown)}; there are: {', '.join(self.points)}")
        cords = {cord.name for cord in self.cords}
        for name, values in (self.tension or {}).items():
            if name not in cords or values.shape not in ((n - 1,), (n,)):
                raise ArgumentError(
                    f"tension {name!r} with shape {values.shape} fits no cord over {n} times; "
                    f"cords: {', '.join(sorted(cords))}"
                )
        if self.error is not None and self.error.shape != (n,):
            raise ArgumentError(f"error has shape {self.error.shape}, expected ({n},)")

    @property
    def floor(self) -> float:
        """Height of the floor, m: as given, or just under the lowest bone."""
        if self.ground is not None:
            return self.ground
        heights = [
            float(self.points[name][:, 2].min()) - bone.radius for bone in self.bones for name in (bone.start, bone.end)
        ]
        return min(heights, default=float(min(path[:, 2].min() for path in self.points.values())))

    @property
    def followed(self) -> str:
        """Name of the point that the camera follows."""
        return self.focus or next(iter(self.points))

    def tension_at(self, name: str, times: Array) -> Array:
        """Return the tension of a cord at other times, (len(times),), N; 0 where it is unknown.

        Values given one per step belong to the middle of the step.
        """
        values = None if self.tension is None else self.tension.get(name)
        if values is None:
            return np.zeros(times.size)
        own = self.t if values.size == self.t.size else 0.5 * (self.t[:-1] + self.t[1:])
        return np.interp(times, own, values)


def mechanism_scene(
    mechanism: Mechanism,
    t: ArrayLike,
    q: ArrayLike,
    *,
    bones: Sequence[Bone] | None = None,
    cords: Sequence[Cord] = (),
    reference: ArrayLike | None = None,
    tension: ArrayLike | None = None,
    error: ArrayLike | None = None,
    traces: Sequence[str] = (),
    focus: str = "",
    title: str = "leastaction",
) -> Scene:
    """Make a scene of a motion of any mechanism; its points are the origins of frames.

    Parameters
    ----------
    mechanism
        What moves.
    t
        Times, (N+1,), s.
    q
        Configurations, (N+1, nq).
    bones
        What is drawn between the frames; if not given, a bar from every frame to the one that carries it
        where they are apart.
    cords
        Thin lines between frames, such as strings and springs.
    reference
        Configurations to be followed, (N+1, nq): the bones are drawn in them too, as a ghost.
    tension
        Tension of each cord, (N, len(cords)) or (N+1, len(cords)), N.
    error, traces, focus, title
        As in `Scene`.

    Raises
    ------
    ArgumentError
        The arrays do not fit the mechanism or each other, or a name is no frame.
    """
    motion = np.asarray(q, dtype=float)
    shown = tuple(_bars(mechanism, motion) if bones is None else bones)
    lines: tuple[Bone | Cord, ...] = (*shown, *cords)
    ends = [name for line in lines for name in (line.start, line.end)]
    points = _paths(mechanism, motion, [*ends, *traces, *([focus] if focus else [])])
    ghost = None
    if reference is not None:
        body = [name for bone in shown for name in (bone.start, bone.end)]
        ghost = _paths(mechanism, np.asarray(reference, dtype=float), body)
    pulls = None
    if tension is not None:
        array = np.asarray(tension, dtype=float)
        if array.ndim != 2 or array.shape[1] != len(cords):
            raise ArgumentError(f"tension has shape {array.shape}, expected (N, {len(cords)})")
        pulls = {cord.name: array[:, i] for i, cord in enumerate(cords)}
    return Scene(
        t=np.asarray(t, dtype=float),
        points=points,
        bones=shown,
        cords=tuple(cords),
        ghost=ghost,
        tension=pulls,
        error=None if error is None else np.asarray(error, dtype=float),
        traces=tuple(traces),
        focus=focus,
        title=title,
    )


def _paths(mechanism: Mechanism, q: Array, names: Sequence[str]) -> dict[str, Array]:
    """Return the paths of frames by name, each (N+1, 3)."""
    unique = list(dict.fromkeys(names))
    positions = mechanism.positions(q, unique)
    return {name: positions[:, i] for i, name in enumerate(unique)}


def _bars(mechanism: Mechanism, q: Array) -> list[Bone]:
    """Return a bone from every frame to its parent, where they are apart."""
    frames = mechanism.tree.frames
    places = mechanism.positions(q)
    apart = {
        i: float(np.linalg.norm(places[:, i] - places[:, frame.parent], axis=1).max())
        for i, frame in enumerate(frames)
        if frame.parent >= 0
    }
    long = {i: length for i, length in apart.items() if length > 1e-9}
    radius = _SLENDERNESS * float(np.mean(list(long.values()))) if long else 0.0
    return [Bone(start=frames[frames[i].parent].name, end=frames[i].name, radius=radius) for i in long]
