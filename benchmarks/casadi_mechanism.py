"""A mechanism and its midpoint step as CasADi expressions, read from the description and from nothing the core derives.

`Symbolic` knows the elements that the problems of the benchmarks have; of others it says that it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from leastaction.mechanics import Mechanism

__all__ = ["Symbolic"]

_TINY = 1e-14  # what is left of an entry of a pose that should be 0


class Symbolic:
    """Functions of a mechanism, on CasADi's scalar expressions (SX).

    Parameters
    ----------
    mechanism : Mechanism
    unknown : sequence of str
        Names of parameters that are symbols: stiffnesses of joint springs, or coefficients of damping.

    Attributes
    ----------
    q, v, u : SX
        Symbols of variables, velocities and inputs, in the order of the mechanism.
    lagrangian : SX
        Kinetic less potential energy.
    constraints : SX (nc,)
        The equations ``h(q)``.
    force : SX (nd,)
        Generalised forces on the dynamic variables.
    numbers : SX (n,)
        The unknown parameters.

    Raises
    ------
    NotImplementedError
        The mechanism has an element that is not known here, or an unknown parameter is of another kind.
    """

    def __init__(self, mechanism: Mechanism, unknown: Sequence[str] = ()) -> None:
        self.numbers, self._unknown, self._used = ca.SX.sym("p", len(unknown)), list(unknown), set()
        m = self.mechanism = mechanism
        self.q, self.v = ca.SX.sym("q", m.nq), ca.SX.sym("v", m.nq)
        self.u = ca.SX.sym("u", m.nu)
        self._index = {name: i for i, name in enumerate(m.variables)}
        self._frames = {f.name: (f.joint, np.asarray(f.pose)) for f in m.tree.frames}
        self._move_joints()
        self.lagrangian = self._kinetic()
        force, equations = ca.SX.zeros(m.nq), []
        for element in m.elements.values():
            kind = type(element).__name__
            if kind in _POTENTIALS:
                self.lagrangian -= _POTENTIALS[kind](self, element)
            elif kind in _CONSTRAINTS:
                equations.append(_CONSTRAINTS[kind](self, element))
            elif kind in _FORCES:
                force += _FORCES[kind](self, element)
            else:
                raise NotImplementedError(f"{kind} has no CasADi expression in the benchmarks")
        if self._used != set(self._unknown):
            raise NotImplementedError(f"{sorted(set(self._unknown) - self._used)} are no symbols in the benchmarks")
        self.force = force[: m.nd]
        self.constraints = ca.vertcat(*equations) if equations else ca.SX.zeros(0)

    # ---- Where the frames are -------------------------------------------------------------------

    def position(self, frame: str) -> ca.SX:
        """Return the origin (3,) of a frame in the world."""
        joint, pose = self._frames[frame]
        R, p = self._poses[joint]
        return p + R @ pose[:3, 3]

    def _move_joints(self) -> None:
        """Find pose (R, p) in the world, and velocity (v, w) in its own axes, of every joint's moved frame."""
        zero = ca.SX.zeros(3)
        self._poses, self._rates = {-1: (ca.SX.eye(3), zero)}, {-1: (zero, zero)}
        for j, joint in enumerate(self.mechanism.tree.joints):
            s, rate = ca.SX(joint.coordinate.offset), ca.SX(0)
            for name, factor in joint.coordinate.terms:
                s += factor * self.q[self._index[name]]
                rate += factor * self.v[self._index[name]]
            moved = _clean(joint.pose) @ _exponential(joint.twist, s)
            R, p = moved[:3, :3], moved[:3, 3]
            (R0, p0), (v0, w0) = self._poses[joint.parent], self._rates[joint.parent]
            self._poses[j] = (R0 @ R, p0 + R0 @ p)
            self._rates[j] = (
                R.T @ (v0 + ca.cross(w0, p)) + joint.twist[:3] * rate,
                R.T @ w0 + joint.twist[3:] * rate,
            )

    def _kinetic(self) -> ca.SX:
        """Return the energy of all bodies; those on one joint are one."""
        masses: dict[int, tuple[float, np.ndarray, np.ndarray]] = {}
        for joint, mass, centre, inertia in self._bodies():
            M, first, second = masses.get(joint, (0.0, np.zeros(3), np.zeros((3, 3))))
            about = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
            masses[joint] = (M + mass, first + mass * centre, second + about)
        energy = ca.SX(0)
        for joint, (mass, first, second) in masses.items():
            v, w = self._rates[joint]
            energy += 0.5 * mass * ca.dot(v, v) + ca.dot(v, ca.cross(w, _clean(first)))
            energy += 0.5 * ca.dot(w, _clean(second) @ w)
        return energy

    def _bodies(self, frames: Any = None) -> list[tuple[int, float, np.ndarray, np.ndarray]]:
        """Return joint, mass, centre and inertia about that, in the axes of the joint, of every body."""
        return [
            (
                f.joint,
                body.mass,
                f.pose[:3, :3] @ body.com + f.pose[:3, 3],
                f.pose[:3, :3] @ body.inertia @ f.pose[:3, :3].T,
            )
            for f in self.mechanism.tree.frames
            for body in f.frame.bodies
            if frames is None or f.name in frames
        ]

    def _value(self, given: float | str) -> Any:
        """Return a number, or the variable of that name."""
        return self.q[self._index[given]] if isinstance(given, str) else given

    def _number(self, given: float | str) -> Any:
        """Return a number, or the input of that name."""
        return self.u[list(self.mechanism.inputs).index(given)] if isinstance(given, str) else given

    def _parameter(self, name: str, given: float) -> Any:
        """Return a parameter's number, or its symbol."""
        if name not in self._unknown:
            return given
        self._used.add(name)
        return self.numbers[self._unknown.index(name)]

    # ---- Elements -------------------------------------------------------------------------------

    def _gravity(self, e: Any) -> ca.SX:
        energy = ca.SX(0)
        for joint, mass, centre, _ in self._bodies(e.frames):
            R, p = self._poses[joint]
            energy -= mass * ca.dot(np.asarray(e.vector), p + R @ _clean(centre))
        return energy

    def _joint_spring(self, e: Any) -> ca.SX:
        return (
            0.5
            * self._parameter(f"{e.name}.stiffness", e.stiffness)
            * (self._combination(e.variable) - self._value(e.rest)) ** 2
        )

    def _combination(self, factors: Any) -> ca.SX:
        factors = factors if isinstance(factors, Mapping) else {factors: 1.0}
        return sum(factor * self.q[self._index[name]] for name, factor in factors.items())

    def _distance(self, e: Any) -> ca.SX:
        apart = self.position(e.frame1) - self.position(e.frame2)
        return ca.dot(apart, apart) - self._value(e.length) ** 2

    def _point_to_point(self, e: Any) -> ca.SX:
        apart = self.position(e.frame1) - self.position(e.frame2)
        return ca.vertcat(*(apart["xyz".index(axis)] for axis in e.axes))

    def _damping(self, e: Any) -> ca.SX:
        c = ca.SX.zeros(self.mechanism.nq)
        for i, name in enumerate(self.mechanism.dynamic):
            c[i] = self._parameter(f"{e.name}.{name}", e.named.get(name, e.default))
        return -c * self.v

    def _joint_force(self, e: Any) -> ca.SX:
        return ca.gradient(self._combination(e.variable), self.q) * self._number(e.input)

    def _body_wrench(self, e: Any) -> ca.SX:
        joint, pose = self._frames[e.frame]
        R, p = _clean(pose[:3, :3]), _clean(pose[:3, 3])
        v, w = self._rates[joint]
        force, torque = (
            ca.vertcat(*(self._number(c) for c in part or (0.0, 0.0, 0.0))) for part in (e.force, e.torque)
        )
        power = ca.dot(R.T @ (v + ca.cross(w, p)), force) + ca.dot(R.T @ w, torque)
        return ca.gradient(power, self.v)

    def _tendon(self, e: Any) -> ca.SX:
        if e.force_length is not None or e.force_velocity is not None:
            raise NotImplementedError("a tendon whose force depends on its length has no CasADi expression here")
        points = [self.position(name) for name in e.frames]
        length = sum(ca.norm_2(b - a) for a, b in pairwise(points))
        return -e.gain * self._number(e.input) * ca.gradient(length, self.q)

    # ---- The step -------------------------------------------------------------------------------

    def step(self, dt: float | ca.SX) -> ca.Function:
        """Return the residuals (nx + nc,) of a midpoint step, ``(x1, u, lam, x2)``.

        States ``[q; rho; p; v_rho]`` and inputs ``[u; rho_next]`` are those of `MidpointSystem`, forces are split
        evenly. In order: ``p1 + D1Ld + fd- - Dh(q1)' lam``, ``p2 - D2Ld - fd+``, the prescribed variables and their
        velocities, ``h(q2)``. A symbol for the time step is one more argument, dt, and so are unknown parameters, p.
        """
        m = self.mechanism
        nd, nq = m.nd, m.nq
        x1, x2 = ca.SX.sym("x1", m.nx), ca.SX.sym("x2", m.nx)
        u, lam = ca.SX.sym("u", m.nu + m.nrho), ca.SX.sym("lam", m.nc)
        q1, q2 = x1[:nq, 0], x2[:nq, 0]
        by_q, by_v = (
            ca.Function("D", [self.q, self.v, self.numbers], [ca.gradient(self.lagrangian, z)[:nd]])
            for z in (self.q, self.v)
        )
        middle, v = 0.5 * (q1 + q2), (q2 - q1) / dt
        force = ca.Function("f", [self.q, self.v, self.u, self.numbers], [self.force])
        half = 0.5 * dt * (by_q(middle, v, self.numbers) + force(middle, v, u[: m.nu, 0], self.numbers))
        momentum = by_v(middle, v, self.numbers)
        pull = ca.jtimes(self.constraints, self.q, lam, True)[:nd] if m.nc else ca.SX.zeros(nd)
        residual = ca.vertcat(
            x1[nq : nq + nd] + half - momentum - ca.Function("pull", [self.q, lam], [pull])(q1, lam),
            x2[nq : nq + nd] - half - momentum,
            x2[nd:nq, 0] - u[m.nu :, 0],
            x2[nq + nd :, 0] - v[nd:, 0],
            ca.Function("h", [self.q], [self.constraints])(q2),
        )
        arguments, names = [x1, u, lam, x2], ["x1", "u", "lam", "x2"]
        if isinstance(dt, ca.SX):
            arguments, names = [*arguments, dt], [*names, "dt"]
        if self._unknown:
            arguments, names = [*arguments, self.numbers], [*names, "p"]
        return ca.Function("step", arguments, [residual], names, ["F"])

    def rate(self) -> ca.Function:
        """Return the rate of ``x = [q; v]`` under inputs, ``(x, u) -> dx/dt``: of mechanisms without constraints.

        Raises
        ------
        NotImplementedError
            The mechanism has constraints or prescribed variables.
        """
        m = self.mechanism
        if m.nc or m.nrho or self._unknown:
            raise NotImplementedError("rates are those of mechanisms without constraints, all of whose variables move")
        by_v = ca.gradient(self.lagrangian, self.v)
        push = self.force + ca.gradient(self.lagrangian, self.q) - ca.jtimes(by_v, self.q, self.v)
        accelerations = ca.solve(ca.jacobian(by_v, self.v), push)
        x = ca.vertcat(self.q, self.v)
        return ca.Function("rate", [x, self.u], [ca.vertcat(self.v, accelerations)], ["x", "u"], ["rate"])


def _clean(array: Any) -> ca.SX:
    """Return numbers as constants of CasADi, without what rounding left of zeros: those cost nothing."""
    array = np.asarray(array)
    return ca.SX(ca.DM(np.where(np.abs(array) < _TINY, 0.0, array)))


def _exponential(twist: np.ndarray, s: ca.SX) -> ca.SX:
    """Return ``exp(hat s)`` (4, 4): ``hat^4 = -w^2 hat^2``, so the series ends after hat^3."""
    x, y, z, a, b, c = twist
    hat = np.array([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]])
    w = float(np.linalg.norm(twist[3:]))
    if w == 0.0:
        return ca.SX.eye(4) + s * _clean(hat)
    second, third = hat @ hat / w**2, hat @ hat @ hat / w**3
    return (
        _clean(np.eye(4) + second)
        + s * _clean(hat + w * third)
        - ca.sin(w * s) * _clean(third)
        - ca.cos(w * s) * _clean(second)
    )


_POTENTIALS = {"Gravity": Symbolic._gravity, "JointSpring": Symbolic._joint_spring}
_CONSTRAINTS = {"Distance": Symbolic._distance, "PointToPoint": Symbolic._point_to_point}
_FORCES = {
    "Damping": Symbolic._damping,
    "JointForce": Symbolic._joint_force,
    "BodyWrench": Symbolic._body_wrench,
    "TendonForce": Symbolic._tendon,
}
