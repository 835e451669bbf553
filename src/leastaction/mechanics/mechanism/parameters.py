"""Named parameters: the numbers of a mechanism, its masses, lengths and coefficients.

Every number of a description has a name: ``"bob.mass"``, ``"bob.com.x"``, ``"bob.inertia.xx"`` of the body
on the frame ``bob`` (``"bob.body2.mass"`` of its second one), ``"rod.value"`` of a constant frame such as
``tx(0.5, name="rod")``, ``"hook.translation.x"`` of a `pose`, ``"wheel.factor.motor"`` and ``"wheel.offset"`` of a
frame that moves by more than a variable, ``"nut.pitch"`` of a `screw`, and ``"spring.stiffness"`` of an element.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError, DescriptionError, brief, unknown
from leastaction.mechanics.description.affine import Affine
from leastaction.mechanics.description.tree import Tree
from leastaction.numerics.arrays import Array, as_number, require_mapping

AXES = "xyz"
_MOMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclass(frozen=True)
class BodyNumber:
    """A number of a body: the index of its frame and of the body there, and ``field`` such as "com.x"."""

    frame: int
    body: int
    field: str


@dataclass(frozen=True)
class Length:
    """A number of a constant frame: its coordinate, or the component ``axis`` of its translation."""

    frame: int
    axis: int | None


@dataclass(frozen=True)
class JointNumber:
    """A number of a frame that moves: the ``field`` "factor" of a variable, "offset" or "pitch".

    To change it is to add a prescribed motion to the frame's own, which vanishes where the number has its value and
    grows with it by a linear expression of the variables: `growth`.
    """

    frame: int
    field: str
    variable: str = ""

    def growth(self, tree: Tree) -> Affine:
        """Return how the added motion grows with the number."""
        if self.field == "factor":
            return Affine(((self.variable, 1.0),))
        coordinate = tree.frames[self.frame].frame.coordinate
        assert coordinate is not None
        return Affine((), 1.0) if self.field == "offset" else coordinate


@dataclass(frozen=True)
class ElementNumber:
    """A number of an element: its slot in the core."""

    slot: int


Prescribed = Length | JointNumber
"""A number that a prescribed variable can stand for."""

Place = BodyNumber | Prescribed | ElementNumber


def parameter_places(tree: Tree, slots: Mapping[str, int]) -> dict[str, Place]:
    """Return where every named parameter is: those of bodies and frames, then those of elements.

    An element that is called like a frame has the name of a number that both have, such as "g.offset".
    """
    places = _tree_places(tree)
    places.update({name: ElementNumber(slot) for name, slot in slots.items()})
    return places


def check_names(tree: Tree, slots: Mapping[str, int]) -> None:
    """Raise a `DescriptionError` if two frames or bodies, or one and an element, have a parameter of the same name."""
    stems = _stems(tree)
    heavy = {stem for stem, placed in zip(stems, tree.frames, strict=True) if placed.frame.bodies}
    for stem, placed in zip(stems, tree.frames, strict=True):
        for number in range(2, 1 + len(placed.frame.bodies)):
            if f"{stem}.body{number}" in heavy:
                raise DescriptionError(
                    f"the frame '{stem}.body{number}' is called like body {number} of the frame {stem!r}, so their "
                    "parameters have the same names; give it another name="
                )
    frames = {stem: index for index, stem in enumerate(stems)}
    for name in slots:
        dots = [at for at, letter in enumerate(name) if letter == "."]
        for index in (frames[name[:at]] for at in dots if name[:at] in frames):
            # Of a joint's number and an element's, the element's has the name: see `parameter_places`.
            if not isinstance(_frame_places(tree, index, stems[index]).get(name), JointNumber | None):
                raise DescriptionError(
                    f"duplicate parameter {name!r}: a number of the frame {tree.frames[index].name!r} and "
                    "of an element; give the element another name"
                )


def _stems(tree: Tree) -> list[str]:
    """Return what the names of each frame's parameters begin with.

    The frame's name; where none was given and a single variable moves the frame, the name of that.
    """
    taken = {frame.name for frame in tree.frames}
    stems = []
    for placed in tree.frames:
        coordinate, stem = placed.frame.coordinate, placed.name
        if placed.frame.name is None and coordinate is not None and coordinate.plain:
            stem = coordinate.names[0] if coordinate.names[0] not in taken else stem
            taken.add(stem)
        stems.append(stem)
    return stems


def _frame_names(tree: Tree) -> list[str]:
    return [frame.name for frame in tree.frames]


def _tree_places(tree: Tree) -> dict[str, Place]:
    places: dict[str, Place] = {}
    for index, stem in enumerate(_stems(tree)):
        places.update(_frame_places(tree, index, stem))
    return places


def _frame_places(tree: Tree, index: int, frame_stem: str) -> dict[str, Place]:
    """Return where the parameters of one frame and its bodies are; the world has none."""
    frame, places = tree.frames[index].frame, dict[str, Place]()
    for number in range(len(frame.bodies)):
        stem = frame_stem if number == 0 else f"{frame_stem}.body{number + 1}"
        fields = ["mass", *(f"com.{a}" for a in AXES), *(f"inertia.{m}" for m in _MOMENTS)]
        places.update({f"{stem}.{field}": BodyNumber(index, number, field) for field in fields})
    if index == 0:
        return places
    if frame.transform == "screw":
        places[f"{frame_stem}.pitch"] = JointNumber(index, "pitch")
    if frame.variables:
        assert frame.coordinate is not None
        if not frame.coordinate.plain:
            factors = [(f"factor.{name}", JointNumber(index, "factor", name)) for name in frame.variables]
            for field, place in (*factors, ("offset", JointNumber(index, "offset"))):
                places[f"{frame_stem}.{field}"] = place
    elif frame.matrix is None:
        places[f"{frame_stem}.value"] = Length(index, None)
    else:
        for axis, letter in enumerate(AXES):
            places[f"{frame_stem}.translation.{letter}"] = Length(index, axis)
    return places


def parameter_value(tree: Tree, place: Place, numbers: Array) -> float:
    """Return the value of a parameter; ``numbers`` are those of the core."""
    if isinstance(place, ElementNumber):
        return float(numbers[place.slot])
    frame = tree.frames[place.frame].frame
    if isinstance(place, Length):
        if place.axis is not None:
            assert frame.matrix is not None
            return float(frame.matrix[place.axis, 3])
        assert frame.coordinate is not None
        return frame.coordinate.offset
    if isinstance(place, JointNumber):
        assert frame.coordinate is not None
        if place.field == "pitch":
            assert frame.pitch is not None
            return frame.pitch
        return dict(frame.coordinate.terms)[place.variable] if place.field == "factor" else frame.coordinate.offset
    body = frame.bodies[place.body]
    kind, _, which = place.field.partition(".")
    if kind == "mass":
        return body.mass
    if kind == "com":
        return float(body.com[AXES.index(which)])
    return float(body.inertia[AXES.index(which[0]), AXES.index(which[1])])


def find(tree: Tree, slots: Mapping[str, int], names: object) -> dict[str, Place]:
    """Return the places of some parameters; raise an `ArgumentError` for a name that is none.

    Those of a frame are found by the name of the frame too, where `parameter_places` calls it by its variable.
    """
    if isinstance(names, str) or not isinstance(names, Iterable):
        what = "the string " if isinstance(names, str) else ""
        raise ArgumentError(f"parameters: expected a list of names, got {what}{brief(repr(names))}")
    names = tuple(names)
    for name in names:
        if not isinstance(name, str):
            raise unknown("parameter", name, parameter_places(tree, slots))
    # No more frames are named than have to be: naming all takes longer than a short simulation.
    places: dict[str, Place] = {name: ElementNumber(slots[name]) for name in names if name in slots}
    for stems_of in (_stems, _frame_names):
        missing = [name for name in names if name not in places]
        for index, stem in enumerate(stems_of(tree) if missing else ()):
            if any(name.startswith(f"{stem}.") for name in missing):
                places = _frame_places(tree, index, stem) | places
    found: dict[str, Place] = {}
    for name in names:
        if name not in places:
            raise unknown("parameter", name, parameter_places(tree, slots))
        if name in found:
            raise ArgumentError(f"parameters: {name!r} is listed twice; name each one once")
        found[name] = places[name]
    return found


def checked(changes: Mapping[str, float]) -> dict[str, float]:
    """Return new values as finite floats; raise an `ArgumentError` for anything else."""
    require_mapping(changes, "parameters", "{'bob.mass': 2.0}")
    return {name: as_number(value, f"the parameter {name!r}") for name, value in changes.items()}


def inertia_slope(tree: Tree, place: BodyNumber) -> tuple[int, Array]:
    """Return the joint (-1: the world) whose inertia a body's number changes, and by how much.

    Returns ``joint``; ``slope`` (10,): of mass, first moment and rotational inertia (xx yy zz xy xz yz) about the
    origin of the joint's moved frame, in its axes: ``I_o = R I R^T + m (c.c E - c c^T)`` with ``c = R com + o``.
    """
    placed = tree.frames[place.frame]
    body = placed.frame.bodies[place.body]
    rotation, origin = placed.pose[:3, :3], placed.pose[:3, 3]
    centre = rotation @ body.com + origin
    kind, _, which = place.field.partition(".")
    mass, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if kind == "mass":
        mass, moment = 1.0, centre
        inertia = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    elif kind == "com":
        axis = rotation[:, AXES.index(which)]
        moment = body.mass * axis
        across = np.outer(centre, axis)
        inertia = body.mass * (2.0 * (centre @ axis) * np.eye(3) - across - across.T)
    else:
        i, j = AXES.index(which[0]), AXES.index(which[1])
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        inertia = rotation @ unit @ rotation.T
    upper = [inertia[AXES.index(m[0]), AXES.index(m[1])] for m in _MOMENTS]
    return placed.joint, np.array([mass, *moment, *upper])
