"""How configurations move with velocities: coordinates do by themselves, a quaternion by the angular velocity.

A quaternion q of a rotation whose angular velocity in its own axes is w moves by ``q' = q (0, w) / 2``, the product of
quaternions. That holds for any length: a solution times a number is a solution, so what an integrator makes of the
length is without effect on the rotation.
"""

from __future__ import annotations

import numpy as np

from leastaction.mechanics.mechanism.arguments import Compiled, of_unit_length
from leastaction.numerics import rotations
from leastaction.numerics.arrays import Array


class Kinematics:
    """The relation ``q' = N(q) v`` of one mechanism; where no rotation is a quaternion N is the identity."""

    def __init__(self, mechanism: Compiled) -> None:
        self.mechanism = m = mechanism
        self.turns = [
            (m.coordinates.index(rotation.quaternion[0]), m.variables.index(rotation.variables[0]))
            for rotation in m.tree.rotations
        ]
        turned = {first + i for _, first in self.turns for i in range(3)}
        self._variables = [i for i in range(m.nv) if i not in turned]
        self._coordinates = [m.coordinates.index(m.variables[i]) for i in self._variables]

    @property
    def curved(self) -> bool:
        """Whether there is a quaternion."""
        return bool(self.turns)

    def rates(self, q: Array, v: Array) -> Array:
        """Return the rates (..., nq) of configurations (..., nq) with velocities (..., nv)."""
        if not self.turns:
            return v
        out = np.empty(q.shape)
        out[..., self._coordinates] = v[..., self._variables]
        for at, by in self.turns:
            w = v[..., by : by + 3]
            turn = np.concatenate([np.zeros((*w.shape[:-1], 1)), w], axis=-1)
            out[..., at : at + 4] = 0.5 * rotations.product(q[..., at : at + 4], turn)
        return out

    def rates_by_configuration(self, v: Array) -> Array:
        """Return the derivatives (..., nq, nq) of `rates` by the numbers of a configuration."""
        out = np.zeros((*v.shape[:-1], self.mechanism.nq, self.mechanism.nq))
        for at, by in self.turns:
            turn = np.concatenate([np.zeros((*v.shape[:-1], 1)), v[..., by : by + 3]], axis=-1)
            columns = [rotations.product(e, turn) for e in np.eye(4)]
            out[..., at : at + 4, at : at + 4] = 0.5 * np.stack(columns, axis=-1)
        return out

    def directions(self, q: Array) -> Array:
        """Return N (..., nq, nv)."""
        m = self.mechanism
        if not self.turns:
            return np.broadcast_to(np.eye(m.nq), (*q.shape, m.nq))
        return np.stack([self.rates(q, np.broadcast_to(e, (*q.shape[:-1], m.nv))) for e in np.eye(m.nv)], axis=-1)

    def changes(self, q: Array) -> Array:
        """Return the derivatives (..., nv, nq) of small differences ``N^-1 dq`` by the numbers of a configuration."""
        N = self.directions(q)
        # Columns are orthogonal, those of a rotation half as long as its quaternion.
        return np.asarray(np.swapaxes(N / np.sum(N * N, axis=-2, keepdims=True), -1, -2))

    def rates_by_both(self, z: Array) -> Array:
        """Return the second derivatives (..., nq, nv) of ``z . N(q) v`` by the numbers of q, then v; z (..., nq)."""
        m = self.mechanism
        out = np.zeros((*z.shape, m.nv))
        for at, by in self.turns:
            for i in range(3):
                turn = np.eye(4)[i + 1]
                moved = np.stack([0.5 * rotations.product(e, turn) for e in np.eye(4)], axis=-1)
                out[..., at : at + 4, by + i] = z[..., at : at + 4] @ moved
        return out

    def on_space(self, q: Array) -> Array:
        """Return a configuration (nq,) with quaternions of unit length."""
        return of_unit_length(self.mechanism, q[None, :])[0] if self.turns else q
