"""MuJoCo's dynamics of an MJCF, in the variables of the mechanism that `load` makes of it.

MuJoCo compiles the file here; ball and free joints go from its velocities to rates of angles by their Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from leastaction import ContinuousDynamics, Mechanism
from leastaction.io.mechanisms import LeftOut, Model, rotations
from leastaction.io.mechanisms.mjcf import read_mjcf
from leastaction.io.mechanisms.names import settle
from leastaction.io.mechanisms.parts import JointPart

OFF = ("CONTACT", "LIMIT", "FRICTIONLOSS", "EQUALITY", "ACTUATION", "CLAMPCTRL")


@dataclass
class Point:
    """A random state: of the mechanism ``q, v``, of MuJoCo ``qpos, qvel``, with ``qvel = J v`` and ``Jv = dJ/dt v``."""

    q: np.ndarray
    v: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    J: np.ndarray
    Jv: np.ndarray


ACTIVE = ("motor.", "servo.", "muscle.", "passive.")


def without_friction(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without the dry friction of its joints and tendons."""
    return mechanism.with_exchanged({name: () for name in mechanism.elements if name.startswith("friction.")})


def smooth(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without dry friction, and without its actuators."""
    return mechanism.with_exchanged(
        {name: () for name in mechanism.elements if name.startswith(("friction.", *ACTIVE))}
    )


def joints_of(path: Path) -> tuple[JointPart, ...]:
    robot, _ = read_mjcf(path)
    return settle(robot, robot).all_joints


def quaternion(angles: np.ndarray) -> np.ndarray:
    quat = np.zeros(4)
    a, b, c = angles
    turns = [np.array([np.cos(x / 2), *(np.sin(x / 2) * np.eye(3)[i])]) for i, x in enumerate((a, b, c))]
    first = np.zeros(4)
    mujoco.mju_mulQuat(first, turns[0], turns[1])
    mujoco.mju_mulQuat(quat, first, turns[2])
    return quat


def random_point(joints: tuple[JointPart, ...], mechanism: Mechanism, rng: np.random.Generator) -> Point:
    q, v, qpos, qvel, blocks, Jv = {}, {}, [], [], [], []
    for joint in joints:
        if joint.kind in ("hinge", "slide"):
            q[joint.name], v[joint.name] = rng.uniform(-0.5, 0.5), rng.uniform(-1, 1)
            qpos.append(q[joint.name])
            qvel.append(v[joint.name])
            blocks.append((joint.name, np.eye(1), (joint.name,)))
            Jv.append(0.0)
            continue
        names = rotations.variables_of(joint)
        if joint.axes == "quaternion":
            turn = rng.standard_normal(4)
            place = [*rng.uniform(-0.8, 0.8, len(names) - 3), *(turn / np.linalg.norm(turn))]
            q.update(zip(rotations.coordinates_of(joint), place, strict=True))
            v.update({name: rng.uniform(-1, 1) for name in names})
            qpos += place
            qvel += [v[name] for name in names]
            Jv += [0.0] * len(names)
            blocks.append((joint.name, np.eye(len(names)), names))
            continue
        for name in names:
            q[name], v[name] = rng.uniform(-0.8, 0.8), rng.uniform(-1, 1)
        rates, angles = np.array([v[n] for n in names]), np.array([q[n] for n in names])
        E = rotations.rates_to_angular(angles[-3:])
        Ed = _rate(angles[-3:], rates[-3:])
        J = np.eye(len(names))
        J[-3:, -3:] = E
        qpos += [*angles[:-3], *quaternion(angles[-3:])]
        qvel += list(J @ rates)
        Jv += [0.0] * (len(names) - 3) + list(Ed @ rates[-3:])
        blocks.append((joint.name, J, names))
    order = {name: i for i, name in enumerate(mechanism.variables)}
    whole = np.zeros((len(qvel), mechanism.nv))
    row = 0
    for _, J, names in blocks:
        whole[row : row + len(J), [order[n] for n in names]] = J
        row += len(J)
    return Point(mechanism.configuration(q), mechanism.velocity(v), np.array(qpos), np.array(qvel), whole, np.array(Jv))


def _rate(angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
    _, b, c = angles
    _, bd, cd = rates
    cb, sb, cc, sc = np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    return np.array(
        [[-sb * cc * bd - cb * sc * cd, cc * cd, 0], [sb * sc * bd - cb * cc * cd, -sc * cd, 0], [cb * bd, 0, 0]]
    )


def compiled(path: Path, left_out: tuple[LeftOut, ...] = ()) -> tuple[Any, Any]:
    """Return MuJoCo's model, compiled here, without what the mechanism does not have."""
    spec = mujoco.MjSpec.from_file(str(path))
    for flag in OFF:
        spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    spec.option.density = spec.option.viscosity = 0.0
    spec.option.wind = [0.0, 0.0, 0.0]
    names = {each.name for each in left_out}
    said = " | ".join(names)
    for joint in spec.joints:
        name = joint.name or joint.parent.name
        if f"springdamper of the joint {name!r}" in said:
            joint.springdamper = [0.0, 0.0]
        for what, none in (("damping", [0.0] * 3), ("stiffness", [0.0] * 3), ("armature", 0.0)):
            if f"{what} of the joint {name!r}" in said:
                setattr(joint, what, none)
    for tendon in spec.tendons:
        if f"armature of the tendon {tendon.name!r}" in said:
            tendon.armature = 0.0
        if f"tendon {tendon.name!r}" in names or f"wrapping of the tendon {tendon.name!r}" in said:
            tendon.stiffness, tendon.damping, tendon.armature = [0.0] * 3, [0.0] * 3, 0.0
    m = spec.compile()
    return m, mujoco.MjData(m)


def errors(path: Path, model: Model, points: int = 2) -> dict[str, float]:
    """Return how far mass matrix, force at rest and force in motion are from MuJoCo's, relative to its size."""
    m, d = compiled(path, model.left_out)
    mechanism, joints, rng = smooth(model.mechanism), joints_of(path), np.random.default_rng(1)
    dynamics = ContinuousDynamics(mechanism)
    worst = {"mass": 0.0, "gravity": 0.0, "motion": 0.0}
    for _ in range(points):
        p = random_point(joints, mechanism, rng)
        for name, v, Jv in (("gravity", 0.0 * p.v, 0.0 * p.Jv), ("motion", p.v, p.Jv)):
            d.qpos[:], d.qvel[:] = p.qpos, 0.0 if name == "gravity" else p.qvel
            mujoco.mj_forward(m, d)
            M = np.zeros((m.nv, m.nv))
            mujoco.mj_fullM(m, d, M)
            wanted = p.J.T @ (d.qfrc_bias - d.qfrc_passive + M @ Jv)
            got = dynamics.inverse_dynamics(p.q, v, np.zeros(mechanism.nv))
            size = np.abs(p.J.T) @ (
                np.abs(d.qfrc_bias) + np.abs(d.qfrc_passive) + np.abs(M) @ (np.abs(Jv) + (p.J @ v) ** 2)
            )
            worst[name] = max(worst[name], _ratio(got - wanted, size))
        wanted = p.J.T @ M @ p.J
        worst["mass"] = max(worst["mass"], _ratio(mechanism.mass_matrix(p.q) - wanted, wanted))
    return worst


def error_of_actuators(path: Path, model: Model, points: int = 2) -> float | None:
    """Return how far the forces of the actuators are from MuJoCo's; None where there are none to compare.

    Without limits of inputs and forces, and with inputs for states of activation.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    mechanism, wrapped = without_friction(model.mechanism), " | ".join(each.name for each in model.left_out)
    inputs, unknown = [], []
    for number, actuator in enumerate(list(spec.actuators)):
        actuator.forcelimited = actuator.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE
        name = actuator.name or f"{actuator.target}.motor{number}"
        known = [each for each in (f"{name}.input", name) if each in mechanism.inputs]
        if not known or f"wrapping of the tendon {actuator.target!r}" in wrapped:
            unknown.append(actuator)
        else:
            inputs.append(known[0])
    for actuator in unknown:
        spec.delete(actuator)
    if not inputs:
        return None
    m = spec.compile()
    d, rng, joints = mujoco.MjData(m), np.random.default_rng(2), joints_of(path)
    alone = ContinuousDynamics(smooth(mechanism))
    driven, worst = ContinuousDynamics(mechanism), 0.0
    for _ in range(points):
        p = random_point(joints, mechanism, rng)
        ctrl, u = rng.uniform(0.0, 1.0, m.nu), np.zeros(mechanism.n_inputs)
        u[[mechanism.inputs.index(name) for name in inputs]] = ctrl
        d.qpos[:], d.qvel[:], d.ctrl[:] = p.qpos, p.qvel, ctrl
        for i in np.flatnonzero(m.actuator_actnum):
            d.act[m.actuator_actadr[i]] = ctrl[i]
        mujoco.mj_forward(m, d)
        still = np.zeros(mechanism.nv)
        got = alone.inverse_dynamics(p.q, p.v, still) - driven.inverse_dynamics(p.q, p.v, still, u=u)
        size = np.abs(p.J.T) @ np.abs(d.qfrc_actuator)
        worst = max(worst, _ratio(got - p.J.T @ d.qfrc_actuator, np.maximum(size, 1e-6)))
    return worst


def _ratio(error: np.ndarray, size: np.ndarray) -> float:
    return float(np.abs(error).max() / max(np.abs(size).max(), 1e-12))
