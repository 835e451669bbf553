"""A motion by tensions: strings that pull are found first, and the lengths with which they do follow from it.

With its strings as rods of given lengths the puppet is hard to plan for: they push, brace against each other, and lose
their grip where a limb hangs straight below its string. With the tensions as inputs (`PulledSystem`) its dynamics are
smooth everywhere and a string that pulls is an input with a bound. Both make the same motions, so the plan's minimum is
that of the puppet on strings of prescribed lengths, and `Plan.by_lengths` says it so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import lsq_linear

from leastaction.apps.marionette.tracking.cost import TrackingCost
from leastaction.apps.marionette.tracking.limits import PuppetLimits
from leastaction.apps.marionette.tracking.problem import ROOT, TrackingProblem, unheld
from leastaction.apps.marionette.tracking.weights import TrackingWeights
from leastaction.errors import LeastActionError, StepError
from leastaction.io.motion.motion import Motion
from leastaction.mechanics import JointForce, MidpointVI
from leastaction.models.marionette import marionette, strings_of
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult, Status, optimize
from leastaction.optimal.discrete.linear_quadratic import regulate
from leastaction.systems import MidpointSystem, PulledSystem

# Prices of a motor's square on the way to the motion without motors, and the iterations at each.
PRICES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
_ITERATIONS, _LAST_ITERATIONS = 20, 40
SEARCH_STAGES = len(PRICES) + 1
"""Optimisations that a search takes, one after the other: one at each price, and one without motors."""
_CUTOFFS = (4.0, 2.0, 1.0, 0.5)  # Hz, of smoother motions to begin with
_FIRST = ("tension", "joints")


class Plan:
    """The tracking problem with the tensions as inputs.

    ``problem``: the same by lengths. ``weights``, ``limits``: what is minimised, and what is kept to.
    """

    def __init__(self, problem: TrackingProblem, weights: TrackingWeights, limits: PuppetLimits) -> None:
        whole = problem.mechanism
        self.problem, self.weights = problem, weights
        self.strings = strings_of(whole)
        by_tension = marionette(strings=9 if len(self.strings) == 9 else 6, by="tension")
        numbers = {name: value for name, value in whole.parameters.items() if name in by_tension.parameters}
        self.mechanism = by_tension.with_parameters(numbers)
        m, t = self.mechanism, problem.t
        self.t, self.dt = t, problem.dt
        self.system = PulledSystem(MidpointVI(m, threads=problem.threads), t, at_instants=m.inputs)
        self._columns = np.array([whole.variables.index(name) for name in m.variables])
        self._ends = np.array([whole.kinematic.index(name) for name in m.kinematic])
        self._lengths = np.array([whole.kinematic.index(s.length) for s in self.strings])
        q = problem.reference[:, self._columns]
        x = np.zeros((len(t), m.nx))
        x[:, : m.nq] = q
        x[:, m.nq : m.nq + m.nd] = problem.x_reference[:, whole.nq : whole.nq + whole.nd]
        x[1:, m.nq + m.nd :] = np.diff(q[:, m.nd :], axis=0) / self.dt
        self.tension = self._tension_at_rest(limits.tension)
        self.x_reference = x
        self.u_reference = np.hstack([np.tile(self.tension, (len(t) - 1, 1)), q[1:, m.nd :]])
        self.limits = limits
        self.free_start = m.variables

    def cost(self, *, motor: float | None = None) -> TrackingCost:
        """Return the cost; with motors as further inputs, behind the tensions, if they have a price."""
        m, w, strings = self.mechanism, self.weights, len(self.strings)
        inertia = np.diag(m.mass_matrix(self.x_reference[0, : m.nq]))[: m.nd]
        free = unheld(self.problem.mechanism)
        body = np.array([w.root if n in ROOT else w.unheld if n in free else w.joint for n in m.dynamic])
        rate = w.rate * np.array([w.unheld if n in free else 1.0 for n in m.dynamic]) / inertia**2
        motors = 0 if motor is None else m.nd
        price = np.full(motors, 0.0 if motor is None else motor)
        u = self.u_reference
        return TrackingCost(
            self.x_reference,
            np.hstack([u[:, :strings], np.zeros((len(u), motors)), u[:, strings:]]),
            Q=np.concatenate([body, np.full(m.nrho, w.string), rate, np.zeros(m.nrho)]),
            R=np.concatenate([np.full(strings, w.tension), price, np.full(m.nrho, 0.01 * w.string)]),
            dt=self.dt,
            rho=slice(m.nd, m.nq),
            v_rho=slice(m.nq + m.nd, m.nx),
            rho_next=slice(strings + motors, strings + motors + m.nrho),
            acceleration=w.string_acceleration,
        )

    def search(
        self,
        say: Callable[[str], object],
        *,
        stage: int = 0,
        result: OptimizationResult | None = None,
        keep: Callable[[int, OptimizationResult, bool], None],
    ) -> tuple[Array, Array]:
        """Return a first trajectory found with motors on all joints that become ever more expensive.

        ``say``: told what each stage came to. ``stage``, ``result``: the stage to begin with, and what the one before
        it found. ``keep``: told of both after every stage, and where Ctrl-C ends one, which is the third argument.
        """
        m, strings = self.mechanism, len(self.strings)
        motors = range(strings, strings + m.nd)
        helped = m.with_elements([JointForce(name, f"motor of {name}") for name in m.dynamic])
        by_motors = MidpointSystem(MidpointVI(helped, threads=self.problem.threads), self.t)
        limits = self.limits.of(m, self.problem.reference[:, :2], _FIRST)
        for number in range(stage, SEARCH_STAGES):
            price = PRICES[number] if number < len(PRICES) else None
            solve = partial(
                optimize,
                self.system if price is None else by_motors,
                self.cost(motor=price),
                limits=limits,
                free_start=self.free_start,
                tolerance=1e-2,
                max_iterations=_ITERATIONS if price is not None else _LAST_ITERATIONS,
            )
            if result is None:
                found = self._first(solve)
            elif price is None:
                found = solve(initial=(result.x, np.delete(result.u, motors, axis=1)))
            else:
                found = solve(initial=result)
            if found.status is Status.INTERRUPTED:
                # Ctrl-C, which a single optimisation only ends early, ends them all.
                if result is not None:
                    keep(number, result, True)
                raise KeyboardInterrupt
            result = found
            if price is None:
                say(f"without motors: cost {result.cost:.4g}")
                break
            keep(number + 1, result, False)
            effort = float(np.max(np.sqrt(np.mean(result.u[:, motors] ** 2, axis=0))))
            say(f"motors at price {price:g}: the strongest gives {effort:.2g} N or N m (rms)")
        assert result is not None
        return result.x, result.u

    def _first(self, solve: Callable[..., OptimizationResult]) -> OptimizationResult:
        """Return what the cheapest motors make of the wanted motion, or of a smoother one where that is too wild."""
        m, strings = self.mechanism, len(self.strings)
        x, u = self.x_reference.copy(), np.insert(self.u_reference, [strings] * m.nd, 0.0, axis=1)
        for cutoff in _CUTOFFS:
            try:
                return solve(initial=(x, u))
            except LeastActionError:
                q = Motion(m.variables, self.t, self.x_reference[:, : m.nq]).low_pass(cutoff).q
                x[:, : m.nq] = q
                x[:, m.nq : m.nq + m.nd] = [
                    m.momentum(each, rate)[: m.nd] for each, rate in zip(q, np.gradient(q, self.t, axis=0), strict=True)
                ]
                x[1:, m.nq + m.nd :] = np.diff(q[:, m.nd :], axis=0) / self.dt
                x[0] = self.x_reference[0]
                u[:, strings + m.nd :] = q[1:, m.nd :]
        return solve(initial=(self.x_reference[0], u))

    def finer(self, coarse: Plan, x: Array, u: Array) -> tuple[Array, Array]:
        """Return a trajectory of a plan with longer steps between its instants, as a curve to start from."""
        early = coarse.t[:-1]
        return (
            np.stack([np.interp(self.t, coarse.t, column) for column in x.T], axis=1),
            np.hstack(
                [
                    np.stack([np.interp(self.t[:-1], early, column) for column in u.T[: len(self.strings)]], axis=1),
                    np.stack(
                        [np.interp(self.t[1:], coarse.t[1:], column) for column in u.T[len(self.strings) :]], axis=1
                    ),
                ]
            ),
        )

    def pulling(self, result: OptimizationResult) -> OptimizationResult:
        """Return a result whose strings pull, also where the search ended before they all did.

        Under the gains about what was found, each tension is held at its least where it would fall below.
        """
        strings, least = len(self.strings), self.limits.tension
        if result.u[:, :strings].min() >= least * (1.0 - 1e-9) or not np.isfinite(result.cost):
            return result
        x, u = result.x.copy(), result.u.copy()
        try:
            for k in range(self.system.N):
                u[k] -= result.K[k] @ (x[k] - result.x[k])
                u[k, :strings] = np.maximum(u[k, :strings], least)
                x[k + 1] = self.system.f(x[k], u[k], k)
        except StepError:
            return result
        return replace(result, x=x, u=u, cost=self.cost().value(x, u))

    def by_lengths(self, result: OptimizationResult) -> OptimizationResult:
        """Return a result of this system as one of the puppet on strings of prescribed lengths: the same motion."""
        m, whole, problem, dt = self.mechanism, self.problem.mechanism, self.problem, self.dt
        N, system = len(self.t) - 1, problem.system
        q = np.zeros((N + 1, whole.nq))
        q[:, self._columns] = result.x[:, : m.nq]
        places = (whole.positions(q, names) for names in zip(*((s.hook, s.control) for s in self.strings), strict=True))
        lengths = np.linalg.norm(np.subtract(*places), axis=2)
        q[:, whole.nd + self._lengths] = lengths
        x = np.zeros((N + 1, system.nx))
        x[:, : whole.nq] = q
        x[:, whole.nq : whole.nq + whole.nd] = result.x[:, m.nq : m.nq + m.nd]
        x[1:, whole.nq + whole.nd : whole.nx] = np.diff(q[:, whole.nd :], axis=0) / dt
        share = np.full((N, 1), dt)
        share[0] *= 0.5
        x[1:, whole.nx :] = share * result.u[:, : len(self.strings)] / (2.0 * lengths[:-1])
        x[0, whole.nx :] = 2.0 * x[1, whole.nx :]
        u = q[1:, whole.nd :]
        try:
            A, B = system.linearize(x, u)
            cost = problem.cost(self.weights.tension).hessian(x, u)
            K = regulate(A, B, Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
        except LeastActionError:  # where strings have lost their grip there is no regulator; the motion stands
            K = np.zeros((N, system.nu, system.nx))
        done = system.rollout(x[0], x, u, K, 0, N)
        if done.complete:
            x, u = done.x, done.u
        return replace(result, x=x, u=u, K=K, projection_gain=K)

    def _tension_at_rest(self, least: float) -> Array:
        """Return the tensions with which the strings carry the puppet as well as they can where the motion starts."""
        whole = self.problem.mechanism
        q = self.problem.reference[0]
        weight = -whole.core.gradient(q, np.zeros(whole.nq))[0][: whole.nd]
        lengths = q[whole.nd + self._lengths]
        by_tension = whole.constraint_jacobian(q)[:, : whole.nd] / (2.0 * lengths[:, None])
        return np.asarray(lsq_linear(by_tension.T, -weight, bounds=(least, np.inf)).x)
