"""Robot arms that reach for a pose, beside crocoddyl: ``python -m benchmarks.arms [--quick]``.

UR5 (6 joints) and Panda (7, fingers fixed) from their URDF in example-robot-data, one second in 100 and in 1000 steps.
Both start in the same pose, held against gravity, and minimise the same integral of squared angles to the goal and
torques, with a last weight on angles and velocities. We step by the midpoint rule and crocoddyl by semi-implicit Euler,
so the costs agree but for the error of the time step. Both stop where the next step is expected to gain less than the
same part of the cost. Times are those of the processor, on one thread.

Then once more with torques that are limited, to a part of what each joint used, if that holds the arm where it starts,
beside BoxFDDP. Both start as before.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks import unit  # noqa: E402
from benchmarks.cases import Array  # noqa: E402
from benchmarks.continuous import conversion  # noqa: E402
from leastaction.mechanics import MidpointVI  # noqa: E402
from leastaction.optimal import Bound, QuadraticCost, optimize  # noqa: E402
from leastaction.systems import MidpointSystem  # noqa: E402

__all__ = ["Run", "Task", "fddp", "midpoint", "tasks"]

_SECONDS = 1.0
_ANGLES, _TORQUES, _LAST_ANGLES, _LAST_RATES = 1.0, 1e-3, 1e3, 1e1  # weights
_TOLERANCE = 1e-8  # expected decrease over cost
_PART = 0.7  # of the largest torque of each joint, where it is limited


@dataclass(frozen=True)
class Task:
    """A Pinocchio model that is to go from one pose to another in so many steps."""

    name: str
    model: Any
    start: Array
    goal: Array
    steps: int

    @property
    def dt(self) -> float:
        """Seconds of a step."""
        return _SECONDS / self.steps


@dataclass(frozen=True)
class Run:
    """What a program made of a task."""

    cost: float
    converged: bool
    iterations: int
    seconds: float
    last: Array  # pose at the end
    inputs: Array

    def line(self) -> str:
        """Return its figures."""
        each = 1e3 * self.seconds / max(self.iterations, 1)
        return (
            f"{1e3 * self.seconds:8.1f} ms, {self.iterations:3d} it, {each:7.2f} ms an iteration, cost {self.cost:.6g}"
            + ("" if self.converged else ", NOT CONVERGED")
        )


def tasks(steps: int) -> list[Task]:
    """Return both arms' tasks."""
    import example_robot_data
    import pinocchio

    ur5 = example_robot_data.load("ur5").model
    panda = example_robot_data.load("panda").model
    fingers = [j for j in range(1, panda.njoints) if "finger" in panda.names[j]]
    panda = pinocchio.buildReducedModel(panda, fingers, pinocchio.neutral(panda))
    return [
        Task(
            "UR5, 6 joints", ur5, np.array([0.0, -1.2, 1.0, -0.5, 0.3, 0.0]),
            np.array([1.0, -0.6, 1.6, 0.4, -0.5, 0.8]), steps,
        ),
        Task(
            "Panda, 7 joints", panda, np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]),
            np.array([0.9, 0.3, -0.4, -1.2, 0.5, 2.0, 0.0]), steps,
        ),
    ]  # fmt: skip


def _best(solve: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    best = np.inf
    for _ in range(repeats):
        began = time.process_time()
        result = solve()
        best = min(best, time.process_time() - began)
    return result, best


def _hold(task: Task) -> Array:
    """Return the torques that hold the arm where it starts."""
    import pinocchio

    held: Array = pinocchio.computeGeneralizedGravity(task.model, task.model.createData(), task.start)
    return held


def limit(task: Task, free: Run) -> Array:
    """Return the most that joints may use, of which the free motion uses more."""
    return np.maximum(_PART * np.abs(free.inputs).max(axis=0), 1.05 * np.abs(_hold(task)))


def midpoint(task: Task, most: Array | None = None, *, repeats: int = 3) -> Run:
    """Solve by the midpoint rule and the projection operator; within limits of the torques, if there are any."""
    import pinocchio

    model, N, dt, n = task.model, task.steps, task.dt, task.model.nv
    integrator = MidpointVI(conversion().mechanism_of(model), threads=1)
    system = MidpointSystem(integrator, dt * np.arange(N + 1))
    wanted = np.concatenate([task.goal, np.zeros(n)])
    # The last momentum counts as its velocity would.
    data = model.createData()
    inertia = pinocchio.crba(model, data, task.goal)
    inertia = np.triu(inertia) + np.triu(inertia, 1).T
    last = np.zeros((2 * n, 2 * n))
    last[:n, :n] = _LAST_ANGLES * np.eye(n)
    inverse = np.linalg.inv(inertia)
    last[n:, n:] = _LAST_RATES * 0.5 * (inverse @ inverse + (inverse @ inverse).T)
    cost = QuadraticCost(
        np.tile(wanted, (N + 1, 1)), np.zeros((N, n)),
        Q=dt * np.concatenate([_ANGLES * np.ones(n), np.zeros(n)]),
        R=dt * _TORQUES * np.ones(n), Q_final=last,
    )  # fmt: skip
    initial = np.concatenate([task.start, np.zeros(n)]), np.tile(_hold(task), (N, 1))
    limits = (
        []
        if most is None
        else [Bound(name, -b, b) for name, b in zip(system.quantity("input").names, most, strict=True)]
    )
    result, seconds = _best(
        lambda: optimize(system, cost, initial=initial, limits=limits, tolerance=_TOLERANCE), repeats
    )
    converged = result.status.name in ("CONVERGED", "STALLED")
    return Run(result.cost, converged, result.iterations, seconds, result.x[-1, :n], result.u)


def fddp(task: Task, goal: float, most: Array | None = None, *, repeats: int = 3) -> Run:
    """Solve by crocoddyl's FDDP until it expects to gain less than the tolerance of a cost of about ``goal``.

    With limits of the torques, by BoxFDDP.
    """
    import crocoddyl
    import pinocchio

    model, N, dt, n = task.model, task.steps, task.dt, task.model.nv
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFull(state)
    wanted = np.concatenate([task.goal, np.zeros(n)])

    def residual(weights: Array) -> Any:
        activation = crocoddyl.ActivationModelWeightedQuad(weights)
        return crocoddyl.CostModelResidual(state, activation, crocoddyl.ResidualModelState(state, wanted, n))

    running, terminal = crocoddyl.CostModelSum(state, n), crocoddyl.CostModelSum(state, n)
    running.addCost("angles", residual(np.concatenate([np.ones(n), np.zeros(n)])), _ANGLES)
    torques = crocoddyl.ResidualModelControl(state, np.zeros(n))
    running.addCost("torques", crocoddyl.CostModelResidual(state, torques), _TORQUES)
    last = np.concatenate([_LAST_ANGLES * np.ones(n), _LAST_RATES * np.ones(n)])
    terminal.addCost("last", residual(last), 1.0)

    def action(costs: Any, step: float) -> Any:
        dynamics = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
        # Without this crocoddyl 3.2.1 leaves gravity out beside Pinocchio 4.1.
        dynamics.armature = np.zeros(n)
        data = dynamics.createData()
        dynamics.calc(data, np.concatenate([task.start, np.zeros(n)]), np.ones(n))
        exact = pinocchio.aba(model, model.createData(), task.start, np.zeros(n), np.ones(n))
        if not np.allclose(data.xout, exact, rtol=1e-9, atol=1e-9):
            raise AssertionError("crocoddyl's accelerations are not those of pinocchio.aba")
        stepped = crocoddyl.IntegratedActionModelEuler(dynamics, step)
        if most is not None and step > 0.0:
            stepped.u_lb, stepped.u_ub = -most, most
        return stepped

    x0 = np.concatenate([task.start, np.zeros(n)])
    problem = crocoddyl.ShootingProblem(x0, [action(running, dt)] * N, action(terminal, 0.0))
    problem.nthreads = 1
    hold = _hold(task)
    solver = crocoddyl.SolverFDDP(problem) if most is None else crocoddyl.SolverBoxFDDP(problem)
    solver.th_stop = _TOLERANCE * goal

    def solve() -> bool:
        return bool(solver.solve([x0] * (N + 1), [hold] * N, 500, False))

    done, seconds = _best(solve, repeats)
    return Run(solver.cost, done, solver.iter, seconds, np.array(solver.xs[-1][:n]), np.array(solver.us))


def _compare(name: str, ours: Run, program: str, theirs: Run) -> None:
    print(name)
    print(f"    ours              {ours.line()}")
    print(f"    crocoddyl {program:7s} {theirs.line()}")
    print(
        f"    faster by {theirs.seconds / ours.seconds:.1f} in all; the poses at the end differ by "
        f"{np.abs(ours.last - theirs.last).max():.1g} rad",
        flush=True,
    )


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="100 steps only, each once")
    arguments = parser.parse_args()
    try:
        import crocoddyl
        import example_robot_data  # noqa: F401
    except ImportError as error:
        print(f"{error.name} is not installed: there is nothing to compare with", file=sys.stderr)
        return 0
    repeats = 1 if arguments.quick else 3
    for steps in (100,) if arguments.quick else (100, 1000):
        for task in tasks(steps):
            free = midpoint(task, repeats=repeats)
            _compare(f"{task.name}, {steps} steps", free, "FDDP", fddp(task, free.cost, repeats=repeats))
            most = limit(task, free)
            limited = midpoint(task, most, repeats=repeats)
            name = f"{task.name}, {steps} steps, torques at most {100 * _PART:.0f} %"
            _compare(name, limited, "BoxFDDP", fddp(task, limited.cost, most, repeats=repeats))
    measured = unit.measure(0.5)
    note = measured if isinstance(measured, str) else f"{1e6 * measured.best:.1f} us"
    print(f"crocoddyl {crocoddyl.__version__}, unit {note}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
