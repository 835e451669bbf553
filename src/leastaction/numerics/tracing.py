"""Derivatives of functions that are written with JAX's NumPy, which need the extra ``jax``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.numerics.extras import extra


class TracedFunction:
    """A function ``f(y, *others)`` and its derivatives by y, compiled, in double precision.

    It goes to other processes as the function does, and is compiled there anew.

    ``function``: of JAX's arrays. ``rows``: whether all arguments are rows of arguments, one call for each of them.
    """

    def __init__(self, function: Callable[..., Any], *, rows: bool = False) -> None:
        self._jax = jax = extra("jax", of="jax", why='derivatives="jax"')
        self.function, self.rows = function, rows

        def value(*arguments: Any) -> Any:
            return jax.numpy.asarray(function(*arguments), dtype=float)

        ways = (value, jax.jacfwd(value), jax.jacfwd(jax.jacrev(value)))
        self._compiled = [jax.jit(jax.vmap(way) if rows else way) for way in ways]

    def __reduce__(self) -> tuple[Any, ...]:
        return _made_again, (self.function, self.rows)

    def derivative(self, order: int, *arguments: Any) -> Array:
        """Return the value (order 0), the first or the second derivatives, along last axes of their own."""
        where = self._jax if hasattr(self._jax, "enable_x64") else extra("jax.experimental", of="jax", why="this JAX")
        with where.enable_x64(True):
            return np.asarray(self._compiled[order](*arguments), dtype=np.float64)


def _made_again(function: Callable[..., Any], rows: bool) -> TracedFunction:
    return TracedFunction(function, rows=rows)
