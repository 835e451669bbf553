"""Potential energies: terms of V in L = T - V. Those of springs are in `springs`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.elements.along import FramePair
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.reading import number, three
from leastaction.mechanics.expressions.tapes import TapeWriter
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class Potential(Element):
    """Base of the elements that add to the potential energy."""


@dataclass(frozen=True)
class Gravity(Potential):
    """Uniform gravity: ``V = -m g . p`` with p the centre of mass, for every mass or for some.

    Parameters
    ----------
    vector : array_like, shape (3,), optional
        Acceleration of gravity in world axes (m/s^2). Along -z by default.
    frames : sequence of str, optional
        The frames on whose bodies it acts; on every body if not given. A mechanism holds one gravity for
        all at most, and as many for some as it likes; what acts on the same body adds up.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the vector is not three finite numbers, or a frame is named twice or carries no mass.

    Notes
    -----
    With frames, the mass that gravity sees is a parameter of its own for every frame,
    ``"gravity.mass.<frame>"`` (kg): the sum over the frame's bodies, at their centre of mass.
    """

    vector: Sequence[float] = (0.0, 0.0, -9.81)
    frames: Sequence[str] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "vector", three(self.vector, f"{self.title}: vector"))
        if self.frames is None:
            return
        given: object = self.frames
        if isinstance(given, str) or not isinstance(given, Sequence) or not given:
            raise DescriptionError(
                f"{self.title}: frames: expected a list of frames, got {given!r}; leave it out for "
                "gravity on every mass"
            )
        names = tuple(check_name(frame, f"{self.title}: frames") for frame in given)
        if len(set(names)) < len(names):
            raise DescriptionError(f"{self.title}: frames: {list(names)} names a frame twice")
        object.__setattr__(self, "frames", names)

    @property
    def unique(self) -> bool:
        """Gravity on every mass exists once."""
        return self.frames is None

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=tuple(self.frames or ()))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return "gravity" if self.frames is None else f"gravity({', '.join(self.frames)})"

    def describe(self) -> str:
        """Return the values in a few words."""
        where = "" if self.frames is None else f" on {', '.join(self.frames)}"
        return f"({', '.join(f'{value:g}' for value in self.vector)}) m/s^2{where}"

    def check(self, context: Context) -> None:
        """Check names, and that every frame carries a mass; see `Element.check`."""
        super().check(context)
        for frame in self.frames or ():
            if _mass(_bodies(context, frame)) == 0.0:
                heavy = [name for name in context.frames if _mass(_bodies(context, name)) > 0.0]
                raise DescriptionError(
                    f"{self.label}: the frame {frame!r} carries no mass; "
                    f"{closest(None, heavy, what='frames with a mass')}"
                )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        g = np.array(self.vector)
        if self.frames is None:
            builder.set_gravity(g)
            return
        origin = context.point(builder, context.world)
        upwards = context.direction(builder, context.world, -g)
        for frame in self.frames:
            bodies = _bodies(context, frame)
            mass = _mass(bodies)
            com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
            placed = context.placed(frame)
            offset = placed.pose[:3, :3] @ com + placed.pose[:3, 3]
            height = builder.component_coordinate(
                builder.add_point(placed.joint, offset), origin, upwards
            )
            slot = context.parameter(builder, self, f"mass.{frame}", mass)
            builder.add_potential(height, builder.law("linear", [slot]))


def _bodies(context: Context, frame: str) -> tuple[Body, ...]:
    spec = context.placed(frame).spec
    return () if spec is None else spec.bodies


def _mass(bodies: Sequence[Body]) -> float:
    return sum(body.mass for body in bodies)


@dataclass(frozen=True)
class InverseSquareGravity(FramePair, Potential):
    """Attraction between two frames with the inverse square of their distance: ``V = -k / |p1 - p2|``.

    Newton's law of gravity with ``k = G m1 m2``, Coulomb's law of charges with ``k = -q1 q2 / (4 pi eps0)``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins attract each other. They must not meet, where the energy has no bound.
    strength : float
        The constant k (N m^2); positive attracts, negative repels.
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame or the strength is zero or not finite.
    """

    strength: float

    def __post_init__(self) -> None:
        super().__post_init__()
        strength = number(self.strength, f"{self.title}: strength")
        if strength == 0.0:
            raise DescriptionError(
                f"{self.title}: strength: got zero, so nothing acts; give a number that is not, or remove it"
            )
        object.__setattr__(self, "strength", strength)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"inverse_square_gravity({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame1} to {self.frame2}, {self.strength:g} N m^2"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_distance(context, "follow the attraction")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        tape = TapeWriter(2)
        distance, k = tape.inputs
        slot = context.parameter(builder, self, "strength", self.strength)
        builder.add_potential(
            builder.path_coordinate(list(self.points(builder, context))),
            builder.tape_law(tape.end(-(k / distance)), [slot]),
        )
