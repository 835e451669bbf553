"""Predictive control: how long a call takes, beside CasADi's fatrop and crocoddyl's BoxFDDP on the same tasks.

``python -m benchmarks.mpc [--calls N]``. Times are of this thread's processor, so that what else runs on the machine
counts little; the unit is that of the other benchmarks. A call from which the processor was taken away meanwhile comes
back to cold caches: told is the worst of those from which it was not, too, and the iterations, which are what a call
has to do.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from resource import RUSAGE_THREAD, getrusage  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402

from benchmarks import unit  # noqa: E402
from benchmarks.cases import DT, package_marionette  # noqa: E402
from leastaction.control import MPC  # noqa: E402
from leastaction.costs import tracking  # noqa: E402
from leastaction.mechanics import Damping, Gravity, JointForce, Mechanism, MidpointVI, rx, ry, rz, to_velocity, tz  # noqa: E402
from leastaction.models.cart_pendulum import cart_pendulum  # noqa: E402
from leastaction.numerics.arrays import Array  # noqa: E402
from leastaction.optimal import Bound, QuadraticCost, solve_linear_quadratic  # noqa: E402
from leastaction.systems import MidpointSystem  # noqa: E402

MOST = np.array([80.0, 80.0, 50.0, 50.0, 20.0, 20.0, 10.0])  # N m, of the arm's motors


@dataclass(frozen=True)
class Task:
    """What is controlled, from where, what chance adds to the state at each step, and the goal by the unit (s)."""

    name: str
    mpc: MPC
    x: Array
    chance: Array
    goal: float


def cart() -> Task:
    """Return a cart-pole of 50 steps that balances, with a bounded push and a short track."""
    system = MidpointSystem(MidpointVI(cart_pendulum(), threads=1), 0.02 * np.arange(51))
    cost = tracking(system, {"x": 1.0, "theta": 10.0, "p_*": 0.1}, {"theta": np.pi}, effort=1e-2)
    mpc = MPC(system, cost, [Bound("x-force", -40.0, 40.0), Bound("x", -1.0, 1.0)])
    return Task("cart-pole, 50 steps", mpc, np.array([0.0, np.pi, 0.0, 0.0]), np.array([0.0, 0.0, 0.2, 0.05]), 1e-3)


def arm() -> Task:
    """Return an arm of seven joints of 30 steps that follows a wave, with torques and speeds limited."""
    tree: Any = []
    for i in reversed(range(7)):
        joint = (rz, ry, rz, ry, rz, ry, rx)[i]
        link = tz(0.25, name=f"link{i}", mass=4.0 - 0.5 * i, inertia=(0.05, 0.05, 0.02))
        tree = [joint(f"j{i}"), [link, tree] if tree else [link]]
    motors = [JointForce(f"j{i}", input=f"m{i}") for i in range(7)]
    m = Mechanism(tree, [Gravity(), Damping(0.5), *motors])
    system = MidpointSystem(MidpointVI(m, threads=1), 0.02 * np.arange(31))

    def ahead(t: float) -> QuadraticCost:
        at = t + system.t
        wanted = np.zeros((31, 14))
        wanted[:, :7] = 0.4 * np.sin(2.0 * at[:, None] + np.arange(7))
        return QuadraticCost(wanted, np.zeros((30, 7)), Q=[100.0] * 7 + [0.01] * 7, R=[1e-3] * 7)

    limits = [Bound(f"m{i}", -MOST[i], MOST[i]) for i in range(7)]
    speeds = Bound([f"j{i}" for i in range(7)], -2.0, 2.0, of="rate")
    x = np.concatenate([0.4 * np.sin(np.arange(7.0)), np.zeros(7)])
    return Task("arm of 7, 30 steps", MPC(system, ahead, [*limits, speeds]), x, np.repeat([0.0, 5e-3], 7), 2e-3)


def marionette() -> Task:
    """Return the package's marionette of 20 steps that is to hold its pose, with strings that pull."""
    case = package_marionette()
    system = MidpointSystem(MidpointVI(case.mechanism, threads=1), DT * np.arange(21), multipliers=True)
    m = system.mechanism
    x = np.concatenate([case.x0, np.zeros(m.nc)])
    weights = np.repeat([100.0, 0.01, 0.01, 0.01, 0.0], [m.nd, m.nrho, m.nd, m.nrho, m.nc])
    held = np.concatenate([np.zeros(m.n_inputs), x[m.nd : m.nq]])
    # A fifth of a second is short beside how it swings: what comes after has the price of a long horizon.
    A, B = (np.tile(each, (400, 1, 1)) for each in system.derivatives(x, held, 0))
    P = solve_linear_quadratic(A, B, Q=weights, R=np.ones(system.nu), Q_final=weights, keep_P=True).P
    assert P is not None
    cost = QuadraticCost(
        np.tile(x, (21, 1)), np.tile(held, (20, 1)), Q=weights, R=np.ones(system.nu), Q_final=0.5 * (P[0] + P[0].T)
    )
    mpc = MPC(system, cost, [Bound("*", min=0.0, of="tension")])
    chance = np.zeros(system.nx)
    chance[m.nq : m.nq + m.nd] = 1e-5
    return Task("marionette, 20 steps", mpc, x, chance, 10e-3)


@dataclass(frozen=True)
class Measured:
    """What all calls but the first took: seconds (n,), which of them kept the processor, and their iterations."""

    seconds: Array
    kept: np.ndarray[tuple[int], np.dtype[np.bool_]]
    iterations: tuple[int, ...]
    violation: float
    fallbacks: int


def measure(task: Task, calls: int) -> Measured:
    """Call a controller in a loop that chance pushes."""
    rng, x, system = np.random.default_rng(0), task.x, task.mpc.system
    seconds, kept, iterations, violation, fallbacks = [], [], set[int](), 0.0, 0
    for k in range(calls + 1):
        switches, begun = getrusage(RUSAGE_THREAD).ru_nivcsw, time.thread_time()
        u = task.mpc(x, k * task.mpc.dt)
        if k:
            seconds.append(time.thread_time() - begun)
            kept.append(getrusage(RUSAGE_THREAD).ru_nivcsw == switches)
            violation = max(violation, task.mpc.info.violation)
            fallbacks += not task.mpc.info.planned
            iterations.add(task.mpc.info.interior_iterations)
        x = system.f(x, u, 0) + task.chance * rng.standard_normal(system.nx)
    return Measured(np.array(seconds), np.array(kept), tuple(sorted(iterations)), violation, fallbacks)


def fatrop_on_the_cart(calls: int) -> Array:
    """Return the seconds of fatrop's calls, warm started, on a cart-pole with the same bounds (Runge and Kutta's)."""
    import casadi as ca

    x, u = ca.MX.sym("x", 4), ca.MX.sym("u")
    s, c = ca.sin(x[1]), ca.cos(x[1])
    M = ca.vertcat(ca.horzcat(11.0, c), ca.horzcat(c, 1.0))
    a = ca.solve(M, ca.vertcat(u + s * x[3] ** 2 - 0.01 * x[2], -9.8 * s - 0.01 * x[3]))
    rate = ca.Function("rate", [x, u], [ca.vertcat(x[2:], a)])
    h, k1 = 0.02, rate(x, u)
    k2 = rate(x + h / 2 * k1, u)
    k3 = rate(x + h / 2 * k2, u)
    step = ca.Function("step", [x, u], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + h * k3, u))])
    opti, xs, us = ca.Opti(), [], []
    begin = opti.parameter(4)
    for k in range(51):
        xs.append(opti.variable(4))
        if k < 50:
            us.append(opti.variable(1))
    for k in range(50):
        opti.subject_to(xs[k + 1] == step(xs[k], us[k]))
        if k == 0:
            opti.subject_to(xs[0] == begin)
        opti.subject_to(opti.bounded(-40.0, us[k], 40.0))
        if k:
            opti.subject_to(opti.bounded(-1.0, xs[k][0], 1.0))
    opti.subject_to(opti.bounded(-1.0, xs[50][0], 1.0))
    weights = ca.DM([1.0, 10.0, 0.1, 0.1])
    off = [each - ca.DM([0.0, np.pi, 0.0, 0.0]) for each in xs]
    opti.minimize(0.5 * sum(ca.dot(weights * d, d) for d in off) + 0.5e-2 * sum(each**2 for each in us))
    opti.solver(
        "fatrop", {"structure_detection": "auto", "print_time": False, "fatrop": {"print_level": 0, "tol": 1e-4}}
    )
    at, rng, seconds = np.array([0.0, np.pi, 0.0, 0.0]), np.random.default_rng(0), []
    for each in xs:
        opti.set_initial(each, at)
    for k in range(calls + 1):
        opti.set_value(begin, at)
        begun = time.thread_time()
        try:
            found = opti.solve()
        except RuntimeError:  # where chance has pushed it beyond its track there is no plan within
            found = opti.debug
        if k:
            seconds.append(time.thread_time() - begun)
        plan = [np.asarray(found.value(each)).ravel() for each in xs]
        pushes = [float(found.value(each)) for each in us]
        for each, value in zip(xs, [*plan[1:], plan[-1]], strict=True):
            opti.set_initial(each, value)
        for each, value in zip(us, [*pushes[1:], pushes[-1]], strict=True):
            opti.set_initial(each, value)
        at = np.asarray(step(at, pushes[0])).ravel() + rng.standard_normal(4) * [0.0, 0.0, 0.02, 0.05]
    return np.array(seconds)


def boxfddp_on_the_arm(calls: int) -> Array:
    """Return the seconds of BoxFDDP's calls, an iteration each from where the last one leads, on the same arm.

    Its model has no damping, and its speeds no limits.
    """
    import crocoddyl
    import pinocchio as pin

    model, parent = pin.Model(), 0
    kinds = {"z": pin.JointModelRZ, "y": pin.JointModelRY, "x": pin.JointModelRX}
    for i, axis in enumerate("zyzyzyx"):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.25 * (i > 0)]))
        parent = model.addJoint(parent, kinds[axis](), place, f"j{i}")
        inertia = pin.Inertia(4.0 - 0.5 * i, np.array([0.0, 0.0, 0.25]), np.diag([0.05, 0.05, 0.02]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    state = crocoddyl.StateMultibody(model)
    actuation, followed, actions = crocoddyl.ActuationModelFull(state), [], []
    weights = crocoddyl.ActivationModelWeightedQuad(np.repeat([100.0, 0.01], 7))
    for k in range(31):
        costs = crocoddyl.CostModelSum(state, 7)
        followed.append(crocoddyl.ResidualModelState(state, np.zeros(14), 7))
        costs.addCost("wave", crocoddyl.CostModelResidual(state, weights, followed[-1]), 1.0)
        torques = crocoddyl.ResidualModelControl(state, np.zeros(7))
        costs.addCost("torques", crocoddyl.CostModelResidual(state, torques), 1e-3)
        dynamics = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, costs)
        dynamics.armature = np.zeros(7)
        actions.append(crocoddyl.IntegratedActionModelEuler(dynamics, 0.02 if k < 30 else 0.0))
        if k < 30:
            actions[-1].u_lb, actions[-1].u_ub = -MOST, MOST
    task = arm()
    x, system, rng, seconds = task.x, task.mpc.system, np.random.default_rng(0), []
    m = system.mechanism
    problem = crocoddyl.ShootingProblem(np.zeros(14), actions[:-1], actions[-1])
    problem.nthreads = 1
    solver = crocoddyl.SolverBoxFDDP(problem)
    xs, us = [np.concatenate([x[:7], np.zeros(7)])] * 31, [np.zeros(7)] * 30
    for k in range(calls + 1):
        seen = np.concatenate([x[:7], to_velocity(m, x[:7], x[7:])])
        begun = time.thread_time()
        problem.x0 = seen
        for j, each in enumerate(followed):
            each.reference = np.concatenate([0.4 * np.sin(2.0 * 0.02 * (k + j) + np.arange(7)), np.zeros(7)])
        solver.solve([seen, *xs[1:]], us, 1 if k else 100, False)
        if k:
            seconds.append(time.thread_time() - begun)
        xs, us = [*list(solver.xs)[1:], solver.xs[-1]], [*list(solver.us)[1:], solver.us[-1]]
        u = np.clip(solver.us[0], -MOST, MOST)
        x = system.f(x, u, 0) + task.chance * rng.standard_normal(14)
    return np.array(seconds)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=1000)
    calls = parser.parse_args().calls
    found = unit.measure(0.5)
    share = 1.0 if isinstance(found, str) else found.best / unit.AT_DESIGN
    shown = found if isinstance(found, str) else f"{1e6 * found.best:.1f} us"
    print(f"the unit: {shown}; times in ms by it, {calls} calls")
    tasks: list[Callable[[], Task]] = [cart, arm, marionette]
    for make in tasks:
        task = make()
        it = measure(task, calls)
        median, high, worst = (1e3 * float(np.quantile(it.seconds, q)) / share for q in (0.5, 0.99, 1.0))
        alone = 1e3 * float(it.seconds[it.kept].max(initial=0.0)) / share
        print(
            f"{task.name:23s} median {median:6.2f}  99 % {high:6.2f}  worst {worst:6.2f}  goal {1e3 * task.goal:4.1f}  "
            f"worst of {np.sum(it.kept)} that kept the processor {alone:6.2f}  "
            f"violation {it.violation:.1e}, {it.fallbacks} fallbacks, "
            f"{it.iterations[0]} to {it.iterations[-1]} iterations"
        )
    for name, others in {
        "fatrop on the cart-pole": fatrop_on_the_cart,
        "BoxFDDP on the arm": boxfddp_on_the_arm,
    }.items():
        try:
            seconds = others(min(calls, 300))
        except ImportError as error:
            print(f"{name:23s} {error.name} is not installed")
            continue
        median, high, worst = (1e3 * float(np.quantile(seconds, q)) / share for q in (0.5, 0.99, 1.0))
        print(f"{name:23s} median {median:6.2f}  99 % {high:6.2f}  worst {worst:6.2f}")


if __name__ == "__main__":
    main()
