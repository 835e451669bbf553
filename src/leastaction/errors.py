"""The errors that the package raises on purpose.

Each message says what was given, what was expected and what to do about it. Every class derives from
`LeastActionError`, so one ``except`` clause catches them all; those that report a bad argument are a `ValueError` too.
"""

from __future__ import annotations

import copyreg
import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

NOT_YET = "docs/beyond/not_yet.md says what serves until then"
"""Where errors point that refuse what cannot be said yet."""


class LeastActionError(Exception):
    """Base of every error that the package raises on purpose."""

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors with keyword-only fields must survive the trip back from a worker process, and the
        # default reduction of an exception would call the class with the message alone.
        rebuild: Callable[..., Any] = copyreg.__newobj__  # type: ignore[attr-defined]
        return (rebuild, (type(self), *self.args), self.__dict__ or None)


class DescriptionError(LeastActionError, ValueError):
    """A mechanism's description cannot be compiled: a name, a shape, a mass or an element is wrong."""


class ArgumentError(LeastActionError, ValueError):
    """An argument has the wrong shape, an unknown name, a value that is not finite or out of range.

    Attributes
    ----------
    function : str
        What was called with it, with which the message begins; empty where that is not known.
    """

    function = ""

    def __str__(self) -> str:
        said = super().__str__()
        return said if not self.function or said.startswith(self.function) else f"{self.function}: {said}"


class KeywordError(ArgumentError, TypeError):
    """A keyword that a function does not have.

    Attributes
    ----------
    keyword : str
        What was given.
    known : set[str]
        The keywords that there are.
    """

    def __init__(self, keyword: str, known: Iterable[str]) -> None:
        super().__init__(keyword)
        self.keyword = keyword
        self.known = set(known)

    def __str__(self) -> str:
        near = closest(self.keyword, sorted(self.known), what="arguments")
        return f"{self.function or 'the call'}: has no argument {self.keyword!r}; {near}"


class LackingArgumentError(ArgumentError, TypeError):
    """A call without an argument that it needs."""


class ProjectionError(ArgumentError):
    """A curve that an optimisation was to begin with leads to no trajectory: no roll-out could follow it."""


class InconsistentStartError(LeastActionError):
    """A configuration or a velocity violates the constraints, or cannot be brought onto them.

    Attributes
    ----------
    residuals : dict[str, float]
        Residual of every constraint by name, largest magnitude first: the value of ``h`` for a
        configuration, of ``Dh v`` for a velocity.
    """

    def __init__(self, message: str, *, residuals: Mapping[str, float]) -> None:
        super().__init__(message)
        self.residuals: dict[str, float] = worst_first(residuals)


class ContradictoryConstraintsError(InconsistentStartError):
    """Constraints pull against each other: where they are violated least, no motion of the free variables helps.

    Attributes
    ----------
    residuals : dict[str, float]
        Residual of every constraint there by name, largest magnitude first.
    constraints : tuple[str, ...]
        The constraints that cannot hold together, the largest residual first.
    held : tuple[str, ...]
        Held variables whose motion would lessen the residual, the most effective first.
    q : Any
        The configuration of least residual.
    """

    def __init__(
        self,
        message: str,
        *,
        residuals: Mapping[str, float],
        constraints: tuple[str, ...],
        held: tuple[str, ...] = (),
        q: Any = None,
    ) -> None:
        super().__init__(message, residuals=residuals)
        self.constraints = tuple(constraints)
        self.held = tuple(held)
        self.q = q


class EquilibriumError(LeastActionError):
    """No equilibrium was found.

    Attributes
    ----------
    residuals : dict[str, float]
        Net force on every free variable and residual of every constraint by name, largest magnitude first.
    iteration : int
        Iterations that were made.
    reached : Any
        The `Equilibrium` that was come to, which is none; None if not even the constraints could be met.
    """

    def __init__(self, message: str, *, residuals: Mapping[str, float], iteration: int, reached: Any = None) -> None:
        super().__init__(message)
        self.residuals: dict[str, float] = worst_first(residuals)
        self.iteration = int(iteration)
        self.reached = reached


class StepError(LeastActionError):
    """A time step has no solution, or the solver did not find it.

    Attributes
    ----------
    t : float
        Time at the start of the step (s).
    residuals : dict[str, float]
        Residual of every equation by name, largest magnitude first.
    iteration : int
        Iterations of the solver that were made.
    state : Any
        The last good state, from which the simulation can go on with another step or input.
    quality : Any
        How coarse the step was, a `StepQuality`; None where that is not known.
    """

    def __init__(
        self,
        message: str,
        *,
        t: float,
        residuals: Mapping[str, float],
        iteration: int,
        state: Any = None,
        quality: Any = None,
    ) -> None:
        super().__init__(message)
        self.quality = quality
        self.t = float(t)
        self.residuals: dict[str, float] = worst_first(residuals)
        self.iteration = int(iteration)
        self.state = state


class DynamicsError(LeastActionError):
    """The equations of motion have no solution at a point.

    Attributes
    ----------
    t : float
        Time (s).
    point : int
        Which of several points it was, from 0.
    variable : str or None
        The variable without inertia, if that is why.
    """

    def __init__(self, message: str, *, t: float, point: int = 0, variable: str | None) -> None:
        super().__init__(message)
        self.t = float(t)
        self.point = int(point)
        self.variable = variable


class MotionFileError(LeastActionError, ValueError):
    """A motion file is truncated, is not of the format that it claims, or does not fit the mechanism."""


class ModelFileError(LeastActionError, ValueError):
    """A file of a mechanism, or of a problem, cannot be read, holds none, or says what cannot be.

    Attributes
    ----------
    line : int or None
        The line of the file, where it is known.
    """

    def __init__(self, message: str, *, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


class SweepError(LeastActionError):
    """A sweep ended before all was done: its worker processes died. What was done is kept.

    Attributes
    ----------
    done : dict[int, Any]
        Results by the number of their value.
    """

    def __init__(self, message: str, *, done: Mapping[int, Any]) -> None:
        super().__init__(message)
        self.done = dict(done)


class OutputError(LeastActionError, OSError):
    """A result cannot be written where it was asked for."""


class MissingExtraError(LeastActionError, ImportError):
    """A package is not installed that something needs which not everybody wants; the message says how to get it."""


class ResultFileError(LeastActionError, ValueError):
    """A saved result cannot be read back, or belongs to another mechanism."""


class CoarseStepWarning(UserWarning):
    """A time step is so long that its solution is far from that of a short one, and about to be lost."""


class EnergyBalanceWarning(UserWarning):
    """A simulation lost or gained energy beside the work that was done."""


class ResidualWarning(UserWarning):
    """Residuals of a fit are not noise: the model misses something, or what was measured does not tell a number."""


class RoundingWarning(UserWarning):
    """A motion is so far from the origin, or its steps are so short, that rounding eats it."""


class SwingWarning(UserWarning):
    """A curve through points swings: between two of them it is far from all that are near."""


class SingularityWarning(UserWarning):
    """A joint came so near to a singularity of its angles that they no longer follow its motion well."""


class UnitWarning(UserWarning):
    """A number looks as if it were in another unit, such as an angle in degrees."""


def closest(name: object, known: Iterable[object], *, what: str) -> str:
    """Return the end of an "unknown name" message: close matches to what was given, or the names that exist.

    One sentence, such as ``"did you mean 'theta'?"`` or ``"the frames are 'a', 'b'"``. ``what``: their kind in the
    plural.
    """
    names = [each for each in known if isinstance(each, str)]
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.6) if isinstance(name, str) else []
    if isinstance(name, str) and not near:
        folded = {known_name.casefold(): known_name for known_name in names}
        near = [folded[name.casefold()]] if name.casefold() in folded else []
    if near:
        return f"did you mean {' or '.join(repr(match) for match in near)}?"
    if not names:
        return f"the mechanism has no {what}"
    return f"the {what} are {some([repr(known_name) for known_name in names])}"


def unknown(kind: str, name: object, known: Iterable[str], what: str = "") -> ArgumentError:
    """Return the error of a name that nothing has, where others are known.

    ``kind``: what it would be the name of, such as ``"frame"``. ``what``: the argument that it was given as, where that
    has to be said.
    """
    given = f"{what}: " if what else ""
    kinds = " or ".join(f"{each}s" for each in kind.split(" or "))
    return ArgumentError(f"{given}unknown {kind} {name!r}; {closest(name, known, what=kinds)}")


def some(names: Sequence[str], most: int = 12) -> str:
    """Return names in one line, the first of them and how many more there are if there are many."""
    rest = len(names) - most
    return ", ".join(names[:most]) + (f" and {rest} more" if rest > 0 else "")


def brief(value: object) -> str:
    """Return something as text for a message, cut off where it becomes long."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def worst_first(residuals: Mapping[str, float]) -> dict[str, float]:
    """Return residuals by name, of any unit, with the largest magnitude (or NaN) first."""

    def size(item: tuple[str, float]) -> float:
        value = float(item[1])
        return float("inf") if value != value else abs(value)

    ordered = sorted(residuals.items(), key=size, reverse=True)
    return {name: float(value) for name, value in ordered}
