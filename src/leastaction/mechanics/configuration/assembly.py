"""Consistent starts: the configuration and the velocity nearest to a wanted one that the constraints allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, InconsistentStartError, some, worst_first
from leastaction.mechanics.configuration.constraint_projection import ConstraintProjection
from leastaction.mechanics.configuration.contradiction import contradictory, find_contradiction
from leastaction.mechanics.configuration.null_space import Indices, free_variables, restoring, row_scales
from leastaction.mechanics.mechanism.arguments import rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import difference
from leastaction.numerics.arrays import Array, Row, as_array, as_count, as_number, require_instance
from leastaction.numerics.public import public

CONFIGURATION_TOLERANCE = 1e-8  # distance from a constraint, in units of q
VELOCITY_TOLERANCE = 1e-6  # part of the rate of a constraint, relative to its terms (at least 1)


@public
@dataclass(frozen=True)
class ConfigurationProjection:
    """A configuration on the constraints, and how far it is from the one that was asked for.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration.
    correction : dict of str to float
        Change by variable name (m or rad), the largest first; only the variables that were free. Of a rotation that is
        a quaternion the vector of the rotation between both, in its own axes.
    largest : float
        Largest magnitude among the changes.
    iterations : int
        Steps that were made.
    residuals : dict of str to float
        h(q) by constraint name (m^2 for a `Distance`).
    """

    q: Array
    correction: dict[str, float]
    largest: float
    iterations: int
    residuals: dict[str, float]

    def __str__(self) -> str:
        """Say how far it is from what was asked for, and how well the constraints hold."""
        return f"{_moved(self.correction)} in {self.iterations} steps; {_left(self.residuals)}"


@public
@dataclass(frozen=True)
class VelocityProjection:
    """A velocity that keeps the constraints, and how far it is from the one that was asked for.

    Attributes
    ----------
    v : ndarray, shape (nv,)
        The velocity.
    correction : dict of str to float
        Change by variable name (m/s or rad/s), the largest first; only the variables that were free.
    largest : float
        Largest magnitude among the changes.
    residuals : dict of str to float
        Rates of the constraints, Dh(q) v, by name.
    """

    v: Array
    correction: dict[str, float]
    largest: float
    residuals: dict[str, float]

    def __str__(self) -> str:
        """Say how far it is from what was asked for, and how well the constraints hold."""
        return f"{_moved(self.correction)}; {_left(self.residuals)}"


def _moved(correction: Mapping[str, float]) -> str:
    changes = [
        f"{name!r} {change:+.4g}" for name, change in correction.items() if abs(change) > CONFIGURATION_TOLERANCE
    ]
    return "changed " + some(changes, 6) if changes else "nothing had to change"


def _left(residuals: Mapping[str, float]) -> str:
    if not residuals:
        return "there are no constraints"
    worst = max(residuals, key=lambda name: abs(residuals[name]))
    return f"the largest residual is that of {worst!r}, {residuals[worst]:.2g}"


@public
def check_consistent(mechanism: Mechanism, q: Row, *, tolerance: float = CONFIGURATION_TOLERANCE) -> None:
    """Raise unless a configuration satisfies the constraints.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,)
        The configuration.
    tolerance : float, optional
        Largest ``|h_i| / max(1, |Dh_i|, |Dh_i|^2 / 4)``: about the distance from the constraint in units of q.

    Raises
    ------
    InconsistentStartError
        With the residual by constraint name. A `ContradictoryConstraintsError` if no motion of the dynamic
        variables brings it onto them.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    as_number(tolerance, "tolerance", above=0.0, below=1.0)
    values = mechanism.constraint_values(single(mechanism, q))
    limits = tolerance * row_scales(mechanism.constraint_jacobian(q))
    if not np.all(np.abs(values) <= limits):
        residuals = dict(zip(mechanism.constraints, values, strict=True))
        contradiction = find_contradiction(mechanism, q) if np.isfinite(values).all() else None
        if contradiction is not None:
            raise contradictory("the configuration cannot satisfy the constraints", contradiction)
        raise InconsistentStartError(
            f"the configuration does not satisfy the constraints: {_worst(residuals, limits)}. "
            "Use project_configuration to bring it onto them",
            residuals=residuals,
        )


def check_lengths(mechanism: Mechanism, q: Array, t: Array | None = None) -> None:
    """Raise an `ArgumentError` for a prescribed length that is not positive, in q (nq,), or in (N, nq) at times t (N,).

    A string of no length has no direction to pull in.
    """
    rows = q if q.ndim == 2 else q[None, :]
    for name, element in mechanism.elements.items():
        variable = element.length_variable
        if variable is None:
            continue
        lengths = rows[:, mechanism.coordinates.index(variable)]
        if np.any(lengths <= 0.0):
            k = int(np.argmax(lengths <= 0.0))
            when = "" if t is None else f" at t = {t[k]:.6g} s"
            raise ArgumentError(
                f"{name}: its length {variable!r} is {lengths[k]:.6g} m{when}, expected a positive one, as a string of "
                f"zero length has no direction to pull in. Set {variable!r} in the configuration"
            )


def check_velocity(mechanism: Mechanism, q: Array, v: Array, *, instead: str = "") -> None:
    """Raise an `InconsistentStartError` unless a velocity keeps the constraints; ``instead``: what else may be done."""
    if mechanism.nc == 0:
        return
    rate = mechanism.constraint_rates(q, v)
    size = np.abs(mechanism.constraint_jacobian(q)) @ np.abs(v)
    if not np.all(np.abs(rate) <= VELOCITY_TOLERANCE * np.maximum(1.0, size)):
        residuals = worst_first(dict(zip(mechanism.constraints, rate, strict=True)))
        name, value = next(iter(residuals.items()))
        raise InconsistentStartError(
            f"the velocity does not keep the constraints: the rate of {name!r} is {value:.3g}. Use "
            f"project_velocity to bring it onto them{instead}",
            residuals=residuals,
        )


@public
def project_configuration(
    mechanism: Mechanism,
    q: Row,
    *,
    hold: Sequence[str] = (),
    move_kinematic: bool = False,
    weights: Mapping[str, float] | ArrayLike | None = None,
    tolerance: float = 1e-12,
    max_iterations: int = 200,
    attempts: int = 1,
) -> ConfigurationProjection:
    """Return the configuration on the constraints that is nearest to a given one.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,)
        The wanted configuration.
    hold : sequence of str, optional
        Variables that must not move; a joint whose rotation is a quaternion by its name.
    move_kinematic : bool, optional
        Let the kinematic variables move too; they are held by default.
    weights : mapping of str to float, or array_like of shape (nv,), optional
        Weight of the change of each variable, positive; 1 for those that are not named.
    tolerance : float, optional
        Largest ``|h_i| / max(1, |Dh_i|, |Dh_i|^2 / 4)`` of the result. The constraints are met to
        rounding where that is possible; the nearest point is found to about 1e-8.
    max_iterations : int, optional
        Bound on the steps from one starting point.
    attempts : int, optional
        Starting points that are tried until one leads to the constraints: first the given one, then points
        beside it (always the same ones). The change is measured from the given one in any case.

    Returns
    -------
    ConfigurationProjection
        Its `q` is the configuration.

    Raises
    ------
    ArgumentError
        For a wrong shape, a value that is not finite, an unknown name, a weight that is not positive, or prescribed
        lengths of zero or less that lead nowhere.
    ContradictoryConstraintsError
        If constraints contradict each other or are out of reach: names them, and the held variables that
        stand in the way.
    InconsistentStartError
        If no such configuration is found for another reason. Both carry the residuals by constraint name.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    start = single(mechanism, q)
    free = free_variables(mechanism, hold, move_kinematic)
    as_count(attempts, "attempts", 1)
    as_count(max_iterations, "max_iterations", 0)
    as_number(tolerance, "tolerance", above=0.0, below=1.0)
    root = np.sqrt(_weights(mechanism, weights)[free])
    problem = ConstraintProjection(mechanism, start, free, root)
    q_near, iterations = problem.solve(tolerance, max_iterations, attempts)
    values = mechanism.constraint_values(q_near)
    residuals = dict(zip(mechanism.constraints, (float(h) for h in values), strict=True))
    limits = tolerance * row_scales(mechanism.constraint_jacobian(q_near))
    if not np.all(np.isfinite(values) & (np.abs(values) <= limits)):
        check_lengths(mechanism, q_near)
        contradiction = None
        if np.all(np.isfinite(values)):
            contradiction = find_contradiction(mechanism, q_near, hold=hold, move_kinematic=move_kinematic)
        if contradiction is not None:
            raise contradictory("no configuration on the constraints was found", contradiction)
        raise InconsistentStartError(
            f"no configuration on the constraints was found in {iterations} steps: "
            f"{_worst(residuals, limits)}. Start nearer, allow more steps (max_iterations=), or let other "
            "starting points be tried (attempts=)",
            residuals=residuals,
        )
    correction, largest = _correction(mechanism, free, difference(mechanism, q_near, start))
    return ConfigurationProjection(q_near, correction, largest, iterations, residuals)


@public
def project_velocity(
    mechanism: Mechanism,
    q: Row,
    v: Row,
    *,
    hold: Sequence[str] = (),
    move_kinematic: bool = False,
    weights: Mapping[str, float] | ArrayLike | None = None,
    tolerance: float = 1e-10,
) -> VelocityProjection:
    """Return the velocity nearest to a given one that keeps the constraints: ``Dh(q) v = 0``.

    Where constraints change with the time, ``Dh v + dh/dt = 0``, of `Mechanism.at_time`.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,)
        A configuration on the constraints.
    v : array_like, shape (nv,)
        The wanted velocity.
    hold, move_kinematic, weights
        As in `project_configuration`, for the velocities.
    tolerance : float, optional
        Largest residual that may be left, relative to ``|Dh_i| |v|`` (at least 1).

    Raises
    ------
    ArgumentError
        As in `project_configuration`.
    InconsistentStartError
        If the held velocities cannot be followed; carries Dh v by constraint name.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    as_number(tolerance, "tolerance", above=0.0, below=1.0)
    given = rates(mechanism, v)
    jacobian = mechanism.constraint_jacobian(q)
    free = free_variables(mechanism, hold, move_kinematic)
    root = np.sqrt(_weights(mechanism, weights)[free])
    result = given.copy()
    # A gradient that is not finite leaves a rate that is not, which is refused below.
    if mechanism.nc and len(free) and np.isfinite(jacobian).all():
        # Twice: the second pass removes the rounding that the first leaves.
        for _ in range(2):
            rate = mechanism.constraint_rates(q, result)
            if not np.isfinite(rate).all():
                break
            result[free] += restoring(jacobian[:, free] / root, rate) / root
    with np.errstate(over="ignore", invalid="ignore"):
        rate = mechanism.constraint_rates(q, result)
        limits = tolerance * row_scales(jacobian) * max(1.0, float(np.linalg.norm(result)))
    residuals = dict(zip(mechanism.constraints, (float(r) for r in rate), strict=True))
    if not np.all(np.abs(rate) <= limits):
        raise InconsistentStartError(
            f"no velocity of the free variables keeps the constraints: {_worst(residuals, limits)}. "
            "Hold fewer variables, or change the velocities of the held ones",
            residuals=residuals,
        )
    correction, largest = _correction(mechanism, free, result - given)
    return VelocityProjection(result, correction, largest, residuals)


def _correction(mechanism: Mechanism, free: Indices, change: Array) -> tuple[dict[str, float], float]:
    named = {mechanism.variables[i]: float(change[i]) for i in free}
    ordered = dict(sorted(named.items(), key=lambda item: -abs(item[1])))
    return ordered, max((abs(value) for value in named.values()), default=0.0)


def _worst(residuals: Mapping[str, float], limits: Array) -> str:
    over = [
        (name, value)
        for (name, value), limit in zip(residuals.items(), limits, strict=True)
        if not (np.isfinite(value) and abs(value) <= limit)
    ]
    over.sort(key=lambda item: -abs(item[1]))
    return some([f"{name!r} is off by {value:.3g}" for name, value in over], 6)


def _weights(mechanism: Mechanism, weights: Mapping[str, float] | ArrayLike | None) -> Array:
    if weights is None:
        return np.ones(mechanism.nv)
    if isinstance(weights, Mapping):
        values = mechanism.velocity(weights, default=1.0)
    else:
        values = as_array(weights, "weights", (mechanism.nv,), names=mechanism.variables)
    for name, value in zip(mechanism.variables, values, strict=True):
        if value <= 0.0:
            raise ArgumentError(
                f"weights: {name!r} has the weight {value}; expected a positive one (name it in hold= "
                "to keep it where it is)"
            )
    return values
