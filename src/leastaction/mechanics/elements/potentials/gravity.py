"""Gravity: uniform, and with the inverse square of a distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from leastaction.errors import DescriptionError, closest
from leastaction.mechanics.description.bodies import Body
from leastaction.mechanics.elements.base import Potential
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.fields import END, VECTOR, not_zero
from leastaction.mechanics.elements.kinds import Kind, Names, Uses
from leastaction.mechanics.expressions.tapes import TapeWriter, dot
from leastaction.numerics.public import public

_FRAMES = Names("frames")


@dataclass(frozen=True)
class _Heavy(Kind):
    """Frames with a mass, each once."""

    def read(self, value: object, what: str) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence) or not value:
            raise DescriptionError(
                f"{what}: expected a list of frames, got {value!r}; leave it out for gravity on every mass"
            )
        names = _FRAMES.read(value, what)
        if len(set(names)) < len(names):
            raise DescriptionError(f"{what}: {list(names)} names a frame twice")
        return names

    def uses(self, value: tuple[str, ...]) -> Uses:
        return _FRAMES.uses(value)

    def acts_on(self, value: tuple[str, ...]) -> tuple[str, ...]:
        return _FRAMES.acts_on(value)


@public
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

    Raises
    ------
    DescriptionError
        If the vector is not three finite numbers, or a frame is named twice or carries no mass.

    Notes
    -----
    The vector is a parameter, ``"gravity.vector.z"`` (m/s^2). With frames, the mass that gravity sees is one of its own
    for every frame, ``"gravity.mass.<frame>"`` (kg): the sum over the frame's bodies, at their centre of mass.
    """

    vector: Sequence[float] = field(default=(0.0, 0.0, -9.81), metadata=VECTOR)
    frames: Sequence[str] | None = field(default=None, metadata={"kind": _Heavy()})

    called = "gravity"
    reads = "{vector} m/s^2"

    @property
    def unique(self) -> bool:
        return self.frames is None

    @property
    def weighed(self) -> tuple[str, ...]:
        return tuple(self.frames or ())

    @property
    def down(self) -> tuple[float, float, float] | None:
        x, y, z = (float(c) for c in self.vector)
        return (x, y, z) if self.frames is None and (x, y, z) != (0.0, 0.0, 0.0) else None

    def describe(self) -> str:
        return super().describe() + (f" on {', '.join(self.frames)}" if self.frames else "")

    def check(self, context: Context) -> None:
        super().check(context)
        for frame in self.frames or ():
            if _mass(_bodies(context, frame)) == 0.0:
                heavy = [name for name in context.frames if _mass(_bodies(context, name)) > 0.0]
                raise DescriptionError(
                    f"{self.label}: the frame {frame!r} carries no mass; "
                    f"{closest(None, heavy, what='frames with a mass')}"
                )

    def add_to(self, core: Compiler) -> None:
        if self.frames is None:
            first = core.builder.set_gravity(np.array(self.vector))
            for number, axis in enumerate("xyz"):
                core.record(f"vector.{axis}", first + number)
            return
        slots = [core.slot(f"vector.{axis}") for axis in "xyz"]
        for frame in self.frames:
            bodies, placed = _bodies(core.context, frame), core.context.placed(frame)
            mass = _mass(bodies)
            com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
            centre = core.builder.add_point(placed.joint, placed.pose[:3, :3] @ com + placed.pose[:3, 3])
            tape = TapeWriter(6)
            height = core.builder.tape_coordinate(
                [centre], [], [], tape.end(-dot(tape.inputs[:3], tape.inputs[3:])), slots
            )
            slot = core.parameter(f"mass.{frame}", mass)
            core.potential(height, core.builder.law("linear", [slot]))


def _bodies(context: Context, frame: str) -> tuple[Body, ...]:
    return context.placed(frame).frame.bodies


def _mass(bodies: Sequence[Body]) -> float:
    return sum(body.mass for body in bodies)


@public
@dataclass(frozen=True)
class InverseSquareGravity(Potential):
    """Attraction between two frames with the inverse square of their distance: ``V = -k / |p1 - p2|``.

    Newton's law of gravity with ``k = G m1 m2``, Coulomb's law of charges with ``k = -q1 q2 / (4 pi eps0)``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins attract each other. They must not meet, where the energy has no bound.
    strength : float
        The constant k (N m^2); positive attracts, negative repels.

    Raises
    ------
    DescriptionError
        If both are the same frame or the strength is zero or not finite.
    """

    frame1: str = field(metadata=END)
    frame2: str = field(metadata=END)
    strength: float = field(metadata=not_zero("so that something acts", unit="N m^2"))

    called = "inverse_square_gravity"
    reads = "{frame1} to {frame2}, {strength}"
    task = "follow the attraction"

    def add_to(self, core: Compiler) -> None:
        tape = TapeWriter(2)
        distance, k = tape.inputs
        law = core.builder.tape_law(tape.end(-(k / distance)), [core.slot("strength")])
        core.potential(core.path((self.frame1, self.frame2)), law)
