"""What a simulation in continuous time takes from the steps of its integration: instants, events, drift."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from leastaction.mechanics.continuous.equations import Equations
from leastaction.mechanics.continuous.events import Watched
from leastaction.mechanics.continuous.stabilisation import Drift, rates
from leastaction.numerics.arrays import Array
from leastaction.numerics.ode import IntegrationFailed, Interpolant, March, OdeStep

_AT_ONCE = 1e-12  # after the start, relative to its time (at least 1 s): as good as at the start


@dataclass(frozen=True)
class SolverCounts:
    """What a simulation took.

    ``steps``: accepted steps of the solver. ``evaluations``: evaluations of the equations of motion. ``jacobians``:
    evaluations of their exact derivatives.
    """

    steps: int
    evaluations: int
    jacobians: int


@dataclass
class Progress:
    """What an integration has come to: filled as it goes, so that it is whole whenever it ends.

    ``times`` (N+1,): instants of the result (s). ``march``: the integration, at its start. ``keep``: keep the
    interpolants.
    """

    equations: Equations
    times: Array
    events: Sequence[Watched]
    march: March
    keep: bool
    t: list[float] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    pieces: list[Interpolant] = field(default_factory=list)
    event: str | None = None
    failure: str | None = None

    def __post_init__(self) -> None:
        t, x = self.march.t, self.march.y
        self.t.append(t)
        self.x.append(x)
        self.reached, self.state = t, x
        self.worst = np.zeros((4, self.equations.mechanism.nc))
        self._measure(t, x, x)
        for event in self.events:
            event.last = event.evaluate(t, x)

    def run(self, tell: Callable[[float, float], None] | None) -> None:
        """Integrate to the end, an event that ends it, or a failure; `KeyboardInterrupt` passes through."""
        try:
            for step in self.march:
                self._accept(step)
                if tell is not None:
                    tell(self.reached, float(self.times[-1]))
                if self.event is not None:
                    return
        except IntegrationFailed as failed:
            self.failure = str(failed)

    @property
    def drift(self) -> dict[str, Drift]:
        """The drift by the name of the constraint."""
        names = self.equations.mechanism.constraints
        return {name: Drift(*(float(w) for w in self.worst[:, i])) for i, name in enumerate(names)}

    @property
    def counts(self) -> SolverCounts:
        """What it has taken."""
        return SolverCounts(self.march.steps, self.march.evaluations, self.march.jacobians)

    def _accept(self, step: OdeStep) -> None:
        """Take from a step what is asked for."""
        e, times = self.equations, self.times
        inside = times[(times > step.start) & (times <= step.end)]
        values = [event.evaluate(step.end, step.y) for event in self.events]
        crossed = [event for event, value in zip(self.events, values, strict=True) if event.crossed(value)]
        piece: Interpolant | None = None
        if self.keep or crossed or np.any(inside < step.end):
            piece = step.interpolant()
        end, x_end = step.end, step.y
        if crossed:
            assert piece is not None
            end, x_end = self._take_events(crossed, piece, step.y)
        for event, value in zip(self.events, values, strict=True):
            event.last = value
        for t in inside[inside <= end]:
            self.t.append(float(t))
            if t == end:
                self.x.append(x_end)
            else:
                assert piece is not None
                self.x.append(e.hold(float(t), piece(t)))
        if self.keep and piece is not None:
            self.pieces.append(piece)
        self.reached, self.state = end, x_end
        self._measure(step.end, e.state(step.end, step.raw), step.y)

    def _take_events(self, crossed: Sequence[Watched], piece: Interpolant, x_end: Array) -> tuple[float, Array]:
        """Record the events of a step in the order of time, up to one that ends the simulation."""
        e = self.equations

        def along(t: float) -> Array:
            return e.state(t, piece(t))

        found = [(event.locate(along, piece.start, piece.end), event) for event in crossed]
        # The state of an event is a zero but for rounding: a start from there is no event again.
        begun = self.t[0] + _AT_ONCE * max(1.0, abs(self.t[0]))
        for t, event in sorted(found, key=lambda pair: pair[0]):
            if t <= begun:
                continue
            x = x_end if t == piece.end else e.hold(t, piece(t))
            event.t.append(t)
            event.x.append(x)
            if event.terminal and len(event.t) >= event.terminal:
                self.event = event.name
                return t, x
        return piece.end, x_end

    def _measure(self, t: float, raw: Array, x: Array) -> None:
        m = self.equations.mechanism.at_time(t)
        if not m.nc:
            return
        after = rates(m, x[: m.nq], x[m.nq :])
        before = after
        if self.equations.projection is not None and raw is not x:
            before = rates(m, raw[: m.nq], raw[m.nq :])
        np.maximum(self.worst, np.abs([*after, *before]), out=self.worst)
