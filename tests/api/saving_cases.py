"""Runs and results of every kind, small, for tests of their files."""

from __future__ import annotations

from typing import Any

import numpy as np

import leastaction as la
from leastaction.optimal import LinearSystem


def hanging() -> la.Mechanism:
    """A bob on a string below a hook that is moved, with an input and names that are awkward."""
    return la.Mechanism(
        [
            la.tx("hook", name="hook", kinematic=True),
            la.ty("side"),
            [la.tz("bob/z.1", name="bob", mass=1.0)],
            la.ry("arm", name="arm", mass=0.1, inertia=(0.1, 0.1, 0.1)),
        ],
        [
            la.Gravity(),
            la.Distance("hook", "bob", 1.0, name="string.1/a"),
            la.JointForce("side", "push"),
            la.JointForce("arm", "motor"),
        ],
    ).with_parameters({"bob.mass": 0.1 + 0.2})


def arm() -> la.Mechanism:
    """A bob on an arm that a motor turns."""
    return la.Mechanism(
        [la.ry("elbow"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("elbow", "motor")]
    )


def simulated() -> la.Trajectory:
    vi = la.MidpointVI(hanging())
    m = vi.mechanism
    t = np.linspace(1.0, 1.2, 5)
    start = vi.start(m.configuration({"side": 0.6, "bob/z.1": -0.8}), t=1.0)
    return vi.simulate(start, t, inputs=np.full((4, 2), 1.0 / 3.0), rho=np.linspace(0.0, 0.01, 4)[:, None])


def integrated() -> la.ContinuousTrajectory:
    m = hanging()
    q = m.configuration({"side": 0.6, "bob/z.1": -0.8})
    event = la.Event(lambda t, x: x[m.variables.index("side")] - 0.59)
    return la.simulate(
        m, q, 0.0 * q, t=np.linspace(1.0, 1.2, 5), inputs=np.array([0.1, 0.3]), events={"cross.ed/50%": event}
    )


def system(*, multipliers: bool = False) -> la.MidpointSystem:
    vi = la.MidpointVI(hanging(), split="left", tolerance=1e-12, threads=1)
    return la.MidpointSystem(vi, np.linspace(1.0, 1.2, 5), multipliers=multipliers)


def cost(problem: la.MidpointSystem) -> la.QuadraticCost:
    N, nx, nu = problem.N, problem.nx, problem.nu
    return la.QuadraticCost(np.zeros((N + 1, nx)), np.zeros((N, nu)), Q=np.ones(nx), R=np.ones(nu))


def optimised(*, multipliers: bool = False, **options: Any) -> la.OptimizationResult:
    problem = system(multipliers=multipliers)
    m = problem.mechanism
    x = np.zeros(problem.nx)
    x[: m.nx] = problem.integrator.start(m.configuration({"side": 0.6, "bob/z.1": -0.8}), t=1.0).x
    given = {"initial": (x, np.zeros((problem.N, problem.nu))), "max_iterations": 2} | options
    return la.optimize(problem, cost(problem), **given)


def limited() -> la.OptimizationResult:
    return optimised(
        limits=[la.Bound("push", -1.0, 1.0), la.Bound("bob/z.1", max=0.0)], unknowns=[la.FinalTime(guess=1.25)]
    )


def optimised_continuously(**options: Any) -> la.OptimizationResult:
    m = la.Mechanism(
        [la.ry("elbow"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("elbow", "motor")]
    )
    weights = la.ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
    given = {"initial": ([0.3, 0.0], [0.0]), "horizon": (1.0, 1.5), "max_iterations": 1} | options
    dynamics = la.ContinuousDynamics(m, constraint_damping=1.0)
    return la.optimize(la.MechanismSystem(dynamics), weights, **given)


def of_functions() -> la.OptimizationResult:
    fall = LinearSystem(np.eye(1), np.eye(1), N=3)
    weights = la.QuadraticCost(np.zeros((4, 1)), np.zeros((3, 1)), Q=[1.0], R=[1.0])
    return la.optimize(fall, weights, initial=([1.0], np.zeros((3, 1))))


def played() -> la.Played:
    m = la.Mechanism(
        [la.ry("elbow"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("elbow", "motor")]
    )
    t = np.linspace(0.0, 0.2, 5)
    found = la.follow(m, {"elbow": 0.2 * np.sin(t)}, t=t)
    return la.play(found.system, found.result)


CASES = {
    "simulated": simulated,
    "integrated": integrated,
    "optimised": optimised,
    "optimised, multipliers": lambda: optimised(multipliers=True),
    "limited": limited,
    "optimised continuously": optimised_continuously,
    "limited continuously": lambda: optimised_continuously(limits=[la.Bound("motor", -1.0, 1.0)]),
    "of functions": of_functions,
    "played": played,
}
