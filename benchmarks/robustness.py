"""Does the optimiser converge, and to a minimum? ``python -m benchmarks.robustness [--quick] [--json] [--only WORDS]``.

Every problem of `benchmarks.robustness_problems` and of `benchmarks.robustness_further` is solved under default
settings, and its end is held against the exact second order: see `certify`. With ``--curves`` it is those of
`benchmarks.robustness_curves`, with ``--others`` those of `benchmarks.robustness_others`, with ``--drawn SEED ...``
those of `benchmarks.robustness_drawn`; with ``--shooting multiple`` gaps are part of the iterates from the start, with
``single`` never.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import json  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections import Counter  # noqa: E402
from dataclasses import asdict, dataclass  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks.robustness_curves import CURVES  # noqa: E402
from benchmarks.robustness_drawn import drawn  # noqa: E402
from benchmarks.robustness_further import FURTHER  # noqa: E402
from benchmarks.robustness_others import OTHERS  # noqa: E402
from benchmarks.robustness_problems import PROBLEMS, QUICK, Given, Problem  # noqa: E402
from leastaction import _core  # noqa: E402
from leastaction.errors import LeastActionError  # noqa: E402
from leastaction.optimal import adjoint, optimize, solve_linear_quadratic  # noqa: E402

__all__ = ["Certificate", "Outcome", "certify", "solve"]

_DIRECTIONS = 6  # random ones along which the cost must rise


@dataclass(frozen=True)
class Certificate:
    """Whether a trajectory is a local minimum, found without the optimiser's loop.

    Attributes
    ----------
    definite : bool
        Whether the exact second derivative of the projected cost is positive definite over all inputs.
    expected : float
        Decrease that Newton's model expects, relative to the cost.
    descent : float
        Largest decrease along random projected directions, relative to the cost; 0 if there is none.
    """

    definite: bool
    expected: float
    descent: float

    @property
    def minimum(self) -> bool:
        """Whether all that was looked at speaks for a minimum."""
        return self.definite and self.expected < 1e-6 and self.descent < 1e-8


@dataclass(frozen=True)
class Outcome:
    """How one problem ended. ``expected``, ``definite`` and ``descent`` are those of the `Certificate`.

    ``rollouts``: all of them, those of searches with finer steps too, whose iterations are not among ``iterations``;
    ``searched``: those of the iterations.
    """

    name: str
    status: str
    message: str
    cost: float
    minimum: bool
    definite: bool
    expected: float
    descent: float
    iterations: int
    methods: dict[str, int]
    solves: int
    indefinite: int
    rollouts: int
    searched: int
    seconds: float


class _Counted:
    """Counts the linear-quadratic problems that the core solves, and those that had no minimum."""

    def __enter__(self) -> _Counted:
        self.solves = self.indefinite = 0
        self._solve = solve = _core.solve_linear_quadratic

        def counted(*args: Any, **options: Any) -> Any:
            report = solve(*args, **options)
            self.solves += 1
            self.indefinite += report.status != _core.LinearQuadraticStatus.solved
            return report

        _core.solve_linear_quadratic = counted
        return self

    def __exit__(self, *_: object) -> None:
        _core.solve_linear_quadratic = self._solve


def certify(given: Given, x: np.ndarray, u: np.ndarray) -> Certificate:
    """Hold a trajectory to the conditions of a local minimum."""
    system, cost = given.system, given.cost
    linear = system.linearize(x, u)
    A, B = linear
    gradient, hessian = cost.gradient(x, u), cost.hessian(x, u)
    K = solve_linear_quadratic(A, B, Q=hessian.Q, R=hessian.R, Q_final=hessian.Q_final).K
    z = adjoint(A, B, K, *gradient)
    model = solve_linear_quadratic(
        A, B, Q=hessian.Q, R=hessian.R, Q_final=hessian.Q_final, S=hessian.S,
        H=system.curvatures(x, u, z), q=gradient.q, r=gradient.r, q_final=gradient.q_final,
    )  # fmt: skip
    value = cost.value(x, u)
    rng = np.random.default_rng(0)
    best = 0.0
    for trial in range(_DIRECTIONS):
        knots = rng.normal(size=(6 + 4 * trial, system.nu))
        smooth = np.stack(
            [np.interp(np.linspace(0, 1, system.N), np.linspace(0, 1, len(knots)), c) for c in knots.T],
            axis=1,
        )
        for size in (1e-3, 1e-2):
            for sign in (size, -size):
                du = sign * smooth * (np.abs(u).max() + 1e-3)
                run = system.rollout(x[0], x, u + du, K, 0, system.N)
                if run.complete:
                    best = max(best, value - cost.value(run.x, run.u))
    expected = -2.0 * model.constant / abs(value) if model.definite else np.inf
    return Certificate(model.definite, expected, best / abs(value))


def solve(problem: Problem, **options: Any) -> Outcome:
    """Solve a problem and certify its end."""
    given = problem.build()
    with _Counted() as counted:
        began = time.perf_counter()
        try:
            result = optimize(given.system, given.cost, initial=(given.x, given.u), **options)
        except LeastActionError as error:
            seconds = time.perf_counter() - began
            nothing = (np.nan, False, False, np.nan, np.nan, 0, {})
            return Outcome(
                problem.name, type(error).__name__, str(error), *nothing, counted.solves,
                counted.indefinite, 0, 0, seconds,
            )  # fmt: skip
        seconds = time.perf_counter() - began
    try:
        certificate = certify(given, result.x, result.u)
    except LeastActionError:
        certificate = Certificate(False, np.nan, np.nan)
    return Outcome(
        problem.name,
        result.status.name,
        result.message,
        result.cost,
        certificate.minimum,
        certificate.definite,
        certificate.expected,
        certificate.descent,
        result.iterations,
        dict(Counter(result.history.method)),
        counted.solves,
        counted.indefinite,
        result.rollouts,
        int(result.history.rollouts.sum()),
        seconds,
    )


def selected(
    *,
    quick: bool = False,
    curves: bool = False,
    others: bool = False,
    drawn_by: list[int] | None = None,
    only: str | None = None,
) -> list[Problem]:
    """Return the problems of a run."""
    problems = OTHERS if others else CURVES if curves else PROBLEMS + FURTHER
    if drawn_by is not None:
        problems = [problem for seed in drawn_by for problem in drawn(seed)]
    chosen = [p for p in problems if not quick or p.mechanism in QUICK]
    return [p for p in chosen if only is None or only in p.name]


def _line(o: Outcome) -> str:
    kinds = " ".join(f"{n} {name}" for name, n in o.methods.items())
    verdict = "minimum" if o.minimum else ("indefinite" if not o.definite else "not there")
    return (
        f"{o.name:62.62} {o.status:18.18} {verdict:10} {o.cost:12.6g} {o.iterations:4d} it "
        f"{o.solves:4d} LQ {o.indefinite:3d} indef {o.rollouts:4d} ro {o.seconds:6.2f} s "
        f"{o.expected:8.1e}  {kinds}"
    )


def summary(outcomes: list[Outcome]) -> dict[str, float]:
    """Return the figures that matter, over all problems."""
    good = [o for o in outcomes if o.minimum and o.status in ("CONVERGED", "STALLED")]
    solves = sum(o.solves for o in outcomes)
    return {
        "problems": len(outcomes),
        "certified": len(good),
        "said converged, is no minimum": sum(o.status in ("CONVERGED", "STALLED") and not o.minimum for o in outcomes),
        "solves": solves,
        "indefinite share": sum(o.indefinite for o in outcomes) / max(solves, 1),
        "iterations": sum(o.iterations for o in outcomes),
        "roll-outs per iteration, converged": sum(o.searched for o in good) / max(sum(o.iterations for o in good), 1),
        "seconds": sum(o.seconds for o in outcomes),
    }


def main() -> int:
    """Solve and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="only a few mechanisms")
    parser.add_argument("--curves", action="store_true", help="the starts that are no trajectories")
    parser.add_argument("--others", action="store_true", help="springs, prescribed sliders, turns of any size")
    parser.add_argument("--drawn", type=int, nargs="*", metavar="SEED", help="problems drawn by chance")
    parser.add_argument("--shooting", default="auto")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--only", help="only problems whose name contains this")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--max-iterations", type=int)
    arguments = parser.parse_args()
    options: dict[str, Any] = {"method": arguments.method, "shooting": arguments.shooting}
    if arguments.max_iterations is not None:
        options["max_iterations"] = arguments.max_iterations
    outcomes = []
    problems = selected(
        quick=arguments.quick,
        curves=arguments.curves,
        others=arguments.others,
        drawn_by=arguments.drawn,
        only=arguments.only,
    )
    for problem in problems:
        outcomes.append(solve(problem, **options))
        print(_line(outcomes[-1]), file=sys.stderr if arguments.json else sys.stdout, flush=True)
    figures = summary(outcomes)
    if arguments.json:
        print(json.dumps({"summary": figures, "outcomes": [asdict(o) for o in outcomes]}, indent=1))
    else:
        for o in outcomes:
            if not o.minimum:
                print(f"\n{o.name}\n    {o.message}")
        print()
        for name, figure in figures.items():
            print(f"{name:40} {figure:.4g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
