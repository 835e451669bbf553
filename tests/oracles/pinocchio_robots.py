"""Pinocchio's dynamics of a URDF, in the variables of the mechanism that `load` makes of it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin

from leastaction import ContinuousDynamics, Mechanism
from leastaction.io.mechanisms import Model, rotations
from leastaction.io.mechanisms.kinds import parse
from leastaction.io.mechanisms.names import Names, settle
from leastaction.io.mechanisms.parts import JointPart
from leastaction.io.mechanisms.urdf import read_urdf


def smooth(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without damping and dry friction, which Pinocchio reads and does not apply."""
    taken = ("damping", "friction.")
    return mechanism.with_exchanged({name: () for name in mechanism.elements if name.startswith(taken)})


def names_of(path: Path) -> Names:
    robot = read_urdf(parse(path.read_text(), path), path, [])
    return settle(robot, robot)


def pinocchio_of(path: Path, model: Model, floating: bool) -> pin.Model:
    """Return Pinocchio's model; of a file whose inertias were mended, of one with the mended ones."""
    root = ET.fromstring(path.read_text())
    mended = [each.name.split("'")[1] for each in model.left_out if each.name.startswith(("inertia of", "massless"))]
    for link in root.findall("link"):
        if link.get("name") in mended:
            _write(link, model.mechanism)
    text = ET.tostring(root, encoding="unicode")
    return pin.buildModelFromXML(text, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(text)


def _write(link: ET.Element, mechanism: Mechanism) -> None:
    name = link.get("name")
    (body,) = mechanism.tree.frames[mechanism.tree.index[name]].frame.bodies
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=" ".join(map(repr, body.com.tolist())), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(body.mass))
    entries = zip(
        ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True
    )
    ET.SubElement(inertial, "inertia", {key: repr(float(body.inertia[at])) for key, at in entries})


def errors(path: Path, model: Model, floating: bool, points: int = 2) -> dict[str, float]:
    """Return how far mass matrix, gravity, bias and accelerations are from Pinocchio's, relative to their size."""
    robot, names, mechanism = pinocchio_of(path, model, floating), names_of(path), smooth(model.mechanism)
    data, dynamics, rng = robot.createData(), ContinuousDynamics(mechanism), np.random.default_rng(2)
    order = {name: i for i, name in enumerate(mechanism.variables)}
    worst = dict.fromkeys(("mass", "gravity", "bias", "acceleration"), 0.0)
    for _ in range(points):
        q, v = rng.uniform(-0.7, 0.7, mechanism.nq), rng.uniform(-1, 1, mechanism.nv)
        for rotation in mechanism.tree.rotations:
            place = mechanism.coordinates.index(rotation.quaternion[0])
            q[place : place + 4] /= np.linalg.norm(q[place : place + 4])
        values = dict(zip(mechanism.coordinates, q, strict=True))
        qp, E, Ed = pin.neutral(robot), np.zeros((robot.nv, mechanism.nv)), np.zeros(robot.nv)
        for i in range(1, robot.njoints):
            at, joint = robot.idx_vs[i], robot.joints[i]
            if joint.nv == 6:
                base = JointPart(name=mechanism.tree.rotations[0].name, kind="free")
                columns = [order[name] for name in rotations.variables_of(base)]
                place = [values[name] for name in rotations.coordinates_of(base)]
                qp[:7], E[:6, columns], Ed[:6] = _base(np.array(place), v[columns])
                continue
            value = names.values[robot.names[i]]
            number = value.value(values)
            for name, factor in value.terms:
                E[at, order[name]] = factor
            if joint.nq == 2:
                qp[robot.idx_qs[i] : robot.idx_qs[i] + 2] = np.cos(number), np.sin(number)
            else:
                qp[robot.idx_qs[i]] = number
        M = pin.crba(robot, data, qp).copy()
        M = np.triu(M) + np.triu(M, 1).T
        g, h = (
            pin.computeGeneralizedGravity(robot, data, qp).copy(),
            pin.nonLinearEffects(robot, data, qp, E @ v).copy(),
        )
        mass, bias = E.T @ M @ E, E.T @ (h + M @ Ed)
        zero = np.zeros(mechanism.nv)
        worst["mass"] = max(worst["mass"], _ratio(mechanism.mass_matrix(q) - mass, mass))
        sizes = np.abs(E.T) @ (np.abs(g) + np.abs(h) + np.abs(M) @ np.abs(Ed))
        weight = dynamics.inverse_dynamics(q, zero, zero)
        worst["gravity"] = max(worst["gravity"], _ratio(weight - E.T @ g, sizes))
        worst["bias"] = max(worst["bias"], _ratio(dynamics.inverse_dynamics(q, v, zero) - bias, sizes))
        got, wanted = dynamics.accelerations(q, v).a, np.linalg.solve(mass, -bias)
        condition = np.linalg.cond(mass / np.sqrt(np.outer(np.diag(mass), np.diag(mass))))
        worst["acceleration"] = max(worst["acceleration"], _ratio(got - wanted, wanted) / condition)
    return worst


def _base(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return configuration, E and dE/dt v of a free flyer, whose linear velocity is in the axes of the body."""
    quaternion = np.roll(q[3:], -1)
    E = np.eye(6)
    E[:3, :3] = pin.Quaternion(quaternion).toRotationMatrix().T
    return np.array([*q[:3], *quaternion]), E, np.array([*(-np.cross(v[3:], E[:3, :3] @ v[:3])), 0.0, 0.0, 0.0])


def _ratio(error: np.ndarray, size: np.ndarray) -> float:
    return float(np.abs(error).max() / max(np.abs(size).max(), 1e-12))
