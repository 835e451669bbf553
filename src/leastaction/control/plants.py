"""What a controller is run on, in either kind of time: a step of the controller's at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, StepError
from leastaction.mechanics.continuous.legendre import to_momentum
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.prescribed import divided
from leastaction.numerics.arrays import Array
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.systems.continuous import MechanismSystem
from leastaction.systems.midpoint import MidpointSystem


class Plant(ABC):
    """A system that goes on over one step of a controller under an input that is held. ``system``: which it is."""

    system: Any

    @abstractmethod
    def step(self, x: Array, u: Array, k: int) -> Array:
        """Return the state at the end of step k. One without solution raises a `LeastActionError`."""

    def converts_for(self, model: object) -> Callable[[Array], Array]:  # noqa: ARG002 - overridden
        """Return how a state of the plant is one of a controller's model."""
        return lambda x: x


class _StepwisePlant(Plant):
    """A discrete system, one of whose steps is one of the controller's, or several of a `MidpointSystem`."""

    def __init__(self, system: DiscreteSystem, substeps: int) -> None:
        self.system, self.substeps = system, substeps

    def step(self, x: Array, u: Array, k: int) -> Array:
        system, parts = self.system, self.substeps
        if parts == 1:
            return np.array(system.f(x, u, min(k, system.N - 1)))
        m = system.mechanism
        # Prescribed variables go evenly to where they are commanded.
        ways = divided(m, x[m.first_rho : m.nq], u[m.n_inputs :], parts)
        for j, way in enumerate(ways):
            x = np.array(system.f(x, np.concatenate((u[: m.n_inputs], way)), parts * k + j))
        return x


class _IntegratedPlant(Plant):
    """A system in continuous time, integrated over each step of the controller."""

    def __init__(self, system: ContinuousSystem, t: Array) -> None:
        self.system, self.t = system, t

    def step(self, x: Array, u: Array, k: int) -> Array:
        from scipy.integrate import solve_ivp  # slow to import

        begin, end = float(self.t[k]), float(self.t[k + 1])
        found = solve_ivp(lambda t, y: self.system.f(y, u, t), (begin, end), x, method="DOP853", rtol=1e-9, atol=1e-11)
        if not found.success:
            raise StepError(
                f"the plant could not be integrated from {begin:.6g} s on: {found.message}",
                t=begin, residuals={}, iteration=int(found.nfev), state=x,
            )  # fmt: skip
        after = np.asarray(found.y[:, -1])
        return np.asarray(self.system.moved_start(after, np.zeros_like(after)))

    def converts_for(self, model: object) -> Callable[[Array], Array]:
        """Return the momenta of the plant's velocities, where the model has those."""
        if not (isinstance(self.system, MechanismSystem) and isinstance(model, DiscreteSystem)):
            return lambda x: x
        m = self.system.mechanism
        if getattr(model, "mechanism", None) is None:
            return lambda x: x
        return lambda x: np.concatenate([x[: m.nq], to_momentum(m, x[: m.nq], x[m.nq :]), x[m.nq + m.nd :]])


def plant_of(plant: object, t: Array, substeps: int) -> Plant:
    """Return what was given to be steered as a plant that is asked at times t (N+1,)."""
    fine = t
    if substeps > 1:
        shares = np.arange(substeps) / substeps
        fine = np.append((t[:-1, None] + shares * np.diff(t)[:, None]).ravel(), t[-1])
    if isinstance(plant, MidpointVI):
        return _StepwisePlant(MidpointSystem(plant, fine), substeps)
    if type(plant) is MidpointSystem:
        return _StepwisePlant(MidpointSystem(plant.integrator, fine, multipliers=plant.multipliers), substeps)
    if isinstance(plant, DiscreteSystem):
        if substeps > 1:
            raise ArgumentError(
                f"substeps: got {substeps} for a {type(plant).__name__}, expected 1: its steps are given"
            )
        return _StepwisePlant(plant, 1)
    if isinstance(plant, ContinuousSystem):
        return _IntegratedPlant(plant, t)
    raise ArgumentError(
        f"plant: got {type(plant).__name__}, expected a MidpointVI, a MidpointSystem or another DiscreteSystem, or a "
        "MechanismSystem in continuous time"
    )
