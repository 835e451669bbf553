"""An optimisation in continuous time with unknowns beside the inputs, as one of an extended system on a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.problem import Collocation, mesh_of
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory, OverTime
from leastaction.optimal.initial import pair_of
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.limit import Bound, Limit
from leastaction.optimal.loop import Callback
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult, Status
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.unknowns.conditions import is_of_unknowns, off_the_border
from leastaction.optimal.unknowns.continuous.cost import ExtendedContinuousCost
from leastaction.optimal.unknowns.continuous.limits import OfCondition, OfOwnStates, OfUnknowns
from leastaction.optimal.unknowns.continuous.system import ExtendedContinuousSystem
from leastaction.optimal.unknowns.extended import told_in_own_states
from leastaction.optimal.unknowns.periodic import Periodic
from leastaction.optimal.unknowns.unknown import Unknown

_NO_TIME = 1e-2  # of the horizon that a search begins with: in less a motion is not looked for


class ContinuousExtension:
    """A continuous system with unknowns, to be put on meshes, and the way there and back for all that is returned.

    The horizon of the search is that of what it begins with; ``system`` is the extended one, once it has begun.
    """

    system: ExtendedContinuousSystem

    def __init__(
        self,
        system: ContinuousSystem,
        cost: ContinuousCost,
        unknowns: Sequence[Unknown],
        limits: Sequence[Limit],
        settings: Options,
        accuracy: Accuracy,
        horizon: tuple[float, float] | None,
        free_start: bool | Sequence[str],
    ) -> None:
        self.own, self.cost, self.unknowns, self.limits = system, cost, tuple(unknowns), tuple(limits)
        self.settings, self.accuracy, self.horizon, self.free_start = settings, accuracy, horizon, free_start
        self.first = 1 if free_start is False else 0
        self.names = [each.name for each in unknowns]
        for each in unknowns:
            each.value_of(system, (-np.inf, np.inf))  # names that are not known are said at once
        copied = {i for limit in limits if isinstance(limit, Periodic) for i in limit.entries(system)}
        self.copied = sorted(copied) if self.first == 0 else []

    # ---- There ------------------------------------------------------------------------------------

    def start(self, initial: Any) -> DiscreteProblem:
        """Begin with a curve to be projected, that of an earlier result, or an initial state and inputs."""
        found = initial if isinstance(initial, ContinuousOptimizationResult) else None
        own = ContinuousProblem(self.own, self.cost, self.settings, self.accuracy, self.horizon)
        curve, is_curve = own.given(initial if found is None else found.dense)
        guess = self._begun(curve.t0, curve.tf, {} if found is None else found.unknowns)
        problem = self._collocation(guess, curve.t0, curve.tf)
        if not is_curve:
            x, u = pair_of(initial)
            x0 = as_array(np.asarray(x), "initial x", (self.own.nx,), meaning="(nx,)")
            self._check(self.system.extended(x0, guess), curve)
            return problem.start((self.system.extended(x0, guess), u))
        dense = self._extended(curve, guess)
        self._check(dense.xu.flat(curve.t0)[: dense.nx], curve)
        return problem.start(
            dense if found is None else replace(found, over_time=replace(found.over_time, dense=dense))
        )

    def resume(self, result: OptimizationResult) -> DiscreteProblem:
        """Begin where an earlier run ended, on the horizon on which that had begun."""
        assert isinstance(result, ContinuousOptimizationResult)
        missing = [name for name in self.names if name not in result.unknowns]
        others = [name for name in result.unknowns if name not in self.names]
        if missing or others:
            raise ArgumentError(
                f"resume: got a result {'without' if missing else 'with'} the unknown {(missing or others)[0]!r}, "
                "expected those of this call; give initial=result instead"
            )
        mesh = mesh_of(result, "unknowns")
        t0, tf = float(mesh.breaks[0]), float(mesh.breaks[-1])
        self._begun(t0, tf, result.unknowns)
        values = self.system.values(mesh.x[0])
        dense = self._extended(_over(result.dense, t0, tf), values)
        back = [float(t0 + (t - t0) / self.system.pace(values)) for t in result.jumps]
        over_time = replace(result.over_time, dense=dense, jumps=tuple(back))
        return self._collocation(self.guess, t0, tf).resume(replace(result, over_time=over_time))

    def _begun(self, t0: float, tf: float, known: Mapping[str, float]) -> Array:
        """Make the extended system over a horizon; return the guesses of its unknowns, or what is known of them."""
        values = np.array([each.value_of(self.own, (t0, tf)) for each in self.unknowns])
        self.wanted = np.array(
            [v if e.wanted is None else e.wanted for e, v in zip(self.unknowns, values, strict=True)]
        )
        guess = np.array([v if e.guess is None else e.guess for e, v in zip(self.unknowns, values, strict=True)])
        guess = np.array([known.get(name, value) for name, value in zip(self.names, guess.tolist(), strict=True)])
        self.system = ExtendedContinuousSystem(self.own, self.names, self.copied, self.free_start, (t0, tf))
        self.system.at(guess)  # values that cannot be are named before anything is done
        self.conditions = self.own.conditions_of(self.names) or []
        for condition in self.conditions:
            guess = off_the_border(condition, guess)
        self.guess = guess
        return guess

    def _collocation(self, guess: Array, t0: float, tf: float) -> Collocation:
        system = self.system
        cost = ExtendedContinuousCost(self.cost, self.unknowns, self.wanted, system)
        limits: list[Limit] = [
            OfUnknowns(Bound(each.name, each.min, each.max), self.unknowns)
            for each in self.unknowns
            if each.min is not None or each.max is not None
        ]
        for limit in self.limits:
            if isinstance(limit, Periodic):
                limits.append(limit)
            elif isinstance(limit, Bound) and is_of_unknowns(limit, self.names):
                limits.append(OfUnknowns(limit, self.unknowns))
            else:
                limits.append(OfOwnStates(limit, guess))
        limits += [OfCondition(each, system, self.unknowns, guess) for each in self.conditions]
        return Collocation(
            system, cost, limits, self._settings(), self.accuracy, (t0, tf), True,
            first=self.first, final_time=system.final_time, gapped=self._gapped,
        )  # fmt: skip

    @property
    def _gapped(self) -> Gapped:
        """When pieces may have gaps: a motion that may last longer or shorter leaves the curve that was given."""
        if not self.settings.tries_gaps:
            return "never"
        return "where left" if self.system.time_at is None else "at once"

    def _settings(self) -> Options:
        """Return options for the extended system: gains and weights of a projection act on the system's own states."""
        given, moves = self.settings.projection, self.system.moves
        if isinstance(given, PiecewisePolynomial):
            nu, nx = self.own.nu, self.own.nx
            rows = given.coefficients.reshape(*given.coefficients.shape[:2], nu, nx) @ moves
            flat = rows.reshape(*given.coefficients.shape[:2], -1)
            return self.settings.changed(projection=PiecewisePolynomial(given.breaks, flat, (nu, self.system.nx)))
        if not isinstance(given, Mapping):
            return self.settings
        weights = dict(given)
        for name in {"Q", "Q_final"}.intersection(weights):
            if callable(weights[name]):
                raise ArgumentError(
                    f"projection: {name}: got a function of time beside unknowns, expected a constant (nx,) or (nx, nx)"
                )
            n = self.own.nx
            weight = as_array(weights[name], f"projection: {name}", (n,), (n, n), meaning="(nx,) or (nx, nx)")
            weights[name] = moves.T @ (np.diag(weight) if weight.ndim == 1 else weight) @ moves
        return self.settings.changed(projection=weights)

    def _extended(self, curve: DenseTrajectory, values: Array) -> DenseTrajectory:
        """Return a curve of the system's own states as one of the extended ones."""
        n, system = self.own.nx, self.system
        own = curve.xu.coefficients
        constants = np.concatenate([values, curve.xu.flat(curve.t0)[:n][system.layout.kept]])
        states = np.zeros((*own.shape[:2], system.nx + system.nu))
        states[:, :, :n], states[:, :, system.nx :] = own[:, :, :n], own[:, :, n:]
        states[:, 0, n : system.nx] = constants
        states[:, 0, system.layout.kept] -= constants[len(values) :]
        return DenseTrajectory(PiecewisePolynomial(curve.t, states, (states.shape[2],)), system.nx)

    def _check(self, x: Array, curve: DenseTrajectory) -> None:
        """Ask for the derivatives by the unknowns, so that what they cannot be found for is said before the first step.

        Raises `ArgumentError`: from the system.
        """
        self.system.start_directions(x, None)
        with suppress(LeastActionError):  # The start need not be a trajectory.
            self.system.derivatives(read_only(x), curve.xu.flat(curve.t0)[curve.nx :], curve.t0)

    # ---- And back ---------------------------------------------------------------------------------

    def callback(self, given: Callback | None) -> Callback | None:
        """Return a callback that calls the given one with the system's own states."""
        return told_in_own_states(given, lambda x: self.system.own(x), self.result)

    def result(self, found: OptimizationResult) -> ContinuousOptimizationResult:
        """Return a result in the system's own states and the true time, with its unknowns."""
        result = cast(ContinuousOptimizationResult, found)
        system, n, nu = self.system, self.own.nx, self.own.nu
        values = system.values(result.x[0]).copy()
        own, pace = system.at(values), system.pace(values)
        t0, tf = system.t0, float(system.true_time(np.array([result.dense.tf]), values)[0])
        keep = (np.arange(nu)[:, None] * system.nx + np.arange(n)).ravel()
        feedback = result.feedback.part(keep, (nu, n))
        law = np.concatenate([keep, nu * system.nx + np.arange(nu)])
        states = result.dense.xu.coefficients
        x = states[:, :, :n].copy()
        x[:, :, system.layout.kept] += states[:, :, system.layout.at_copies : system.nx]
        curve = np.concatenate([x, states[:, :, system.nx :]], axis=2)
        dense = DenseTrajectory(PiecewisePolynomial(result.dense.t, curve, (n + nu,)), n)
        message = result.message
        if result.status is Status.INFEASIBLE and tf - t0 < _NO_TIME * system.lasts:
            message += (
                f" The final time went to {tf - t0:.2g} s, where no input moves anything: give it a least value, "
                f"FinalTime(min=...), or begin with a longer horizon than {system.lasts:g} s."
            )
        return replace(
            result,
            message=message,
            x=read_only(system.own(result.x)),
            K=np.ascontiguousarray(result.K[:, :, :n]),
            projection_gain=np.ascontiguousarray(result.projection_gain[:, :, :n]),
            t=read_only(_stretched(result.t, t0, tf)),
            feedback=_stretched_function(feedback, t0, tf),
            projection=_stretched_function(result.projection.part(law, (len(law),)), t0, tf),
            over_time=OverTime(
                dense=_over(dense, t0, tf),
                accuracy=result.accuracy,
                jumps=tuple(system.true_time(np.array(result.jumps), values).tolist()),
            ),
            limits=None if result.limits is None else self._report(result.limits, len(result.t) - 1, pace, (t0, tf)),
            state_names=own.state_names,
            input_names=own.input_names,
            system=own.told(),
            unknowns=MappingProxyType(system.named(values)),
        )

    def _report(self, report: LimitReport, pieces: int, pace: float, horizon: tuple[float, float]) -> LimitReport:
        """Return a report in the true time: duals of what holds all along are by its seconds."""
        if self.system.time_at is None:
            return report
        last = float(self.system.t0 + self.system.lasts)
        sides = []
        for side in report.sides:
            assert side.t is not None
            t = horizon[0] + (side.t - horizon[0]) * ((horizon[1] - horizon[0]) / (last - horizon[0]))
            along = len(side.k) > 1 and len(side.k) >= 3 * pieces
            sides.append(replace(side, t=read_only(t), dual=read_only(side.dual / pace) if along else side.dual))
        return replace(report, sides=tuple(sides))


def _stretched(t: Array, t0: float, tf: float) -> Array:
    """Return times stretched to end at another one."""
    return np.asarray(t0 + (t - t[0]) * ((tf - t0) / (t[-1] - t[0])))


def _stretched_function(function: PiecewisePolynomial, t0: float, tf: float) -> PiecewisePolynomial:
    """Return a function of time over another horizon."""
    return PiecewisePolynomial(_stretched(function.breaks, t0, tf), function.coefficients, function.shape)


def _over(curve: DenseTrajectory, t0: float, tf: float) -> DenseTrajectory:
    """Return a curve over another horizon."""
    return DenseTrajectory(_stretched_function(curve.xu, t0, tf), curve.nx)
