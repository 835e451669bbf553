"""The functions that a step is made of, with their derivatives, and the force that drives prescribed variables.

They are methods of `MidpointVI`, which is ``vi`` here.

With ``q = (q1 + q2)/2`` and ``v = (q2 - q1)/dt``, all of them are functions of `Mechanism` of ``(q, v)``, which are
linear in ``(q1, q2)``: the derivatives follow without a new formula. Of a rotation that is a quaternion derivatives
are by turns of either end in the body, and middle and angular velocity are those of
`leastaction.mechanics.mechanism.queries.turn_charts`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from leastaction.mechanics.discrete.balance import DiscreteBalance, balance_of
from leastaction.mechanics.discrete.derivatives import check_trajectory
from leastaction.mechanics.discrete.impulses import impulses_along
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.arguments import single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.composition import Composed, PushedBack, Turns
from leastaction.mechanics.mechanism.queries.function_derivatives import Evaluate, FunctionDerivatives
from leastaction.mechanics.mechanism.queries.functions import places_of_turns
from leastaction.mechanics.mechanism.queries.turn_charts import PushedStep, TurnedStep
from leastaction.mechanics.mechanism.turns import difference, moved_by
from leastaction.numerics.arrays import Array, as_time_step
from leastaction.numerics.rotations import exponential


def discrete_lagrangian(vi: Integrator, q1: ArrayLike, q2: ArrayLike, dt: float) -> FunctionDerivatives:
    """Return ``Ld = dt L((q1 + q2)/2, (q2 - q1)/dt)`` (J s), by ``q1`` and ``q2``, to the fourth order.

    Rotations that are quaternions go the shorter way, and derivatives are by turns of the ends in their bodies.

    Parameters
    ----------
    q1, q2 : array_like, shape (nq,)
        Configurations at the start and the end of a step.
    dt : float
        Time step (s).

    Returns
    -------
    FunctionDerivatives
        ``Ld.by("q1")`` is D1Ld, ``Ld.by("q1", "q2")`` is D2D1Ld.

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, or a time step that is not positive.
    """
    middle = _Middle.of(vi.mechanism, q1, q2, dt)
    return middle.function("Ld", vi.mechanism.lagrangian(middle.q, middle.v))


def discrete_potential(
    vi: Integrator, q1: ArrayLike, q2: ArrayLike, dt: float, element: str | None = None
) -> FunctionDerivatives:
    """Return what one potential, or all, take from `discrete_lagrangian`: ``dt V((q1 + q2)/2)`` (J s).

    Parameters
    ----------
    q1, q2, dt
        As of `discrete_lagrangian`, errors too.
    element : str, optional
        As of `Mechanism.potential`.
    """
    middle = _Middle.of(vi.mechanism, q1, q2, dt)
    of = vi.mechanism.potential(middle.q, element)
    return middle.function(f"dt {of.name}", of)


def discrete_force(
    vi: Integrator, q1: ArrayLike, q2: ArrayLike, u: ArrayLike | None, dt: float, element: str | None = None
) -> tuple[FunctionDerivatives, FunctionDerivatives]:
    """Return the discrete forces fd- and fd+ of one element, or of all, by ``q1``, ``q2`` and ``u``.

    Parameters
    ----------
    q1, q2, dt
        As of `discrete_lagrangian`, errors too.
    u : array_like, shape (n_inputs,), or None
        Inputs; zero if None.
    element : str, optional
        As of `Mechanism.force`.

    Returns
    -------
    fd_minus, fd_plus : FunctionDerivatives
        Impulses (N s or N m s) on all nv variables at the start and at the end of the step, as `split` shares them.
    """
    middle = _Middle.of(vi.mechanism, q1, q2, dt)
    of = vi.mechanism.force(middle.q, middle.v, u, element)
    return middle.force(of, vi.shares, 0), middle.force(of, vi.shares, 1)


def driving_force(vi: Integrator, trajectory: Trajectory) -> Array:
    """Return the forces that make the prescribed variables move as they do in a run (dissertation 4.42).

    A prescribed variable is moved by whatever force that takes. At an instant between two steps it is the impulse
    that its own equation of motion lacks, ``-(D2Ld + fd+ of the step before + D1Ld + fd- of the step after -
    Dh^T lam)``, here over the time that it stands for, half of both steps. In continuous time
    `ContinuousDynamics.inverse_dynamics` has it.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism.

    Returns
    -------
    ndarray, shape (N-1, nrho)
        At the instants ``t[1:-1]``, in the order of `Mechanism.kinematic` (N or N m). Besides the forces of
        elements, and positive where it drives the variable up; of a rotation the torque in the axes behind the joint.

    Raises
    ------
    ArgumentError
        For a trajectory of a mechanism with other variables.
    """
    check_trajectory(vi, trajectory)
    run = trajectory
    before, after, held = impulses_along(vi, run.t, run.q, run.inputs, run.lam)
    dt = np.diff(run.t)[:, None]
    lacking = (after[:-1] + before[1:] - held[1:])[:, vi.mechanism.nd :]
    return np.asarray(-2.0 * lacking / (dt[:-1] + dt[1:]))


def balance(vi: Integrator, trajectory: Trajectory) -> DiscreteBalance:
    """Return how energy and work balance along a motion, such as one that an optimisation found.

    Parameters
    ----------
    trajectory : Trajectory
        Of this mechanism. `Trajectory.balance` of what was simulated is the same.

    Raises
    ------
    ArgumentError
        For a trajectory of a mechanism with other variables.
    """
    check_trajectory(vi, trajectory)
    run = trajectory
    return balance_of(run.t, vi.core.energies(run.t, run.x, run.u, run.lam))


@dataclass(frozen=True)
class _Middle:
    """The middle of a step of a length dt (s): q and v there, [q; v] by [q1; q2], and what of it turns say."""

    q: Array
    v: Array
    dt: float
    by: Array
    turns: Turns | None

    @classmethod
    def of(cls, m: Mechanism, q1: ArrayLike, q2: ArrayLike, dt: float) -> _Middle:
        start, end, h = single(m, q1, "q1"), single(m, q2, "q2"), as_time_step(dt)
        one = np.eye(m.nv)
        by = np.block([[one / 2.0, one / 2.0], [-one / h, one / h]])
        if not m.tree.rotations:
            return cls((start + end) / 2.0, (end - start) / h, h, by, None)
        turned, apart = places_of_turns(m), difference(m, end, start)
        places = np.hstack([turned, m.nv + turned])
        by[places.ravel()] = 0.0
        turns = Turns(TurnedStep(exponential(apart[turned]), h), places, places, np.zeros(places.shape))
        return cls(moved_by(m, start, apart / 2.0), apart / h, h, by, turns)

    def composed(self, of: FunctionDerivatives, factor: float) -> Composed:
        """Return a function of [q; v; u], or of q alone, as one of [q1; q2; u]."""
        more = of.size - len(self.by)
        by = np.pad(self.by, ((0, max(more, 0)), (0, max(more, 0))))[: of.size]
        by[len(self.by) :, len(self.by) :] = np.eye(max(more, 0))
        turns = self.turns if self.turns is None or more >= 0 else replace(self.turns, z=self.turns.z[:, :3])
        return Composed(of.evaluate, by, factor, turns)

    def function(self, name: str, of: FunctionDerivatives) -> FunctionDerivatives:
        """Return ``dt of`` by [q1; q2]."""
        n = len(self.v)
        evaluate = self.composed(of, self.dt)
        return FunctionDerivatives.of(name, {"q1": n, "q2": n}, evaluate, highest_order=of.highest_order)

    def force(self, of: FunctionDerivatives, shares: tuple[float, float], side: int) -> FunctionDerivatives:
        """Return what of forces acts at one end, by [q1; q2; u]."""
        n, factor = len(self.v), shares[side] * self.dt
        evaluate: Evaluate = self.composed(of, factor)
        if self.turns is not None:
            assert isinstance(self.turns.function, TurnedStep)
            pushes = PushedStep(self.turns.function, side)
            evaluate = PushedBack(self.composed(of, 1.0), self.turns, pushes, self.turns.y[:, :3], factor)
        arguments = {"q1": n, "q2": n, "u": of.size - 2 * n}
        name = f"fd{'-+'[side]} of {of.name}"
        return FunctionDerivatives.of(name, arguments, evaluate, rows=of.rows, highest_order=of.highest_order)
