"""Constraints that lead a point: on a plane, on a line, along a prescribed path."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.along import Pair
from leastaction.mechanics.elements.base import Builder, Context, Uses
from leastaction.mechanics.elements.constraints.distances import Constraint, refuse_own_variable
from leastaction.mechanics.elements.reading import Direction, direction, show, triad, vector
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class PointOnPlane(Pair, Constraint):
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
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame or the normal is none.
    """

    plane: str
    frame: str
    normal: Direction = "z"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "normal", direction(self.normal, f"{self.title}: normal"))

    @property
    def ends(self) -> tuple[str, str]:
        """The two frames."""
        return self.plane, self.frame

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"point_on_plane({self.plane}, {self.frame})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame} on the plane of {self.plane} across {show(self.normal)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_movable(context, "keep the point on the plane")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        normal = context.direction(builder, self.plane, vector(self.normal))
        first, second = self.points(builder, context)
        builder.add_constraint(builder.component_coordinate(first, second, normal))


@dataclass(frozen=True)
class PointOnLine(Pair, Constraint):
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
    name : str, optional

    Raises
    ------
    DescriptionError
        If both are the same frame or the direction is none.

    Notes
    -----
    In a plane mechanism one of the equations is always met; `PointOnPlane` with the normal in the plane
    then does without it.
    """

    line: str
    frame: str
    direction: Direction = "x"

    def __post_init__(self) -> None:
        super().__post_init__()
        checked = direction(self.direction, f"{self.title}: direction")
        object.__setattr__(self, "direction", checked)

    @property
    def ends(self) -> tuple[str, str]:
        """The two frames."""
        return self.line, self.frame

    @property
    def equations(self) -> tuple[str, ...]:
        """Two equations across the line."""
        return (".across1", ".across2")

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"point_on_line({self.line}, {self.frame})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame} on the line of {self.line} along {show(self.direction)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_movable(context, "keep the point on the line")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        first, second = self.points(builder, context)
        for across in triad(self.direction)[1:]:
            along = context.direction(builder, self.line, across)
            builder.add_constraint(builder.component_coordinate(first, second, along))


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
    name : str, optional

    Raises
    ------
    DescriptionError
        If no coordinate is prescribed, or one by a variable that moves the frame itself.
    """

    frame: str
    x: str | None = None
    y: str | None = None
    z: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name(self.frame, f"{self.title}: frame")
        for axis in "xyz":
            if getattr(self, axis) is not None:
                check_name(getattr(self, axis), f"{self.title}: {axis}, a kinematic variable")
        if not self.prescribed:
            raise DescriptionError(
                f"{self.label}: no coordinate is prescribed; give one of x=, y=, z= the name of a kinematic "
                "variable"
            )

    @property
    def prescribed(self) -> dict[str, str]:
        """The kinematic variable of every axis that is prescribed."""
        given = {"x": self.x, "y": self.y, "z": self.z}
        return {axis: name for axis, name in given.items() if name is not None}

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=(self.frame,), kinematic=tuple(dict.fromkeys(self.prescribed.values())))

    @property
    def equations(self) -> tuple[str, ...]:
        """One equation a prescribed axis."""
        return tuple(f".{axis}" for axis in self.prescribed)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"prescribed_path({self.frame})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return (
            f"{self.frame} at {', '.join(f'{a} = {name}' for a, name in self.prescribed.items())}"
        )

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_moved(
            context,
            context.moving(self.frame),
            f"moves {self.frame!r}, so nothing can follow the path; remove the "
            "constraint or choose another frame",
        )
        for axis, name in self.prescribed.items():
            refuse_own_variable(self, name, context, (self.frame,), axis)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        point = context.point(builder, self.frame)
        origin = context.point(builder, context.world)
        for axis, name in self.prescribed.items():
            along = context.direction(builder, context.world, vector(axis))
            coordinate = builder.component_coordinate(point, origin, along)
            builder.add_constraint(coordinate, -1, context.variable(name))
