"""This package beside another build of it: ``python -m benchmarks.against PATH [--rounds 20] [--only NAME]``.

PATH is the folder in which the other `leastaction` stands with its compiled core, as a rule the `src` of an earlier
commit. Processes of both take turns, each of which times a step of a whole roll-out, A and B, and the contracted second
order of mechanisms that any version has; the best of each counts, so ratios are the same on a machine that others use.
`LEASTACTION_CORE` chooses the variant of the core for both.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

import leastaction
from benchmarks.cases import Case, package_marionette
from benchmarks.settings import MICRO
from benchmarks.timing import best_of
from leastaction.mechanics import Mechanism, MidpointVI
from leastaction.models import cart_pendulum, chain, four_bars

__all__ = ["CASES", "measure"]

_DT, _STEPS, _BUDGET = 0.01, 100, 0.05
_JOBS = ("step", "A, B", "second order")
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def _free(m: Mechanism, q: ArrayLike, v: ArrayLike) -> Case:
    start = MidpointVI(m).start(q, v).x
    return Case(repr(m), m, _DT * np.arange(_STEPS + 1), start, np.zeros((_STEPS, m.n_inputs + m.nrho)), None)


def _chain(links: int) -> Case:
    angles = np.linspace(1.0, 0.2, links)
    return _free(chain.pendulum_chain(links), angles, -0.5 * angles)


def _four_bar() -> Case:
    m = four_bars.four_bars(1)
    return _free(m, *four_bars.at_angle(m, 1.1, 0.7))


def _marionette() -> Case:
    case = package_marionette()
    return dataclasses.replace(case, t=case.t[: _STEPS + 1], u=case.u[:_STEPS])


CASES: dict[str, Callable[[], Case]] = {
    "pendulum": lambda: _chain(1),
    "cart-pole": lambda: _free(cart_pendulum.cart_pendulum(), [0.1, 2.0], [0.2, 0.3]),
    "four-bar": _four_bar,
    "five pendulums": lambda: _chain(5),
    "marionette": _marionette,
}
"""Motions by name, of mechanisms without quaternions."""


def measure(case: Case) -> list[float]:
    """Return the seconds of one step, of its A and B, and of its contracted second order."""
    vi = MidpointVI(case.mechanism, threads=1)
    out = vi.core.roll_out(case.t, case.x0, None, case.u, None)
    if out.steps < case.steps:
        raise RuntimeError(f"{case.name}: the roll-out failed after {out.steps} of {case.steps} steps")
    first = vi.linearize_arrays(case.t, out.x, case.u)
    weights = np.random.default_rng(0).normal(size=(case.steps, 2 * case.mechanism.nq))
    jobs: list[Callable[[], object]] = [
        lambda: vi.core.roll_out(case.t, case.x0, None, case.u, None),
        lambda: vi.linearize_arrays(case.t, out.x, case.u, out=first),
        lambda: first.packed_curvature_all(weights),
    ]
    return [best_of(job, budget=_BUDGET).best / case.steps for job in jobs]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against", description="Another build beside this one.")
    parser.add_argument("path", type=Path, help="the folder in which the other leastaction stands")
    parser.add_argument("--rounds", type=int, default=20, help="processes of each")
    parser.add_argument("--only", action="append", choices=list(CASES), help="only this case, may be given again")
    arguments = parser.parse_args()
    names = arguments.only or list(CASES)
    packages = [Path(leastaction.__file__).resolve().parent.parent, arguments.path.resolve()]
    if not (packages[1] / "leastaction" / "__init__.py").exists():
        parser.error(f"no leastaction in {packages[1]}; give the folder in which it stands, such as ../other/src")
    best = np.full((2, len(names), len(_JOBS)), np.inf)
    for turn in range(2 * arguments.rounds):
        which = (turn + turn // 2) % 2  # each begins as often
        told = subprocess.run(
            [sys.executable, "-c", _CHILD, *names],
            env=os.environ | _ONE_THREAD | {"PYTHONPATH": str(packages[which])},
            cwd=Path(__file__).resolve().parent.parent,
            check=True,
            capture_output=True,
            text=True,
        )
        best[which] = np.minimum(best[which], json.loads(told.stdout))
    print("times of one step in us, of this package and of the other, and their ratio")
    print(f"{'':16s}" + "".join(f"{job:>26s}" for job in _JOBS))
    for k, name in enumerate(names):
        rows = zip(best[0, k] / MICRO, best[1, k] / MICRO, strict=True)
        print(f"{name:16s}" + "".join(f"{mine:10.3f} {other:8.3f} {mine / other:6.3f}" for mine, other in rows))
    return 0


_CHILD = (
    "import json, sys; from benchmarks.against import CASES, measure; "
    "print(json.dumps([measure(CASES[name]()) for name in sys.argv[1:]]))"
)

if __name__ == "__main__":
    sys.exit(main())
