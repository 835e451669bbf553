"""Whole descriptions: a strategy that draws them, and the calls that build the mechanism."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from hypothesis import strategies as st

from fuzz import damage as hurt
from fuzz.damage import Damage
from fuzz.pieces import draw_elements
from fuzz.trees import Call, Draw, Node, Wood, draw_wood
from leastaction import mechanics as la
from leastaction.mechanics import Mechanism


@dataclass
class Description:
    """What the user writes.

    ``style``: the tree as nested lists, as chained calls, or as chained calls with a nested list in them.
    ``changes``: of parameters, as a mapping or as (share of the parameters, what is done to them).
    """

    wood: Wood
    elements: list[Call]
    style: str = "nested"
    orders: dict[str, Any] = field(default_factory=dict)
    description: Any = None
    intruder: Any = None
    element_list: Any = None
    changes: Any = None
    damage: Damage | None = None
    seed: int = 0

    @property
    def types(self) -> list[str]:
        """The types of the elements, each once."""
        return sorted({call.function.__name__ for call in self.elements})


@st.composite
def descriptions(draw: Any, kind: str) -> Description:
    """Draw a description with an element of a type: about half of them sound, half with one thing broken."""
    d = Draw(draw)
    wood = draw_wood(d)
    result = Description(wood, draw_elements(d, wood, kind))
    result.seed = d.below(1 << 16)
    result.style = d.pick(["nested", "chained", "mixed"])
    if d.chance(20):
        names = [*wood.dynamic]
        result.orders = {"dynamic": d.some(names, len(names), len(names))}
    if d.chance(30):
        result.changes = "nudge"
        if d.chance(25):
            result.changes = hurt.choose(d, hurt.NUMBER)
            result.damage = Damage(result.changes[0], "with_parameters", repr(result.changes[1]), result.changes[2])
            return result
    if d.chance(60):
        result.damage = _break(d, result)
    return result


def _break(d: Draw, it: Description) -> Damage | None:
    kind = d.below(20)
    if kind < 12 and it.elements:
        return hurt.hurt_element(d, it.elements)
    if kind < 14 and it.elements:
        frames = [spot.name for spot in it.wood.spots if spot.name]
        return hurt.misfit(d, it.elements, frames, [*it.wood.dynamic, *it.wood.kinematic, "u"])
    if kind < 16:
        return hurt.hurt_node(d, it.wood.every())
    if kind == 16:
        label, given, certain = hurt.choose(d, hurt.DESCRIPTIONS)
        it.description = (given,)
        return Damage(label, "description", repr(given), certain)
    if kind == 17:
        label, given, certain = hurt.choose(d, hurt.INTRUDERS)
        it.intruder = (given,)
        it.style, it.wood.world = "nested", "world"
        return Damage(label, "nested lists", repr(given), certain)
    if kind == 18:
        label, it.element_list, certain = hurt.choose(d, hurt.LISTS)
        it.element_list = (it.element_list,)
        return Damage(label, "elements", repr(it.element_list[0]), certain)
    if d.chance(40):
        return hurt.contradict(d, it.elements, it.wood)
    if d.chance(70):
        which = d.pick(["dynamic", "kinematic", "inputs"])
        label, value, certain = hurt.choose(d, hurt.ORDERS)
        it.orders = {**it.orders, which: value}
        return Damage(label, which, repr(value), certain)
    label, it.changes, certain = hurt.choose(d, hurt.VALUES)
    it.changes = (it.changes,)
    return Damage(label, "with_parameters", repr(it.changes[0]), certain)


# The calls


def make(thing: Any) -> Any:
    """Make the calls in a value: what a user would have written."""
    if isinstance(thing, Call):
        return thing.function(*map(make, thing.args), **{k: make(v) for k, v in thing.options.items()})
    if type(thing) is list:
        return [make(item) for item in thing]
    return thing


def build(it: Description) -> Mechanism:
    """Describe and compile the mechanism."""
    tree = _tree(it) if it.description is None else make(it.description[0])
    elements = make(it.elements if it.element_list is None else it.element_list[0])
    return Mechanism(tree, elements, **it.orders)


def _tree(it: Description) -> Any:
    if it.style == "nested" and it.wood.world == "world":
        nested = _nested(it.wood.nodes)
        return nested if it.intruder is None else _with_intruder(nested, it.intruder[0])
    root = la.world(it.wood.world)
    for node in it.wood.nodes:
        _chain(root, node, it.style)
    return root


def _nested(nodes: list[Node]) -> list[Any]:
    result: list[Any] = []
    for node in nodes:
        result.append(make(node.call))
        if node.children:
            result.append(_nested(node.children))
    return result


def _chain(place: la.Branch, node: Node, style: str) -> None:
    call = node.call
    args, options = make(call.args), {k: make(v) for k, v in call.options.items()}
    at = getattr(place, call.function.__name__)(*args, **options)
    if style == "mixed" and node.children:
        at.add(_nested(node.children))
        return
    for child in node.children:
        _chain(at, child, style)


def _with_intruder(nested: list[Any], intruder: Any) -> list[Any]:
    """Put what does not belong there into the innermost list of the first branch."""
    inner, outer = nested, nested
    while len(inner) > 1 and isinstance(inner[1], list):
        inner, outer = inner[1], inner
    if intruder == "itself":
        inner.append(inner) if isinstance(inner[-1], la.Frame | la.Composition) else inner.extend([la.tx(1.0), inner])
    elif intruder == "an outer list":
        inner.extend([la.tx(1.0), outer])
    elif intruder == "a frame twice":
        inner.append(inner[0])
    else:
        inner.append(make(intruder))
    return nested
