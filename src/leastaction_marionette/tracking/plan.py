"""A motion by tensions: strings that pull are found first, and the lengths with which they do follow from it.

With its strings as rods of given lengths the puppet is hard to plan for: they push, brace against each other, and lose
their grip where a limb hangs straight below its string. With the tensions as inputs (`PulledSystem`) its dynamics are
smooth everywhere and a string that pulls is an input with a bound. Both make the same motions, so the plan's minimum is
that of the puppet on strings of prescribed lengths, and `Plan.by_lengths` says it so.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import lsq_linear

from leastaction.errors import ArgumentError, LeastActionError, StepError
from leastaction.io import Motion
from leastaction.mechanics import JointForce, MidpointVI, to_momentum
from leastaction.models.marionette import (
    axes_of,
    held_strings,
    marionette,
    set_of,
    string_lengths,
    strings_of,
    tied_strings,
)
from leastaction.numerics import Array
from leastaction.optimal import Cost, OptimizationResult, Status, linearize_along_curve, regulate
from leastaction.systems import PulledSystem
from leastaction_marionette.tracking.cost import TrackingCost
from leastaction_marionette.tracking.limits import FIRST_KINDS, PuppetLimits
from leastaction_marionette.tracking.problem import TrackingProblem, levers, unheld
from leastaction_marionette.tracking.ties import Ties
from leastaction_marionette.tracking.weights import TrackingWeights
from leastaction_marionette.turns import rates_along, unit

_OFF = 0.02  # of the mean tension at rest, by which tensions keep off their least
_ROUNDING = 1e-9  # of limits of tensions
_LITTLE = 1.1  # times the cost that may take
_HELD = "Strings push on the motion found, and on all near it: the puppet hangs still."


class TrackingPlan:
    """The tracking problem with the tensions as inputs.

    ``problem``: the same by lengths. ``weights``, ``limits``: what is minimised, and what is kept to.
    """

    def __init__(self, problem: TrackingProblem, weights: TrackingWeights, limits: PuppetLimits) -> None:
        whole = problem.mechanism
        self.problem, self.weights = problem, weights
        self.strings = strings_of(whole)
        by_tension = marionette(strings=set_of(whole), by="tension", axes=axes_of(whole))
        own = by_tension.parameters
        numbers = {name: value for name, value in whole.parameters.items() if name in own}
        self.mechanism = by_tension.with_parameters(numbers)
        m, t = self.mechanism, problem.t
        self.t, self.dt = t, problem.dt
        self.system = PulledSystem(MidpointVI(m, threads=problem.threads), t, at_instants=m.inputs)
        self.columns = np.array([whole.coordinates.index(name) for name in m.coordinates])
        self._ends = np.array([whole.kinematic.index(name) for name in m.kinematic])
        held = held_strings(whole)
        self.held = np.array([self.strings.index(s) for s in held], dtype=int)
        self.lengths = np.array([whole.kinematic.index(s.length) for s in held], dtype=int)
        self.ties = Ties(whole, m) if tied_strings(whole) else None
        q = problem.reference[:, self.columns]
        self.tension = self._tension_at_rest(limits)
        self.x_reference = self.states(q)
        # The motion begins at rest, not with the slope of its first step.
        self.x_reference[0, m.nq : m.nq + m.nd] = problem.x_reference[0, whole.nq : whole.nq + whole.nd]
        self.u_reference = np.hstack([np.tile(self.tension, (len(t) - 1, 1)), q[1:, m.first_rho :]])
        self.limits = limits
        self.free_start = m.coordinates

    def following(self, motion: Motion) -> TrackingPlan:
        """Return the plan of another motion of the same puppet."""
        old = self.problem
        problem = TrackingProblem(old.mechanism, motion, old.weights, old.threads, old.follow)
        return TrackingPlan(problem, self.weights, self.limits)

    @cached_property
    def by_motors(self) -> PulledSystem:
        """The system with a motor on every joint; their forces are inputs behind the tensions."""
        m = self.mechanism
        helped = m.with_elements([JointForce(name, f"motor of {name}") for name in m.dynamic])
        return PulledSystem(MidpointVI(helped, threads=self.problem.threads), self.t, at_instants=m.inputs)

    def tied(self, weight: float, *, firm: bool) -> TrackingPlan:
        """Return the plan with strings on bars tied with another weight; see `Ties.tied`."""
        assert self.ties is not None
        other = copy(self)
        other.ties = self.ties.tied(weight, firm=firm)
        return other

    @property
    def varies(self) -> bool:
        """Whether strings that are tied to bars still vary in length."""
        return self.ties is not None and not self.ties.firm

    def cost(self, *, motor: float | None = None) -> Cost:
        """Return the cost; that of the system with motors if they have a price."""
        system = self.system if motor is None else self.by_motors
        cost = self.untied_cost(motor=motor)
        return cost if self.ties is None else self.ties.priced(cost, system)

    def untied_cost(self, *, motor: float | None = None) -> Cost:
        """Return the cost but for the price of lengths."""
        system = self.system if motor is None else self.by_motors
        return self.problem.with_markers(self.tracking_cost(motor=motor), system)

    def tracking_cost(self, *, motor: float | None = None) -> TrackingCost:
        """Return the part of the cost that is quadratic in states and inputs."""
        m, w, strings = self.mechanism, self.weights, len(self.strings)
        system = self.system if motor is None else self.by_motors
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
            system=system,
            acceleration=squares * w.string_acceleration,
        )

    def regulators(self, x: Array, u: Array) -> Iterator[Array]:
        """Yield gains with which a motion may be followed, the firmest first."""
        try:
            cost = self.cost().hessian(x, u)
            K = regulate(*linearize_along_curve(self.system, x, u), Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
        except LeastActionError:
            return
        yield from (K, 0.3 * K)

    def broken(self, x: Array) -> frozenset[str]:
        """Return the kinds of limits that states break, of those that are not stated from the first stage on."""
        place = self.problem.pelvis
        return self.limits.broken(self.mechanism, self.t, place, x) - FIRST_KINDS

    def states(self, q: Array) -> Array:
        """Return the states (N+1, nx) of a motion q (N+1, nq), whose momenta are those of its slope."""
        return self.system.states_along(q, to_momentum(self.mechanism, q, rates_along(self.mechanism, q, self.t)))

    def finer(self, coarse: TrackingPlan, x: Array, u: Array) -> tuple[Array, Array]:
        """Return a trajectory of a plan with longer steps between its instants, as a curve to start from."""
        m, strings = self.mechanism, len(self.strings)
        # The motion begins at rest.
        fine = CubicSpline(coarse.t, x, axis=0, bc_type=((1, np.zeros(x.shape[1])), "not-a-knot"))(self.t)
        fine = unit(m.coordinates, fine)
        fine[1:, m.nq + m.nd :] = np.diff(fine[:, m.first_rho : m.nq], axis=0) / self.dt
        pulls = [np.interp(self.t[:-1], coarse.t[:-1], column) for column in u.T[:strings]]
        return fine, np.hstack([np.stack(pulls, axis=1), fine[1:, m.first_rho : m.nq]])

    def inside(self, x: Array, u: Array, cost: float) -> tuple[Array, Array]:
        """Return a motion near a curve whose tensions keep off their limits; the curve where that costs much more."""
        for gains in self.regulators(x, u):
            xs, us = self.clipped(x, u, gains, _OFF)
            if len(us) == self.system.N and self.cost().value(xs, us) < _LITTLE * cost:
                return xs, us
        return x, u

    def pulling(self, result: OptimizationResult) -> OptimizationResult:
        """Return a result whose strings pull, also where the search ended before they all did.

        Under the gains about what was found, each tension is held within its limits. Where that leads far away, one in
        which all strings pull, if with a little less or too much, stays what it is.
        """
        pulls = result.u[:, : len(self.strings)]
        fine = np.isfinite(result.x).all() and np.isfinite(result.u).all()
        lowest = pulls.min() if fine else -np.inf
        if fine and self.limits.keep(pulls, _ROUNDING):
            return result
        none = np.zeros_like(result.K)
        if fine:
            for gains in (result.K, *self.regulators(result.x, result.u), none):
                if np.isfinite(gains).all():
                    x, u = self.clipped(result.x, result.u, gains)
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

    def clipped(self, xbar: Array, ubar: Array, K: Array, off: float = 0.0) -> tuple[Array, Array]:
        """Return a roll-out under feedback, each tension within its limits; up to the step that failed.

        ``off``: of the mean tension at rest, by which they keep off them.
        """
        strings = len(self.strings)
        least, most = self.tensions_inside(off)
        x, u = np.array(xbar), np.array(ubar)
        for k in range(self.system.N):
            u[k] = ubar[k] - K[k] @ self.system.difference(x[k], xbar[k])
            u[k, :strings] = np.clip(u[k, :strings], least, most)
            try:
                x[k + 1] = self.system.f(x[k], u[k], k)
            except StepError:
                return x[: k + 1], u[:k]
        return x, u

    def tensions_inside(self, off: float) -> tuple[float, float]:
        """Return the least and the most tension, off their limits by a share of the mean tension at rest (N)."""
        limits = self.limits
        by = min(off * float(self.tension.mean()), 0.5 * (limits.strength - limits.tension))
        return limits.tension + by, limits.strength - by

    def hung(self) -> tuple[Array, Array]:
        """Return what the puppet does where its strings are held, up to a step that fails."""
        return self.clipped(*self.hanging(), np.zeros((self.system.N, self.system.nu, self.system.ndx)))

    def hanging(self) -> tuple[Array, Array]:
        """Return states and inputs of a puppet that hangs from where the motion begins."""
        return (
            np.tile(self.x_reference[0], (len(self.t), 1)),
            np.tile(
                np.concatenate([self.tension, self.x_reference[0, self.mechanism.first_rho : self.mechanism.nq]]),
                (self.system.N, 1),
            ),
        )

    def _tension_at_rest(self, limits: PuppetLimits) -> Array:
        """Return the tensions with which the strings carry the puppet as well as they can where the motion starts."""
        whole = self.problem.mechanism
        q = self.problem.reference[0]
        weight = -whole.core.gradient(q, np.zeros(whole.nv))[0][: whole.nd]
        if not len(self.strings) * limits.strength > (heavy := float(weight[whole.variables.index("torso_tz")])):
            raise ArgumentError(
                f"limits: strength is {limits.strength:g} N, and {len(self.strings)} strings of that do not carry the "
                f"puppet, which weighs {heavy:.3g} N. Allow more, or take more strings"
            )
        lengths = string_lengths(whole, q)
        by_tension = whole.constraint_jacobian(q)[:, : whole.nd] / (2.0 * lengths[:, None])
        return np.asarray(lsq_linear(by_tension.T, -weight, bounds=(limits.tension, limits.strength)).x)
