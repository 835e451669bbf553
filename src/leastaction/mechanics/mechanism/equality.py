"""When two mechanisms are the same: in description, names, numbers and elements."""

from __future__ import annotations

from typing import Any

from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.description.tree import Tree, TreeFrame
from leastaction.mechanics.mechanism.compilation import Plan


def same(first: Plan, second: Plan) -> bool:
    """Return whether two mechanisms are the same in all that is written of them, however that was said."""
    names = ("dynamic", "kinematic", "inputs", "constraints", "numbers", "shared")
    return (
        all(getattr(first, each) == getattr(second, each) for each in names)
        and list(first.elements.items()) == list(second.elements.items())
        and _tree(first.tree) == _tree(second.tree)
    )


def names_hash(settled: Plan) -> int:
    """Return a number that is the same for mechanisms that are."""
    frames = tuple(at.name for at in settled.tree.frames)
    return hash((frames, settled.dynamic, settled.kinematic, settled.inputs, settled.constraints))


def _tree(tree: Tree) -> tuple[Any, ...]:
    groups = [(group.kind, group.name, group.axes, indices) for group, indices in tree.compositions]
    return [_frame(at) for at in tree.frames], groups


def _frame(at: TreeFrame) -> tuple[Any, ...]:
    frame = at.frame
    arrays = [None if array is None else array.tolist() for array in (frame.twist, frame.matrix, frame.point)]
    bodies = [_body(body) for body in frame.bodies]
    told = (frame.transform, frame.coordinate, frame.kinematic, frame.name, frame.pitch)
    return at.name, at.parent, told, arrays, bodies


def _body(body: Body) -> tuple[Any, ...]:
    return body.mass, body.com.tolist(), body.inertia.tolist(), body.allow_nonphysical
