"""The constraints of a mechanism: residuals, Jacobian, rank."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.compiled import Compiled
from leastaction.numerics.arrays import Array

# Length of what is left of a gradient, as a fraction of it, below which an equation counts as dependent.
RANK_TOLERANCE = 1e-9
# Share in a dependent gradient below which an equation has no part in it.
WEIGHT_TOLERANCE = 1e-6


class ConstraintQueries(Compiled):
    """What can be asked about the constraints; see `Mechanism`, which offers it."""

    __slots__ = ()

    def constraint_values(self, q: npt.ArrayLike) -> Array:
        """Return h(q), shape (nc,), or (N, nc) for a batch."""
        values, single = self._batch(q)
        result = np.empty((len(values), self.nc))
        for row, configuration in zip(result, values, strict=True):
            row[:] = self.core.constraints(configuration)
        return result[0] if single else result

    def constraint_residuals(self, q: npt.ArrayLike) -> dict[str, Any]:
        """Return h(q) by constraint name: floats, or arrays (N,) for a batch."""
        values = self.constraint_values(q)
        if values.ndim == 1:
            return {n: float(h) for n, h in zip(self.constraints, values, strict=True)}
        return dict(zip(self.constraints, values.T, strict=True))

    def constraint_jacobian(self, q: npt.ArrayLike) -> Array:
        """Return Dh(q), shape (nc, nq), at q of shape (nq,)."""
        jacobian = self.core.constraint_jacobian(self._single(q))
        return np.asarray(jacobian).reshape(self.nc, self.nq)

    def constraint_rank(self, q: npt.ArrayLike) -> int:
        """Return the rank of the constraints on the dynamic variables at q of shape (nq,)."""
        return self.nc - len(self.redundancy(q))

    def degrees_of_freedom(self, q: npt.ArrayLike) -> int:
        """Return nd less the rank of the constraints on the dynamic variables at q of shape (nq,)."""
        return self.nd - self.constraint_rank(q)

    def redundancy(self, q: npt.ArrayLike) -> dict[str, tuple[str, ...]]:
        """Return the constraint equations that ask for nothing new at a configuration.

        Parameters
        ----------
        q : array_like, shape (nq,)
            The configuration.

        Returns
        -------
        dict of str to tuple of str
            Every equation whose gradient by the dynamic variables is a linear combination of those of
            equations listed before it in `constraints`, and which these are; none for a gradient of zero.
            Empty where all equations are independent. At a singular configuration, as a four-bar linkage
            in one line, equations are dependent that are independent elsewhere.

        Raises
        ------
        ArgumentError
            If a gradient is not finite there, as that of a path two points of which meet.
        """
        jacobian = self.constraint_jacobian(q)[:, : self.nd]
        if not np.isfinite(jacobian).all():
            bad = [
                name
                for name, row in zip(self.constraints, jacobian, strict=True)
                if not np.isfinite(row).all()
            ]
            raise ArgumentError(
                f"the gradient of {', '.join(map(repr, bad[:6]))} is not finite at this configuration, so the "
                "rank of the constraints is not determined; ask at another one"
            )
        # Rows of ordinary size, so that no square overflows.
        jacobian = jacobian / max(1.0, float(np.abs(jacobian).max(initial=0.0)))
        scales = np.linalg.norm(jacobian, axis=1)
        # A row without a gradient is one of rounding, compared with the whole.
        floor = RANK_TOLERANCE * max(1.0, float(scales.max(initial=0.0)))
        basis = np.zeros((0, self.nd))
        kept: list[int] = []
        found: dict[str, tuple[str, ...]] = {}
        for row, (name, scale) in enumerate(zip(self.constraints, scales, strict=True)):
            if scale <= floor:
                found[name] = ()
                continue
            unit = jacobian[row] / scale
            rest = unit - basis.T @ (basis @ unit)
            rest -= basis.T @ (basis @ rest)
            size = float(np.linalg.norm(rest))
            if size > RANK_TOLERANCE:
                basis = np.vstack([basis, rest / size])
                kept.append(row)
                continue
            rows = jacobian[kept] / scales[kept, None]
            weights = np.linalg.lstsq(rows.T, unit, rcond=None)[0]
            found[name] = tuple(
                self.constraints[other]
                for other, weight in zip(kept, weights, strict=True)
                if abs(weight) > WEIGHT_TOLERANCE
            )
        return found
