"""Derivatives of functions that give none: by the complex step, exact to rounding, or by differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array

_STEP = 1e-30  # nothing cancels in a complex step, so it may be as small as this


def complex_step(function: Callable[[Any], Any], y: Array) -> Array:
    """Return the derivatives of an analytic function by the entries of y (..., n), along a last axis of their own."""
    columns = []
    for i in range(y.shape[-1]):
        moved = y.astype(complex)
        moved[..., i] += 1j * _STEP
        columns.append(np.asarray(function(moved)).imag / _STEP)
    return np.stack(columns, axis=-1)


def central_differences(function: Callable[[Any], Any], y: Array, *, step: float = 6e-6) -> Array:
    """Return the same of a smooth function, by central differences: good to about the square of the step.

    ``y``: (n,), or (m, n) of m samples, for which the function returns (m, ...). ``step``: relative to entries, or to 1
    where these are less; the cube root of the rounding unit by default.
    """
    columns = []
    for i in range(y.shape[-1]):
        ahead, behind = y.copy(), y.copy()
        h = step * np.maximum(1.0, np.abs(y[..., i]))
        ahead[..., i] += h
        behind[..., i] -= h
        change = np.asarray(function(ahead)) - np.asarray(function(behind))
        way = ahead[..., i] - behind[..., i]
        columns.append(change / np.reshape(way, way.shape + (1,) * (change.ndim - way.ndim)))
    return np.stack(columns, axis=-1)


def fourth_order(function: Callable[[float], Array], step: float) -> Array:
    """Return the derivative of a function of one number at zero, by differences of fourth order."""
    near, far = (np.asarray(function(by) - function(-by)) for by in (step, 2.0 * step))
    return np.asarray((8.0 * near - far) / (12.0 * step))
