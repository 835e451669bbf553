"""The marionette learns a simulated walk (dissertation 6.7.3.1)."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from benchmarks.cases import DT, Array, Case, string_motion
from benchmarks.settings import Settings
from benchmarks.timing import Absent, Row, best_of, timed
from leastaction.mechanics import MidpointVI, Trajectory
from leastaction.optimal import OptimizationResult, QuadraticCost, optimize
from leastaction.systems import MidpointSystem

GROUP = "marionette"

# Weights: the puppet's own variables count, momenta and velocities hardly, and the strings are free to do
# what they must.
_BODY, _STRINGS, _RATES, _INPUTS = 100.0, 0.01, 0.01, 0.01


@dataclass(frozen=True)
class Problem:
    """What is optimised: the wanted motion, the cost, and the trajectory to start from."""

    system: MidpointSystem
    cost: QuadraticCost
    t: Array
    wanted: Trajectory
    x: Array
    u: Array


def problem(case: Case, steps: int, *, threads: int = 1) -> Problem:
    """Return the dissertation's problem.

    The wanted configurations are those of a simulation in which the strings of arms and legs vary
    sinusoidally; wanted momenta, velocities and inputs are zero, so the wanted motion is not one the puppet
    can make. The start is the simulation with all strings held.
    """
    m = case.mechanism
    integrator = MidpointVI(m, threads=threads)
    t = DT * np.arange(steps + 1)
    start = integrator.start(case.x0[: m.nq], p=case.x0[m.nq : m.nq + m.nd])
    wanted = integrator.simulate(start, t, rho=string_motion(m, start.q[m.nd :], t))
    held = integrator.simulate(start, t)
    x_wanted = np.zeros((steps + 1, m.nx))
    x_wanted[:, : m.nq] = wanted.q
    Q = np.full(m.nx, _RATES)
    Q[: m.nd] = _BODY
    Q[m.nd : m.nq] = _STRINGS
    cost = QuadraticCost(x_wanted, np.zeros((steps, m.nu + m.nrho)), Q=Q, R=np.full(m.nu + m.nrho, _INPUTS))
    return Problem(MidpointSystem(integrator, t), cost, t, wanted, held.x, held.u)


def with_tensions(case: Case, steps: int) -> tuple[MidpointSystem, QuadraticCost, tuple[Array, Array]]:
    """Return the walk's system with tensions in its state, its cost, and the start that hangs on still strings."""
    given, nc = problem(case, steps), case.mechanism.nc
    system = MidpointSystem(MidpointVI(case.mechanism, threads=1), given.t, multipliers=True)
    none = np.zeros((steps + 1, nc))
    Q = np.concatenate([given.cost.Q, np.zeros(nc)])
    cost = QuadraticCost(np.hstack([given.cost.x_wanted, none]), given.cost.u_wanted, Q=Q, R=given.cost.R)
    return system, cost, (np.hstack([given.x, none]), given.u)


def mean_tensions(system: MidpointSystem, result: OptimizationResult) -> dict[str, float]:
    """Return the mean tension (N) of each string along a motion."""
    return {name: float(along.mean()) for name, along in system.trajectory(result.x, result.u).tensions().items()}


def solve(given: Problem) -> OptimizationResult:
    """Optimise."""
    return optimize(given.system, given.cost, initial=(given.x, given.u))


def rows(case: Case, settings: Settings) -> list[Row | Absent]:
    """Measure whole optimisations, on one thread and on all."""
    result: list[Row | Absent] = []
    cores = os.cpu_count() or 1
    for threads in (1, cores) if cores > 1 else (1,):
        given = problem(case, settings.steps, threads=threads)
        solved: list[OptimizationResult] = []
        timing = best_of(
            lambda given=given, solved=solved: solved.append(solve(given)),
            budget=settings.budget,
            least=settings.repeats,
        )
        last = solved[-1]
        q, nd = last.x[:, : case.mechanism.nq], case.mechanism.nd
        error = float(np.sqrt(np.mean((q - given.wanted.q)[:, 3:nd] ** 2)))
        result.append(
            timed(
                GROUP,
                f"marionette optimisation, {settings.steps} steps" + ("" if threads == 1 else ", all threads"),
                timing,
                "run",
                threads=threads,
                target=settings.target(0.45) if threads == 1 else None,
                dissertation=settings.target(33.0),
                note=f"{last.iterations} iterations ({_methods(last)}), {last.rollouts} roll-outs, "
                f"{last.status.name.lower()}",
                details=_details(last) | {"rms_angle_error_rad": error},
            )
        )
    return result


def _methods(result: OptimizationResult) -> str:
    names = list(dict.fromkeys(result.history.method))
    return ", ".join(f"{result.history.method.count(name)} {name}" for name in names)


def _details(result: OptimizationResult) -> dict[str, object]:
    return {
        "iterations": result.iterations,
        "methods": list(result.history.method),
        "costs": [float(value) for value in result.history.cost],
        "rollouts": result.rollouts,
        "status": result.status.name,
        "seconds": dict(result.timings),
    }
