"""Trees with other numbers, or with numbers turned into variables: parameters changed, and differentiated by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.description.affine import Affine
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.flattening import place_frames
from leastaction.mechanics.description.frames import PRIMITIVES, Frame
from leastaction.mechanics.description.joints import screw_detail, screw_twist
from leastaction.mechanics.description.poses import pose
from leastaction.mechanics.description.tree import Tree, TreeFrame
from leastaction.mechanics.mechanism.parameters import AXES, BodyNumber, JointNumber, Length, Place, Prescribed


def with_values(tree: Tree, changes: Mapping[Place, float], *, allow_nonphysical: bool = False) -> Tree:
    """Return a tree with other masses and lengths; the names of its frames stay.

    ``allow_nonphysical``: whether bodies may have inertias that no real ones have, as of `Body`.
    Raises `DescriptionError` for a body that cannot be, with the name of its frame.
    """
    bodies: dict[tuple[int, int], dict[str, float]] = {}
    lengths: dict[int, dict[int | None, float]] = {}
    joints: list[tuple[JointNumber, float]] = []
    for place, value in changes.items():
        if isinstance(place, BodyNumber):
            bodies.setdefault((place.frame, place.body), {})[place.field] = value
        elif isinstance(place, Length):
            lengths.setdefault(place.frame, {})[place.axis] = value
        elif isinstance(place, JointNumber):
            joints.append((place, value))
    if not bodies and not lengths and not joints:
        return tree
    frames = [placed.frame for placed in tree.frames]
    order_stays = True
    for (index, number), values in bodies.items():
        frame = frames[index]
        try:
            changed = _changed(frame.bodies[number], values, allow_nonphysical)
        except DescriptionError as error:
            raise DescriptionError(f"frame {tree.frames[index].name!r}: {error}") from None
        kept = frame.bodies
        order_stays = order_stays and changed.is_massive == kept[number].is_massive
        frames[index] = replace(frame, bodies=(*kept[:number], changed, *kept[number + 1 :]))
    if order_stays and not lengths and not joints:
        # Frames stand where they stood.
        return replace(tree, frames=tuple(map(_exchanged, tree.frames, frames)))
    for index, coordinates in lengths.items():
        frame = frames[index]
        frames[index] = _resized(frame, coordinates)
    for place, value in joints:
        frames[place.frame] = _geared(frames[place.frame], tree.frames[place.frame].name, place, value)
    return place_frames(
        [placed.name for placed in tree.frames], frames[1:], [placed.parent for placed in tree.frames[1:]]
    )


def _exchanged(placed: TreeFrame, frame: Frame) -> TreeFrame:
    return placed if frame is placed.frame else replace(placed, frame=frame)


def _changed(body: Body, values: Mapping[str, float], allow_nonphysical: bool) -> Body:
    """Return a body with other numbers, all at once: what is in between need not be a body."""
    mass, com, inertia = body.mass, body.com.copy(), body.inertia.copy()
    for field, value in values.items():
        kind, _, which = field.partition(".")
        if kind == "mass":
            mass = value
        elif kind == "com":
            com[AXES.index(which)] = value
        else:
            i, j = AXES.index(which[0]), AXES.index(which[1])
            inertia[i, j] = inertia[j, i] = value
    return Body(mass, com=com, inertia=inertia, allow_nonphysical=body.allow_nonphysical or allow_nonphysical)


def _resized(frame: Frame, coordinates: Mapping[int | None, float]) -> Frame:
    """Return a constant frame with another coordinate (None), or other components of its translation."""
    if None in coordinates:
        return replace(frame, coordinate=Affine((), coordinates[None]))
    assert frame.matrix is not None
    matrix = frame.matrix.copy()
    for axis, value in coordinates.items():
        matrix[axis, 3] = value
    matrix.setflags(write=False)
    return replace(frame, matrix=matrix)


def _geared(frame: Frame, name: str, place: JointNumber, value: float) -> Frame:
    """Return a frame with another number of its joint."""
    assert frame.coordinate is not None
    if place.field == "pitch":
        assert frame.twist is not None
        assert frame.point is not None
        axis, point = frame.twist[3:], frame.point
        return replace(
            frame, twist=screw_twist(axis, point, value), detail=screw_detail(axis, point, value), pitch=value
        )
    if place.field == "offset":
        return replace(frame, coordinate=replace(frame.coordinate, offset=value))
    if value == 0.0:
        raise DescriptionError(f"frame {name!r}: the factor of {place.variable!r} is 0, by which it would not move it")
    terms = tuple((variable, value if variable == place.variable else f) for variable, f in frame.coordinate.terms)
    return replace(frame, coordinate=replace(frame.coordinate, terms=terms))


def freed(tree: Tree, lengths: Mapping[str, Prescribed]) -> Tree:
    """Return the tree with numbers turned into kinematic variables of the parameters' names.

    What moves with a length then moves with a variable, so that derivatives by the one are derivatives by
    the other. A `pose` is split into translations and its rotation. To a joint a variable is added that stands for what
    a change of its number does, to a screw a slide along its axis.
    """
    names, parents, frames = [tree.frames[0].name], [], []

    def put(name: str, frame: Frame, parent: int) -> int:
        names.append(name)
        frames.append(frame)
        parents.append(parent)
        return len(names) - 1

    moved_to = {0: 0}  # the frame's index in the new tree
    for index, placed in enumerate(tree.frames[1:], start=1):
        own = {name: place for name, place in lengths.items() if place.frame == index}
        slides, frame = _led(placed.frame, own)
        parent = moved_to[placed.parent]
        for name, slide in slides:
            parent = put(f"{name} (slide)", slide, parent)
        moved_to[index] = put(placed.name, frame, parent)
    return place_frames(names, frames, parents)


def _led(frame: Frame, numbers: Mapping[str, Prescribed]) -> tuple[list[tuple[str, Frame]], Frame]:
    """Return a frame whose numbers are variables: slides before it by their names, and what is left of it."""
    slides: list[tuple[str, Frame]] = []
    offset = None if frame.matrix is None else frame.matrix[:3, 3].copy()
    for name, place in numbers.items():
        variable = Affine(((name, 1.0),))
        if isinstance(place, Length) and place.axis is None:
            frame = replace(frame, coordinate=variable, kinematic=(name,))
        elif isinstance(place, Length):
            assert offset is not None
            assert place.axis is not None
            offset[place.axis] = 0.0
            slides.append((name, Frame(PRIMITIVES[place.axis], variable, np.eye(6)[place.axis], kinematic=(name,))))
        elif place.field == "pitch":
            assert frame.twist is not None
            along = np.concatenate([frame.twist[3:], np.zeros(3)])
            slides.append((name, Frame("twist", variable, along, kinematic=(name,))))
        else:
            assert frame.coordinate is not None
            frame = replace(frame, coordinate=frame.coordinate + variable, kinematic=(*frame.kinematic, name))
    if slides and frame.matrix is not None:
        rest = pose(translation=offset, rotation=frame.matrix[:3, :3])
        frame = replace(frame, matrix=rest.matrix)
    return slides, frame
