"""The interface of every element, and what an element may ask about its mechanism.

An element states which names it uses (`Element.uses`), checks itself against the mechanism
(`Element.check`) and adds itself to the core (`Element.add_to`). A new type is a frozen dataclass that
derives from one of the families (`Potential`, `Force`, `Constraint`) and fills in these three; nothing
else has to know of it.
"""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.description.poses import exponential
from leastaction.mechanics.description.tree import WORLD, Tree, TreeFrame
from leastaction.mechanics.elements.builder import Builder as Builder
from leastaction.numerics.arrays import Array
from leastaction.numerics.names import check_name

# Distance of two points, relative to the lengths that it sums, below which it is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Uses:
    """The names that an element uses, by kind; inputs and kinematic variables may be new with it.

    ``variables`` are known variables of either kind.
    """

    frames: tuple[str, ...] = ()
    dynamic: tuple[str, ...] = ()
    kinematic: tuple[str, ...] = ()
    variables: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Context:
    """The mechanism as an element sees it while it is checked and compiled.

    Attributes
    ----------
    tree : Tree
        Frames and joints.
    dynamic, kinematic, inputs : tuple of str
        Names in their final order.
    frames : mapping of str to int
        Index of every frame in ``tree.frames``.
    parameters : dict of str to int
        Slots of the numbers that were added, by names such as ``"spring.stiffness"``.
    owners : dict of str to (str, str)
        Unique name of the element that each of them belongs to, and its name there.
    element : str or None
        Unique name of the element that is being added.
    """

    tree: Tree
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    inputs: tuple[str, ...]
    frames: Mapping[str, int]
    parameters: dict[str, int] = field(default_factory=dict)
    owners: dict[str, tuple[str, str]] = field(default_factory=dict)
    element: str | None = None
    _points: dict[str, int] = field(default_factory=dict)
    _directions: dict[tuple[int, bytes], int] = field(default_factory=dict)
    _constants: dict[float, int] = field(default_factory=dict)

    def within(self, element: str) -> Context:
        """Return the same context, shared, while the element of that unique name is added."""
        return replace(self, element=element)

    @property
    def world(self) -> str:
        """Name of the world frame."""
        return self.tree.frames[0].name

    def variable(self, name: str) -> int:
        """Index of a configuration variable in q: dynamic first, then kinematic."""
        if name in self.dynamic:
            return self.dynamic.index(name)
        return len(self.dynamic) + self.kinematic.index(name)

    def input(self, name: str) -> int:
        """Index of an input in u."""
        return self.inputs.index(name)

    def placed(self, frame: str) -> TreeFrame:
        """Return a frame of the tree: its joint, and its pose there."""
        return self.tree.frames[self.frames[frame]]

    def point(self, builder: Builder, frame: str) -> int:
        """Index of the core's point at a frame's origin; made when first asked for."""
        if frame not in self._points:
            placed = self.placed(frame)
            offset = np.ascontiguousarray(placed.pose[:3, 3])
            self._points[frame] = builder.add_point(placed.joint, offset)
        return self._points[frame]

    def direction(self, builder: Builder, frame: str, vector: npt.ArrayLike) -> int:
        """Index of the core's direction for a vector (3,) in the axes of a frame; made once."""
        placed = self.placed(frame)
        turned = placed.pose[:3, :3] @ np.asarray(vector, dtype=np.float64)
        key = (placed.joint, turned.tobytes())
        if key not in self._directions:
            self._directions[key] = builder.add_direction(placed.joint, turned)
        return self._directions[key]

    def parameter(self, builder: Builder, element: Element, field: str, value: float) -> int:
        """Add a number of an element as the parameter ``"element.field"``; return its slot."""
        return self.record(element, field, builder.add_number(float(value)))

    def record(self, element: Element, field: str, slot: int) -> int:
        """Record a slot that the builder gave to a number of an element; return it."""
        owner = self.element or element.name or element.default_name
        name = f"{owner}.{field}"
        if name in self.parameters:
            other, _ = self.owners[name]
            raise DescriptionError(
                f"{element.label}: its parameter {name!r} is also one of the element {other!r}; give one of "
                "them another name="
            )
        self.parameters[name], self.owners[name] = slot, (owner, field)
        return slot

    def constant(self, builder: Builder, value: float) -> int:
        """Slot of a number that is not a parameter, such as the 1 of a factor left out; made once."""
        if value not in self._constants:
            self._constants[value] = builder.add_number(value)
        return self._constants[value]

    def moving(self, *frames: str, turning: bool = False) -> tuple[str, ...]:
        """The variables that move (or turn) consecutive frames relative to each other, in the order of q.

        For a single frame, relative to the world.
        """
        path = frames if len(frames) > 1 else (self.world, *frames)
        joints: set[int] = set()
        for frame1, frame2 in pairwise(path):
            joints |= set(self._above(frame1)) ^ set(self._above(frame2))
        found = {
            name
            for joint in (self.tree.joints[index] for index in joints)
            if not turning or joint.twist[3:].any()
            for name in joint.variables
        }
        return tuple(name for name in self.dynamic + self.kinematic if name in found)

    def always_together(self, frame1: str, frame2: str) -> bool:
        """Whether the origins of two frames coincide in every configuration.

        Two configurations of no special shape tell: what holds at both holds everywhere.
        """
        common = set(self._above(frame1)) & set(self._above(frame2))
        names = self.dynamic + self.kinematic
        for values in np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(names))):
            at = dict(zip(names, values, strict=True))
            # Lengths near the largest double may overflow; they are not together then.
            with np.errstate(over="ignore", invalid="ignore"):
                (first, reach1), (second, reach2) = (
                    self._origin(frame, common, at) for frame in (frame1, frame2)
                )
                apart = float(np.abs(first - second).max())
            if not apart <= ROUNDING * (reach1 + reach2) < np.inf:
                return False
        return True

    def _origin(
        self, frame: str, common: set[int], values: Mapping[str, float]
    ) -> tuple[Array, float]:
        """Origin of a frame (3,) before the nearest of the common joints, and the lengths it sums."""
        placed = self.placed(frame)
        origin, joint = placed.pose[:3, 3], placed.joint
        reach = float(np.abs(origin).max())
        while joint != WORLD and joint not in common:
            spec = self.tree.joints[joint]
            coordinate = spec.coordinate.offset + sum(
                f * values[name] for name, f in spec.coordinate.terms
            )
            motion = spec.pose @ exponential(spec.twist, coordinate)
            origin = motion[:3, :3] @ origin + motion[:3, 3]
            reach += float(np.abs(spec.pose[:3, 3]).max() + np.abs(motion[:3, 3]).max())
            joint = spec.parent
        return origin, reach

    def _above(self, frame: str) -> tuple[int, ...]:
        joint = self.placed(frame).joint
        return () if joint == WORLD else self.tree.ancestors(joint)


@dataclass(frozen=True)
class Element(abc.ABC):
    """Something that acts on the frames of a mechanism.

    Attributes
    ----------
    name : str or None
        Name of the element, unique in the mechanism; made from the type and what it acts on if None.
    """

    name: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name, f"the name of a {type(self).__name__}")

    @property
    def unique(self) -> bool:
        """Whether a mechanism may hold only one such element."""
        return False

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
    def title(self) -> str:
        """The element for messages while its fields are not checked yet: without a made-up name."""
        kind = type(self).__name__
        return kind if self.name is None else f"{kind} {self.name!r}"

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
        self._known(uses.variables, variables, "variable", "variables")
        self._known(uses.inputs, context.inputs, "input", "inputs")

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; None if that is not one of its fields.

        Raises
        ------
        DescriptionError
            If the element cannot have that value.
        """
        numbers = {f.name for f in fields(self) if isinstance(getattr(self, f.name), float | int)}
        changed: dict[str, Any] = {parameter: value}
        return replace(self, **changed) if parameter in numbers else None

    @abc.abstractmethod
    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core's mechanism. Called after `check`, in the order of the elements."""

    def check_moved(self, context: Context, movers: Iterable[str], why: str) -> None:
        """Raise a `DescriptionError` if no variable is among the movers, with the end of the sentence.

        Constraints ask for a dynamic one.
        """
        if not any(mover in context.dynamic + context.kinematic for mover in movers):
            raise DescriptionError(f"{self.label}: no variable {why}")

    def check_some_dynamic(self, context: Context, movers: Iterable[str], why: str) -> None:
        """Raise a `DescriptionError` with the reason if none of the variables is dynamic."""
        if not set(movers) & set(context.dynamic):
            raise DescriptionError(f"{self.label}: {why}")

    def _known(self, names: Sequence[str], known: Sequence[str], kind: str, kinds: str) -> None:
        for name in names:
            if name not in known:
                raise DescriptionError(
                    f"{self.label}: unknown {kind} {name!r}; {closest(name, known, what=kinds)}"
                )
