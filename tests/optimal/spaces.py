"""Systems whose states live on a circle and among rotations, in plain NumPy, by formulas of their own."""

from __future__ import annotations

import numpy as np

from leastaction.numerics.differences import complex_step, fourth_order
from leastaction.optimal import DiscreteSystem, Linearization, ProductSpace, Rotations, StateSpace, Vectors

INERTIA = np.array([1.0, 1.3, 0.7])


class Circle(StateSpace):
    """Points of a circle as (cos, sin), moved by an angle."""

    nx, ndx = 2, 1

    def difference(self, x, xbar):
        cross = xbar[..., 0] * x[..., 1] - xbar[..., 1] * x[..., 0]
        return np.arctan2(cross, np.sum(x * xbar, axis=-1))[..., None]

    def plus(self, x, dx):
        c, s = np.cos(dx[..., 0]), np.sin(dx[..., 0])
        return np.stack([c * x[..., 0] - s * x[..., 1], s * x[..., 0] + c * x[..., 1]], axis=-1)

    def plus_derivative(self, x):
        return np.stack([-x[..., 1], x[..., 0]], axis=-1)[..., None]

    def plus_curvature(self, x, w):
        return -np.sum(w * x, axis=-1)[..., None, None]

    def difference_derivative(self, x, xbar):
        return np.ones((*x.shape[:-1], 1, 1))

    def difference_curvature(self, x, xbar, w):
        return np.zeros((*x.shape[:-1], 1, 1))


class Pendulum(DiscreteSystem):
    """A pendulum as (cos, sin, rate): half a step of the rate's change moves the angle along."""

    nx, nu = 3, 1

    def __init__(self, N, dt=0.05):
        self.N, self.dt, self.space = N, dt, ProductSpace(Circle(), Vectors(1))

    def f(self, x, u, k):
        w = x[2] + self.dt * (u[0] - 9.81 * x[1])
        angle = Circle().plus(x[:2], np.array([self.dt * w]))
        return np.array([*angle, w])

    def derivatives(self, x, u, k):
        dt, pull = self.dt, -9.81 * x[0]
        return np.array([[1 + dt * dt * pull, dt], [dt * pull, 1.0]]), np.array([[dt * dt], [dt]])

    def curvature(self, x, u, k, z):
        H = np.zeros((3, 3))
        H[0, 0] = self.dt * 9.81 * x[1] * (self.dt * z[0] + z[1])
        return H


def times(p, q):
    """Return the products of quaternions [w, x, y, z], (n, 4) each; of complex numbers too."""
    a, b, c, d = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    return np.concatenate([a * c - np.sum(b * d, axis=-1, keepdims=True), a * d + c * b + np.cross(b, d)], axis=-1)


def turned_by(phi):
    """Return the quaternions of rotations by vectors, by series: up to half a turn, of complex numbers too."""
    s, c, by = np.sum(phi * phi, axis=-1, keepdims=True) / 4.0, 0.0, 0.0
    term = np.ones_like(s)
    for k in range(14):
        c, by = c + term, by + term / (2 * k + 1)
        term = -term * s / ((2 * k + 1) * (2 * k + 2))
    return np.concatenate([c, 0.5 * by * phi], axis=-1)


def step(x, u, dt):
    """Return where bodies that turn freely under torques get to: [quaternion; rate in the body], (n, 7) each."""
    w = x[..., 4:]
    w = w + dt * (u - np.cross(w, INERTIA * w)) / INERTIA
    return np.concatenate([times(x[..., :4], turned_by(dt * w)), w], axis=-1)


BODY = ProductSpace(Rotations(), Vectors(3))


class Body(DiscreteSystem):
    """A body that turns freely under torques; its derivatives are complex steps through charts of its own."""

    nx, nu = 7, 3

    def __init__(self, steps):
        self.steps, self.N, self.space = np.asarray(steps, dtype=float), len(steps), BODY

    def f(self, x, u, k):
        return step(x, u, self.steps[k])

    def derivatives(self, x, u, k):
        J = self.slopes(x[None], u[None], self.steps[k : k + 1], np.zeros(9))[0]
        return J[:, :6], J[:, 6:]

    def curvature(self, x, u, k, z):
        return self.bends(x[None], u[None], self.steps[k : k + 1], z[None])[0]

    def linearize(self, x, u, out=None):
        x, u = x[:-1].copy(), u.copy()
        J = self.slopes(x, u, self.steps, np.zeros(9))
        return Linearization(J[:, :, :6], J[:, :, 6:], lambda z: self.bends(x, u, self.steps, z))

    def linearize_each(self, x, u, ends):
        return self.linearize(x, u)

    @staticmethod
    def slopes(x, u, dt, at):
        end, dt = step(x, u, dt[:, None]), dt[:, None]

        def charted(y):
            after = step(
                np.concatenate([times(x[:, :4], turned_by(y[:, :3])), x[:, 4:] + y[:, 3:6]], axis=1), u + y[:, 6:], dt
            )
            back = times(end[:, :4] * [1.0, -1.0, -1.0, -1.0], after[:, :4])
            v, s = back[:, 1:], np.sum(back[:, 1:] ** 2, axis=1, keepdims=True)
            # The logarithm of a small rotation.
            turn = 2.0 * v * (1.0 + s / 6.0 + 3.0 * s**2 / 40.0 + 15.0 * s**3 / 336.0)
            return np.concatenate([turn, after[:, 4:] - end[:, 4:]], axis=1)

        return complex_step(charted, np.broadcast_to(at, (len(x), 9)))

    def bends(self, x, u, dt, z):
        # Differences of fourth order by all nine directions at once.
        n, by = len(x), 1e-3 * np.array([1.0, -1.0, 2.0, -2.0])
        at = np.repeat((by[:, None, None] * np.eye(9)).reshape(36, 9), n, axis=0)
        J = self.slopes(np.tile(x, (36, 1)), np.tile(u, (36, 1)), np.tile(dt, 36), at)
        slope = np.einsum("bki,bkij->bkj", np.broadcast_to(z, (36, n, 6)), J.reshape(36, n, 6, 9)).reshape(4, 9, n, 9)
        H = (8.0 * (slope[0] - slope[1]) - (slope[2] - slope[3])).transpose(1, 2, 0) / 0.012
        return 0.5 * (H + H.transpose(0, 2, 1))


def body(N):
    """Return a body over N steps of a tenth of a second."""
    return Body(np.full(N, 0.1))


def attitude(axis, angle):
    axis = np.asarray(axis, dtype=float)
    return turned_by(angle * axis / np.linalg.norm(axis))


class TimedBody(Body):
    """A body whose steps share a final time, and whose torques are times a number."""

    def __init__(self, N, T, strength=1.0):
        super().__init__(np.full(N, T / N))
        self.T, self.strength = T, strength

    @property
    def parameters(self):
        return {"final time": self.T, "strength": self.strength}

    def with_parameters(self, values):
        known = {**self.parameters, **values}
        return TimedBody(self.N, known["final time"], known["strength"])

    def time(self, k):
        return k * self.T / self.N

    def f(self, x, u, k):
        return step(x, self.strength * u, self.steps[k])

    def derivatives(self, x, u, k):
        A, B = super().derivatives(x, self.strength * u, k)
        return A, self.strength * B

    def _scaled(self, H):
        scale = np.r_[np.ones(6), np.full(3, self.strength)]
        return scale[:, None] * H * scale

    def curvature(self, x, u, k, z):
        return self._scaled(super().curvature(x, self.strength * u, k, z))

    def linearize(self, x, u, out=None):
        found = super().linearize(x, self.strength * u)
        return Linearization(found.A, self.strength * found.B, lambda z: self._scaled(found.second(z)))

    def differentiate_by(self, x, u, names, start=0):
        x = x[: len(u)]
        ends = step(x, self.strength * u, self.T / self.N)

        def moved(name, by):
            other = self.with_parameters({name: self.parameters[name] + by})
            return BODY.difference(step(x, other.strength * u, other.T / self.N), ends)

        return np.stack([fourth_order(lambda by, name=name: moved(name, by), 1e-3) for name in names], axis=2)
