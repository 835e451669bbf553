"""The planar problems of `benchmarks.robustness_problems` beside CasADi and Ipopt: ``python -m benchmarks.peers``.

Both solve the same discrete problem, the midpoint rule and the cost of `QuadraticCost`, from the same start. Ipopt gets
it as direct multiple shooting: states are unknowns beside the inputs, the discrete Euler-Lagrange equations are
constraints, derivatives of both orders are exact and compiled by CasADi into one function mapped over the steps. The
building of that function is not counted. Times are those of the processor, which other programs disturb least.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from dataclasses import asdict, dataclass  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks.robustness_problems import PROBLEMS, Given, Problem  # noqa: E402
from leastaction.errors import LeastActionError  # noqa: E402
from leastaction.optimal import optimize  # noqa: E402

__all__ = ["PLANAR", "Comparison", "compare"]

_G = 9.81  # of Gravity()


@dataclass(frozen=True)
class Planar:
    """Links one behind the other in the y-z plane, as the mechanisms of the problems have them.

    ``trolley`` is the mass that the first one hangs from, 0 if it is fixed. Each link has a length, a mass, the
    distance of that from the joint, and an inertia about it. ``inputs`` are the variables with a motor.
    """

    trolley: float
    links: tuple[tuple[float, float, float, float], ...]
    inputs: tuple[int, ...]
    damping: float


def _rods(*inputs: int) -> Planar:
    links = tuple((length, mass, 0.5 * length, mass * length**2 / 12.0) for length, mass in ((1.0, 1.0), (0.8, 0.8)))
    return Planar(0.0, links, inputs, 0.02)


PLANAR = {
    "cart": Planar(2.0, ((0.8, 0.4, 0.8, 0.0),), (0,), 0.02),
    "double cart": Planar(2.0, ((0.8, 0.4, 0.8, 0.0),) * 2, (0,), 0.02),
    "acrobot": _rods(1),
    "pendubot": _rods(0),
    "planar arm": Planar(0.0, tuple((0.4, 1.5 / (1.0 + 0.3 * k), 0.2, 0.03) for k in range(3)), (0, 1, 2), 0.05),
    "chain of 3": Planar(1.0, ((0.5, 0.5, 0.5, 0.0),) * 3, (0,), 0.05),
    "chain of 8": Planar(0.0, ((0.5, 0.5, 0.5, 0.0),) * 8, tuple(range(8)), 0.05),
}
"""The mechanisms that are compared."""


@dataclass(frozen=True)
class Comparison:
    """One problem, solved by both; ``ratio`` is Ipopt's time over ours, ``better`` how much lower our cost is."""

    name: str
    ours: float
    ipopt: float
    our_status: str
    ipopt_status: str
    our_seconds: float
    ipopt_seconds: float
    our_iterations: int
    ipopt_iterations: int

    @property
    def ratio(self) -> float:
        """How many times faster we are."""
        return self.ipopt_seconds / self.our_seconds

    @property
    def better(self) -> float:
        """By how much our cost is lower, relative to theirs."""
        return (self.ipopt - self.ours) / abs(self.ipopt)


def _step(planar: Planar, dt: float) -> Any:
    """Return CasADi's function of the residuals of a step, ``(x1, u, x2) -> (2 nq,)``."""
    import casadi as ca

    n = len(planar.links) + (planar.trolley > 0.0)
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    y, z, angle, energy = (q[0] if planar.trolley else 0), 0, 0, 0
    if planar.trolley:
        energy = 0.5 * planar.trolley * v[0] ** 2
    for k, (length, mass, centre, inertia) in enumerate(planar.links):
        i = k + (planar.trolley > 0.0)
        angle = angle + q[i]
        at = ca.vertcat(y + centre * ca.sin(angle), z - centre * ca.cos(angle))
        rate = ca.jtimes(at, q, v)
        turn = ca.jtimes(angle, q, v)
        energy = energy + 0.5 * mass * ca.dot(rate, rate) + 0.5 * inertia * turn**2
        energy = energy - mass * _G * at[1]
        y, z = y + length * ca.sin(angle), z - length * ca.cos(angle)
    lagrangian = ca.Function("L", [q, v], [energy])

    q1, p1, q2, p2 = (ca.SX.sym(name, n) for name in ("q1", "p1", "q2", "p2"))
    u = ca.SX.sym("u", len(planar.inputs))
    Ld = dt * lagrangian(0.5 * (q1 + q2), (q2 - q1) / dt)
    force = -planar.damping * (q2 - q1) / dt
    for column, row in enumerate(planar.inputs):
        force[row] += u[column]
    residual = ca.vertcat(p1 + ca.gradient(Ld, q1) + 0.5 * dt * force, ca.gradient(Ld, q2) + 0.5 * dt * force - p2)
    return ca.Function("step", [ca.vertcat(q1, p1), u, ca.vertcat(q2, p2)], [residual])


def _ipopt(planar: Planar, given: Given, x: np.ndarray, u: np.ndarray) -> tuple[float, str, float, int]:
    """Return Ipopt's cost, status, seconds and iterations."""
    import casadi as ca

    system, cost = given.system, given.cost
    N, nx, nu = system.N, system.nx, system.nu
    X, U = ca.MX.sym("X", nx, N + 1), ca.MX.sym("U", nu, N)
    step = _step(planar, float(system.t[1] - system.t[0]))
    gaps = step.map(N)(X[:, :N], U, X[:, 1:])
    dx, du = X - ca.DM(cost.x_wanted.T), U - ca.DM(cost.u_wanted.T)
    weights = np.tile(cost.Q[:, None], N + 1)
    weights[:, -1] = cost.Q_final
    value = 0.5 * (ca.sum(ca.vec(ca.DM(weights) * dx**2)) + ca.sum(ca.vec(ca.DM(np.tile(cost.R[:, None], N)) * du**2)))
    unknowns = ca.vertcat(ca.vec(X), ca.vec(U))
    options = {
        "print_time": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "max_iter": 500,
            "tol": 1e-8,
            "acceptable_iter": 0,
        },
    }
    solver = ca.nlpsol("peer", "ipopt", {"x": unknowns, "f": value, "g": ca.vec(gaps)}, options)
    lower = np.full(unknowns.numel(), -np.inf)
    upper = -lower
    lower[:nx] = upper[:nx] = x[0]
    began = time.process_time()
    found = solver(x0=np.concatenate([x.ravel(), u.ravel()]), lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    seconds = time.process_time() - began
    stats = solver.stats()
    return float(found["f"]), str(stats["return_status"]), seconds, int(stats["iter_count"])


def compare(problem: Problem) -> Comparison:
    """Solve a problem by both."""
    given = problem.build()
    system, planar = given.system, PLANAR[problem.mechanism]
    x, u = given.x, given.u
    if x.ndim == 1:
        none = np.zeros((system.N, system.nu, system.nx))
        x = system.rollout(x, np.tile(x, (system.N + 1, 1)), u, none, 0, system.N).x
        # That both mean the same is not taken on trust.
        gap = _step(planar, float(system.t[1] - system.t[0])).map(system.N)(x[:-1].T, u.T, x[1:].T)
        worst = float(np.abs(np.array(gap)).max())
        if worst > 1e-6 * (1.0 + float(np.abs(x).max())):
            raise AssertionError(f"{problem.name}: the models differ by {worst:.3g}")
    began = time.process_time()
    try:
        result = optimize(system, given.cost, initial=(given.x, given.u))
        ours = (result.cost, result.status.name, result.iterations)
    except LeastActionError as error:
        ours = (np.inf, type(error).__name__, 0)
    seconds = time.process_time() - began
    theirs = _ipopt(planar, given, x, u)
    return Comparison(problem.name, ours[0], theirs[0], ours[1], theirs[1], seconds, theirs[2], ours[2], theirs[3])


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON array on stdout")
    parser.add_argument("--only", default="", help="only problems whose name contains this")
    arguments = parser.parse_args()
    rows = []
    for problem in PROBLEMS:
        if problem.mechanism not in PLANAR or arguments.only not in problem.name:
            continue
        row = compare(problem)
        rows.append(row)
        print(
            f"{row.name:62.62} {row.ours:12.6g} {row.our_status:14.14} {row.our_seconds:6.2f} s "
            f"{row.our_iterations:4d} it | {row.ipopt:12.6g} {row.ipopt_status:20.20} {row.ipopt_seconds:6.2f} s "
            f"{row.ipopt_iterations:4d} it | {row.ratio:6.1f} x {row.better:+.1e}",
            file=sys.stderr if arguments.json else sys.stdout,
            flush=True,
        )
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    elif rows:
        worse = [row.name for row in rows if row.better < -1e-6]
        print(f"\n{len(rows)} problems, median of the time ratio {np.median([r.ratio for r in rows]):.1f}")
        print(f"a lower cost than ours in {len(worse)}, a higher one in {sum(r.better > 1e-6 for r in rows)}")
        for name in worse:
            print(f"    {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
