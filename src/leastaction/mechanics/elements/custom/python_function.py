"""Elements that the user writes as a Python class with value, gradient and Hessian.

They work everywhere, but every evaluation calls Python: an expression (`ExpressionPotential`) runs a hundred
times faster. Hold a new class to its own definition with `check_derivatives`.
"""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics.elements.base import Context, Uses
from leastaction.mechanics.elements.builder import Builder
from leastaction.mechanics.elements.constraints.distances import Constraint
from leastaction.mechanics.elements.custom.expression import movers
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.potentials.gravity import Potential
from leastaction.mechanics.expressions.terms import unit_vector
from leastaction.numerics.arrays import as_number
from leastaction.numerics.names import check_name

Direction = tuple[str, str | Sequence[float]]


class PythonFunction(abc.ABC):
    """A scalar function f(z) of the user's own, with its gradient and Hessian.

    z (m,) holds x y z of every point, x y z of every direction (all in world axes), then the variables, in the
    order in which the element names them. The methods must take complex z and follow it analytically: write
    them with NumPy's functions, without `abs`, `arctan2`, `real`, `conj` or comparisons of z. The third order is the
    complex-step derivative of the Hessian, exact to rounding.

    Nothing may change between calls with the same z.
    """

    @abc.abstractmethod
    def value(self, z: npt.NDArray[Any]) -> Any:
        """Return f(z), a scalar."""

    @abc.abstractmethod
    def gradient(self, z: npt.NDArray[Any]) -> npt.ArrayLike:
        """Return df/dz, shape (m,)."""

    @abc.abstractmethod
    def hessian(self, z: npt.NDArray[Any]) -> npt.ArrayLike:
        """Return d2f/dz2, shape (m, m), symmetric."""


@dataclass(frozen=True)
class _Called:
    """What the core calls: a `PythonFunction` up to an order (0, 1, 2), with its shapes checked."""

    function: PythonFunction
    title: str

    def __call__(self, z: npt.NDArray[Any], order: int) -> tuple[Any, Any, Any]:
        value = self.array("value", z, ())
        gradient = self.array("gradient", z, (z.size,)) if order >= 1 else None
        hessian = self.array("hessian", z, (z.size, z.size)) if order >= 2 else None
        return value[()], gradient, hessian

    def array(self, method: str, z: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
        result = np.asarray(getattr(self.function, method)(z))
        if result.shape != shape or result.dtype.kind not in "iufc":
            raise ArgumentError(
                f"{self.title}: {type(self.function).__name__}.{method} returned {result.dtype} of shape "
                f"{result.shape}, expected numbers of shape {shape}"
            )
        if result.dtype.kind == "c" and z.dtype.kind != "c":
            raise ArgumentError(
                f"{self.title}: {type(self.function).__name__}.{method} returned complex numbers for real z; "
                "it must be real there"
            )
        return np.asarray(result, dtype=z.dtype, order="C")


@dataclass(frozen=True)
class PythonPotential(Potential):
    """A potential energy of the user's own: ``V = f(z)`` (J) with f in Python.

    Parameters
    ----------
    function : PythonFunction
        f, with its gradient and Hessian.
    points : sequence of str, optional
        Frames whose origins are the first part of z.
    directions : sequence of (str, vector), optional
        Frames and unit vectors fixed in them (``"x"``, ``"y"``, ``"z"`` or three numbers): the next part of z.
    variables : sequence of str, optional
        Configuration variables, the last part of z.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the function lacks a method, or z would be empty.
    """

    function: PythonFunction
    points: Sequence[str] = field(default=(), kw_only=True)
    directions: Sequence[Direction] = field(default=(), kw_only=True)
    variables: Sequence[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _settle(self)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=_frames(self), variables=tuple(self.variables))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"potential({', '.join((*_frames(self), *self.variables))})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{type(self.function).__name__} in Python"

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        builder.add_potential(_coordinate(self, builder, context))


@dataclass(frozen=True)
class PythonConstraint(Constraint):
    """A holonomic constraint of the user's own: ``h(q) = f(z) = 0`` with f in Python.

    Parameters
    ----------
    function : PythonFunction
        f, with its gradient and Hessian; scaled like a length or an angle.
    points, directions, variables
        What z holds, as in `PythonPotential`.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the function lacks a method, z would be empty, or no dynamic variable changes it.
    """

    function: PythonFunction
    points: Sequence[str] = field(default=(), kw_only=True)
    directions: Sequence[Direction] = field(default=(), kw_only=True)
    variables: Sequence[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        _settle(self)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=_frames(self), variables=tuple(self.variables))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"constraint({', '.join((*_frames(self), *self.variables))})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{type(self.function).__name__} in Python = 0"

    def check(self, context: Context) -> None:
        """Check names, and that something can keep the constraint; see `Element.check`."""
        super().check(context)
        self.check_some_dynamic(
            context,
            movers(_frames(self), self.variables, context),
            "no dynamic variable changes the points, directions and variables, so nothing can keep the "
            "function at zero; remove the constraint or use others",
        )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        builder.add_constraint(_coordinate(self, builder, context))


@dataclass(frozen=True)
class PythonForce(Force):
    """A force of the user's own with a potential f in Python: ``F_i = gain u df/dq_i`` with an input u.

    Such is the force of a coil, with u its current and f the flux that it links, or of a string, with u its
    tension and -f its length. Forces of any other form are expressions; see `ExpressionForce`.

    Parameters
    ----------
    function : PythonFunction
        f, with its gradient and Hessian.
    input : str
        The input u; new with this element, or shared with others of the same name.
    gain : float, optional
        A factor, the parameter ``"name.gain"``.
    points, directions, variables
        What z holds, as in `PythonPotential`.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the function lacks a method, z would be empty, or no dynamic variable changes it.
    """

    function: PythonFunction
    input: str
    gain: float = field(default=1.0, kw_only=True)
    points: Sequence[str] = field(default=(), kw_only=True)
    directions: Sequence[Direction] = field(default=(), kw_only=True)
    variables: Sequence[str] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name(self.input, f"{self.title}: input")
        gain = as_number(self.gain, f"{self.title}: gain", error=DescriptionError)
        object.__setattr__(self, "gain", gain)
        _settle(self)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=_frames(self), variables=tuple(self.variables), inputs=(self.input,))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"force({', '.join((*_frames(self), *self.variables))})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.gain:g} {self.input} along {type(self.function).__name__} in Python"

    def check(self, context: Context) -> None:
        """Check names, and that the force acts on something; see `Element.check`."""
        super().check(context)
        self.check_some_dynamic(
            context,
            movers(_frames(self), self.variables, context),
            "no dynamic variable changes the points, directions and variables, so the force does nothing; "
            "use others",
        )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slot = context.parameter(builder, self, "gain", self.gain)
        builder.add_force(_coordinate(self, builder, context), slot, context.input(self.input))


_AnyPython = PythonPotential | PythonConstraint | PythonForce


def _settle(element: _AnyPython) -> None:
    """Check the fields of an element and make tuples of them."""
    missing = [
        method
        for method in ("value", "gradient", "hessian")
        if not callable(getattr(element.function, method, None))
    ]
    if missing or isinstance(element.function, type):
        lacks = f"has no method {missing[0]!r}" if missing else "is a class; make an object of it"
        raise DescriptionError(
            f"{element.title}: expected an object with value(z), gradient(z) and hessian(z), such as a "
            f"PythonFunction, but {element.function!r} {lacks}"
        )
    for what in ("points", "directions", "variables"):
        given: object = getattr(element, what)
        if isinstance(given, (str, Mapping)) or not isinstance(given, Iterable):
            raise DescriptionError(
                f"{element.title}: {what}: expected a list, got {given!r} alone; write [...]"
            )
    names = {
        what: tuple(check_name(name, f"{element.title}: {what}") for name in getattr(element, what))
        for what in ("points", "variables")
    }
    directions = []
    entry: Any
    for entry in element.directions:
        if not isinstance(entry, (tuple, list)) or len(entry) != 2:
            raise DescriptionError(
                f"{element.title}: directions: expected pairs of a frame and a vector, got {entry!r}"
            )
        frame = check_name(entry[0], f"{element.title}: directions: the frame")
        directions.append((frame, unit_vector(frame, entry[1])))
    if not (names["points"] or directions or names["variables"]):
        raise DescriptionError(
            f"{element.title}: the function has nothing to depend on; give points=, directions= or variables="
        )
    object.__setattr__(element, "points", names["points"])
    object.__setattr__(element, "variables", names["variables"])
    object.__setattr__(element, "directions", tuple(directions))


def _frames(element: _AnyPython) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*element.points, *(frame for frame, _ in element.directions)]))


def _coordinate(element: _AnyPython, builder: Builder, context: Context) -> int:
    called: Callable[..., Any] = _Called(element.function, element.label)
    return builder.python_coordinate(
        [context.point(builder, frame) for frame in element.points],
        [context.direction(builder, frame, vector) for frame, vector in element.directions],
        [context.variable(name) for name in element.variables],
        called,
    )
