"""The problems of `benchmarks.robustness` beside CasADi and Ipopt: ``python -m benchmarks.peers [--compiled]``.

Both solve the same discrete problem, the midpoint rule and the cost of `QuadraticCost`, from the same start. Ipopt gets
it as direct multiple shooting with exact derivatives (see `benchmarks.multiple_shooting`): states are unknowns beside
the inputs, the discrete Euler-Lagrange equations are constraints. What is built before it solves is not counted. Times
are those of the processor, which other programs disturb least. Where our optimum is the worse one, both ends are
certified: either they are two local minima, or ours is none.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
import warnings  # noqa: E402
from dataclasses import asdict, dataclass  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks.cases import Array  # noqa: E402
from benchmarks.robustness import certify  # noqa: E402
from benchmarks.robustness_problems import PROBLEMS, Given, Problem  # noqa: E402
from leastaction.errors import LeastActionError  # noqa: E402
from leastaction.optimal import OptimizationResult, optimize  # noqa: E402

__all__ = ["Comparison", "compare"]

_PATIENCE = {"max_iter": 1000, "max_cpu_time": 12.0}  # Ipopt's: some starts send it far away
_SAME = 1e-6  # relative difference of costs of the same optimum
_SHORT = 0.5  # seconds; what takes less is repeated


@dataclass(frozen=True)
class Comparison:
    """One problem, solved by both.

    ``better`` is how much lower our cost is, relative to theirs; ``verdict`` tells why it is not, where it is higher.
    ``compiled_seconds``: theirs with functions that the C compiler made, where that was measured besides.
    """

    name: str
    ours: float
    ipopt: float
    our_status: str
    ipopt_status: str
    our_seconds: float
    ipopt_seconds: float
    our_iterations: int
    ipopt_iterations: int
    verdict: str
    compiled_seconds: float = np.nan

    @property
    def ratio(self) -> float:
        """How many times faster we are."""
        return self.ipopt_seconds / self.our_seconds

    @property
    def ratio_compiled(self) -> float:
        """How many times faster we are than with compiled functions; NaN where that was not measured."""
        return self.compiled_seconds / self.our_seconds

    @property
    def better(self) -> float:
        """By how much our cost is lower, relative to theirs."""
        return (self.ipopt - self.ours) / abs(self.ipopt)


def start_of(given: Given) -> tuple[Array, Array]:
    """Return the start of a problem as a curve: the motion under its inputs, if it has an initial state alone."""
    x, u = given.x, given.u
    if x.ndim == 1:
        N, nu, nx = given.system.N, given.system.nu, given.system.nx
        x = given.system.rollout(x, np.tile(x, (N + 1, 1)), u, np.zeros((N, nu, nx)), 0, N).x
    return x, u


def _ours(given: Given, repeats: int) -> tuple[OptimizationResult | str, float]:
    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result: OptimizationResult | str = optimize(given.system, given.cost, initial=(given.x, given.u))
        except LeastActionError as error:
            result = type(error).__name__
        best = min(best, time.process_time() - began)
        if best > _SHORT:
            break
    return result, best


def _verdict(given: Given, result: OptimizationResult | str, theirs: tuple[Array, Array]) -> str:
    """Return why our end costs more."""
    if isinstance(result, str):
        return result
    if result.status.name not in ("CONVERGED", "STALLED"):
        return result.message
    if not certify(given, result.x, result.u).minimum:
        return "ours is no minimum"
    try:
        other = certify(given, *theirs).minimum
    except LeastActionError as error:
        return f"ours is a minimum; theirs is no trajectory: {error}"
    return "another minimum: both are certified" if other else "ours is a minimum; theirs is not certified as one"


def compare(problem: Problem, *, compiled: bool = False, repeats: int = 3) -> Comparison:
    """Solve a problem by both; times are the best of the repeats, as far as one is short."""
    from benchmarks.multiple_shooting import MultipleShooting

    given = problem.build()
    result, seconds = _ours(given, repeats)
    if isinstance(result, str):
        ours, status, iterations = np.inf, result, 0
    else:
        ours, status, iterations = result.cost, result.status.name, result.iterations
    program = MultipleShooting(given.system, given.cost, compiled=compiled)
    solver = program.ipopt(**_PATIENCE)
    start = start_of(given)
    theirs = program.solve(solver, *start)
    theirs_seconds = theirs.seconds
    for _ in range(repeats - 1):
        if theirs_seconds < _SHORT:
            theirs_seconds = min(theirs_seconds, program.solve(solver, *start).seconds)
    worse = theirs.solved and ours - theirs.cost > _SAME * abs(theirs.cost)
    return Comparison(
        problem.name,
        ours,
        theirs.cost,
        status,
        theirs.status,
        seconds,
        theirs_seconds,
        iterations,
        theirs.iterations,
        _verdict(given, result, (theirs.x, theirs.u)) if worse else "",
    )


def _line(row: Comparison) -> str:
    return (
        f"{row.name:62.62} {row.ours:12.6g} {row.our_status:14.14} {1e3 * row.our_seconds:8.1f} ms "
        f"{row.our_iterations:4d} it | {row.ipopt:12.6g} {row.ipopt_status:20.20} {1e3 * row.ipopt_seconds:8.1f} ms "
        f"{row.ipopt_iterations:4d} it | {row.ratio:6.1f} x {row.better:+.1e} {row.verdict}"
    )


def summary(rows: list[Comparison]) -> str:
    """Return what the comparisons come to."""
    solved = [r for r in rows if r.ipopt_status == "Solve_Succeeded"]
    same = [r for r in solved if abs(r.better) <= _SAME]
    lines = [
        f"{len(rows)} problems, of which Ipopt solves {len(solved)} and both come to the same optimum in {len(same)}"
    ]
    for what, some in (("all", rows), ("those that Ipopt solves", solved), ("the same optimum", same)):
        if some:
            lines.append(f"median of the time ratio, {what}: {np.median([r.ratio for r in some]):.1f}")
    each = [
        (r.ipopt_seconds / r.ipopt_iterations) / (r.our_seconds / r.our_iterations)
        for r in solved
        if r.our_iterations and r.ipopt_iterations
    ]
    if each:
        lines.append(f"median of the ratio of times per iteration, those that Ipopt solves: {np.median(each):.1f}")
    lines.append(f"our optimum is lower in {sum(r.better > _SAME for r in solved)} of them, higher in:")
    lines += [f"    {r.name}: {r.verdict}" for r in solved if r.verdict] or ["    none"]
    return "\n".join(lines)


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON array on stdout")
    parser.add_argument("--only", default="", help="only problems whose name contains this")
    parser.add_argument("--compiled", action="store_true", help="Ipopt's derivatives by the C compiler")
    parser.add_argument("--repeats", type=int, default=3, help="of what takes less than half a second")
    arguments = parser.parse_args()
    try:
        import casadi  # noqa: F401
    except ImportError:
        print("casadi is not installed: there is nothing to compare with", file=sys.stderr)
        return 0
    rows = []
    for problem in PROBLEMS:
        if arguments.only not in problem.name:
            continue
        rows.append(compare(problem, compiled=arguments.compiled, repeats=arguments.repeats))
        print(_line(rows[-1]), file=sys.stderr if arguments.json else sys.stdout, flush=True)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))
    elif rows:
        print(f"\n{summary(rows)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
