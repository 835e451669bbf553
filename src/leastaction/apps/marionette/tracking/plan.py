"""A motion by tensions: strings that pull are found first, and the lengths with which they do follow from it.

With its strings as rods of given lengths the puppet is hard to plan for: they push, brace against each other, and lose
their grip where a limb hangs straight below its string. With the tensions as inputs (`PulledSystem`) its dynamics are
smooth everywhere and a string that pulls is an input with a bound. Both make the same motions, so the plan's minimum is
that of the puppet on strings of prescribed lengths, and `Plan.by_lengths` says it so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import lsq_linear

from leastaction.apps.marionette.tracking.cost import TrackingCost
from leastaction.apps.marionette.tracking.limits import FIRST_KINDS, PuppetLimits
from leastaction.apps.marionette.tracking.problem import TrackingProblem, levers, unheld
from leastaction.apps.marionette.tracking.settle import NotTiedError, settled
from leastaction.apps.marionette.tracking.ties import Ties
from leastaction.apps.marionette.tracking.weights import TrackingWeights
from leastaction.errors import LeastActionError, ProjectionError, StepError
from leastaction.io.motion.motion import Motion
from leastaction.mechanics import JointForce, MidpointVI, Trajectory
from leastaction.models.marionette import (
    held_strings,
    marionette,
    set_of,
    string_lengths,
    strings_of,
    tied_strings,
)
from leastaction.numerics.arrays import Array
from leastaction.optimal import Cost, IterationRecord, OptimizationResult, Status, optimize
from leastaction.optimal.discrete.linear_quadratic import regulate
from leastaction.optimal.discrete.projection import linearize_along_curve
from leastaction.systems import PulledSystem

# Prices of a motor's square on the way to the motion without motors, and the iterations at each.
PRICES = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3, 1e4)
_ITERATIONS, _LAST_ITERATIONS = 12, 80
SEARCH_STAGES = len(PRICES) + 1
"""Optimisations that a search takes at most, one after the other: one at each price, and one without motors."""
_RELEASED = 4  # stage from which on it is tried whether the motion goes on without motors
_JUMP = 2.0  # times the cost with motors may that without be at first
_CUTOFFS = (1e6, 8.0, 4.0, 2.0, 1.0)  # Hz, of ever smoother motions to begin with; the first leaves it as it is
_SAME = 1e-6  # m or rad, by which the same motion may differ, by tensions and by lengths
_SET_OUT = 5  # steps within which a motion that begins fast is picked up from rest
_INSIDE = 0.1  # of the mean tension at rest, by which tensions are above their least to begin with
_OFF, _LITTLE = 0.02, 1.1  # the same where motors cannot make up for it, and times the cost that may take
_HELD = "Strings push on the motion found, and on all near it: the puppet hangs still."
# Tolerance of the search: where barriers stay high, each stage leaves room for the next. Without motors it is that of a
# motion which is hardly improved with shorter steps of time.
_ROUGHLY, _WITHOUT_MOTORS = 0.1, 0.02

Keep = Callable[[int, OptimizationResult, bool], None]
Count = Callable[[OptimizationResult, bool], None]


class Plan:
    """The tracking problem with the tensions as inputs.

    ``problem``: the same by lengths. ``weights``, ``limits``: what is minimised, and what is kept to.
    """

    def __init__(self, problem: TrackingProblem, weights: TrackingWeights, limits: PuppetLimits) -> None:
        whole = problem.mechanism
        self.problem, self.weights = problem, weights
        self.strings = strings_of(whole)
        by_tension = marionette(strings=set_of(whole), by="tension")
        numbers = {name: value for name, value in whole.parameters.items() if name in by_tension.parameters}
        self.mechanism = by_tension.with_parameters(numbers)
        m, t = self.mechanism, problem.t
        self.t, self.dt = t, problem.dt
        self.system = PulledSystem(MidpointVI(m, threads=problem.threads), t, at_instants=m.inputs)
        self._columns = np.array([whole.variables.index(name) for name in m.variables])
        self._ends = np.array([whole.kinematic.index(name) for name in m.kinematic])
        held = held_strings(whole)
        self._held = np.array([self.strings.index(s) for s in held], dtype=int)
        self._lengths = np.array([whole.kinematic.index(s.length) for s in held], dtype=int)
        self.ties = Ties(whole, m, len(t) - 1) if tied_strings(whole) else None
        q = problem.reference[:, self._columns]
        self.tension = self._tension_at_rest(limits.tension)
        self.x_reference = self._states(q)
        # The motion begins at rest, not with the slope of its first step.
        self.x_reference[0, m.nq : m.nq + m.nd] = problem.x_reference[0, whole.nq : whole.nq + whole.nd]
        self.u_reference = np.hstack([np.tile(self.tension, (len(t) - 1, 1)), q[1:, m.nd :]])
        self.limits = limits
        self.free_start = m.variables

    def following(self, motion: Motion) -> Plan:
        """Return the plan of another motion of the same puppet."""
        old = self.problem
        problem = TrackingProblem(old.mechanism, motion, old.weights, old.threads, old.follow)
        return Plan(problem, self.weights, self.limits)

    @cached_property
    def by_motors(self) -> PulledSystem:
        """The system with a motor on every joint; their forces are inputs behind the tensions."""
        m = self.mechanism
        helped = m.with_elements([JointForce(name, f"motor of {name}") for name in m.dynamic])
        return PulledSystem(MidpointVI(helped, threads=self.problem.threads), self.t, at_instants=m.inputs)

    def cost(self, *, motor: float | None = None) -> Cost:
        """Return the cost; that of the system with motors if they have a price."""
        system = self.system if motor is None else self.by_motors
        cost = self.problem.with_markers(self.tracking_cost(motor=motor), system)
        return cost if self.ties is None else self.ties.priced(cost, system)

    def tracking_cost(self, *, motor: float | None = None) -> TrackingCost:
        """Return the part of the cost that is quadratic in states and inputs."""
        m, w, strings = self.mechanism, self.weights, len(self.strings)
        inertia = np.diag(m.mass_matrix(self.x_reference[0, : m.nq]))[: m.nd]
        free = unheld(self.problem.mechanism)
        rate = w.rate * np.array([w.unheld if n in free else 1.0 for n in m.dynamic]) / inertia**2
        motors = 0 if motor is None else m.nd
        price = np.full(motors, 0.0 if motor is None else motor)
        u, squares = self.u_reference, levers(m) ** 2
        return TrackingCost(
            self.x_reference,
            np.hstack([u[:, :strings], np.zeros((len(u), motors)), u[:, strings:]]),
            Q=np.concatenate([self.problem.body_weights(w), squares * w.string, rate, np.zeros(m.nrho)]),
            R=np.concatenate([np.full(strings, w.tension), price, squares * (0.01 * w.string)]),
            dt=self.dt,
            rho=slice(m.nd, m.nq),
            v_rho=slice(m.nq + m.nd, m.nx),
            rho_next=slice(strings + motors, strings + motors + m.nrho),
            acceleration=squares * w.string_acceleration,
        )

    def search(
        self,
        say: Callable[[str], object],
        *,
        stage: int = 0,
        result: OptimizationResult | None = None,
        keep: Keep,
        count: Count = lambda _found, _motors: None,
    ) -> tuple[Array, Array]:
        """Return a first trajectory found with motors on all joints that become ever more expensive.

        ``say``: told what each stage came to. ``stage``, ``result``: the stage to begin with, and what the one before
        it found. ``keep``: told of both after every stage, and where Ctrl-C ends one, which is the third argument.
        ``count``: told of every optimisation, and whether motors helped in it.
        """
        m, strings = self.mechanism, len(self.strings)
        motors = range(strings, strings + m.nd)
        options = self._options()

        def ended(found: OptimizationResult, number: int) -> OptimizationResult:
            if found.status is Status.INTERRUPTED:
                # Ctrl-C, which a single optimisation only ends early, ends them all.
                if result is not None:
                    keep(number, result, True)
                raise KeyboardInterrupt
            return found

        for number in range(stage, SEARCH_STAGES):
            if result is not None and number >= _RELEASED:
                stated = self._broken(result.x)
                found = ended(self._release(result, motors, stated), number)
                if found.status is not Status.STOPPED_BY_CALLBACK:
                    count(found, False)
                    say(f"without motors: cost {found.cost:.4g}")
                    within = ended(self._within(found, stated), number)
                    if within is not found:
                        count(within, False)
                    return self._unless_still(within.x, within.u, say)
            if number == len(PRICES):
                break
            price = PRICES[number]
            # Duals of an earlier stage are those of cheaper motors: each stage finds its own.
            solve = partial(optimize, self.by_motors, self.cost(motor=price), max_iterations=_ITERATIONS, **options)
            found = self._begun(solve) if result is None else solve(initial=(result.x, result.u))
            result = ended(found, number)
            count(result, True)
            keep(number + 1, result, False)
            effort = float(np.max(np.sqrt(np.mean(result.u[:, motors] ** 2, axis=0))))
            say(f"motors at price {price:g}: the strongest gives {effort:.2g} N or N m (rms)")
        assert result is not None
        # Motors that do next to nothing are still missed: what the strings do by themselves is where the rest begins.
        x, u = result.x, np.delete(result.u, motors, axis=1)
        say("without motors: not found in the search")
        for gains in self._regulators(x, u):
            xs, us = self._clipped(x, u, gains)
            if len(us) == self.system.N:
                return self._unless_still(xs, us, say)
        return self.hung()

    def _unless_still(self, x: Array, u: Array, say: Callable[[str], object]) -> tuple[Array, Array]:
        """Return a motion; that of a puppet which hangs still, where it is nearer to the wanted one.

        Where strings are too few for what the motors did, the motion without them is violent, and leads nowhere.
        """
        xs, us = self.hung()
        if len(us) < self.system.N or self.cost().value(xs, us) > self.cost().value(x, u):
            return x, u
        say("a puppet that hangs still is nearer: it begins with that")
        return xs, us

    def _regulators(self, x: Array, u: Array) -> Iterator[Array]:
        """Yield gains with which a motion may be followed, the firmest first."""
        try:
            cost = self.cost().hessian(x, u)
            K = regulate(*linearize_along_curve(self.system, x, u), Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
        except LeastActionError:
            return
        yield from (K, 0.3 * K)

    def _begun(self, solve: Callable[..., OptimizationResult]) -> OptimizationResult:
        """Return what the first stage finds from the wanted motion, or a smoother one where steps cannot follow it."""
        # On its limit a tension has a barrier like a wall, from which no direction leads away.
        inside = self.limits.tension + _INSIDE * self.tension.mean()
        q = self.x_reference[:, : self.mechanism.nq]
        tensions = np.maximum(self.u_reference[:, : len(self.strings)], inside)
        for cutoff in _CUTOFFS:
            smooth = Motion(self.mechanism.variables, self.t, q).low_pass(cutoff).q
            with suppress(ProjectionError):
                return solve(initial=self.driven(smooth, tensions))
        return solve(initial=self.driven(np.tile(q[0], (len(q), 1)), tensions))

    def _options(self, more: Collection[str] = (), tolerance: float = _ROUGHLY) -> dict[str, Any]:
        """Return options of a stage: limits of the first kinds and `more`, what is free of the start, the tolerance."""
        return {
            "limits": self.limits.of(self.mechanism, self.problem.pelvis, {*FIRST_KINDS, *more}),
            "free_start": self.free_start,
            "tolerance": tolerance,
        }

    def _broken(self, x: Array) -> frozenset[str]:
        """Return the kinds of limits that states break, of those that are not stated from the first stage on."""
        place = self.problem.pelvis
        return self.limits.broken(self.mechanism, self.t, place, x) - FIRST_KINDS

    def _release(self, result: OptimizationResult, motors: range, stated: frozenset[str]) -> OptimizationResult:
        """Return what is found without motors from where they did something; stopped at once where that is far off.

        ``stated``: kinds of limits that the motion with motors breaks. Without motors it would break them by far, and
        the way back from there is long.
        """
        most = _JUMP * result.cost

        def lost(record: IterationRecord) -> bool:
            return record.iteration == 0 and not record.cost < most

        try:
            return optimize(
                self.system,
                self.cost(),
                initial=(result.x, np.delete(result.u, motors, axis=1)),
                callback=lost,
                max_iterations=_LAST_ITERATIONS,
                **self._options(stated, _WITHOUT_MOTORS),
            )
        except ProjectionError:
            return replace(result, status=Status.STOPPED_BY_CALLBACK)

    def _within(self, result: OptimizationResult, stated: frozenset[str]) -> OptimizationResult:
        """Return a motion without motors that keeps to limits which one that was found breaks, and to those stated."""
        kinds = stated | self._broken(result.x)
        if kinds == stated:
            return result
        return optimize(
            self.system,
            self.cost(),
            initial=(result.x, result.u),
            max_iterations=_LAST_ITERATIONS,
            **self._options(kinds, _WITHOUT_MOTORS),
        )

    def driven(self, q: Array, tensions: Array) -> tuple[Array, Array]:
        """Return a motion q (N+1, nq) from rest with the motors that make it: behind the tensions among the inputs.

        Of a motion q, each step of the midpoint rule says what acts in its middle, given what acted in the last one and
        what pulls at its start: ``p_k + s dt f_pull = -D_1 L_d - dt/2 f``, ``p_k+1 = D_2 L_d + dt/2 f``. What begins
        fast is picked up within a few steps.
        """
        m, strings, dt = self.mechanism, len(self.strings), self.dt
        share = np.clip(np.arange(len(self.t)) / _SET_OUT, 0.0, 1.0)[:, None]
        q = q[0] + share**3 * (10.0 - 15.0 * share + 6.0 * share**2) * (q - q[0])
        none, still = np.zeros(strings), np.zeros(m.nq)
        motors, states = np.empty((len(tensions), m.nd)), self._states(q)
        p = self.x_reference[0, m.nq : m.nq + m.nd]
        for k, pull in enumerate(tensions):
            states[k, m.nq : m.nq + m.nd] = p
            middle, rate = 0.5 * (q[k + 1] + q[k]), (q[k + 1] - q[k]) / dt
            by_q, by_v = (each[: m.nd] for each in m.core.gradient(middle, rate)[:2])
            force = by_q + m.core.force(middle, rate, none)[: m.nd]
            kick = m.core.force(q[k], still, pull)[: m.nd] - m.core.force(q[k], still, none)[: m.nd]
            p = p + (0.5 if k == 0 else 1.0) * dt * kick
            motors[k] = 2.0 / dt * (by_v - p) - force
            p = by_v + 0.5 * dt * (force + motors[k])
        states[-1, m.nq : m.nq + m.nd] = p
        return states, np.hstack([tensions, motors, q[1:, m.nd :]])

    def _states(self, q: Array) -> Array:
        """Return the states (N+1, nx) of a motion q (N+1, nq), whose momenta are those of its slope."""
        m = self.mechanism
        rates = np.gradient(q, self.t, axis=0)
        x = np.zeros((len(q), m.nx))
        x[:, : m.nq] = q
        x[:, m.nq : m.nq + m.nd] = [m.momentum(a, b)[: m.nd] for a, b in zip(q, rates, strict=True)]
        x[1:, m.nq + m.nd :] = np.diff(q[:, m.nd :], axis=0) / self.dt
        return x

    def finer(self, coarse: Plan, x: Array, u: Array) -> tuple[Array, Array]:
        """Return a trajectory of a plan with longer steps between its instants, as a curve to start from."""
        m, strings = self.mechanism, len(self.strings)
        # The motion begins at rest.
        fine = CubicSpline(coarse.t, x, axis=0, bc_type=((1, np.zeros(x.shape[1])), "not-a-knot"))(self.t)
        fine[1:, m.nq + m.nd :] = np.diff(fine[:, m.nd : m.nq], axis=0) / self.dt
        pulls = [np.interp(self.t[:-1], coarse.t[:-1], column) for column in u.T[:strings]]
        return fine, np.hstack([np.stack(pulls, axis=1), fine[1:, m.nd : m.nq]])

    def inside(self, x: Array, u: Array, cost: float) -> tuple[Array, Array]:
        """Return a motion near a curve whose tensions keep off their limit; the curve where that costs much more."""
        least = self.limits.tension + _OFF * self.tension.mean()
        for gains in self._regulators(x, u):
            xs, us = self._clipped(x, u, gains, least)
            if len(us) == self.system.N and self.cost().value(xs, us) < _LITTLE * cost:
                return xs, us
        return x, u

    def pulling(self, result: OptimizationResult) -> OptimizationResult:
        """Return a result whose strings pull, also where the search ended before they all did.

        Under the gains about what was found, each tension is held at its least where it would fall below. Where that
        leads far away, one in which all strings pull, if with a little less, stays what it is.
        """
        strings, least = len(self.strings), self.limits.tension
        fine = np.isfinite(result.x).all() and np.isfinite(result.u).all()
        lowest = result.u[:, :strings].min() if fine else -np.inf
        if lowest >= least * (1.0 - 1e-9):
            return result
        none = np.zeros_like(result.K)
        if fine:
            for gains in (result.K, *self._regulators(result.x, result.u), none):
                if np.isfinite(gains).all():
                    x, u = self._clipped(result.x, result.u, gains)
                    if len(u) < self.system.N:
                        continue
                    cost = self.cost().value(x, u)
                    if lowest < 0.0 or cost < _LITTLE * result.cost:
                        return replace(result, x=x, u=u, cost=cost)
        if lowest >= 0.0:
            return result
        x, u = self.hung()
        if len(u) < self.system.N:
            return result
        held = replace(result, x=x, u=u, cost=self.cost().value(x, u))
        return replace(held, status=Status.LINE_SEARCH_FAILED, message=_HELD) if result.success else held

    def _clipped(self, xbar: Array, ubar: Array, K: Array, least: float | None = None) -> tuple[Array, Array]:
        """Return a roll-out under feedback, no tension below its least; up to the step that failed."""
        strings = len(self.strings)
        least = self.limits.tension if least is None else least
        x, u = np.array(xbar), np.array(ubar)
        for k in range(self.system.N):
            u[k] = ubar[k] - K[k] @ (x[k] - xbar[k])
            u[k, :strings] = np.maximum(u[k, :strings], least)
            try:
                x[k + 1] = self.system.f(x[k], u[k], k)
            except StepError:
                return x[: k + 1], u[:k]
        return x, u

    def hung(self) -> tuple[Array, Array]:
        """Return what the puppet does where its strings are held, up to a step that fails."""
        return self._clipped(*self._hanging(), np.zeros((self.system.N, self.system.nu, self.system.nx)))

    def _hanging(self) -> tuple[Array, Array]:
        """Return states and inputs of a puppet that hangs from where the motion begins."""
        return (
            np.tile(self.x_reference[0], (len(self.t), 1)),
            np.tile(
                np.concatenate([self.tension, self.x_reference[0, self.mechanism.nd : self.mechanism.nq]]),
                (self.system.N, 1),
            ),
        )

    def by_lengths(self, result: OptimizationResult) -> OptimizationResult:
        """Return a result of this system as one of the puppet on strings of prescribed lengths: the same motion.

        With strings on bars it is the nearest one on which their lengths are exact. Raises `NotTiedError` where there
        is none.
        """
        m, whole, problem, dt = self.mechanism, self.problem.mechanism, self.problem, self.dt
        N, system = len(self.t) - 1, problem.system
        if self.ties is not None:
            x, u = self._tied(result)
            result = replace(result, x=x, u=u)
        q = np.zeros((N + 1, whole.nq))
        q[:, self._columns] = result.x[:, : m.nq]
        lengths = string_lengths(whole, q)
        q[:, whole.nd + self._lengths] = lengths[:, self._held]
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
        # Rods push where strings lose their grip: what has gone another way there is another motion.
        if done.complete and np.abs(done.x[:, : whole.nq] - x[:, : whole.nq]).max() < _SAME:
            x, u = done.x, done.u
        return replace(result, x=x, u=u, K=K, projection_gain=K)

    def _tied(self, result: OptimizationResult) -> tuple[Array, Array]:
        """Return a motion near a result with strings on bars as long as they are tied.

        Raises `NotTiedError` where none is found.
        """
        assert self.ties is not None
        found = settled(
            self.system, self.ties, result.x, result.u, inputs=self.mechanism.inputs, least=self.limits.tension
        )
        if found is None:
            raise NotTiedError(
                "strings on bars: no motion is found in which all of them pull. Lower the least tension, allow bars "
                "more reach, or let hands hold more strings"
            )
        return found

    def by_tensions(self, trajectory: Trajectory, tension: Array, result: OptimizationResult) -> OptimizationResult:
        """Return a motion on strings of prescribed lengths, and its result, as one of this system: the same motion."""
        m = self.mechanism
        x = np.zeros((len(self.t), m.nx))
        x[:, : m.nq] = trajectory.q[:, self._columns]
        x[:, m.nq : m.nq + m.nd] = trajectory.p
        x[1:, m.nq + m.nd :] = np.diff(x[:, m.nd : m.nq], axis=0) / self.dt
        u = np.hstack([tension, x[1:, m.nd : m.nq]])
        K = next(self._regulators(x, u), np.zeros((self.system.N, self.system.nu, self.system.nx)))
        return replace(result, x=x, u=u, K=K, projection_gain=K, limits=None)

    def _tension_at_rest(self, least: float) -> Array:
        """Return the tensions with which the strings carry the puppet as well as they can where the motion starts."""
        whole = self.problem.mechanism
        q = self.problem.reference[0]
        weight = -whole.core.gradient(q, np.zeros(whole.nq))[0][: whole.nd]
        lengths = string_lengths(whole, q)
        by_tension = whole.constraint_jacobian(q)[:, : whole.nd] / (2.0 * lengths[:, None])
        return np.asarray(lsq_linear(by_tension.T, -weight, bounds=(least, np.inf)).x)
