"""The bridge in continuous time: the accelerations of a mechanism as a system that the optimiser can steer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np

from leastaction.errors import ArgumentError, DynamicsError
from leastaction.mechanics.configuration.assembly import project_configuration, project_velocity
from leastaction.mechanics.configuration.null_space import NullSpace
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics, as_dynamics
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.sensitivity import start_by, velocity_by
from leastaction.mechanics.elements.units import rate_of
from leastaction.mechanics.mechanism.arguments import state_by_name
from leastaction.mechanics.mechanism.kinematics import Kinematics
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.units import input_units, state_units
from leastaction.mechanics.mechanism.turns import moved
from leastaction.numerics.arrays import Array, Row
from leastaction.numerics.dataset import Dataset
from leastaction.numerics.frozen import changed
from leastaction.numerics.public import public
from leastaction.optimal.continuous import ContinuousSystem
from leastaction.optimal.quantity import Quantity
from leastaction.optimal.space import bent_by_numbers, by_numbers
from leastaction.optimal.system import FINAL_TIME, Linearization, keeps
from leastaction.systems.quantities.continuous import KINDS, points_of, quantity_of
from leastaction.systems.quantities.physical import conditions_of
from leastaction.systems.saving import dataset_with_multipliers
from leastaction.systems.state_space import space_of_states


@dataclass(frozen=True)
class _InputsOver:
    """Inputs over time as the law of a trajectory, whatever the state."""

    u: Callable[[float], Array]

    def __call__(self, t: float, x: Array) -> Array:  # noqa: ARG002 - as a law is called
        return self.u(t)


@public
class MechanismSystem(ContinuousSystem):
    """``x' = f(x, u, t)`` of a mechanism.

    State ``x = [q; rho; v; v_rho]``, input ``u = [inputs; rho_a]`` with the accelerations of the kinematic
    variables. Samples of whole trajectories are differentiated in the core, on several threads.

    Rotations that are quaternions are steered as the four numbers that they are: all derivatives are by them, and
    gains are (nu, nx). Their rate ``q' = q (0, w) / 2`` keeps their length, and what rounding or a mesh makes of it is
    without effect. `space` says how a cost takes differences: ``ContinuousQuadraticCost(..., space=system)``.

    A constrained mechanism starts on its constraints and stays there to the accuracy of the integration;
    `ContinuousDynamics` with Baumgarte's stabilisation holds it there longer.

    It holds no state: any number of threads may share it.

    Parameters
    ----------
    dynamics : ContinuousDynamics or Mechanism
        The equations of motion; of a mechanism alone, those without stabilisation. With a
        `PythonConstraint` there is no curvature, and Newton's method is not offered.
    """

    quantities = KINDS

    def __init__(self, dynamics: ContinuousDynamics | Mechanism) -> None:
        self.dynamics = as_dynamics(dynamics)
        self.mechanism = m = self.dynamics.mechanism
        self.kinematics = Kinematics(m)
        self.space = space_of_states(m)
        self.nx, self.nu = m.nx, m.n_inputs + m.nrho
        self.has_curvature = not any(element.equations and element.highest_order < 4 for element in m.elements.values())

    def f(self, x: Array, u: Array, t: float) -> Array:
        """Return the rate of the state (nx,); `DynamicsError` where the mechanism has none."""
        return np.asarray(self.rates(x[None, :], u[None, :], np.array([t]))[0])

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        m = self.mechanism
        nq, nd = m.nq, m.nd
        points = points_of(m, x, u)
        times = np.ascontiguousarray(t, dtype=np.float64)
        out = self.dynamics.core.accelerations(*points, self.dynamics.threads, times)
        if out.solved != len(x):
            self._explain(points, t)
        rates = np.empty((len(x), m.nx))
        rates[:, :nq] = self.kinematics.rates(x[:, :nq], x[:, nq:])
        rates[:, nq : nq + nd] = out.a
        rates[:, nq + nd :] = u[:, m.n_inputs :]
        return rates

    def roll_out_pieces(
        self, h: Array, t: Array, matrix: Array, reference: tuple[Array, Array], K: Array, z: Array, u: Array
    ) -> int:
        if not keeps(self, MechanismSystem, "rates", "own_rates", "f"):
            return 0  # its own rates count
        return self.dynamics.core.roll_out_pieces(h, t, matrix, *reference, K, z, u)

    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        A, B = self.linearize(x[None, :], u[None, :], np.array([t]))
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, t: float, z: Array) -> Array:
        return np.asarray(self.curvatures(x[None, :], u[None, :], np.array([t]), z[None, :])[0])

    def own_linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        m = self.mechanism
        nq, nd = m.nq, m.nd
        slopes = self.dynamics.linearize(*points_of(m, x, u), t).all
        J = np.zeros((len(x), self.nx, self.nx + self.nu))
        if self.space is None:
            rows = np.arange(nq)
            J[:, rows, nq + rows] = 1.0
            J[:, nq : nq + nd] = slopes[:, :nd]
        else:
            J[:, :nq, :nq] = self.kinematics.rates_by_configuration(x[:, nq:])
            J[:, :nq, nq : self.nx] = self.kinematics.directions(x[:, :nq])
            J[:, nq : nq + nd] = by_numbers(self.space, x, slopes[:, :nd])
        kinematic = np.arange(m.nrho)
        J[:, nq + nd + kinematic, self.nx + m.n_inputs + kinematic] = 1.0
        second = partial(self.curvatures, x.copy(), u.copy(), t.copy())
        return Linearization(J[:, :, : self.nx], J[:, :, self.nx :], second)

    def own_curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        m = self.mechanism
        points, z_a = points_of(m, x, u), np.ascontiguousarray(z[:, m.nq : m.nq + m.nd])
        found = self.dynamics.curvature(*points, t, z_a=z_a)
        if self.space is None:
            return found
        slope = np.einsum("ka,kai->ki", z_a, self.dynamics.linearize(*points, t).all[:, : m.nd])
        found = bent_by_numbers(self.space, x, slope, found)
        turning = self.kinematics.rates_by_both(z[:, : m.nq])
        found[:, : m.nq, m.nq : m.nx] += turning
        found[:, m.nq : m.nx, : m.nq] += turning.transpose(0, 2, 1)
        return found

    @property
    def autonomous(self) -> bool:  # type: ignore[override]
        """Whether nothing depends on time: no expression in it, and no subclass has rates of its own."""
        return not self.mechanism.core.timed and keeps(self, MechanismSystem, "rates", "own_rates", "f")

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:
        return quantity_of(self.dynamics, kind, np.zeros(1) if t is None else t)

    @property
    def state_units(self) -> tuple[str, ...]:
        return state_units(self.mechanism, momenta=False)

    @property
    def input_units(self) -> tuple[str, ...]:
        m, units = self.mechanism, self.mechanism.units
        return (*input_units(m), *(rate_of(units[name], 2) for name in m.kinematic))

    def told(self) -> MechanismSystem | None:
        """Return the system without what a subclass adds; None of one with rates of its own."""
        if type(self) is MechanismSystem:
            return self
        plain = MechanismSystem(self.dynamics)
        own = keeps(self, MechanismSystem, "rates", "own_rates", "f")
        return None if not own or (plain.nx, plain.nu) != (self.nx, self.nu) else plain

    def dataset(self, result: Any) -> Dataset:
        names = "constraint_damping", "constraint_stiffness", "threads"
        settings = {name: getattr(self.dynamics, name) for name in names}
        return dataset_with_multipliers(result, {"name": "MechanismSystem", **settings}, impulses=False)

    def motion(self, result: Any) -> ContinuousTrajectory:
        m = self.mechanism
        q, v, inputs, rho_a = points_of(m, result.x, result.u)
        found = self.dynamics.accelerations(q, v, inputs, rho_a, result.t)
        a = np.hstack([found.a[:, : m.nd], rho_a])
        return ContinuousTrajectory(
            m, result.t, q, inputs, found.lam, v=v, a=a, dense=result.dense.x, law=_InputsOver(result.dense.u)
        )

    # ---- Parameters -------------------------------------------------------------------------------

    @property
    def parameters(self) -> Mapping[str, float]:  # type: ignore[override]
        """Those of the mechanism."""
        return self.mechanism.parameters

    def with_parameters(self, values: Mapping[str, float]) -> Self:
        """Return the same system with other values of some parameters; errors as of `Mechanism.with_parameters`."""
        return self._remade(self.mechanism.with_parameters(values))

    def with_parameters_near(self, values: Mapping[str, float]) -> Self:
        return self._remade(self.mechanism.with_parameters(values, allow_nonphysical=True))

    def _remade(self, mechanism: Mechanism) -> Self:
        own = self.dynamics
        settings = {name: getattr(own, name) for name in ("constraint_damping", "constraint_stiffness", "threads")}
        dynamics = ContinuousDynamics(mechanism, **settings)
        return changed(self, mechanism=mechanism, dynamics=dynamics, kinematics=Kinematics(mechanism))

    def conditions_of(self, names: Sequence[str]) -> list[Quantity]:
        return conditions_of(self.mechanism, names)

    def start_by_parameters(self, x: Array, names: Sequence[str], free: bool | Sequence[str]) -> Array:
        """Return how configuration and velocity follow parameters that change constraints, (nx, len(names)).

        Raises
        ------
        ArgumentError
            Where they would have to, and are not free.
        """
        m, out = self.mechanism, np.zeros((self.nx, len(names)))
        numbers = [name for name in names if name != FINAL_TIME]
        if not m.nc or not numbers:
            return out
        entries = () if free is False else range(m.nq) if free is True else self.free_entries(list(free))
        hold = [name for i, name in enumerate(m.coordinates) if i not in entries and name in m.variables]
        columns = [list(names).index(name) for name in numbers]
        q, v = np.ascontiguousarray(x[: m.nq]), np.ascontiguousarray(x[m.nq :])
        try:
            dq = start_by(MidpointVI(m, threads=1), q, numbers, hold)
            dv = velocity_by(m, q, v, numbers, dq, hold)
        except ArgumentError as error:
            raise ArgumentError(
                f"unknowns: too little of the start is free to follow: {error}, or give free_start=True"
            ) from None
        rows = np.arange(m.nd)[:, None]
        out[: m.nq, columns] = self.kinematics.directions(q)[:, : m.nd] @ dq
        out[m.nq + rows, columns] = dv
        return out

    # ---- What it is asked -------------------------------------------------------------------------

    def own_input_name(self, i: int) -> str:
        """Return the name of an input, or of the prescribed variable whose acceleration it is."""
        m = self.mechanism
        return (*m.inputs, *m.variables[m.nd :])[i]

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        """Return the directions (nx, n) in which an initial state may move; tangent to the constraints.

        With ``h = 0`` and ``Dh v + dh/dt = 0`` they are the null space of ``[Dh, 0; v'D2h + D dh/dt, Dh]``, among the
        entries that are free.
        """
        m = self.mechanism
        chosen = list(range(self.nx)) if free is None else self.free_entries(free)
        whole = np.eye(self.nx)
        if self.space is not None:
            # A direction is free where all is that it moves.
            stays = np.ones(self.nx, dtype=np.bool_)
            stays[chosen] = False
            chosen = np.flatnonzero(~self.space.pattern[stays].any(axis=0)).tolist()
            whole = self.space.plus_derivative(x)
        whole = whole[:, chosen]
        if not m.nc:
            return whole
        q, v = np.ascontiguousarray(x[: m.nq]), x[m.nq :]
        Dh, h = m.constraint_jacobian(q), 1e-6
        # Directions may be off by a difference's error: `moved_start` brings the state back onto the constraints.
        ends = moved(m, np.stack([q, q]), h * np.stack([v, -v]))
        turned = (m.constraint_jacobian(ends[0]) - m.constraint_jacobian(ends[1])) / (2.0 * h)
        turned = turned + m.core.constraint_drift(q)[1]
        held = np.block([[Dh, np.zeros_like(Dh)], [turned, Dh]])
        return np.asarray(whole @ NullSpace.of(held[:, chosen]).basis)

    def own_starting_at(self, t: float) -> MechanismSystem | None:
        then = self.mechanism.at_time(t)
        return None if then is self.mechanism else self._remade(then)

    def own_state(self, given: Any) -> Row | None:
        """Return numbers by name, with what is not turned."""
        return state_by_name(self.mechanism, given) if isinstance(given, Mapping) else None

    def own_moved_start(self, x: Array, dx: Array) -> Array:
        """Return an initial state moved along its directions, and brought back onto the constraints."""
        m = self.mechanism
        there = x + dx
        there[: m.nq] = self.kinematics.on_space(there[: m.nq])
        if m.nc:
            q = np.ascontiguousarray(there[: m.nq])
            still = [name for name, change in zip(m.coordinates, dx[: m.nq], strict=True) if change == 0.0]
            still = [name for name in still if name in m.variables]
            q = project_configuration(m, q, hold=still, move_kinematic=True).q
            there = np.concatenate([q, project_velocity(m, q, there[m.nq :]).v])
        return there

    def _explain(self, points: tuple[Array, Array, Array, Array], t: Array) -> None:
        """Raise the error that says why there are no accelerations."""
        try:
            self.dynamics.accelerations(*points, t)
        except ArgumentError as error:
            # A diverging roll-out, not an argument that somebody gave.
            at = float(t[0])
            raise DynamicsError(f"no accelerations at t = {at:.6g} s: {error}", t=at, variable=None) from error
