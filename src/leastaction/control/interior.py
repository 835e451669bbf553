"""The quadratic problem of one instant of a predictive controller, with its limits: an interior point method.

Along a motion, with the changes ``z = (dx, du)`` and limits ``c + C z >= 0``::

    minimise   g'z + 1/2 z'H z + rho'e    subject to   dx+ = A dx + B du,  dx_0 = 0,  c + C z = s - e,  s, e >= 0

An excess e has a price rho, so that there always is a solution. Newton's step on the equations of optimality, with
``s y = mu`` and ``e (rho - y) = mu``, comes to one Riccati recursion with the stiffness
``sigma = 1 / (s/y + e/(rho - y))`` in the weights, as in `leastaction.optimal.limits`; each iteration makes two (the
predictor and the corrector of S. Mehrotra, SIAM J. Optim. 2, 1992). Slacks and multipliers are kept from instant to
instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from leastaction import _core
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.cost import CostGradient
from leastaction.optimal.discrete.hessians import ModelHessian
from leastaction.optimal.limits.cost import Jacobians, LimitedCost
from leastaction.optimal.limits.sides import Sided
from leastaction.optimal.quantity import Instants
from leastaction.optimal.system import Linearization


class WindowModel(NamedTuple):
    """What is known along a motion: values and derivatives of limits, dynamics, and the cost."""

    c: Sided
    jacobians: Jacobians
    linear: Linearization
    gradient: CostGradient
    plain: ModelHessian


@dataclass(frozen=True, eq=False)
class InteriorPoint:
    """Where the interior point method ended.

    ``dx`` (N+1, ndx), ``du`` (N, nu): the changes. ``K`` (N, nu, ndx): the gains of its last recursion. All in memory
    of the method. ``iterations``, ``converged``: how many there were, and whether these were enough. ``excess``: the
    largest violation of a limit to first order, in its scale.
    """

    dx: Array
    du: Array
    K: Array
    iterations: int
    converged: bool
    excess: float


class InteriorProgram:
    """The method and its memory, in the core: slacks, excesses, multipliers and prices. Not for several threads.

    ``limited``: the limits. ``sizes``: N, ndx, nu. ``price``: of an excess of its scale, to begin with. ``scales``: of
    all limits. ``magnitude``: of the cost, where it falls by nothing.
    """

    def __init__(
        self, limited: LimitedCost, sizes: tuple[int, int, int], price: float, scales: Array, magnitude: float
    ) -> None:
        self.limited, self.scales, self.magnitude = limited, scales, magnitude
        _, nx, nu = sizes
        m = limited.layout.ends[-1]
        stage, length = np.zeros(m, dtype=np.int64), np.ones(m, dtype=np.int64)
        for each in limited.others:
            stage[each.at], length[each.at] = each.rows.k[:, None], len(each.rows.columns(nx, nu))
        begin = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(length)])
        column, factors = np.zeros(begin[-1], dtype=np.int64), np.zeros(begin[-1])
        for rows, width, first in ((limited.of_states, nx, 0), (limited.of_inputs, nu, nx)):
            if len(rows.places):
                stage[rows.at] = rows.places // width
                at = begin[:-1][rows.at]
                column[at], factors[at] = first + rows.places % width, rows.factors
        # Where the derivatives of the others are among all, and their signs.
        self._places: list[tuple[Instants, float]] = []
        for each in limited.others:
            columns = each.rows.columns(nx, nu)
            places = begin[:-1][each.at][:, :, None] + np.arange(len(columns))
            column[places] = columns
            self._places.append((places, each.rows.sign))
        self.core = _core.InteriorProgram(*sizes, stage, begin, column)
        self.core.coefficients[:] = factors
        self.core.scales[:], self.core.rho[:] = scales, price / scales
        self._coefficients, self._kept = self.core.coefficients, (self.core.s, self.core.e, self.core.y)
        self._solution = self.core.dx, self.core.du, self.core.K
        self._room = np.empty(m)
        self._later: dict[int, Instants] = {}  # where what is so many steps later stands

    def solve(self, model: WindowModel, *, tolerance: float, most: int) -> InteriorPoint | None:
        """Return the solution, to within a tolerance relative to the cost's fall; None where there is no minimum."""
        for (places, sign), jacobian in zip(self._places, model.jacobians, strict=True):
            self._coefficients[places] = sign * jacobian
        A, B = model.linear
        q, r, q_final = (np.ascontiguousarray(each, dtype=np.float64) for each in model.gradient)
        plain = model.plain
        columns, part = (None, None) if plain.part is None else plain.part
        report = self.core.solve(
            A, B, model.c.flat, tolerance, self.magnitude, most, Q=plain.Q, R=plain.R,
            S=None if plain.S is None else np.ascontiguousarray(plain.S), q=q, r=r,
            Q_final=np.ascontiguousarray(plain.Q_final), q_final=q_final, part=part,
            part_columns=None if columns is None else np.ascontiguousarray(columns, dtype=np.int64),
            pattern=model.linear.pattern,
        )  # fmt: skip
        if not report.solved:
            return None
        return InteriorPoint(*self._solution, report.iterations, report.converged, report.excess)

    def shift(self, steps: int) -> None:
        """Have slacks and multipliers go along with a horizon that has moved on."""
        if not self.core.kept or not steps:
            return
        if steps not in self._later:
            places = np.arange(self.limited.layout.ends[-1], dtype=np.float64)
            for side in Sided(places, self.limited.layout):
                by = min(steps, len(side) - 1)
                if by > 0:
                    side[:-by] = side[by:].copy()
            self._later = {steps: places.astype(np.intp)}  # that of the last number of steps, which mostly is one
        for flat in self._kept:
            np.take(flat, self._later[steps], out=self._room, mode="clip")
            flat[:] = self._room
