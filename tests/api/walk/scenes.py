"""The mechanisms, runs and results that right calls are made of."""

from __future__ import annotations

import functools

import numpy as np

import leastaction as la
from leastaction import mechanics as mech
from leastaction import optimal, systems
from leastaction.optimal import continuous as continuous_costs

Q, V = [0.3, 0.8], [0.1, 0.2]


@functools.cache
def arm() -> la.Mechanism:
    """Return two links with a force, a string to a prescribed place and damping."""
    links = [mech.rx("a"), [mech.tz(-1.0, mass=1.0, name="A"), [mech.rx("b"), [mech.tz(-1.0, mass=0.5, name="B")]]]]
    hook = mech.ty("hook", kinematic=True, name="hook")
    forces = [mech.JointForce("b", input="u"), mech.Damping({"a": 0.1})]
    return la.Mechanism([*links, hook], [mech.Gravity(), mech.Distance("hook", "B", 1.5, name="bar"), *forces])


@functools.cache
def free_arm() -> la.Mechanism:
    links = [mech.rx("a"), [mech.tz(-1.0, mass=1.0, name="A"), [mech.rx("b"), [mech.tz(-1.0, mass=0.5, name="B")]]]]
    return la.Mechanism(links, [mech.Gravity(), mech.JointForce("b", input="u")])


@functools.cache
def held() -> np.ndarray:
    return mech.project_configuration(arm(), [0.3, 0.8, 0.0]).q


@functools.cache
def integrator() -> la.MidpointVI:
    return la.MidpointVI(free_arm(), threads=1)


@functools.cache
def run() -> la.Trajectory:
    vi = integrator()
    return vi.simulate(vi.start([0.3, 0.8]), np.linspace(0.0, 0.1, 11))


@functools.cache
def continuous() -> mech.ContinuousTrajectory:
    return mech.simulate(free_arm(), [0.3, 0.8], None, np.linspace(0.0, 0.1, 6))


class Square(mech.PythonFunction):
    """``z[0]^2``, a user's own function."""

    def value(self, z):
        return z[0] ** 2

    def gradient(self, z):
        return np.array([2.0 * z[0], *np.zeros(len(z) - 1)])

    def hessian(self, z):
        return np.diag([2.0, *np.zeros(len(z) - 1)])


def oscillator(x, u, k):
    return np.array([x[0] + 0.1 * x[1], x[1] - 0.1 * x[0] + 0.1 * u[0]])


def oscillator_rate(x, u, t):
    return np.array([x[1], u[0] - x[0]])


TIMES = 0.02 * np.arange(6)


@functools.cache
def steps() -> la.MidpointSystem:
    return la.MidpointSystem(integrator(), TIMES)


@functools.cache
def price() -> la.QuadraticCost:
    s = steps()
    return la.QuadraticCost(np.zeros((s.N + 1, s.nx)), np.zeros((s.N, s.nu)), Q=np.ones(s.nx), R=np.eye(s.nu))


@functools.cache
def guess():
    return integrator().start(Q).x, np.zeros((steps().N, steps().nu))


@functools.cache
def found() -> la.OptimizationResult:
    return la.optimize(steps(), price(), initial=guess(), limits=[la.Bound("u", -1.0, 1.0)], max_iterations=2)


@functools.cache
def tied() -> la.MidpointSystem:
    return la.MidpointSystem(la.MidpointVI(arm(), threads=1), TIMES)


@functools.cache
def tied_run() -> la.Trajectory:
    vi = tied().integrator
    return vi.simulate(vi.start(held()), TIMES)


@functools.cache
def tied_price() -> la.QuadraticCost:
    s = tied()
    wanted = np.tile(la.MidpointVI(arm(), threads=1).start(held()).x, (s.N + 1, 1))
    return la.QuadraticCost(wanted, np.zeros((s.N, s.nu)), Q=np.ones(s.nx), R=np.eye(s.nu))


@functools.cache
def tied_guess():
    s = tied()
    u = np.zeros((s.N, s.nu))
    u[:, [s.input_name(j).endswith("hook") for j in range(s.nu)]] = held()[2]
    return la.MidpointVI(arm(), threads=1).start(held()).x, u


@functools.cache
def puppet() -> la.Mechanism:
    """Return a weight on a string whose length is prescribed."""
    links = [la.ty("y"), [la.tz("z", mass=1.0, name="weight")]]
    thread = mech.Distance("world", "weight", "string", name="thread")
    return la.Mechanism(links, [la.Gravity(), thread], kinematic=["string"])


@functools.cache
def hung() -> la.MidpointSystem:
    return la.MidpointSystem(la.MidpointVI(puppet(), threads=1), TIMES)


@functools.cache
def hung_guess():
    s = hung()
    state = s.integrator.start([0.1, -np.sqrt(1.0 - 0.01), 1.0])
    return state.x, np.ones((s.N, s.nu))


@functools.cache
def hung_price() -> la.QuadraticCost:
    s = hung()
    return la.QuadraticCost(
        np.tile(hung_guess()[0], (s.N + 1, 1)), np.ones((s.N, s.nu)), Q=np.ones(s.nx), R=np.eye(s.nu)
    )


@functools.cache
def flow() -> continuous_costs.FunctionContinuousSystem:
    return continuous_costs.FunctionContinuousSystem(oscillator_rate, nx=2, nu=1, derivatives="complex-step")


@functools.cache
def flow_price() -> la.ContinuousQuadraticCost:
    return la.ContinuousQuadraticCost(np.zeros(2), np.zeros(1), Q=np.ones(2), R=np.ones(1), Q_final=np.ones(2))


@functools.cache
def flow_found():
    return la.optimize(flow(), flow_price(), initial=([0.5, 0.0], np.zeros(1)), horizon=(0.0, 1.0), max_iterations=1)


@functools.cache
def line() -> optimal.LinearSystem:
    return optimal.LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], N=5)


@functools.cache
def line_price() -> la.QuadraticCost:
    return la.QuadraticCost(np.ones((6, 2)), np.zeros((5, 1)), Q=np.ones(2), R=np.ones(1))


@functools.cache
def followed() -> systems.Followed:
    return la.follow(free_arm(), {"a": 0.3 + TIMES}, {"a": 10.0}, t=TIMES, tolerance=1e-3)
