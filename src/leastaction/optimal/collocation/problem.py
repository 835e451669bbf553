"""A continuous problem with limits or a free start, as the optimiser's loop sees it: one mesh after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import Mesh, PiecewisePolynomial
from leastaction.optimal.accuracy import Accuracy
from leastaction.optimal.collocation.cost import AnyCollocationCost, collocation_cost
from leastaction.optimal.collocation.limits import Stated, stated, told
from leastaction.optimal.collocation.mesh import STAGES, RadauMesh
from leastaction.optimal.collocation.own_projection import projection_on
from leastaction.optimal.collocation.system import CollocationSystem
from leastaction.optimal.continuous.cost import ContinuousCost, ContinuousQuadraticCost
from leastaction.optimal.continuous.problem import ContinuousProblem
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import ContinuousOptimizationResult, DenseTrajectory
from leastaction.optimal.discrete.direction import DiscreteDirection, Iterate
from leastaction.optimal.discrete.linear_quadratic import solve_linear_quadratic
from leastaction.optimal.limit_report import LimitReport
from leastaction.optimal.limits.barrier_problem import BarrierProblem
from leastaction.optimal.limits.limit import Limit
from leastaction.optimal.limits.problem import LimitedProblem
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.line_search import Trial
from leastaction.optimal.memory import Memory, OnMesh
from leastaction.optimal.options import Options
from leastaction.optimal.result import OptimizationResult

# Pieces of the first mesh, and of the last one at most; how often it is made finer.
_FIRST, _FIRST_MOST, _MOST, _ROUNDS = 16, 128, 1500, 9
# Error of a piece that is fine enough: of its states, in times the accuracy of integrations and in parts of the state's
# size at most; and of its inputs where they continue those of the piece before, in parts of their size.
_OF_ACCURACY, _OF_STATES, _OF_INPUTS = 1e3, 1e-5, 3e-3
_TO_STATES = 30.0  # error of the inputs in times that of the states, where that is more
_ABOVE_NOISE = 100.0  # promise of a first step on a finer mesh, in times the noise
_SHORTEST = 1e-4  # shortest piece, in parts of the horizon
_ROUGH = 1e-3  # error of a first mesh, in parts of the states' size (rms)
_AGAIN = 1e-4  # barrier parameter on a finer mesh, in parts of the first


class CollocationProblem(BarrierProblem):
    """A continuous system, its cost and its limits, on a mesh that is made finer where the motion asks for it.

    Where the minimum on one mesh is found and its pieces are too long for the motion, the next stage has shorter ones
    there. The duals go along, as functions of time.
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
    ) -> None:
        self.own = ContinuousProblem(system, cost, settings, accuracy, horizon)
        self.stated_limits, self.settings, self.free_start = tuple(limits), settings, free_start
        self.mesh: RadauMesh
        self.sides: list[Stated] = []
        self.densities: list[tuple[Array, Array, Array]] = []
        self.rounds = 0
        self.moved = True

    # ---- Where to start -------------------------------------------------------------------------

    def start(self, initial: Any) -> None:
        """Begin with a curve to be projected, that of an earlier result, or an initial state and inputs."""
        given = initial.limits if isinstance(initial, ContinuousOptimizationResult) else None
        own = self.own
        curve, is_curve = own.given(initial.dense if isinstance(initial, ContinuousOptimizationResult) else initial)
        if not is_curve:
            own.apply(curve)
            curve = own.trajectory
        inner = self._times(curve.t0, curve.tf)
        if given is not None:
            self.densities = _densities(given)
        pieces = _FIRST
        while pieces < _FIRST_MOST and _misses(curve, RadauMesh.first(curve.t0, curve.tf, inner, pieces)):
            pieces *= 2
        failure: ArgumentError | None = None
        for _ in range(3):
            try:
                self._lay(RadauMesh.first(curve.t0, curve.tf, inner, pieces), curve)
            except ArgumentError as error:
                failure, pieces = error, 2 * pieces
                continue
            return
        assert failure is not None
        raise failure

    def resume(self, result: OptimizationResult) -> None:
        own = self.own
        own.resume(result)
        self._times(own.trajectory.t0, own.trajectory.tf)
        mesh = None if result.memory is None else result.memory.mesh
        if mesh is None:
            raise ArgumentError(
                "resume: got a result that was not found on a mesh, expected one with the limits of this call. Give it "
                "as initial"
            )
        self._set(RadauMesh(mesh.breaks))
        self.x, self.u, self.gain = mesh.x, mesh.u, mesh.gain
        self.value, self.rounds = self.cost.value(self.x, self.u), mesh.rounds
        self._begin(resumed=True)
        if result.limits is not None or self.sides:
            self._restore(result.limits)
        self.moved = mesh.moved

    def _times(self, t0: float, tf: float) -> list[float]:
        """Return the times that have to be ends of pieces: where something jumps, or limits are asked alone."""
        inner = list(self.own.jumps)
        for limit in self.stated_limits:
            at: Any = limit.at
            for time in [at] if isinstance(at, (str, int, float)) else at or ():
                if isinstance(time, (str, bool)):
                    continue
                if not t0 <= float(time) <= tf:
                    raise ArgumentError(f"{limit}: got at={time!r}, expected a time from {t0:g} to {tf:g} s")
                inner.append(float(time))
        return inner

    def _lay(self, mesh: RadauMesh, curve: DenseTrajectory) -> None:
        """Begin on a mesh, at the motion on it that follows a curve."""
        self._set(mesh)
        x, u = self._nodes(curve)
        BarrierProblem.start(self, (x, u))
        self._carry()
        self.moved = self.rounds == 0

    def accept(self, direction: DiscreteDirection, trial: Trial[Iterate]) -> None:
        super().accept(direction, trial)
        self.moved = True

    def _set(self, mesh: RadauMesh) -> None:
        """Take a mesh."""
        own = self.own
        system = CollocationSystem(own.system, mesh)
        self.mesh = mesh
        self.sides = stated(self.stated_limits, own.system, mesh, 1 if self.free_start is False else 0)
        cost = collocation_cost(own.cost, mesh, system.layout)
        clock, rollouts = getattr(self, "clock", own.clock), self.rollouts
        settings = self.settings
        if own.projection is not None:
            settings = settings.changed(projection=projection_on(own.projection, own.system, mesh, system.layout))
        super().__init__(system, cost, list(_rows(self.sides)), settings, self.free_start)
        self.clock, self.rollouts = clock, rollouts

    def _with(self, rows: list[Rows], settings: Options) -> LimitedProblem:
        return LimitedProblem(self.system, self.cost, rows, settings, self.free_start)

    def _nodes(self, curve: DenseTrajectory) -> tuple[Array, Array]:
        """Return states and inputs of the discrete system along a curve."""
        mesh, layout = self.mesh, self.layout
        x, u = curve.sample(mesh.t.ravel())
        x, u = x.reshape(mesh.N, STAGES, -1), u.reshape(mesh.N, STAGES, -1)
        z = np.zeros((mesh.N + 1, layout.nz))
        z[0, : layout.nx] = curve.sample(mesh.breaks[:1])[0][0]
        z[1:] = layout.joined(x, u)
        return z, u.reshape(mesh.N, -1)

    @property
    def layout(self) -> Any:
        """Where states and inputs of points are."""
        return self.system.layout  # type: ignore[attr-defined]

    def _set_out(self) -> None:
        super()._set_out()
        # Along a limit that is bent there is a way down from a saddle as far as its barrier is soft: later, none.
        self.tells_saddles |= self.system.has_curvature and bool(self.limited.others)

    # ---- Meshes ---------------------------------------------------------------------------------

    def tolerated(self, goal: float) -> float:
        """Return the expected decrease that is small enough: on a finer mesh a step is made, or it were for nothing."""
        enough = super().tolerated(goal)
        return enough if self.moved else min(enough, _ABOVE_NOISE * self.noise)

    def next_stage(self, *, moved: bool = True) -> bool:
        """Go on with dearer excess or a smaller barrier, or else with shorter pieces where the motion asks for them."""
        if super().next_stage(moved=moved):
            return True
        if self.rounds >= _ROUNDS or not self.stages.are_met(self._limits()):
            return False
        coarse = self._coarse()
        mesh = self.mesh.halved(coarse)
        if not coarse.any() or mesh.N > _MOST:
            return False
        before = vars(self).copy()
        try:
            self._refine(mesh)
        except KeyboardInterrupt:  # it stands where it stood, as a whole
            vars(self).clear()
            vars(self).update(before)
            raise
        return True

    def _refine(self, mesh: RadauMesh) -> None:
        """Go on with the motion found so far on a finer mesh."""
        self.rounds += 1
        curve, self.densities = self.curve(), _densities(self._told())
        before = self.mesh
        try:
            self._lay(mesh, curve)
        except ArgumentError:
            # The motion on the mesh before is an answer; a finer one could not be set out on.
            self._lay(before, curve)
            self.rounds = _ROUNDS

    def _coarse(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which pieces are too long."""
        mesh, system = self.mesh, self.own.system
        rtol = self.own.accuracy.rtol
        tolerance = max(min(_OF_ACCURACY * rtol, _OF_STATES), rtol)
        curve = self.curve()
        t = mesh.between()
        x, u = curve.sample(t.ravel())
        slopes = curve.x.derivative()(t.ravel())
        rates = system.rates(x, u, t.ravel())
        states, inputs = self.layout.points(self.x[1:])
        size = np.abs(states).max(axis=(0, 1))
        size = np.maximum(size, 1e-3 * size.max(initial=0.0)) + 1e-9
        off = np.abs(slopes - rates).reshape(*t.shape, -1).max(axis=1) * mesh.h[:, None] / size
        reach = np.abs(inputs).max(axis=(0, 1)) + 1e-12
        rough = (mesh.leaps(inputs) > max(_OF_INPUTS, _TO_STATES * rtol) * reach).any(axis=1)
        # What does not continue may be the fault of either side.
        rough[:-1] |= rough[1:]
        long = mesh.h > _SHORTEST * (mesh.breaks[-1] - mesh.breaks[0])
        return np.asarray(long & ((off > tolerance).any(axis=1) | rough))

    def curve(self) -> DenseTrajectory:
        """Return the current iterate as functions of time."""
        nx = self.own.system.nx
        states, inputs = self.layout.points(self.x[1:])
        return DenseTrajectory(self.mesh.curve(self.x[0, :nx], states, inputs), nx)

    # ---- Duals ----------------------------------------------------------------------------------

    def _carry(self) -> None:
        """Take the duals of the mesh before, as functions of time."""
        densities, self.densities = self.densities, []
        duals, stages = self.duals, self.stages
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
        self._set_out()

    def _restore(self, given: LimitReport | None) -> None:
        """Go on with the duals of an earlier run."""
        if given is None:
            raise ArgumentError("resume: got a result without limits, expected those of this call. Give it as initial")
        if given.labels != self._told().labels:
            raise ArgumentError(
                f"resume: got a result with the limits {', '.join(given.labels[:4])} ..., expected those of this "
                "call. Give initial=result to start from its trajectory with others"
            )
        barrier, stages = given.barrier, self.stages
        if barrier is None or barrier.duals.size != sum(y.size for y in self.duals.y):
            self.densities = _densities(given)
            self._carry()
            return
        stages.size, stages.first_mu = barrier.size, barrier.first_mu
        stages.last = barrier.last_mu
        self.duals.restore(given.mu, barrier)
        self.values = None  # they may have been lent other leeway
        self._set_out()

    # ---- What is told ---------------------------------------------------------------------------

    def arrays(self) -> tuple[Array, Array]:
        """Return states and inputs at the ends of the pieces."""
        inputs = self.layout.points(self.x[1:])[1]
        return self.x[:, : self.own.system.nx].copy(), self.mesh.inputs_at_breaks(inputs)

    def result(self, summary: dict[str, Any]) -> ContinuousOptimizationResult:
        own = self.own
        own.trajectory = self.curve()
        own.gain = own.feedback = self._gains()
        found = own.result(summary)
        # At the end of a piece the input is that of its last point: the next piece's polynomial may stand beside it.
        u = found.u.copy()
        u[1:] = self.layout.points(self.x[1:])[1][:, -1]
        mesh = OnMesh(self.mesh.breaks, self.x, self.u, self.gain.copy(), self.rounds, self.moved)
        return replace(found, u=u, limits=self._told() if self.sides else None, memory=Memory(mesh=mesh))

    def _gains(self) -> PiecewisePolynomial:
        """Return the gains of the cost's own regulator, without limits, and no feedforward, as functions of time."""
        own, mesh = self.own, self.mesh
        nx, nu = own.system.nx, own.system.nu
        even = ContinuousQuadraticCost(np.zeros(nx), np.zeros(nu), Q=np.ones(nx), R=np.ones(nu), Q_final=np.ones(nx))
        for cost in (own.cost, even):
            Q, R, S, Q_final = AnyCollocationCost(cost, mesh, self.layout).hessian(self.x, self.u)
            solution = solve_linear_quadratic(*self._linearize(), Q=Q, R=R, S=S, Q_final=Q_final, keep_P=True)
            if solution.definite:
                break
        assert solution.P is not None
        # What the piece before costs is no part of the cost to go.
        P = solution.P[:, :nx, :nx] - np.concatenate([Q, Q_final[None]])[:, :nx, :nx]
        P[-1] += cost.final_hessian(self.x[-1, :nx], float(mesh.breaks[-1]))
        curve = own.trajectory

        def gains(t: Array, P: Array) -> tuple[Array, Array]:
            """Return K, and the slope of P."""
            x, u = curve.sample(t)
            A, B = own.system.linearize(x, u, t)
            Q, R, S = cost.hessian(x, u, t)
            right = B.transpose(0, 2, 1) @ P
            if S is not None:
                right += S.transpose(0, 2, 1)
            K = np.asarray(np.linalg.solve(R, right), dtype=np.float64)
            pull = P @ A
            return K, right.transpose(0, 2, 1) @ K - Q - pull - pull.transpose(0, 2, 1)

        # Between the ends of a piece P is the cubic that has its values and slopes there.
        h, fine = mesh.h[:, None, None, None], Mesh(mesh.breaks)
        begin, end = (gains(t, at)[1][:, None] for t, at in ((mesh.breaks[:-1], P[:-1]), (mesh.t[:, -1], P[1:])))
        s = ((fine.t.reshape(mesh.N, -1) - mesh.breaks[:-1, None]) / mesh.h[:, None])[:, :, None, None]
        step = P[1:, None] - P[:-1, None]
        between = P[:-1, None] + s * s * (3.0 - 2.0 * s) * step
        between = between + h * s * (1.0 - s) * ((1.0 - s) * begin - s * end)
        K = gains(fine.t, between.reshape(-1, nx, nx))[0].reshape(len(fine.t), -1)
        return fine.fit(np.hstack([K, np.zeros((len(K), nu))]), (nu * nx + nu,))

    def _told(self) -> LimitReport:
        """Return the report of the limits as they were stated."""
        report = self.report()
        return replace(report, sides=told(self.sides, report.sides, self.mesh))


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


def _densities(report: LimitReport) -> list[tuple[Array, Array, Array]]:
    """Return times, duals and prices of what was stated."""
    return [(side.t, side.dual, side.price) for side in report.sides if side.t is not None]
