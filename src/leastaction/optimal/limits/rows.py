"""Limits as the optimiser takes them: rows ``c >= 0`` at some instants, with their derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.quantity import Entries, Instants, Quantity, Samples

__all__ = ["Rows", "Weights"]


class Weights:
    """What rows add to the second derivative of a cost; matrices only where some row is no single entry."""

    def __init__(self, N: int, nx: int, nu: int) -> None:
        self.state, self.input = np.zeros((N + 1, nx)), np.zeros((N, nu))
        self.matrix: Array | None = None
        self.final = np.zeros((nx, nx))

    def full(self) -> Array:
        """Return the matrices of the steps (N, nx+nu, nx+nu), to be added to."""
        if self.matrix is None:
            n = self.state.shape[1] + self.input.shape[1]
            self.matrix = np.zeros((len(self.input), n, n))
        return self.matrix


@dataclass(frozen=True, eq=False)
class Rows:
    """``sign (quantity - bounds) >= 0`` at the instants k.

    Attributes
    ----------
    limit : str
        What they came from.
    quantity : Quantity
        Of m functions.
    sign : float
        1 for least values, -1 for largest ones.
    bounds : ndarray (n, m)
    k : ndarray of int (n,)
        Instants of a quantity of the state, steps of any other.
    scale : ndarray (m,)
        What is large, in the quantity's unit; 0 where that is to be seen from where the optimisation starts.
    equal : bool
        Whether these are one side of equations, whose other side follows.
    """

    limit: str
    quantity: Quantity
    sign: float
    bounds: Array
    k: Instants
    scale: Array
    equal: bool = False

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column says."""
        if self.quantity.says_all and not self.bounds.any():
            return self.quantity.names
        relation = "=" if self.equal else ">=" if self.sign > 0.0 else "<="
        least, most = self.bounds.min(axis=0), self.bounds.max(axis=0)
        unit = f" {self.quantity.unit}" if self.quantity.unit else ""
        kind = f"{self.quantity.kind} " if self.quantity.kind else ""
        return tuple(
            f"{kind}{name} {relation} {a:.6g}{unit}" if a == b else f"{kind}{name} {relation} {a:.4g} .. {b:.4g}{unit}"
            for name, a, b in zip(self.quantity.names, least, most, strict=True)
        )

    def values(self, x: Array, u: Array) -> Array:
        """Return c (n, m) along a trajectory."""
        return np.asarray(self.sign * (self.quantity.values(self._at(x, u)) - self.bounds))

    def check(self, x: Array, u: Array) -> None:
        """Ask a quantity for its derivatives, so that what is wrong with them is said before the first step.

        Raises
        ------
        ArgumentError
            From the quantity.
        """
        k, x, u, x_next = self._at(x, u)
        at = Samples(k[:1], x[:1], u[:1], x_next[:1])
        self.quantity.jacobian(at)
        self.quantity.curvature(at, np.ones((1, len(self.quantity.names))))

    def add_gradient(self, x: Array, u: Array, y: Array, q: Array, r: Array) -> None:
        """Subtract ``y . dc`` from the gradients q (N+1, nx), r (N, nu)."""
        quantity, nx = self.quantity, x.shape[1]
        if isinstance(quantity, Entries):
            target = q if quantity.of_state else r
            target[np.ix_(self.k, quantity.columns)] -= self.sign * quantity.factors * y
            return
        pull = np.einsum("kmi,km->ki", quantity.jacobian(self._at(x, u)), self.sign * y)
        q[self.k] -= pull[:, :nx]
        if not quantity.of_state:
            r[self.k] -= pull[:, nx : nx + r.shape[1]]
        if quantity.looks_ahead:
            q[self.k + 1] -= pull[:, nx + r.shape[1] :]

    def add_hessian(self, x: Array, u: Array, y: Array, sigma: Array, to: Weights, dynamics: Array | None) -> None:
        """Add ``dc' sigma dc - y . d2c``.

        Parameters
        ----------
        y, sigma : ndarray (n, m)
            Duals and stiffness.
        dynamics : ndarray (N, nx, nx+nu) or None
            ``[A B]``, for what looks ahead.
        """
        quantity, nx = self.quantity, x.shape[1]
        if isinstance(quantity, Entries):
            target = to.state if quantity.of_state else to.input
            target[np.ix_(self.k, quantity.columns)] += quantity.factors**2 * sigma
            return
        at = self._at(x, u)
        C = quantity.jacobian(at)
        bent = quantity.curvature(at, self.sign * y)
        if quantity.looks_ahead:
            assert dynamics is not None
            AB = dynamics[self.k]
            n = AB.shape[2]
            C = C[:, :, :n] + C[:, :, n:] @ AB
            if bent is not None:
                mixed = bent[:, :n, n:] @ AB
                bent = bent[:, :n, :n] + mixed + mixed.transpose(0, 2, 1) + AB.transpose(0, 2, 1) @ bent[:, n:, n:] @ AB
        H = np.einsum("kmi,km,kmj->kij", C, sigma, C)
        if bent is not None:
            H -= bent
        if not quantity.of_state:
            to.full()[self.k] += H
            return
        last = self.k == len(u)
        if not last.all():
            to.full()[self.k[~last], :nx, :nx] += H[~last]
        if last.any():
            to.final += H[last].sum(axis=0)

    def along(self, x: Array, u: Array, dx: Array, du: Array) -> Array:
        """Return ``dc (n, m)`` along a direction."""
        quantity = self.quantity
        if isinstance(quantity, Entries):
            moved = (dx if quantity.of_state else du)[np.ix_(self.k, quantity.columns)]
            return np.asarray(self.sign * quantity.factors * moved)
        parts = [dx[self.k]]
        if not quantity.of_state:
            parts.append(du[self.k])
        if quantity.looks_ahead:
            parts.append(dx[self.k + 1])
        C = quantity.jacobian(self._at(x, u))
        return np.asarray(self.sign * np.einsum("kmi,ki->km", C, np.hstack(parts)))

    def _at(self, x: Array, u: Array) -> Samples:
        k = self.k
        if self.quantity.of_state:
            nothing = np.empty((len(k), 0))
            return Samples(k, x[k], nothing, nothing)
        return Samples(k, x[k], u[k], x[k + 1])
