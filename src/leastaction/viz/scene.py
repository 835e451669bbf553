"""What a picture of a mechanism needs: points over time, bones and cords between them, and shapes on frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism
from leastaction.mechanics.description.shapes import Shape
from leastaction.mechanics.elements.looks import LookKind
from leastaction.numerics.arrays import Array, as_array, require_instance
from leastaction.numerics.public import public

_SLENDERNESS = 0.04  # radius of a bone that none was given for, by the mean length of the bones


@public
@dataclass(frozen=True, kw_only=True)
class Bone:
    """A rounded bar between two points, or a ball where both are the same.

    Parameters
    ----------
    start, end
        Names of the two points.
    radius
        Half the thickness, m.
    color
        Red, green, blue and opacity, 0 to 1; the viewer's own if not given.
    """

    start: str
    end: str
    radius: float
    color: tuple[float, float, float, float] | None = None


@public
@dataclass(frozen=True, kw_only=True)
class Cord:
    """A thin line between two points, coloured by its tension where that is known.

    Parameters
    ----------
    name
        What it is called; the key of its tension.
    start, end
        Names of the two points; ``end`` is where it is held.
    via
        Names of the points between them, in order.
    kind
        What it is drawn as: a string or rod by default a line, a spring as a coil, a damper and a motor as cylinders.
    """

    name: str
    start: str
    end: str
    via: tuple[str, ...] = ()
    kind: LookKind = "string"

    @property
    def path(self) -> tuple[str, ...]:
        """All its points, in order."""
        return (self.start, *self.via, self.end)


@public
@dataclass(frozen=True, kw_only=True)
class Arrow:
    """A force or a torque, drawn as an arrow where it acts.

    Parameters
    ----------
    name
        What exerts it.
    kind
        Whether it is an input's or a reaction's, a force or a torque.
    place, vector
        Where it acts (m), and the force (N) or torque (N m), each (N+1, 3).
    """

    name: str
    kind: Literal["force", "torque", "reaction"]
    place: Array
    vector: Array


@public
@dataclass(frozen=True, kw_only=True)
class JointMark:
    """Where a joint is: drawn on demand, the rail of a slide always.

    Parameters
    ----------
    name
        Of the joint: its variables, or its frame.
    kind
        "hinge", "slide" or "ball".
    frame
        Name of the frame, among the poses, in whose axes the rest is.
    point, axis
        A point of its axis (m), and the axis' direction, (3,).
    reach
        Of a slide: from where to where along the axis it is drawn (m).
    """

    name: str
    kind: Literal["hinge", "slide", "ball"]
    frame: str
    point: Array
    axis: Array
    reach: tuple[float, float] = (0.0, 0.0)


@public
@dataclass(frozen=True, kw_only=True)
class ActiveLimit:
    """When a limit holds the motion back: its words, and the spans of time (s)."""

    name: str
    spans: tuple[tuple[float, float], ...]


@public
@dataclass(frozen=True, kw_only=True)
class Scene:
    """A mechanism in motion, ready to be drawn; z points up.

    Parameters
    ----------
    t
        Times, (N+1,), s, growing; one alone is a scene that stands still.
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
        Name of the point that the camera follows; when empty it stays where it is.
    base
        Name of the frame of the world: shapes on it that are far from everything else do not count for the camera.
    ground
        Height of the floor, m; the lowest point of any bone when None.
    title
        Heading.
    poses
        Names of frames that carry shapes or joints, and their poses, each (N+1, 4, 4).
    ghost_poses
        Poses of the reference, under the same names; shapes on frames that are in it are drawn translucent too.
    shapes
        Primitives and meshes on these frames.
    arrows, marks, limits
        Forces, joints, and when which limit is active.
    azimuth, elevation
        From where it is first seen: about the vertical from the x axis, and above the floor (degrees).
    nearer
        How many times nearer than where all of a pose is in sight.
    kinematics
        How joints move the frames of what stands still, for the page's sliders; see `kinematics`.

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
    base: str = ""
    ground: float | None = None
    title: str = "leastaction"
    poses: Mapping[str, Array] = field(default_factory=dict)
    ghost_poses: Mapping[str, Array] | None = None
    shapes: tuple[Shape, ...] = ()
    arrows: tuple[Arrow, ...] = ()
    marks: tuple[JointMark, ...] = ()
    limits: tuple[ActiveLimit, ...] = ()
    azimuth: float = 50.0
    elevation: float = 9.0
    nearer: float = 1.0
    kinematics: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        """Check names, shapes and values."""
        groups = (self.points, self.poses, self.ghost or {}, self.ghost_poses or {}, self.tension or {})
        for name, given in {**dict(pair for group in groups for pair in group.items()), "t": self.t}.items():
            require_instance(given, name, np.ndarray)
        if self.error is not None:
            require_instance(self.error, "error", np.ndarray)
        n = self.t.size
        if self.t.ndim != 1 or n < 1 or not np.all(np.diff(self.t) > 0.0):
            raise ArgumentError(f"t must be growing times, got shape {self.t.shape}")
        if not self.points:
            raise ArgumentError("a scene needs at least one point")
        for name, path in (*self.poses.items(), *(self.ghost_poses or {}).items()):
            if path.shape != (n, 4, 4) or not np.all(np.isfinite(path)):
                raise ArgumentError(f"pose {name!r} must be ({n}, 4, 4) finite numbers, got {path.shape}")
        carriers = {shape.frame for shape in self.shapes} | {mark.frame for mark in self.marks}
        if unknown := sorted(carriers - set(self.poses)):
            raise ArgumentError(f"no pose is called {', '.join(unknown)}; there are: {', '.join(self.poses)}")
        for label, group in (("point", self.points), ("ghost point", self.ghost or {})):
            for name, path in group.items():
                if path.shape != (n, 3) or not np.all(np.isfinite(path)):
                    raise ArgumentError(f"{label} {name!r} must be ({n}, 3) finite numbers, got {path.shape}")
        lines: tuple[Bone | Cord, ...] = (*self.bones, *self.cords)
        used = {name for line in lines for name in (line.start, line.end)}
        used |= {name for cord in self.cords for name in cord.via}
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

    @property
    def strongest(self) -> dict[str, float]:
        """How much the longest arrow of each kind stands for."""
        found: dict[str, float] = {}
        for arrow in self.arrows:
            found[arrow.kind] = max(found.get(arrow.kind, 1e-12), float(np.linalg.norm(arrow.vector, axis=1).max()))
        return found

    @property
    def top_tension(self) -> float:
        """The tension that is drawn in the strongest colour, N: all but half a percent of the time it is less."""
        return max([1e-9, *(float(np.quantile(pull, 0.995)) for pull in (self.tension or {}).values())])

    def tension_at(self, name: str, times: Array) -> Array:
        """Return the tension of a cord at other times, (len(times),), N; 0 where it is unknown.

        Values given one per step belong to the middle of the step.
        """
        values = None if self.tension is None else self.tension.get(name)
        if values is None:
            return np.zeros(times.size)
        own = self.t if values.size == self.t.size else 0.5 * (self.t[:-1] + self.t[1:])
        return np.interp(times, own, values)


@public
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
    times = as_array(t, "t", (None,))
    shape = (len(times), mechanism.nq)
    motion = as_array(q, "q", shape, names=mechanism.coordinates)
    shown = tuple(_bars(mechanism, motion) if bones is None else bones)
    lines: tuple[Bone | Cord, ...] = (*shown, *cords)
    ends = [name for line in lines for name in (line.start, line.end)]
    points = _paths(mechanism, motion, [*ends, *traces, *([focus] if focus else [])])
    ghost = None
    if reference is not None:
        body = [name for bone in shown for name in (bone.start, bone.end)]
        ghost = _paths(mechanism, as_array(reference, "reference", shape, names=mechanism.coordinates), body)
    pulls = None
    if tension is not None:
        array = as_array(tension, "tension", (None, len(cords)), meaning="a pull of each cord")
        pulls = {cord.name: array[:, i] for i, cord in enumerate(cords)}
    return Scene(
        t=times,
        points=points,
        bones=shown,
        cords=tuple(cords),
        ghost=ghost,
        tension=pulls,
        error=None if error is None else as_array(error, "error", (len(times),)),
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
    places = mechanism.positions(q, list(mechanism.tree.index))
    apart = {
        i: float(np.linalg.norm(places[:, i] - places[:, frame.parent], axis=1).max())
        for i, frame in enumerate(frames)
        if frame.parent >= 0
    }
    long = {i: length for i, length in apart.items() if length > 1e-9}
    radius = _SLENDERNESS * float(np.mean(list(long.values()))) if long else 0.0
    return [Bone(start=frames[frames[i].parent].name, end=frames[i].name, radius=radius) for i in long]
