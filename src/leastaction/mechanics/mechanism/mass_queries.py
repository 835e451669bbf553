"""What moves in a mechanism as a whole: mass, energy, momentum; `Mechanism` asks these questions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from leastaction import _core
from leastaction.errors import ArgumentError
from leastaction.mechanics.description.tree import WORLD, Tree
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


def energy_of(core: _core.Mechanism, q: Array, v: Array) -> Energy:
    """Return the energies at states q, v (N, nq)."""
    kinetic = np.array([core.kinetic_energy(*state) for state in zip(q, v, strict=True)])
    return Energy(kinetic, np.array([core.potential_energy(row) for row in q]))


def mass_of(tree: Tree) -> float:
    """Return the mass of all bodies (kg), those fixed in the world too."""
    return float(sum(body.mass for _, body, _ in tree.bodies()))


def center_of_mass_of(tree: Tree, joints: Array) -> Array:
    """Return the centres of mass (N, 3) from the poses of all joints (N, nj, 4, 4)."""
    total = mass_of(tree)
    if total == 0.0:
        raise ArgumentError(
            "center_of_mass: the mechanism has no mass, so it has no centre of mass; give a frame mass="
        )
    moment = np.zeros((len(joints), 3))
    for joint, body, pose in tree.bodies():
        moment += body.mass * _placed(joints, joint, pose[:3, :3] @ body.com + pose[:3, 3])
    return moment / total


@np.errstate(over="ignore", invalid="ignore")
def total_momentum_of(tree: Tree, core: _core.Mechanism, variables: Sequence[str], q: Array, v: Array) -> Array:
    """Return linear and angular momentum about the world origin (N, 6) at states q, v (N, nq)."""
    poses, velocities = core.joint_poses(q), _joint_velocities(tree, core, variables, q, v)
    result = np.zeros((len(q), 6))
    for joint, body, pose in tree.bodies():
        if joint == WORLD:
            continue
        turn = poses[:, joint, :3, :3] @ pose[:3, :3]
        linear, angular = velocities[:, joint, :3], velocities[:, joint, 3:]
        centre = _placed(poses, joint, pose[:3, :3] @ body.com + pose[:3, 3])
        p = body.mass * (linear + np.cross(angular, centre))
        local = np.einsum("nji,nj->ni", turn, angular) @ body.inertia
        result[:, :3] += p
        result[:, 3:] += np.cross(centre, p) + np.einsum("nij,nj->ni", turn, local)
    return result


def _joint_velocities(tree: Tree, core: _core.Mechanism, variables: Sequence[str], q: Array, v: Array) -> Array:
    """Return the velocities [v; w] (N, nj, 6), at the world origin, of what each joint moves."""
    column = {name: index for index, name in enumerate(variables)}
    result = np.array(core.joint_twists(q))
    # Joints come after their parents.
    for index, joint in enumerate(tree.joints):
        rate = sum(factor * v[:, column[name]] for name, factor in joint.coordinate.terms)
        result[:, index] *= np.asarray(rate)[:, None]
        if joint.parent != WORLD:
            result[:, index] += result[:, joint.parent]
    return result


def _placed(poses: Array, joint: int, point: Array) -> Array:
    """Return a point (3,) of the moved frame of a joint in the world, (N, 3)."""
    if joint == WORLD:
        return np.broadcast_to(point, (len(poses), 3))
    placed: Array = poses[:, joint, :3, :3] @ point + poses[:, joint, :3, 3]
    return placed
