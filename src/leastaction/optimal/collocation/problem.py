"""A continuous problem on a mesh: one discrete problem after the other, with shorter pieces where it needs them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import changed
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.charts import CostInCharts
from leastaction.optimal.collocation.cost import collocation_cost
from leastaction.optimal.collocation.gains import regulator_along
from leastaction.optimal.collocation.limits import Stated, stated, told
from leastaction.optimal.collocation.mesh import STAGES, RadauMesh
from leastaction.optimal.collocation.own_projection import projection_on
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.iterates.curve import Gapped
from leastaction.optimal.iterates.here import Here
from leastaction.optimal.iterates.work import Work
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.merit import BarrierMerit
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.search.grid import TimeGrid
from leastaction.optimal.search.problem import DiscreteProblem
from leastaction.optimal.state import OnMesh, Place, SearchState
from leastaction.optimal.system import Linearization

# Pieces of the first mesh, and of the last one at most; how often it is made finer.
_FIRST, _FIRST_MOST, _MOST, _ROUNDS = 16, 128, 1500, 9
# Error of a piece that is fine enough: of its states, in times the accuracy of integrations and in parts of the state's
# size at most; and of its inputs where they continue those of the piece before, in parts of their size.
_OF_ACCURACY, _OF_STATES, _OF_INPUTS = 1e3, 1e-5, 3e-3
_FELT = 1e-3  # change of states by a step of inputs over a piece that is none, in parts of their error
_TO_STATES = 30.0  # error of the inputs in times that of the states, where that is more
_ABOVE_NOISE = 100.0  # promise of a first step on a finer mesh, in times the noise
_JUMP = 0.1  # step of an input from one piece to the next, in parts of its size, that no polynomial follows
_SHORTEST = 1e-4  # shortest piece, in parts of the horizon
_ROUGH = 1e-3  # error of a first mesh, in parts of the states' size (rms)
_AGAIN = 1e-4  # barrier parameter on a finer mesh, in parts of the first

Densities = list[tuple[Array, Array, Array]]
"""Times, duals and prices of limits as they were stated."""


class Collocation:
    """A continuous system, its cost and its limits, to be put on meshes.

    ``own``: the problem without a mesh, which tells of the horizon and of a first trajectory. ``first``: the first
    point at which states are limited; the start where that is free, if left out. ``final_time``,
    ``gapped``: as of `DiscreteProblem`.
    """

    def __init__(
        self,
        system: ContinuousSystem,
        cost: ContinuousCost,
        limits: Sequence[Limit],
        settings: Options,
        accuracy: Accuracy,
        horizon: tuple[float, float] | None,
        free_start: bool | Sequence[str],
        *,
        first: int | None = None,
        final_time: int | None = None,
        gapped: Gapped = "never",
    ) -> None:
        self.own = ContinuousProblem(system, cost, settings, accuracy, horizon)
        self.limits, self.settings, self.free_start = tuple(limits), settings, free_start
        self.first = first if first is not None else 1 if free_start is False else 0
        self.final_time, self.gapped = final_time, gapped

    def start(self, initial: Any) -> DiscreteProblem:
        """Begin with a curve to be projected, that of an earlier result, or an initial state and inputs."""
        given = initial.limits if isinstance(initial, ContinuousOptimizationResult) else None
        own = self.own
        curve, is_curve = own.given(initial.dense if isinstance(initial, ContinuousOptimizationResult) else initial)
        if not is_curve:
            own.apply(curve)
            curve = own.here.trajectory
        inner, densities = self._times(curve.t0, curve.tf), [] if given is None else _densities(given)
        pieces = _FIRST
        while pieces < _FIRST_MOST and _misses(curve, RadauMesh.first(curve.t0, curve.tf, inner, pieces)):
            pieces *= 2
        failure: ArgumentError | None = None
        for _ in range(3):
            grid = MeshGrid(self, RadauMesh.first(curve.t0, curve.tf, inner, pieces))
            try:
                return grid.start(curve, densities)
            except ArgumentError as error:
                failure, pieces = error, 2 * pieces
        assert failure is not None
        raise failure

    def resume(self, result: OptimizationResult) -> DiscreteProblem:
        """Begin where an earlier run ended."""
        own = self.own
        own.resume(result)
        self._times(own.here.trajectory.t0, own.here.trajectory.tf)
        mesh = mesh_of(result, "limits")
        grid = MeshGrid(self, RadauMesh(mesh.breaks), mesh.rounds)
        problem = grid.resume(mesh, result)
        grid.moved = mesh.moved
        return problem

    def _times(self, t0: float, tf: float) -> list[float]:
        """Return the times that have to be ends of pieces: where something jumps, or limits are asked alone."""
        inner = list(self.own.models.jumps)
        for limit in self.limits:
            at: Any = limit.at
            for time in [at] if isinstance(at, (str, int, float)) else at or ():
                if isinstance(time, (str, bool)):
                    continue
                if not t0 <= float(time) <= tf:
                    raise ArgumentError(f"{limit}: got at={time!r}, expected a time from {t0:g} to {tf:g} s")
                inner.append(float(time))
        return inner


class MeshGrid(TimeGrid):
    """The pieces of a horizon.

    Where the minimum on one mesh is found and its pieces are too long for the motion, the next problem has shorter ones
    there. The duals go along, as functions of time.

    ``whole``: what is on the mesh. ``rounds``: how often it was made finer. ``moved``: whether a step was made on this
    one by an earlier run, or none need be.
    """

    is_mesh = True

    def __init__(self, whole: Collocation, mesh: RadauMesh, rounds: int = 0) -> None:
        self.whole, self.mesh, self.rounds = whole, mesh, rounds
        self.moved = rounds == 0
        own = whole.own
        self.system = CollocationSystem(own.system, mesh)
        self.sides = stated(whole.limits, own.system, mesh, whole.first)

    # ---- The problem on it ------------------------------------------------------------------------

    def _problem(self, x: Array, u: Array) -> DiscreteProblem:
        """Return the problem; a projection that was given is one about states and inputs of the discrete system."""
        whole = self.whole
        settings = whole.settings
        cost: Cost = collocation_cost(whole.own.cost, self.mesh, self.system.layout)
        if self.system.space is not None:
            cost = CostInCharts(cost, self.system.space)
        given = whole.own.models.projection
        if given is not None:
            settings = settings.changed(projection=projection_on(given, self.system, x, u))
        return DiscreteProblem(
            self.system, cost, settings, list(_rows(self.sides)), whole.free_start,
            whole.gapped, final_time=whole.final_time, grid=self,
            finer=self.finer, results=self.result,
            work=Work(self.system.N, self.system.ndx, self.system.nu, clock=whole.own.report.clock),
        )  # fmt: skip

    def start(
        self,
        curve: DenseTrajectory,
        densities: Densities,
        before: Work | None = None,
        reach: tuple[PiecewisePolynomial, PiecewisePolynomial] | None = None,
    ) -> DiscreteProblem:
        """Return the problem at the motion that follows a curve.

        ``densities``: of its limits, where these are known. ``before``: where another mesh was worked on. ``reach``:
        the least and largest inputs (nu,) that the pieces of that had at their points.
        """
        nodes = self._nodes(curve, reach)
        problem = self._problem(*nodes)
        if before is not None:
            problem.parts.work.count_on(before)
        problem.start(nodes)
        if problem.parts.barrier is not None:
            self._carry(problem, problem.parts.barrier, densities)
        return problem

    def resume(self, mesh: OnMesh, result: OptimizationResult) -> DiscreteProblem:
        """Return the problem where an earlier run ended."""
        problem = self._problem(mesh.x, mesh.u)
        here, gaps = problem.parts.here, None if result.state is None else result.state.gaps
        here.move(mesh.x, mesh.u, None)
        here.gain, here.value = mesh.gain, problem.parts.plain.cost.value(mesh.x, mesh.u)
        if result.state is not None:
            problem.beginning.recall(result.state.begun)
        if gaps is not None:
            problem.beginning.recall_gaps(gaps)
        problem.beginning.put_limits_in(resumed=True)
        if result.limits is not None or self.sides:
            self._restore(problem, result.limits)
        return problem

    def _nodes(
        self, curve: DenseTrajectory, reach: tuple[PiecewisePolynomial, PiecewisePolynomial] | None
    ) -> tuple[Array, Array]:
        """Return states and inputs of the discrete system along a curve, these within their reach."""
        mesh, layout = self.mesh, self.system.layout
        x, u = curve.sample(mesh.t.ravel())
        if reach is not None:
            # Where inputs jump, the polynomial through their values swings beyond them.
            u = np.clip(u, *(side(mesh.t.ravel()) for side in reach))
        x, u = x.reshape(mesh.N, STAGES, -1), u.reshape(mesh.N, STAGES, -1)
        z = np.zeros((mesh.N + 1, layout.nz))
        z[0, : layout.nx] = start = curve.sample(mesh.breaks[:1])[0][0]
        if self.system.space is not None:
            z[0, : STAGES * layout.nx] = np.tile(start, STAGES)  # numbers that are states
        z[1:] = layout.joined(x, u)
        return z, u.reshape(mesh.N, -1)

    # ---- Finer meshes -----------------------------------------------------------------------------

    def tolerated(self, goal: float, here: Here) -> float:
        """Return the expected decrease that is small enough: on a finer mesh a step is made, or it were for nothing."""
        return goal if self.moved or here.moved else min(goal, _ABOVE_NOISE * here.noise)

    def finer(self, problem: DiscreteProblem) -> DiscreteProblem | None:
        """Return the problem with shorter pieces where the motion asks for them."""
        limits = problem.parts.limits
        if self.rounds >= _ROUNDS or not (limits is None or limits.stages.are_met(limits.limits())):
            return None
        coarse = self._coarse(problem.parts.here)
        mesh = self.mesh.halved(coarse)
        if not coarse.any() or mesh.N > _MOST:
            return None
        curve, densities = self.curve(problem.parts.here.x), _densities(self._report(problem))
        reach = self._reach(problem.parts.here)
        try:
            following = MeshGrid(self.whole, mesh, self.rounds + 1).start(curve, densities, problem.parts.work, reach)
        except ArgumentError:
            # The motion on the mesh before is an answer; a finer one could not be set out on.
            following = MeshGrid(self.whole, self.mesh, _ROUNDS).start(curve, densities, problem.parts.work, reach)
        return following

    def _reach(self, here: Here) -> tuple[PiecewisePolynomial, PiecewisePolynomial]:
        """Return the least and largest inputs that pieces have at their points, where these jump; else no bounds."""
        inputs = self.system.layout.points(here.x[1:])[1]
        jumps = self.mesh.leaps(inputs) > _JUMP * np.abs(inputs).max(axis=(0, 1))
        jumps[:-1] |= jumps[1:]
        sides = inputs.min(axis=1), inputs.max(axis=1)
        held = [np.where(jumps, side, far)[:, None] for side, far in zip(sides, (-np.inf, np.inf), strict=True)]
        least, most = (PiecewisePolynomial(self.mesh.breaks, each, each.shape[2:]) for each in held)
        return least, most

    def _coarse(self, here: Here) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which pieces are too long."""
        mesh, system = self.mesh, self.whole.own.system
        rtol = self.whole.own.accuracy.rtol
        tolerance = max(min(_OF_ACCURACY * rtol, _OF_STATES), rtol)
        curve = self.curve(here.x)
        t = mesh.between()
        x, u = curve.sample(t.ravel())
        slopes = curve.x.derivative()(t.ravel())
        rates = system.rates(x, u, t.ravel())
        states, inputs = self.system.layout.points(here.x[1:])
        size = np.abs(states).max(axis=(0, 1))
        size = np.maximum(size, 1e-3 * size.max(initial=0.0)) + 1e-9
        off = np.abs(slopes - rates).reshape(*t.shape, -1).max(axis=1) * mesh.h[:, None] / size
        reach, leaps = np.abs(inputs).max(axis=(0, 1)), mesh.leaps(inputs)
        rough = leaps > max(_OF_INPUTS, _TO_STATES * rtol) * reach
        # Where inputs are not wanted they are rounding, of any shape: what states do not feel is smooth.
        at = states.reshape(-1, system.nx), inputs.reshape(-1, system.nu), mesh.t.ravel()
        pushes = np.abs(Linearization(*system.linearize(*at)).B).reshape(mesh.N, STAGES, *at[0].shape[1:], -1)
        felt = np.einsum("nij,nj->nij", pushes.max(axis=1), leaps * mesh.h[:, None]) / size[:, None]
        rough = (rough & (felt.max(axis=1) > _FELT * tolerance)).any(axis=1)
        # What does not continue may be the fault of either side.
        rough[:-1] |= rough[1:]
        long = mesh.h > _SHORTEST * (mesh.breaks[-1] - mesh.breaks[0])
        return np.asarray(long & ((off > tolerance).any(axis=1) | rough))

    def curve(self, x: Array) -> DenseTrajectory:
        """Return a trajectory (N+1, nz) as functions of time."""
        nx = self.whole.own.system.nx
        states, inputs = self.system.layout.points(x[1:])
        return DenseTrajectory(self.mesh.curve(x[0, :nx], states, inputs), nx)

    # ---- Duals ------------------------------------------------------------------------------------

    def _carry(self, problem: DiscreteProblem, limits: BarrierMerit, densities: Densities) -> None:
        """Take the duals of another mesh, as functions of time."""
        duals, stages = limits.duals, limits.stages
        if len(densities) != sum(1 for side in self.sides if not side.is_second):
            return
        i = 0
        own = iter(densities)
        for side in self.sides:
            if side.is_second:
                continue
            times, values, price = next(own)
            if values.shape[1] != len(side.rows[0].labels):
                return
            for rows, points in zip(side.rows, side.points, strict=True):
                weight = self.mesh.weights_of_points[points][:, None] if side.along else 1.0
                at = self.mesh.points[points]
                duals.rho[i] = price.copy()
                net = weight * np.stack([np.interp(at, times, column) for column in values.T], axis=1)
                if rows.equal:
                    duals.rho[i + 1] = price.copy()
                    half = 0.5 * duals.rho[i]
                    for row, sign in ((i, 1.0), (i + 1, -1.0)):
                        duals.y[row] = half + 0.5 * sign * np.clip(net, -1.8 * half, 1.8 * half)
                    i += 2
                else:
                    duals.y[i] = np.clip(net, 1e-9 * duals.rho[i], 0.9 * duals.rho[i])
                    i += 1
        duals.settle_prices()
        duals.mu = max(_AGAIN * stages.first_mu, stages.last)
        problem.parts.set_out()

    def _restore(self, problem: DiscreteProblem, given: LimitReport | None) -> None:
        """Go on with the duals of an earlier run."""
        if given is None:
            raise ArgumentError("resume: got a result without limits, expected those of this call. Give it as initial")
        limits = problem.parts.limits
        labels = () if limits is None else self._report(problem).labels
        if limits is None or given.labels != labels:
            raise ArgumentError(
                f"resume: got a result with the limits {', '.join(given.labels[:4])} ..., expected those of this "
                "call. Give initial=result to start from its trajectory with others"
            )
        barrier, stages = given.barrier, limits.stages
        if barrier is None or barrier.duals.size != limits.duals.y.flat.size:
            self._carry(problem, limits, _densities(given))
            return
        stages.size, stages.first_mu = barrier.size, barrier.first_mu
        stages.last = barrier.last_mu
        limits.duals.restore(given.mu, barrier)
        limits.forget_leeway()  # they may have been lent another
        problem.parts.set_out()

    # ---- What is told -----------------------------------------------------------------------------

    def arrays(self, here: Here) -> tuple[Array, Array]:
        """Return states and inputs at the ends of the pieces."""
        inputs = self.system.layout.points(here.x[1:])[1]
        return here.x[:, : self.whole.own.system.nx].copy(), self.mesh.inputs_at_breaks(inputs)

    def result(self, problem: DiscreteProblem, summary: dict[str, Any]) -> ContinuousOptimizationResult:
        """Return the result at the current iterate, in continuous time."""
        own, here, begun = self.whole.own, problem.parts.here, problem.beginning.begun
        before = begun.earlier if here.is_open else None
        at = before or here.place()
        own.here.trajectory = motion = self.curve(at.x)
        gain = regulator_along(own.system, own.cost, motion, own.models.jumps, own.accuracy)
        own.here.gain = own.models.feedback = gain
        found = own.report.result(summary)
        # At the end of a piece the input is that of its last point: the next piece's polynomial may stand beside it.
        u = found.u.copy()
        u[1:] = self.system.layout.points(at.x[1:])[1][:, -1]
        mesh = OnMesh(self.mesh.breaks, at.x, at.u, at.gain, self.rounds, self.moved or here.moved)
        limits = self._report(problem, before) if self.sides else None
        curve = problem.parts.curve
        begun = changed(begun, ease=problem.parts.ease)
        state = SearchState(begun=begun, mesh=mesh, gaps=None if curve is None else curve.state())
        found = replace(found, u=u, limits=limits, gap=here.gap, state=state)
        if before is None:
            return found
        return replace(found, cost=problem.parts.asked.value(before.x, before.u), gap=0.0)

    def _report(self, problem: DiscreteProblem, at: Place | None = None) -> LimitReport:
        """Return the report of the limits as they were stated; ``at``: as of `BarrierMerit`."""
        if problem.parts.limits is None:
            return LimitReport((), np.nan, 0.0)
        report = problem.parts.report(at)
        return replace(report, sides=told(self.sides, report.sides, self.mesh))


def mesh_of(result: OptimizationResult, what: str) -> OnMesh:
    """Return where a result stands on its mesh, or complain where it was found on none; ``what``: a new one has."""
    if result.state is None or result.state.mesh is None:
        raise ArgumentError(
            f"resume: got a result that was not found on a mesh, expected one with the {what} of this call. Give it as "
            "initial"
        )
    return result.state.mesh


def _misses(curve: DenseTrajectory, mesh: RadauMesh) -> bool:
    """Return whether the polynomials of a mesh miss the states of a curve by more than those of a first one may."""
    x = curve.x(mesh.t)
    again = mesh.curve(curve.x.flat(curve.t0), x, np.zeros((*mesh.t.shape, 0)))
    between = mesh.between().ravel()
    off = np.sqrt(np.mean((again(between) - curve.x(between)) ** 2, axis=0))
    return bool((off > _ROUGH * (1e-9 + np.abs(x).max(axis=(0, 1)))).any())


def _rows(sides: Sequence[Stated]) -> Iterator[Rows]:
    """Return the rows of the discrete system; both sides of equations one after the other."""
    for i, side in enumerate(sides):
        if side.is_second:
            continue
        for j, rows in enumerate(side.rows):
            yield rows
            if rows.equal:
                yield sides[i + 1].rows[j]


def _densities(report: LimitReport) -> Densities:
    """Return times, duals and prices of what was stated."""
    return [(side.t, side.dual, side.price) for side in report.sides if side.t is not None]
