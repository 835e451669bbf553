"""The marionette's step, its first derivatives and its contracted second ones."""

from __future__ import annotations

import os

import numpy as np

from benchmarks.cases import Case
from benchmarks.settings import MICRO, Settings
from benchmarks.timing import Absent, Row, Timing, best_of, timed
from leastaction.mechanics import MidpointVI

GROUP = "step"


def rows(case: Case, settings: Settings) -> list[Row | Absent]:
    """Measure along the case's motion; per step, whole roll-outs and linearisations in one call."""
    integrator = MidpointVI(case.mechanism, threads=1)
    t, x0, u = case.t, case.x0, case.u
    N = case.steps
    out = integrator.core.roll_out(t, x0, None, u, None)
    if out.steps < N:
        raise RuntimeError(f"{case.name}: the roll-out failed after {out.steps} of {N} steps")
    x = out.x

    step = best_of(lambda: integrator.core.roll_out(t, x0, None, u, None), budget=settings.budget)
    first = _first(integrator, case, x, settings)
    second = _second(integrator, case, x, settings)
    newton = out.iterations / N
    result: list[Row | Absent] = [
        timed(
            GROUP,
            "step",
            step / N,
            "step",
            target=12 * MICRO,
            dissertation=1370 * MICRO,
            note=f"{newton:.2f} Newton iterations, {out.factorizations / N:.2f} factorisations",
            details={"newton_iterations": newton, "steps": N, "mechanism": case.name},
        ),
        _left_split(case, settings),
        timed(
            GROUP,
            "first derivatives A, B",
            first / N,
            "step",
            target=20 * MICRO,
            dissertation=780 * MICRO,
        ),
        timed(
            GROUP,
            "second derivatives, contracted",
            second / N,
            "step",
            target=60 * MICRO,
            dissertation=18700 * MICRO,
            note="dissertation: full tensors, which its optimiser then contracts",
        ),
        timed(GROUP, "A, B and second together", _sum(first, second) / N, "step"),
        Row(
            GROUP,
            "(A, B and second) / (A, B)",
            (first.best + second.best) / first.best,
            unit="",
            target=2.5,
        ),
    ]
    threads = os.cpu_count() or 1
    if threads > 1:
        parallel = MidpointVI(case.mechanism, threads=threads)
        a, b = _first(parallel, case, x, settings), _second(parallel, case, x, settings)
        result += [
            timed(GROUP, "first derivatives A, B, all threads", a / N, "step", threads=threads),
            timed(GROUP, "second derivatives, contracted, all threads", b / N, "step", threads=threads),
        ]
    return result


def _first(integrator: MidpointVI, case: Case, x: np.ndarray, settings: Settings) -> Timing:
    """Time A, B of the whole motion, written over those of the call before as an optimisation does."""
    d = integrator.linearize_arrays(case.t, x, case.u)
    return best_of(lambda: integrator.linearize_arrays(case.t, x, case.u, out=d), budget=settings.budget)


def _second(integrator: MidpointVI, case: Case, x: np.ndarray, settings: Settings) -> Timing:
    """Time the contracted second order alone, with all that it takes over from the first."""
    d = integrator.linearize_arrays(case.t, x, case.u)
    z = np.random.default_rng(0).normal(size=(case.steps, case.mechanism.nx))
    return best_of(lambda: d.curvature(z), budget=settings.budget)


def _left_split(case: Case, settings: Settings) -> Row:
    """The step as the dissertation splits forces; its states are held against the stored ones."""
    core = MidpointVI(case.mechanism, split="left", threads=1).core
    out = core.roll_out(case.t, case.x0, None, case.u, None)
    timing = best_of(lambda: core.roll_out(case.t, case.x0, None, case.u, None), budget=settings.budget)
    note, details = "", {}
    if case.q is not None:
        difference = float(np.abs(out.x[:, : case.mechanism.nq] - case.q).max())
        note = f"within {difference:.1g} of the independent program's states"
        details = {"largest_difference": difference}
    return timed(GROUP, "step, left split", timing / case.steps, "step", note=note, details=details)


def _sum(a: Timing, b: Timing) -> Timing:
    return Timing(a.best + b.best, a.median + b.median, min(a.repeats, b.repeats))
