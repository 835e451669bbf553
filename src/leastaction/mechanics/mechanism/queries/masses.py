"""What moves in a mechanism as a whole, mass, energy, momentum: methods of `Mechanism`, which is ``m`` here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.description.tree import WORLD
from leastaction.mechanics.mechanism.arguments import Compiled, batch, batch_of_states, rates, shaped, single
from leastaction.numerics.arrays import Array, Row, as_array
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class Energy:
    """Energy of a mechanism (J): floats, or arrays (N,) for a batch of states."""

    kinetic: Any
    potential: Any

    @property
    def total(self) -> Any:
        """Kinetic and potential energy together (J)."""
        return self.kinetic + self.potential


def energy(m: Compiled, q: Row, v: Row, t: ArrayLike | None = None) -> Energy:
    """Return the kinetic and potential energy (J) at q, v of shape (nq,), or (N, nq) for a batch.

    ``t``: times (s), one or (N,), where potentials change with the time; else that of `Mechanism.at_time`, or zero.
    """
    values, speeds, one = batch_of_states(m, q, v)
    kinetic = np.array([m.core.kinetic_energy(*state) for state in zip(values, speeds, strict=True)])
    times = np.broadcast_to(m.time if t is None else as_array(t, "t", (), (len(values),)), len(values))
    potential = np.array([m.core.potential_energy(*at) for at in zip(values, times, strict=True)])
    return Energy(float(kinetic[0]), float(potential[0])) if one else Energy(kinetic, potential)


def momentum(m: Compiled, q: Row, v: Row) -> Array:
    """Return dL/dv at q, v of shape (nq,): the momentum of every variable, kinematic ones too."""
    found: Array = m.core.gradient(single(m, q), rates(m, v))[1]
    return found


def mass_matrix(m: Compiled, q: Row) -> Array:
    """Return the inertia matrix (nq, nq) of all variables at q of shape (nq,)."""
    # L is quadratic in v, so its second derivative by v is the same at any velocity.
    inertia: Array = m.core.hessian(single(m, q), np.zeros(m.nv))[2]
    return inertia


def mass_of(m: Compiled) -> float:
    """Return the mass of all bodies (kg)."""
    return float(sum(body.mass for _, body, _ in m.tree.bodies()))


def center_of_mass(m: Compiled, q: Row) -> Array:
    """Return the centre of mass of all bodies, those fixed in the world too.

    Parameters
    ----------
    q : array_like, shape (nq,) or (N, nq)

    Returns
    -------
    ndarray, shape (3,) or (N, 3)
        In the world (m).

    Raises
    ------
    ArgumentError
        If the mechanism has no mass.
    """
    values, one = batch(m, q)
    joints, total = m.core.joint_poses(values), mass_of(m)
    if total == 0.0:
        raise ArgumentError(
            "center_of_mass: the mechanism has no mass, so it has no centre of mass; give a frame mass="
        )
    moment = np.zeros((len(values), 3))
    for joint, body, pose in m.tree.bodies():
        moment += body.mass * _placed(joints, joint, pose[:3, :3] @ body.com + pose[:3, 3])
    return shaped(moment / total, one)


@np.errstate(over="ignore", invalid="ignore")
def total_momentum(m: Compiled, q: Row, v: Row) -> Array:
    """Return the linear and angular momentum of all bodies.

    Parameters
    ----------
    q, v : array_like, shape (nq,) or (N, nq)

    Returns
    -------
    ndarray, shape (6,) or (N, 6)
        Linear momentum (kg m/s), then angular momentum about the world origin (kg m^2/s), world axes.
    """
    values, speeds, one = batch_of_states(m, q, v)
    poses, velocities = m.core.joint_poses(values), _joint_velocities(m, values, speeds)
    result = np.zeros((len(values), 6))
    for joint, body, pose in m.tree.bodies():
        if joint == WORLD:
            continue
        turn = poses[:, joint, :3, :3] @ pose[:3, :3]
        linear, angular = velocities[:, joint, :3], velocities[:, joint, 3:]
        centre = _placed(poses, joint, pose[:3, :3] @ body.com + pose[:3, 3])
        p = body.mass * (linear + np.cross(angular, centre))
        local = np.einsum("nji,nj->ni", turn, angular) @ body.inertia
        result[:, :3] += p
        result[:, 3:] += np.cross(centre, p) + np.einsum("nij,nj->ni", turn, local)
    return shaped(result, one)


def _joint_velocities(m: Compiled, q: Array, v: Array) -> Array:
    """Return the velocities [v; w] (N, nj, 6), at the world origin, of what each joint moves."""
    column = {name: index for index, name in enumerate(m.variables)}
    result = np.array(m.core.joint_twists(q))
    # Joints come after their parents.
    for index, joint in enumerate(m.tree.joints):
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
