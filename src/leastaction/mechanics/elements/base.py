"""What an element is, in one place.

An element is a frozen dataclass whose fields say what they are (`leastaction.mechanics.elements.fields`),
with the words that it is described by and one method, `Element.add_to`, which states its formula to the
core: most are a scalar coordinate with a law around it. Checks, names, parameters and text follow from the
fields, here. A new type derives from `Potential`, `Force` or `Constraint`; nothing else has to know of it.
"""

from __future__ import annotations

import abc
from collections.abc import Collection, Iterator, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar

from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.kinds import Frame, Kind, Uses
from leastaction.mechanics.elements.looks import Look, LookKind, Push
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import check_name


@cache
def _declared(cls: type[Element]) -> tuple[tuple[str, Kind, bool], ...]:
    """Name and kind of every field of a type that has one, and whether it may be None."""
    return tuple((f.name, f.metadata["kind"], f.default is None) for f in fields(cls) if "kind" in f.metadata)


@dataclass(frozen=True)
class Element(abc.ABC):
    """Something that acts on the frames of a mechanism. Frozen: threads may share it.

    Attributes
    ----------
    name : str or None
        Name of the element, unique in the mechanism; made from the type and what it acts on if None.

    Notes
    -----
    A type declares: ``called``, the first part of the name that is made; ``reads``, the words of `describe`,
    with fields in braces; ``task``, what the frames that it names must be able to do, which is to turn where
    ``turning``; ``needs_dynamic``, whether a dynamic variable must be able to; ``highest_order``, to which
    order the core can differentiate it; ``seen_as``, what is drawn between its frames, nothing if None.
    """

    name: str | None = field(default=None, kw_only=True)

    called: ClassVar[str]
    reads: ClassVar[str]
    task: ClassVar[str] = ""
    turning: ClassVar[bool] = False
    needs_dynamic: ClassVar[bool] = False
    highest_order: ClassVar[int] = 4
    seen_as: ClassVar[LookKind | None] = None

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name, f"the name of a {type(self).__name__}")
        for name, kind, optional in _declared(type(self)):
            value = getattr(self, name)
            if value is not None or not optional:
                object.__setattr__(self, name, kind.read(value, f"{self.title}: {name}"))
        ends = self._ends
        if len(ends) == 2 and ends[0] == ends[1]:
            raise DescriptionError(f"{self.label}: both ends are the frame {ends[0]!r}; give two different frames")

    def _held(self) -> Iterator[tuple[str, Kind, Any]]:
        """Name, kind and value of every declared field that is not left out."""
        for name, kind, _ in _declared(type(self)):
            value = getattr(self, name)
            if value is not None:
                yield name, kind.for_value(value), value

    # What the fields say

    @property
    def uses(self) -> Uses:
        """The names that the element uses."""
        return sum((kind.uses(value) for _, kind, value in self._held()), Uses())

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the fields, by name; those that the core is given are parameters."""
        found: dict[str, float] = {}
        for name, kind, value in self._held():
            found.update(kind.numbers(name, value))
        return found

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; None if that is not one of its fields.

        Raises
        ------
        DescriptionError
            If the element cannot have that value.
        """
        for name, kind, held in self._held():
            if parameter in kind.numbers(name, held):
                changed: dict[str, Any] = {name: kind.with_number(name, held, parameter, value)}
                return replace(self, **changed)
        return None

    @property
    def default_name(self) -> str:
        """The name if none is given; numbered by the mechanism where several elements share it."""
        on = dict.fromkeys(n for _, kind, value in self._held() for n in kind.acts_on(value))
        on = on or dict.fromkeys(self.uses.frames + self.uses.variables)
        return f"{self.called}({', '.join(on)})" if on else self.called

    @property
    def title(self) -> str:
        """The element for messages while its fields are not checked yet: without a made-up name."""
        kind = type(self).__name__
        return kind if self.name is None else f"{kind} {self.name!r}"

    @property
    def label(self) -> str:
        """The element for messages, such as ``Distance 'string'``."""
        return f"{type(self).__name__} {self.name or self.default_name!r}"

    def describe(self) -> str:
        """Return the values of the element in a few words, for the printed mechanism."""
        return self.reads.format(**{name: kind.show(value) for name, kind, value in self._held()})

    # What it answers about itself

    @property
    def unique(self) -> bool:
        """Whether a mechanism may hold only one such element."""
        return False

    @property
    def equations(self) -> tuple[str, ...]:
        """Suffixes of the scalar constraint equations that the element adds; ("",) for a single one."""
        return ()

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        """Return the units of inputs, and of variables that prescribe numbers of it, by name; as far as it knows them.

        ``of``: units of the variables that move joints, by name.
        """
        values = ((kind, getattr(self, name)) for name, kind, _ in _declared(type(self)))
        return {name: unit for kind, value in values for name, unit in kind.prescribed(value).items()}

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        """Return the unit of each of its `equations`, "" where it knows none; ``of`` as above."""
        return ("",) * len(self.equations)

    @property
    def strings(self) -> tuple[tuple[str, ...], ...]:
        """Paths of frames whose length it is made of, so that no piece of them may be zero."""
        held = tuple(self._held())
        ends = tuple(value for _, kind, value in held if isinstance(kind, Frame) and kind.end)
        paths = tuple(path for _, kind, value in held for path in kind.strings(value))
        return (*paths, ends) if ends else paths

    @property
    def length_variable(self) -> str | None:
        """The variable that prescribes the length of a string, which must stay positive."""
        return None

    @property
    def geared(self) -> Mapping[str, float]:
        """The variables whose motion turns it as a rotor, by their factors; none if it has no inertia."""
        return {}

    @property
    def weighed(self) -> tuple[str, ...]:
        """Frames whose mass it took over from their bodies as a number of its own."""
        return ()

    def tension(self, impulse: Array, dt: Array, start: Mapping[str, Array]) -> Array | None:
        """Return the tension of a string (N) from its multiplier; None if the element is no string.

        Parameters
        ----------
        impulse : ndarray, shape (N,)
            Multiplier of its equation over steps of length ``dt`` (N,).
        start : mapping of str to ndarray, shape (N,)
            Configuration variables at the start of each step.
        """
        return None

    def slope(self, pieces: Mapping[tuple[str, str], Array], values: Mapping[str, Array | float]) -> Array | None:
        """Return the slope of its function by the lengths of all pieces of a cord; None where it is none of a cord.

        Parameters
        ----------
        pieces : mapping of pairs of frames to ndarray, shape (N,)
            Distances of frames, of any pair.
        values : mapping of str to ndarray, shape (N,), or float
            Configuration variables, and the element's numbers by their own names.
        """
        return None

    # What it looks like

    @property
    def down(self) -> tuple[float, float, float] | None:
        """The direction, in world axes, in which everything falls by it; None of what is no gravity for all."""
        return None

    @property
    def looks(self) -> tuple[Look, ...]:
        """The lines that it is seen as, through frames."""
        if self.seen_as is None:
            return ()
        held = tuple(self._held())
        ends = tuple(value for _, kind, value in held if isinstance(kind, Frame) and kind.end)
        paths = [path for _, kind, value in held for path in kind.strings(value)]
        return tuple(Look(self.seen_as, path) for path in (*paths, ends) if path)

    @property
    def pushes(self) -> tuple[Push, ...]:
        """The forces and torques that it exerts on frames or joints, where they are not along its looks."""
        return ()

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array | None:
        """Return the tension (N) along its looks, positive where they pull; None where only a multiplier knows it.

        Parameters
        ----------
        length, rate : ndarray, shape (N,)
            Length (m) of the line that it is seen as, and its rate (m/s).
        values : mapping of str to ndarray, shape (N,)
            Variables and inputs at the same instants.
        """
        return None

    # What it asks of the mechanism, and does to it

    def check(self, context: Context) -> None:
        """Raise a `DescriptionError` if the element does not fit the mechanism.

        Checks that every name is known and of the right kind, that something moves what the element acts along, and
        that no string has a piece of no length; types with more to check extend it.
        """
        self._check_names(context)
        movers: set[str] = set()
        ends, turns = self._ends, "turns" if self.turning else "moves"
        if ends:
            what = " relative to ".join(map(repr, ends))
            other = "other frames" if len(ends) > 1 else "another frame"
            why = f"{turns} {what}, so nothing can {self.task}; remove the element or choose {other}"
            movers |= self.check_moved(context, context.moving(*ends, turning=self.turning), why)
        for _, kind, value in self._held():
            moved = kind.movers(value, context)
            if moved is not None:
                movers |= self.check_moved(context, *moved)
        for first, second in (piece for string in self.strings for piece in pairwise(string)):
            if context.always_together(first, second):
                raise DescriptionError(
                    f"{self.label}: the origins of {first!r} and {second!r} coincide in every configuration, "
                    "and a distance of zero has no direction to act in; choose other frames"
                )
        for name, kind, value in self._held():
            uses = kind.uses(value)
            if not movers.isdisjoint(uses.kinematic + uses.either):
                raise DescriptionError(
                    f"{self.label}: {name} {value!r} is also a variable that moves what the element acts on; "
                    "give it a variable of its own"
                )

    @abc.abstractmethod
    def add_to(self, core: Compiler) -> None:
        """Add the element to the core's mechanism. Called after `check`, in the order of the elements."""

    def check_moved(self, context: Context, movers: AbstractSet[str], why: str) -> AbstractSet[str]:
        """Return the movers; raise a `DescriptionError` with the end of the sentence if there are none."""
        if not movers or (self.needs_dynamic and context.is_dynamic.isdisjoint(movers)):
            kind = "dynamic variable" if self.needs_dynamic else "variable"
            raise DescriptionError(f"{self.label}: no {kind} {why}")
        return movers

    @property
    def _ends(self) -> tuple[str, ...]:
        """The frames that fields name one by one."""
        return tuple(value for _, kind, value in self._held() if isinstance(kind, Frame))

    def _check_names(self, context: Context) -> None:
        uses = self.uses
        kinds: tuple[tuple[tuple[str, ...], Collection[str], Collection[str], str], ...] = (
            (uses.frames, context.frames, context.tree.named, "frame"),
            (uses.dynamic + uses.kinematic + uses.variables, context.variables, context.variables, "variable"),
            (uses.inputs, context.inputs, context.inputs, "input"),
        )
        for needed, wrong, kind, other in (
            (uses.dynamic, context.kinematic, "dynamic", "kinematic"),
            (uses.kinematic, context.dynamic, "kinematic", "dynamic"),
        ):
            for name in needed:
                if name in wrong:
                    right = getattr(context, kind)
                    raise DescriptionError(
                        f"{self.label}: {name!r} is a {other} variable where a {kind} one is needed; "
                        f"{closest(None, right, what=f'{kind} variables')}"
                    )
        for names, known, told, kind in kinds:
            for name in names:
                if name not in known:
                    raise DescriptionError(
                        f"{self.label}: unknown {kind} {name!r}; {closest(name, tuple(told), what=f'{kind}s')}"
                    )


class Potential(Element):
    """Base of the elements that add to the potential energy."""


class Force(Element):
    """Base of the elements that exert a force."""

    highest_order = 3


class Constraint(Element):
    """Base of the elements that add constraint equations; adds a single one unless it says otherwise."""

    needs_dynamic = True

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation, with the name of the element."""
        return ("",)

    def as_spring(self, stiffness: float) -> Element | None:
        """Return a spring (N/m) that pulls back where the constraint would hold; None if there is none.

        It has the constraint's name, and the same variables.
        """
        return None

    def as_string(self, stiffness: float, smoothing: float) -> Element | None:
        """Return an elastic string (N/m), slack where it is shorter by `smoothing` (m); None for what is no string."""
        return None

    def as_force(self, tension: str) -> Element | None:
        """Return the force of a string whose tension (N) is an input of this name; None if the element is no string."""
        return None
