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
    """The relation ``q' = N(q) v`` of one mechanism; where no rotation is a quaternion N is the identity.

    ``n_dynamic``: how many numbers of a configuration belong to the dynamic variables.
    """

    def __init__(self, mechanism: Compiled) -> None:
        self.mechanism = m = mechanism
        self.n_dynamic = m.nq - len(m.tree.coordinates(m.kinematic))
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
        """Return the derivative (nq, nq) of `rates` by the numbers of a configuration."""
        out = np.zeros((self.mechanism.nq, self.mechanism.nq))
        for at, by in self.turns:
            turn = np.concatenate([[0.0], v[by : by + 3]])
            out[at : at + 4, at : at + 4] = 0.5 * np.transpose([rotations.product(e, turn) for e in np.eye(4)])
        return out

    def directions(self, q: Array) -> Array:
        """Return N (nq, nv)."""
        m = self.mechanism
        if not self.turns:
            return np.eye(m.nq)
        return np.transpose([self.rates(q, e) for e in np.eye(m.nv)])

    def changes(self, q: Array) -> Array:
        """Return the derivative (nv, nq) of small differences ``N^-1 dq`` by the numbers of a configuration."""
        if not self.turns:
            return np.eye(self.mechanism.nq)
        N = self.directions(q)
        # Columns are orthogonal, those of a rotation half as long as its quaternion.
        return np.asarray(N.T / np.sum(N * N, axis=0)[:, None])

    def on_space(self, q: Array) -> Array:
        """Return a configuration (nq,) with quaternions of unit length."""
        return of_unit_length(self.mechanism, q[None, :])[0] if self.turns else q
