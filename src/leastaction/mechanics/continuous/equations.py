"""The equations of motion as ``dx/dt = f(t, x)`` with the inputs of a simulation in them."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from leastaction.errors import DynamicsError
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.prescribed import Prescribed
from leastaction.mechanics.continuous.signals import WholeInput
from leastaction.mechanics.continuous.stabilisation import ConstraintLost, Projection, project
from leastaction.mechanics.mechanism.kinematics import Kinematics
from leastaction.numerics.arrays import Array


class Equations:
    """``x = [q; rho; v; v_rho]`` and its rate ``[q'; rho'; a; rho_a]``, where ``q' = v`` but for quaternions.

    A prescribed motion takes the place of its entries of x wherever x is used, so that they are exact at all
    times; what the integrator makes of them is its own business.

    ``law``: the input ``[inputs; rho_a]``; only its part for the inputs where there is a prescribed motion.
    ``projection``: given where constraints are projected on.
    """

    def __init__(
        self, dynamics: ContinuousDynamics, law: WholeInput, motion: Prescribed | None, projection: Projection | None
    ) -> None:
        self.dynamics = dynamics
        self.mechanism = dynamics.mechanism
        self.law = law
        self.motion = motion
        self.projection = projection if self.mechanism.nc else None
        self.kinematics = Kinematics(self.mechanism)
        self.curved = self.kinematics.curved

    @property
    def holds(self) -> bool:
        """Whether the end of a step is moved: onto a prescribed motion, constraints, quaternions of unit length."""
        return self.motion is not None or self.projection is not None or self.curved

    def __getstate__(self) -> dict[str, object]:
        # A trajectory goes to another process with the mechanism; what is compiled is made anew there.
        d = self.dynamics
        stabilization = (d.constraint_damping, d.constraint_stiffness)
        return {**self.__dict__, "dynamics": stabilization}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        damping, stiffness = state["dynamics"]
        self.dynamics = ContinuousDynamics(self.mechanism, constraint_damping=damping, constraint_stiffness=stiffness)

    def state(self, t: float, x: Array) -> Array:
        """Return x with the prescribed motion in its place, and quaternions of unit length."""
        m = self.mechanism
        if self.curved:
            x = np.concatenate([self.kinematics.on_space(x[: m.nq]), x[m.nq :]])
        if self.motion is None:
            return x
        x = x.copy()
        x[m.first_rho : m.nq], x[m.nq + m.nd :] = self.motion.at(t)
        return x

    def input(self, t: float, x: Array) -> Array:
        """Return ``[inputs; rho_a]`` at a time and a state; after the jump where the inputs jump."""
        u = self.law.value(t, x)
        if self.motion is None:
            return u
        return np.concatenate([u, self.motion.acceleration(t)])

    def solve(self, t: float, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the accelerations (nq,) and the multipliers (nc,) at a time, a state and an input."""
        m = self.mechanism
        out = self.dynamics.accelerations(x[: m.nq], x[m.nq :], u[: m.n_inputs], u[m.n_inputs :], t)
        return np.concatenate([out.a, u[m.n_inputs :]]), out.lam

    def rate(self, t: float, x: Array) -> Array:
        """Return dx/dt; `DynamicsError` where there is none."""
        m = self.mechanism
        if not np.all(np.isfinite(x)):
            raise DynamicsError("the state is not finite", t=t, variable=None)
        quaternions = x
        x = self.state(t, x)
        u = self.input(t, x)
        if not np.all(np.isfinite(u)):
            names = [*m.inputs, *(f"acceleration of {name}" for name in m.kinematic)]
            bad = names[int(np.argmax(~np.isfinite(u)))]
            raise DynamicsError(f"the input {bad!r} is not finite", t=t, variable=None)
        # The core itself: all is checked, and the checks of a call by hand would take longer than it.
        out = self.dynamics.core.accelerations(
            x[None, : m.nq], x[None, m.nq :], u[None, : m.n_inputs], u[None, m.n_inputs :], 1, np.array((t,))
        )
        if out.solved < 1:
            self.dynamics.accelerations(x[: m.nq], x[m.nq :], u[: m.n_inputs], u[m.n_inputs :], t)
            raise DynamicsError("the equations of motion have no solution", t=t, variable=None)
        v = x[m.nq :]
        # Of their own length: so that what an integrator does to it is without effect (see `Kinematics`).
        q_rate = self.kinematics.rates(quaternions[: m.nq], v) if self.curved else v
        return np.concatenate([q_rate, out.a[0], u[m.n_inputs :]])

    def rate_on_constraints(self, t: float, x: Array) -> Array:
        """Return dx/dt at the state on the constraints that is nearest, where there is one."""
        if np.all(np.isfinite(x)):
            with contextlib.suppress(ConstraintLost):
                x = self.hold(t, x)
        return self.rate(t, x)

    def jacobian(self, t: float, x: Array) -> Array:
        """Return the derivative of the rate by x, (nx, nx), exact but for laws that give no derivative."""
        m = self.mechanism
        nd, nq = m.nd, m.nq
        x = self.state(t, x)
        u = self.input(t, x)
        q, v = x[:nq], x[nq:]
        d = self.dynamics.linearize(q, v, u[: m.n_inputs], u[m.n_inputs :], t)
        by_x = np.zeros((m.nx, m.nx))
        by_x[:nq, :nq] = self.kinematics.rates_by_configuration(v)
        by_x[:nq, nq:] = self.kinematics.directions(q)
        by_x[nq : nq + nd, :nq] = d.a_dq @ self.kinematics.changes(q)
        by_x[nq : nq + nd, nq:] = d.a_dv
        slope = self.law.jacobian(t, x)
        if slope is not None:
            by_u = np.zeros((m.nx, m.n_inputs + m.nrho))
            by_u[nq : nq + nd] = np.hstack([d.a_du, d.a_drho_a])
            by_u[nq + nd :, m.n_inputs :] = np.eye(m.nrho)
            by_x += by_u[:, : len(slope)] @ slope
        if self.motion is not None:
            prescribed = np.r_[m.first_rho : nq, nq + nd : m.nx]
            by_x[:, prescribed] = 0.0
            by_x[prescribed] = 0.0
        return by_x

    def hold(self, t: float, x: Array) -> Array:
        """Return x with the prescribed motion in its place, of unit length, and on constraints that are projected on.

        Raises `ConstraintLost` if the constraints are not reached.
        """
        x = self.state(t, x)
        if self.projection is None:
            return x
        if not np.all(np.isfinite(x)):
            raise ConstraintLost("the state is not finite")
        m = self.mechanism
        try:
            q, v = project(m.at_time(t), x[: m.nq], x[m.nq :], self.projection.tolerance)
        except np.linalg.LinAlgError as error:
            raise ConstraintLost(f"the constraints cannot be held: {error}") from None
        return np.concatenate([q, v])
