"""A discrete problem as a nonlinear program for CasADi's solvers: direct multiple shooting with exact derivatives.

Unknowns are ``[x_0 u_0 lam_0 | x_1 u_1 lam_1 | ... | x_N]`` and constraints the residuals of every step, so that the
multipliers of a mechanism's own constraints can be bounded too. What is kept within bounds besides (`StepRows`) are
more rows of every step; of a motion that returns the first state is free, and the last one the same. Jacobian and
Hessian of a stage are scalar expressions, evaluated for all stages by one map and put together by a sparse product: two
to three times as fast, over a whole solution, as what CasADi finds by itself by colouring the program.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from subprocess import run
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.casadi_mechanism import Symbolic
from benchmarks.cases import Array
from leastaction.optimal import QuadraticCost
from leastaction.systems import MidpointSystem

__all__ = ["EXACTLY", "MultipleShooting", "Solution", "StepRows"]

_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 1000,
    "tol": 1e-8,
    "acceptable_iter": 0,
}

EXACTLY: dict[str, Any] = {"bound_relax_factor": 0.0}
"""Ipopt's option to hold bounds as they are: by itself it goes beyond them by 1e-8, for a cost up to 1e-6 lower."""

_LARGE = 20000  # operations of a stage's derivatives


@dataclass(frozen=True)
class Solution:
    """What a solver found; ``seconds`` are of the processor, in the solver alone."""

    x: Array
    u: Array
    lam: Array
    cost: float
    status: str
    iterations: int
    seconds: float

    @property
    def solved(self) -> bool:
        """Whether the solver says that it is a local optimum."""
        return self.status in ("Solve_Succeeded", "0")


@dataclass(frozen=True)
class StepRows:
    """Functions of every step, ``low <= c(x1, u, lam, x2) <= high``.

    ``of``: the mechanism's expressions and the symbols of a step to the functions (n,). ``low``, ``high``: broadcast to
    (N, n).
    """

    of: Callable[[Symbolic, Any, Any, Any, Any], Any]
    low: Any = -np.inf
    high: Any = np.inf


class MultipleShooting:
    """The program of a system and a cost.

    Parameters
    ----------
    system : MidpointSystem
        With equal steps of time, and without multipliers in its state.
    cost : QuadraticCost
        Its weights do not couple different entries, or are one matrix for all stages.
    compiled : bool
        Compile the derivatives of a stage with the C compiler (gcc), instead of CasADi's interpreter.
    paths : sequence of StepRows
        What every step is kept to besides.
    returning : bool
        The first state is free, and the last one the same.

    Attributes
    ----------
    model : Symbolic
        The mechanism.
    lower, upper : ndarray (n,)
        Bounds on the unknowns. See `bound` to set them.
    """

    def __init__(
        self,
        system: MidpointSystem,
        cost: QuadraticCost,
        *,
        compiled: bool = False,
        paths: Sequence[StepRows] = (),
        returning: bool = False,
    ) -> None:
        m = system.integrator.mechanism
        self.N, self.nx, self.nu, self.nc = system.N, system.nx, system.nu, m.nc
        self.size = self.nx + self.nu + self.nc
        self.model = Symbolic(m)
        self.dt = float(system.t[1] - system.t[0])
        self.cost = cost
        self.compiled, self.paths, self.returning = compiled, tuple(paths), returning
        self.lower = np.full(self.N * self.size + self.nx, -np.inf)
        self.upper = -self.lower

    # ---- Unknowns -------------------------------------------------------------------------------

    def pack(self, x: Array, u: Array, lam: Array | None = None) -> Array:
        """Return the unknowns of states (N+1, nx), inputs (N, nu) and multipliers (N, nc).

        Multipliers that are left out are those that balance every step best.
        """
        if lam is None:
            lam = self._multipliers(x, u)
        return np.concatenate([np.hstack([x[:-1], u, lam]).ravel(), x[-1]])

    def unpack(self, w: Array) -> tuple[Array, Array, Array]:
        """Return states, inputs and multipliers."""
        stages = w[: -self.nx].reshape(self.N, self.size)
        x, u, lam = np.split(stages, [self.nx, self.nx + self.nu], axis=1)
        return np.vstack([x, w[-self.nx :]]), u, lam

    def bound(
        self,
        lower: tuple[Any, Any, Any] = (-np.inf, -np.inf, -np.inf),
        upper: tuple[Any, Any, Any] = (np.inf, np.inf, np.inf),
    ) -> None:
        """Set bounds on states, inputs and multipliers, each broadcast to (N+1, nx), (N, nu) and (N, nc)."""
        shapes = ((self.N + 1, self.nx), (self.N, self.nu), (self.N, self.nc))
        self.lower, self.upper = (
            self.pack(*(np.broadcast_to(b, shape) for b, shape in zip(bounds, shapes, strict=True)))
            for bounds in (lower, upper)
        )

    def _multipliers(self, x: Array, u: Array) -> Array:
        lam = np.zeros((self.N, self.nc))
        if self.nc:
            # The residual is linear in them.
            left = self.residuals(x, u, lam)
            f = self.step
            by = ca.Function("by", f.sx_in(), [ca.jacobian(f(*f.sx_in()), f.sx_in()[2])])
            for k in range(self.N):
                rows = np.array(by(x[k], u[k], lam[k], x[k + 1]))
                lam[k] = np.linalg.lstsq(rows, -left[k], rcond=None)[0]
        return lam

    # ---- Functions ------------------------------------------------------------------------------

    @cached_property
    def step(self) -> ca.Function:
        """The residuals of a step, ``(x1, u, lam, x2)``."""
        return self.model.step(self.dt)

    @cached_property
    def kept(self) -> ca.Function:
        """What every step is kept to besides, ``(x1, u, lam, x2)``."""
        symbols = self.step.sx_in()
        return ca.Function(
            "kept", symbols, [ca.vertcat(ca.SX(0, 1), *(p.of(self.model, *symbols) for p in self.paths))]
        )

    @cached_property
    def kept_within(self) -> tuple[Array, Array]:
        """Least and largest values (N, n) of `kept`."""
        sizes = [path.of(self.model, *self.step.sx_in()).numel() for path in self.paths]

        def all_of(bounds: list[Any]) -> Array:
            parts = [np.broadcast_to(each, (self.N, n)) for each, n in zip(bounds, sizes, strict=True)]
            return np.hstack([np.empty((self.N, 0)), *parts])

        return all_of([path.low for path in self.paths]), all_of([path.high for path in self.paths])

    @cached_property
    def stage(self) -> ca.Function:
        """The rows of a step: its residuals, and what it is kept to."""
        symbols = self.step.sx_in()
        return ca.Function("stage", symbols, [ca.vertcat(self.step(*symbols), self.kept(*symbols))])

    def residuals(self, x: Array, u: Array, lam: Array) -> Array:
        """Return by how much every step is missed, (N, nx + nc)."""
        return np.array(self.step.map(self.N)(x[:-1].T, u.T, lam.T, x[1:].T)).T

    @cached_property
    def program(self) -> dict[str, ca.MX]:
        """The program ``{x, f, g}`` of `casadi.nlpsol`."""
        w = ca.MX.sym("w", self.lower.size)
        z, x1 = self._stages(w)
        parts = ca.vertsplit(z, [0, self.nx, self.nx + self.nu, self.size])
        g = ca.vec(self.stage.map(self.N)(*parts, x1))
        if self.returning:
            g = ca.vertcat(g, w[-self.nx :] - w[: self.nx])
        return {"x": w, "f": self._value(w), "g": g}

    @cached_property
    def within(self) -> tuple[Array, Array]:
        """Least and largest values of all constraints."""
        none, ends = np.zeros((self.N, self.nx + self.nc)), np.zeros(self.nx if self.returning else 0)
        low, high = (np.concatenate([np.hstack([none, each]).ravel(), ends]) for each in self.kept_within)
        return low, high

    def _stages(self, w: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Return z = [x u lam] of all stages, and the states after them."""
        z = ca.reshape(w[: self.N * self.size], self.size, self.N)
        return z, ca.horzcat(z[: self.nx, 1:], w[self.N * self.size :])

    @cached_property
    def _by_stage(self) -> list[ca.Function]:
        """The Jacobian of a step's rows F, and the lower triangle of the Hessian of mu . F; both by [z; x2]."""
        z, x2 = ca.SX.sym("z", self.size), ca.SX.sym("x2", self.nx)
        F = self.stage(*ca.vertsplit(z, [0, self.nx, self.nx + self.nu, self.size]), x2)
        mu = ca.SX.sym("mu", F.numel())
        both = ca.vertcat(z, x2)
        functions = [
            ca.Function("J", [z, x2], [ca.jacobian(F, both)], {"cse": True}),
            ca.Function("H", [z, x2, mu], [ca.tril(ca.hessian(ca.dot(mu, F), both)[0])], {"cse": True}),
        ]  # fmt: skip
        return _compiled(functions) if self.compiled else functions

    def _value(self, w: ca.MX) -> ca.MX:
        z, _ = self._stages(w)
        cost, x, u = self.cost, z[: self.nx, :], z[self.nx : self.nx + self.nu, :]
        last = w[self.N * self.size :]
        return 0.5 * (
            _form(cost.Q, x - ca.DM(cost.x_wanted[:-1].T))
            + _form(cost.R, u - ca.DM(cost.u_wanted.T))
            + _form(cost.Q_final, last - ca.DM(cost.x_wanted[-1]))
        )

    def _assembled(self, stage: ca.Sparsity, rows: int, *, triangle: bool) -> Any:
        """Return how the nonzeros of all stages' matrices become one sparse matrix, as a function of them.

        Columns (and rows of a triangle) of a stage begin where its unknowns do; where stages overlap they add up.
        """
        n = self.lower.size
        row, column = (np.array(a) for a in stage.get_triplet())
        k = np.arange(self.N)[:, None]
        r = (row + (self.size if triangle else rows) * k).ravel()
        c = (column + self.size * k).ravel()
        if triangle:
            r, c = c, r  # solvers want the upper one
        whole = ca.Sparsity.triplet(n if triangle else rows * self.N, n, r.tolist(), c.tolist())
        place = {at: i for i, at in enumerate(zip(*whole.get_triplet(), strict=True))}
        to = [place[at] for at in zip(r.tolist(), c.tolist(), strict=True)]
        plain = to == list(range(len(to)))
        add = ca.DM.triplet(to, list(range(len(to))), ca.DM.ones(len(to)), whole.nnz(), len(to))

        def assemble(stages: ca.MX) -> ca.MX:
            values = ca.reshape(stages.nz[:], len(to), 1)
            return ca.MX(whole, values if plain else ca.densify(add @ values))

        return assemble

    @cached_property
    def derivatives(self) -> dict[str, ca.Function]:
        """The Jacobian ``jac_g`` and the upper triangle of the Hessian ``hess_lag``, as options of `casadi.nlpsol`."""
        w, p = self.program["x"], ca.MX.sym("p", 0)
        z, x2 = self._stages(w)
        J, H = self._by_stage
        rows = self.stage.numel_out(0)
        by_stage = J.map(self.N)(z, x2)
        jacobian = self._assembled(J.sparsity_out(0), rows, triangle=False)(by_stage)
        if self.returning:
            ends = ca.jacobian(w[-self.nx :] - w[: self.nx], w)
            jacobian = ca.vertcat(jacobian, ends)
        weight, mu = ca.MX.sym("weight"), ca.MX.sym("mu", self.program["g"].numel())
        bent = H.map(self.N)(z, x2, ca.reshape(mu[: rows * self.N], rows, self.N))
        hessian = self._assembled(H.sparsity_out(0), rows, triangle=True)(bent)
        of_cost = ca.triu(ca.hessian(self.program["f"], w)[0])
        return {
            "jac_g": ca.Function("nlp_jac_g", [w, p], [self.program["g"], jacobian]),
            "hess_lag": ca.Function("nlp_hess_l", [w, p, weight, mu], [weight * of_cost + hessian]),
        }

    # ---- Solvers --------------------------------------------------------------------------------

    def ipopt(self, **options: Any) -> ca.Function:
        """Return Ipopt for the program; options are Ipopt's own."""
        return ca.nlpsol(
            "peer",
            "ipopt",
            self.program,
            {"print_time": False, "ipopt": {**_IPOPT, **options}, **self.derivatives},
        )

    def solve(self, solver: ca.Function, x: Array, u: Array, lam: Array | None = None) -> Solution:
        """Solve from a start under the bounds, with the first state held unless the motion is to return."""
        lower, upper = self.lower.copy(), self.upper.copy()
        if not self.returning:
            lower[: self.nx] = upper[: self.nx] = x[0]
        least, most = self.within
        start = self.pack(x, u, lam)
        began = time.process_time()
        found = solver(x0=start, lbx=lower, ubx=upper, lbg=least, ubg=most)
        seconds = time.process_time() - began
        stats = solver.stats()
        return Solution(
            *self.unpack(np.array(found["x"]).ravel()),
            float(found["f"]),
            str(stats["return_status"]),
            int(stats["iter_count"]),
            seconds,
        )


def _form(weight: Array, d: ca.MX) -> ca.MX:
    """Return the sum of ``d' W d`` over the columns."""
    if weight.ndim == 3:
        if weight.shape[2] != 1:
            raise NotImplementedError("a weight matrix for every stage")
        return ca.sum(ca.vec(ca.DM(weight[:, :, 0].T) * d**2))
    if weight.ndim == 2:
        return ca.dot(d, ca.DM(weight) @ d)
    return ca.sum(ca.vec(ca.DM(np.tile(weight[:, None], d.shape[1])) * d**2))


def _compiled(functions: list[ca.Function]) -> list[ca.Function]:
    """Return functions of the same names from a library that the C compiler made.

    What is large is made by -O1: a marionette's takes minutes by -O2, and is no faster for it.
    """
    large = sum(function.n_instructions() for function in functions) > _LARGE
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "stage.c", Path(folder) / "stage.so"
        generator = ca.CodeGenerator("stage.c")
        for function in functions:
            generator.add(function)
        generator.generate(f"{folder}/")
        run(["gcc", "-O1" if large else "-O2", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"], check=True)
        return [ca.external(f.name(), str(library)) for f in functions]
