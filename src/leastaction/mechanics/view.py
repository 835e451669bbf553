"""The printed view of a mechanism."""

from __future__ import annotations

from leastaction.mechanics.compilation import Plan
from leastaction.mechanics.tree import TreeFrame


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
    frames = plan.tree.frames
    children: list[list[int]] = [[] for _ in frames]
    for index, frame in enumerate(frames[1:], start=1):
        children[frame.parent].append(index)
    lines = [frames[0].name]
    # An explicit stack, since a chain may be longer than Python recurses.
    stack = [(child, "", child == children[0][-1]) for child in reversed(children[0])]
    while stack:
        index, indent, last = stack.pop()
        lines.append(f"{indent}{'└─ ' if last else '├─ '}{_frame_line(frames[index])}")
        deeper = indent + ("   " if last else "│  ")
        below = children[index]
        stack.extend((child, deeper, child == below[-1]) for child in reversed(below))
    for name, element in plan.elements.items():
        title = type(element).__name__
        # A name that was made from the element says nothing more than the description does.
        shown = f"{title} {name!r}" if element.name is not None else title
        lines.append(f"{shown}: {element.describe()}")
    for kind, names in (
        ("dynamic", plan.dynamic),
        ("kinematic", plan.kinematic),
        ("inputs", plan.inputs),
        ("constraints", plan.constraints),
    ):
        lines.append(f"{kind} ({len(names)}){': ' if names else ''}{', '.join(names)}")
    return "\n".join(lines)


def _frame_line(frame: TreeFrame) -> str:
    spec = frame.spec
    assert spec is not None
    parts = [frame.name]
    if spec.name is not None or spec.variable is None:
        parts.append(spec.label)
    if spec.kinematic:
        parts.append("kinematic")
    for body in spec.bodies:
        text = f"{body.mass:g} kg"
        if body.inertia.any():
            xx, yy, zz = body.inertia.diagonal()
            text += f", inertia {xx:g} {yy:g} {zz:g}"
        if body.com.any():
            text += f", com {' '.join(f'{c:g}' for c in body.com)}"
        parts.append(f"[{text}]")
    return "  ".join(parts)
