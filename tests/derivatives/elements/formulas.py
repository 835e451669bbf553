"""What every element means: its documented formula, written down once more on poses and their rates.

Potentials give V, constraints their equations in the documented order, forces the generalised forces by virtual
work: ``f = (dx/dq)^T F`` for a force F on a point x, and likewise with the angular velocity for a torque.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from leastaction.mechanics.elements import directions

if TYPE_CHECKING:
    from oracles.mechanism_oracle import Place

Array = jnp.ndarray


def kind(element: object) -> str:
    return type(element).__name__


@dataclass(frozen=True)
class Motion:
    """A configuration, a velocity and inputs, for the forces."""

    place: Callable[[Array], Place]
    q: Array
    v: Array
    u: dict[str, Array]

    @property
    def here(self) -> Place:
        return self.place(self.q)

    def rate(self, coordinate: Callable[[Place], Array]) -> Array:
        return jax.jvp(lambda q: coordinate(self.place(q)), (self.q,), (self.v,))[1]

    def work(self, coordinate: Callable[[Place], Array], force: Array) -> Array:
        """Return f with ``f . dq = force . dx`` for every change dq of the configuration."""
        slopes = jax.jacfwd(lambda q: coordinate(self.place(q)))(self.q)
        return jnp.tensordot(force, slopes, jnp.ndim(force))

    def turning_work(self, frame: str, torque: Array) -> Array:
        """Return f with ``f . v = torque . w`` for every velocity v and the angular velocity w of the frame."""
        R = self.here.rotation(frame)
        hats = jnp.einsum("ijn,kj->ikn", jax.jacfwd(lambda q: self.place(q).rotation(frame))(self.q), R)
        return torque @ jnp.stack([hats[2, 1], hats[0, 2], hats[1, 0]])

    def number(self, component: Any) -> Array | float:
        """Return a number, the value of the input of that name, or that times a factor."""
        if isinstance(component, Mapping):
            return sum(factor * self.u[name] for name, factor in component.items())
        return self.u[component] if isinstance(component, str) else component


# Shared pieces


def axis_vector(axis: Any) -> np.ndarray:
    return np.eye(3)["xyz".index(axis)] if isinstance(axis, str) else np.asarray(axis, dtype=float)


def triad(axis: Any) -> list[np.ndarray]:
    """Return the axis and the two axes after it; for numbers, which two is the package's choice."""
    if not isinstance(axis, str):
        return list(directions.triad(axis))
    i = "xyz".index(axis)
    return [np.eye(3)[(i + k) % 3] for k in range(3)]


def norm(x: Array) -> Array:
    return jnp.sqrt(x @ x)


def path_length(place: Place, frames: Any) -> Array:
    if isinstance(frames, Mapping):
        return sum(factor * path_length(place, path) for path, factor in frames.items())
    points = [place.origin(frame) for frame in frames]
    return sum(norm(b - a) for a, b in pairwise(points))


def combination(place: Place, factors: Any) -> Array:
    """Return the sum of factor q[name]; a name alone has the factor 1."""
    if isinstance(factors, str):
        return place[factors]
    return sum(factor * place[name] for name, factor in factors.items())


def scalar(place: Place, on: Any) -> Array:
    """Return a variable, a sum of some, the length of a path, or a sum of such."""
    of_paths = not isinstance(on, str) and (not isinstance(on, Mapping) or isinstance(next(iter(on)), tuple))
    return path_length(place, on) if of_paths else combination(place, on)


def curve_value(curve: Any, x: Array) -> Array:
    """Return the polynomial piece that x falls into; the first and the last one carry on."""
    breaks, pieces = jnp.asarray(curve.breaks), jnp.asarray(curve.coefficients)
    i = jnp.clip(jnp.searchsorted(breaks, x, side="right") - 1, 0, len(pieces) - 1)
    t = x - breaks[i]
    return sum(pieces[i, k] * t**k for k in range(pieces.shape[1]))


def curve_integral(curve: Any, x: Array) -> Array:
    """Return the integral of a curve from its start to x."""
    powers = np.arange(1, curve.coefficients.shape[1] + 1)
    terms = curve.coefficients / powers
    whole = [0.0]
    for piece, width in zip(terms, np.diff(curve.breaks), strict=True):
        whole.append(whole[-1] + piece @ width**powers)
    antiderivative = np.column_stack([whole[:-1], terms])
    return curve_value(SimpleNamespace(breaks=curve.breaks, coefficients=antiderivative), x)


def expression_value(expression: Any, place: Place, motion: Motion | None = None) -> Array:
    """Return the value of a SymPy expression by JAX, its symbols looked up by what they stand for."""
    import sympy

    values = {}

    def symbol(value: Array) -> Any:
        dummy = sympy.Dummy()
        values[dummy] = value
        return dummy

    known = expression
    for part in [a for a in sympy.preorder_traversal(expression) if kind(a) == "Rate"]:
        assert motion is not None, "only forces have rates"
        inner = part.args[0]
        rate = motion.rate(lambda there, inner=inner: expression_value(inner, there))
        known = known.xreplace({part: symbol(rate)})
    known = known.replace(lambda a: kind(a) == "Coordinate", lambda a: a.args[0])
    for quantity in known.free_symbols - set(values):
        role, of = quantity.role, quantity.of
        if role == "point":
            value = place.origin(of[0])[of[1]]
        elif role == "direction":
            value = (place.rotation(of[0]) @ np.asarray(of[1]))[of[2]]
        elif role == "variable":
            value = place[of[0]]
        elif role == "input":
            assert motion is not None, "only forces have inputs"
            value = motion.u[of[0]]
        else:
            value = of[1]
        known = known.xreplace({quantity: symbol(value)})
    return sympy.lambdify(list(values), known, modules="jax")(*values.values())


def python_value(place: Place, e: Any) -> Array:
    """Return f(z) of a function of the user's own, which is written so that it takes JAX's arrays too."""
    points = [place.origin(frame) for frame in e.points]
    directions = [place.rotation(frame) @ np.asarray(vector) for frame, vector in e.directions]
    variables = [place[name][None] for name in e.variables]
    return e.function.value(jnp.concatenate([*points, *directions, *variables]))


# Potentials


def gravity(place: Place, e: Any) -> Array:
    """V = -m g . p"""
    energy = jnp.zeros(())
    for body in place.oracle.bodies:
        if e.frames is None or body.frame in e.frames:
            centre = place.pose(body.frame) @ np.append(body.centre, 1.0)
            energy -= body.mass * np.asarray(e.vector) @ centre[:3]
    return energy


def inverse_square_gravity(place: Place, e: Any) -> Array:
    return -e.strength / path_length(place, (e.frame1, e.frame2))


def value_of(place: Place, given: float | str) -> Array | float:
    """Return a number, or the value of the variable of that name."""
    return place[given] if isinstance(given, str) else given


def linear_spring(place: Place, e: Any) -> Array:
    apart = place.origin(e.frame1) - place.origin(e.frame2)
    if e.length == 0.0:
        return 0.5 * e.stiffness * apart @ apart
    return 0.5 * e.stiffness * (norm(apart) - value_of(place, e.length)) ** 2


def joint_spring(place: Place, e: Any) -> Array:
    return 0.5 * e.stiffness * (combination(place, e.variable) - value_of(place, e.rest)) ** 2


def turned(place: Place, e: Any) -> Array:
    """phi = atan2((a x e) . d, e . d), e the first axis after a in frame1 and d the same vector of frame2"""
    a, across, _ = triad(e.axis)
    R1, R2 = place.rotation(e.frame1), place.rotation(e.frame2)
    d = R2 @ across
    return jnp.arctan2((R1 @ np.cross(a, across)) @ d, (R1 @ across) @ d)


def torsional_spring(place: Place, e: Any) -> Array:
    return 0.5 * e.stiffness * (turned(place, e) - value_of(place, e.rest)) ** 2


def nonlinear_spring(place: Place, e: Any) -> Array:
    """V = integral of F from the start of the curve"""
    return curve_integral(e.force, scalar(place, e.on))


def elastic_string(place: Place, e: Any) -> Array:
    stretch = path_length(place, e.frames) - value_of(place, e.length)
    if e.tension_only:
        stretch = e.smoothing * jax.nn.softplus(stretch / e.smoothing)
    return 0.5 * e.stiffness * stretch**2


def expression_potential(place: Place, e: Any) -> Array:
    return expression_value(e.expression, place)


# Constraints


def distance(place: Place, e: Any) -> list[Array]:
    apart = place.origin(e.frame1) - place.origin(e.frame2)
    return [apart @ apart - value_of(place, e.length) ** 2]


def point_to_point(place: Place, e: Any) -> list[Array]:
    apart = place.origin(e.frame1) - place.origin(e.frame2)
    return [apart["xyz".index(axis)] for axis in e.axes]


def path_length_held(place: Place, e: Any) -> list[Array]:
    return [path_length(place, e.frames) - value_of(place, e.length)]


def coupling(place: Place, e: Any) -> list[Array]:
    return [combination(place, e.factors) - value_of(place, e.offset)]


def polynomial_coupling(place: Place, e: Any) -> list[Array]:
    """h = s - (c0 + c1 x + c2 x^2 + ...)"""
    x = scalar(place, e.of)
    return [scalar(place, e.on) - sum(c * x**k for k, c in enumerate(e.coefficients))]


def point_on_plane(place: Place, e: Any) -> list[Array]:
    """h = n . (p_plane - p_frame)"""
    n = place.rotation(e.plane) @ axis_vector(e.normal)
    return [n @ (place.origin(e.plane) - place.origin(e.frame))]


def point_on_line(place: Place, e: Any) -> list[Array]:
    """h = e . (p_line - p_frame) along both directions across the line"""
    apart = place.origin(e.line) - place.origin(e.frame)
    R = place.rotation(e.line)
    return [(R @ across) @ apart for across in triad(e.direction)[1:]]


def hinge_loop(place: Place, e: Any) -> list[Array]:
    """The origins, and the axis of frame1 on both directions across that of frame2"""
    apart = place.origin(e.frame1) - place.origin(e.frame2)
    R1, R2 = place.rotation(e.frame1), place.rotation(e.frame2)
    a, *across = triad(e.axis)
    if e.planar:
        return [(R1 @ b) @ apart for b in across]
    return [*apart, *((R1 @ a) @ (R2 @ b) for b in across)]


def fixed_orientation(place: Place, e: Any) -> list[Array]:
    """e_y . d_z, e_z . d_x, e_x . d_y, with d the axes of frame2 less the wanted rotation"""
    wanted = np.eye(3) if e.rotation is None else np.asarray(e.rotation)
    between = place.rotation(e.frame1).T @ place.rotation(e.frame2) @ wanted.T
    return [between[1, 2], between[2, 0], between[0, 1]]


def prescribed_path(place: Place, e: Any) -> list[Array]:
    names = (e.x, e.y, e.z)
    point = place.origin(e.frame)
    return [point[i] - place[name] for i, name in enumerate(names) if name is not None]


def expression_constraint(place: Place, e: Any) -> list[Array]:
    return [expression_value(e.expression, place)]


def python_constraint(place: Place, e: Any) -> list[Array]:
    return [python_value(place, e)]


# Forces


def damping(motion: Motion, e: Any) -> Array:
    dynamic = motion.here.oracle.dynamic
    c = np.zeros(len(motion.q))
    for i, name in enumerate(dynamic):
        c[i] = e.named.get(name, e.default)
    return -c * motion.v


def joint_force(motion: Motion, e: Any) -> Array:
    """f_i = factor_i u"""
    return motion.work(lambda place: combination(place, e.variable), motion.u[e.input])


def motor(motion: Motion, e: Any) -> Array:
    """f_i = gain u dphi/dq_i"""
    return motion.work(lambda place: turned(place, e), e.gain * motion.u[e.input])


def linear_motor(motion: Motion, e: Any) -> Array:
    """f_i = gain u ds/dq_i"""
    push = e.gain * motion.u[e.input]
    return motion.work(lambda place: path_length(place, (e.frame1, e.frame2)), push)


def nonlinear_damping(motion: Motion, e: Any) -> Array:
    """F = -(c1 s' + c3 s'^3 + c5 s'^5) along s"""

    def s(place: Place) -> Array:
        return scalar(place, e.on)

    v = motion.rate(s)
    return motion.work(s, -sum(c * v ** (2 * k + 1) for k, c in enumerate(e.coefficients)))


def coulomb_friction(motion: Motion, e: Any) -> Array:
    def s(place: Place) -> Array:
        return scalar(place, e.on)

    return motion.work(s, -e.force * jnp.tanh(motion.rate(s) / e.speed))


def servo(motion: Motion, e: Any) -> Array:
    """F = (gain + gain_by_place s + gain_by_rate s') u + offset - stiffness s - damping s'"""

    def along(place: Place) -> Array:
        return scalar(place, e.on)

    numbers = ("gain_by_place", "gain_by_rate", "offset", "stiffness", "damping")
    by_place, by_rate, offset, stiffness, damping = (getattr(e, name) or 0.0 for name in numbers)
    s, rate = along(motion.here), motion.rate(along)
    gain = e.gain + by_place * s + by_rate * rate
    return motion.work(along, gain * motion.u[e.input] + offset - stiffness * s - damping * rate)


def linear_damper(motion: Motion, e: Any) -> Array:
    """A tension c times the rate of the distance."""

    def length(place: Place) -> Array:
        return path_length(place, (e.frame1, e.frame2))

    return motion.work(length, -e.coefficient * motion.rate(length))


def wrench(motion: Motion, e: Any) -> tuple[Array, Array]:
    parts = [(0.0, 0.0, 0.0) if part is None else part for part in (e.force, e.torque)]
    force, torque = (jnp.stack([jnp.asarray(motion.number(c)) for c in part]) for part in parts)
    return force, torque


def body_wrench(motion: Motion, e: Any) -> Array:
    """In the frame's axes, the force at its origin."""
    R = motion.here.rotation(e.frame)
    return _on_frame(motion, e.frame, *(R @ part for part in wrench(motion, e)))


def hybrid_wrench(motion: Motion, e: Any) -> Array:
    """In world axes, the force at the frame's origin."""
    return _on_frame(motion, e.frame, *wrench(motion, e))


def spatial_wrench(motion: Motion, e: Any) -> Array:
    """In world axes, the force on the point of the body that is at the world's origin now."""
    force, torque = wrench(motion, e)
    to_body = jnp.linalg.inv(motion.here.pose(e.frame)) @ np.array([0.0, 0.0, 0.0, 1.0])
    push = motion.work(lambda place: (place.pose(e.frame) @ to_body)[:3], force)
    return push + motion.turning_work(e.frame, torque)


def _on_frame(motion: Motion, frame: str, force: Array, torque: Array) -> Array:
    return motion.work(lambda p: p.origin(frame), force) + motion.turning_work(frame, torque)


def tendon_force(motion: Motion, e: Any) -> Array:
    """f = -gain u fl(L) fv(L') dL/dq"""

    def length(place: Place) -> Array:
        return path_length(place, e.frames)

    tension = e.gain * motion.u[e.input]
    if e.force_length is not None:
        tension = tension * curve_value(e.force_length, length(motion.here))
    if e.force_velocity is not None:
        tension = tension * curve_value(e.force_velocity, motion.rate(length))
    return motion.work(length, -tension)


def drag(motion: Motion, e: Any) -> Array:
    """F = -c (|w|^2 + e^2)^((n-1)/2) w with w = p' - wind"""
    w = motion.rate(lambda place: place.origin(e.frame)) - np.asarray(e.wind)
    size = (w @ w + e.smoothing**2) ** ((e.exponent - 1.0) / 2.0)
    return motion.work(lambda place: place.origin(e.frame), -e.coefficient * size * w)


def expression_force(motion: Motion, e: Any) -> Array:
    """f_i = F ds/dq_i"""

    def along(place: Place) -> Array:
        named = isinstance(e.along, str)
        return place[e.along] if named else expression_value(e.along, place)

    return motion.work(along, expression_value(e.expression, motion.here, motion))


def python_force(motion: Motion, e: Any) -> Array:
    """f_i = gain F ds/dq_i, F the input or a function of s, variables, their rates and the input"""

    def s(place: Place) -> Array:
        return place[e.function] if isinstance(e.function, str) else python_value(place, e)

    u = [] if e.input is None else [motion.u[e.input]]
    if e.magnitude is None:
        return motion.work(s, e.gain * u[0])
    scalars = [s, *(lambda place, name=name: place[name] for name in e.measured)]
    y = [*(scalar(motion.here) for scalar in scalars), *(motion.rate(scalar) for scalar in scalars), *u]
    return motion.work(s, e.gain * e.magnitude.value(jnp.stack(y)))


def armature(index: Mapping[str, int], e: Any) -> np.ndarray:
    """R with T = v'Rv/2 = J/2 (sum of factor v)^2"""
    factors = np.zeros(len(index))
    for name, factor in ({e.variable: 1.0} if isinstance(e.variable, str) else e.variable).items():
        factors[index[name]] = factor
    return e.inertia * np.outer(factors, factors)


ROTORS: dict[str, Callable[[Mapping[str, int], Any], np.ndarray]] = {"Armature": armature}

POTENTIALS: dict[str, Callable[[Place, Any], Array]] = {
    "Gravity": gravity,
    "InverseSquareGravity": inverse_square_gravity,
    "LinearSpring": linear_spring,
    "JointSpring": joint_spring,
    "TorsionalSpring": torsional_spring,
    "NonlinearSpring": nonlinear_spring,
    "ElasticString": elastic_string,
    "ExpressionPotential": expression_potential,
    "PythonPotential": python_value,
}
CONSTRAINTS: dict[str, Callable[[Place, Any], list[Array]]] = {
    "Distance": distance,
    "PointToPoint": point_to_point,
    "PathLength": path_length_held,
    "PointOnPlane": point_on_plane,
    "PointOnLine": point_on_line,
    "HingeLoop": hinge_loop,
    "FixedOrientation": fixed_orientation,
    "PrescribedPath": prescribed_path,
    "Coupling": coupling,
    "PolynomialCoupling": polynomial_coupling,
    "ExpressionConstraint": expression_constraint,
    "PythonConstraint": python_constraint,
}
FORCES: dict[str, Callable[[Motion, Any], Array]] = {
    "Damping": damping,
    "JointForce": joint_force,
    "Motor": motor,
    "LinearMotor": linear_motor,
    "NonlinearDamping": nonlinear_damping,
    "CoulombFriction": coulomb_friction,
    "LinearDamper": linear_damper,
    "BodyWrench": body_wrench,
    "HybridWrench": hybrid_wrench,
    "SpatialWrench": spatial_wrench,
    "TendonForce": tendon_force,
    "Servo": servo,
    "Drag": drag,
    "ExpressionForce": expression_force,
    "PythonForce": python_force,
}
