"""The loop of a simulation in continuous time around the steps of SciPy's solvers.

`scipy.integrate.solve_ivp` knows no projection between steps, so the solvers are driven here step by step. A state
that was moved onto the constraints is put back into the solver with what it keeps of that state, instead of a restart,
which would cost implicit methods their factorisations and multistep methods their order.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.mechanics.continuous.equations import Equations
from leastaction.mechanics.continuous.events import Watched
from leastaction.mechanics.continuous.stabilisation import ConstraintLost, Drift, rates
from leastaction.numerics.arrays import Array

METHODS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
"""SciPy's solvers by name."""

IMPLICIT = ("Radau", "BDF", "LSODA")
"""Those that take a Jacobian."""


def solver_type(method: str) -> Any:
    """Return the solver class of SciPy with one of the names in `METHODS`."""
    from scipy import integrate  # here, because it takes longer to import than all else

    return getattr(integrate, method)


_AT_ONCE = 1e-12  # after the start, relative to its time (at least 1 s): as good as at the start


@dataclass(frozen=True)
class Effort:
    """What a simulation took.

    Attributes
    ----------
    steps : int
        Accepted steps of the solver.
    evaluations : int
        Evaluations of the equations of motion.
    jacobians : int
        Evaluations of their exact derivatives.
    """

    steps: int
    evaluations: int
    jacobians: int


@dataclass(frozen=True)
class Piece:
    """One step's interpolant, bent so that it ends where the projection put the step's end.

    The bend ``s^2 (3 - 2 s)`` of the projection's change, s from 0 to 1, leaves the slopes at both ends, and
    is of the size of the step's error.
    """

    interpolant: Any
    start: float
    end: float
    change: Array | None

    def __call__(self, t: Any) -> Array:
        """Return states (nx,) at a time, or (nx, n) at times."""
        values: Array = self.interpolant(t)
        if self.change is None:
            return values
        s = (np.asarray(t) - self.start) / (self.end - self.start)
        bend = s**2 * (3.0 - 2.0 * s)
        return values + (self.change * bend if bend.ndim == 0 else np.outer(self.change, bend))


@dataclass
class Progress:
    """What an integration has come to: filled as it goes, so that it is whole whenever it ends."""

    t: list[float]
    x: list[Array]
    pieces: list[Piece] = field(default_factory=list)
    steps: int = 0
    evaluations: int = 0
    jacobians: int = 0
    reached: float = 0.0
    state: Array = field(default_factory=lambda: np.zeros(0))
    event: str | None = None
    failure: str | None = None
    worst: Array = field(default_factory=lambda: np.zeros((4, 0)))

    def drift(self, names: Sequence[str]) -> dict[str, Drift]:
        """Return the drift by the name of the constraint."""
        return {name: Drift(*(float(w) for w in self.worst[:, i])) for i, name in enumerate(names)}

    @property
    def effort(self) -> Effort:
        """What it has taken."""
        return Effort(self.steps, self.evaluations, self.jacobians)


class Integration:
    """One integration over given times.

    Parameters
    ----------
    equations : Equations
    method : str
        One of `METHODS`.
    options : dict
        Options of the solver: rtol, atol, max_step, first_step.
    events : sequence of Watched
    keep : bool
        Keep the interpolants.
    max_steps : int, optional
        Steps after which it has failed.
    """

    def __init__(
        self,
        equations: Equations,
        method: str,
        options: dict[str, Any],
        events: Sequence[Watched],
        keep: bool,
        max_steps: int | None = None,
    ) -> None:
        self.equations = equations
        self.method = method
        self.options = options
        self.events = events
        self.keep = keep
        self.max_steps = max_steps

    def run(
        self,
        times: Array,
        x0: Array,
        progress: Progress,
        tell: Callable[[float, float], None] | None,
    ) -> None:
        """Integrate from x0 over the times, into `progress`.

        A failure is told there; `KeyboardInterrupt` passes through, with all that was done in it.
        """
        e = self.equations
        progress.reached, progress.state = float(times[0]), x0
        progress.worst = np.zeros((4, e.mechanism.nc))
        self._measure(x0, x0, progress)
        for event in self.events:
            event.last = event.evaluate(float(times[0]), x0)
        size = self.options.get("first_step")
        for begin, end in itertools.pairwise([times[0], *e.law.breaks, times[-1]]):
            options = dict(self.options)
            if size is not None:
                # An interval begins with the step that the one before had come to.
                options["first_step"] = min(size, float(end - begin))
            e.start = float(begin)
            size = self._segment(times, float(end), options, progress, tell)
            if progress.failure is not None or progress.event is not None:
                return

    def _segment(
        self,
        times: Array,
        bound: float,
        options: dict[str, Any],
        progress: Progress,
        tell: Callable[[float, float], None] | None,
    ) -> float | None:
        """Integrate to a bound within which the inputs do not jump; return the size of the last whole step."""
        e = self.equations
        e.cause = None
        if not np.all(np.isfinite(e.rate(progress.reached, progress.state))):
            progress.failure = e.cause
            return None
        if self.method in IMPLICIT:
            options = {**options, "jac": self._counted(progress)}
        with np.errstate(all="ignore"):
            solver = solver_type(self.method)(
                e.rate, progress.reached, progress.state.copy(), bound, **options
            )
        size: float | None = None
        base = progress.evaluations
        while solver.status == "running":
            e.cause = None
            failure = self._step(solver)
            progress.evaluations = base + solver.nfev
            if failure is not None:
                progress.failure = self._why(failure)
                return None
            try:
                self._accept(solver, times, progress)
            except ConstraintLost as lost:
                progress.failure = str(lost)
                return None
            if solver.t < bound or size is None:
                size = solver.step_size
            if tell is not None:
                tell(progress.reached, float(times[-1]))
            if progress.event is not None:
                return None
            if progress.steps == self.max_steps and progress.reached < times[-1]:
                progress.failure = f"it took {progress.steps} steps, as many as max_steps allows"
                return None
        return size

    def _counted(self, progress: Progress) -> Callable[[float, Array], Array]:
        def jacobian(t: float, x: Array) -> Array:
            progress.jacobians += 1
            return self.equations.jacobian(t, x)

        return jacobian

    def _why(self, otherwise: str) -> str:
        """Return what the equations say of their last failure, or something else if they say nothing."""
        return self.equations.cause or otherwise

    def _step(self, solver: Any) -> str | None:
        """Make one step; return why it failed, or None."""
        with np.errstate(all="ignore"), warnings.catch_warnings(record=True) as told:
            # LSODA says why it fails by a warning.
            warnings.simplefilter("always")
            try:
                message = solver.step()
            except (ValueError, np.linalg.LinAlgError) as error:
                # A Jacobian that is not finite, or a matrix of it that has no inverse.
                return str(error)
        if solver.status == "failed":
            said = "; ".join(str(w.message) for w in told)
            return said or message or "the solver gave up"
        if not np.all(np.isfinite(solver.y)):
            return "the state is not finite"
        return None

    def _accept(self, solver: Any, times: Array, progress: Progress) -> None:
        """Bring the end of a step onto the constraints, and take from the step what is asked for."""
        e = self.equations
        t_old, t_new, raw = float(solver.t_old), float(solver.t), np.asarray(solver.y)
        x = e.hold(t_new, raw)
        change = x - raw
        moved = bool(np.any(change))
        inside = times[(times > t_old) & (times <= t_new)]
        values = [event.evaluate(t_new, x) for event in self.events]
        crossed = [
            (event, value)
            for event, value in zip(self.events, values, strict=True)
            if event.crossed(value)
        ]
        piece: Piece | None = None
        if self.keep or crossed or np.any(inside < t_new):
            piece = Piece(solver.dense_output(), t_old, t_new, change if moved else None)
        end, x_end = t_new, x
        if crossed:
            assert piece is not None
            end, x_end = self._take_events([event for event, _ in crossed], piece, x, progress)
        for event, value in zip(self.events, values, strict=True):
            event.last = value
        for t in inside[inside <= end]:
            progress.t.append(float(t))
            if t == end:
                progress.x.append(x_end)
            else:
                assert piece is not None
                progress.x.append(e.hold(float(t), piece(t)))
        if self.keep and piece is not None:
            progress.pieces.append(piece)
        progress.steps += 1
        progress.reached, progress.state = end, x_end
        self._measure(e.state(t_new, raw), x, progress)
        if moved and progress.event is None:
            put(solver, x, e.rate)

    def _take_events(
        self, crossed: Sequence[Watched], piece: Piece, x_end: Array, progress: Progress
    ) -> tuple[float, Array]:
        """Record the events of a step in the order of time, up to one that ends the simulation."""
        e = self.equations

        def along(t: float) -> Array:
            return e.state(t, piece(t))

        found = [(event.locate(along, piece.start, piece.end), event) for event in crossed]
        # The state of an event is a zero but for rounding: a start from there is no event again.
        begun = progress.t[0] + _AT_ONCE * max(1.0, abs(progress.t[0]))
        for t, event in sorted(found, key=lambda pair: pair[0]):
            if t <= begun:
                continue
            x = x_end if t == piece.end else e.hold(t, piece(t))
            event.t.append(t)
            event.x.append(x)
            if event.terminal and len(event.t) >= event.terminal:
                progress.event = event.name
                return t, x
        return piece.end, x_end

    def _measure(self, raw: Array, x: Array, progress: Progress) -> None:
        m = self.equations.mechanism
        if not m.nc:
            return
        after = rates(m, x[: m.nq], x[m.nq :])
        before = after
        if self.equations.projection is not None and raw is not x:
            before = rates(m, raw[: m.nq], raw[m.nq :])
        np.maximum(progress.worst, np.abs([*after, *before]), out=progress.worst)


def put(solver: Any, x: Array, rate: Callable[[float, Array], Array]) -> None:
    """Put a moved state into a solver, in all places where it keeps it."""
    solver.y = x.copy()
    kind = type(solver).__name__
    if kind == "BDF":
        # The backward difference of order 0; the others do not change with a shift.
        solver.D[0] = x
    elif kind == "LSODA":
        integrator = solver._lsoda_solver._integrator
        # Nordsieck's array begins here, with the state.
        integrator.rwork[20 : 20 + len(x)] = x
        solver._lsoda_solver._y = x.copy()
    else:
        # The last stage of a Runge-Kutta step is the first of the next.
        solver.f = rate(solver.t, x)
        solver.nfev += 1
