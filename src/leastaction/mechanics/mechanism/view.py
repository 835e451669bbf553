"""The printed view of a mechanism."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from leastaction.mechanics.description.frames import Frame, Group
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.mechanism.compilation import Plan


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


def tree_rows(tree: Tree) -> Iterator[Row]:
    """Return the lines that show a tree, from the first frame after the world on."""
    children: list[list[int]] = [[] for _ in tree.frames]
    for index, frame in enumerate(tree.frames[1:], start=1):
        children[frame.parent].append(index)
    # The frames of a composition stand in one line, that of the first, unless something else hangs between.
    whole = {
        indices[0]: indices
        for _, indices in tree.compositions
        if all(children[a] == [b] for a, b in pairwise(indices))
    }
    # An explicit stack, since a chain may be longer than Python recurses.
    stack = [(child, "", child == children[0][-1]) for child in reversed(children[0])]
    while stack:
        index, indent, last = stack.pop()
        indices = whole.get(index, (index,))
        specs = [spec for i in indices if (spec := tree.frames[i].spec) is not None]
        yield _row(f"{indent}{'└─ ' if last else '├─ '}", tree.frames[indices[-1]].name, specs)
        deeper = indent + ("   " if last else "│  ")
        below = children[indices[-1]]
        stack.extend((child, deeper, child == below[-1]) for child in reversed(below))


def shared_variables(tree: Tree) -> dict[str, tuple[str, ...]]:
    """Return the variables that move several frames, with the names of these frames."""
    moved: dict[str, list[str]] = {}
    for joint in tree.joints:
        for name in joint.variables:
            moved.setdefault(name, []).append(tree.frames[joint.frame].name)
    return {name: tuple(frames) for name, frames in moved.items() if len(frames) > 1}


def some(names: Sequence[str], most: int = 12) -> str:
    """Return names in one line, the first of them if there are many."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


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

    Parameters
    ----------
    plan : Plan
        The checked mechanism.

    Returns
    -------
    str
        Several lines without a newline at the end.
    """
    lines = [plan.tree.frames[0].name]
    for row in tree_rows(plan.tree):
        parts = [row.name, row.transform, row.detail, row.kinematic]
        text = [part for part in parts if part] + [f"[{body}]" for body in row.bodies]
        lines.append(row.branch + "  ".join(text))
    for title, name, description in element_lines(plan):
        lines.append(f"{title}{f' {name!r}' if name else ''}: {description}")
    lines.extend(f"{name} = {value:g}" for name, value in plan.numbers.items())
    for name, frames in shared_variables(plan.tree).items():
        lines.append(f"{name} moves {len(frames)} frames: {some(frames)}")
    for kind, names in name_lines(plan):
        lines.append(f"{kind} ({len(names)}){': ' if names else ''}{', '.join(names)}")
    return "\n".join(lines)


def _row(branch: str, name: str, specs: list[Frame]) -> Row:
    last, group = specs[-1], specs[-1].group
    variables = tuple(dict.fromkeys(v for spec in specs for v in spec.variables))
    if len(specs) > 1 and group is not None:
        transform, detail = _composition(group, [str(spec.coordinate) for spec in specs])
    else:
        # The name of a frame that was given none tells its transformation, unless a number was changed.
        told = last.name is None and last.label in name
        transform = "" if told else last.label
        detail = last.detail
    prescribed = [v for v in variables if any(v in spec.kinematic for spec in specs)]
    kinematic = "kinematic"
    if len(prescribed) < len(variables):
        kinematic += f": {', '.join(prescribed)}"
    return Row(
        branch,
        name,
        transform,
        detail,
        kinematic if prescribed else "",
        tuple(_body_text(spec, i) for spec in specs for i in range(len(spec.bodies))),
    )


def _composition(group: Group, coordinates: list[str]) -> tuple[str, str]:
    """Return a composition as text: its name and the ends of its variables' names, where these are its own."""
    own = f"{group.name}."
    if all(coordinate.startswith(own) for coordinate in coordinates):
        ends = " ".join(coordinate.removeprefix(own) for coordinate in coordinates)
        return f"{group.kind}({group.name}: {ends})", ""
    return f"{group.kind}({', '.join(coordinates)})", f"axes {group.axes}"


def _body_text(spec: Frame, index: int) -> str:
    body = spec.bodies[index]
    text = f"{body.mass:g} kg"
    if body.inertia.any():
        xx, yy, zz = body.inertia.diagonal()
        text += f", inertia {xx:g} {yy:g} {zz:g}"
    if body.com.any():
        text += f", com {' '.join(f'{c:g}' for c in body.com)}"
    return text
