"""Gains of the projection that a user gives in continuous time: as they are, or by weights."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.continuous.cost import ContinuousQuadraticCost
from leastaction.optimal.continuous.system import ContinuousSystem


def feedback_of(K: PiecewisePolynomial) -> PiecewisePolynomial:
    """Return gains (nu, nx) as the feedback ``[K (row by row); C]`` with no feedforward."""
    nu, nx = K.shape
    feedforward = np.zeros((*K.coefficients.shape[:2], nu))
    return PiecewisePolynomial(K.breaks, np.concatenate([K.coefficients, feedforward], axis=2), (nu * (nx + 1),))


def checked_gains(given: Any, system: ContinuousSystem) -> PiecewisePolynomial | None:
    """Return gains that were given, or None where weights were.

    Raises `ArgumentError`: gains of another shape, or that are no functions of time.
    """
    if isinstance(given, Mapping):
        return None
    if not isinstance(given, PiecewisePolynomial):
        raise ArgumentError(
            f"projection: got an array of shape {given.shape} for {type(system).__name__}, expected gains as a "
            "PiecewisePolynomial in continuous time, such as `regulate_continuous` returns, or weights"
        )
    if given.shape != (system.nu, system.nx):
        raise ArgumentError(
            f"projection: got gains of shape {given.shape}, expected {(system.nu, system.nx)}, (nu, nx)"
        )
    return given


def weights_as_cost(
    given: Mapping[str, Any], system: ContinuousSystem, t0: float, tf: float
) -> ContinuousQuadraticCost:
    """Return the cost of the regulator with these weights; identities where they are left out.

    Raises `ArgumentError`: weights of wrong shapes.
    """
    nx, nu = system.nx, system.nu
    weights = {"Q": np.ones(nx), "R": np.ones(nu), "Q_final": np.ones(nx), **given}
    try:
        cost = ContinuousQuadraticCost(np.zeros(nx), np.zeros(nu), **weights)
        cost.check(t0, tf, nx, nu)
    except ArgumentError as error:
        raise ArgumentError(f"projection: {error}") from None
    return cost
