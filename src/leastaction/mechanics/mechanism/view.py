"""The printed view of a mechanism."""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import Any

from leastaction.errors import some
from leastaction.mechanics.description.frames import QUATERNION, Frame, Group
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.mechanism.compilation import Plan

# What of a tree and of a list is shown: the view of a chain of a thousand links stays short.
MOST_ROWS = 300
MOST_NAMES = 200
_END = "·"  # the text of every node while the lines that lead to it are drawn


@dataclass(frozen=True)
class Row:
    """One line of a tree: a frame, or a composition as a whole.

    ``branch``: the lines that draw the tree. ``name``: that of the frame. ``transform``: how it is placed, empty
    if the name says it. ``detail``: where the axis of the joint lies. ``kinematic``: which of its variables are
    kinematic, in words. ``bodies``: each in words.
    """

    branch: str
    name: str
    transform: str
    detail: str
    kinematic: str
    bodies: tuple[str, ...]


def tree_rows(tree: Tree) -> tuple[list[Row], int]:
    """Return the lines that show the first frames of a tree, the world left out, and how many more there are."""
    from rich.tree import Tree as Drawing  # here, so that to import the package is quick

    children: list[list[int]] = [[] for _ in tree.frames]
    for index, frame in enumerate(tree.frames[1:], start=1):
        children[frame.parent].append(index)
    # The frames of a composition stand in one line, that of the first, unless something else hangs between.
    whole = {
        indices[0]: indices for _, indices in tree.compositions if all(children[a] == [b] for a, b in pairwise(indices))
    }
    shown: list[tuple[int, ...]] = []
    left_out = 0
    drawing = Drawing(_END)
    # An explicit stack, since a chain may be longer than Python recurses.
    stack = [(child, drawing) for child in reversed(children[0])]
    while stack:
        index, parent = stack.pop()
        indices = whole.get(index, (index,))
        if len(shown) < MOST_ROWS:
            shown.append(indices)
            parent = parent.add(_END)
        else:
            left_out += 1
        stack.extend((child, parent) for child in reversed(children[indices[-1]]))
    rows = [
        _row(line.removesuffix(_END), tree.frames[indices[-1]].name, [tree.frames[i].frame for i in indices])
        for line, indices in zip(_lines(drawing)[1:], shown, strict=True)
    ]
    return rows, left_out


def _lines(drawing: Any) -> list[str]:
    """Return a tree drawn by rich as plain lines, however wide."""
    from rich.console import Console

    file = io.StringIO()
    Console(file=file, width=10 * MOST_ROWS, color_system=None).print(drawing)
    return file.getvalue().splitlines()


def shared_variables(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return the variables that move several frames, with the names of these frames."""
    moved: dict[str, list[str]] = {}
    for joint in tree.joints:
        for name in joint.variables:
            moved.setdefault(name, []).append(tree.frames[joint.frame].name)
    return {name: tuple(frames) for name, frames in moved.items() if len(frames) > 1}


def element_lines(plan: Plan) -> list[tuple[str, str, str]]:
    """Return type, name and description of every element; a name made from the element is left out."""
    return [
        (type(element).__name__, name if element.name is not None else "", element.describe())
        for name, element in plan.elements.items()
    ]


def name_lines(plan: Plan) -> list[tuple[str, tuple[str, ...]]]:
    """Return the kinds of names that the arrays are ordered by, and the names."""
    return [
        ("dynamic", plan.dynamic),
        ("kinematic", plan.kinematic),
        ("inputs", plan.inputs),
        ("constraints", plan.constraints),
    ]


def tree_view(plan: Plan) -> str:
    """Return a mechanism as text: the tree with variables and masses, the elements, the variables.

    ``plan``: the checked mechanism. Returns several lines without a newline at the end.
    """
    rows, left_out = tree_rows(plan.tree)
    lines = [plan.tree.frames[0].name]
    for row in rows:
        parts = [row.name, row.transform, row.detail, row.kinematic]
        text = [part for part in parts if part] + [f"[{body}]" for body in row.bodies]
        lines.append(row.branch + "  ".join(text))
    lines.extend([f"… and {left_out} more"] if left_out else [])
    lines.extend(
        first_of(
            f"{title}{f' {name!r}' if name else ''}: {description}" for title, name, description in element_lines(plan)
        )
    )
    lines.extend(first_of(f"{name} = {value:g}" for name, value in plan.numbers.items()))
    lines.extend(
        first_of(
            f"{name} moves {len(frames)} frames: {some(frames)}" for name, frames in shared_variables(plan.tree).items()
        )
    )
    for kind, names in name_lines(plan):
        lines.append(f"{kind} ({len(names)}){': ' if names else ''}{some(names, MOST_NAMES)}")
    return "\n".join(lines)


def first_of(lines: Iterable[str]) -> list[str]:
    """Return the first of many lines, and how many more there are."""
    given = iter(lines)
    shown = list(islice(given, MOST_NAMES))
    rest = sum(1 for _ in given)
    return [*shown, f"… and {rest} more"] if rest else shown


def _row(branch: str, name: str, frames: list[Frame]) -> Row:
    last, group = frames[-1], frames[-1].group
    variables = tuple(dict.fromkeys(v for frame in frames for v in frame.variables))
    if len(frames) > 1 and group is not None:
        transform, detail = _composition(group, [str(frame.coordinate) for frame in frames])
    else:
        # The name of a frame that was given none tells its transformation, unless a number was changed.
        told = last.name is None and last.label in name
        transform = "" if told else last.label
        detail = last.detail
    prescribed = [v for v in variables if any(v in frame.kinematic for frame in frames)]
    kinematic = "kinematic"
    if len(prescribed) < len(variables):
        kinematic += f": {', '.join(prescribed)}"
    return Row(
        branch,
        name,
        transform,
        detail,
        kinematic if prescribed else "",
        tuple(_body_text(frame, i) for frame in frames for i in range(len(frame.bodies))),
    )


def _composition(group: Group, coordinates: list[str]) -> tuple[str, str]:
    """Return a composition as text: its name and the ends of its variables' names, where these are its own."""
    own = f"{group.name}."
    if group.axes == QUATERNION:
        slides = "".join(f"{coordinate.removeprefix(own)} " for coordinate in coordinates[:-3])
        return f"{group.kind}({group.name}: {slides}qw qx qy qz)", "unit quaternion, rates wx wy wz in its axes"
    if all(coordinate.startswith(own) for coordinate in coordinates):
        ends = " ".join(coordinate.removeprefix(own) for coordinate in coordinates)
        return f"{group.kind}({group.name}: {ends})", ""
    return f"{group.kind}({', '.join(coordinates)})", f"axes {group.axes}"


def _body_text(frame: Frame, index: int) -> str:
    body = frame.bodies[index]
    text = f"{body.mass:g} kg"
    if body.inertia.any():
        xx, yy, zz = body.inertia.diagonal()
        text += f", inertia {xx:g} {yy:g} {zz:g}"
    if body.com.any():
        text += f", com {' '.join(f'{c:g}' for c in body.com)}"
    return text
