"""Elements that the user writes as a Python class with value, gradient and Hessian.

They work everywhere, but every evaluation calls Python: an expression (`ExpressionPotential`) runs a hundred
times faster. Hold a new class to its own definition with `check_function` (or `leastaction.check_derivatives`).
"""

from __future__ import annotations

import abc
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics.elements.base import Constraint, Force, Potential
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.fields import FRAMES, INPUT, Metadata, number
from leastaction.mechanics.elements.kinds import Kind, Names, Uses
from leastaction.mechanics.expressions.terms import unit_vector
from leastaction.numerics.names import check_name
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public

Direction = tuple[str, str | Sequence[float]]


class PythonFunction(abc.ABC):
    """A scalar function f(z) of the user's own, with its gradient and Hessian.

    Threads that share a mechanism call it too, one at a time.

    z (m,) holds x y z of every point, x y z of every direction (all in world axes), then the variables, in the
    order in which the element names them. The methods must take complex z and follow it analytically: write
    them with NumPy's functions, without `abs`, `arctan2`, `real`, `conj` or comparisons of z. The third order is the
    complex-step derivative of the Hessian, exact to rounding.

    Nothing may change between calls with the same z, which is read-only.
    """

    __repr__ = printed

    @abc.abstractmethod
    def value(self, z: NDArray[Any]) -> Any:
        """Return f(z), a scalar."""

    @abc.abstractmethod
    def gradient(self, z: NDArray[Any]) -> ArrayLike:
        """Return df/dz, shape (m,)."""

    @abc.abstractmethod
    def hessian(self, z: NDArray[Any]) -> ArrayLike:
        """Return d2f/dz2, shape (m, m), symmetric."""


@dataclass(frozen=True)
class _Called:
    """What the core calls: a `PythonFunction` up to an order (0, 1, 2), with its shapes checked."""

    function: PythonFunction
    title: str

    def __call__(self, z: NDArray[Any], order: int) -> tuple[Any, Any, Any]:
        z.setflags(write=False)  # what one method did to it, the next would see
        value = self.array("value", z, ())
        gradient = self.array("gradient", z, (z.size,)) if order >= 1 else None
        hessian = self.array("hessian", z, (z.size, z.size)) if order >= 2 else None
        return value[()], gradient, hessian

    def array(self, method: str, z: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
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
class _Function(Kind):
    """An object with the methods of a `PythonFunction`."""

    def read(self, value: Any, what: str) -> Any:
        title = what.rpartition(":")[0]
        missing = [method for method in ("value", "gradient", "hessian") if not callable(getattr(value, method, None))]
        if missing or isinstance(value, type):
            lacks = f"has no method {missing[0]!r}" if missing else "is a class; make an object of it"
            raise DescriptionError(
                f"{title}: expected an object with value(z), gradient(z) and hessian(z), such as a "
                f"PythonFunction, but {value!r} {lacks}"
            )
        return value

    def show(self, value: Any) -> str:
        return f"{type(value).__name__} in Python"


_OBJECT = _Function()


@dataclass(frozen=True)
class _Along(Kind):
    """What a force acts along: such an object, or the name of a variable."""

    def read(self, value: Any, what: str) -> Any:
        return check_name(value, f"{what}, a variable") if isinstance(value, str) else _OBJECT.read(value, what)

    def uses(self, value: Any) -> Uses:
        return Uses(variables=(value,)) if isinstance(value, str) else Uses()

    def acts_on(self, value: Any) -> tuple[str, ...]:
        return self.uses(value).variables

    def show(self, value: Any) -> str:
        return value if isinstance(value, str) else _OBJECT.show(value)


@dataclass(frozen=True)
class _Directions(Kind):
    """Pairs of a frame and a vector in its axes, which is brought to length one."""

    def read(self, value: Any, what: str) -> tuple[tuple[str, tuple[float, ...]], ...]:
        if isinstance(value, (str, Mapping)) or not isinstance(value, Iterable):
            raise DescriptionError(f"{what}: expected a list, got {value!r} alone; write [...]")
        directions = []
        entry: Any
        for entry in value:
            if not isinstance(entry, (tuple, list)) or len(entry) != 2:
                raise DescriptionError(f"{what}: expected pairs of a frame and a vector, got {entry!r}")
            frame = check_name(entry[0], f"{what}: the frame")
            directions.append((frame, unit_vector(frame, entry[1])))
        return tuple(directions)

    def uses(self, value: Any) -> Uses:
        return Uses(frames=self.acts_on(value))

    def acts_on(self, value: Any) -> tuple[str, ...]:
        return tuple(frame for frame, _ in value)


_FUNCTION: Metadata = {"kind": _OBJECT}
_DIRECTIONS: Metadata = {"kind": _Directions()}
_VARIABLES: Metadata = {"kind": Names("variables")}


@public
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

    Raises
    ------
    DescriptionError
        If the function lacks a method, or z would be empty.
    """

    function: PythonFunction = field(metadata=_FUNCTION)
    points: Sequence[str] = field(default=(), kw_only=True, metadata=FRAMES)
    directions: Sequence[Direction] = field(default=(), kw_only=True, metadata=_DIRECTIONS)
    variables: Sequence[str] = field(default=(), kw_only=True, metadata=_VARIABLES)

    called = "potential"
    reads = "{function}"
    highest_order = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_arguments(self)

    def add_to(self, core: Compiler) -> None:
        core.potential(_coordinate(self, core))


@public
@dataclass(frozen=True)
class PythonConstraint(Constraint):
    """A holonomic constraint of the user's own: ``h(q) = f(z) = 0`` with f in Python.

    Parameters
    ----------
    function : PythonFunction
        f, with its gradient and Hessian; scaled like a length or an angle.
    points, directions, variables
        What z holds, as in `PythonPotential`.

    Raises
    ------
    DescriptionError
        If the function lacks a method, z would be empty, or no dynamic variable changes it.
    """

    function: PythonFunction = field(metadata=_FUNCTION)
    points: Sequence[str] = field(default=(), kw_only=True, metadata=FRAMES)
    directions: Sequence[Direction] = field(default=(), kw_only=True, metadata=_DIRECTIONS)
    variables: Sequence[str] = field(default=(), kw_only=True, metadata=_VARIABLES)

    called = "constraint"
    reads = "{function} = 0"
    highest_order = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_arguments(self)

    def check(self, context: Context) -> None:
        super().check(context)
        self.check_moved(
            context,
            context.behind(self.uses.frames, self.uses.variables),
            "changes the points, directions and variables, so nothing can keep the function at zero; remove "
            "the constraint or use others",
        )

    def add_to(self, core: Compiler) -> None:
        core.constraint(_coordinate(self, core))


@public
@dataclass(frozen=True)
class PythonForce(Force):
    """A force of the user's own along a scalar s of the configuration: ``F_i = gain F ds/dq_i``, both in Python.

    Without a magnitude F is an input u: the force of a coil, with u its current and s the flux that it links, or of
    a string, with u its tension and -s its length. With one it is a function of places, rates and the input: friction,
    a motor with its characteristic, a controller.

    Parameters
    ----------
    function : PythonFunction or str
        s, with its gradient and Hessian; or the name of a variable. F is positive where it drives s up.
    input : str, optional
        The input u; new with this element, or shared with others of the same name. Needed without a magnitude.
    magnitude : PythonFunction, optional
        F, with its gradient and Hessian, of ``y = [s, w.., ds/dt, dw/dt.., u]`` with the variables w of `measured`, and
        u if there is one; in N along a length, N m along an angle.
    measured : sequence of str, optional
        Configuration variables that the magnitude depends on besides s.
    gain : float, optional
        A factor, the parameter ``"name.gain"``.
    points, directions, variables
        What z of `function` holds, as in `PythonPotential`.

    Raises
    ------
    DescriptionError
        If a function lacks a method, z would be empty, no dynamic variable changes s, or there is neither an input nor
        a magnitude.
    """

    function: PythonFunction | str = field(metadata={"kind": _Along()})
    input: str | None = field(default=None, metadata=INPUT)
    magnitude: PythonFunction | None = field(default=None, kw_only=True, metadata=_FUNCTION)
    measured: Sequence[str] = field(default=(), kw_only=True, metadata=_VARIABLES)
    gain: float = field(default=1.0, kw_only=True, metadata=number())
    points: Sequence[str] = field(default=(), kw_only=True, metadata=FRAMES)
    directions: Sequence[Direction] = field(default=(), kw_only=True, metadata=_DIRECTIONS)
    variables: Sequence[str] = field(default=(), kw_only=True, metadata=_VARIABLES)

    called = "force"
    needs_dynamic = True
    highest_order = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.function, str):
            _check_arguments(self)
        elif self.points or self.directions or self.variables:
            raise DescriptionError(
                f"{self.title}: it acts along the variable {self.function!r}, so there is no z; leave out points=, "
                "directions= and variables=, or give a function of them"
            )
        if self.input is None and self.magnitude is None:
            raise DescriptionError(f"{self.title}: nothing says how large it is; give an input, magnitude= or both")
        if self.measured and self.magnitude is None:
            raise DescriptionError(f"{self.title}: measured: there is no magnitude that depends on it; give magnitude=")

    def describe(self) -> str:
        size = self.input or ""
        if self.magnitude is not None:
            size = f"{type(self.magnitude).__name__} in Python" + (f" of {self.input}" if self.input else "")
        return f"{self.gain:g} {size} along {_Along().show(self.function)}"

    def check(self, context: Context) -> None:
        super().check(context)
        frames = (*self.points, *(frame for frame, _ in self.directions))
        variables = (self.function,) if isinstance(self.function, str) else self.variables
        self.check_moved(
            context,
            context.behind(frames, variables),
            "changes the points, directions and variables, so the force does nothing; use others",
        )

    def add_to(self, core: Compiler) -> None:
        along = core.sum(self.function) if isinstance(self.function, str) else _coordinate(self, core)
        if self.magnitude is None:
            core.force(along, "gain", self.input)
            return
        coordinates = [along, *(core.sum(name) for name in self.measured)]
        inputs = [] if self.input is None else [core.input(self.input)]
        called = _Called(self.magnitude, self.label)
        core.builder.add_python_force(coordinates, inputs, called, core.slot("gain"))


_AnyPython = PythonPotential | PythonConstraint | PythonForce


def _check_arguments(element: _AnyPython) -> None:
    if not (element.points or element.directions or element.variables):
        raise DescriptionError(
            f"{element.title}: the function has nothing to depend on; give points=, directions= or variables="
        )


def _coordinate(element: _AnyPython, core: Compiler) -> int:
    return core.builder.python_coordinate(
        [core.point(frame) for frame in element.points],
        [core.direction(frame, vector) for frame, vector in element.directions],
        [core.variable(name) for name in element.variables],
        _Called(cast(PythonFunction, element.function), element.label),
    )
