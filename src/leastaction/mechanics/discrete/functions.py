"""The functions that a step is made of, with their derivatives, and the force that drives prescribed variables.

With ``q = (q1 + q2)/2`` and ``v = (q2 - q1)/dt``, all of them are functions of `Mechanism` of ``(q, v)``, which are
linear in ``(q1, q2)``: the derivatives follow without a new formula.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.function_derivatives import FunctionDerivatives, Substituted
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_time_step


def discrete_lagrangian(m: Mechanism, q1: npt.ArrayLike, q2: npt.ArrayLike, dt: float) -> FunctionDerivatives:
    """Return ``Ld = dt L``; see `MidpointVI.discrete_lagrangian`."""
    h = as_time_step(dt)
    q, v = _midpoint(m, q1, q2, h)
    return _on_a_step("Ld", m.lagrangian(q, v), _places_and_rates(m.nq, h), h, {"q1": m.nq, "q2": m.nq})


def discrete_potential(
    m: Mechanism, q1: npt.ArrayLike, q2: npt.ArrayLike, dt: float, element: str | None
) -> FunctionDerivatives:
    """Return ``dt V``; see `MidpointVI.discrete_potential`."""
    h = as_time_step(dt)
    q, _ = _midpoint(m, q1, q2, h)
    places = _places_and_rates(m.nq, h)[: m.nq]
    of = m.potential(q, element)
    return _on_a_step(f"dt {of.name}", of, places, h, {"q1": m.nq, "q2": m.nq})


def discrete_force(
    m: Mechanism,
    shares: tuple[float, float],
    q1: npt.ArrayLike,
    q2: npt.ArrayLike,
    u: npt.ArrayLike | None,
    dt: float,
    element: str | None,
) -> tuple[FunctionDerivatives, FunctionDerivatives]:
    """Return the shares of ``dt f`` at the start and at the end of a step; see `MidpointVI.discrete_force`."""
    h = as_time_step(dt)
    q, v = _midpoint(m, q1, q2, h)
    of = m.force(q, v, u, element)
    n = 2 * m.nq
    by = np.eye(n + m.n_inputs)
    by[:n, :n] = _places_and_rates(m.nq, h)
    arguments = {"q1": m.nq, "q2": m.nq, "u": m.n_inputs}
    first, second = (
        _on_a_step(f"fd{sign} of {of.name}", of, by, share * h, arguments)
        for sign, share in zip("-+", shares, strict=True)
    )
    return first, second


def driving_force(m: Mechanism, shares: tuple[float, float], run: Trajectory) -> Array:
    """Return the forces (N-1, nrho) on prescribed variables; see `MidpointVI.driving_force`."""
    dt = np.diff(run.t)
    middle, rates = (run.q[1:] + run.q[:-1]) / 2.0, np.diff(run.q, axis=0) / dt[:, None]
    steps = list(zip(middle, rates, run.inputs, strict=True))
    slopes = [m.core.gradient(q, v) for q, v, _ in steps]
    L_q, L_v = (np.array([slope[i][m.nd :] for slope in slopes]).reshape(len(dt), m.nrho) for i in (0, 1))
    f = np.array([m.core.force(q, v, u)[m.nd :] for q, v, u in steps]).reshape(len(dt), m.nrho)
    h = dt[:, None]
    before = h * L_q / 2.0 - L_v + shares[0] * h * f  # D1Ld + fd-
    after = h * L_q / 2.0 + L_v + shares[1] * h * f  # D2Ld + fd+
    held = np.array(
        [m.constraint_jacobian(q)[:, m.nd :].T @ lam for q, lam in zip(run.q[:-1], run.lam, strict=True)]
    ).reshape(len(dt), m.nrho)
    impulses = -(after[:-1] + before[1:] - held[1:])
    force: Array = 2.0 * impulses / (h[:-1] + h[1:])
    return force


def _midpoint(m: Mechanism, q1: npt.ArrayLike, q2: npt.ArrayLike, dt: float) -> tuple[Array, Array]:
    start, end = (as_array(q, what, (m.nq,), names=m.variables) for q, what in ((q1, "q1"), (q2, "q2")))
    return (start + end) / 2.0, (end - start) / dt


def _places_and_rates(n: int, dt: float) -> Array:
    """Return [q; v] by [q1; q2]."""
    one = np.eye(n)
    return np.block([[one / 2.0, one / 2.0], [-one / dt, one / dt]])


def _on_a_step(
    name: str, of: FunctionDerivatives, by: Array, factor: float, arguments: dict[str, int]
) -> FunctionDerivatives:
    evaluate = Substituted(of.evaluate, by, factor)
    return FunctionDerivatives.of(name, arguments, evaluate, rows=of.rows, highest_order=of.highest_order)
