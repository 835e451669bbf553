"""Holds systems and costs to their derivatives: for your own classes, before you optimise with them.

Every check compares order n of a derivative with differences of order n - 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from leastaction.errors import ArgumentError
from leastaction.optimal.checks.continuous import compare_continuous, compare_continuous_cost
from leastaction.optimal.checks.discrete import compare_cost, compare_discrete
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.cost import Cost
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.system import check_system


@dataclass(frozen=True)
class DerivativeReport:
    """Largest differences, each relative to ``1 +`` the size of the derivative compared.

    Attributes
    ----------
    errors : dict[str, float]
        By name: "A", "B", "curvature", "curvature symmetry", "linearize", "curvatures", of a discrete system "rollout";
        and "cost gradient", "cost hessian" (in continuous time "final gradient", "final hessian") if a cost was given.
    tolerance : float
        What was allowed.
    """

    errors: dict[str, float]
    tolerance: float

    @property
    def ok(self) -> bool:
        """Whether every error is within the tolerance."""
        return all(error <= self.tolerance for error in self.errors.values())

    def __str__(self) -> str:
        lines = [
            f"{name:20s} {error:9.2e}{'' if error <= self.tolerance else '  WRONG'}"
            for name, error in self.errors.items()
        ]
        return "\n".join(lines)


def check_derivatives(
    system: DiscreteSystem | ContinuousSystem | Cost | ContinuousCost,
    x: Any,
    u: Any = None,
    *,
    cost: Any = None,
    tolerance: float = 1e-6,
    seed: int = 0,
) -> DerivativeReport:
    """Compare the derivatives of a system, of a cost, or of both, with central differences.

    Parameters
    ----------
    system : DiscreteSystem, ContinuousSystem, Cost or ContinuousCost
        What is checked.
    x, u : array_like (N+1, nx), (N, nu); or a DenseTrajectory alone
        Curve along which to check, at a few of its steps or times. It need not be a trajectory of the system.
    cost : Cost or ContinuousCost, optional
        Cost to check along the same curve as a system.
    tolerance : float
        Relative error that is allowed; central differences are good to about 1e-8.
    seed : int
        Of the random directions and weights.

    Returns
    -------
    DerivativeReport
        `ok`, and by name the errors; print it.

    Raises
    ------
    ArgumentError
        Shapes that do not fit the system or the cost.
    """
    if isinstance(system, Cost | ContinuousCost):
        if cost is not None:
            raise ArgumentError("cost: got a second one, expected None: the first argument is a cost already")
        if isinstance(system, Cost):
            return DerivativeReport(dict(compare_cost(system, x, u, seed)), tolerance)
        return DerivativeReport(dict(compare_continuous_cost(system, x)), tolerance)
    check_system(system, (DiscreteSystem, ContinuousSystem), ("nx", "nu"))
    if isinstance(system, DiscreteSystem):
        check_system(system, (DiscreteSystem,), ("N",))
        errors = compare_discrete(system, x, u, cost, seed)
    else:
        if u is not None:
            raise ArgumentError(
                "u: got an array besides the curve, expected None: a DenseTrajectory holds states and inputs"
            )
        errors = compare_continuous(system, x, cost, seed)
    return DerivativeReport(dict(errors), tolerance)
