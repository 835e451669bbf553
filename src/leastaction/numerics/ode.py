"""Initial-value problems by SciPy's adaptive solvers, step by step: the one place that drives them.

`scipy.integrate.solve_ivp` knows no projection between steps, cannot be given up in the middle, and warns where a
reason is wanted. So the solvers are driven here, through what they document:

- **Projection.** The solver integrates z where the solution is ``y = z + c``, with c constant over a step. To move y
  onto a manifold changes c. Nothing that a solver keeps of its past (differences, derivatives, factorisations) sees a
  shift, so multistep methods keep their order and implicit ones their matrices, as they would not after a restart.
- **Jumps.** Integration starts anew where the equation jumps, and the equation sees times strictly between two jumps,
  and before the end of all.
- **Fragile places.** Near a state where the equation is next to undetermined its values are noise, and a solver that
  shortens its steps only comes to see more of it. A `Passage` says where that is, and steps there are taken on trial:
  if they went wrong they are made anew, with equations that stand up to more and by ever longer steps, which lead
  over the place.
- **Failures.** Where the equation has no value the solver sees NaN, which it takes for a step that was too long; when
  no step is short enough, the reason is the one that the equation gave.
"""

from __future__ import annotations

import importlib
import itertools
import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, read_only

SOLVERS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
"""SciPy's solvers by name."""

IMPLICIT = ("Radau", "BDF", "LSODA")
"""Those that take a Jacobian, for stiff equations."""


# Trial steps in a fragile place are taken over when there are so many, and end when one is so much shorter than
# the step into it.
_HELD = 50
_SHRUNK = 1e-3
# Fragile places in a row that were not passed well, after which no more is tried.
_PATIENCE = 3
# Relative tolerances of further trials, of which none is less than what was asked for.
_TRIALS = (1e-8, 1e-7, 1e-6, 1e-5)
_BETTER = 0.1  # of the first trial's error: a further one must have come down to it


class IntegrationFailed(LeastActionError):
    """An integration that cannot go on; its message is the reason, and the `March` says how far it came."""


@dataclass(eq=False, slots=True)
class Interpolant:
    """The solution over one step, bent so that it ends where the projection put the step's end.

    The bend ``s^2 (3 - 2 s)`` of the projection's change, s from 0 to 1, leaves the slopes at both ends, and
    is of the size of the step's error.

    ``solution``: SciPy's dense output, without shift and bend. ``start``, ``end``: of the step (s). ``shift``,
    ``change`` (n,): what is added, and the projection's change at the end; None for none.
    """

    solution: Callable[[Any], Any]
    start: float
    end: float
    shift: Array | None = None
    change: Array | None = None

    def __call__(self, t: Any) -> Array:
        """Return the solution (n,) at a time, or (n, m) at times (m,)."""
        values = np.asarray(self.solution(t))
        column = (slice(None),) + (None,) * (values.ndim - 1)
        if self.shift is not None:
            values = values + self.shift[column]
        if self.change is not None:
            s = (np.asarray(t) - self.start) / (self.end - self.start)
            values = values + self.change[column] * (s**2 * (3.0 - 2.0 * s))
        return values


class OdeStep:
    """An accepted step, as a `March` gives it; its interpolant is to be asked for (first) before the next step.

    ``start``, ``end``: Times (s). ``raw``, ``y`` (n,): The solution at the end, before and after it was held.
    """

    __slots__ = ("_interpolant", "_interpolate", "end", "raw", "start", "y")

    def __init__(self, start: float, end: float, raw: Array, y: Array, interpolate: Callable[[], Interpolant]) -> None:
        self.start, self.end = start, end
        self.raw, self.y = raw, y
        self._interpolate = interpolate
        self._interpolant: Interpolant | None = None

    def interpolant(self) -> Interpolant:
        """Return the solution over the step."""
        if self._interpolant is None:
            self._interpolant = self._interpolate()
        return self._interpolant


@dataclass(frozen=True)
class Passage:
    """Where an equation is fragile, and how its steps are to be made and judged there.

    ``fragile(t, y)``: asked of the end of every step. ``fun``: an equation of the same solution that stands up to more,
    in place of `March`'s. ``error(interpolants)``: how wrong some steps went, in units of what is allowed.
    """

    fragile: Callable[[float, Array], bool]
    fun: Callable[[float, Array], Array]
    error: Callable[[Sequence[Interpolant]], float]


class March:
    """One integration of ``y' = fun(t, y)`` from t0 to tf, forwards or backwards: iterate over its steps.

    The iteration ends at tf, and by `IntegrationFailed` where it cannot go on; it may be left at any step. The counts
    and the last state are right whenever it ends. Not for several threads.

    ``fun(t, y) -> (n,)``: an `ArithmeticError`, an error of this package other than an `ArgumentError`, or what is not
    finite says that there is no value. ``y0`` (n,): the initial value. ``solver``: one of `SOLVERS`. ``rtol``,
    ``atol``: error of one step that is allowed, ``atol + rtol |y|``. ``jacobian(t, y) -> (n, n)``: for those of
    `IMPLICIT`. ``hold(t, y) -> y``: moves the end of every step where it belongs, such as onto constraints; an error of
    this package ends the integration. ``jumps``: times where `fun` jumps. ``passage``: where steps are taken on trial.
    ``first_step``, ``max_step``: sizes (s). ``max_steps``, ``max_seconds``: steps, and wall time (s), after which it
    has failed.

    ``t``, ``y``: the last time that was reached, and the solution there. ``steps``, ``evaluations``, ``jacobians``:
    steps accepted, and evaluations of `fun` and `jacobian`.
    """

    def __init__(
        self,
        fun: Callable[[float, Array], Array],
        t0: float,
        tf: float,
        y0: Array,
        *,
        solver: str,
        rtol: float,
        atol: float | Array,
        jacobian: Callable[[float, Array], Array] | None = None,
        hold: Callable[[float, Array], Array] | None = None,
        jumps: Sequence[float] = (),
        passage: Passage | None = None,
        first_step: float | None = None,
        max_step: float | None = None,
        max_steps: int | None = None,
        max_seconds: float | None = None,
    ) -> None:
        self.t, self.y = float(t0), np.asarray(y0, dtype=np.float64)
        self.steps = self.evaluations = self.jacobians = 0
        self._fun, self._jacobian, self._hold = fun, jacobian, hold
        self._passage = passage
        self._stops = segments(min(t0, tf), max(t0, tf), jumps)
        if tf < t0:
            self._stops.reverse()
        self._solver = solver
        self._options: dict[str, Any] = {"rtol": rtol, "atol": atol}
        if max_step is not None:
            self._options["max_step"] = max_step
        self._size = first_step
        self._max_steps = max_steps
        self._deadline = None if max_seconds is None else time.monotonic() + max_seconds
        self._lost = 0
        self._cause: str | None = None
        self._theirs: ValueError | None = None

    def __iter__(self) -> Iterator[OdeStep]:
        """Make the steps."""
        # Only those who integrate pay for the import, of most of a second.
        kind = getattr(importlib.import_module("scipy.integrate"), self._solver)
        for begin, end in itertools.pairwise(self._stops):
            yield from self._segment(kind, begin, end)

    def _segment(self, kind: Any, begin: float, end: float) -> Iterator[OdeStep]:
        """Integrate from one jump to the next."""
        steps = self._steps(kind, begin, begin, end)
        if self._passage is None:
            yield from steps
            return
        before = (self.t, self.y, self._size)
        while (step := next(steps, None)) is not None:
            if self._lost < _PATIENCE and self._passage.fragile(step.end, step.y):
                held, anew = self._pass(kind, begin, end, before, step, steps)
                yield from held
                if anew and self.t != end:
                    steps = self._steps(kind, begin, self.t, end)
            else:
                yield step
            before = (self.t, self.y, self._size)

    def _pass(
        self,
        kind: Any,
        begin: float,
        end: float,
        before: tuple[float, Array, float | None],
        step: OdeStep,
        steps: Iterator[OdeStep],
    ) -> tuple[list[OdeStep], bool]:
        """Return the steps through a fragile place that went least wrong, and whether to begin anew after them."""
        assert self._passage is not None
        best = self._try(step, steps)
        if best.error <= 1.0:
            self._lost = 0
            return best.steps, False
        first = best
        rtol = float(self._options["rtol"])
        for tolerance in _TRIALS:
            if best.error <= 1.0:
                break
            looser = max(tolerance / rtol, 1.0)
            self.t, self.y, self._size = before
            steps = self._steps(kind, begin, self.t, end, self._passage.fun, looser)
            try:
                trial = self._try(next(steps), steps)
            except IntegrationFailed:
                continue
            if trial.error < min(best.error, max(_BETTER * first.error, 1.0)):
                best = trial
        self.t, self.y, self._size = best.state
        # What cannot be passed is met again at every step: then what integrates without help says why it fails.
        self._lost = self._lost + 1 if best.error > 1.0 else 0
        return best.steps, best is not first or best.shrunk

    def _try(self, step: OdeStep, steps: Iterator[OdeStep]) -> _Trial:
        """Go on from the first step into a fragile place until it is left."""
        passage = self._passage
        assert passage is not None
        held, pieces = [], []
        shortest = _SHRUNK * abs(step.end - step.start)
        while True:
            pieces.append(step.interpolant())
            held.append(step)
            shrunk = abs(step.end - step.start) < shortest and step.end != self._stops[-1]
            if shrunk or len(held) == _HELD or not passage.fragile(step.end, step.y):
                break
            try:
                after = next(steps, None)
            except IntegrationFailed:
                shrunk = True
                break
            if after is None:
                break
            step = after
        error = np.inf if shrunk else passage.error(pieces)
        return _Trial(held, error, (self.t, self.y, self._size), shrunk)

    def _steps(
        self,
        kind: Any,
        first: float,
        begin: float,
        end: float,
        fun: Callable[[float, Array], Array] | None = None,
        looser: float = 1.0,
    ) -> Iterator[OdeStep]:
        """Integrate to a jump from a time after the jump before it, which is at ``first``."""
        fun = fun or self._fun
        low, high = min(first, end), math.nextafter(max(first, end), -math.inf)
        if low > min(self._stops[0], self._stops[-1]):
            low = math.nextafter(low, math.inf)
        shift = np.zeros(self.y.size)

        def within(t: float) -> float:
            return low if t < low else high if t > high else t

        def rate(t: float, z: Array) -> Array:
            self.evaluations += 1
            return self._asked(fun, within(t), z if self._hold is None else z + shift, (z.size,))

        def slope(t: float, z: Array) -> Array:
            self.jacobians += 1
            assert self._jacobian is not None
            return self._asked(self._jacobian, within(t), z + shift, (z.size, z.size))

        options = dict(self._options)
        if looser > 1.0:
            options["rtol"], options["atol"] = looser * options["rtol"], looser * options["atol"]
        if self._size is not None:
            # A segment begins with the step that the one before had come to.
            options["first_step"] = min(self._size, abs(end - begin))
        if self._jacobian is not None and self._solver in IMPLICIT:
            options["jac"] = slope
        self._cause = None
        with np.errstate(all="ignore"):
            if not np.isfinite(rate(begin, self.y)).all():
                raise IntegrationFailed(self._why("the equations have no value there"))
            solver = self._guarded(lambda: kind(rate, begin, self.y.copy(), end, **options))
        whole = False
        while solver.status == "running":
            self._step(solver)
            start, t, raw = float(solver.t_old), float(solver.t), solver.y + shift
            if not np.isfinite(raw).all():
                raise IntegrationFailed(self._why("the state is not finite"))
            cause = self._why("")
            if cause:
                # Older versions of LSODA step on to where the equations have no value.
                with np.errstate(all="ignore"):
                    if not np.isfinite(rate(t, solver.y)).all():
                        raise IntegrationFailed(cause)
            y = raw if self._hold is None else self._held(t, raw)
            change = None if y is raw or np.array_equal(y, raw) else y - raw
            self.steps += 1
            self.t, self.y = t, y
            if t != end or not whole:
                self._size, whole = float(solver.step_size), True
            past = shift.copy() if shift.any() else None

            def interpolate(
                start: float = start, t: float = t, past: Array | None = past, change: Array | None = change
            ) -> Interpolant:
                return Interpolant(solver.dense_output(), start, t, past, change)

            yield OdeStep(start, t, raw, y, interpolate)
            if change is not None:
                shift += change
                if hasattr(solver, "f"):
                    # One-step methods begin a step with the slope that ended the one before.
                    with np.errstate(all="ignore"):
                        solver.f = rate(t, solver.y)
            self._check_limits(t)

    def _step(self, solver: Any) -> None:
        self._cause = None
        with np.errstate(all="ignore"):
            if self._solver == "LSODA":
                # It says why it fails by a warning.
                with warnings.catch_warnings(record=True) as told:
                    warnings.simplefilter("always")
                    message = self._guarded(solver.step)
                message = "; ".join(str(w.message) for w in told) or message
            else:
                message = self._guarded(solver.step)
        if solver.status == "failed":
            raise IntegrationFailed(self._why(_gave_up(message)))

    def _asked(self, function: Callable[[float, Array], Array], t: float, y: Array, shape: tuple[int, ...]) -> Array:
        """Return the value of one of the user's functions, NaN where there is none."""
        try:
            return function(t, read_only(y))
        except ValueError as error:
            self._theirs = error
            raise
        except (LeastActionError, ArithmeticError) as error:
            # The first reason within a step says more than what follows from it.
            self._cause = self._cause or str(error)
            return np.full(shape, np.nan)

    def _guarded(self, call: Callable[[], Any]) -> Any:
        try:
            return call()
        except (ValueError, np.linalg.LinAlgError) as error:
            if error is self._theirs:
                raise
            # A Jacobian that is not finite, or a matrix of it that has no inverse.
            raise IntegrationFailed(self._why(_gave_up(error))) from None

    def _why(self, otherwise: str) -> str:
        """Return what the equations said of their last failure, or something else if they said nothing."""
        return self._cause or otherwise

    def _held(self, t: float, y: Array) -> Array:
        assert self._hold is not None
        try:
            return self._hold(t, y)
        except ArgumentError:
            raise
        except LeastActionError as lost:
            raise IntegrationFailed(str(lost)) from None

    def _check_limits(self, t: float) -> None:
        if t == self._stops[-1]:
            return
        if self._max_steps is not None and self.steps >= self._max_steps:
            raise IntegrationFailed(f"it took {self.steps} steps, as many as max_steps allows")
        if self._deadline is not None and time.monotonic() > self._deadline:
            raise IntegrationFailed("it took as long as max_seconds allows")


@dataclass(frozen=True)
class _Trial:
    """Steps through a fragile place, how wrong they went, where they came to, and whether they became too short."""

    steps: list[OdeStep]
    error: float
    state: tuple[float, Array, float | None]
    shrunk: bool


def segments(t0: float, tf: float, jumps: Sequence[float]) -> list[float]:
    """Return t0, the jumps between, and tf, in increasing order."""
    least = 1e-12 * (abs(t0) + abs(tf))
    inner = sorted({float(t) for t in jumps if t0 + least < t < tf - least})
    return [t0, *inner, tf]


def _gave_up(message: object) -> str:
    reason = str(message or "without a reason").rstrip(".")
    return f"the solver gave up, {reason[:1].lower()}{reason[1:]}"
