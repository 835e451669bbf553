"""A cam, magnets and a variable-pitch screw, each written as an expression and as a Python class.

They act on one small machine, whose kinematics are written out in SymPy here, by hand.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy

from leastaction.mechanics import Mechanism, pose, rx, ry, rz, tx, ty, tz
from leastaction.mechanics.elements import (
    Element,
    ExpressionConstraint,
    ExpressionForce,
    ExpressionPotential,
    PythonConstraint,
    PythonFunction,
    PythonPotential,
)
from leastaction.mechanics.elements.custom.python_function import PythonForce
from leastaction.mechanics.expressions.terms import (
    direction,
    distance,
    input_,
    parameter,
    point,
    rate,
    speed,
    variable,
)

THETA, LIFT, NUT, ALPHA, BETA, HEIGHT = SYMBOLS = sympy.symbols("theta lift nut alpha beta height", real=True)
NAMES = tuple(symbol.name for symbol in SYMBOLS)


def machine(*elements: Element) -> Mechanism:
    """Return a wheel, a follower, a nut, an arm with a magnet, and a coil whose height is prescribed."""
    return Mechanism(
        [
            rz("theta", name="wheel", mass=1.0, inertia=(0.02, 0.02, 0.03)),
            tx(0.3, name="guide"),
            [ty("lift", name="follower", mass=0.4)],
            tx("nut", name="nut", mass=0.6),
            pose(translation=[0.5, 0.2, 0.4], name="base"),
            [
                rx("alpha"),
                [ry("beta"), [tz(0.3, name="magnet", mass=0.5, inertia=(0.01, 0.02, 0.01))]],
            ],
            tz("height", kinematic=True, name="coil"),
        ],
        elements,
        dynamic=NAMES[:-1],
    )


def kinematics() -> dict[Any, sympy.Expr]:
    """Return every symbol of the expressions below as a function of the configuration."""
    sa, ca, sb, cb = sympy.sin(ALPHA), sympy.cos(ALPHA), sympy.sin(BETA), sympy.cos(BETA)
    axis = sympy.Matrix([sb, -sa * cb, ca * cb])  # Rx Ry e_z
    places = {
        "follower": sympy.Matrix([0.3, LIFT, 0]),
        "magnet": sympy.Matrix([0.5, 0.2, 0.4]) + 0.3 * axis,
        "coil": sympy.Matrix([0, 0, HEIGHT]),
    }
    out: dict[Any, sympy.Expr] = {variable(s.name): s for s in SYMBOLS}
    for frame, place in places.items():
        out |= dict(zip(point(frame), place, strict=True))
    out |= dict(zip(direction("magnet", "z"), axis, strict=True))
    out |= dict(zip(direction("coil", "z"), (0, 0, 1), strict=True))
    return out


class Cam(PythonFunction):
    """The follower's height less the profile at the wheel's angle; z = [follower, theta]."""

    def value(self, z: np.ndarray) -> Any:
        a = z[3]
        return z[1] - 0.05 * (1.0 - np.cos(a)) - 0.01 * np.sin(2.0 * a) ** 2

    def gradient(self, z: np.ndarray) -> np.ndarray:
        a = z[3]
        return np.array([0.0, 1.0, 0.0, -0.05 * np.sin(a) - 0.02 * np.sin(4.0 * a)])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        out = np.zeros((4, 4), dtype=z.dtype)
        out[3, 3] = -0.05 * np.cos(z[3]) - 0.08 * np.cos(4.0 * z[3])
        return out


class Screw(PythonFunction):
    """The nut's travel less the pitch's integral over the angle; z = [nut, theta]."""

    def value(self, z: np.ndarray) -> Any:
        return z[0] - 0.02 * z[1] - 0.003 * z[1] ** 3

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return np.array([1.0, -0.02 - 0.009 * z[1] ** 2])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        return np.array([[0.0, 0.0], [0.0, -0.018 * z[1]]], dtype=z.dtype)


class Dipoles(PythonFunction):
    """Energy of two dipoles, ``k (m.n / d^3 - 3 (m.r)(n.r) / d^5)``; z = [magnet, coil, m, n]."""

    def __init__(self, k: float) -> None:
        self.k = k

    def terms(self, z: np.ndarray) -> tuple[Any, ...]:
        r, m, n = z[:3] - z[3:6], z[6:9], z[9:]
        # Products as f = sum c_i P_i over powers of s = r.r: A s^(-3/2) - 3 B C s^(-5/2).
        return r, m, n, r @ r, m @ n, m @ r, n @ r

    def value(self, z: np.ndarray) -> Any:
        _, _, _, s, A, B, C = self.terms(z)
        return self.k * (A * s**-1.5 - 3.0 * B * C * s**-2.5)

    def parts(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the gradient and Hessian by (s, A, B, C), then the gradients (4, 12) of those by z."""
        r, m, n, s, A, B, C = self.terms(z)
        by = np.array(
            [
                -1.5 * A * s**-2.5 + 7.5 * B * C * s**-3.5,
                s**-1.5,
                -3.0 * C * s**-2.5,
                -3.0 * B * s**-2.5,
            ]
        )
        by2 = np.zeros((4, 4), dtype=z.dtype)
        by2[0, 0] = 3.75 * A * s**-3.5 - 26.25 * B * C * s**-4.5
        by2[0, 1] = by2[1, 0] = -1.5 * s**-2.5
        by2[0, 2] = by2[2, 0] = 7.5 * C * s**-3.5
        by2[0, 3] = by2[3, 0] = 7.5 * B * s**-3.5
        by2[2, 3] = by2[3, 2] = -3.0 * s**-2.5
        o = np.zeros(3)
        slopes = np.array(
            [
                np.concatenate([2.0 * r, -2.0 * r, o, o]),
                np.concatenate([o, o, n, m]),
                np.concatenate([m, -m, r, o]),
                np.concatenate([n, -n, o, r]),
            ]
        )
        return by, by2, slopes, CURVATURES

    def gradient(self, z: np.ndarray) -> np.ndarray:
        by, _, slopes, _ = self.parts(z)
        return self.k * by @ slopes

    def hessian(self, z: np.ndarray) -> np.ndarray:
        by, by2, slopes, curvatures = self.parts(z)
        return self.k * (slopes.T @ by2 @ slopes + np.tensordot(by, curvatures, 1))


def _curvatures() -> np.ndarray:
    """Return the constant Hessians (4, 12, 12) of r.r, m.n, m.r and n.r by z."""
    out, one = np.zeros((4, 12, 12)), np.eye(3)
    blocks = [
        [(0, 0, 2), (0, 3, -2), (3, 3, 2)],
        [(6, 9, 1)],
        [(0, 6, 1), (3, 6, -1)],
        [(0, 9, 1), (3, 9, -1)],
    ]
    for hessian, entries in zip(out, blocks, strict=True):
        for i, j, factor in entries:
            hessian[i : i + 3, j : j + 3] = factor * one
            hessian[j : j + 3, i : i + 3] = factor * one
    return out


CURVATURES = _curvatures()


class Flux(PythonFunction):
    """Flux through the coil for a unit current, ``k / d^3``; z = [magnet, coil]."""

    def value(self, z: np.ndarray) -> Any:
        r = z[:3] - z[3:]
        return 2e-3 * (r @ r) ** -1.5

    def gradient(self, z: np.ndarray) -> np.ndarray:
        r = z[:3] - z[3:]
        slope = -6e-3 * r * (r @ r) ** -2.5
        return np.concatenate([slope, -slope])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        r = z[:3] - z[3:]
        s = r @ r
        block = 30e-3 * np.outer(r, r) * s**-3.5 - 6e-3 * np.eye(3) * s**-2.5
        return np.block([[block, -block], [-block, block]])


ANGLE = variable("theta")
BETWEEN = point("magnet") - point("coil")
GAP = distance("magnet", "coil")
POLE, COIL = direction("magnet", "z"), direction("coil", "z")

CAM = point("follower")[1] - parameter("stroke", 0.05) * (1 - sympy.cos(ANGLE)) - sympy.sin(2 * ANGLE) ** 2 / 100
SCREW = variable("nut") - 0.02 * ANGLE - 0.003 * ANGLE**3
DIPOLES = parameter("strength", 2e-3) * (POLE.dot(COIL) / GAP**3 - 3 * POLE.dot(BETWEEN) * COIL.dot(BETWEEN) / GAP**5)
PULL = -6e-3 * input_("current") / GAP**4
# A motor with back-EMF and a magnetic brake on the arm: rates, an input and a product of scalars of the machine.
MOTOR = (
    input_("voltage")
    - parameter("emf", 0.3) * speed("theta") * (1 + GAP**2)
    - sympy.tanh(rate(GAP) * speed("theta")) * sympy.cos(ANGLE)
)

CONSTRAINTS: dict[str, tuple[Element, Element, sympy.Expr]] = {
    "cam": (
        ExpressionConstraint(CAM, name="cam"),
        PythonConstraint(Cam(), points=["follower"], variables=["theta"], name="cam"),
        CAM,
    ),
    "screw": (
        ExpressionConstraint(SCREW, name="screw"),
        PythonConstraint(Screw(), variables=["nut", "theta"], name="screw"),
        SCREW,
    ),
}
MAGNETS = (
    ExpressionPotential(DIPOLES, name="magnets"),
    PythonPotential(
        Dipoles(2e-3),
        points=["magnet", "coil"],
        directions=[("magnet", "z"), ("coil", (0.0, 0.0, 2.0))],
        name="magnets",
    ),
)
ATTRACTION = (
    ExpressionForce(PULL, along=GAP, name="attraction"),
    PythonForce(Flux(), "current", points=["magnet", "coil"], name="attraction"),
)
