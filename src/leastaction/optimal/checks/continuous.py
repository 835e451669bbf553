"""Holds continuous systems and costs to their derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, read_only, require_instance
from leastaction.numerics.differences import central_differences
from leastaction.optimal.checks.differences import Errors
from leastaction.optimal.continuous.cost import ContinuousCost
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.continuous.trajectory import DenseTrajectory
from leastaction.optimal.system import second_derivative

_Note = Callable[[str, Array, Array], None]


def compare_continuous(
    system: ContinuousSystem, curve: DenseTrajectory, cost: ContinuousCost | None, seed: int
) -> Errors:
    """Return by how much the derivatives along a curve differ from differences of one order less."""
    require_instance(curve, "curve", DenseTrajectory, "DenseTrajectory.from_functions or from_samples make one")
    nx, nu = system.nx, system.nu
    if (curve.nx, curve.nu) != (nx, nu):
        raise ArgumentError(f"curve: got {curve.nx} states and {curve.nu} inputs, expected {nx} and {nu}.")
    if cost is not None:
        cost.check(curve.t0, curve.tf, nx, nu)
    rng = np.random.default_rng(seed)
    times = _times(curve)
    x, u = map(read_only, curve.sample(times))
    z = read_only(rng.standard_normal((len(times), nx)))
    errors = Errors()
    note = errors.note
    for i, t in enumerate(times.tolist()):
        errors.compare_numbers(system, x[i], u[i], t, z[i])
        if cost is not None:
            _compare_rate(cost, np.concatenate([x[i], u[i]]), nx, t, note)
    A_all, B_all = system.linearize(x, u, times)
    singles = [system.derivatives(*at) for at in zip(x, u, times.tolist(), strict=True)]
    note("linearize", A_all, np.stack([A for A, _ in singles]))
    note("linearize", B_all, np.stack([B for _, B in singles]))
    if system.has_curvature:
        H_all = system.curvatures(x, u, times, z)
        at_once = zip(x, u, times.tolist(), z, strict=True)
        note("curvatures", H_all, np.stack([second_derivative(system, *one) for one in at_once]))
    if cost is not None:
        _compare_final(cost, x[-1], curve.tf, note)
    return errors


def compare_continuous_cost(cost: ContinuousCost, curve: DenseTrajectory) -> Errors:
    """Return the same of a cost alone."""
    require_instance(curve, "curve", DenseTrajectory, "DenseTrajectory.from_functions or from_samples make one")
    cost.check(curve.t0, curve.tf, curve.nx, curve.nu)
    times, errors = _times(curve), Errors()
    x, u = map(read_only, curve.sample(times))
    for i, t in enumerate(times.tolist()):
        _compare_rate(cost, np.concatenate([x[i], u[i]]), curve.nx, t, errors.note)
    _compare_final(cost, x[-1], curve.tf, errors.note)
    return errors


def _times(curve: DenseTrajectory) -> Array:
    """Return the times at which a curve is looked at."""
    return np.asarray(curve.t0 + (curve.tf - curve.t0) * np.array([0.013, 0.321, 0.777]))


def _compare_rate(cost: ContinuousCost, at: Array, nx: int, t: float, note: _Note) -> None:
    time = np.array([t])

    def gradient(y: Array) -> Array:
        q, r = cost.gradient(y[None, :nx], y[None, nx:], time)
        return np.concatenate([q[0], r[0]])

    value = central_differences(lambda y: np.array([cost.rate(y[:nx], y[nx:], t)]), at)
    note("cost gradient", gradient(at), value[0])
    Q, R, S = cost.hessian(at[None, :nx], at[None, nx:], time)
    cross = np.zeros((nx, at.size - nx)) if S is None else S[0]
    note("cost hessian", np.block([[Q[0], cross], [cross.T, R[0]]]), central_differences(gradient, at))


def _compare_final(cost: ContinuousCost, x: Array, t: float, note: _Note) -> None:
    gradient = cost.final_gradient(x, t)
    value = central_differences(lambda y: np.array([cost.final_value(y, t)]), x)
    note("final gradient", gradient, value[0])
    hessian = central_differences(lambda y: cost.final_gradient(y, t), x)
    note("final hessian", cost.final_hessian(x, t), hessian)
