"""Expressions: potentials, constraints and forces of your own, written with SymPy.

An expression is made of points, directions, variables, inputs, numbers and the time of a mechanism::

    from leastaction.mechanics.expressions import distance, parameter, point, variable

    cam = point("roller")[1] - 0.02 * sympy.cos(variable("theta"))
    magnet = -parameter("strength", 3e-4) / distance("coil", "anchor") ** 3

It is compiled to a short list of instructions that the core evaluates and differentiates by itself, to
every order that it needs: there is nothing to differentiate by hand and nothing runs in Python during a step.
Give it to an `ExpressionPotential`, an `ExpressionConstraint` or an `ExpressionForce`.

Needs SymPy (the extra ``leastaction[expressions]``), which is imported by the first call.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import DescriptionError
from leastaction.numerics.arrays import as_array, as_number
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

if TYPE_CHECKING:
    import sympy

    from leastaction.mechanics.expressions.symbols import MechanismSymbol

UNITS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@public
def point(frame: str) -> sympy.Matrix:
    """Return the position of a frame's origin in the world (m), a column of three symbols.

    Parameters
    ----------
    frame : str
        Name of the frame.

    Returns
    -------
    sympy.Matrix, shape (3, 1)
        Its entries are ``point(frame)[0]`` for x and so on; `dot`, `norm` and `cross` work as on any other.
    """
    check_name(frame, "point: the frame")
    module = symbols()
    return module.sympy.ImmutableMatrix([module.MechanismSymbol("point", frame, axis) for axis in range(3)])


@public
def direction(frame: str, vector: str | ArrayLike) -> sympy.Matrix:
    """Return a unit vector that is fixed in a frame, in world axes: a column of three symbols.

    Parameters
    ----------
    frame : str
        Name of the frame.
    vector : {"x", "y", "z"} or array_like, shape (3,)
        The vector in the axes of the frame; three numbers are brought to length one.

    Returns
    -------
    sympy.Matrix, shape (3, 1)

    Raises
    ------
    DescriptionError
        If the vector is no axis and not three finite numbers, or has no length.
    """
    check_name(frame, "direction: the frame")
    unit = unit_vector(frame, vector)
    module = symbols()
    return module.sympy.ImmutableMatrix([module.MechanismSymbol("direction", frame, unit, axis) for axis in range(3)])


@public
def unit_vector(frame: str, vector: str | ArrayLike) -> tuple[float, ...]:
    """Return a direction in a frame, as `direction` takes it, as three numbers of length one."""
    if isinstance(vector, str):
        if vector not in UNITS:
            raise DescriptionError(f"direction of {frame!r}: got {vector!r}, expected 'x', 'y', 'z' or three numbers")
        return UNITS[vector]
    given = as_array(vector, f"direction of {frame!r}", (3,), error=DescriptionError)
    largest = float(np.abs(given).max())
    if largest == 0.0:
        raise DescriptionError(f"direction of {frame!r}: got zero, which points nowhere; give a vector with a length")
    # Of ordinary size first, so that no square overflows or vanishes; one of length one, to rounding, stays.
    length = float(np.linalg.norm(given / largest)) * largest
    unit = given if abs(length - 1.0) <= 1e-15 else given / largest / np.linalg.norm(given / largest)
    # Adding zero turns -0.0 into 0.0, so that equal directions are equal symbols.
    return tuple((unit + 0.0).tolist())


@public
def distance(frame1: str, frame2: str) -> sympy.Expr:
    """Return the distance between the origins of two frames (m), smooth as long as it is not zero.

    Parameters
    ----------
    frame1, frame2 : str
        Names of two different frames.

    Returns
    -------
    sympy.Expr
        ``sqrt((x1 - x2)**2 + (y1 - y2)**2 + (z1 - z2)**2)`` in the entries of `point`.
    """
    if frame1 == frame2:
        raise DescriptionError(f"distance: both ends are the frame {frame1!r}; give two different frames")
    between = point(frame1) - point(frame2)
    return symbols().sympy.sqrt(sum(component**2 for component in between))


@public
def variable(name: str) -> MechanismSymbol:
    """Return the symbol of a configuration variable (m or rad), dynamic or kinematic."""
    return _quantity("variable", name)


@public
def input_(name: str) -> MechanismSymbol:
    """Return the symbol of an input; new with the force that uses it, or shared with others of that name."""
    return _quantity("input", name)


@public
def parameter(name: str, value: float) -> MechanismSymbol:
    """Return the symbol of a named number.

    Parameters
    ----------
    name : str
        Its name in the element: the mechanism's parameter is ``"element.name"``.
    value : float
        Its value; it can be changed later without compiling the mechanism again.

    Raises
    ------
    DescriptionError
        If the name is empty or the value not one finite number.
    """
    check_name(name, "parameter: the name")
    number = as_number(value, f"parameter {name!r}", error=DescriptionError)
    return _quantity("parameter", name, number)


@public
def time() -> MechanismSymbol:
    """Return the symbol of the time (s), for what changes by itself: potentials, forces, and constraints that move.

    A step of time takes it at its middle, where potentials and forces act, and at its ends, where constraints hold.
    The energy of such a mechanism changes by what they do: by ``dV/dt`` a second, and by ``-lam dh/dt`` of a
    constraint with the force ``Dh^T lam``. What a mechanism is asked about is at time zero, or at that of
    `Mechanism.at_time`.
    """
    made: MechanismSymbol = symbols().MechanismSymbol("time")
    return made


@public
def coordinate(expression: Any) -> sympy.Expr:
    """Mark a part of a force's expression as one coordinate of the core; its value stays what it is.

    A force is evaluated on scalar coordinates, for each of which the core makes the chain rule once. It
    finds good ones itself: marking is for a part that it would tear to pieces.
    """
    return symbols().Coordinate(_scalar(expression, "coordinate"))


@public
def rate(expression: Any) -> sympy.Expr:
    """Return the rate in time of a scalar of the configuration (its unit per s), for forces.

    Parameters
    ----------
    expression : sympy.Expr or str
        In points, directions, variables, numbers and the time, such as ``distance("a", "b")``; or the name of a
        variable.
    """
    if isinstance(expression, str):
        expression = variable(expression)
    return symbols().Rate(_scalar(expression, "rate"))


@public
def speed(name: str) -> sympy.Expr:
    """Return the velocity of a configuration variable (m/s or rad/s): ``rate(variable(name))``."""
    return rate(name)


def symbols() -> ModuleType:
    """Return the module `leastaction.mechanics.expressions.symbols`, or say that it needs SymPy."""
    try:
        from leastaction.mechanics.expressions import symbols as module
    except ImportError as error:
        if error.name != "sympy":
            raise
        raise DescriptionError(
            "expressions are written with SymPy, which is not installed; "
            "install it with: pip install 'leastaction[expressions]'"
        ) from None
    return module


def _quantity(role: str, name: str, *more: Any) -> MechanismSymbol:
    check_name(name, f"{role}: the name")
    made: MechanismSymbol = symbols().MechanismSymbol(role, name, *more)
    return made


def _scalar(expression: Any, what: str) -> sympy.Expr:
    sympy = symbols().sympy
    if isinstance(expression, str):
        raise DescriptionError(
            f"{what}: got the text {expression!r}, expected an expression; "
            f"for a variable write variable({expression!r})"
        )
    scalar = symbols().sympified(expression)
    if not isinstance(scalar, sympy.Expr) or isinstance(scalar, sympy.MatrixBase):
        raise DescriptionError(
            f"{what}: expected a scalar expression, got {expression!r} ({type(expression).__name__})"
        )
    return scalar
