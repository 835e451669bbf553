"""Directions of negative curvature in continuous time, as `leastaction.optimal.discrete.descent` finds them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.piecewise import PiecewisePolynomial
from leastaction.optimal.continuous.model import TangentModel
from leastaction.optimal.continuous.riccati import ContinuousLinearQuadraticSolution
from leastaction.optimal.continuous.trajectory import DenseTrajectory

_MODELS, _ENOUGH = 40, 6  # most models that are solved, and once there is a direction


class Escape(NamedTuple):
    """A direction of negative curvature whose inputs have size one.

    ``slope``, ``bend``: first and second derivative of the cost along it. ``reach``: how far it goes, relative to the
    sizes of the states. ``feedback``: along which it is followed, once its feedforward is divided by ``size``.
    """

    slope: float
    bend: float
    size: float
    reach: float
    feedback: PiecewisePolynomial


def escape(
    model: TangentModel,
    curvature: Array,
    scale: float,
    sizes: Array,
    *,
    solve: Callable[[TangentModel], ContinuousLinearQuadraticSolution],
    sweep: Callable[[ContinuousLinearQuadraticSolution], DenseTrajectory],
) -> Escape | None:
    """Return a direction of negative curvature, where the whole Newton model has one.

    As in discrete time: between the part of the curvature that leaves the model a minimum and the whole of it the
    model becomes flat along a direction, which models that come close lead to by inverse iteration.

    ``curvature`` (n, nx+nu, nx+nu): of the dynamics, at the points of the model's mesh. ``scale``: its part with which
    there is a minimum. ``sizes`` (nx+nu,): of states and inputs. ``solve``, ``sweep``: return the solution of another
    model, and the minimum (dx, du) of a solution.
    """
    t, weights = model.mesh.t, model.mesh.weights
    _, nx, nu = model.samples.B.shape
    whole = model.with_curvature(curvature).samples
    since = (t - t[0]) / (t[-1] - t[0])
    du = np.cos(np.pi * np.outer(since, np.arange(4))) @ np.random.default_rng(0).normal(size=(4, nu))
    low, high = scale, 1.0
    found: Escape | None = None
    for tried in range(_MODELS):
        if found is not None and tried >= _ENOUGH:
            break
        trial = 0.5 * (low + high)
        solution = solve(model.with_curvature(trial * curvature).driven_by(-du))
        if not solution.definite:
            high = trial
            continue
        low = trial
        tangent = sweep(solution)
        dxu, end = tangent.xu(t), tangent.xu.flat(tangent.tf)[:nx]
        dx, du = dxu[:, :nx], dxu[:, nx:]
        size = float(np.sqrt(weights @ np.sum(du**2, axis=1)))
        dx, du, end = dx / size, du / size, end / size
        second = np.einsum("ni,nij,nj->n", dx, whole.Q, dx) + np.einsum("ni,nij,nj->n", du, whole.R, du)
        second += 2.0 * np.einsum("ni,nij,nj->n", dx, whole.S, du)
        bend = float(weights @ second + end @ model.Q_final @ end)
        if bend < 0.0:
            first = np.sum(model.samples.q * dx, axis=1) + np.sum(model.samples.r * du, axis=1)
            slope = float(weights @ first + model.q_final @ end)
            reach = float((np.abs(dx).max(axis=0) / (1.0 + sizes[:nx])).max())
            found = Escape(slope, bend, size, reach, solution.feedback)
    return found
