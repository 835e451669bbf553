"""`FunctionDerivatives`: a function of a mechanism at a point, and all the derivatives that it may be asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations_with_replacement, pairwise, permutations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import Array, as_array, as_count
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.memory import MAX_BYTES, check_memory
from leastaction.numerics.public import public

Evaluate = Callable[[Array, Array], tuple[Array, Array, Array]]
"""From directions (k, n) and weights (m,): values (m,), gradients (m, n) and the Hessian (n, n) of the weighted sum, or
the derivatives of these along the directions."""


@public
@dataclass(frozen=True)
class FunctionDerivatives(Frozen):
    """A function at a point with its gradient and Hessian, and by contraction the orders above; all of them exact.

    `along` differentiates value, gradient and Hessian along a direction: the Hessian of ``f.along(q=dq)`` is the third
    derivative contracted with ``dq``, that of ``f.along(q=dq).along(q=other)`` the fourth contracted with both. There
    may be several functions at once, m of them; then everything has them as its first axis, and `weighed` contracts
    it. Frozen, arrays included: threads may share it.

    Attributes
    ----------
    name : str
        What the function is called, in messages.
    arguments : mapping of str to (int, int)
        Where each argument begins and ends among the n entries that is differentiated by, in their order.
    rows : tuple of str or None
        Names of the m functions; None for a single one.
    highest_order : int
        The order up to which the core differentiates it.
    directions : ndarray, shape (k, n)
        Along which it has been differentiated.
    values : ndarray, shape (m,)
    gradients : ndarray, shape (m, n)
    """

    name: str
    arguments: Mapping[str, tuple[int, int]]
    rows: tuple[str, ...] | None
    highest_order: int
    evaluate: Evaluate = field(repr=False)
    directions: Array = field(repr=False)
    values: Array = field(init=False, repr=False)
    gradients: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        values, gradients, _ = self.evaluate(self.directions, np.ones(1 if self.rows is None else len(self.rows)))
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "gradients", gradients)
        super().__post_init__()

    @classmethod
    def of(
        cls,
        name: str,
        arguments: Mapping[str, int],
        evaluate: Evaluate,
        *,
        rows: Sequence[str] | None = None,
        highest_order: int = 4,
    ) -> FunctionDerivatives:
        """Evaluate a function; `arguments` are their lengths by name."""
        ends = np.cumsum([0, *arguments.values()]).tolist()
        places = dict(zip(arguments, pairwise(ends), strict=True))
        named = None if rows is None else tuple(rows)
        return cls(name, places, named, highest_order, evaluate, np.zeros((0, ends[-1])))

    # What it is

    @property
    def size(self) -> int:
        """Number n of entries that is differentiated by."""
        return int(self.directions.shape[1])

    @property
    def value(self) -> float | Array:
        """The value, a float; of several functions (m,)."""
        return float(self.values[0]) if self.rows is None else self.values

    @property
    def gradient(self) -> Array:
        """The first derivatives, shape (n,); of several functions (m, n)."""
        return self.gradients[0] if self.rows is None else self.gradients

    @cached_property
    def hessian(self) -> Array:
        """The second derivatives, shape (n, n), symmetric; of several functions (m, n, n), not above 1 GiB."""
        return self._hessian(MAX_BYTES)

    def _hessian(self, max_bytes: float) -> Array:
        n, m = self.size, len(self.values)
        if self.rows is None:
            found = self.evaluate(self.directions, np.ones(1))[2]
        else:
            check_memory((m, n, n), max_bytes, self.name, "contract it by weighed(weights).hessian")
            found = np.empty((m, n, n))
            for row, weights in zip(found, np.eye(m), strict=True):
                row[:] = self.evaluate(self.directions, weights)[2]
        found.setflags(write=False)
        return found

    def by(self, *names: str) -> Array:
        """Return the derivatives by one argument, or by two: a block of the gradient or of the Hessian.

        Parameters
        ----------
        *names : str
            Of `arguments`, one or two: ``L.by("v", "q")`` is ``d2L / dv_i dq_j``.

        Raises
        ------
        ArgumentError
            For an unknown name, or another number of them.
        """
        places = [self._place(name) for name in names]
        if len(places) not in (1, 2):
            raise ArgumentError(f"{self.name}: by: got {len(names)} arguments, expected one or two; see `tensor`")
        whole = self.gradient if len(places) == 1 else self.hessian
        block: Array = whole[..., places[0]] if len(places) == 1 else whole[..., places[0], places[1]]
        return block

    # Higher orders

    def along(self, **directions: ArrayLike) -> FunctionDerivatives:
        """Return the derivative along a direction, with its own gradient and Hessian.

        Parameters
        ----------
        **directions : array_like
            The direction by argument, ``f.along(q=dq, v=dv)``; zero for what is not given.

        Raises
        ------
        ArgumentError
            For an unknown argument or a wrong shape, or where the Hessian would be above `highest_order`.
        """
        direction = np.zeros(self.size)
        for name, value in directions.items():
            place = self._place(name)
            direction[place] = as_array(value, f"{self.name}: along: {name}", (place.stop - place.start,))
        self._check_order(3 + len(self.directions))
        return replace(self, directions=np.concatenate([self.directions, direction[None]]))

    def weighed(self, weights: ArrayLike) -> FunctionDerivatives:
        """Return the sum of several functions with weights (m,), as a single one.

        Raises
        ------
        ArgumentError
            For a wrong shape, or a single function.
        """
        if self.rows is None:
            raise ArgumentError(f"{self.name}: weighed: it is a single function; multiply its derivatives")
        given = as_array(weights, f"{self.name}: weights", (len(self.rows),), names=self.rows)
        return replace(self, rows=None, evaluate=Weighed(self.evaluate, given))

    def tensor(self, order: int, *, max_bytes: float = MAX_BYTES) -> Array:
        """Return all derivatives of an order, uncontracted (for analysis: `along` is what algorithms need).

        Parameters
        ----------
        order : int
            0 to the highest order that there is.
        max_bytes : float, optional
            What the result may take: ``8 m n^order`` bytes.

        Returns
        -------
        ndarray, shape (n, ..., n); of several functions (m, n, ..., n)
            Symmetric in all but the functions.

        Raises
        ------
        ArgumentError
            For an order that there is not, or, before anything is made, for a result that takes more.
        """
        wanted = as_count(order, f"{self.name}: tensor: order", 0)
        self._check_order(wanted + len(self.directions))
        n, lead = self.size, () if self.rows is None else (len(self.rows),)
        check_memory((*lead, *[n] * wanted), max_bytes, self.name, "contract it by along(...)")
        if wanted < 2:
            return np.array(self.gradient if wanted else self.value)
        if wanted == 2:
            return np.array(self._hessian(max_bytes))
        out = np.empty((*lead, *[n] * wanted))
        units = np.eye(n)
        for indices in combinations_with_replacement(range(n), wanted - 2):
            directions = np.concatenate([self.directions, units[list(indices)]])
            evaluate = (self.evaluate(directions, weights)[2] for weights in np.eye(len(self.values)))
            block = np.stack(list(evaluate)).reshape(*lead, n, n)
            for place in set(permutations(indices)):
                at: Any = (*[slice(None)] * len(lead), *place)
                out[at] = block
        return out

    def _place(self, name: str) -> slice:
        if name not in self.arguments:
            raise unknown("argument", name, self.arguments, self.name)
        return slice(*self.arguments[name])

    def _check_order(self, order: int) -> None:
        if order > self.highest_order:
            raise ArgumentError(
                f"{self.name}: the derivatives asked for are of order {order}, and the core knows those up to order "
                f"{self.highest_order}"
            )


# What evaluates: records, so that a result can be sent to another process.


@dataclass(frozen=True)
class Weighed:
    """The sum of functions with weights."""

    inner: Evaluate
    weights: Array

    def __call__(self, directions: Array, weights: Array) -> tuple[Array, Array, Array]:
        """Evaluate; see `Evaluate`."""
        values, gradients, hessian = self.inner(directions, weights[0] * self.weights)
        return (self.weights @ values)[None], (self.weights @ gradients)[None], hessian
