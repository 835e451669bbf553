"""Predictive control: the optimum over a horizon from where the system is, one instant after the other.

Each call makes real-time iterations (M. Diehl, H. G. Bock, J. P. Schlöder, SIAM J. Control Optim. 43, 2005): the plan
of the last one, moved on by the time that has passed, is rolled out from the state now under its own gains, which
leaves a motion of the system; along that one quadratic problem with all limits finds the next plan. The first call is
an optimisation to the end, by an `Optimizer`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.interior import InteriorProgram, WindowModel
from leastaction.control.readings import Stated
from leastaction.errors import ArgumentError, LeastActionError
from leastaction.mechanics.discrete.trajectory import State
from leastaction.numerics.arrays import Array, as_array, as_count, as_number, read_only, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, QuadraticCost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.limits.charts import charted
from leastaction.optimal.limits.cost import LimitedCost
from leastaction.optimal.limits.limit import FromSecond, Limit, checked_limits
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.optimizer import Optimizer
from leastaction.optimal.quantity import Entries
from leastaction.optimal.remembered.extension import needed_by, own_limits
from leastaction.optimal.remembered.system import RememberingSystem
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.system import Linearization
from leastaction.systems.closed_loop import PredictiveInfo

_AT_ONCE = 1e-6  # delay that counts as none, of a step
_ACTIVE = 1e-3  # room, in its scale, of a limit that is active
_PRICE = 1e3  # price of an excess by a limit's scale, in costs of the first plan
_MOST = 15  # iterations of a quadratic problem, at most
_LEAST = 1e-3  # cost of the first plan that prices are measured by, at least


@public
class MPC:
    """A predictive controller: ``u = mpc(x, t)``. It remembers its plan: not for several threads.

    Parameters
    ----------
    system : DiscreteSystem
        Such as a `MidpointSystem`, whose first step is the controller's period. Of more than `horizon` steps, the
        window of it that begins at the time of the call, until its end is reached: of what changes with time.
    cost : Cost or callable
        Of `horizon` steps; of more, such as those of a whole plan, the window of it that begins at the time of the
        call, whose end is held; or a function of the time (s) that returns a cost of `horizon` steps.
    limits : sequence of Limit
        What every plan keeps to, over its horizon. An input is never beyond its bounds. Beyond others an excess has a
        price, which rises where it is not enough: where the state is there already, the plan leads back. Rates of
        inputs, here and in a `RateCost`, begin with what was given an instant ago; before the first call with what the
        cost wants.
    horizon : int, optional
        Steps to plan ahead; all of the system's if left out.
    iterations : int, optional
        Most real-time iterations of a call.
    budget : float, optional
        Time (s) after which no further iteration begins, and no quadratic problem: where the first is late already,
        the last plan is followed.
    tolerance : float, optional
        Of the quadratic problems, relative to the cost.

    Attributes
    ----------
    info : PredictiveInfo
        What the last call did.
    x, u, K : ndarray (horizon+1, nx), (horizon, nu), (horizon, nu, ndx)
        Its plan, and the gains along it; the next call writes over them.

    Raises
    ------
    ArgumentError
        Wrong sizes, or limits that the system does not know.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import Bound, JointForce, Mechanism, MidpointSystem, MidpointVI, QuadraticCost, tx
    >>> from leastaction.control import MPC
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 21))
    >>> cost = QuadraticCost(np.zeros((21, 2)), np.zeros((20, 1)), Q=[10.0, 1.0], R=[0.1])
    >>> mpc = MPC(system, cost, [Bound("push", -2.0, 2.0)])
    >>> x = np.array([1.0, 0.0])
    >>> for k in range(100):
    ...     x = system.f(x, mpc(x, 0.05 * k), 0)
    >>> bool(abs(x).max() < 1e-2), mpc.info.planned
    (True, True)
    """

    def __init__(
        self,
        system: DiscreteSystem,
        cost: Cost | Callable[[float], Cost],
        limits: Sequence[Limit] = (),
        *,
        horizon: int | None = None,
        iterations: int = 1,
        budget: float | None = None,
        tolerance: float = 1e-4,
    ) -> None:
        require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
        N = system.N if horizon is None else as_count(horizon, "horizon", 1)
        if N > system.N:
            raise ArgumentError(f"horizon: got {N}, expected at most the {system.N} steps of the system")
        self.horizon, self.whole = N, system
        self.system = system if system.N == N else system.window(0, N)
        if not callable(cost):
            require_instance(cost, "cost", Cost, "such as a QuadraticCost, or a function of the time that returns one")
        self.cost = cost.over(system.N) if isinstance(cost, Cost) else cost
        self.limits = checked_limits(limits)
        self.iterations = as_count(iterations, "iterations", 1)
        self.budget = None if budget is None else as_number(budget, "budget (s)", above=0.0)
        self.tolerance = as_number(tolerance, "tolerance", above=0.0)
        self._times = system.times
        self.t0, self.dt = float(self._times[0]), float(self._times[1] - self._times[0])
        first = self._stated(self.t0)
        first.check_shapes(N, system.nx, system.nu)
        # What was given an instant ago, where something asks for it: then it is a part of the model's state.
        self._given = np.array(np.broadcast_to(getattr(first, "u_wanted", 0.0), (N, system.nu))[0])
        self._needs = needs = needed_by(self.limits, first, self.system, 1)
        self._from = 0  # the step of the whole system with which the model begins
        self.model = self._modelled(self.system)
        self._limits = own_limits(self.limits) if needs else self.limits
        self._state_limits()
        self._move = any(callable(getattr(limit, side, None)) for limit in self.limits for side in ("min", "max"))
        self._program: InteriorProgram | None = None
        self._limited: LimitedCost | None = None
        self._memory: Linearization | None = None
        self._begun = 0.0  # when the plan begins, in steps
        self._x, self.u = np.zeros((N + 1, self.model.nx)), np.zeros((N, system.nu))
        self._K = np.zeros((N, system.nu, self.model.ndx))
        self.info = PredictiveInfo(self.t0, 0.0, 0, 0, 0.0, (), np.nan, planned=False, message="not called yet")

    # ---- The call ---------------------------------------------------------------------------------

    def __call__(self, x: Stated, t: Stated) -> Array:
        """Return the input (nu,) for the state x (nx,), by numbers, by name or a `State`, at a time t (s).

        As a law of a simulation it is called ``(t, x)``, which it tells apart.

        Raises
        ------
        ArgumentError
            A wrong shape, or numbers that are not finite.
        """
        begun = perf_counter()
        if not isinstance(x, (State, Mapping)) and np.ndim(x) == 0:
            x, t = t, x
        at, state = as_number(t, "t"), self._state(x)
        if self._program is None:
            return self._first(x, at, begun)
        self._move_on(max(0, int(np.floor(self._place(at) - self._begun + _AT_ONCE))))
        self._turn_to(at)
        cost = self._cost_at(at)
        message, done, interior, violation, value = "", 0, 0, self.info.violation, np.nan
        while done < self.iterations:
            if self.budget is not None and perf_counter() - begun > self.budget:
                message = f"no time was left after {perf_counter() - begun:.3g} s"
                break
            found = self._improve(state, cost)
            if isinstance(found, str):
                message = found
                break
            violation, value, more = found
            done, interior = done + 1, interior + more
        u = self.u[0] if done else self.u[0] - self._K[0] @ self.model.difference(state, self._x[0])
        u = self._give(u)
        self.info = PredictiveInfo(
            at, perf_counter() - begun, done, interior, violation, self._active() if done else (), value,
            planned=done > 0, message="" if done else message,
        )  # fmt: skip
        return u

    def prepare(self, x: Stated, t: float | None = None, *, u: ArrayLike | None = None) -> OptimizationResult:
        """Plan from a state to the end, by an `Optimizer`: what the first call does, and takes longest.

        Parameters
        ----------
        x : array_like (nx,), State or mapping of str to float
        t : float, optional
            When (s); at the first time of the system if left out.
        u : array_like (horizon, nu), optional
            Inputs to begin with; those of the cost's wanted inputs, within their bounds, or zero if left out.

        Raises
        ------
        ArgumentError
            Wrong shapes, or no motion from there.
        """
        at, N = self.t0 if t is None else as_number(t, "t"), self.horizon
        self._turn_to(at)
        state = self._state(x)
        cost, stated = self._cost_at(at), self._stated(at)
        guess: Any = getattr(stated, "u_wanted", np.zeros((N, self.system.nu))) if u is None else u
        guess = np.clip(as_array(guess, "u", (N, self.system.nu), meaning="(horizon, nu)"), *self._bounds)
        optimizer = Optimizer(
            self.model, cost, [FromSecond(limit) for limit in self._limits], tolerance=1e-6, max_iterations=200
        )
        result = optimizer.run((state, guess))
        self._take(result.x, result.u, result.K, at, cost, result.cost)
        return result

    def reset(self) -> None:
        """Forget the plan: the next call is a first one."""
        self._program = None

    def begin(self, x: ArrayLike, u: ArrayLike, K: ArrayLike, t: float | None = None) -> None:
        """Take a plan that is known, such as one of `optimize` with its gains: the next call goes on from it.

        Parameters
        ----------
        x, u, K : array_like (horizon+1, nx), (horizon, nu), (horizon, nu, ndx)
            It need not be a motion of the system: the next call rolls it out from where that is, under its gains.
        t : float, optional
            When it begins (s); at the first time of the system if left out.

        Raises
        ------
        ArgumentError
            Wrong shapes, or numbers that are not finite.
        """
        at, N, own = self.t0 if t is None else as_number(t, "t"), self.horizon, self.system
        states = as_array(x, "x", (N + 1, own.nx), meaning="(horizon+1, nx)")
        inputs = as_array(u, "u", (N, own.nu), meaning="(horizon, nu)")
        gains = as_array(K, "K", (N, own.nu, own.ndx), meaning="(horizon, nu, ndx)")
        self._turn_to(at)
        if isinstance(self.model, RememberingSystem):
            states = self.model.extended(states, inputs, before=self._given)
            gains = np.concatenate([gains, np.zeros((N, own.nu, self.model.ndx - own.ndx))], axis=2)
        cost = self._cost_at(at)
        self._take(states, inputs, gains, at, cost, cost.value(read_only(states), read_only(inputs)))

    # ---- The time --------------------------------------------------------------------------------

    def _place(self, at: float) -> float:
        """Return where a time is, in steps of the whole system, whose last one goes on after its end."""
        times, N = self._times, len(self._times) - 1
        if at >= times[-1]:
            return float(N + (at - times[-1]) / (times[-1] - times[-2]))
        if at <= times[0]:
            return float((at - times[0]) / self.dt)
        return float(np.interp(at, times, np.arange(N + 1.0)))

    def _step_at(self, at: float) -> int:
        """Return the step of the whole system that begins next to a time."""
        return max(0, int(np.floor(self._place(at) + 0.5)))

    def _turn_to(self, at: float) -> None:
        """Have the model be the window of the whole system that begins at a time."""
        k = min(self._step_at(at), self.whole.N - self.horizon)
        if k != self._from:
            self._from = k
            self.system = self.whole.window(k, k + self.horizon)
            self.model = self._modelled(self.system)
            if self._move:
                self._state_limits()
                self._limited = None if self._limited is None else self._barred(self._limited.cost)

    def _state_limits(self) -> None:
        """State the limits over the horizon that the model has now."""
        self._rows = [row for limit in self._limits for row in limit.rows(self.model, 1)]
        self._labels = [label for row in self._rows for label in row.labels]
        self._bounds = _bounds_of_inputs(self._rows, self.horizon, self.system.nu)
        self._charted = charted(self._rows, self.model.charts())

    def _barred(self, cost: Cost) -> LimitedCost:
        return LimitedCost(cost, self._charted, self.model.ndx, self.model.nu)

    def _modelled(self, system: DiscreteSystem) -> DiscreteSystem:
        """Return a system with what it has to remember."""
        return RememberingSystem(system, self._needs, before=self._given) if self._needs else system

    # ---- Parts ------------------------------------------------------------------------------------

    @property
    def x(self) -> Array:
        """The states (horizon+1, nx) of its plan."""
        return self._x[:, : self.system.nx]

    @property
    def K(self) -> Array:
        """The gains (horizon, nu, ndx) along its plan."""
        return self._K[:, :, : self.system.ndx]

    def _state(self, x: Stated) -> Array:
        """Return a state of the model, with what was given an instant ago where it remembers that."""
        own = self.whole.state_given(x)
        if not isinstance(self.model, RememberingSystem):
            return own
        return self.model.extended(own, self.u, before=self._given)

    def _give(self, u: Array) -> Array:
        """Return an input within its bounds, and remember it."""
        self._given = np.clip(u, *self._bounds)
        return self._given.copy()

    def _first(self, x: Stated, at: float, begun: float) -> Array:
        result = self.prepare(x, at)
        self.info = PredictiveInfo(
            at, perf_counter() - begun, result.iterations, 0, self._violation(self._x, self.u), self._active(),
            result.cost, planned=True, message="" if result.success else result.message,
        )  # fmt: skip
        return self._give(self.u[0])

    def _take(self, x: Array, u: Array, K: Array, at: float, cost: Cost, price: float) -> None:
        """Go on from a plan and what it costs."""
        self._x, self.u, self._K = np.array(x), np.array(u), np.array(K)
        self._begun = self._place(at)
        N, ndx, nu = self.horizon, self.model.ndx, self.model.nu
        self._limited = limited = self._barred(cost)
        scales = limited.layout.columns.filled([rows.scale for rows in self._rows]).flat
        seen = limited.layout.largest(np.abs(limited.asked(self._x, self.u).flat))
        scales = limited.layout.spread(np.where(scales > 0.0, scales, np.maximum(seen, 1e-3)))
        magnitude = max(abs(price), _LEAST)
        self._program = InteriorProgram(limited, (N, ndx, nu), _PRICE * magnitude, scales, magnitude)

    def _cost_at(self, at: float) -> Cost:
        """Return the cost of the model's states over a horizon that begins at a time."""
        stated, model = self._stated(at), self.model
        return model.cost_of(stated) if isinstance(model, RememberingSystem) else stated

    def _stated(self, at: float) -> Cost:
        """Return the cost of a horizon that begins at a time."""
        cost = self.cost
        if not isinstance(cost, Cost):
            found = cost(at)
            require_instance(found, "cost(t)", Cost, "such as a QuadraticCost")
            return found.over(self.horizon)
        whole, N = self.whole, self.horizon
        if whole.N == N:
            return cost
        k = self._step_at(at)
        if type(cost) is QuadraticCost:
            return _held(cost, k, N)
        k = min(k, whole.N - N)
        return cost.window(k, k + N, N=whole.N, nu=whole.nu)

    def _move_on(self, steps: int) -> None:
        """Have the plan begin so many steps later; its last input, state and gain are held."""
        if not steps:
            return
        self._begun += steps
        by = min(steps, self.horizon)
        for plan in (self._x, self.u, self._K):
            last = plan[-1].copy()
            plan[:-by] = plan[by:].copy()
            plan[-by:] = last
        assert self._program is not None
        self._program.shift(steps)

    def _improve(self, state: Array, cost: Cost) -> tuple[float, float, int] | str:
        """Make one real-time iteration; return violation, cost and iterations, or why there is no new plan."""
        system, program, limited = self.model, self._program, self._limited
        assert program is not None
        assert limited is not None
        rollout = system.rollout(state, self._x, self.u, self._K, 0, self.horizon)
        if not rollout.complete:
            # Gains that ask for too much far from the plan: its inputs alone may lead through.
            rollout = system.rollout(state, self._x, self.u, np.zeros_like(self._K), 0, self.horizon)
        if not rollout.complete:
            return f"the last plan leads nowhere from here: {rollout.failure}"
        x, u = read_only(rollout.x), read_only(rollout.u)
        try:
            linear = system.linearize(x, u, self._memory)
            self._memory = linear
            gradient = cost.gradient(x, u)
            c = limited.asked(x, u)
            hessian = cost.model_hessian(x, u, convex=True)
            model = WindowModel(c, limited.jacobians(x, u), linear, gradient, hessian)
            found = program.solve(model, tolerance=self.tolerance, most=_MOST)
        except LeastActionError as error:
            return f"no plan from here: {error}"
        if found is None or not np.isfinite(found.du).all():
            return "the quadratic problem along the motion from here has no minimum"
        self._x[:], self._K[:] = system.plus(x, found.dx), found.K
        np.add(u, found.du, out=self.u)
        return found.excess, cost.value(x, u), found.iterations

    def _violation(self, x: Array, u: Array) -> float:
        if self._limited is None or self._program is None or not self._rows:
            return 0.0
        c = self._limited.asked(x, u).flat
        return max(0.0, -float((c / self._program.scales).min(initial=0.0)))

    def _active(self) -> tuple[str, ...]:
        """Return what limits are active somewhere along the plan."""
        if self._limited is None or self._program is None or not self._rows:
            return ()
        room = self._limited.asked(self._x, self.u).flat / self._program.scales
        near = self._limited.layout.largest(_ACTIVE - room) > 0.0
        return tuple(self._labels[i] for i in np.flatnonzero(near).tolist())


def _bounds_of_inputs(rows: Sequence[Rows], N: int, nu: int) -> tuple[Array, Array]:
    """Return least and largest inputs (nu,) of the first step, infinite where there are no bounds."""
    low, high = np.full(nu, -np.inf), np.full(nu, np.inf)
    for each in rows:
        quantity = each.quantity
        at = np.flatnonzero(each.k == 0)
        if not isinstance(quantity, Entries) or quantity.of_state or each.equal or not len(at) or N < 1:
            continue
        for place, factor, bound in zip(quantity.places, quantity.factors, each.bounds[at[0]], strict=True):
            if each.sign * factor > 0.0:
                low[place] = max(low[place], bound / factor)
            else:
                high[place] = min(high[place], bound / factor)
    return low, high


def _held(cost: QuadraticCost, k: int, N: int) -> QuadraticCost:
    """Return a quadratic cost over N steps from stage k on, whose last stage is held after its end."""
    last = len(cost.u_wanted)
    stages, instants = np.minimum(np.arange(k, k + N), last - 1), np.minimum(np.arange(k, k + N + 1), last)
    Q, R = (W if W.ndim < 3 else W[stages] for W in (cost.Q, cost.R))
    final = cost.Q_final if k + N >= last or cost.Q.ndim == 3 else None
    return QuadraticCost(cost.x_wanted[instants], cost.u_wanted[stages], Q=Q, R=R, Q_final=final, space=cost.space)
