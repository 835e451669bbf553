"""Continuous systems for the tests, in plain NumPy with exact derivatives."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

from leastaction.optimal import Linearization
from leastaction.optimal.continuous import ContinuousSystem
from optimal.systems import _stack


@cache
def _cart_pendulum(with_torque):
    """Rate, Jacobian and second derivatives of a cart with a pendulum, compiled from SymPy."""
    p, th, v, w, F, tau = sp.symbols("p th v w F tau")
    a, al = sp.symbols("a al")
    cart, bob, length, gravity = 1.0, 0.3, 1.0, 9.81
    sin, cos = sp.sin(th), sp.cos(th)
    solved = sp.solve(
        [
            (cart + bob) * a + bob * length * (cos * al - w**2 * sin) - F,
            bob * length * (cos * a + length * al + gravity * sin) - (tau if with_torque else 0),
        ],
        [a, al],
    )
    y = [p, th, v, w, F, tau] if with_torque else [p, th, v, w, F]
    f = sp.Matrix([v, w, solved[a], solved[al]])
    J = f.jacobian(y)
    H = [sp.hessian(f[i], y) for i in range(4)]
    compile_ = lambda e, module: sp.lambdify(y, e, module, cse=True)  # noqa: E731
    return (
        compile_(list(f), "math"),
        compile_([list(J.row(i)) for i in range(4)], "numpy"),
        compile_([[list(h.row(i)) for i in range(len(y))] for h in H], "numpy"),
    )


class CartPendulum(ContinuousSystem):
    """A cart with a pendulum hanging at angle 0; x = [position, angle, their rates], u = [force].

    With a torque at the pivot as a second input, if asked for.
    """

    def __init__(self, with_torque=False):
        self.nx, self.nu = 4, 2 if with_torque else 1
        self._f, self._J, self._H = _cart_pendulum(with_torque)

    def f(self, x, u, t):
        return np.array(self._f(*x.tolist(), *u.tolist()))

    def derivatives(self, x, u, t):
        J = np.array(self._J(*x, *u), dtype=float)
        return J[:, :4], J[:, 4:]

    def curvature(self, x, u, t, z):
        return np.einsum("i,ijk->jk", z, np.array(self._H(*x, *u), dtype=float))

    def linearize(self, x, u, t):
        J = _stack(self._J(*x.T, *u.T), (4, 4 + self.nu), len(t))
        return Linearization(J[:, :, :4], J[:, :, 4:])

    def curvatures(self, x, u, t, z):
        H = _stack(self._H(*x.T, *u.T), (4, 4 + self.nu, 4 + self.nu), len(t))
        return np.einsum("ki,kijl->kjl", z, H)
