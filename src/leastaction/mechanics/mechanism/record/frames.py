"""Frames as plain data, and back: bit by bit, names and order included."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from leastaction.errors import DescriptionError, ModelFileError, closest
from leastaction.mechanics.description import compositions, frames, joints, poses
from leastaction.mechanics.description.affine import Affine, as_affine
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.branch import Branch, preorder, world
from leastaction.mechanics.description.flattening import frame_names, place_frames
from leastaction.mechanics.description.frames import PRIMITIVES, Frame
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.mechanism.record.types import BodyRecord, CompositionRecord, FrameRecord
from leastaction.numerics.arrays import Array
from leastaction.numerics.documents import Document, Place

_DEEPEST = 16  # frames in frames, as text may nest them; what hangs deeper names its parent
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(frames, name) for name in PRIMITIVES},
    **{name: getattr(joints, name) for name in ("twist", "revolute", "screw", "prismatic")},
    **{name: getattr(compositions, name) for name in ("universal", "ball", "free")},
    "pose": poses.pose,
}
# What looks like a number with a unit is not taken for the name of a variable.
UNIT = re.compile(
    r"^[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?\s*(?:deg\w*|°|rad\w*|turns?|[nµumck]?m|in|ft|k?g|N|kN|N\s?m|%|k?N/m)$"
)


# Out


def tree_data(tree: Tree) -> list[dict[str, Any]]:
    """Return the frames of a tree as plain data, those on the world in a list.

    Raises `ModelFileError` for a composition with frames between its own.
    """
    made_up = frame_names(
        tree.frames[0].name, [at.frame for at in tree.frames[1:]], [at.parent for at in tree.frames[1:]]
    )
    last = {indices[-1]: indices for _, indices in tree.compositions}
    following = {a: b for _, indices in tree.compositions for a, b in pairwise(indices)}
    for group, indices in tree.compositions:
        if any(tree.frames[b].parent != a for a, b in pairwise(indices)):
            raise ModelFileError(f"the joint {group.name!r} has other frames between its own, which no file can say")
    children: list[list[int]] = [[] for _ in tree.frames]
    for index, at in enumerate(tree.frames[1:], start=1):
        if following.get(at.parent) != index:
            children[at.parent].append(index)
    heads = {indices[0]: indices[-1] for _, indices in tree.compositions}

    data: list[dict[str, Any]] = []
    waiting: list[tuple[int, str]] = [(0, "")]
    while waiting:
        top, parent = waiting.pop(0)
        # Frames in depth-first order with where they go; an explicit stack, as a chain may be long.
        stack = [(child, data, 1, parent) for child in reversed(children[top])]
        while stack:
            index, siblings, depth, on = stack.pop()
            end = heads.get(index, index)
            entry = _entry(tree, last.get(end, (index,)), made_up)
            if on:
                entry["parent"] = on
            siblings.append(entry)
            # What hangs between the frames of a composition names its parent, and so does what is deep.
            for middle in last.get(end, (index,))[:-1]:
                if children[middle]:
                    _call(tree, entry, last[end])
                    waiting.append((middle, tree.frames[middle].name))
            if not children[end]:
                continue
            if depth == _DEEPEST:
                _call(tree, entry, last.get(end, (index,)))
                waiting.append((end, tree.frames[end].name))
                continue
            below: list[dict[str, Any]] = []
            entry["children"] = below
            stack.extend((child, below, depth + 1, "") for child in reversed(children[end]))
    return data


def _call(tree: Tree, entry: dict[str, Any], indices: Sequence[int]) -> None:
    """Say how frames without a name are called, so that others can name them."""
    if len(indices) > 1:
        entry["called"] = [tree.frames[i].name for i in indices]
    elif "name" not in entry:
        entry["called"] = tree.frames[indices[0]].name


def _entry(tree: Tree, indices: Sequence[int], made_up: Sequence[str]) -> dict[str, Any]:
    placed = [tree.frames[i] for i in indices]
    frame = placed[-1].frame
    entry = _composition([at.frame for at in placed]) if len(indices) > 1 else _frame(frame)
    if frame.name is not None and entry.get("variables") != frame.name:
        entry["name"] = frame.name
    if any(at.frame.name is None and at.name != made_up[i] for at, i in zip(placed, indices, strict=True)):
        _call(tree, entry, indices)
    bodies = list(frame.bodies)
    if bodies and not bodies[0].allow_nonphysical:
        entry.update(_body(bodies.pop(0)))
    if bodies:
        entry["bodies"] = [_body(body) for body in bodies]
    return entry


def _frame(frame: Frame) -> dict[str, Any]:
    entry: dict[str, Any] = {"type": frame.transform}
    if frame.coordinate is None:
        assert frame.matrix is not None
        if not _plain(frame.matrix[:3, 3], np.zeros(3)):
            entry["translation"] = frame.matrix[:3, 3].tolist()
        if not _plain(frame.matrix[:3, :3], np.eye(3)):
            entry["rotation"] = frame.matrix[:3, :3].tolist()
        return entry
    assert frame.twist is not None
    value, offset = _coordinate(frame.coordinate)
    entry["value"] = value
    if offset is not None:
        entry["offset"] = offset
    linear, angular = frame.twist[:3], frame.twist[3:]
    if frame.transform == "twist":
        entry.update({k: part.tolist() for k, part in (("linear", linear), ("angular", angular)) if not _zero(part)})
    elif frame.transform not in PRIMITIVES:
        entry["axis"] = _axis(linear if frame.transform == "prismatic" else angular)
        if frame.point is not None and not _zero(frame.point):
            entry["point"] = frame.point.tolist()
        if frame.pitch is not None:
            entry["pitch"] = frame.pitch
    _prescribe(entry, frame.variables, frame.kinematic)
    return entry


def _composition(parts: Sequence[Frame]) -> dict[str, Any]:
    group = parts[0].group
    assert group is not None
    coordinates = [part.coordinate for part in parts if part.coordinate is not None]
    entry: dict[str, Any] = {"type": group.kind}
    by_name = _FUNCTIONS[group.kind](group.name, axes=group.axes)
    if [part.coordinate for part in by_name.frames] == coordinates:
        entry["variables"] = group.name
    else:
        pairs = [_coordinate(coordinate) for coordinate in coordinates]
        entry["variables"] = [value for value, _ in pairs]
        if any(offset is not None for _, offset in pairs):
            entry["offsets"] = [offset or 0.0 for _, offset in pairs]
    if group.axes != {"universal": "xy"}.get(group.kind, "xyz"):
        entry["axes"] = group.axes
    variables = tuple(dict.fromkeys(name for part in parts for name in part.variables))
    prescribed = {name for part in parts for name in part.kinematic}
    _prescribe(entry, variables, tuple(name for name in variables if name in prescribed))
    return entry


def _prescribe(entry: dict[str, Any], variables: tuple[str, ...], kinematic: tuple[str, ...]) -> None:
    if kinematic:
        entry["kinematic"] = True if kinematic == variables else list(kinematic)


def _coordinate(coordinate: Affine) -> tuple[float | str | dict[str, float], float | None]:
    """Return a coordinate, and what is added to it if anything is."""
    if not coordinate.terms:
        return coordinate.offset, None
    offset = None if _zero(np.array(coordinate.offset)) else coordinate.offset
    (name, factor), *more = coordinate.terms
    plain = factor == 1.0 and not more and not UNIT.match(name)
    return name if plain else dict(coordinate.terms), offset


def _axis(axis: Array) -> str | list[float]:
    for letter, unit in zip("xyz", np.eye(3), strict=True):
        if _plain(axis, unit):
            return letter
    return [float(x) for x in axis]


def _body(body: Body) -> dict[str, Any]:
    entry: dict[str, Any] = {"mass": body.mass}
    if not _zero(body.com):
        entry["com"] = body.com.tolist()
    if not _zero(body.inertia):
        moments, (xx, xy, xz, _, yy, yz, _, _, zz) = body.inertia.diagonal(), body.inertia.ravel().tolist()
        entry["inertia"] = [xx, yy, zz] if _plain(body.inertia, np.diag(moments)) else [xx, yy, zz, xy, xz, yz]
    if body.allow_nonphysical:
        entry["allow_nonphysical"] = True
    return entry


def _zero(array: Array) -> bool:
    return _plain(array, np.zeros_like(array))


def _plain(array: Array, what: Array) -> bool:
    """Whether an array is another bit by bit: -0 is not 0."""
    return array.tobytes() == what.tobytes()


# In


def tree_of(world_name: str, records: Sequence[FrameRecord], document: Document, place: Place = ("frames",)) -> Tree:
    """Return the tree of a file's frames.

    ``place``: where the list stands in the document. Raises `ModelFileError` with the place of what is wrong.
    """
    reader = _FrameReader(document, world(world_name))
    try:
        reader.read(records, place)
        places, parents = preorder(reader.root)
        made = [branch.frame for branch in places[1:] if branch.frame is not None]
        names = frame_names(world_name, made, parents[1:])
        names = [names[0], *(reader.called.get(id(frame), name) for frame, name in zip(made, names[1:], strict=True))]
        twice = [name for name in dict.fromkeys(names) if names.count(name) > 1] if len(set(names)) < len(names) else []
        if twice:
            raise DescriptionError(f"two frames are called {twice[0]!r}; give one of them another name")
        return place_frames(names, made, parents[1:])
    except DescriptionError as error:
        raise document.error(place, str(error)) from None


class _FrameReader:
    """Puts the frames of a file on the world."""

    def __init__(self, document: Document, root: Branch) -> None:
        self.document = document
        self.root = root
        self.known = {root.world_name: root}
        self.called: dict[int, str] = {}

    def read(self, records: Sequence[FrameRecord], place: Place) -> None:
        waiting = [(record, (*place, index)) for index, record in enumerate(records)]
        while waiting:
            left = []
            for record, at in waiting:
                parent = record.parent if isinstance(record.parent, str) else self.root.world_name
                if parent in self.known:
                    self.put(record, self.known[parent], at)
                else:
                    left.append((record, at))
            if len(left) == len(waiting):
                record, at = left[0]
                message = f"unknown frame {record.parent!r}; {closest(record.parent, self.known, what='frames')}"
                raise self.document.error((*at, "parent"), message)
            waiting = left

    def put(self, record: FrameRecord, branch: Branch, place: Place) -> None:
        try:
            made = _made(record)
        except DescriptionError as error:
            raise self.document.error(place, str(error)) from None
        end = branch.put(made)
        parts = [made] if isinstance(made, Frame) else list(made.frames)
        names = [record.called] if isinstance(record.called, str) else record.called
        if isinstance(names, list):
            if len(names) != len(parts):
                raise self.document.error((*place, "called"), f"got {len(names)} names, expected {len(parts)}")
            self.called.update({id(part): name for part, name in zip(parts, names, strict=True) if part.name is None})
        at: Branch | None = end
        for part in reversed(parts):
            assert at is not None
            name = part.name if part.name is not None else self.called.get(id(part))
            if name is not None:
                if name in self.known:
                    raise self.document.error(place, f"another frame is called {name!r} too; names are unique")
                self.known[name] = at
            at = at.parent
        if isinstance(record.children, list):
            for index, child in enumerate(record.children):
                at_child = (*place, "children", index)
                if isinstance(child.parent, str):
                    raise self.document.error((*at_child, "parent"), "a child has its parent; leave this out")
                self.put(child, end, at_child)


def _made(record: FrameRecord) -> Any:
    """Return the frame or composition that a record describes."""
    options = record.given("called", "parent", "children")
    if "bodies" in options:
        options["bodies"] = [body_of(body) for body in options["bodies"]]
    kind = str(record.__struct_config__.tag)
    offsets = options.pop("offsets", None)
    if isinstance(record, CompositionRecord):
        value = options.pop("variables")
        for each in value if isinstance(value, list) else ():
            _refuse_unit(each, "variables")
        if offsets is not None:
            if not isinstance(value, list) or len(offsets) != len(value):
                raise DescriptionError(f"{kind}: offsets: expected one for each of the coordinates in variables")
            value = [as_affine(each, kind, offset) for each, offset in zip(value, offsets, strict=True)]
        if kind != "universal":
            options.setdefault("axes", "xyz")  # as files of the first format have it
        return _FUNCTIONS[kind](value, **options)
    if "value" in options:
        _refuse_unit(options["value"], "value")
        return _FUNCTIONS[kind](options.pop("value"), **options)
    # Alone, it would say nothing in Python; in a file it is a frame that coincides with its parent.
    if not options:
        options["translation"] = [0.0, 0.0, 0.0]
    return _FUNCTIONS[kind](**options)


def _refuse_unit(value: object, what: str) -> None:
    if isinstance(value, str) and UNIT.match(value):
        raise DescriptionError(
            f"{what}: got {value!r}, expected a number in metres or radians without a unit, or the name of a variable"
        )


def body_of(record: BodyRecord) -> Body:
    """Return the body that a record describes; raise a `DescriptionError` for one that cannot be."""
    return Body(**record.given())
