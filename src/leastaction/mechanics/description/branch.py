"""Trees of frames under construction: chained calls and nested lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy.typing as npt

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.affine import CoordinateLike
from leastaction.mechanics.description.compositions import Composition, ball, free, universal
from leastaction.mechanics.description.frames import (
    Frame,
    FrameOptions,
    JointOptions,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.mechanics.description.joints import prismatic, revolute, screw, twist
from leastaction.mechanics.description.poses import pose
from leastaction.numerics.names import check_name


class Branch:
    """A place in a tree under construction, to which further frames are chained.

    Made by `world`. Each of `tx ty tz rx ry rz pose twist screw revolute prismatic universal ball free`
    puts a frame on this one and returns the place of the new frame (of a composition: of its last one), so
    calls can be chained; several calls on one place make its several children. It grows: for one thread.

    Attributes
    ----------
    frame : Frame or None
        The frame at this place; None at the world.
    parent : Branch or None
        The place that this one is chained to.
    children : list of Branch
    """

    __slots__ = ("children", "frame", "parent", "world_name")

    def __init__(
        self, frame: Frame | None, parent: Branch | None = None, *, world_name: str = "world"
    ) -> None:
        self.frame = frame
        self.parent = parent
        self.world_name = world_name
        self.children: list[Branch] = []

    @property
    def root(self) -> Branch:
        """The world at the bottom of the tree."""
        place = self
        while place.parent is not None:
            place = place.parent
        return place

    def __reduce__(self) -> tuple[Any, ...]:
        # Of a whole tree, without recursion: a chain may be longer than Python recurses.
        places, parents = preorder(self.root)
        index = next(i for i, place in enumerate(places) if place is self)
        frames = [place.frame for place in places]
        return _grown, (self.root.world_name, frames, parents, index)

    def put(self, frame: Frame | Composition) -> Branch:
        """Put a frame on this one and return the place of the new frame."""
        if isinstance(frame, Composition):
            place = self
            for part in frame.frames:
                place = place.put(part)
            return place
        if not isinstance(frame, Frame):
            raise DescriptionError(
                f"put: expected a frame such as tx('x') or pose(...), got {frame!r}; "
                "use add for a nested list"
            )
        child = Branch(frame, self)
        self.children.append(child)
        return child

    def add(self, description: Sequence[Any]) -> Branch:
        """Put a nested list of frames on this one and return this same place."""
        # Read to the side first, so that a broken list leaves this tree as it was.
        side = Branch(None)
        read_nested(description, side)
        for child in side.children:
            child.parent = self
        self.children.extend(side.children)
        return self

    def tx(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a translation along x; see `tx`."""
        return self.put(tx(value, **options))

    def ty(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a translation along y; see `ty`."""
        return self.put(ty(value, **options))

    def tz(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a translation along z; see `tz`."""
        return self.put(tz(value, **options))

    def rx(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a rotation about x; see `rx`."""
        return self.put(rx(value, **options))

    def ry(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a rotation about y; see `ry`."""
        return self.put(ry(value, **options))

    def rz(self, value: CoordinateLike, **options: Unpack[JointOptions]) -> Branch:
        """Chain a rotation about z; see `rz`."""
        return self.put(rz(value, **options))

    def pose(
        self,
        matrix: npt.ArrayLike | None = None,
        *,
        translation: npt.ArrayLike | None = None,
        rotation: npt.ArrayLike | None = None,
        **options: Unpack[FrameOptions],
    ) -> Branch:
        """Chain a constant pose; see `pose`."""
        return self.put(pose(matrix, translation=translation, rotation=rotation, **options))

    def twist(
        self,
        value: CoordinateLike,
        *,
        linear: npt.ArrayLike = (0.0, 0.0, 0.0),
        angular: npt.ArrayLike = (0.0, 0.0, 0.0),
        **options: Unpack[JointOptions],
    ) -> Branch:
        """Chain a motion along a twist; see `twist`."""
        return self.put(twist(value, linear=linear, angular=angular, **options))

    def screw(
        self,
        value: CoordinateLike,
        *,
        axis: npt.ArrayLike | str,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        pitch: float,
        **options: Unpack[JointOptions],
    ) -> Branch:
        """Chain a screw, its pitch in metres per radian; see `screw`."""
        return self.put(screw(value, axis=axis, point=point, pitch=pitch, **options))

    def revolute(
        self,
        value: CoordinateLike,
        *,
        axis: npt.ArrayLike | str,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        **options: Unpack[JointOptions],
    ) -> Branch:
        """Chain a rotation about any axis; see `revolute`."""
        return self.put(revolute(value, axis=axis, point=point, **options))

    def prismatic(
        self, value: CoordinateLike, *, axis: npt.ArrayLike | str, **options: Unpack[JointOptions]
    ) -> Branch:
        """Chain a translation along any axis; see `prismatic`."""
        return self.put(prismatic(value, axis=axis, **options))

    def universal(
        self,
        variables: str | Sequence[CoordinateLike],
        *,
        axes: str = "xy",
        kinematic: bool | Sequence[str] = False,
        **options: Unpack[FrameOptions],
    ) -> Branch:
        """Chain a universal joint; see `universal`."""
        return self.put(universal(variables, axes=axes, kinematic=kinematic, **options))

    def ball(
        self,
        variables: str | Sequence[CoordinateLike],
        *,
        axes: str = "xyz",
        kinematic: bool | Sequence[str] = False,
        **options: Unpack[FrameOptions],
    ) -> Branch:
        """Chain a ball joint in Euler angles; see `ball`."""
        return self.put(ball(variables, axes=axes, kinematic=kinematic, **options))

    def free(
        self,
        variables: str | Sequence[CoordinateLike],
        *,
        axes: str = "xyz",
        kinematic: bool | Sequence[str] = False,
        **options: Unpack[FrameOptions],
    ) -> Branch:
        """Chain three translations and a ball joint; see `free`."""
        return self.put(free(variables, axes=axes, kinematic=kinematic, **options))

    def __repr__(self) -> str:
        place = self.world_name if self.frame is None else repr(self.frame)
        return f"<Branch at {place}, {len(self.children)} children>"


def world(name: str = "world") -> Branch:
    """Start a tree of frames at the fixed world frame.

    Parameters
    ----------
    name : str, optional
        Name of the world frame.

    Returns
    -------
    Branch
    """
    return Branch(None, world_name=check_name(name, "the name of the world frame"))


def preorder(root: Branch) -> tuple[list[Branch], list[int]]:
    """Return the places of a tree from the world on, depth first, and the index of each one's parent (-1)."""
    places: list[Branch] = []
    parents: list[int] = []
    # An explicit stack: a chain may be longer than Python recurses.
    stack = [(root, -1)]
    while stack:
        place, parent = stack.pop()
        stack.extend((child, len(places)) for child in reversed(place.children))
        places.append(place)
        parents.append(parent)
    return places, parents


def _grown(
    world_name: str, frames: Sequence[Frame | None], parents: Sequence[int], index: int
) -> Branch:
    places = [Branch(None, world_name=world_name)]
    for frame, parent in zip(frames[1:], parents[1:], strict=True):
        assert frame is not None
        places.append(places[parent].put(frame))
    return places[index]


def check_once(frame: Frame, seen: set[int]) -> None:
    """Note that a frame has been met; raise a `DescriptionError` if it had been met before."""
    if id(frame) in seen:
        raise DescriptionError(
            f"the frame {frame!r} stands in two places of the tree (a cycle, or one object used twice); "
            "make a new frame for each place, for example with a function that returns a limb"
        )
    seen.add(id(frame))


def read_nested(description: Sequence[Any], place: Branch) -> None:
    """Put a nested list of frames on a place of a tree.

    Parameters
    ----------
    description : list
        Frames, each of which may be followed by the list of its children.
    place : Branch
        The place that the outermost frames are put on.

    Raises
    ------
    DescriptionError
        If something else than a frame or a list is met, a list does not follow a frame, a list holds
        itself, or a frame stands in two places.
    """
    if not isinstance(description, (list, tuple)):
        raise DescriptionError(
            "the description: expected a list of frames, each followed by the list of its children, or "
            f"the result of chained calls, got {type(description).__name__}"
        )
    # An explicit stack: a chain of a thousand links nests deeper than Python may recurse.
    open_lists = {id(description)}
    seen: set[int] = set()
    stack = [(description, place, 0)]
    while stack:
        items, parent, position = stack.pop()
        if position == len(items):
            open_lists.discard(id(items))
            continue
        item = items[position]
        if not isinstance(item, (Frame, Composition)):
            raise DescriptionError(_misplaced(item, position, parent))
        for frame in (item,) if isinstance(item, Frame) else item.frames:
            check_once(frame, seen)
        child = parent.put(item)
        children = items[position + 1] if position + 1 < len(items) else None
        if not isinstance(children, (list, tuple)):
            stack.append((items, parent, position + 1))
            continue
        if id(children) in open_lists:
            raise DescriptionError(
                f"cycle: the list of children of {item!r} holds itself; a mechanism is a tree, and a "
                "loop is closed by a constraint such as Distance"
            )
        stack.append((items, parent, position + 2))
        stack.append((children, child, 0))
        open_lists.add(id(children))


def _misplaced(item: object, position: int, parent: Branch) -> str:
    where = "the world" if parent.frame is None else repr(parent.frame)
    if isinstance(item, (list, tuple)):
        before = "stands first" if position == 0 else "follows another list"
        return (
            f"the children of {where}: a list {before}, so it has no frame to belong to; "
            "each list of children stands right after its frame"
        )
    if callable(item):
        return f"the children of {where}: got {item!r}; call it, as in tx('x')"
    return (
        f"the children of {where}: expected a frame such as tx('x') or pose(...), "
        f"got {item!r} ({type(item).__name__}) at position {position}"
    )
