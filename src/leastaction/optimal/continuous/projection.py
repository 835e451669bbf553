"""The projection operator in continuous time (dissertation 6.2.1).

``(x, u) = P(xbar, ubar)`` with ``x(t0) = xbar(t0)``, ``x' = f(x, u, t)``, ``u = ubar - K (x - xbar)``.
The cost is one more state of the same integration, so that it is as accurate as the trajectory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.piecewise import PiecewisePolynomial, approximate
from leastaction.numerics.public import public
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.integrate import integrate
from leastaction.optimal.continuous.own_projection import feedback_of
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.space import StateSpace
from leastaction.optimal.system import second_derivative


@public
@dataclass(frozen=True)
class ContinuousRollout:
    """A trajectory and its cost, or why there is none.

    Attributes
    ----------
    trajectory : DenseTrajectory or None
        None if the integration failed.
    cost : float
        Its cost; 0 if no cost was given, NaN if the integration failed.
    steps : int
        Steps of the integrator.
    failure : str or None
        Why the integration ended early, with its time.
    t : float
        Last time reached (s).
    x : ndarray (nx,)
        State there.
    """

    trajectory: DenseTrajectory | None
    cost: float
    steps: int
    failure: str | None
    t: float
    x: Array


@dataclass(frozen=True)
class Follower:
    """The feedback ``u = u_ref - length C - K (x - x_ref)``.

    ``reference``: ``(x_ref, u_ref)``. ``feedback``: ``[K (row by row); C]`` in one vector. ``length``: factor of C.
    ``space``: where states that are no plain vectors live. Then ``x - x_ref`` is the tangent at x_ref along which x
    lies, as long as the way to it: the difference of numbers where they are near, and no shorter where they are far.
    """

    reference: DenseTrajectory
    feedback: PiecewisePolynomial
    length: float
    space: StateSpace | None = None

    def input(self, x: Array, t: float) -> Array:
        """Return the input at a state and a time."""
        nx, nu = self.reference.nx, self.reference.nu
        ref, law = self.reference.xu.flat(t), self.feedback.flat(t)
        u: Array = ref[nx:] - law[: nu * nx].reshape(nu, nx) @ self._off(x, ref[:nx])
        u -= self.length * law[nu * nx :]
        return u

    def inputs(self, x: Array, t: Array) -> Array:
        """Return the inputs (n, nu) at states (n, nx) and times (n,)."""
        nx, nu = self.reference.nx, self.reference.nu
        ref, law = self.reference.xu(t), self.feedback(t)
        K = law[:, : nu * nx].reshape(-1, nu, nx)
        u: Array = ref[:, nx:] - np.einsum("nij,nj->ni", K, self._off(x, ref[:, :nx]))
        u -= self.length * law[:, nu * nx :]
        return u

    def _off(self, x: Array, at: Array) -> Array:
        if self.space is None:
            return np.asarray(x - at)
        return np.asarray(np.einsum("...ia,...a->...i", self.space.plus_derivative(at), self.space.difference(x, at)))


def roll_out(
    system: ContinuousSystem,
    follower: Follower,
    *,
    accuracy: Accuracy,
    jumps: Sequence[float] = (),
    cost: ContinuousCost | None = None,
    cost_scale: float = 0.0,
    bound: float = np.inf,
    x0: Array | None = None,
    least: Array | None = None,
) -> ContinuousRollout:
    """Integrate a system under a feedback, and its cost with it.

    ``follower``: the feedback; its reference sets the horizon. ``accuracy``: of one step. The cost's own absolute
    tolerance is no larger than `rtol` times `cost_scale`. ``jumps``: times where dynamics, cost or feedback jump.
    ``cost_scale``: a cost of about the size to be expected, if known. ``bound``: the integration is given up when a
    cost that only grows is past this. ``x0`` (nx,): initial state; that of the reference if left out. ``least`` (nx +
    nu,): sizes of states and inputs below which relative accuracy is not worth having.
    """
    reference = follower.reference
    nx, t0, tf = reference.nx, reference.t0, reference.tf
    begin = reference.xu.flat(t0)[:nx] if x0 is None else x0
    # The cost so far is looked at after every step, and not trusted beyond its own error.
    limit = bound if cost is not None and cost.nonnegative else np.inf

    def fun(t: float, y: Array) -> Array:
        x = y[:nx]
        u = follower.input(x, t)
        rate = np.empty(y.size)
        rate[:nx] = system.f(x, u, t)
        if cost is not None:
            rate[nx] = cost.rate(x, u, t)
        return rate

    def check(t: float, y: Array) -> str | None:  # noqa: ARG001
        return "the cost was past its bound" if y[-1] > limit else None

    atol = np.full(nx + (cost is not None), accuracy.atol)
    if cost is not None and cost_scale > 0.0:
        atol[-1] = min(accuracy.atol, accuracy.rtol * cost_scale)
    done = integrate(
        fun,
        t0,
        tf,
        begin if cost is None else np.append(begin, 0.0),
        accuracy=accuracy,
        atol=atol,
        jumps=jumps,
        check=check if np.isfinite(limit) else None,
    )
    x_end = done.y[:nx]
    if done.failure is not None:
        return ContinuousRollout(None, np.nan, done.steps, done.failure, done.t, x_end)
    total = 0.0
    if cost is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(done.y[nx]) + cost.final_value(x_end, tf)
    states = PiecewisePolynomial(done.breaks, done.mesh.coefficients(done.values[:, :nx]), (nx,))

    def both(t: Array) -> Array:
        x = states(t)
        return np.hstack([x, follower.inputs(x, t)])

    mesh, values = approximate(both, done.mesh, accuracy.sampling, least)
    trajectory = DenseTrajectory(mesh.fit(values, (values.shape[1],)), nx)
    return ContinuousRollout(trajectory, total, done.steps, None, tf, x_end)


@public
class ContinuousProjection:
    """The projection operator of a system with given gains; as fit for several threads as the system is.

    Parameters
    ----------
    system : ContinuousSystem
    K : PiecewisePolynomial
        Gains (nu, nx), such as those of `regulate_continuous`.
    accuracy : Accuracy, optional
    jumps : sequence of float, optional
        Times (s) where the curves to be projected jump.

    Raises
    ------
    ArgumentError
        Gains of a wrong shape.
    """

    def __init__(
        self,
        system: ContinuousSystem,
        K: PiecewisePolynomial,
        *,
        accuracy: Accuracy | None = None,
        jumps: Sequence[float] = (),
    ) -> None:
        if K.shape != (system.nu, system.nx):
            raise ArgumentError(
                f"K: got gains of shape {K.shape}, expected {(system.nu, system.nx)}, that is (nu, nx)."
            )
        self.system = system
        self.K = K
        self.accuracy = accuracy or Accuracy()
        self.jumps = tuple(sorted({*jumps, *system.jumps}))
        self._feedback = feedback_of(K)

    def __call__(
        self, curve: DenseTrajectory, cost: ContinuousCost | None = None, *, x0: Array | None = None
    ) -> ContinuousRollout:
        """Return the trajectory (from x0, if given), with its cost if there is one."""
        x0 = None if x0 is None else as_array(x0, "x0", (self.system.nx,))
        return roll_out(
            self.system,
            Follower(curve, self._feedback, 0.0),
            accuracy=self.accuracy,
            jumps=self.jumps if cost is None else tuple(sorted({*self.jumps, *cost.jumps})),
            cost=cost,
            x0=x0,
        )

    def derivative(self, trajectory: DenseTrajectory, direction: DenseTrajectory) -> DenseTrajectory:
        """Return ``DP . direction`` at a trajectory (6.7)."""
        return self._swept(_Tangent(self.system, trajectory), direction)

    def second_derivative(
        self, trajectory: DenseTrajectory, one: DenseTrajectory, other: DenseTrajectory
    ) -> DenseTrajectory:
        """Return ``D2P . (one, other)`` at a trajectory: how `derivative` along one direction changes along another.

        It solves ``ddx' = A ddx + B ddu + D2f (dx, du)_1 (dx, du)_2`` with ``ddu = -K ddx`` and ``ddx(t0) = 0``, whose
        (dx, du) are the derivatives along the two.

        Raises
        ------
        ArgumentError
            Where the linearised system cannot be integrated.
        NotImplementedError
            If the system has no second derivatives.
        """
        along = self.derivative(trajectory, one), self.derivative(trajectory, other)
        still = PiecewisePolynomial(
            trajectory.xu.breaks, np.zeros_like(trajectory.xu.coefficients), (trajectory.nx + trajectory.nu,)
        )
        return self._swept(_Tangent(self.system, trajectory, along), DenseTrajectory(still, trajectory.nx))

    def _swept(self, tangent: ContinuousSystem, direction: DenseTrajectory) -> DenseTrajectory:
        rollout = roll_out(tangent, Follower(direction, self._feedback, 0.0), accuracy=self.accuracy, jumps=self.jumps)
        if rollout.trajectory is None:
            raise ArgumentError(f"trajectory: the linearised system failed, {rollout.failure}.")
        return rollout.trajectory


class _Tangent(ContinuousSystem):
    """The linearisation of a system along a trajectory, as a system of its own.

    ``motions``: two motions that its second derivatives drive it by; none if left out.
    """

    def __init__(
        self, system: ContinuousSystem, trajectory: DenseTrajectory, motions: Sequence[DenseTrajectory] = ()
    ) -> None:
        self.nx, self.nu = system.nx, system.nu
        self.jumps = system.jumps
        self._system, self._trajectory, self._motions = system, trajectory, motions

    def f(self, x: Array, u: Array, t: float) -> Array:
        A, B = self.derivatives(x, u, t)
        rate = np.asarray(A @ x + B @ u)
        if self._motions:
            here, one, other = (each.xu.flat(t) for each in (self._trajectory, *self._motions))
            at = here[: self.nx], here[self.nx :], t
            rate = rate + np.array([one @ second_derivative(self._system, *at, e) @ other for e in np.eye(self.nx)])
        return rate

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:  # noqa: ARG002
        along = self._trajectory.xu.flat(t)
        return self._system.derivatives(along[: self.nx], along[self.nx :], t)
