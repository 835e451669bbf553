"""What moves in a mechanism as a whole: mass, centre of mass, energy, momentum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics.description.tree import WORLD
from leastaction.mechanics.mechanism.compiled import Compiled
from leastaction.numerics.arrays import Array


@dataclass(frozen=True)
class Energy:
    """Energy of a mechanism (J): floats, or arrays (N,) for a batch of states."""

    kinetic: Any
    potential: Any

    @property
    def total(self) -> Any:
        """Kinetic and potential energy together (J)."""
        return self.kinetic + self.potential


class MassQueries(Compiled):
    """Questions about all bodies together; see `Mechanism`, which offers them."""

    __slots__ = ()

    def energy(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Energy:
        """Return the kinetic and potential energy (J) at q, v of shape (nq,), or (N, nq) for a batch."""
        values, single = self._batch(q)
        speeds, _ = self._batch(v, "v", rows=None if single else len(values))
        pairs = list(zip(values, speeds, strict=True))
        kinetic = np.array([self.core.kinetic_energy(a, b) for a, b in pairs])
        potential = np.array([self.core.potential_energy(a) for a, _ in pairs])
        if single:
            return Energy(float(kinetic[0]), float(potential[0]))
        return Energy(kinetic, potential)

    def momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return dL/dv at q, v of shape (nq,): the momentum of every variable, kinematic ones too."""
        momentum: Array = self.core.gradient(self._single(q), self._single(v, "v"))[1]
        return momentum

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """Return the inertia matrix (nq, nq) of all variables at q of shape (nq,)."""
        # L is quadratic in v, so its second derivative by v is the same at any velocity.
        inertia: Array = self.core.hessian(self._single(q), np.zeros(self.nq))[2]
        return inertia

    @property
    def mass(self) -> float:
        """Mass of all bodies (kg), those fixed in the world too."""
        return float(sum(body.mass for _, body, _ in self.tree.bodies()))

    def center_of_mass(self, q: npt.ArrayLike) -> Array:
        """Return the centre of mass of all bodies, those fixed in the world too.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.

        Returns
        -------
        ndarray, shape (3,) or (N, 3)
            In the world (m).

        Raises
        ------
        ArgumentError
            If the mechanism has no mass.
        """
        values, single = self._batch(q)
        total = self.mass
        if total == 0.0:
            raise ArgumentError(
                "center_of_mass: the mechanism has no mass, so it has no centre of mass; give a frame mass="
            )
        poses = self.core.joint_poses(values)
        moment = np.zeros((len(values), 3))
        for joint, body, pose in self.tree.bodies():
            centre = pose[:3, :3] @ body.com + pose[:3, 3]
            moment += body.mass * _placed(poses, joint, centre)
        result: Array = moment / total
        return result[0] if single else result

    @np.errstate(over="ignore", invalid="ignore")
    def total_momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return the linear and angular momentum of all bodies.

        Parameters
        ----------
        q, v : array_like, shape (nq,) or (N, nq)
            Configuration and velocity, or batches of them.

        Returns
        -------
        ndarray, shape (6,) or (N, 6)
            Linear momentum (kg m/s), then angular momentum about the world origin (kg m^2/s), world axes.
        """
        values, single = self._batch(q)
        speeds, _ = self._batch(v, "v", rows=None if single else len(values))
        poses, velocities = self.core.joint_poses(values), self._joint_velocities(values, speeds)
        result = np.zeros((len(values), 6))
        for joint, body, pose in self.tree.bodies():
            if joint == WORLD:
                continue
            turn = poses[:, joint, :3, :3] @ pose[:3, :3]
            linear, angular = velocities[:, joint, :3], velocities[:, joint, 3:]
            centre = _placed(poses, joint, pose[:3, :3] @ body.com + pose[:3, 3])
            p = body.mass * (linear + np.cross(angular, centre))
            local = np.einsum("nji,nj->ni", turn, angular) @ body.inertia
            result[:, :3] += p
            result[:, 3:] += np.cross(centre, p) + np.einsum("nij,nj->ni", turn, local)
        return result[0] if single else result

    def _joint_velocities(self, q: Array, v: Array) -> Array:
        """Return the velocities [v; w] (N, nj, 6), at the world origin, of what each joint moves."""
        twists = self.core.joint_twists(q)
        rates = v @ self.tree.coupling(range(len(self.tree.joints)), self.variables)[0].T
        result: Array = twists * rates[:, :, None]
        # Joints come after their parents.
        for index, joint in enumerate(self.tree.joints):
            if joint.parent != WORLD:
                result[:, index] += result[:, joint.parent]
        return result


def _placed(poses: Array, joint: int, point: Array) -> Array:
    """Return a point (3,) of the moved frame of a joint in the world, (N, 3)."""
    if joint == WORLD:
        return np.broadcast_to(point, (len(poses), 3))
    placed: Array = poses[:, joint, :3, :3] @ point + poses[:, joint, :3, 3]
    return placed
