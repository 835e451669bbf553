"""Names, order and checks: from a tree and elements to calls of the core's builder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from leastaction import _core
from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.elements import Compiler, Context, Element, Parts, Potential
from leastaction.mechanics.mechanism.shared import checked_groups
from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class Plan:
    """Everything that a compiled mechanism knows by name, checked.

    ``tree``: Frames and joints. ``elements``: By their unique names, in the order given. ``dynamic``, ``kinematic``,
    ``inputs``, ``constraints``: Names in the order of every array. ``numbers``: Values of parameters that have been
    changed and are no field of their element. ``shared``: Parameters that stand for several, which have one value.
    """

    tree: Tree
    elements: dict[str, Element]
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    inputs: tuple[str, ...]
    constraints: tuple[str, ...]
    numbers: dict[str, float] = field(default_factory=dict)
    shared: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def with_numbers(self, tree: Tree, numbers: Mapping[str, float], owners: Mapping[str, tuple[str, str]]) -> Plan:
        """Return the plan with another tree of the same frames, and elements with other numbers.

        ``numbers``: values by parameter name; those of frames and bodies are in the tree already. ``owners``: the
        element that each parameter of an element belongs to, and its name there. Raises `DescriptionError` for a number
        that an element refuses.
        """
        elements, rest = dict(self.elements), dict(self.numbers)
        for parameter, value in numbers.items():
            if parameter not in owners:
                continue
            name, number = owners[parameter]
            changed = elements[name].with_number(number, value)
            if changed is None:
                rest[parameter] = value
            else:
                elements[name] = changed
        return replace(self, tree=tree, elements=elements, numbers=rest)

    @property
    def rotors(self) -> list[Mapping[str, float]]:
        """The factors of the elements that are rotors."""
        return [geared for element in self.elements.values() if (geared := element.geared)]

    def context(self) -> Context:
        """Return the mechanism as its elements see it."""
        return Context(self.tree, self.dynamic, self.kinematic, self.inputs)

    def emit(self, builder: _core.MechanismBuilder) -> Compiler:
        """Make the calls that build this mechanism, joints first, then bodies, then elements.

        The result holds the slots of the elements' numbers by name, in ``parameters``, whose they are, and what each
        element came to, in ``parts``.
        """
        core = Compiler(builder, self.context())
        variable = core.context.variables
        for joint in self.tree.joints:
            (name, factor), *more = joint.coordinate.terms
            offset = joint.coordinate.offset
            index = builder.add_joint(joint.parent, joint.pose, joint.twist, variable[name], factor, offset)
            for name, factor in more:
                builder.couple_joint(index, variable[name], factor)
        for ball in self.tree.rotations:
            builder.add_ball(ball.joint)
        for body in bodies_of(self.tree):
            builder.add_body(*body)
        for name, element in self.elements.items():
            before = builder.counts()
            element.add_to(core.within(name, element.label, element.numbers))
            after = builder.counts()
            weight = isinstance(element, Potential) and after.potentials == before.potentials
            core.parts[name] = Parts(before, after, uniform_gravity=weight)
        for name, value in self.numbers.items():
            builder.set_number(core.parameters[name], value)
        return core


def bodies_of(tree: Tree) -> list[tuple[int, float, Array, Array]]:
    """Return joint, mass, centre (3,) and inertia (3, 3) about it of every body, in the joint's axes."""
    found = []
    # What overflows is refused with the inertia that it makes.
    with np.errstate(over="ignore", invalid="ignore"):
        for joint, body, pose in tree.bodies():
            rotation, origin = pose[:3, :3], pose[:3, 3]
            inertia = rotation @ body.inertia @ rotation.T
            found.append((joint, body.mass, rotation @ body.com + origin, (inertia + inertia.T) / 2.0))
    return found


def plan(
    tree: Tree,
    elements: Sequence[Element],
    *,
    dynamic: Sequence[str] | None = None,
    kinematic: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    numbers: Mapping[str, float] | None = None,
    shared: Mapping[str, Sequence[str]] | None = None,
) -> Plan:
    """Check a description and settle the order of its names.

    ``tree``: the flattened frames. ``elements``: what acts on them. ``dynamic``, ``kinematic``, ``inputs``: the order
    of the names; as first met in the tree, then in the elements, if not given. ``numbers``: values of parameters that
    are no field of their element, other than it gave them. ``shared``: parameters that stand for several.
    Raises `DescriptionError` for anything that does not fit; see `Mechanism`.
    """
    if isinstance(elements, Element):
        raise DescriptionError(f"elements: expected a list, got {elements!r} alone; write [...]")
    if isinstance(elements, (str, Mapping)) or not isinstance(elements, Iterable):
        raise DescriptionError(
            f"elements: expected a list of elements such as Gravity() or Distance(...), got {elements!r}"
        )
    elements = tuple(elements)
    for element in elements:
        if not isinstance(element, Element):
            raise DescriptionError(f"elements: expected elements such as Gravity() or Distance(...), got {element!r}")
    uses = [element.uses for element in elements]
    known = set(tree.dynamic)
    new = [name for use in uses for name in use.kinematic + use.either if name not in known]
    named = _named(elements)
    result = Plan(
        tree=tree,
        elements=named,
        dynamic=_ordered(dynamic, tree.dynamic, "dynamic", "dynamic variables"),
        kinematic=_ordered(kinematic, dict.fromkeys([*tree.kinematic, *new]), "kinematic", "kinematic variables"),
        inputs=_ordered(inputs, dict.fromkeys(name for use in uses for name in use.inputs), "inputs", "inputs"),
        constraints=tuple(name + suffix for name, element in named.items() for suffix in element.equations),
        numbers=dict(numbers or {}),
        shared=checked_groups({} if shared is None else shared),
    )
    for rotation in tree.rotations:
        kind = "kinematic" if rotation.variables[0] in result.kinematic else "dynamic"
        order: tuple[str, ...] = getattr(result, kind)
        first = order.index(rotation.variables[0])
        if order[first : first + 3] != rotation.variables:
            raise DescriptionError(
                f"{kind}: the turns of {rotation.name!r} stand apart; list {', '.join(rotation.variables)} in a row"
            )
    context = result.context()
    for element in elements:
        element.check(context)
    return result


def _named(elements: Sequence[Element]) -> dict[str, Element]:
    """Name every element; the names that the user gave go first."""
    given: dict[str, Element] = {}
    types: set[type[Element]] = set()
    for element in elements:
        if element.unique and type(element) in types:
            raise DescriptionError(
                f"{element.label}: a mechanism holds only one {type(element).__name__}; combine them"
            )
        if element.unique:
            types.add(type(element))
        if element.name is not None and element.name in given:
            raise DescriptionError(
                f"duplicate element name {element.name!r}: given to a "
                f"{type(given[element.name]).__name__} and to a {type(element).__name__}"
            )
        if element.name is not None:
            given[element.name] = element
    taken = set(given)
    named: dict[str, Element] = {}
    for element in elements:
        name, number = element.name or element.default_name, 1
        while element.name is None and name in taken:
            number += 1
            name = f"{element.default_name}#{number}"
        taken.add(name)
        named[name] = element
    return named


def _ordered(given: Sequence[str] | None, found: Iterable[str], argument: str, what: str) -> tuple[str, ...]:
    names = tuple(found)
    if given is None:
        return names
    names_given: object = given
    listed = isinstance(names_given, Iterable) and not isinstance(names_given, str)
    order = tuple(given) if listed else ()
    if not listed or not all(isinstance(name, str) for name in order):
        raise DescriptionError(f"{argument}: expected a list of names, got {given!r}")
    known, listed_times = set(names), Counter(order)
    for name, times in listed_times.items():
        if name not in known:
            raise DescriptionError(f"{argument}: unknown name {name!r}; {closest(name, names, what=what)}")
        if times > 1:
            raise DescriptionError(f"{argument}: {name!r} is listed {times} times")
    missing = [name for name in names if name not in listed_times]
    if missing:
        raise DescriptionError(
            f"{argument}: the order of the {what} lacks {', '.join(map(repr, missing))}; "
            "list every one of them, or leave the argument out"
        )
    return order
