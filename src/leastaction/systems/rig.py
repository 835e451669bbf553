"""A plan on a rig: a machine that is not quite its model, with strings that go slack and sensors that are late.

What is played are the planned inputs and prescribed variables, and what a regulator along the plan adds to them.
Readings of the dynamic variables arrive late and noisy; a Kalman filter along the plan makes deviations of the whole
state of them, which the linearised model carries over the delay with the inputs that were given meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, closest, unknown
from leastaction.mechanics.discrete.trajectory import State
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, as_count, as_number, require_instance
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.names import matching
from leastaction.optimal.discrete.linear_quadratic import regulate
from leastaction.optimal.initial import both
from leastaction.optimal.result import OptimizationResult
from leastaction.systems.midpoint import MidpointSystem

_HELD, _PLACES, _SPEEDS = 20.0, 0.1, 10.0  # weights of the regulator: joints, prescribed variables and their speeds
# m/s^2 or rad/s^2, with which the estimate reckons beside what the model says, and where strings may go slack: then a
# limb falls, or is pulled, by newtons that the model along the plan does not have.
_SURPRISE, _SLACK = 0.15, 5.0
_UNSURE = 0.1  # m, rad, m/s or rad/s: how far off the start may be
_LEAST_NOISE = 1e-6  # m or rad
_VARIED = 0.1  # part of a length by which it is varied
_CORRECTIONS, _FIRM = 3, 1e-2  # of prescribed variables; what moves strings less than this part of the most is left


@dataclass(frozen=True, kw_only=True)
class Rig(Frozen):
    """What a machine has that its model has not. Frozen; threads may share it.

    Attributes
    ----------
    spread : float
        Masses, with the inertias of the same body, are off by up to this share of them, drawn by chance.
    factors : mapping of str to float
        Factors of parameters by their names or patterns of them (``"damping.*"``), on top of that.
    stiffness : float or None
        Of strings (N/m): in the place of each constraint that is a string comes an elastic one, which pulls and does
        not push; 2000 N/m is a millimetre of nylon a metre long. None: strings are what they are in the model.
    smoothing : float
        The length over which such a string becomes taut (m).
    noise : float
        Standard deviation of every reading of a dynamic variable (rad or m).
    delay : float
        How late readings are (s), rounded up to whole steps of the plan.
    substeps : int
        Steps in which the machine is simulated to each step of the plan.
    seed : int
        Of what is drawn by chance.

    Raises
    ------
    ArgumentError
        A number out of range.
    """

    spread: float = 0.05
    factors: Mapping[str, float] = field(default_factory=dict)
    stiffness: float | None = 2e3
    smoothing: float = 1e-3
    noise: float = 1e-3
    delay: float = 0.02
    substeps: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "factors", MappingProxyType(dict(self.factors)))
        for name, below in (("spread", 1.0), ("noise", np.inf), ("delay", np.inf)):
            as_number(getattr(self, name), f"Rig: {name}", least=0.0, below=below)
        for name in ("smoothing", *(() if self.stiffness is None else ("stiffness",))):
            as_number(getattr(self, name), f"Rig: {name}", above=0.0)
        as_count(self.substeps, "Rig: substeps", 1)
        as_count(self.seed, "Rig: seed", 0)
        for name, factor in self.factors.items():
            as_number(factor, f"Rig: the factor of {name!r}", above=0.0)
        super().__post_init__()

    def model(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism with elastic strings in the place of those that are constraints."""
        if self.stiffness is None:
            return mechanism
        found = {
            name: each.as_string(self.stiffness, self.smoothing)
            for name, each in mechanism.elements.items()
            if isinstance(each, Constraint)
        }
        return mechanism.with_exchanged({name: [each] for name, each in found.items() if each is not None})

    def machine(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism as it is built: the model with the parameters that it really has.

        Raises
        ------
        ArgumentError
            A factor of something that is no parameter.
        """
        model = self.model(mechanism)
        numbers, chance = model.parameters, np.random.default_rng(self.seed)
        values = dict(numbers)
        for mass in [name for name in numbers if name.endswith(".mass")]:
            factor = 1.0 + self.spread * chance.uniform(-1.0, 1.0)
            for name in numbers:
                if name == mass or name.startswith(f"{mass.removesuffix('mass')}inertia."):
                    values[name] *= factor
        names = list(numbers)
        for pattern, factor in self.factors.items():
            chosen = matching(names, pattern)
            if not chosen:
                raise unknown("parameter", pattern, names, "Rig")
            for i in chosen:
                values[names[i]] *= factor
        return model.with_parameters({name: value for name, value in values.items() if value != numbers[name]})


@dataclass(frozen=True, kw_only=True)
class Played(Frozen):
    """What a rig did. Frozen; threads may share it.

    Attributes
    ----------
    mechanism : Mechanism
        The rig's.
    t : ndarray, shape (N+1,)
        Times of the plan (s); those of the part that was played where it failed.
    x : ndarray, shape (N+1, nx)
        States ``[q; rho; p; v_rho]``.
    u : ndarray, shape (N, nu)
        What was commanded: the inputs, and the prescribed variables at the ends of the steps.
    failure : str or None
        Why it ended early; None if it did not.
    """

    mechanism: Mechanism = field(repr=False)
    t: Array = field(repr=False)
    x: Array = field(repr=False)
    u: Array = field(repr=False)
    failure: str | None = None

    @property
    def q(self) -> Array:
        """Configurations (N+1, nq)."""
        return self.x[:, : self.mechanism.nq]

    def off(self, wanted: ArrayLike, names: str | Sequence[str] = "*") -> float:
        """Return the root mean square distance of dynamic variables from configurations (N+1, nq) or (N+1, nd).

        ``names``: of the variables, or patterns of them. Infinite if the rig failed.
        """
        m = self.mechanism
        patterns = (names,) if isinstance(names, str) else tuple(names)
        chosen = sorted({i for each in patterns for i in matching(m.dynamic, each)})
        if not chosen:
            raise ArgumentError(
                f"names: nothing is called {names!r}; {closest(patterns[0], m.dynamic, what='variables')}"
            )
        if self.failure is not None:
            return float("inf")
        goal = as_array(wanted, "wanted", (len(self.t), m.nq), (len(self.t), m.nd), meaning="(N+1, nq) or (N+1, nd)")
        return float(np.sqrt(np.mean((self.x[:, chosen] - goal[:, chosen]) ** 2)))


def play(
    system: MidpointSystem,
    plan: OptimizationResult | tuple[ArrayLike, ArrayLike],
    rig: Rig | None = None,
    *,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    start: State | None = None,
    feedback: bool = True,
) -> Played:
    """Play a plan on a rig, under a feedback along it: a check of what the plan is worth outside of its model.

    Where strings are elastic, what is commanded as their lengths is less by what the planned tension stretches them.
    Strings whose lengths are numbers are shorter by that in the mean, and the prescribed variables that move their ends
    go along with the rest, as nearly as they can: a bar that carries strings is lifted where they are stretched.

    Parameters
    ----------
    system : MidpointSystem
        The plan's.
    plan : OptimizationResult or (x, u)
        A trajectory of it: x (N+1, nx), u (N, nu).
    rig : Rig, optional
        One with all its defaults if left out.
    Q, R : array_like, optional
        Weights of the regulator, of the state without multipliers and of the inputs, as of `regulate`. If left out,
        20 for dynamic variables, of prescribed ones 10 for speeds, 0.1 for places and 1 for those to come; one over its
        mean square in the plan for each input.
    start : State, optional
        Where the rig begins; where the plan does if left out.
    feedback : bool, optional
        Whether anything is fed back, or the plan played blindly.

    Returns
    -------
    Played

    Raises
    ------
    ArgumentError
        What is no `MidpointSystem`, wrong shapes, unknown parameters, or a plan along which the model cannot go.
    """
    require_instance(system, "system", MidpointSystem)
    if start is not None:
        require_instance(start, "start", State, "MidpointVI(mechanism).start(q) makes one of a configuration")
    rig = Rig() if rig is None else rig
    m, N, t = system.integrator.mechanism, system.N, system.t
    x, u = (plan.x, plan.u) if isinstance(plan, OptimizationResult) else both(plan)
    x = as_array(x, "plan x", (N + 1, system.nx), meaning="(N+1, nx)")
    u = as_array(u, "plan u", (N, system.nu), meaning="(N, nu)")
    x, u, shorter = _reeled_in(system, x, u, rig)
    machine = system.integrator.like(_with_lengths(rig.machine(m), shorter))
    late = int(np.ceil(rig.delay / np.diff(t).max() - 1e-9))
    noise = rig.noise * np.random.default_rng([rig.seed, 1]).standard_normal((N + 1, m.nd))
    controller = None
    if feedback:
        model = _with_lengths(rig.model(m), shorter)
        surprise = _SURPRISE if model.nc == m.nc else _SLACK
        controller = _Controller(MidpointSystem(system.integrator.like(model), t), x, u, Q, R, rig.noise, surprise)
    now = x[0] if start is None else np.concatenate([start.q, start.p, start.v_rho])
    states, commands, failure = [now], [], None
    parts = np.arange(1, rig.substeps + 1)[:, None] / rig.substeps
    for k in range(N):
        command, at = u[k], k - late
        if controller is not None and at >= 0:
            command = command + controller.correction(k, at, states[at][: m.nd] + noise[at])
        before = now[m.nd : m.nq]
        rows = np.tile(command, (rig.substeps, 1))
        rows[:, m.n_inputs :] = before + parts * (command[m.n_inputs :] - before)
        times = t[k] + np.append(0.0, parts) * (t[k + 1] - t[k])
        out = machine.core.roll_out(times, now, None, rows, None)
        if out.steps < rig.substeps or not np.isfinite(out.x[-1]).all():
            failure = f"the rig could not be simulated from {t[k]:.4g} s on"
            break
        now = np.ascontiguousarray(out.x[-1])
        states.append(now)
        commands.append(command)
    played = np.array(commands).reshape(-1, system.nu)
    return Played(mechanism=machine.mechanism, t=t[: len(states)], x=np.array(states), u=played, failure=failure)


def _reeled_in(system: MidpointSystem, x: Array, u: Array, rig: Rig) -> tuple[Array, Array, Mapping[str, float]]:
    """Return the states without multipliers and the inputs with strings shorter by what their tensions stretch them.

    The third are the parameters of strings whose lengths are numbers, and by how much these are shorter: by what the
    strings are stretched in the mean. What is left of that is made up for by the prescribed variables, as nearly as
    they can.
    """
    m, t = system.integrator.mechanism, system.t
    planned, u = np.array(x[:, : m.nx]), np.array(u)
    if rig.stiffness is None or not m.nc:
        return planned, u, {}
    stretched: dict[str, Array] = {}
    for name, pull in system.trajectory(x, u).tensions().items():
        pull[0] *= 2.0  # the first impulse is that of half a step
        by = np.maximum(np.append(pull, pull[-1]), 0.0) / rig.stiffness
        variable = m.elements[name].length_variable
        if variable is None:
            stretched[name] = by
        else:
            planned[:, m.variables.index(variable)] -= by
    shorter = {f"{name}.length": float(by.mean()) for name, by in stretched.items()}
    if stretched and m.nrho:
        _follow_stretch(m, planned, {name: by - by.mean() for name, by in stretched.items()})
    u[:, m.n_inputs :] = planned[1:, m.nd : m.nq]
    planned[1:, m.nq + m.nd :] = np.diff(planned[:, m.nd : m.nq], axis=0) / np.diff(t)[:, None]
    return planned, u, shorter


def _follow_stretch(m: Mechanism, planned: Array, longer: Mapping[str, Array]) -> None:
    """Move the prescribed variables of states (N+1, nx) so that strings of given lengths are longer by (N+1,)."""
    rows = [m.constraints.index(name) for name in longer]
    lengths = [f"{name}.length" for name in longer]
    q = np.ascontiguousarray(planned[:, : m.nq])
    # Of a longer string a constraint has less, by a square or a line of its length, wherever its ends are.
    wanted = np.empty((len(q), len(rows)))
    for i, (row, name, by) in enumerate(zip(rows, lengths, longer.values(), strict=True)):
        length = m.parameters[name]
        less, same, more = (
            m.with_parameters({name: factor * length}).constraint_values(q[0])[row]
            for factor in (1.0 - _VARIED, 1.0, 1.0 + _VARIED)
        )
        share = by / (_VARIED * length)
        wanted[:, i] = -0.5 * share * ((more - less) + share * (more - 2.0 * same + less))
    reeled = {m.elements[name].length_variable for name in m.constraints if name in m.elements}
    moved = [m.variables.index(name) for name in m.kinematic if name not in reeled]
    for at, goal, row in zip(q, wanted, planned, strict=True):
        before = m.constraint_values(at)[rows]
        for _ in range(_CORRECTIONS):
            missing = goal - (m.constraint_values(at)[rows] - before)
            by_moved = m.constraint_jacobian(at)[np.ix_(rows, moved)]
            at[moved] += np.linalg.lstsq(by_moved, missing, rcond=_FIRM)[0]
        row[moved] = at[moved]


def _with_lengths(mechanism: Mechanism, shorter: Mapping[str, float]) -> Mechanism:
    """Return a mechanism whose strings are shorter by so much, by the parameters of their lengths."""
    numbers = mechanism.parameters
    return (
        mechanism.with_parameters({name: numbers[name] - by for name, by in shorter.items()}) if shorter else mechanism
    )


class _Controller:
    """A regulator along a plan, on what a Kalman filter makes of late readings. It goes once through the plan."""

    def __init__(
        self,
        model: MidpointSystem,
        x: Array,
        u: Array,
        Q: ArrayLike | None,
        R: ArrayLike | None,
        noise: float,
        surprise: float,
    ) -> None:
        m = model.integrator.mechanism
        made = model.step_each(x, u)
        if not made.complete:
            raise ArgumentError(f"plan: the model cannot go along it: {made.failure}")
        self.A, self.B = model.linearize_each(x, u, made.x)
        if Q is None:
            Q = np.repeat([_HELD, _PLACES, 0.0, _SPEEDS], [m.nd, m.nrho, m.nd, m.nrho])
        if R is None:
            squares = np.mean(u[:, : m.n_inputs] ** 2, axis=0)
            R = np.concatenate([1.0 / np.where(squares > 0.0, squares, 1.0), np.ones(m.nrho)])
        self.K = regulate(self.A, self.B, Q=Q, R=R)
        self.L = _estimator(model, self.A, x, noise, surprise)
        self.planned = x[:, : m.nd]
        self.known = np.zeros(m.nx)  # the deviation at the instant of the last reading
        self.added = np.zeros_like(u)

    def correction(self, k: int, at: int, reading: Array) -> Array:
        """Return what is added to the input of step k, when the reading of an instant before has come."""
        if at > 0:
            self.known = self._next(self.known, at - 1)
        surprise = reading - self.planned[at] - self.known[: len(reading)]
        self.known = self.known + self.L[at] @ surprise
        ahead = self.known
        for j in range(at, k):
            ahead = self._next(ahead, j)
        self.added[k] = -self.K[k] @ ahead
        return np.asarray(self.added[k])

    def _next(self, deviation: Array, k: int) -> Array:
        return np.asarray(self.A[k] @ deviation + self.B[k] @ self.added[k])


def _estimator(model: MidpointSystem, A: Array, x: Array, noise: float, surprise: float) -> Array:
    """Return the gains (N+1, nx, nd) of the Kalman filter that reads the dynamic variables, along a plan x (N+1, nx).

    The momenta that chance adds have covariances in proportion to the mass matrix, as if each direction got the same
    energy: whatever the variables. Accelerations of the same size for each variable would be huge forces where angles
    are singular and hardly any where they are not, and the filter would take noise for motion.
    """
    m, dt = model.integrator.mechanism, np.diff(model.t)
    # What is off at the start keeps to the constraints.
    directions = _UNSURE * model.start_directions(x[0], [*m.dynamic, *(f"p_{name}" for name in m.dynamic)])
    P = directions @ directions.T
    mass = np.array([m.mass_matrix(np.ascontiguousarray(each[: m.nq]))[: m.nd, : m.nd] for each in x[:-1]])
    share = np.mean(np.diagonal(mass, axis1=1, axis2=2), axis=1) * (surprise * dt) ** 2
    momenta = slice(m.nq, m.nq + m.nd)
    V = max(noise, _LEAST_NOISE) ** 2 * np.eye(m.nd)
    L = np.empty((model.N + 1, m.nx, m.nd))
    for k in range(model.N + 1):
        L[k] = np.linalg.solve(P[: m.nd, : m.nd] + V, P[: m.nd]).T
        if k < model.N:
            P = A[k] @ (P - L[k] @ P[: m.nd]) @ A[k].T
            P = 0.5 * (P + P.T)
            P[momenta, momenta] += share[k] * mass[k]
    return L
