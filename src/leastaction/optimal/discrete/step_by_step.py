"""What is computed over whole trajectories, one step after the other; arguments and results as of `DiscreteSystem`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, StepError
from leastaction.numerics.arrays import Array, read_only, shape_of
from leastaction.optimal.discrete.rollout import Rollout
from leastaction.optimal.system import Linearization, System, second_derivative


def rollout(system: System, x0: Array, xbar: Array, ubar: Array, K: Array, start: int, stop: int) -> Rollout:
    """Simulate steps ``start .. stop-1`` under a feedback."""
    x = np.empty((stop - start + 1, system.nx))
    u = np.empty((stop - start, system.nu))
    x[0] = x0
    # What users' functions are given cannot be written to.
    states, inputs = read_only(x), read_only(u)
    for i, k in enumerate(range(start, stop)):
        u[i] = ubar[k] - K[k] @ system.difference(states[i], xbar[k])
        failure = make_step(system, states[i], inputs[i], k, x[i + 1])
        if failure is not None:
            return Rollout(x[: i + 1], u[:i], i, failure)
    return Rollout(x, u, stop - start)


def step_each(system: System, x: Array, u: Array) -> Rollout:
    """Make every step of a curve from its own state."""
    ends = np.empty((len(u), system.nx))
    states, inputs = read_only(x), read_only(u)
    for k in range(len(u)):
        failure = make_step(system, states[k], inputs[k], k, ends[k])
        if failure is not None:
            return Rollout(ends[:k], u[:k], k, failure)
    return Rollout(ends, u, len(u))


def make_step(system: System, x: Array, u: Array, k: int, end: Array) -> str | None:
    """Write the next state to `end`; return why there is none, an outcome and no exception here."""
    try:
        # A diverging trial leaves the range of doubles.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = system.f(x, u, k)
    except (StepError, ArithmeticError) as error:
        return f"step {k}: {error}"
    try:
        if found is None:  # which NumPy would take for no number
            raise TypeError
        end[:] = found
    except (TypeError, ValueError, OverflowError):
        raise ArgumentError(
            f"{type(system).__name__}.f: got {_shown(found)} for step {k}, expected the next state, ({system.nx},)"
        ) from None
    return None if np.isfinite(end).all() else f"step {k}: the state is not finite"


def linearize(
    system: System,
    x: Array,
    u: Array,
    out: Linearization | None = None,
    second: Callable[[Array, Array, Array], Array] | None = None,
) -> Linearization:
    """Return the derivatives of every step.

    ``second``: ``second(x, u, z)`` returns the contracted second order; that of step by step if left out.
    """
    if out is None:
        N, ndx, nu = len(u), system.ndx, system.nu
        A, B = np.empty((N, ndx, ndx)), np.empty((N, ndx, nu))
    else:
        A, B = out
    x, u = read_only(x.copy()), read_only(u.copy())
    for k in range(len(u)):
        found: Any = system.derivatives(x[k], u[k], k)
        try:
            A[k], B[k] = found
        except (TypeError, ValueError, OverflowError):
            got = " and ".join(map(_shown, found)) if isinstance(found, tuple) else _shown(found)
            raise ArgumentError(
                f"{type(system).__name__}.derivatives: got {got} for step {k}, expected a pair (A, B) of shapes "
                f"{A.shape[1:]} and {B.shape[1:]}"
            ) from None
    return Linearization(A, B, partial(second or partial(curvatures, system), x, u))


def curvatures(system: System, x: Array, u: Array, z: Array) -> Array:
    """Return ``z[k] . D2f`` of every step, (N, ndx+nu, ndx+nu); z (N, ndx)."""
    n = system.ndx + system.nu
    H = np.empty((len(u), n, n))
    x, u, z = read_only(x), read_only(u), read_only(z)
    for k in range(len(u)):
        H[k] = second_derivative(system, x[k], u[k], k, z[k])
    return H


def _shown(given: object) -> str:
    """Return the shape of what a user's function returned, for a message; its type where it has none."""
    shape = None if given is None else shape_of(given)
    return type(given).__name__ if shape is None else f"shape {shape}"
