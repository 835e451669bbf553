"""A plan on a rig: a machine that is not quite its model, with strings that go slack and sensors that are late.

What is played are the planned inputs and prescribed variables, and what a regulator adds to them. Readings of the
dynamic variables arrive late and noisy; a Kalman filter makes the whole state of them, which the model carries over the
delay with the inputs that were given meanwhile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.kalman import KalmanFilter
from leastaction.control.rigs.commands import reeled_in, with_lengths
from leastaction.control.rigs.elastic import nearest
from leastaction.control.rigs.regulator import Regulator
from leastaction.errors import StepError
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.prescribed import divided
from leastaction.mechanics.discrete.trajectory import State
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_array, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.initial import pair_of
from leastaction.optimal.result import OptimizationResult
from leastaction.systems.midpoint import MidpointSystem
from leastaction.systems.rig import Played, Rig

_HELD, _PLACES, _SPEEDS = 100.0, 0.1, 1.0  # weights of the regulator: joints, prescribed variables and their speeds
_SURPRISE = 0.5  # m/s^2 or rad/s^2, with which the estimate reckons beside what the model says
_UNSURE = 0.1  # m, rad, m/s or rad/s: how far off the start may be
_LEAST_NOISE = 1e-6  # m or rad
_AT_ONCE = 1e-9  # of a step: what is late by a whole number of steps is not late by one more for rounding


@public
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

    What is fed back is planned anew at every instant, for 0.4 s from where the machine is, with strings that stay taut,
    or as nearly as they can be: they do not push. It goes by a Kalman filter that follows the machine itself (extended:
    linearised about its own estimate), with the strings that are slack, and by what the model says that will have
    become of that over the delay.

    Where strings are elastic, the plan is none that the model makes: what is commanded, and fed back about, is the
    motion nearest to it (by the same weights) of the model with its elastic strings, in which these do not push or
    hardly do. Strings whose lengths are numbers are shorter by what the planned tensions stretch them in the mean.

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
        100 for dynamic variables, of prescribed ones 1 for speeds, 0.1 for places and 1 for those to come; one over its
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
    require_instance(rig, "rig", Rig)
    m, N, t = system.mechanism, system.N, system.t
    x, u = (plan.x, plan.u) if isinstance(plan, OptimizationResult) else pair_of(plan, "plan")
    x = as_array(x, "plan x", (N + 1, system.nx), meaning="(N+1, nx)")
    u = as_array(u, "plan u", (N, system.nu), meaning="(N, nu)")
    x, u, shorter, least = reeled_in(system, x, u, rig)
    machine = system.integrator.like(with_lengths(rig.machine(m), shorter))
    model = MidpointSystem(system.integrator.like(with_lengths(rig.model(m), shorter)), t)
    Q, R = _weights(m, u, Q, R)
    if least:
        x, u = nearest(model, x, u, Q=Q, R=R, least=least)
    noise = rig.noise * np.random.default_rng([rig.seed, 1]).standard_normal((N + 1, m.first_rho))
    controller = _Controller(model, x, u, Q, R, rig.noise) if feedback else None
    states = [x[0] if start is None else np.concatenate([start.q, start.p, start.v_rho])]
    commands, failure, read = [], None, 0
    for k in range(N):
        command = u[k]
        # What is lost may be anywhere.
        with np.errstate(over="ignore", invalid="ignore"):
            while controller is not None and t[read] + rig.delay <= t[k] + _AT_ONCE * (t[k + 1] - t[k]):
                controller.read(states[read][: m.first_rho] + noise[read])
                read += 1
            if controller is not None and read > 0:
                command = controller.command(k)
        now = _driven(machine, rig.substeps, t[k : k + 2], states[-1], command)
        if now is None:
            failure = f"the rig could not be simulated from {t[k]:.4g} s on"
            break
        states.append(now)
        commands.append(command)
    played = np.array(commands).reshape(-1, system.nu)
    return Played(mechanism=machine.mechanism, t=t[: len(states)], x=np.array(states), u=played, failure=failure)


def _driven(machine: MidpointVI, parts: int, t: Array, x: Array, command: Array) -> Array | None:
    """Return the state of a machine at the end of a step of a plan, made in some parts; None where it has none.

    ``t`` (2,): the times of the step. The prescribed variables go evenly to where they are commanded.
    """
    m, shares = machine.mechanism, np.arange(1, parts + 1)[:, None] / parts
    rows = np.tile(command, (parts, 1))
    rows[:, m.n_inputs :] = divided(m, x[m.first_rho : m.nq], command[m.n_inputs :], parts)
    out = machine.core.roll_out(t[0] + np.append(0.0, shares) * (t[1] - t[0]), x, None, rows, None)
    if out.steps < parts or not np.isfinite(out.x[-1]).all():
        return None
    return np.ascontiguousarray(out.x[-1])


def _weights(m: Mechanism, u: Array, Q: ArrayLike | None, R: ArrayLike | None) -> tuple[ArrayLike, ArrayLike]:
    """Return the weights of the regulator, those that are not given as `play` says."""
    if Q is None:
        Q = np.repeat([_HELD, _PLACES, 0.0, _SPEEDS], [m.nd, m.nrho, m.nd, m.nrho])
    if R is None:
        squares = np.mean(u[:, : m.n_inputs] ** 2, axis=0)
        R = np.concatenate([1.0 / np.where(squares > 0.0, squares, 1.0), np.ones(m.nrho)])
    return Q, R


class _Controller:
    """A regulator along a plan, on an estimate by late readings; it goes through it once.

    The momenta that chance adds have covariances in proportion to the mass matrix, as if each direction got the same
    energy: whatever the variables. Accelerations of the same size for each variable would be huge forces where angles
    are singular and hardly any where they are not, and the filter would take noise for motion.
    """

    def __init__(self, model: MidpointSystem, x: Array, u: Array, Q: ArrayLike, R: ArrayLike, noise: float) -> None:
        self.model, self.x = model, x
        m = model.mechanism
        self.regulator = Regulator(model, x, u, Q, R)
        # What is off at the start keeps to the constraints.
        known = m.coordinates[: m.first_rho]
        unsure = _UNSURE * model.start_directions(x[0], [*known, *(f"p_{name}" for name in m.dynamic)])
        self.kalman = KalmanFilter(
            model, measure=known, noise=max(noise, _LEAST_NOISE), process=self._surprise, x=x[0],
            spread=unsure @ unsure.T,
        )  # fmt: skip
        self.given = u.copy()
        self.read_one = False

    def _surprise(self, x: Array) -> Array:
        """Return the covariance of what a step adds to a state by chance."""
        m, k = self.model.mechanism, self.kalman.k
        mass = m.mass_matrix(np.ascontiguousarray(x[: m.nq]))[: m.nd, : m.nd]
        W = np.zeros((m.ndx, m.ndx))
        momenta = slice(m.nv, m.nv + m.nd)
        by = _SURPRISE * (self.model.t[k + 1] - self.model.t[k])
        W[momenta, momenta] = np.mean(np.diagonal(mass)) * by**2 * mass
        return W

    def read(self, reading: Array) -> None:
        """Take the reading of the next instant."""
        kalman = self.kalman
        if self.read_one:
            k = kalman.k
            try:
                kalman.predict(self.given[k])
            except StepError:  # what is known stays as it is
                kalman.x, kalman.k = self._after(k, kalman.x), k + 1
        kalman.correct(reading)
        self.read_one = True

    def _after(self, k: int, x: Array) -> Array:
        """Return where step k leads from x (nx,); as far from the plan as before where the model has no such step.

        Beside the singular pose of three angles there may be none, and a few steps later there is.
        """
        try:
            return self.model.f(x, self.given[k], k)
        except StepError:
            return self.model.plus(self.x[k + 1], self.model.difference(x, self.x[k]))

    def command(self, k: int) -> Array:
        """Return the input of step k, given what was read."""
        ahead = self.kalman.x
        for j in range(self.kalman.k, k):
            ahead = self._after(j, ahead)
        self.given[k] = self.regulator.command(k, ahead)
        return np.asarray(self.given[k])
