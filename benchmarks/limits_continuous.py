"""Limits in continuous time, beside Ipopt on the same transcribed problems.

They are rows of ``python -m benchmarks.limits``. Both solve the problem on the same mesh, by the Radau IIA method of
three stages, from the same start: accuracies are so rough that `optimize` makes no finer one. Ipopt has the states and
inputs of all points as unknowns, the method's equations as constraints, and exact derivatives by CasADi.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.casadi_mechanism import Symbolic
from benchmarks.multiple_shooting import EXACTLY
from benchmarks.peers import Comparison
from benchmarks.timing import fastest
from leastaction.mechanics import Gravity, JointForce, Mechanism, rx, ry, ty, tz
from leastaction.optimal import Accuracy, Bound, ContinuousOptimizationResult, ContinuousQuadraticCost, Equal, optimize
from leastaction.optimal.collocation.mesh import MATRIX, STAGES, WEIGHTS
from leastaction.systems import MechanismSystem

__all__ = ["Case", "cases", "compare"]

_IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 1000, "max_cpu_time": 20.0}
_ONE_MESH = Accuracy(rtol=0.09)


@dataclass(frozen=True)
class Case:
    """A problem for both solvers, from rest, without inputs.

    ``low``, ``high``: bounds on the state and on the input. ``end``: the last state, NaN where it is free.
    """

    name: str
    mechanism: Mechanism
    cost: ContinuousQuadraticCost
    wanted: Sequence[float]
    weights: tuple[Sequence[float], Sequence[float], Sequence[float]]
    duration: float
    low: tuple[Sequence[float], Sequence[float]]
    high: tuple[Sequence[float], Sequence[float]]
    end: Sequence[float]


def _case(
    name: str,
    mechanism: Mechanism,
    wanted: Sequence[float],
    weights: tuple[Sequence[float], Sequence[float], Sequence[float]],
    duration: float,
    most: tuple[Sequence[float], Sequence[float]],
    end: Sequence[float] | None = None,
) -> Case:
    """Return a case with bounds on both sides; ``weights``: Q, R, Q_final."""
    Q, R, Q_final = weights
    cost = ContinuousQuadraticCost(wanted, np.zeros(len(R)), Q=Q, R=R, Q_final=Q_final)
    low = -np.asarray(most[0]), -np.asarray(most[1])
    free = np.full(len(wanted), np.nan) if end is None else end
    return Case(name, mechanism, cost, wanted, weights, duration, low, most, free)


def cases() -> list[Case]:
    """Return the problems."""
    cart = Mechanism(
        [ty("cart", mass=10.0), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]],
        [Gravity((0.0, 0.0, -9.8)), JointForce("cart", input="push")],
    )
    arm = Mechanism(
        [ry("shoulder"), [tz(-0.5, mass=1.0), [ry("elbow"), [tz(-0.5, mass=0.5, name="hand")]]]],
        [Gravity((0.0, 0.0, -9.81)), JointForce("shoulder", input="upper"), JointForce("elbow", input="lower")],
    )
    none, up, raised = np.inf, [0.0, np.pi, 0.0, 0.0], [1.0, 0.5, 0.0, 0.0]
    swing = ([0.1, 1.0, 0.0, 0.0], [1e-3], [1.0, 1.0, 1.0, 1.0])
    torques = [none] * 4, [8.0, 3.0]
    reach = ([1.0, 1.0, 0.01, 0.01], [0.01, 0.01], [10.0, 10.0, 1.0, 1.0])
    return [
        _case("cart, continuous, swing-up, push bounded", cart, up, swing, 3.0, ([none] * 4, [80.0])),
        _case("cart, continuous, upright at the end", cart, up, swing, 3.0, ([1.5, none, none, none], [80.0]),
              [np.nan, np.pi, np.nan, np.nan]),
        _case("two-link arm, continuous, torques bounded", arm, raised, reach, 1.5, ([none] * 4, [6.0, 2.0])),
        _case("two-link arm, continuous, at rest at the end", arm, raised, reach, 1.5, torques, raised),
    ]  # fmt: skip


def solve(case: Case) -> ContinuousOptimizationResult:
    """Solve a case on its first mesh."""
    m = case.mechanism
    limits: list[Any] = []
    for names, kind, most in ((m.variables, "variable", case.high[0]), (m.inputs, "input", case.high[1])):
        limits += [Bound(name, -a, a, of=kind) for name, a in zip(names, most, strict=False) if np.isfinite(a)]
    for name, value in zip(m.variables, case.end, strict=False):
        limits += [Equal(name, value, of="variable")] if np.isfinite(value) else []
    for name, value in zip(m.variables, case.end[m.nq :], strict=True):
        limits += [Equal(name, value, of="rate")] if np.isfinite(value) else []
    start = np.zeros(2 * m.nq), np.zeros(m.nu)
    system = MechanismSystem(m)
    return optimize(system, case.cost, initial=start, horizon=(0.0, case.duration), limits=limits, accuracy=_ONE_MESH)


def compare(case: Case, *, rounds: int = 3) -> Comparison:
    """Solve a case with both."""
    result, seconds = fastest(lambda: solve(case), rounds)
    solver, arguments = _peer(case, np.diff(result.dense.t))
    found, theirs = fastest(lambda: solver(**arguments), rounds)
    stats = solver.stats()
    return Comparison(
        case.name, result.cost, float(found["f"]), result.status.name, str(stats["return_status"]), seconds, theirs,
        result.iterations, int(stats["iter_count"]), verdict="",
    )  # fmt: skip


def _peer(case: Case, h: np.ndarray) -> tuple[ca.Function, dict[str, Any]]:
    """Return Ipopt for a case on a mesh with pieces of these lengths, and what it is called with."""
    rate = Symbolic(case.mechanism).rate()
    nx, nu, n = 2 * case.mechanism.nq, case.mechanism.nu, len(h) * STAGES
    x, u = ca.MX.sym("x", nx, n), ca.MX.sym("u", nu, n)
    slopes, first, equations = rate.map(n)(x, u), ca.MX(nx, 1), []
    for k, length in enumerate(h):
        part = slice(k * STAGES, (k + 1) * STAGES)
        reached = ca.repmat(first, 1, STAGES) + length * (slopes[:, part] @ ca.DM(MATRIX.T))
        equations.append(ca.vec(reached - x[:, part]))
        first = x[:, part.stop - 1]
    Q, R, Q_final = (ca.DM(np.asarray(each, dtype=np.float64)) for each in case.weights)
    wanted = ca.DM(np.asarray(case.wanted, dtype=np.float64))
    off, share = x - ca.repmat(wanted, 1, n), ca.DM(np.outer(h, WEIGHTS).ravel())
    rates = ca.sum1(ca.repmat(Q, 1, n) * off**2) + ca.sum1(ca.repmat(R, 1, n) * u**2)
    value = 0.5 * (ca.dot(rates.T, share) + ca.dot(Q_final, off[:, -1] ** 2))
    fixed = [i for i in range(nx) if np.isfinite(case.end[i])]
    ends = [x[i, -1] - case.end[i] for i in fixed]
    w, g = ca.vertcat(ca.vec(x), ca.vec(u)), ca.vertcat(*equations, *ends)
    bounds = [np.concatenate([np.tile(of_x, n), np.tile(of_u, n)]) for of_x, of_u in (case.low, case.high)]
    solver = ca.nlpsol("peer", "ipopt", {"x": w, "f": value, "g": g}, {"print_time": 0, "ipopt": {**_IPOPT, **EXACTLY}})
    return solver, {"x0": np.zeros(w.numel()), "lbx": bounds[0], "ubx": bounds[1], "lbg": 0.0, "ubg": 0.0}
