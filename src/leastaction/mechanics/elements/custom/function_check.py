"""Holds a `PythonFunction` to its own definition: a check for your own classes, before you simulate with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import ArgumentError
from leastaction.mechanics.elements.custom.python_function import PythonFunction
from leastaction.numerics.arrays import Array, as_array, as_number
from leastaction.numerics.differences import central_differences, complex_step
from leastaction.numerics.public import public

# Central differences, which tell whether a method follows complex z, are good to about 1e-9.
DIFFERENCE = 1e-5
ROUGH = 1e-5


@public
@dataclass(frozen=True)
class FunctionReport:
    """Largest errors of the derivatives of a function, each relative to ``1 +`` the size of the derivative.

    Attributes
    ----------
    errors : dict[str, float]
        By name: "gradient", "hessian", "hessian symmetry" against the complex step; "value on complex z",
        "gradient on complex z" and "hessian on complex z" against central differences of real ones.
    worst : dict[str, tuple[int, ...]]
        The entry with that error, such as ``(2, 0)``.
    allowed : dict[str, float]
        What was allowed.
    """

    errors: dict[str, float]
    worst: dict[str, tuple[int, ...]]
    allowed: dict[str, float]

    @property
    def ok(self) -> bool:
        """Whether every error is within what is allowed."""
        return not self.wrong

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names of what is not; an error that is no number is not within anything."""
        return tuple(name for name, error in self.errors.items() if not error <= self.allowed[name])

    def __str__(self) -> str:
        return "\n".join(
            f"{name:22s} {error:9.2e} at {list(self.worst[name])}{'  WRONG' if name in self.wrong else ''}"
            for name, error in self.errors.items()
        )


@public
def check_function(
    function: PythonFunction, z: ArrayLike, *, tolerance: float = 1e-10, strict: bool = True
) -> FunctionReport:
    """Compare gradient and Hessian of a function with the complex-step derivatives of its value and gradient.

    Parameters
    ----------
    function : PythonFunction
    z : array_like, shape (m,)
        Where to compare; choose a point that is nothing special.
    tolerance : float, optional
        Relative error that is allowed.
    strict : bool, optional
        Whether an error beyond that is raised; if not, see `FunctionReport.ok`.

    Raises
    ------
    ArgumentError
        If a derivative is wrong, or a method does not follow complex z; the message names the entry.
    """
    at = as_array(z, "check_derivatives: z", (None,))
    m = at.size
    if m == 0:
        raise ArgumentError("check_derivatives: z: got no entries, expected one at least")
    tolerance = as_number(tolerance, "check_derivatives: tolerance")
    methods = {"value": (), "gradient": (m,), "hessian": (m, m)}
    calls = {name: partial(_call, function, name, shape) for name, shape in methods.items()}
    stepped = {name: complex_step(call, at) for name, call in calls.items()}
    differences = {name: central_differences(partial(_real, call), at, step=DIFFERENCE) for name, call in calls.items()}
    given = {name: _real(call, at) for name, call in calls.items()}
    hessian = given["hessian"]
    pairs = {
        # A method that does not follow complex z makes the complex step wrong too, so it is named first.
        **{f"{name} on complex z": (stepped[name], differences[name], max(ROUGH, tolerance)) for name in methods},
        "gradient": (given["gradient"], stepped["value"], tolerance),
        "hessian": (hessian, stepped["gradient"], tolerance),
        "hessian symmetry": (hessian, hessian.T, tolerance),
    }
    errors: dict[str, float] = {}
    worst: dict[str, tuple[int, ...]] = {}
    for name, (ours, theirs, _) in pairs.items():
        error = np.abs(ours - theirs) / (1.0 + np.abs(theirs).max(initial=0.0))
        error = np.where(np.isnan(error), np.inf, error)
        worst[name] = tuple(int(i) for i in np.unravel_index(np.argmax(error), error.shape))
        errors[name] = float(error.max(initial=0.0))
    report = FunctionReport(errors, worst, {name: pair[2] for name, pair in pairs.items()})
    if strict and not report.ok:
        first = report.wrong[0]
        ours, theirs, _ = pairs[first]
        raise ArgumentError(_message(function, first, worst[first], ours, theirs))
    return report


def _message(function: PythonFunction, name: str, entry: tuple[int, ...], ours: Any, theirs: Any) -> str:
    kind = type(function).__name__
    got, wanted = float(ours[entry]), float(theirs[entry])
    if name.endswith("on complex z"):
        method = name.split()[0]
        return (
            f"{kind}.{method} does not follow complex z: its derivative {list(entry)} by the complex step is "
            f"{got:.9g}, by differences {wanted:.9g}; avoid abs, real, conj and comparisons of z"
        )
    if name == "hessian symmetry":
        return (
            f"{kind}.hessian is not symmetric: entry {list(entry)} is {got:.9g}, its mirror image "
            f"{wanted:.9g}; make it symmetric"
        )
    below = "value" if name == "gradient" else "gradient"
    return (
        f"{kind}.{name}: entry {list(entry)} is {got:.12g}, but the complex-step derivative of {below} is "
        f"{wanted:.12g}; correct {name} (or {below}, if that is the wrong one)"
    )


def _real(call: Callable[[Array], NDArray[Any]], z: Array) -> Array:
    return np.asarray(call(z).real)


def _call(function: PythonFunction, name: str, shape: tuple[int, ...], z: NDArray[Any]) -> NDArray[Any]:
    given = z.copy()
    given.setflags(write=False)
    result = np.asarray(getattr(function, name)(given))
    if result.shape != shape or result.dtype.kind not in "iufc":
        raise ArgumentError(
            f"{type(function).__name__}.{name}: returned {result.dtype} of shape {result.shape}, expected "
            f"numbers of shape {shape}"
        )
    return result
