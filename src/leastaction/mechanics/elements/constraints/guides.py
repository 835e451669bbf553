"""Constraints that lead a point: on a plane, on a line, along a prescribed path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.directions import Direction, triad, vector
from leastaction.mechanics.elements.fields import AXIS, FRAME, KINEMATIC
from leastaction.mechanics.elements.looks import Push, along_axes
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class PointOnPlane(Constraint):
    """Keep the origin of a frame on a plane of another: ``h = n . (p_plane - p_frame)``.

    Parameters
    ----------
    plane : str
        The frame that carries the plane; its origin is on it.
    frame : str
        The frame whose origin stays on the plane.
    normal : str or array_like, shape (3,), optional
        The normal n in the axes of the plane's frame: ``"x"``, ``"y"``, ``"z"`` or three numbers. It is
        taken as long as it is given: h is in metres for a unit vector.

    Raises
    ------
    DescriptionError
        If both are the same frame or the normal is none.
    """

    plane: str = field(metadata=FRAME)
    frame: str = field(metadata=FRAME)
    normal: Direction = field(default="z", metadata=AXIS)

    called = "point_on_plane"
    reads = "{frame} on the plane of {plane} across {normal}"
    task = "keep the point on the plane"

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m",)

    @property
    def pushes(self) -> tuple[Push, ...]:
        x, y, z = (-float(c) for c in vector(self.normal))
        return (Push(self.frame, (((x, y, z), ""),), axes=self.plane),)

    def add_to(self, core: Compiler) -> None:
        normal = vector(self.normal)
        core.constraint(core.component(self.plane, self.frame, self.plane, normal))


@public
@dataclass(frozen=True)
class PointOnLine(Constraint):
    """Keep the origin of a frame on a line of another: ``h_i = e_i . (p_line - p_frame)`` (m).

    Two equations, ``name.across1`` and ``name.across2``, along unit vectors across the line that are
    fixed in its frame: for an axis the two next axes, such as y and z for ``"x"``.

    Parameters
    ----------
    line : str
        The frame that carries the line, which passes through its origin.
    frame : str
        The frame whose origin stays on the line.
    direction : str or array_like, shape (3,), optional
        Direction of the line in the axes of its frame: ``"x"``, ``"y"``, ``"z"`` or three numbers.

    Raises
    ------
    DescriptionError
        If both are the same frame or the direction is none.

    Notes
    -----
    In a plane mechanism one of the equations is always met; `PointOnPlane` with the normal in the plane
    then does without it.
    """

    line: str = field(metadata=FRAME)
    frame: str = field(metadata=FRAME)
    direction: Direction = field(default="x", metadata=AXIS)

    called = "point_on_line"
    reads = "{frame} on the line of {line} along {direction}"
    task = "keep the point on the line"

    @property
    def equations(self) -> tuple[str, ...]:
        return (".across1", ".across2")

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m", "m")

    @property
    def pushes(self) -> tuple[Push, ...]:
        across = [tuple(-float(c) for c in side) for side in triad(self.direction)[1:]]
        terms = tuple(((x, y, z), suffix) for (x, y, z), suffix in zip(across, self.equations, strict=True))
        return (Push(self.frame, terms, axes=self.line),)

    def add_to(self, core: Compiler) -> None:
        for across in triad(self.direction)[1:]:
            core.constraint(core.component(self.line, self.frame, self.line, across))


@public
@dataclass(frozen=True)
class PrescribedPath(Constraint):
    """Lead the origin of a frame along a prescribed path: ``h = p[axis] - rho[axis]`` (m).

    One equation, ``name.x`` and so on, for each coordinate in world axes that is prescribed. The multiplier
    is the impulse of the force that it takes.

    Parameters
    ----------
    frame : str
        The frame.
    x, y, z : str, optional
        The kinematic variables that prescribe its coordinates; those that are left out stay free. A name
        that no frame uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If no coordinate is prescribed, or one by a variable that moves the frame itself.
    """

    frame: str = field(metadata=FRAME)
    x: str | None = field(default=None, metadata=KINEMATIC)
    y: str | None = field(default=None, metadata=KINEMATIC)
    z: str | None = field(default=None, metadata=KINEMATIC)

    called = "prescribed_path"
    task = "follow the path"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.prescribed:
            raise DescriptionError(
                f"{self.label}: no coordinate is prescribed; give one of x=, y=, z= the name of a kinematic variable"
            )

    @property
    def prescribed(self) -> dict[str, str]:
        """The kinematic variable of every axis that is prescribed."""
        given = {"x": self.x, "y": self.y, "z": self.z}
        return {axis: name for axis, name in given.items() if name is not None}

    @property
    def equations(self) -> tuple[str, ...]:
        return tuple(f".{axis}" for axis in self.prescribed)

    @property
    def pushes(self) -> tuple[Push, ...]:
        return (Push(self.frame, along_axes({axis: f".{axis}" for axis in self.prescribed})),)

    def describe(self) -> str:
        return f"{self.frame} at {', '.join(f'{a} = {name}' for a, name in self.prescribed.items())}"

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        return dict.fromkeys(self.prescribed.values(), "m")

    def equation_units(self, of: Mapping[str, str]) -> tuple[str, ...]:
        return ("m",) * len(self.equations)

    def add_to(self, core: Compiler) -> None:
        world = core.context.world
        for axis, name in self.prescribed.items():
            coordinate = core.component(self.frame, world, world, vector(axis))
            core.constraint(coordinate, axis, name)
