"""A Pinocchio model as a `Mechanism`, and both programs' states and derivatives in each other's coordinates.

Revolute and prismatic joints, bounded or not, are twists along the columns of Pinocchio's own motion subspace. A free
flyer becomes three translations in the world and three angles about x, y and z, one in the other: with ``T`` from the
rates of these to Pinocchio's velocity in the body's axes, ``v' = T v``, ``a' = T a + dT v`` and forces ``f = T' f'``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sympy

from leastaction.mechanics import Body, Branch, Gravity, JointForce, Mechanism, world

ROUNDING = 1e-18  # kg m^2: what is left where moments of bodies cancel
FLYER = ("tx", "ty", "tz", "rx", "ry", "rz")


def mechanism_of(model: Any, *, quaternions: bool = False) -> Mechanism:
    """Return the mechanism of a model, an input on every variable, both in the order of its velocities.

    ``quaternions``: whether a free flyer's rotation is one; it has no inputs then. That of a spherical joint is one.
    """
    placed: list[Branch] = [world()]
    variables: list[str] = []
    for j in range(1, model.njoints):
        parent, joint, name = placed[model.parents[j]], model.joints[j], model.names[j]
        base = parent.pose(model.jointPlacements[j].homogeneous, name=f"{name} base")
        inertia = model.inertias[j]
        moments = np.where(np.abs(inertia.inertia) > ROUNDING, inertia.inertia, 0.0)
        bodies = []
        if inertia.mass > 0.0 or moments.any():
            # Some robots' files hold inertias that no body has.
            body = Body(inertia.mass, com=inertia.lever, inertia=moments, allow_nonphysical=True)
            bodies.append(body)
        if joint.nv == 6 and quaternions:
            placed.append(base.free(name, axes="quaternion", bodies=bodies))
            continue
        if joint.nv == 3:
            placed.append(base.ball(name, axes="quaternion", bodies=bodies))
            continue
        if joint.nv == 6:
            at = base
            for kind in FLYER:
                last = kind == FLYER[-1]
                options = {"bodies": bodies, "name": name} if last else {"name": f"{name} {kind}"}
                at = getattr(at, kind)(f"{name}.{kind}", **options)
                variables.append(f"{name}.{kind}")
            placed.append(at)
            continue
        assert joint.nv == 1, f"{name}: {joint.shortname()} is no joint of one variable"
        data = joint.createData()
        joint.calc(data, neutral_of(model, j), np.zeros(1))
        linear, angular = np.ravel(data.S)[:3], np.ravel(data.S)[3:]
        variable = f"{name}.q"
        placed.append(base.twist(variable, linear=linear, angular=angular, bodies=bodies, name=name))
        variables.append(variable)
    forces = [JointForce(variable, input=f"{variable} force") for variable in variables]
    return Mechanism(
        placed[0],
        [Gravity(model.gravity.linear), *forces],
        dynamic=None if quaternions else variables,
        inputs=[f"{variable} force" for variable in variables],
    )


def neutral_of(model: Any, j: int) -> np.ndarray:
    """Return Pinocchio's configuration of a joint of one variable at zero."""
    return np.array([1.0, 0.0]) if model.joints[j].nq == 2 else np.zeros(1)


@cache
def _flyer_map() -> tuple[Any, Any, Any]:
    """T of a free flyer and its first two derivatives by the six variables, as functions of them."""
    q = sympy.symbols("x y z a b c", real=True)
    a, b, c = q[3:]

    def turn(axis: int, angle: Any) -> Any:
        return [sympy.rot_axis1, sympy.rot_axis2, sympy.rot_axis3][axis](-angle)

    Ry, Rz = turn(1, b), turn(2, c)
    R = turn(0, a) * Ry * Rz
    x, y, z = (sympy.Matrix([int(i == k) for i in range(3)]) for k in range(3))
    rates = sympy.Matrix.hstack((Ry * Rz).T * x, Rz.T * y, z)
    T = sympy.diag(R.T, rates)
    first = [T.diff(s) for s in q]
    second = [[D.diff(s) for s in q] for D in first]
    return tuple(sympy.lambdify([q], expression, "numpy") for expression in (T, first, second))  # type: ignore[return-value]


@dataclass(frozen=True)
class Coordinates:
    """Where a model's free flyer is among its velocities (None: fixed base), and the map between both programs.

    ``T`` (nv, nv), ``T_q[i, j, k] = dT_ij/dq_k`` and ``T_qq`` are at one configuration of ours.
    """

    q: np.ndarray
    T: np.ndarray
    T_q: np.ndarray
    T_qq: np.ndarray

    @classmethod
    def at(cls, model: Any, q: np.ndarray) -> Coordinates:
        n = model.nv
        T, T_q, T_qq = np.eye(n), np.zeros((n, n, n)), np.zeros((n, n, n, n))
        for j in range(1, model.njoints):
            if model.joints[j].nv == 6:
                s = slice(model.joints[j].idx_v, model.joints[j].idx_v + 6)
                values = [np.array(f(q[s]), dtype=float) for f in _flyer_map()]
                T[s, s] = values[0]
                T_q[s, s, s] = np.moveaxis(values[1], 0, -1)
                T_qq[s, s, s, s] = np.moveaxis(values[2], (0, 1), (-2, -1))
        return cls(q, T, T_q, T_qq)

    def theirs(self, model: Any) -> np.ndarray:
        """Return Pinocchio's configuration."""
        import pinocchio

        out = np.zeros(model.nq)
        for j in range(1, model.njoints):
            joint = model.joints[j]
            value = self.q[joint.idx_v : joint.idx_v + joint.nv]
            if joint.nv == 6:
                from scipy.spatial.transform import Rotation

                # Capital letters: each about the axis that the one before has turned.
                turn = Rotation.from_euler("XYZ", value[3:])
                part = np.concatenate([value[:3], turn.as_quat()])
            elif joint.nq == 2:
                part = np.array([np.cos(value[0]), np.sin(value[0])])
            else:
                part = value
            out[joint.idx_q : joint.idx_q + joint.nq] = part
        assert pinocchio.isNormalized(model, out, 1e-12)
        return out

    def rate(self, v: np.ndarray) -> np.ndarray:
        """Return dT/dt along v."""
        return np.asarray(self.T_q @ v)
