"""Which constraints keep each other from being met, and what would have to give way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from leastaction.errors import ContradictoryConstraintsError, worst_first
from leastaction.mechanics.configuration.constraint_projection import ConstraintProjection
from leastaction.mechanics.configuration.null_space import free_variables, row_scales
from leastaction.mechanics.mechanism.arguments import single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, Row, as_number, require_instance
from leastaction.numerics.public import public

# Part of the largest that counts as a part in a contradiction.
_PART = 1e-3


@public
@dataclass(frozen=True)
class Contradiction:
    """Constraints that cannot hold together near a configuration.

    Attributes
    ----------
    constraints : tuple of str
        Their names, the largest part in the contradiction first. One alone is out of reach.
    held : tuple of str
        Held variables whose motion would lessen the residual, the most effective first.
    residuals : dict of str to float
        h by constraint name at the point of least residual, the largest first.
    q : ndarray, shape (nq,)
        That point.
    """

    constraints: tuple[str, ...]
    held: tuple[str, ...]
    residuals: dict[str, float]
    q: Array

    def __str__(self) -> str:
        names = " and ".join(repr(name) for name in self.constraints[:6])
        if len(self.constraints) > 6:
            names += f" and {len(self.constraints) - 6} more"
        off = ", ".join(f"{self.residuals[name]:.3g}" for name in self.constraints[:6])
        if len(self.constraints) == 1:
            text = f"{names} is out of reach: it is still off by {off} where it is nearest"
        else:
            text = f"{names} contradict each other: they are off by {off} where they are nearest"
        if self.held:
            text += f", with {', '.join(repr(name) for name in self.held[:4])} held"
        return text


@public
def find_contradiction(
    mechanism: Mechanism, q: Row, *, hold: Sequence[str] = (), move_kinematic: bool = False, tolerance: float = 1e-9
) -> Contradiction | None:
    """Return the constraints that keep each other from being met near a configuration.

    Goes to the nearest point where the constraints are violated least. Where something is left of them, it is
    in the left null space of their Jacobian: the constraints with a part in it pull against each other,
    and no small motion helps any of them without harm to another.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,)
        Where to look.
    hold, move_kinematic
        As in `project_configuration`.
    tolerance : float, optional
        Residual, relative to ``max(1, |Dh_i|, |Dh_i|^2 / 4)``, that counts as none.

    Returns
    -------
    Contradiction or None
        None if the constraints can be met, or if no point of least residual was found.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    as_number(tolerance, "tolerance", above=0.0, below=1.0)
    start = single(mechanism, q)
    free = free_variables(mechanism, hold, move_kinematic)
    if not mechanism.nc:
        return None
    problem = ConstraintProjection(mechanism, start, free, np.ones(len(free)))
    point, parts = problem.least_residual(start)
    largest = float(np.abs(parts).max())
    if largest <= tolerance:
        return None
    order = np.argsort(-np.abs(parts), kind="stable")
    names = tuple(mechanism.constraints[i] for i in order if abs(parts[i]) > _PART * largest)
    jacobian = mechanism.constraint_jacobian(point)
    slope = np.abs((parts / row_scales(jacobian)) @ jacobian)
    slope[free] = 0.0
    held = np.argsort(-slope, kind="stable")
    values = mechanism.constraint_values(point)
    return Contradiction(
        constraints=names,
        held=tuple(mechanism.variables[i] for i in held if slope[i] > _PART * largest * largest),
        residuals=worst_first(dict(zip(mechanism.constraints, values, strict=True))),
        q=point,
    )


def contradictory(what: str, found: Contradiction) -> ContradictoryConstraintsError:
    """Return the error that says what could not be done and which constraints stand in the way."""
    advice = "change or remove one of them" if len(found.constraints) > 1 else "change it"
    if found.held:
        advice += ", hold fewer variables, or let the kinematic ones move (move_kinematic=True)"
    return ContradictoryConstraintsError(
        f"{what}: {found}. {advice[0].upper()}{advice[1:]}; if they can be met "
        "further away, let project_configuration try more starting points (attempts=)",
        residuals=found.residuals,
        constraints=found.constraints,
        held=found.held,
        q=found.q,
    )
