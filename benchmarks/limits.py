"""Optimisation within limits, beside Ipopt on the same discrete problems: ``python -m benchmarks.limits``.

The free optimum of a problem comes first; then its inputs, states or tensions get limits that it does not keep to. Both
solvers start from where the problem says, know exact second derivatives, and are asked for the same optimum. Shortest
times, motions that return and free initial states follow, of `benchmarks.limits_unknowns`, and problems in continuous
time on a mesh, of `benchmarks.limits_continuous`. Obstacles, strings that only pull, reactions of linkages and gaits
are those of `benchmarks.limits_further`. Where both converge to other costs, they are at different minima.

Ipopt's functions are evaluated as CasADi does; where steps are mapped over time besides as the C compiler makes them of
CasADi's code, which takes seconds to minutes that are not counted.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
from collections.abc import Iterable, Iterator, Sequence  # noqa: E402
from dataclasses import replace  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks import limits_continuous, limits_further, limits_unknowns  # noqa: E402
from benchmarks.fatrop import solve_by  # noqa: E402
from benchmarks.limits_cases import CASES, Case  # noqa: E402
from benchmarks.multiple_shooting import EXACTLY, MultipleShooting, Solution  # noqa: E402
from benchmarks.peers import Comparison, start_of  # noqa: E402
from benchmarks.robustness_problems import PROBLEMS  # noqa: E402
from benchmarks.timing import fastest  # noqa: E402
from leastaction.optimal import optimize  # noqa: E402

__all__ = ["CASES", "Case", "compare"]

_ROUNDS = 3  # at least, the best of which counts
_OTHER = 1e-4  # relative difference of costs from which on minima are others: tolerances leave less


def compare(case: Case, *, rounds: int = _ROUNDS, compiled: bool = True, by_fatrop: bool = False) -> Comparison:
    """Solve a case with both; by fatrop in the place of Ipopt if it is asked for.

    ``compiled``: with functions that the C compiler made, besides.
    """
    problem = next(each for each in PROBLEMS if each.name == case.of)
    given = problem.build()
    free = optimize(given.system, given.cost, initial=(given.x, given.u))
    limited = case.limit(given, free)
    start = given.x, given.u
    result, seconds = fastest(lambda: optimize(given.system, given.cost, initial=start, limits=limited.limits), rounds)

    def theirs(compiled: bool) -> Solution:
        peer = MultipleShooting(given.system, given.cost, compiled=compiled)
        peer.bound(limited.lower, limited.upper)
        return solve_by(peer, start_of(given), rounds=rounds, by_fatrop=by_fatrop, **EXACTLY)

    found = theirs(compiled=False)
    return Comparison(
        case.name, result.cost, found.cost, result.status.name, found.status, seconds, found.seconds,
        result.iterations, found.iterations, verdict="",
        compiled_seconds=theirs(compiled=True).seconds if compiled else np.nan,
    )  # fmt: skip


def _line(row: Comparison) -> str:
    said = "" if row.ipopt_status == "Solve_Succeeded" else f"  {row.ipopt_status}"
    if not said and row.our_status == "CONVERGED" and abs(row.better) > _OTHER:
        said = "  another minimum"
    compiled = "" if np.isnan(row.compiled_seconds) else f"{1e3 * row.compiled_seconds:.0f}"
    ratio = "" if np.isnan(row.compiled_seconds) else f"{row.ratio_compiled:.1f}"
    return (
        f"{row.name:48s} {row.our_status:12.12s} {row.our_iterations:4d} {1e3 * row.our_seconds:6.0f} "
        f"{row.ipopt_iterations:6d} {1e3 * row.ipopt_seconds:6.0f} {row.ratio:6.1f} {compiled:>9s} {ratio:>6s} "
        f"{row.better:9.1e}{said}"
    )


def _compared(words: Sequence[str], rounds: int, by_fatrop: bool) -> Iterator[tuple[str, Comparison]]:
    """Return the kind and the figures of every problem whose name has all of the words; fatrop's have no kind."""

    def chosen(cases: Iterable[Any]) -> list[Any]:
        return [case for case in cases if all(word in case.name for word in words)]

    for module, cases in ((_HERE, CASES), (limits_further, limits_further.CASES)):
        for case in chosen(cases):
            returns = getattr(case, "returns", False)
            yield "unknowns" if returns else "discrete", module.compare(case, rounds=rounds)
            if by_fatrop and not returns:
                by = module.compare(case, rounds=1, compiled=False, by_fatrop=True)
                yield "", replace(by, name="  by fatrop")
    for other in chosen(limits_unknowns.cases()):
        yield "unknowns", limits_unknowns.compare(other, rounds=rounds)
    for continuous in chosen(limits_continuous.cases()):
        yield "continuous", limits_continuous.compare(continuous, rounds=rounds)


_HERE = sys.modules[__name__]
_KINDS = {
    "discrete": "inputs, states, multipliers, frames", "unknowns": "initial states, times, parameters",
    "continuous": "on a mesh",
}  # fmt: skip


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.limits", description=__doc__.partition("\n")[0])
    parser.add_argument("--only", metavar="WORDS", default="", help="problems whose names contain all of these words")
    parser.add_argument(
        "--rounds",
        type=int,
        default=_ROUNDS,
        help="solutions at least, the best of which counts",
    )
    parser.add_argument("--fatrop", action="store_true", help="a line more for each problem, with fatrop for Ipopt")
    arguments = parser.parse_args()
    heads = (
        f"{'iter':>4s} {'ms':>6s} {'Ipopt':>6s} {'ms':>6s} {'ratio':>6s} {'compiled':>9s} {'ratio':>6s} {'better':>9s}"
    )
    print(f"{'problem':48s} {'ours':12s} {heads}")
    ratios: dict[str, list[float]] = {kind: [] for kind in _KINDS}
    compiled: list[float] = []
    for kind, row in _compared(arguments.only.split(), arguments.rounds, arguments.fatrop):
        print(_line(row), flush=True)
        if kind:
            ratios[kind].append(row.ratio)
            compiled.append(row.ratio_compiled)
    for kind, found in ratios.items():
        if found:
            print(f"median ratio of times, {kind} ({_KINDS[kind]}), {len(found)} rows: {np.median(found):.2f}")
    if every := [ratio for found in ratios.values() for ratio in found]:
        print(f"median ratio of times, all {len(every)} rows: {np.median(every):.2f}")
    if some := [(each, by) for each, by in zip(every, compiled, strict=True) if not np.isnan(by)]:
        plain, faster = np.median(some, axis=0)
        print(
            f"median ratio of times, {len(some)} rows with compiled functions too: {plain:.2f}, with these {faster:.2f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
