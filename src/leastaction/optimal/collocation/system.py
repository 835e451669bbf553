"""A continuous system on a mesh as a discrete one: a step is a piece of the horizon."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from leastaction.errors import LeastActionError, StepError
from leastaction.numerics.arrays import Array, read_only
from leastaction.optimal.collocation.charts import in_charts, space_on_mesh
from leastaction.optimal.collocation.mesh import MATRIX, ORDER, PLACE, STAGES, NodeLayout, RadauMesh
from leastaction.optimal.collocation.piece import (
    Factors,
    factored,
    newton_matrix,
    slopes_of_points,
    solved,
    solved_each,
)
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.discrete.step_by_step import make_step
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.space import moved_by
from leastaction.optimal.system import Linearization

# Most iterations for a piece; largest residual, in parts of the states, of points that are a trajectory's.
_MOST_ITERATIONS, _RESIDUAL = 40, 1e-12
# A Newton matrix is used again while its steps shrink by at least the first; what they leave is below the second, of
# the state's size, or rounding, where they do not shrink any more below the third. The first is held against the last.
_SHRINKS, _CLOSE, _ROUNDING, _NEAR = 0.2, 1e-14, 1e-11, 1e-2


class CollocationSystem(DiscreteSystem):
    """The pieces of a mesh as the steps of a discrete system; as fit for several threads as the system is.

    Its input is that of all points of a piece, its state that of all points of the piece before, and their inputs: so
    what is asked of points is asked of states. What comes next depends on the first nx entries only.
    """

    def __init__(self, system: ContinuousSystem, mesh: RadauMesh) -> None:
        self.system, self.mesh = system.starting_at(float(mesh.breaks[0])), mesh
        self.layout = NodeLayout(system.nx, system.nu)
        self.nx, self.nu, self.N = self.layout.nz, STAGES * system.nu, mesh.N
        self.has_curvature = system.has_curvature
        self.space = space_on_mesh(system)

    def own_when(self, k: int) -> str:
        return f"t = {self.mesh.breaks[k]:.4g} s"

    def own_input_name(self, i: int) -> str:
        return self.system.input_name(i % self.system.nu)

    def own_time(self, k: int) -> float:
        return float(self.mesh.breaks[k])

    def own_start_directions(self, x: Array, free: Sequence[str] | None) -> Array:
        start, space = x[: self.system.nx], self.system.space
        own = self.system.start_directions(start, free)
        if space is not None:
            own = space.changes(start) @ own
        return np.vstack([own, np.zeros((self.ndx - len(own), own.shape[1]))])

    def own_moved_start(self, x: Array, dx: Array) -> Array:
        moved, nx = x.copy(), self.system.nx
        by = dx[:nx] if self.space is None else self.space.plus(x, dx)[:nx] - x[:nx]
        moved[:nx] = self.system.moved_start(x[:nx], by)
        return moved

    # ---- Steps ----------------------------------------------------------------------------------

    def f(self, x: Array, u: Array, k: int) -> Array:
        """Return the points of a piece; `StepError` where they are not found."""
        start, inputs = x[: self.system.nx], u.reshape(1, STAGES, -1)
        states = self._solve(start, inputs[0], k, np.tile(start, (STAGES, 1)))
        return np.asarray(self.layout.joined(states[None], inputs)[0])

    def own_rollout(self, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
        """Simulate pieces under a feedback, each found from where the reference has it."""
        nx = self.system.nx
        x, u = np.empty((stop - start + 1, self.nx)), np.empty((stop - start, self.nu))
        x[0] = x0
        along = self.layout.points(xbar[start + 1 : stop + 1])[0]
        matrices: Sequence[Array | None] | None = None
        size, k = STAGES * nx, start - 1
        while (k := self._rolled_out(x, u, (xbar, ubar, K), slice(start, stop), k + 1)) < stop:
            i = k - start
            if matrices is None:
                matrices = self._matrices_along(along, ubar[start:stop], slice(start, stop))
            off = self.difference(x[i], xbar[k])
            u[i] = ubar[k] - K[k] @ off
            inputs = u[i].reshape(STAGES, -1)
            try:
                with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                    states = self._solve(x[i, :nx], inputs, k, self._moved(along[i], off), matrices[i])
            except StepError:
                failure = make_step(self, read_only(x[i]), read_only(u[i]), k, x[i + 1])
                if failure is not None:
                    return Rollout(x[: i + 1], u[:i], i, failure)
                continue
            x[i + 1, :size], x[i + 1, size:] = states[ORDER].ravel(), u[i]
        return Rollout(x, u, stop - start)

    def own_step_each(self, x: Array, u: Array) -> Rollout:
        """Make every piece of a curve from its own state, each found from where the curve has it."""
        nx, ends = self.system.nx, np.empty((self.N, self.nx))
        states = self.layout.points(x[1:])[0]
        matrices = self._matrices_along(states, u, slice(0, self.N))
        for k, matrix in enumerate(matrices):
            inputs = u[k].reshape(STAGES, -1)
            try:
                with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                    found = self._solve(x[k, :nx], inputs, k, states[k], matrix)
            except StepError:
                failure = make_step(self, read_only(x[k]), read_only(u[k]), k, ends[k])
                if failure is not None:
                    return Rollout(ends[:k], u[:k], k, failure)
                continue
            ends[k] = self.layout.joined(found[None], inputs[None])[0]
        return Rollout(ends, u, self.N)

    def _moved(self, states: Array, off: Array) -> Array:
        """Return states of points (STAGES, nx) moved as the end of the piece before is."""
        space = self.system.space
        return moved_by(space, states, off[: self.system.nx if space is None else space.ndx])

    def _rolled_out(self, x: Array, u: Array, curve: tuple[Array, Array, Array], pieces: slice, begin: int) -> int:
        """Let the system simulate pieces by itself from one of them on; return the first that it did not."""
        xbar, ubar, K = curve
        here, rest = slice(begin - pieces.start, None), slice(begin, pieces.stop)
        if begin == pieces.stop:
            return begin
        reference = np.ascontiguousarray(xbar[begin : pieces.stop + 1]), np.ascontiguousarray(ubar[rest])
        try:
            done = self.system.roll_out_pieces(
                self.mesh.h[rest], self.mesh.t[rest], MATRIX, reference, np.ascontiguousarray(K[rest]), x[here], u[here]
            )
            return begin + (done or 0)
        except (LeastActionError, ArithmeticError):
            return begin  # what says why is asked for one piece

    def _matrices_along(self, states: Array, u: Array, pieces: slice) -> Sequence[Array | None]:
        """Return Newton's matrices of pieces along a curve: all at once they cost little more than one alone."""
        n, nx, t = states.shape[0], self.system.nx, self.mesh.t[pieces].ravel()
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                A = self.system.slopes(states.reshape(-1, nx), u.reshape(n * STAGES, -1), t)
        except (LeastActionError, ArithmeticError):
            return [None] * n
        matrices = newton_matrix(self.mesh.h[pieces, None, None], A.reshape(n, STAGES, nx, nx))
        good = np.asarray(np.isfinite(matrices).all(axis=(1, 2))).tolist()
        return [each if fit else None for each, fit in zip(matrices, good, strict=True)]

    def _solve(self, x: Array, u: Array, k: int, states: Array, matrix: Array | None = None) -> Array:
        """Return the states (STAGES, nx) of the points of a piece by Newton's method, begun where they are given.

        ``matrix``: Newton's, of somewhere near, for as long as its steps shrink.
        """
        h, t = self.mesh.h[k], self.mesh.t[k]
        factors: Factors | None = None
        why, made, residual, before = "it takes too many iterations", 0, np.full(states.shape, np.nan), _NEAR
        try:
            if matrix is not None:
                factors = factored(matrix)
            for made in range(1, _MOST_ITERATIONS + 1):
                residual = x + h * (MATRIX @ self.system.rates(states, u, t)) - states
                if factors is None:
                    factors = factored(newton_matrix(h, self.system.slopes(states, u, t)))
                step = solved(factors, residual.ravel()).reshape(states.shape)
                states = states + step
                if not np.isfinite(states).all():
                    raise ArithmeticError("it leads to no finite state")
                size = float((np.abs(step) / (1.0 + np.abs(states))).max())
                # A matrix of somewhere near shows what it is good for by its second step.
                left = size / before if made > 1 or matrix is None else 1.0
                # Steps with one matrix shrink by a factor, those with a new one are squared.
                if size * min(left, 1.0) <= _CLOSE or (size <= _ROUNDING and left > _SHRINKS):
                    return states
                if left > _SHRINKS and (made > 1 or matrix is None or size > _SHRINKS * _NEAR):
                    factors = None
                before = size
        except (LeastActionError, ArithmeticError) as error:
            why = str(error)
        worst = np.abs(residual).max(axis=0)
        raise StepError(
            f"the piece from {self.mesh.breaks[k]:.6g} to {self.mesh.breaks[k + 1]:.6g} s could not be solved: {why}",
            t=float(self.mesh.breaks[k]),
            residuals={f"x[{i}]": float(value) for i, value in enumerate(worst)},
            iteration=made,
        )

    def points(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return states and inputs of all points (N, STAGES, ...) of the steps from x (N+1, nz) with u (N, ...)."""
        nx, mesh = self.system.nx, self.mesh
        inputs = u.reshape(self.N, STAGES, -1)
        states = self.layout.points(x[1:])[0].copy()
        # Of a trajectory they are known.
        try:
            rates = self.system.rates(states.reshape(-1, nx), inputs.reshape(self.N * STAGES, -1), mesh.t.ravel())
            off = x[:-1, None, :nx] + mesh.h[:, None, None] * (MATRIX @ rates.reshape(states.shape)) - states
        except LeastActionError:
            off = np.full(states.shape, np.inf)
        for k in np.flatnonzero((np.abs(off) > _RESIDUAL * (1.0 + np.abs(states).max())).any(axis=(1, 2))):
            start = x[k, :nx]
            states[k] = self._solve(start, inputs[k], int(k), np.tile(start, (STAGES, 1)))
        return states, inputs

    # ---- Derivatives ----------------------------------------------------------------------------

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:
        A, B = self._piece(x, u, k)
        return A[0], B[0]

    def curvature(self, x: Array, u: Array, k: int, z: Array) -> Array:
        return np.asarray(self._piece(x, u, k).curvature(z[None, :])[0])

    def _piece(self, x: Array, u: Array, k: int) -> Linearization:
        part = CollocationSystem(self.system, RadauMesh(self.mesh.breaks[k : k + 2]))
        return part.linearize(np.stack([x, self.f(x, u, k)]), u[None, :])

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization:  # noqa: ARG002
        """Return the derivatives of every piece, by the implicit function theorem."""
        return self._in_charts(self._linearized(*self.points(x, u)), x[:-1], x[1:])

    def own_linearize_each(self, x: Array, u: Array, ends: Array) -> Linearization:
        found = self._linearized(self.layout.points(ends)[0], u.reshape(self.N, STAGES, -1))
        return self._in_charts(found, x[: self.N], ends)

    def _in_charts(self, found: Linearization, begin: Array, end: Array) -> Linearization:
        """Return derivatives of pieces that are by the numbers of states by these, where they are no plain vectors."""
        if self.space is None or self.system.space is None:
            return found
        return in_charts(found, self.space, NodeLayout(self.system.space.ndx, self.system.nu), begin, end)

    def _linearized(self, states: Array, inputs: Array) -> Linearization:
        """Return the derivatives of pieces with these states and inputs at their points (N, STAGES, ...)."""
        N, nx, nu, h = self.N, self.system.nx, self.system.nu, self.mesh.h[:, None, None]
        flat = states.reshape(-1, nx), inputs.reshape(-1, nu), self.mesh.t.ravel()
        found: Any = self.system.linearize(*flat)  # a user's may be a bare pair
        along = found if isinstance(found, Linearization) else Linearization(*found)
        A, B = along.A.reshape(N, STAGES, nx, nx), along.B.reshape(N, STAGES, nx, nu)
        size = STAGES * nx
        matrices = newton_matrix(h, A)
        J = slopes_of_points(matrices, h, B)
        A_all, B_all = np.zeros((N, self.nx, self.nx)), np.zeros((N, self.nx, self.nu))
        ordered = J[:, ORDER].reshape(N, size, -1)
        A_all[:, :size, :nx], B_all[:, :size] = ordered[:, :, :nx], ordered[:, :, nx:]
        B_all[:, size:] = np.eye(STAGES * nu)
        bent = partial(self._bent, matrices, J, flat, along)
        layout = self.layout

        def second(z: Array) -> Array:
            whole = np.zeros((N, self.nx + self.nu, self.nx + self.nu))
            whole[:, layout.used[:, None], layout.used] = bent(z)
            return whole

        def packed(z: Array) -> Array:
            return np.asarray(bent(z)[:, *layout.lower])

        return Linearization(A_all, B_all, second, pattern=layout.pattern, packed=packed)

    def _bent(
        self, matrices: Array, J: Array, flat: tuple[Array, Array, Array], along: Linearization, z: Array
    ) -> Array:
        """Return ``z . D2f`` by the end of the piece before and the inputs.

        It is the dynamics' curvature at the points, weighed by the pieces' own adjoint.
        """
        N, nx, nu = self.N, self.system.nx, self.system.nu
        weights = z[:, : STAGES * nx].reshape(N, STAGES, nx)[:, PLACE].reshape(N, -1)
        costate = solved_each(matrices.transpose(0, 2, 1), weights[:, :, None]).reshape(N, STAGES, nx)
        pull = self.mesh.h[:, None, None] * np.einsum("ij,nia->nja", MATRIX, costate)
        pull = pull.reshape(-1, nx)
        bent = self.system.curvatures(*flat, pull) if along.second is None else along.curvature(pull)
        n = nx + STAGES * nu
        moves = np.zeros((N, STAGES, nx + nu, n))
        moves[:, :, :nx] = J
        for stage in range(STAGES):
            moves[:, stage, nx:, nx + stage * nu : nx + (stage + 1) * nu] = np.eye(nu)
        flat_moves = moves.reshape(N * STAGES, nx + nu, n)
        return np.asarray((flat_moves.transpose(0, 2, 1) @ bent @ flat_moves).reshape(N, STAGES, n, n).sum(axis=1))
