"""Solutions of initial-value problems as functions of time, on the mesh of the integrator's steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.ode import IntegrationFailed, Interpolant, March
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy


@dataclass(frozen=True)
class Integration:
    """The solution of an initial-value problem, or the part of it before it failed.

    ``y`` (n,): value at the last time reached. ``t``: that time (s). ``steps``: steps made. ``failure``: why it ended
    early; None if it did not. ``breaks``, ``values`` (n+1,), (n * POINTS, size): ends of the steps in increasing order,
    and the solution at the points of that mesh.
    """

    y: Array
    t: float
    steps: int
    failure: str | None
    breaks: Array
    values: Array

    @property
    def mesh(self) -> Mesh:
        """The steps as a mesh."""
        return Mesh(self.breaks)

    def curve(self, shape: tuple[int, ...]) -> PiecewisePolynomial:
        """Return the solution as a function of time."""
        return self.mesh.fit(self.values, shape)


def integrate(
    fun: Callable[[float, Array], Array],
    t0: float,
    tf: float,
    y0: Array,
    *,
    accuracy: Accuracy,
    atol: Array | None = None,
    jumps: Sequence[float] = (),
    check: Callable[[float, Array], str | None] | None = None,
) -> Integration:
    """Integrate ``y' = fun(t, y)`` from t0 to tf, forwards or backwards.

    ``fun``: as of `March`. ``t0``, ``tf``: times (s). ``y0`` (size,): initial value. ``atol`` (size,): absolute
    tolerance of each entry, instead of the one of `accuracy`. ``jumps``: times where `fun` jumps. ``check``: ``check(t,
    y)`` after every step; a string ends the integration with that reason.
    """
    march = March(
        fun,
        t0,
        tf,
        y0,
        solver=accuracy.solver,
        rtol=accuracy.rtol,
        atol=accuracy.atol if atol is None else atol,
        jumps=jumps,
        max_steps=accuracy.max_steps,
    )
    pieces: list[Interpolant] = []
    failure = None
    try:
        for step in march:
            pieces.append(step.interpolant())
            failure = check(step.end, step.y) if check is not None else None
            if failure is not None:
                break
    except IntegrationFailed as failed:
        failure = str(failed)
    if failure is not None:
        failure = f"t = {march.t:.6g} s: {failure}"
    breaks, values = _sampled(pieces, t0, y0, backwards=tf < t0, wanted=failure is None)
    return Integration(march.y, march.t, march.steps, failure, breaks, values)


def _sampled(pieces: list[Interpolant], t0: float, y0: Array, *, backwards: bool, wanted: bool) -> tuple[Array, Array]:
    if not pieces or not wanted:
        return np.array([t0]), np.empty((0, y0.size))
    if backwards:
        pieces = pieces[::-1]
    first = pieces[0]
    breaks = np.array([min(first.start, first.end), *(max(p.start, p.end) for p in pieces)])
    mesh = Mesh(breaks)
    points = mesh.t.reshape(len(pieces), -1)
    values = [piece(t).T for piece, t in zip(pieces, points, strict=True)]
    return breaks, np.concatenate(values)
