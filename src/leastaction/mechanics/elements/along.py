"""What elements act along: a variable or a sum of them, the length of a path, the places of two frames.

Each is a scalar of the configuration that the core knows with all its derivatives; springs, dampers,
tendons and constraints differ only in what they do with it.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.reading import Factors, factors, path
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class Along(Element):
    """Base of the elements that act along one scalar, their `scalar`."""

    @property
    @abc.abstractmethod
    def scalar(self) -> Sum | Path:
        """What the element acts along."""

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return self.scalar.uses

    def check(self, context: Context) -> None:
        """Check names, and that something moves the scalar; see `Element.check`."""
        super().check(context)
        scalar = self.scalar
        self.check_moved(context, scalar.movers(context), scalar.stuck)
        if isinstance(scalar, Path):
            check_apart(self, context, scalar.frames)

    def coordinate(self, builder: Builder, context: Context) -> int:
        """Add the scalar to the core and return it."""
        return self.scalar.coordinate(builder, context, self)


@dataclass(frozen=True)
class Sum:
    """A configuration variable, or the sum of some with factors.

    ``given``: the name or the factors; only the factors of a mapping are parameters.
    """

    given: str | Factors

    @classmethod
    def read(cls, value: object, what: str) -> str | Factors:
        """Return a checked name or mapping of factors, which can be a field of an element."""
        checked = factors(value, what)
        return value if isinstance(value, str) else checked

    @classmethod
    def of(cls, field: str | Mapping[str, float]) -> Sum:
        """Return the sum of a field that was checked by `read`."""
        return cls(field if isinstance(field, str) else Factors(field))

    @property
    def factors(self) -> Mapping[str, float]:
        """Factor of every variable."""
        return {self.given: 1.0} if isinstance(self.given, str) else self.given

    @property
    def names(self) -> str:
        """The variables, for the name of an element."""
        return ", ".join(self.factors)

    @property
    def uses(self) -> Uses:
        """The variables."""
        return Uses(variables=tuple(self.factors))

    @property
    def stuck(self) -> str:
        """What to say after "no variable" if nothing moves it."""
        names = ", ".join(map(repr, self.factors))
        return f"is among {names}, so nothing can give way to the element; remove it or name a variable that can"

    def movers(self, context: Context) -> tuple[str, ...]:
        """The variables that change it."""
        return tuple(name for name in self.factors if name in context.dynamic + context.kinematic)

    def coordinate(self, builder: Builder, context: Context, element: Element) -> int:
        """Add it to the core; the factors of a mapping are parameters of the element."""
        slots = [
            context.constant(builder, 1.0)
            if isinstance(self.given, str)
            else context.parameter(builder, element, f"factors.{name}", factor)
            for name, factor in self.factors.items()
        ]
        return builder.variables_coordinate([context.variable(n) for n in self.factors], slots)

    def __str__(self) -> str:
        shown = {1.0: "", -1.0: "-"}
        terms = [shown.get(f, f"{f:g} ") + name for name, f in self.factors.items()]
        return " + ".join(terms).replace("+ -", "- ")


@dataclass(frozen=True)
class Path:
    """The length of the straight pieces through the origins of frames, in their order (m).

    The frames between the ends are via-points: pulleys of no radius, eyelets, sheaths of a tendon.
    """

    frames: tuple[str, ...]

    @classmethod
    def read(cls, value: object, what: str) -> tuple[str, ...]:
        """Return checked frames, which can be a field of an element."""
        return path(value, what)

    @property
    def names(self) -> str:
        """The frames, for the name of an element."""
        shown = self.frames if len(self.frames) <= 3 else (self.frames[0], "...", self.frames[-1])
        return ", ".join(shown)

    @property
    def uses(self) -> Uses:
        """The frames."""
        return Uses(frames=self.frames)

    @property
    def stuck(self) -> str:
        """What to say after "no variable" if nothing moves it."""
        return (
            f"moves the frames of the path {self} relative to each other, so nothing can change its length; "
            "remove the element or choose other frames"
        )

    def movers(self, context: Context) -> tuple[str, ...]:
        """The variables that change it."""
        return context.moving(*self.frames)

    def coordinate(self, builder: Builder, context: Context, element: Element) -> int:  # noqa: ARG002
        """Add it to the core."""
        return builder.path_coordinate([context.point(builder, frame) for frame in self.frames])

    def __str__(self) -> str:
        return " to ".join(self.frames)


def with_factor(element: Along, field: str, parameter: str, value: float) -> Element | None:
    """Return the element with another factor of the sum in a field; None if the parameter is no factor."""
    name = parameter.removeprefix("factors.")
    if name == parameter:
        return None
    changed: dict[str, Any] = {field: {**getattr(element, field), name: value}}
    return replace(element, **changed)


def check_apart(element: Element, context: Context, frames: Sequence[str]) -> None:
    """Complain if consecutive frames always coincide, so that their distance has no derivative."""
    for first, second in pairwise(frames):
        if context.always_together(first, second):
            raise DescriptionError(
                f"{element.label}: the origins of {first!r} and {second!r} coincide in every configuration, "
                "and a distance of zero has no direction to act in; choose other frames"
            )


@dataclass(frozen=True)
class Pair(Element):
    """Base of the elements between two frames, which something must be able to move."""

    def __post_init__(self) -> None:
        super().__post_init__()
        first, second = (check_name(frame, f"{self.title}: a frame") for frame in self.ends)
        if first == second:
            raise DescriptionError(
                f"{self.label}: both ends are the frame {first!r}; give two different frames"
            )

    @property
    @abc.abstractmethod
    def ends(self) -> tuple[str, str]:
        """The two frames."""

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=self.ends)

    def check_movable(self, context: Context, task: str, *, turning: bool = False) -> None:
        """Complain that nothing can do the task if no variable moves (turns) one end."""
        first, second = self.ends
        self.check_moved(
            context,
            context.moving(first, second, turning=turning),
            f"{'turns' if turning else 'moves'} {first!r} relative to {second!r}, so "
            f"nothing can {task}; remove the element or choose other frames",
        )

    def check_distance(self, context: Context, task: str) -> None:
        """Complain as `check_movable` does, and if the origins always coincide."""
        self.check_movable(context, task)
        check_apart(self, context, self.ends)

    def points(self, builder: Builder, context: Context) -> tuple[int, int]:
        """Add both origins to the core and return them."""
        first, second = self.ends
        return context.point(builder, first), context.point(builder, second)


@dataclass(frozen=True)
class FramePair(Pair):
    """Base of the elements between two frames of equal standing.

    Parameters
    ----------
    frame1, frame2 : str
        The frames.
    name : str, optional
        Name of the element.
    """

    frame1: str
    frame2: str

    @property
    def ends(self) -> tuple[str, str]:
        """The two frames."""
        return self.frame1, self.frame2
