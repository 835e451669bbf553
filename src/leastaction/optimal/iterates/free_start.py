"""An initial state that is found too, and which unknown numbers the cost does not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.hessians import ModelHessian
from leastaction.optimal.discrete.linear_quadratic import LinearQuadraticSolution
from leastaction.optimal.discrete.system import DiscreteSystem

# Second derivative by the initial state, in parts of the largest, that counts as none: little more than rounding, since
# a limit that is active in the end is stiffer than all else by ten orders of magnitude.
_FLAT = 1e-14

_SHORTER = 0.7  # part of what a motion lasts that a step of the search takes off at most


class FreeStart:
    """The initial state of a search: fixed, free, or free in some of its entries.

    ``free``: whether, or which. ``final_time``: the place in the state of the time (s) at which the motion ends, if
    that is found too. ``flat``: unknown numbers of which the last model says nothing.
    """

    def __init__(self, system: DiscreteSystem, free: bool | Sequence[str], final_time: int | None = None) -> None:
        self.system, self.free, self.final_time = system, free, final_time
        self.flat: list[str] = []
        self._directions: Array | None = None

    @property
    def is_fixed(self) -> bool:
        """Whether it stays as it is."""
        return self.free is False

    def forget(self) -> None:
        """Drop what holds of one initial state only."""
        self._directions = None

    def directions(self, x0: Array) -> Array:
        """Return the directions (ndx, n) in which it may move."""
        if self._directions is None:
            entries = None if isinstance(self.free, bool) else self.free
            self._directions = self.system.start_directions(x0, entries)
        return self._directions

    def step(self, model: LinearQuadraticSolution, x0: Array) -> Array | None:
        """Return its change at the model's minimum (dissertation 6.3.2.1); None if it is fixed."""
        if self.free is False:
            return None
        from scipy.linalg.lapack import dposv  # slow to import, and not needed by most

        Z = self.directions(x0)
        if not Z.size:
            return np.zeros(len(Z))
        _, step, _ = dposv(Z.T @ model.P0 @ Z, Z.T @ model.b[0])
        return np.asarray(-Z @ step)

    def longest(self, dx0: Array | None, x0: Array, length: float) -> float:
        """Return how far to go along its change, at most this far: no model holds for a motion that is much shorter."""
        if self.final_time is None or dx0 is None:
            return length
        lasts, change = x0[self.final_time] - self.system.time(0), dx0[self.final_time - self.system.nx]
        return float(-_SHORTER * lasts / change) if length * change < -_SHORTER * lasts else length

    def checked(
        self, model: LinearQuadraticSolution, x0: Array, hessian: Callable[[], ModelHessian]
    ) -> LinearQuadraticSolution:
        """Return a model, without a minimum if it has none over the initial state.

        ``hessian``: returns the model's weights; called where it may have no minimum.
        """
        self.flat = []
        if self.free is False or not model.definite:
            return model
        Z = self.directions(x0)
        bend = Z.T @ model.P0 @ Z
        if not len(bend):
            return model
        little = _FLAT * float(np.abs(bend).max())
        if _is_definite(bend, little):
            return model
        # What a limit at the start itself weighs is added last, so no rounding of the rest is as large as that.
        little = _FLAT * float(np.abs(bend - Z.T @ hessian().of_first_state @ Z).max())
        if _is_definite(bend, little):
            return model
        values, vectors = np.linalg.eigh(bend)
        least = float(values[0])
        if least >= -little:
            self.flat = self.system.unknowns_along(np.abs(Z @ vectors[:, values <= little]).max(axis=1)) or []
        message = f"P is not positive definite over the free initial state (smallest eigenvalue {least:.3g})."
        return replace(model, definite=False, stage=0, message=message)

    @property
    def undetermined(self) -> str:
        """Names of unknown numbers that the cost does not determine, as a message; empty where there are none."""
        if not self.flat:
            return ""
        names = " and ".join(repr(name) for name in self.flat)
        return (
            f"The cost does not depend on {names} along this motion, neither to first nor to second order, so that "
            "cannot be found. Start from a motion on which it has an effect, give it a price or a `weight` (what is "
            "known of it), or leave it out of the unknowns."
        )


def _is_definite(matrix: Array, least: float) -> bool:
    """Whether all eigenvalues of a symmetric matrix are larger than some number."""
    from scipy.linalg.lapack import dpotrf  # slow to import, and not needed by most

    lowered = matrix.copy()
    lowered.flat[:: len(matrix) + 1] -= least
    return int(dpotrf(lowered)[1]) == 0
