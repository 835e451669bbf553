"""Trees of frames under construction: chained calls and nested lists."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Concatenate, ParamSpec

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.compositions import Composition, ball, free, universal
from leastaction.mechanics.description.frames import Frame, rx, ry, rz, tx, ty, tz
from leastaction.mechanics.description.joints import prismatic, revolute, screw, twist
from leastaction.mechanics.description.poses import pose
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

P = ParamSpec("P")


def _chained(make: Callable[P, Frame | Composition]) -> Callable[Concatenate[Branch, P], Branch]:
    """Return a function that makes a frame as the method that puts it on a branch."""

    def chain(self: Branch, /, *args: P.args, **options: P.kwargs) -> Branch:
        return self.put(make(*args, **options))

    chain.__name__ = make.__name__
    chain.__qualname__ = f"Branch.{make.__name__}"
    chain.__doc__ = f"Put a frame on this one and return its place; see `{make.__name__}`."
    return chain


@public
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

    def __init__(self, frame: Frame | None, parent: Branch | None = None, *, world_name: str = "world") -> None:
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
        return grown, (self.root.world_name, frames, parents, index)

    def put(self, frame: Frame | Composition) -> Branch:
        """Put a frame on this one and return the place of the new frame."""
        if isinstance(frame, Composition):
            place = self
            for part in frame.frames:
                place = place.put(part)
            return place
        if not isinstance(frame, Frame):
            raise DescriptionError(
                f"put: expected a frame such as tx('x') or pose(...), got {frame!r}; use add for a nested list"
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

    tx, ty, tz = _chained(tx), _chained(ty), _chained(tz)
    rx, ry, rz = _chained(rx), _chained(ry), _chained(rz)
    pose, twist, screw = _chained(pose), _chained(twist), _chained(screw)
    revolute, prismatic = _chained(revolute), _chained(prismatic)
    universal, ball, free = _chained(universal), _chained(ball), _chained(free)


@public
def world(name: str = "world") -> Branch:
    """Start a tree of frames at the fixed world frame.

    Parameters
    ----------
    name : str, optional
        Name of the world frame.
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


def grown(world_name: str, frames: Sequence[Frame | None], parents: Sequence[int], index: int) -> Branch:
    """Return a place, by its index, of the tree that `preorder` takes apart; its first frame is that of the world."""
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

    ``description``: frames, each of which may be followed by the list of its children. ``place``: the place that the
    outermost frames are put on. Raises `DescriptionError` if something else than a frame or a list is met, a list does
    not follow a frame, a list holds itself, or a frame stands in two places.
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
