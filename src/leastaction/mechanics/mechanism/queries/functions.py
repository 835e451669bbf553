"""The functions that a mechanism is made of, of the whole or of one element alone.

Functions are methods of `Mechanism`, which is ``m`` here; classes evaluate what they return, see
`leastaction.mechanics.mechanism.queries.function_derivatives.Evaluate`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.elements import Constraint, Force, Parts, Potential
from leastaction.mechanics.mechanism.arguments import Compiled, inputs_of, rates, single
from leastaction.mechanics.mechanism.queries.composition import Composed, Places, PushedBack, Turns
from leastaction.mechanics.mechanism.queries.function_derivatives import Evaluate, FunctionDerivatives
from leastaction.mechanics.mechanism.queries.turn_charts import pushed_state, turned_state
from leastaction.numerics.arrays import Array, Row


def lagrangian(m: Compiled, q: Row, v: Row) -> FunctionDerivatives:
    """Return the Lagrangian ``L = T - V`` (J) at a state, by ``q`` and ``v``, to the fourth order.

    Parameters
    ----------
    q, v : array_like, shape (nq,) and (nv,)
        Configuration and velocity.

    Returns
    -------
    FunctionDerivatives
        ``L.by("v", "q")`` is `L_vq`, ``L.along(q=dq, v=dv).hessian`` the third order contracted with a direction.
        To the third order where there is a `PythonPotential`.

    Raises
    ------
    ArgumentError
        For wrong shapes or values that are not finite.
    """
    at, speed = single(m, q).copy(), rates(m, v).copy()
    evaluate = turned(m, LagrangianAt(m, _parts_of(m, None, Potential), at, speed), speed)
    arguments = {"q": m.nv, "v": m.nv}
    return FunctionDerivatives.of("L", arguments, evaluate, highest_order=_highest_order(m, None, Potential))


def potential(m: Compiled, q: Row, element: str | None = None) -> FunctionDerivatives:
    """Return the potential energy (J) at a configuration, by ``q``, to the fourth order.

    Parameters
    ----------
    q : array_like, shape (nq,)
        Configuration.
    element : str, optional
        The potential whose energy is meant; that of all together if not given.

    Returns
    -------
    FunctionDerivatives
        To the third order where there is a `PythonPotential`.

    Raises
    ------
    ArgumentError
        For a wrong shape, an unknown element or one that is no potential.
    """
    evaluate = turned(m, PotentialAt(m, _parts_of(m, element, Potential), single(m, q).copy()))
    order = _highest_order(m, element, Potential)
    return FunctionDerivatives.of(_called("V", element), {"q": m.nv}, evaluate, highest_order=order)


def force(m: Compiled, q: Row, v: Row, u: ArrayLike | None = None, element: str | None = None) -> FunctionDerivatives:
    """Return the generalised forces (N or N m) on all variables, by ``q``, ``v`` and ``u``, to the third order.

    Parameters
    ----------
    q, v : array_like, shape (nq,) and (nv,)
        Configuration and velocity.
    u : array_like, shape (n_inputs,), optional
        Inputs; zero if not given.
    element : str, optional
        The force that is meant; all together if not given.

    Returns
    -------
    FunctionDerivatives
        Of nv functions, one for each variable, kinematic ones too; `FunctionDerivatives.weighed` contracts them.
        To the second order where there is a `PythonForce`.

    Raises
    ------
    ArgumentError
        For wrong shapes, an unknown element or one that is no force.
    """
    at, speed = single(m, q).copy(), rates(m, v).copy()
    given = inputs_of(m, u, "u").copy()
    evaluate = turned_forces(m, ForceAt(m, _parts_of(m, element, Force), at, speed, given), speed)
    arguments, order = {"q": m.nv, "v": m.nv, "u": m.n_inputs}, _highest_order(m, element, Force)
    return FunctionDerivatives.of(_called("f", element), arguments, evaluate, rows=m.variables, highest_order=order)


def constraint(m: Compiled, q: Row, element: str | None = None) -> FunctionDerivatives:
    """Return the constraint functions h(q) at a configuration, by ``q``, to the fourth order.

    Parameters
    ----------
    q : array_like, shape (nq,)
        Configuration; the constraints need not hold there.
    element : str, optional
        The constraint that is meant; all of them if not given.

    Returns
    -------
    FunctionDerivatives
        Of as many functions as there are equations; `FunctionDerivatives.weighed` contracts them, with
        multipliers for example. To the third order where there is a `PythonConstraint`.

    Raises
    ------
    ArgumentError
        For a wrong shape, an unknown element or one that is no constraint.
    """
    parts = _parts_of(m, element, Constraint)
    rows = m.constraints[parts.first.constraints : parts.last.constraints]
    evaluate = turned(m, ConstraintsAt(m, parts, single(m, q).copy()))
    order = _highest_order(m, element, Constraint)
    return FunctionDerivatives.of(_called("h", element), {"q": m.nv}, evaluate, rows=rows, highest_order=order)


def places_of_turns(m: Compiled) -> Places:
    """Return where the turns of n quaternions stand among the variables, (n, 3)."""
    firsts = [m.variables.index(rotation.variables[0]) for rotation in m.tree.rotations]
    return np.array(firsts, dtype=np.intp).reshape(-1, 1) + np.arange(3)


def turned(m: Compiled, evaluate: Evaluate, v: Array | None = None, more: int = 0) -> Evaluate:
    """Return a function of the core's coordinates, [q; v; more] or q alone, as one of turns and angular velocities."""
    return evaluate if not m.tree.rotations else _composed(m, evaluate, v, more)


def _composed(m: Compiled, evaluate: Evaluate, v: Array | None, more: int) -> Composed:
    places = places_of_turns(m)
    at = np.zeros(places.shape)
    if v is not None:
        at, places = np.hstack([at, v[places]]), np.hstack([places, m.nv + places])
    by = np.eye(m.nv if v is None else 2 * m.nv + more)
    by[places, places] = 0.0
    return Composed(evaluate, by, turns=Turns(turned_state, places, places, at))


def turned_forces(m: Compiled, evaluate: ForceAt, v: Array) -> Evaluate:
    """Return forces on the core's coordinates as torques about the axes of the bodies."""
    if not m.tree.rotations:
        return evaluate
    composed = _composed(m, evaluate, v, m.n_inputs)
    assert composed.turns is not None
    return PushedBack(composed, composed.turns, pushed_state, places_of_turns(m))


def _parts_of(m: Compiled, element: object, kind: type[Any]) -> Parts:
    """Return the parts of an element of a kind, or of all elements."""
    if element is None:
        return m.parts[None]
    name: object = element
    found = m.elements.get(name) if isinstance(name, str) else None
    known = [name for name, each in m.elements.items() if isinstance(each, kind)]
    if not isinstance(element, str) or not isinstance(found, kind):
        what = f"{kind.__name__.lower()}s"
        given = f"unknown element {element!r}" if found is None else f"{element!r} is a {type(found).__name__}"
        raise ArgumentError(f"element: {given}; {closest(element, known, what=what)}")
    return m.parts[element]


def _highest_order(m: Compiled, element: str | None, kind: type[Any]) -> int:
    """Return to which order the core differentiates an element of a kind, or all of that kind."""
    elements, highest = m.elements, int(kind.highest_order)
    asked = elements.values() if element is None else [elements[element]]
    return min((each.highest_order for each in asked if isinstance(each, kind)), default=highest)


def _called(symbol: str, element: str | None) -> str:
    """Return how messages call a function of the mechanism, or of one element."""
    return symbol if element is None else f"{symbol} of {element!r}"


# Numbers that overflow are seen in what comes out.
_quiet = np.errstate(over="ignore", invalid="ignore")


@dataclass(frozen=True)
class PotentialAt:
    """Potentials by q at a configuration (nq,), of the core's coordinates (nv,): their sum."""

    mechanism: Compiled
    parts: Parts
    q: Array

    @_quiet
    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, parts = self.mechanism.nv, self.parts
        first, last = parts.first.potentials, parts.last.potentials
        each = np.full(last - first, weights[0])
        values, gradients, hessian = self.mechanism.core.potentials(first, last, each, self.q, directions)
        value, gradient, bend = (
            values.sum(keepdims=True),
            gradients.reshape(values.size, n).sum(0),
            hessian.reshape(n, n),
        )
        if parts.uniform_gravity:
            still = np.zeros_like(directions)
            L, slope, second = self.mechanism.core.lagrangian_of_bodies(self.q, np.zeros(n), directions, still)
            value = value - L
            gradient = gradient - slope[0, :n]
            bend = bend - weights[0] * second.reshape(2 * n, 2 * n)[:n, :n]
        return value, gradient[None], bend


@dataclass(frozen=True)
class LagrangianAt:
    """The Lagrangian by [q; v] at a state (nq,), (nv,)."""

    mechanism: Compiled
    parts: Parts
    q: Array
    v: Array

    @_quiet
    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, parts = self.mechanism.nv, self.parts
        dq, dv = (np.ascontiguousarray(half) for half in (directions[:, :n], directions[:, n:]))
        value, gradient, hessian = self.mechanism.core.lagrangian_of_bodies(self.q, self.v, dq, dv)
        second = weights[0] * hessian.reshape(2 * n, 2 * n)
        # Along a direction in which only the velocity changes, the potentials do not.
        V, V_q, V_qq = PotentialAt(self.mechanism, parts.without_gravity(), self.q)(dq, weights)
        gradient[0, :n] -= V_q[0]
        second[:n, :n] -= V_qq
        return value - V, gradient, second


@dataclass(frozen=True)
class ConstraintsAt:
    """Constraint functions by q at a configuration (nq,)."""

    mechanism: Compiled
    parts: Parts
    q: Array

    @_quiet
    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        n, first, last = self.mechanism.nv, self.parts.first.constraints, self.parts.last.constraints
        found = self.mechanism.core.constraint_functions(first, last, weights, self.q, directions)
        values, gradients, hessian = found
        return values, gradients.reshape(values.size, n), hessian.reshape(n, n)


@dataclass(frozen=True)
class ForceAt:
    """Generalised forces (nv,) by [q; v; u] at a state and inputs."""

    mechanism: Compiled
    parts: Parts
    q: Array
    v: Array
    u: Array

    @_quiet
    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        core, at, n = self.mechanism.core, (self.q, self.v, self.u), self.mechanism.nv
        parts = _core.ElementParts(self.parts.first, self.parts.last)
        values, gradients = core.force(*at, parts), np.hstack(core.force_jacobians(*at, parts))
        if not len(directions):
            return values, gradients, core.force_curvature(*at, weights, parts)
        (direction,) = directions
        dq, dv, du = np.split(np.ascontiguousarray(direction), [n, 2 * n])
        bent, third = core.forces_along(weights, *at, dq, dv, du, parts)
        return gradients @ direction, bent, third.reshape(len(direction), -1)
