"""Costs in continuous time: ``h(x, u) = int l(x, u, t) dt + m(x(tf), tf)``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array
from leastaction.numerics.frozen import restore_state, saved_state
from leastaction.numerics.printed import printed
from leastaction.numerics.public import public
from leastaction.numerics.time_functions import TimeFunction, TimeFunctionLike
from leastaction.optimal.continuous.final_term import FinalTerm, QuadraticFinalTerm
from leastaction.optimal.cost import check_weight, deviations, matrix_of, owned_row, weigh
from leastaction.optimal.space import StateSpace, bent_by_numbers, by_numbers
from leastaction.optimal.system import System, space_of


class RateGradient(NamedTuple):
    """First derivatives of a cost's rate at n samples.

    Attributes
    ----------
    q, r : ndarray (n, nx), (n, nu)
        ``dl/dx`` and ``dl/du``.
    """

    q: Array
    r: Array


class RateHessian(NamedTuple):
    """Second derivatives of a cost's rate at n samples.

    Attributes
    ----------
    Q, R : ndarray (n, nx, nx), (n, nu, nu)
        ``d2l/dx2`` and ``d2l/du2``.
    S : ndarray (n, nx, nu) or None
        ``d2l/dxdu``; None is zero.
    """

    Q: Array
    R: Array
    S: Array | None


class ContinuousCost(ABC):
    """A cost that is an integral over time and a final term.

    The arrays given are read-only. A cost whose methods are pure may serve several threads at once.
    """

    __repr__ = printed

    nonnegative: bool = False
    """Whether the rate is never below zero: a trial can then be given up as soon as its cost so far is
    past what it may cost in all."""

    jumps: Sequence[float] = ()
    """Times (s) where the rate or its slope jumps with time, if it does."""

    final_term: FinalTerm | None = None
    """What the last state costs; a cost may also say so by `final_value`, `final_gradient` and `final_hessian`."""

    @abstractmethod
    def rate(self, x: Array, u: Array, t: float) -> float:
        """Return ``l(x, u, t)``."""

    def rates(self, x: Array, u: Array, t: Array) -> Array:
        """Return the rates (n,) at ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""
        found = self.own_rates(x, u, t)
        return np.array([self.rate(*at) for at in zip(x, u, t.tolist(), strict=True)]) if found is None else found

    def own_rates(self, x: Array, u: Array, t: Array) -> Array | None:
        """Return the rates at once; None of a cost that has no such way."""

    @abstractmethod
    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        """Return the first derivatives of the rate at ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""

    @abstractmethod
    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        """Return the second derivatives of the rate at ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""

    def final_value(self, x: Array, t: float) -> float:
        """Return ``m(x, tf)`` for the last state (nx,); zero where there is no `final_term`."""
        return 0.0 if self.final_term is None else self.final_term.value(x, t)

    def final_gradient(self, x: Array, t: float) -> Array:
        """Return ``dm/dx`` (nx,)."""
        return np.zeros_like(x) if self.final_term is None else self.final_term.gradient(x, t)

    def final_hessian(self, x: Array, t: float) -> Array:
        """Return ``d2m/dx2`` (nx, nx)."""
        return np.zeros((x.size, x.size)) if self.final_term is None else self.final_term.hessian(x, t)

    def convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian:
        """Return second derivatives of the rate, for quadratic models that hold far from a minimum.

        Those of `own_convex_hessian`, else of `hessian`; the optimiser leaves out negative eigenvalues.
        """
        found = self.own_convex_hessian(x, u, t)
        return self.hessian(x, u, t) if found is None else found

    def own_convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian | None:
        """Return second derivatives of the cost's own for that, as Gauss and Newton's; None if it has none."""

    def convex_final_hessian(self, x: Array, t: float) -> Array:
        """Return the same of the final term (nx, nx)."""
        return self.final_hessian(x, t) if self.final_term is None else self.final_term.convex_hessian(x, t)

    def check(self, t0: float, tf: float, nx: int, nu: int) -> None:
        """Complain if the cost is not for nx states and nu inputs over ``[t0, tf]``; optional."""


@public
class ContinuousQuadraticCost(ContinuousCost):
    """Half the weighted square of the distance from a wanted motion.

    ``1/2 int (x - x_wanted)'Q(x - x_wanted) + (u - u_wanted)'R(u - u_wanted) dt
    + 1/2 (x(tf) - x_final)' Q_final (x(tf) - x_final)``

    Parameters
    ----------
    x_wanted, u_wanted : array_like (nx,) and (nu,), or PiecewisePolynomial, or callable
        Wanted motion: a constant, a `PiecewisePolynomial` (such as one ``through`` samples), or a function of one time.
        Of one state or one input a number will do, here and for weights.
    Q, R : the same, of shape (n,) or (n, n)
        Weights, a diagonal or a matrix. Q must be positive semidefinite, R positive definite.
    Q_final : array_like (nx,) or (nx, nx), optional
        Weight of the last state; none if left out.
    x_final : array_like (nx,), optional
        Wanted last state; x_wanted at the end if left out.
    jumps : sequence of float, optional
        Times (s) where a function that was given jumps, or its slope. Those of a `PiecewisePolynomial` are known.
    space : StateSpace or System, optional
        How states differ, as of a `QuadraticCost`: Q and Q_final then weigh ndx numbers. Derivatives are by the numbers
        of the state, as all are in continuous time.

    Raises
    ------
    ArgumentError
        Weights that are not symmetric or not definite, values that are not finite. What is given as
        a function is looked at when the optimisation begins.
    """

    nonnegative = True

    __getstate__, __setstate__ = saved_state, restore_state

    def __init__(
        self,
        x_wanted: TimeFunctionLike,
        u_wanted: TimeFunctionLike,
        *,
        Q: TimeFunctionLike,
        R: TimeFunctionLike,
        Q_final: ArrayLike | None = None,
        x_final: ArrayLike | None = None,
        jumps: Sequence[float] = (),
        space: StateSpace | System | None = None,
    ) -> None:
        self.space = space_of(space)
        # A number is that of one state, or of one input.
        self.x_wanted, self.u_wanted = (
            TimeFunction(each, name, row=True) for each, name in ((x_wanted, "x_wanted"), (u_wanted, "u_wanted"))
        )
        self.Q, self.R = (TimeFunction(each, name, row=True) for each, name in ((Q, "Q"), (R, "R")))
        self.Q_final = None if Q_final is None else owned_row(Q_final, "Q_final")
        self.x_final = None if x_final is None else owned_row(x_final, "x_final")
        for weight, definite in ((self.Q, False), (self.R, True)):
            if weight.is_constant:
                _check(weight.at(0.0), weight.name, definite=definite)
        if self.Q_final is not None:
            _check(self.Q_final, "Q_final", definite=False)
            self.final_term = QuadraticFinalTerm(self.space, self.Q_final, self.x_wanted, self.x_final)
        signals = (self.x_wanted, self.u_wanted, self.Q, self.R)
        given = as_array(list(jumps), "jumps").ravel().tolist()
        self.jumps = tuple(sorted({*given, *(t for s in signals for t in s.jumps)}))

    def check(self, t0: float, tf: float, nx: int, nu: int) -> None:
        self.x_wanted.check(t0, tf, (nx,), what="(nx,)")
        self.u_wanted.check(t0, tf, (nu,), what="(nu,)")
        ndx = nx if self.space is None else self.space.ndx
        for weight, n, what, definite in (
            (self.Q, ndx, "(nx,) or (nx, nx)", False),
            (self.R, nu, "(nu,) or (nu, nu)", True),
        ):
            for value in weight.check(t0, tf, (n,), (n, n), what=what):
                _check(value, weight.name, definite=definite)
        if self.Q_final is not None:
            as_array(self.Q_final, "Q_final", (ndx,), (ndx, ndx), meaning="(nx,) or (nx, nx)")
        if self.x_final is not None:
            as_array(self.x_final, "x_final", (nx,), meaning="(nx,)")

    def rate(self, x: Array, u: Array, t: float) -> float:
        dx, du = self._off(x, self.x_wanted.at(t)), u - self.u_wanted.at(t)
        Q, R = self.Q.at(t), self.R.at(t)
        weighed = dx @ (Q * dx if Q.ndim == 1 else Q @ dx) + du @ (R * du if R.ndim == 1 else R @ du)
        return 0.5 * float(weighed)

    def own_rates(self, x: Array, u: Array, t: Array) -> Array:
        dx, du = self._off(x, self.x_wanted.samples(t)), u - self.u_wanted.samples(t)
        weighed = weigh(_as_stages(self.Q.samples(t)), dx), weigh(_as_stages(self.R.samples(t)), du)
        return np.asarray(0.5 * (np.sum(dx * weighed[0], axis=1) + np.sum(du * weighed[1], axis=1)))

    def gradient(self, x: Array, u: Array, t: Array) -> RateGradient:
        Q, wanted = _as_stages(self.Q.samples(t)), self.x_wanted.samples(t)
        pull = weigh(_as_stages(self.R.samples(t)), u - self.u_wanted.samples(t))
        if self.space is None:
            return RateGradient(weigh(Q, x - wanted), pull)
        off = deviations(self.space, Q, x, wanted)
        return RateGradient(by_numbers(self.space, x, off.gradient[:, None])[:, 0], pull)

    def hessian(self, x: Array, u: Array, t: Array) -> RateHessian:  # noqa: ARG002
        Q, R = (_as_stages(weight.samples(t)) for weight in (self.Q, self.R))
        if self.space is None:
            return RateHessian(matrix_of(Q), matrix_of(R), None)
        found = deviations(self.space, Q, x, self.x_wanted.samples(t))
        bent = bent_by_numbers(self.space, x, found.gradient, found.squares + found.bend)
        return RateHessian(bent, matrix_of(R), None)

    def own_convex_hessian(self, x: Array, u: Array, t: Array) -> RateHessian | None:  # noqa: ARG002
        if self.space is None:
            return None  # as it is
        Q, R = (_as_stages(weight.samples(t)) for weight in (self.Q, self.R))
        found = deviations(self.space, Q, x, self.x_wanted.samples(t))
        bent = bent_by_numbers(self.space, x, np.zeros_like(found.gradient), found.squares)
        return RateHessian(bent, matrix_of(R), None)

    def _off(self, x: Array, wanted: Array) -> Array:
        return x - wanted if self.space is None else self.space.difference(x, wanted)


def _as_stages(weight: Array) -> Array:
    """Return weights (n, size) or (n, size, size) with one for each row: (n, size, 1) or (n, size, size)."""
    return weight if weight.ndim == 3 else weight[:, :, None]


def _check(weight: Array, what: str, *, definite: bool) -> None:
    if weight.ndim not in (1, 2) or weight.shape[0] != weight.shape[-1]:
        raise ArgumentError(f"{what}: got shape {weight.shape}, expected (n,) or (n, n).")
    check_weight(weight, what, definite=definite)
