"""The linear-quadratic problem: backward recursion over the marionette's A, B and over dense ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.cases import Array, Case
from benchmarks.marionette import problem
from benchmarks.settings import Settings
from benchmarks.timing import Absent, Row, Timing, best_of, timed
from leastaction.mechanics.discrete.linearization import step_pattern
from leastaction.optimal.discrete.linear_quadratic import Workspace, solve_linear_quadratic

GROUP = "lq"
TARGET = 80e-3

# Little enough curvature for every stage to stay definite, so that the recursion runs to its end.
_CURVATURE_SCALE = 1e-3


def rows(case: Case, settings: Settings) -> list[Row | Absent]:
    """Measure; nx 80, nu 18, 1000 stages in a full run."""
    A, B, Q, R = _dense(settings.stages, case.mechanism.nx, case.mechanism.nu + case.mechanism.nrho)
    size = f"nx {B.shape[1]}, nu {B.shape[2]}, {len(B)} stages"
    target = settings.target(TARGET)
    return [
        *_marionette(case, settings, size),
        timed(
            GROUP,
            "LQ solve, dense random A, B, Q, R",
            _time(settings, A, B, Q=Q, R=R),
            "solve",
            target=target,
            note=size,
        ),
        _crocoddyl(A[0], B[0], Q[0], R[0], settings),
    ]


def _marionette(case: Case, settings: Settings, size: str) -> list[Row]:
    """The problems that the marionette's optimisation solves, quasi-Newton and Newton."""
    given = problem(case, settings.stages)
    integrator, x, u = given.system.integrator, given.wanted.x, given.wanted.u
    d = integrator.linearize_arrays(given.t, x, u)
    gradient, hessian = given.cost.gradient(given.x, given.u), given.cost.hessian(x, u)
    z = np.ascontiguousarray(gradient.q)
    H = d.packed_curvature_all(z)
    common = {
        "pattern": step_pattern(integrator.mechanism, multipliers=False),
        "Q": hessian.Q,
        "R": hessian.R,
        "Q_final": hessian.Q_final,
        "q": gradient.q,
        "r": gradient.r,
        "q_final": gradient.q_final,
    }
    curved = {"H": H, "H_scale": _CURVATURE_SCALE, **common}
    target = settings.target(TARGET)
    result = []
    for name, weights in (
        ("LQ solve, marionette's A, B, diagonal Q, R", common),
        ("LQ solve, the same and a Hessian per stage", curved),
    ):
        solution = solve_linear_quadratic(d.A, d.B, **weights)
        note = f"{size}; structure used in {solution.structured_stages}"
        if not solution.definite:
            note = f"not to its end: {solution.message}"
        timing = _time(settings, d.A, d.B, **weights)
        result.append(timed(GROUP, name, timing, "solve", target=target, note=note))
    return result


def _time(settings: Settings, A: Array, B: Array, **weights: Any) -> Timing:
    workspace = Workspace(len(B), *B.shape[1:])
    return best_of(lambda: solve_linear_quadratic(A, B, workspace=workspace, **weights), budget=settings.budget)


def _dense(N: int, nx: int, nu: int) -> tuple[Array, Array, Array, Array]:
    """Return dense random problems, a little damped so that costs stay of one size."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(N, nx, nx)) * (0.95 / np.sqrt(nx))
    B = rng.normal(size=(N, nx, nu)) / np.sqrt(nx)
    W = rng.normal(size=(N, nx, nx)) / np.sqrt(nx)
    Q = W @ W.transpose(0, 2, 1) + 0.1 * np.eye(nx)
    V = rng.normal(size=(N, nu, nu)) / np.sqrt(nu)
    R = V @ V.transpose(0, 2, 1) + 0.1 * np.eye(nu)
    return A, B, Q, R


def _crocoddyl(A: Array, B: Array, Q: Array, R: Array, settings: Settings) -> Row | Absent:
    """Time crocoddyl's backward pass on a dense problem of the same size."""
    name = "crocoddyl backwardPass, dense, the same sizes"
    try:
        import crocoddyl
    except ImportError:
        return Absent(GROUP, name, "crocoddyl is not installed")
    nx, nu = B.shape
    N = settings.stages
    zero_x, zero_u = np.zeros(nx), np.zeros(nu)
    model = crocoddyl.ActionModelLQR(A, B, Q, R, np.zeros((nx, nu)), zero_x, zero_x, zero_u)
    solver = crocoddyl.SolverDDP(crocoddyl.ShootingProblem(np.ones(nx), [model] * N, model))
    solver.setCandidate([np.ones(nx)] * (N + 1), [zero_u] * N, False)
    solver.calcDiff()
    return timed(
        GROUP,
        name,
        best_of(solver.backwardPass, budget=settings.budget),
        "solve",
        reference=True,
        note=f"crocoddyl {crocoddyl.__version__}; 240 ms when the targets were set",
        details={"design_seconds": 0.24},
    )
