"""Free initial states, motions that return, shortest times and parameters, beside Ipopt.

They are rows of ``python -m benchmarks.limits``. Both solve the same discrete problem from the same start. Ipopt has
states, inputs, parameters and the final time as unknowns, the steps as constraints, and exact derivatives by CasADi,
which interprets them here: the unknown numbers enter every step, so the stages' own derivatives of
`benchmarks.multiple_shooting` will not do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.casadi_mechanism import Symbolic
from benchmarks.multiple_shooting import EXACTLY
from benchmarks.peers import Comparison
from benchmarks.timing import fastest
from leastaction.mechanics import Damping, Gravity, JointForce, JointSpring, Mechanism, MidpointVI, rx, ry, ty, tz
from leastaction.optimal import Bound, Equal, FinalTime, Limit, Parameter, Periodic, QuadraticCost, Unknown, optimize
from leastaction.systems import MidpointSystem

__all__ = ["Case", "cases", "compare"]

_IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 1000, "max_cpu_time": 20.0}


@dataclass(frozen=True)
class Case:
    """A problem for both solvers, from rest, without inputs but those that are known.

    ``ends``: what is zero of the first and the last state, for Ipopt. ``low``, ``high``: bounds on states, and on
    inputs. ``free_start``, ``unknowns``, ``limits``: as of `optimize`.
    """

    name: str
    system: MidpointSystem
    cost: QuadraticCost
    ends: Callable[[Any, Any], Any]
    low: tuple[Any, Any]
    high: tuple[Any, Any]
    limits: Sequence[Limit]
    unknowns: Sequence[Unknown] = ()
    free_start: bool = False


def _cart(steps: int, duration: float, mass: float = 4.0) -> MidpointSystem:
    m = Mechanism(
        [ty("cart", mass=mass), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]],
        [Gravity((0.0, 0.0, -9.8)), JointForce("cart", input="push"), Damping({"pole": 0.05})],
    )
    return MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, duration, steps + 1))


def _arm(steps: int, duration: float) -> MidpointSystem:
    m = Mechanism(
        [ry("shoulder"), [tz(-0.5, mass=1.0), [ry("elbow"), [tz(-0.5, mass=0.5, name="hand")]]]],
        [Gravity((0.0, 0.0, -9.81)), JointForce("shoulder", input="upper"), JointForce("elbow", input="lower")],
    )
    return MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, duration, steps + 1))


def _shortest(name: str, system: MidpointSystem, goal: list[float], most: list[float], angle: float) -> Case:
    """Return a shortest time from rest to rest; the last variable stays within an angle."""
    nq, nx = len(goal), system.nx
    cost = QuadraticCost(
        np.zeros((system.N + 1, nx)), np.zeros((system.N, system.nu)), Q=np.zeros(nx), R=[1e-5] * system.nu
    )
    inputs, last = system.quantity("input").names, system.quantity("variable").names[-1]
    end, high = np.r_[goal, np.zeros(nx - nq)], np.full(nx, np.inf)
    limits: list[Limit] = [Bound(each, -a, a, of="input") for each, a in zip(inputs, most, strict=True)]
    limits.append(Equal("*", end, of="state"))
    if np.isfinite(angle):
        limits.append(Bound(last, -angle, angle, of="variable"))
        high[nq - 1] = angle
    unknowns = [FinalTime(0.1, 20.0, price=1.0)]
    return Case(
        name, system, cost, lambda first, last: ca.vertcat(first, last - end), (-high, -np.array(most)),
        (high, np.array(most)), limits, unknowns,
    )  # fmt: skip


def _springy(steps: int, duration: float, stiffness: float, friction: float) -> MidpointSystem:
    """Return the cart whose pole is held by a spring with friction."""
    m = Mechanism(
        [ty("cart", mass=4.0), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]],
        [
            Gravity((0.0, 0.0, -9.8)), JointForce("cart", input="push"), Damping({"pole": friction}, name="friction"),
            JointSpring("pole", stiffness, name="spring"),
        ],
    )  # fmt: skip
    return MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, duration, steps + 1))


def _identified() -> Case:
    """Return the search for a spring and a friction by what was measured of places, with noise, under a known push."""
    system, true = _springy(150, 3.0, 3.0, 0.05), _springy(150, 3.0, 7.0, 0.3)
    push = 15.0 * np.sin(2.0 * system.t[:-1, None]) * np.cos(0.7 * system.t[:-1, None])
    motion = true.rollout(np.zeros(4), np.zeros((151, 4)), push, np.zeros((150, 1, 4)), 0, 150).x
    noise = 0.01 * np.random.default_rng(0).normal(size=motion.shape)
    cost = QuadraticCost(motion + noise, push, Q=[1e4, 1e4, 0.0, 0.0], R=[100.0])
    unknowns = [Parameter("spring.stiffness", 0.5, 30.0), Parameter("friction.pole", 0.0, 2.0)]
    free = np.full(4, np.inf), np.array([15.0])
    return Case(
        "cart, spring and friction identified", system, cost, lambda first, last: first,  # noqa: ARG005
        (-free[0], -free[1]), free, [Bound("push", -15.0, 15.0)], unknowns,
    )  # fmt: skip


def _designed() -> Case:
    """Return the search for the springs with which an arm waves under the least torques."""
    m = Mechanism(
        [ry("shoulder"), [tz(-0.5, mass=1.0), [ry("elbow"), [tz(-0.5, mass=0.5, name="hand")]]]],
        [
            Gravity((0.0, 0.0, -9.81)), JointForce("shoulder", input="upper"), JointForce("elbow", input="lower"),
            JointSpring("shoulder", 2.0, name="at_shoulder"), JointSpring("elbow", 2.0, name="at_elbow"),
        ],
    )  # fmt: skip
    system, most = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 2.0, 101)), np.array([8.0, 3.0])
    wanted = np.zeros((101, 4))
    wanted[:, 0], wanted[:, 1] = 0.8 * np.sin(np.pi * system.t) ** 2, 0.6 * np.sin(2.0 * np.pi * system.t) ** 2
    cost = QuadraticCost(wanted, np.zeros((100, 2)), Q=[100.0, 100.0, 1e-3, 1e-3], R=[1e-2, 1e-2])
    unknowns = [Parameter("at_shoulder.stiffness", 0.0, 40.0), Parameter("at_elbow.stiffness", 0.0, 40.0)]
    limits = [Bound("upper", -8.0, 8.0), Bound("lower", -3.0, 3.0)]
    return Case(
        "two-link arm, springs designed, torques bounded", system, cost, lambda first, last: first,  # noqa: ARG005
        (np.full(4, -np.inf), -most), (np.full(4, np.inf), most), limits, unknowns,
    )  # fmt: skip


def _wave(system: MidpointSystem, **weights: Any) -> QuadraticCost:
    wanted = np.zeros((system.N + 1, system.nx))
    wanted[:, 0] = 0.3 * np.sin(2.0 * np.pi * system.t / system.t[-1]) + 0.1 * np.cos(4.0 * np.pi * system.t)
    return QuadraticCost(wanted, np.zeros((system.N, system.nu)), **weights)


def cases() -> list[Case]:
    """Return the problems."""
    swing, two = _cart(100, 2.0), _arm(100, 2.0)
    none, one = (np.inf, np.inf), (np.inf, np.array([8.0]))
    Q, R = [10.0, 1.0, 1e-3, 1e-3], [1e-3]
    returns, begins = (lambda first, last: last - first), (lambda first, last: ca.DM(0, 1))  # noqa: ARG005
    return [
        _shortest("cart, shortest time, push and pole bounded", _cart(50, 3.0), [2.0, 0.0], [15.0], 0.2),
        _shortest("crane, shortest time, tight pole, 100 steps", _cart(100, 3.0, 8.0), [3.0, 0.0], [10.0], 0.05),
        _shortest("two-link arm, shortest time, torques bounded", _arm(50, 1.0), [1.2, 0.8], [12.0, 6.0], np.inf),
        Case("cart, periodic, no bounds", swing, _wave(swing, Q=Q, R=R), returns, (-none[0], -none[1]), none,
             [Periodic("*")], free_start=True),
        Case("cart, periodic, push bounded", swing, _wave(swing, Q=Q, R=R), returns, (-one[0], -one[1]), one,
             [Periodic("*"), Bound("push", -8.0, 8.0)], free_start=True),
        Case("cart, free initial state, push bounded", swing, _wave(swing, Q=Q, R=R), begins, (-one[0], -one[1]), one,
             [Bound("push", -8.0, 8.0)], free_start=True),
        Case("two-link arm, periodic", two, _wave(two, Q=Q, R=[1e-3, 1e-3]), returns, (-none[0], -none[1]), none,
             [Periodic("*")], free_start=True),
        _identified(),
        _designed(),
    ]  # fmt: skip


def compare(case: Case, *, rounds: int = 3) -> Comparison:
    """Solve a case with both."""
    system = case.system
    start = np.zeros(system.nx), case.cost.u_wanted
    options: dict[str, Any] = {"limits": case.limits, "unknowns": case.unknowns, "free_start": case.free_start}
    result, seconds = fastest(lambda: optimize(system, case.cost, initial=start, **options), rounds)
    price = sum(each.price * result.unknowns[each.name] for each in case.unknowns)
    solver, arguments = _peer(case)
    found, theirs = fastest(lambda: solver(**arguments), rounds)
    stats = solver.stats()
    cost = case.cost.value(result.x, result.u) + price
    return Comparison(
        case.name, cost, float(found["f"]), result.status.name, str(stats["return_status"]), seconds, theirs,
        result.iterations, int(stats["iter_count"]), verdict="",
    )  # fmt: skip


def _peer(case: Case) -> tuple[ca.Function, dict[str, Any]]:
    """Return Ipopt for a case, and what it is called with."""
    system, cost = case.system, case.cost
    N, nx, nu = system.N, system.nx, system.nu
    x, u, T = ca.MX.sym("x", nx, N + 1), ca.MX.sym("u", nu, N), ca.MX.sym("T")
    lasts = any(isinstance(each, FinalTime) for each in case.unknowns)
    unknowns = [each for each in case.unknowns if isinstance(each, Parameter)]
    p = ca.MX.sym("p", len(unknowns))
    step = Symbolic(system.integrator.mechanism, [each.name for each in unknowns]).step(ca.SX.sym("dt")).map(N)
    F = step(
        x[:, :-1], u, ca.MX(0, N), x[:, 1:], ca.repmat(T / N, 1, N), *([ca.repmat(p, 1, N)] if unknowns else [])
    )  # fmt: skip
    dx, du = x - cost.x_wanted.T, u - cost.u_wanted.T
    price = sum(each.price for each in case.unknowns)  # of the final time
    value = price * T + 0.5 * (
        ca.sum(ca.vec(ca.DM(np.tile(cost.Q[:, None], N)) * dx[:, :-1] ** 2))
        + ca.sum(ca.vec(ca.DM(np.tile(cost.R[:, None], N)) * du**2))
        + ca.dot(ca.DM(cost.Q_final), dx[:, -1] ** 2)
    )
    w, g = ca.vertcat(ca.vec(x), ca.vec(u), T, p), ca.vertcat(ca.vec(F), case.ends(x[:, 0], x[:, -1]))
    duration = float(system.t[-1])
    bounds = []
    for (of_x, of_u), of_T, of_p in (
        (case.low, 0.1, [each.min for each in unknowns]), (case.high, 20.0, [each.max for each in unknowns]),
    ):  # fmt: skip
        parts = np.broadcast_to(of_x, (N + 1, nx)).ravel(), np.broadcast_to(of_u, (N, nu)).ravel()
        bounds.append(np.concatenate([*parts, [of_T if lasts else duration], of_p]))
    solver = ca.nlpsol("peer", "ipopt", {"x": w, "f": value, "g": g}, {"print_time": 0, "ipopt": {**_IPOPT, **EXACTLY}})
    values = [each.value_of(system) for each in unknowns]
    guess = np.concatenate([np.zeros((N + 1) * nx), cost.u_wanted.ravel(), [duration], values])
    return solver, {"x0": guess, "lbx": bounds[0], "ubx": bounds[1], "lbg": 0.0, "ubg": 0.0}
