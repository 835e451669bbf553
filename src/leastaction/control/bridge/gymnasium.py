"""Gymnasium: an environment of any mechanism, alone or many at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.many import simulate_many
from leastaction.control.readings import Measured, Readings
from leastaction.errors import ArgumentError, StepError, unknown
from leastaction.numerics.arrays import Array, as_array, as_count, require_instance
from leastaction.numerics.extras import extra
from leastaction.systems.midpoint import MidpointSystem


def environment(
    system: MidpointSystem,
    *,
    reward: Callable[[Array, Array], float],
    start: Callable[[np.random.Generator], ArrayLike],
    actions: Mapping[str, tuple[float, float]],
    observe: Measured | None = None,
    ended: Callable[[Array], bool] = lambda x: False,  # noqa: ARG005
    render: Callable[[Array], Array] | None = None,
) -> Any:
    """Return an environment of Gymnasium, whose episodes last as long as the system's horizon.

    Parameters
    ----------
    system : MidpointSystem
    reward : callable
        ``reward(x, u) -> float`` of the state that a step leads to and the input over it.
    start : callable
        ``start(rng) -> (nx,)``: draws an initial state from a ``numpy.random.Generator``.
    actions : mapping of str to (float, float)
        Least and largest of the inputs that are chosen, by name; others are zero.
    observe : optional
        What is seen of a state, as `measure` of `KalmanFilter`; all of it if left out.
    ended : callable, optional
        ``ended(x) -> bool``: whether an episode ends at a state.
    render : callable, optional
        ``render(x) -> (height, width, 3)`` of bytes: a picture of a state.

    Returns
    -------
    gymnasium.Env
        A step without solution ends an episode (``info["failure"]`` says why).

    Raises
    ------
    ArgumentError
        What is no `MidpointSystem`, unknown inputs, or bounds in the wrong order.
    MissingExtraError
        Gymnasium is not installed.
    """
    gym, parts = extra("gymnasium", of="gymnasium", why="bridge.gymnasium"), _Parts(system, actions, observe)

    class MechanismEnv(gym.Env):  # type: ignore[misc, name-defined]
        metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's

        def __init__(self) -> None:
            self.action_space = gym.spaces.Box(parts.low, parts.high, dtype=np.float64)
            self.observation_space = gym.spaces.Box(-np.inf, np.inf, (parts.readings.ny,), dtype=np.float64)
            self.render_mode = None if render is None else "rgb_array"
            self.x, self.k = np.zeros(system.nx), 0

        def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
            super().reset(seed=seed, options=options)
            self.x, self.k = parts.started(start(self.np_random)), 0
            return parts.readings(self.x), {}

        def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
            u = parts.inputs(np.asarray(action, dtype=np.float64)[None])[0]
            try:
                self.x = np.array(system.f(self.x, u, min(self.k, system.N - 1)))
            except StepError as error:
                return parts.readings(self.x), 0.0, True, False, {"failure": str(error)}
            self.k += 1
            return (
                parts.readings(self.x), float(reward(self.x, u)), bool(ended(self.x)), self.k >= system.N, {},
            )  # fmt: skip

        def render(self) -> Any:
            return None if render is None else render(self.x)

    return MechanismEnv()


def vector_environment(
    system: MidpointSystem,
    count: int,
    *,
    reward: Callable[[Array, Array], Array],
    start: Callable[[np.random.Generator], ArrayLike],
    actions: Mapping[str, tuple[float, float]],
    observe: Measured | None = None,
    ended: Callable[[Array], Array] = lambda x: np.zeros(len(x), dtype=np.bool_),
) -> Any:
    """Return so many environments at once, whose steps are made side by side by `simulate_many`.

    Parameters
    ----------
    system, start, actions, observe
        As of `environment`.
    count : int
    reward, ended : callable
        As of `environment`, of states (B, nx) and inputs (B, nu), with an array (B,) for all.

    Returns
    -------
    gymnasium.vector.VectorEnv
        An episode that is over begins anew with the next step, whose action is not used.

    Raises
    ------
    ArgumentError, MissingExtraError
        As of `environment`.
    """
    gym, parts = extra("gymnasium", of="gymnasium", why="bridge.gymnasium"), _Parts(system, actions, observe)
    extra("gymnasium.vector", of="gymnasium", why="bridge.gymnasium")
    B, times = as_count(count, "count", 1), system.t[:2]

    class MechanismVectorEnv(gym.vector.VectorEnv):  # type: ignore[misc, name-defined]
        metadata = {"autoreset_mode": gym.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012 - Gymnasium's

        def __init__(self) -> None:
            self.num_envs = B
            self.single_action_space = gym.spaces.Box(parts.low, parts.high, dtype=np.float64)
            self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (parts.readings.ny,), dtype=np.float64)
            self.action_space = gym.vector.utils.batch_space(self.single_action_space, B)
            self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, B)
            self.x, self.k, self.over = np.zeros((B, system.nx)), np.zeros(B, dtype=int), np.zeros(B, dtype=bool)

        def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Array, dict[str, Any]]:
            super().reset(seed=seed, options=options)
            self._begin(np.arange(B))
            return self._seen(), {}

        def step(self, action: Any) -> tuple[Array, Array, Any, Any, dict[str, Any]]:
            u, going, began = parts.inputs(np.asarray(action, dtype=np.float64)), ~self.over, self.over.copy()
            rewards, terminated = np.zeros(B), np.zeros(B, dtype=bool)
            at = np.flatnonzero(going)
            if len(at):
                runs = simulate_many(system.integrator, self.x[at], times, u[at][:, None, :])
                good = runs.steps == 1
                self.x[at[good]] = runs.x[good, 1]
                self.k[at] += 1
                rewards[at[good]] = reward(self.x[at[good]], u[at[good]])
                terminated[at[good]] = ended(self.x[at[good]])
                terminated[at[~good]] = True
            self._begin(np.flatnonzero(began))
            truncated = (self.k >= system.N) & ~terminated
            self.over = terminated | truncated
            return self._seen(), rewards, terminated, truncated, {}

        def _begin(self, which: Any) -> None:
            for i in which:
                self.x[i] = parts.started(start(self.np_random))
            self.k[which], self.over[which] = 0, False

        def _seen(self) -> Array:
            return np.array([parts.readings(x) for x in self.x])

    return MechanismVectorEnv()


class _Parts:
    """What both kinds of environments share: inputs by actions, and what is seen."""

    def __init__(self, system: MidpointSystem, actions: Mapping[str, tuple[float, float]], observe: Any) -> None:
        require_instance(system, "system", MidpointSystem, "MidpointSystem(MidpointVI(mechanism), t) makes one")
        self.system = system
        self.readings = Readings(system, np.eye(system.nx) if observe is None else observe)
        names, self.places = system.input_names, list[int]()
        for name, (low, high) in actions.items():
            if name not in names:
                raise unknown("input", name, names, "actions")
            if not low < high:
                raise ArgumentError(f"actions[{name!r}]: got {low} and {high}, expected the least before the largest")
            self.places.append(names.index(name))
        self.low, self.high = (np.array([bounds[i] for bounds in actions.values()], dtype=np.float64) for i in (0, 1))

    def inputs(self, actions: Array) -> Array:
        """Return the inputs (B, nu) of actions (B, n), within their bounds."""
        u = np.zeros((len(actions), self.system.nu))
        u[:, self.places] = np.clip(actions, self.low, self.high)
        return u

    def started(self, x: ArrayLike) -> Array:
        """Return an initial state, checked."""
        return as_array(x, "start(rng)", (self.system.nx,), names=self.system.state_names).copy()
