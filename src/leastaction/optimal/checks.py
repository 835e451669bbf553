"""Holds systems and costs to their derivatives: for your own classes, before you optimise with them.

Every check compares order n of a derivative with differences of order n - 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.optimal.costs import Cost
from leastaction.optimal.differences import central_differences, relative_error
from leastaction.optimal.protocol import DiscreteSystem

__all__ = ["DerivativeReport", "check_derivatives"]


@dataclass(frozen=True)
class DerivativeReport:
    """Largest differences, each relative to ``1 +`` the size of the derivative compared.

    Attributes
    ----------
    errors : dict[str, float]
        By name: "A", "B", "curvature", "curvature symmetry", "rollout", "linearize", "curvatures";
        and "cost gradient", "cost hessian" if a cost was given.
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
    system: DiscreteSystem,
    x: ArrayLike,
    u: ArrayLike,
    *,
    cost: Cost | None = None,
    tolerance: float = 1e-6,
    seed: int = 0,
) -> DerivativeReport:
    """Compare the derivatives of a system, and of a cost, with central differences.

    Parameters
    ----------
    system : DiscreteSystem
    x, u : array_like (N+1, nx), (N, nu)
        Curve along which to check; a few of its steps are taken.
    cost : Cost, optional
        Cost to check along the same curve.
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
        Shapes that do not fit the system.
    """
    N, nx, nu = system.N, system.nx, system.nu
    x = as_array(x, "x", (N + 1, nx), meaning="(N+1, nx)")
    u = as_array(u, "u", (N, nu), meaning="(N, nu)")
    rng = np.random.default_rng(seed)
    errors = dict.fromkeys(("A", "B"), 0.0)
    for k in sorted({0, N // 3, N - 1}):
        A, B = system.derivatives(x[k], u[k], k)
        A_differences = central_differences(lambda y, k=k: system.f(y, u[k], k), x[k])
        B_differences = central_differences(lambda y, k=k: system.f(x[k], y, k), u[k])
        errors["A"] = max(errors["A"], relative_error(A, A_differences))
        errors["B"] = max(errors["B"], relative_error(B, B_differences))
        if system.has_curvature:
            _check_curvature(system, x[k], u[k], k, rng.standard_normal(nx), errors)
    _check_whole(system, x, u, rng, errors)
    if cost is not None:
        _check_cost(cost, x, u, rng, errors)
    return DerivativeReport(errors, tolerance)


def _check_curvature(
    system: DiscreteSystem, x: Array, u: Array, k: int, z: Array, errors: dict[str, float]
) -> None:
    H = system.curvature(x, u, k, z)

    def gradient(y: Array) -> Array:
        return z @ np.hstack(system.derivatives(y[: x.size], y[x.size :], k))

    differences = central_differences(gradient, np.concatenate([x, u]))
    for name, error in (
        ("curvature", relative_error(H, differences)),
        ("curvature symmetry", relative_error(H, H.T)),
    ):
        errors[name] = max(errors.get(name, 0.0), error)


def _check_whole(
    system: DiscreteSystem,
    x: Array,
    u: Array,
    rng: np.random.Generator,
    errors: dict[str, float],
) -> None:
    """The methods over whole trajectories against the loops over single steps."""
    N, nx, nu = system.N, system.nx, system.nu
    K = 0.1 * rng.standard_normal((N, nu, nx))
    stop = min(N, 10)
    ours = DiscreteSystem.rollout(system, x[0], x, u, K, 0, stop)
    theirs = system.rollout(x[0], x, u, K, 0, stop)
    if ours.steps_done != theirs.steps_done:
        raise ArgumentError(
            f"system.rollout: made {theirs.steps_done} steps where f makes {ours.steps_done}."
        )
    errors["rollout"] = relative_error(theirs.x, ours.x)
    A, B = system.linearize(x, u)
    steps = sorted({0, N // 2, N - 1})
    singles = [system.derivatives(x[k], u[k], k) for k in steps]
    errors["linearize"] = max(
        relative_error(A[steps], np.stack([A_k for A_k, _ in singles])),
        relative_error(B[steps], np.stack([B_k for _, B_k in singles])),
    )
    if system.has_curvature:
        z = rng.standard_normal((N + 1, nx))
        H = system.curvatures(x, u, z)
        single = np.stack([system.curvature(x[k], u[k], k, z[k + 1]) for k in steps])
        errors["curvatures"] = relative_error(H[steps], single)


def _check_cost(
    cost: Cost, x: Array, u: Array, rng: np.random.Generator, errors: dict[str, float]
) -> None:
    """Along a random direction over the whole curve."""
    dx, du = rng.standard_normal(x.shape), rng.standard_normal(u.shape)

    def value(s: Array) -> Array:
        return np.array([cost.value(x + s * dx, u + s * du)])

    def slope(s: Array) -> Array:
        q, r, q_final = cost.gradient(x + s * dx, u + s * du)
        return np.array([np.sum(q * dx[:-1]) + np.sum(r * du) + q_final @ dx[-1]])

    def form(weight: Array, left: Array, right: Array) -> float:
        if weight.ndim == 1 or weight.shape[-1] == 1 != right.shape[-1]:
            return float(np.sum(left * weight.reshape(-1, left.shape[-1]) * right))
        return float(np.sum(left * np.einsum("...ij,...j->...i", weight, right)))

    Q, R, S, Q_final = cost.hessian(x, u)
    curvature = form(Q, dx[:-1], dx[:-1]) + form(R, du, du) + form(Q_final, dx[-1], dx[-1])
    if S is not None:
        curvature += 2.0 * form(S, dx[:-1], du)
    zero = np.zeros(1)
    errors["cost gradient"] = relative_error(slope(zero), central_differences(value, zero)[:, 0])
    errors["cost hessian"] = relative_error(
        np.array([curvature]), central_differences(slope, zero)[:, 0]
    )
