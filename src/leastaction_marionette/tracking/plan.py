"""A motion by tensions: strings that pull are found first, and the lengths with which they do follow from it.

With its strings as rods of given lengths the puppet is hard to plan for: they push, brace against each other, and lose
their grip where a limb hangs straight below its string. With the tensions as inputs (`PulledSystem`) its dynamics are
smooth everywhere and a string that pulls is an input with a bound. Both make the same motions, so the plan's minimum is
that of the puppet on strings of prescribed lengths, and `by_lengths` says it so.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from copy import copy
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import lsq_linear

from leastaction.errors import ArgumentError, LeastActionError, StepError
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
from leastaction.optimal import Cost, Limit, LimitReport, OptimizationResult, Status, linearize_along_curve, regulate
from leastaction.systems import PulledSystem
from leastaction_marionette.tracking.cost import TrackingCost
from leastaction_marionette.tracking.limits import KINDS
from leastaction_marionette.tracking.problem import TrackingProblem
from leastaction_marionette.tracking.ties import Ties
from leastaction_marionette.turns import rates_along, unit

_OFF = 0.02  # of the mean tension at rest, by which tensions keep off their least
_ROUNDING = 1e-9  # of limits of tensions
_LITTLE = 1.1  # times the cost that may take
_HELD = "Strings push on the motion found, and on all near it: the puppet hangs still."

Curve = tuple[Array, Array]
"""States (N+1, nx) and inputs (N, nu): a trajectory, or what is near one."""


class TrackingPlan:
    """A tracking problem with the tensions as inputs.

    ``problem``: the same by lengths. Attributes: ``mechanism``, ``system`` by tensions; ``columns``, where its
    coordinates stand among those by lengths; ``tension`` at rest where the motion starts (N); the wanted
    ``x_reference``, ``u_reference``; ``ties``, the lengths of strings on bars, or None.
    """

    def __init__(self, problem: TrackingProblem) -> None:
        whole, t = problem.mechanism, problem.t
        self.problem, self.limits, self.t, self.dt = problem, problem.limits, t, problem.dt
        self.strings = strings_of(whole)
        by_tension = marionette(strings=set_of(whole), by="tension", axes=axes_of(whole))
        own = by_tension.parameters
        numbers = {name: value for name, value in whole.parameters.items() if name in own}
        self.mechanism = m = by_tension.with_parameters(numbers)
        self.system = PulledSystem(MidpointVI(m, threads=problem.threads), t, at_instants=m.inputs)
        self.columns = np.array([whole.coordinates.index(name) for name in m.coordinates])
        self.ties = Ties(whole, m) if tied_strings(whole) else None
        self.tension = self._tension_at_rest()
        q = problem.reference[:, self.columns]
        self.x_reference = self.states(q)
        # The motion begins at rest, not with the slope of its first step.
        self.x_reference[0, m.nq : m.nq + m.nd] = 0.0
        self.u_reference = np.hstack([np.tile(self.tension, (len(t) - 1, 1)), q[1:, m.first_rho :]])

    @cached_property
    def by_motors(self) -> PulledSystem:
        """The system with a motor on every joint; their forces are inputs behind the tensions."""
        m = self.mechanism
        helped = m.with_elements([JointForce(name, f"motor of {name}") for name in m.dynamic])
        return PulledSystem(MidpointVI(helped, threads=self.problem.threads), self.t, at_instants=m.inputs)

    def tied(self, weight: float, *, firm: bool = False) -> TrackingPlan:
        """Return the plan with strings on bars tied with another weight; see `Ties.tied`."""
        assert self.ties is not None
        other = copy(self)
        other.ties = self.ties.tied(weight, firm=firm)
        return other

    def cost(self, *, motor: float | None = None, tied: bool = True) -> Cost:
        """Return the cost; that of the system with motors if they have a price. ``tied``: with the price of lengths."""
        system = self.system if motor is None else self.by_motors
        cost = self.problem.with_markers(self.tracking_cost(motor=motor), system)
        return cost if self.ties is None or not tied else self.ties.priced(cost, system)

    def tracking_cost(self, *, motor: float | None = None) -> TrackingCost:
        """Return the part of the cost that is quadratic in states and inputs."""
        strings, u = len(self.strings), self.u_reference
        system, motors = (self.system, []) if motor is None else (self.by_motors, [motor] * self.mechanism.nd)
        u = np.insert(u, [strings] * len(motors), 0.0, axis=1)
        weights = [self.problem.weights.tension] * strings + motors
        return self.problem.tracking_cost(system, self.x_reference, u, inputs=weights)

    def regulators(self, x: Array, u: Array) -> Iterator[Array]:
        """Yield gains with which a motion may be followed, the firmest first."""
        try:
            cost = self.cost().hessian(x, u)
            K = regulate(*linearize_along_curve(self.system, x, u), Q=cost.Q, R=cost.R, Q_final=cost.Q_final)
        except LeastActionError:
            return
        yield from (K, 0.3 * K)

    def stated(self, kinds: Collection[str] = KINDS) -> list[Limit]:
        """Return the limits of its system, of some kinds."""
        return self.limits.of(self.mechanism, self.problem.pelvis, kinds)

    def stated_in(self, report: LimitReport | None) -> bool:
        """Whether a report is of these limits: not of some, as in older runs, nor of a puppet that is held still."""
        sides = sum(len(limit.rows(self.system, 0)) for limit in self.stated())
        return report is not None and len(report.sides) == sides

    def states(self, q: Array) -> Array:
        """Return the states (N+1, nx) of a motion q (N+1, nq), whose momenta are those of its slope."""
        return self.system.states_along(q, to_momentum(self.mechanism, q, rates_along(self.mechanism, q, self.t)))

    def by_tensions(self, x: Array, u: Array) -> Curve:
        """Return a motion on strings of prescribed lengths, in states and inputs of its system, as one by tensions."""
        m, made = self.mechanism, self.problem.system.trajectory(x, u)
        pulls = made.tensions()
        tension = np.stack([pulls[string.name] for string in self.strings], axis=1)
        tension[0] *= 2.0  # the first impulse is that of half a step
        states = self.system.states_along(made.q[:, self.columns], made.p)
        return states, np.hstack([tension, states[1:, m.first_rho : m.nq]])

    def by_lengths(self, x: Array, u: Array) -> Curve:
        """Return a motion by tensions in states and inputs by lengths."""
        m, whole = self.mechanism, self.problem.mechanism
        held = held_strings(whole)
        q = np.zeros((len(x), whole.nq))
        q[:, self.columns] = x[:, : m.nq]
        lengths = string_lengths(whole, q)
        for string in held:
            q[:, whole.coordinates.index(string.length)] = lengths[:, self.strings.index(string)]
        made = self.problem.system.states_along(q, x[:, m.nq : m.nq + m.nd])
        share = np.full((len(u), 1), self.dt)
        share[0] *= 0.5
        made[1:, whole.nx :] = share * u[:, : len(self.strings)] / (2.0 * lengths[:-1])
        made[0, whole.nx :] = 2.0 * made[1, whole.nx :]
        return made, q[1:, whole.first_rho :]

    def finer(self, coarse: TrackingPlan, x: Array, u: Array) -> Curve:
        """Return a trajectory of a plan with longer steps between its instants, as a curve to start from."""
        m, strings = self.mechanism, len(self.strings)
        # The motion begins at rest.
        fine = CubicSpline(coarse.t, x, axis=0, bc_type=((1, np.zeros(x.shape[1])), "not-a-knot"))(self.t)
        fine = unit(m.coordinates, fine)
        fine[1:, m.nq + m.nd :] = np.diff(fine[:, m.first_rho : m.nq], axis=0) / self.dt
        pulls = [np.interp(self.t[:-1], coarse.t[:-1], column) for column in u.T[:strings]]
        return fine, np.hstack([np.stack(pulls, axis=1), fine[1:, m.first_rho : m.nq]])

    def inside(self, x: Array, u: Array, cost: float) -> Curve:
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

    def clipped(self, xbar: Array, ubar: Array, K: Array, off: float = 0.0) -> Curve:
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

    def hung(self) -> Curve:
        """Return what the puppet does where its strings are held, up to a step that fails."""
        return self.clipped(*self.hanging(), np.zeros((self.system.N, self.system.nu, self.system.ndx)))

    def hanging(self) -> Curve:
        """Return states and inputs of a puppet that hangs from where the motion begins."""
        m, first = self.mechanism, self.x_reference[0]
        u = np.concatenate([self.tension, first[m.first_rho : m.nq]])
        return np.tile(first, (len(self.t), 1)), np.tile(u, (self.system.N, 1))

    def _tension_at_rest(self) -> Array:
        """Return the tensions with which the strings carry the puppet as well as they can where the motion starts."""
        whole, limits, weight = self.problem.mechanism, self.limits, self.problem.weight
        q = self.problem.reference[0]
        if not len(self.strings) * limits.strength > (heavy := float(weight[whole.variables.index("torso_tz")])):
            raise ArgumentError(
                f"limits: strength is {limits.strength:g} N, and {len(self.strings)} strings of that do not carry the "
                f"puppet, which weighs {heavy:.3g} N. Allow more, or take more strings"
            )
        by_tension = whole.constraint_jacobian(q)[:, : whole.nd] / (2.0 * string_lengths(whole, q)[:, None])
        return np.asarray(lsq_linear(by_tension.T, -weight, bounds=(limits.tension, limits.strength)).x)
