"""Discrete systems for the tests, in plain NumPy with exact derivatives."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

import leastaction as la
from leastaction.optimal import DiscreteSystem, Linearization, QuadraticCost
from leastaction.systems import MidpointSystem


@cache
def _cart_pendulum_step(dt):
    """Step, Jacobian and second derivatives of a cart with a pendulum, compiled from SymPy."""
    p, th, v, w, F = y = sp.symbols("p th v w F")
    cart, bob, length, gravity = 1.0, 0.3, 1.0, 9.81
    sin, cos = sp.sin(th), sp.cos(th)
    mass = cart + bob * sin**2
    acceleration = (F + bob * sin * (length * w**2 + gravity * cos)) / mass
    angular = (-F * cos - bob * length * w**2 * cos * sin - (cart + bob) * gravity * sin) / (length * mass)
    v_next, w_next = v + dt * acceleration, w + dt * angular
    f = sp.Matrix([p + dt * v_next, th + dt * w_next, v_next, w_next])
    J = f.jacobian(y)
    H = [sp.hessian(f[i], y) for i in range(4)]
    compile_ = lambda e: sp.lambdify(y, e, "numpy", cse=True)  # noqa: E731
    return (
        compile_(list(f)),
        compile_([list(J.row(i)) for i in range(4)]),
        compile_([[list(h.row(i)) for i in range(5)] for h in H]),
    )


def _stack(nested, shape, n):
    """Entries that are constants or arrays over time, as one array with time first."""
    out = np.empty((n, *shape))
    for index in np.ndindex(*shape):
        entry = nested
        for i in index:
            entry = entry[i]
        out[(slice(None), *index)] = entry
    return out


def is_trajectory(system, x, u):
    """Compare every state with the step that leads to it."""
    return all(np.allclose(system.f(x[k], u[k], k), x[k + 1], rtol=1e-9, atol=1e-9) for k in range(len(u)))


def rolled_out(system, x0, u):
    """Return the motion from a state under inputs (N, nu), to which nothing is fed back."""
    N, nu = u.shape
    return system.rollout(x0, np.zeros((N + 1, system.nx)), u, np.zeros((N, nu, system.nx)), 0, N)


def strung_rig(stiffness, smoothing):
    """Return a rig that differs from its model by elastic strings alone."""
    return la.Rig(stiffness=stiffness, smoothing=smoothing, spread=0.0, noise=0.0, delay=0.0)


def crane():
    """Return a cart with a double pendulum whose tip hangs on a string that is reeled, and a configuration of it."""
    mechanism = la.Mechanism(
        [
            la.tx("cart", mass=2.0), [la.rx("a"), [la.tz(-1.0, mass=1.0, inertia=(0.1, 0.2, 0.3)), [
                la.rz("twist"), [la.rx("b"), [la.tz(-0.7, name="tip", mass=0.5, inertia=(0.1, 0.1, 0.05))]],
            ]]],
            la.tz(1.0), [la.tx("winch", name="winch", kinematic=True)],
        ],
        [
            la.Gravity(),
            la.Damping(0.1),
            la.JointForce("cart", "push"),
            la.Distance("tip", "winch", "length", name="string"),
        ],
    )  # fmt: skip
    near = mechanism.configuration({"a": 0.3, "b": -0.4, "twist": 0.2, "length": 2.4})
    return mechanism, la.project_configuration(mechanism, near).q


class CartPendulum(DiscreteSystem):
    """A cart with a pendulum hanging at angle 0; x = [position, angle, their rates], u = [force]."""

    def __init__(self, N=200, dt=0.02):
        self.nx, self.nu, self.N = 4, 1, N
        self._f, self._J, self._H = _cart_pendulum_step(dt)

    def f(self, x, u, k):
        return np.array(self._f(*x, *u))

    def derivatives(self, x, u, k):
        J = np.array(self._J(*x, *u), dtype=float)
        return J[:, :4], J[:, 4:]

    def curvature(self, x, u, k, z):
        return np.einsum("i,ijk->jk", z, np.array(self._H(*x, *u), dtype=float))

    def linearize(self, x, u, out=None):
        J = _stack(self._J(*x[:-1].T, *u.T), (4, 5), self.N)
        return Linearization(np.ascontiguousarray(J[:, :, :4]), np.ascontiguousarray(J[:, :, 4:]))

    def curvatures(self, x, u, z, out=None):
        H = _stack(self._H(*x[:-1].T, *u.T), (4, 5, 5), self.N)
        return np.einsum("ki,kijl->kjl", z[1:], H)


def simulate(system, x0, u):
    """The open-loop trajectory."""
    zero = np.zeros((system.N, system.nu, system.nx))
    xbar = np.zeros((system.N + 1, system.nx))
    rollout = system.rollout(np.asarray(x0, dtype=float), xbar, u, zero, 0, system.N)
    assert rollout.complete
    return rollout.x


def swinging_double_pendulum(N: int = 40) -> tuple[MidpointSystem, QuadraticCost]:
    """Return a double pendulum driven at its hip, and the cost of swinging with a period of 1.6 s."""
    m = la.Mechanism(
        [la.rx("a"), [la.tz(-1.0, name="A", mass=1.0), [la.rx("b"), [la.tz(-0.8, name="B", mass=0.7)]]]],
        [la.Gravity((0.0, 0.0, -9.81)), la.JointForce("a", input="hip"), la.Damping(0.1)],
    )
    t = np.linspace(0.0, 1.6, N + 1)
    wanted = np.zeros((N + 1, 4))
    wanted[:, 0], wanted[:, 1] = 0.6 * np.sin(2 * np.pi * t / 1.6), 0.3 * np.cos(2 * np.pi * t / 1.6)
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[10.0, 3.0, 0.0, 0.0], R=[0.01])
    return MidpointSystem(la.MidpointVI(m, threads=1), t), cost
