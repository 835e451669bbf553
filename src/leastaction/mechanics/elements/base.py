"""The interface of every element, and what an element may ask about its mechanism.

An element states which names it uses (`Element.uses`), checks itself against the mechanism
(`Element.check`) and adds itself to the core (`Element.add_to`). A new type is a frozen dataclass that
derives from one of the families (`Potential`, `Force`, `Constraint`) and fills in these three; nothing
else has to know of it.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import numpy as np

from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.arguments import Array
from leastaction.mechanics.frames import check_name
from leastaction.mechanics.tree import Tree


class Builder(Protocol):
    """The part of the core's mechanism builder that descriptions are compiled to.

    Joints, points, variables and inputs are indices; a joint of -1 is the world.
    """

    def add_joint(self, parent: int, pose: Array, twist: Array, variable: int, /) -> int:
        """Add a joint by its base pose (4, 4) in the parent's moved frame and its twist (6,)."""
        ...

    def add_body(self, joint: int, mass: float, com: Array, inertia: Array, /) -> None:
        """Add a body in the moved frame of a joint; inertia (3, 3) about the centre of mass."""
        ...

    def add_point(self, joint: int, offset: Array, /) -> int:
        """Add a point (3,) in the moved frame of a joint."""
        ...

    def set_gravity(self, g: Array, /) -> None:
        """Set the acceleration of gravity (3,)."""
        ...

    def add_distance(
        self, point1: int, point2: int, length: float, variable: int = -1, /
    ) -> object:
        """Hold the distance of two points; the variable is the length unless it is -1."""
        ...

    def add_coincidence(self, point1: int, point2: int, direction: Array, /) -> object:
        """Let two points coincide along a direction (3,) of the world."""
        ...

    def add_damping(self, variable: int, coefficient: float, /) -> None:
        """Add the force -c v on a variable."""
        ...

    def add_joint_force(self, variable: int, input_index: int, /) -> None:
        """Add an input onto a variable."""
        ...


@dataclass(frozen=True)
class Uses:
    """The names that an element uses, by kind; inputs and kinematic variables may be new with it."""

    frames: tuple[str, ...] = ()
    dynamic: tuple[str, ...] = ()
    kinematic: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Context:
    """The mechanism as an element sees it while it is compiled.

    Attributes
    ----------
    tree : Tree
        Frames and joints.
    dynamic, kinematic, inputs : tuple of str
        Names in their final order.
    frames : mapping of str to int
        Index of every frame in ``tree.frames``.
    """

    tree: Tree
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    inputs: tuple[str, ...]
    frames: Mapping[str, int]
    _points: dict[str, int] = field(default_factory=dict)

    def variable(self, name: str) -> int:
        """Index of a configuration variable in q: dynamic first, then kinematic."""
        if name in self.dynamic:
            return self.dynamic.index(name)
        return len(self.dynamic) + self.kinematic.index(name)

    def input(self, name: str) -> int:
        """Index of an input in u."""
        return self.inputs.index(name)

    def point(self, builder: Builder, frame: str) -> int:
        """Index of the core's point at a frame's origin; made when first asked for."""
        if frame not in self._points:
            placed = self.tree.frames[self.frames[frame]]
            offset = np.ascontiguousarray(placed.pose[:3, 3])
            self._points[frame] = builder.add_point(placed.joint, offset)
        return self._points[frame]

    def joints_between(self, frame1: str, frame2: str) -> tuple[int, ...]:
        """The joints that move one frame relative to the other."""
        first, second = (
            set(self.tree.ancestors(self.tree.frames[self.frames[frame]].joint))
            for frame in (frame1, frame2)
        )
        return tuple(sorted(first ^ second))


@dataclass(frozen=True)
class Element(abc.ABC):
    """Something that acts on the frames of a mechanism.

    Attributes
    ----------
    name : str or None
        Name of the element, unique in the mechanism; made from the type and what it acts on if None.
    """

    name: str | None = field(default=None, kw_only=True)

    unique: ClassVar[bool] = False
    """Whether a mechanism may hold only one element of this type."""

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name, f"the name of a {type(self).__name__}")

    @property
    @abc.abstractmethod
    def uses(self) -> Uses:
        """The names that the element uses."""

    @property
    @abc.abstractmethod
    def default_name(self) -> str:
        """The name if none is given; numbered by the mechanism where several elements share it."""

    @property
    def equations(self) -> tuple[str, ...]:
        """Suffixes of the scalar constraint equations that the element adds; ("",) for a single one."""
        return ()

    @property
    def label(self) -> str:
        """The element for messages, such as ``Distance 'string'``."""
        return f"{type(self).__name__} {self.name or self.default_name!r}"

    @abc.abstractmethod
    def describe(self) -> str:
        """Return the values of the element in a few words, for the printed mechanism."""

    def check(self, context: Context) -> None:
        """Raise a `DescriptionError` if the element does not fit the mechanism.

        Checks that every name is known and of the right kind; types with more to check extend it.
        """
        uses = self.uses
        self._known(uses.frames, tuple(context.frames), "frame", "frames")
        variables = context.dynamic + context.kinematic
        kinds = (
            (uses.dynamic, context.dynamic, "dynamic", context.kinematic, "kinematic"),
            (uses.kinematic, context.kinematic, "kinematic", context.dynamic, "dynamic"),
        )
        for names, right, wanted, wrong, other in kinds:
            for name in names:
                if name in wrong:
                    raise DescriptionError(
                        f"{self.label}: {name!r} is a {other} variable where a {wanted} one is needed; "
                        f"{closest(None, right, what=f'{wanted} variables')}"
                    )
            self._known(names, variables, "variable", "variables")
        self._known(uses.inputs, context.inputs, "input", "inputs")

    @abc.abstractmethod
    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core's mechanism. Called after `check`, in the order of the elements."""

    def _known(self, names: Sequence[str], known: Sequence[str], kind: str, kinds: str) -> None:
        for name in names:
            if name not in known:
                raise DescriptionError(
                    f"{self.label}: unknown {kind} {name!r}; {closest(name, known, what=kinds)}"
                )
