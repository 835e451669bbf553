"""How a simulation in continuous time keeps the constraints: by projection, by stabilisation, or not at all.

The accelerations satisfy ``d^2 h/dt^2 = 0``, so the error of the integrator leaves h to drift as a double
integrator does. With M the mass matrix and G = Dh, both of the dynamic variables, and ``W = M^-1 G^T (G M^-1 G^T)^+``:

- Projection: ``q <- q - W h`` until h is zero to rounding, then ``v <- v - W (Dh v)``. In the metric M the change
  is the least one that there is, so of all velocities that keep the constraints v goes to the one that an impulse of
  the constraints alone leads to.
- Baumgarte's stabilisation: ``h'' + 2 (zeta/T) h' + h/T^2 = 0`` takes the place of ``h'' = 0``. Deviations die out with
  the time constant T, but the stiffness ``1/T^2`` is one more scale of the equations. `ContinuousDynamics` solves these
  equations as they stand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.mechanics.configuration.assembly import check_consistent, check_velocity
from leastaction.mechanics.configuration.null_space import LOOSE_RANK_TOLERANCE, RANK_TOLERANCE, row_scales
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import moved
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.public import public

_ITERATIONS = 20
_LOOSENING = 10.0  # beside the constraints, singular values below so many times |h| are noise
_SAFE = 1e-4  # ratio in a Cholesky factor down to which its squared condition does no harm
_SLOW, _FAR = 0.1, 1e-6  # fall of |h|, and way, for which the metric of the start no longer does


@public
@dataclass(frozen=True)
class Projection:
    """Bring every accepted step back onto the constraints. Frozen: threads may share it.

    Attributes
    ----------
    tolerance : float
        Largest ``|h_i| / max(1, |Dh_i|, |Dh_i|^2 / 4)`` that may be left; a projection that leaves more ends
        the simulation. Where it is possible the constraints are met to rounding.
    """

    tolerance: float = 1e-10


@public
@dataclass(frozen=True)
class Baumgarte:
    """Let deviations from the constraints die out, as those of a damped oscillator do. Frozen: threads may share it.

    Attributes
    ----------
    time_constant : float
        T (s): deviations obey ``h'' + 2 (zeta/T) h' + h/T^2 = 0``.
    damping_ratio : float
        zeta; 1 is the critical damping, with which h falls as ``(1 + t/T) exp(-t/T)``.
    """

    time_constant: float = 0.1
    damping_ratio: float = 1.0

    @property
    def damping(self) -> float:
        """Factor of h' (1/s)."""
        return 2.0 * self.damping_ratio / self.time_constant

    @property
    def stiffness(self) -> float:
        """Factor of h (1/s^2)."""
        return 1.0 / self.time_constant**2


@public
@dataclass(frozen=True)
class Drift:
    """How far a simulation was from one constraint at the steps of the integrator.

    Attributes
    ----------
    h : float
        Largest ``|h_i|``, after projection where there is one.
    rate : float
        Largest ``|Dh_i v|``, likewise.
    h_step, rate_step : float
        Largest ones before projection: what a single step did. Without projection as `h` and `rate`.
    """

    h: float
    rate: float
    h_step: float
    rate_step: float


class ConstraintLost(LeastActionError):
    """A projection did not reach the constraints; ends a simulation, and its message becomes the cause."""


def as_handling(constraints: object) -> Projection | Baumgarte | None:
    """Return how constraints are kept, from what a user gives; None for not at all."""
    named: dict[str, Projection | Baumgarte | None] = {"project": Projection(), "baumgarte": Baumgarte(), "none": None}
    if isinstance(constraints, str) and constraints in named:
        return named[constraints]
    if isinstance(constraints, Projection):
        as_number(constraints.tolerance, "constraints: tolerance", above=0.0, below=1e-2)
        return constraints
    if isinstance(constraints, Baumgarte):
        for field in ("time_constant", "damping_ratio"):
            as_number(getattr(constraints, field), f"constraints: {field}", above=0.0)
        return constraints
    raise ArgumentError(
        f"constraints: got {constraints!r}, expected 'project', 'baumgarte', 'none', or a Projection or "
        "Baumgarte with parameters"
    )


def check_start_consistent(mechanism: Mechanism, q: Array, v: Array) -> None:
    """Raise an `InconsistentStartError` unless a start satisfies the constraints and keeps them."""
    if mechanism.nc:
        check_consistent(mechanism, q)
        check_velocity(mechanism, q, v, instead=", or constraints=Baumgarte(...), which lets deviations die out")


class ConstraintMetric:
    """The constraints at one configuration, in the metric of the mass matrix.

    ``q`` (nq,). ``size``: |h| there: a bound for what counts as redundant.
    """

    def __init__(self, mechanism: Mechanism, q: Array, size: float = 0.0) -> None:
        nd = mechanism.nd
        self.jacobian = _jacobian(mechanism, q)
        mass = mechanism.core.hessian(q, np.zeros(mechanism.nv))[2][:nd, :nd]
        gradients = self.jacobian[:, :nd].T
        try:
            inverse_root = _inverse_root(mass)
        except np.linalg.LinAlgError:
            # A variable that moves no mass here: the constraints hold it. Any metric will do.
            inverse_root = np.eye(nd)
        scaled = inverse_root.T @ gradients
        self._least = inverse_root @ self._inverse(scaled, size)

    @staticmethod
    def _inverse(scaled: Array, size: float) -> Array:
        """Return the generalised inverse (nd, nc) of ``scaled^T``."""
        gram = scaled.T @ scaled
        try:
            root = _inverse_root(gram)
        except np.linalg.LinAlgError:
            root = None
        if root is not None:
            # Several times cheaper than singular values, where the equations are independent.
            diagonal = 1.0 / root.diagonal()
            if np.all(diagonal > max(_SAFE * diagonal.max(initial=0.0), _LOOSENING * size)):
                return np.asarray(scaled @ (root @ root.T))
        left, sizes, right = np.linalg.svd(scaled, full_matrices=False)
        largest = float(sizes.max(initial=0.0))
        loose = min(LOOSE_RANK_TOLERANCE * largest, _LOOSENING * size)
        keep = sizes > max(RANK_TOLERANCE * largest, loose)
        return np.asarray((left[:, keep] / sizes[keep]) @ right[keep])

    def change(self, wanted: Array) -> Array:
        """Return the least change (nd,) in the mass metric that changes h (or its rates) as wanted (nc,)."""
        return np.asarray(self._least @ wanted)


def _inverse_root(matrix: Array) -> Array:
    """Return R, upper triangular, with ``R R^T = matrix^-1``; a `LinAlgError` if it is not positive definite.

    With ``matrix = L L^T`` the Cholesky factor of ``[[matrix, 1], [1, c]]`` has ``L^-T`` in its lower left block, for
    any large c. So no triangular equations are solved: BLAS libraries hand even the smallest of these to threads, which
    on a busy machine takes a hundred times as long as the solution.
    """
    n = len(matrix)
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n] = matrix
    whole[n:, :n] = whole[:n, n:] = np.eye(n)
    whole[n:, n:] = 1e200 * np.eye(n)
    return np.asarray(np.linalg.cholesky(whole)[n:, :n])


def rates(mechanism: Mechanism, q: Array, v: Array) -> tuple[Array, Array]:
    """Return h and its rate, each (nc,)."""
    return np.asarray(mechanism.core.constraints(q)), mechanism.constraint_rates(q, v)


def _jacobian(mechanism: Mechanism, q: Array) -> Array:
    """Return Dh (nc, nv), of a q that is checked."""
    return np.asarray(mechanism.core.constraint_jacobian(q)).reshape(mechanism.nc, mechanism.nv)


def project(mechanism: Mechanism, q: Array, v: Array, tolerance: float) -> tuple[Array, Array]:
    """Return the nearest configuration on the constraints and the velocity there that keeps them.

    ``q`` (nq,), ``v`` (nv,): near the constraints. The kinematic entries stay. ``tolerance``: see `Projection`. Raises
    `ConstraintLost` if the constraints are not reached.
    """
    nd, core = mechanism.nd, mechanism.core
    v = v.copy()
    h = np.asarray(core.constraints(q))
    size = float(np.linalg.norm(h))
    metric = ConstraintMetric(mechanism, q, size)
    scales = row_scales(metric.jacobian)
    start, stale = q, False
    for _ in range(_ITERATIONS):
        if np.all(np.abs(h) <= 1e-15 * scales):
            break
        change = np.zeros(mechanism.nv)
        change[:nd] = -metric.change(h)
        trial = q + change if not mechanism.tree.rotations else moved(mechanism, q[None, :], change[None, :])[0]
        h_trial = np.asarray(core.constraints(trial))
        smaller = float(np.linalg.norm(h_trial))
        if stale and not smaller < _SLOW * size:
            metric, stale = ConstraintMetric(mechanism, q, size), False
            continue
        if not smaller < size:
            break
        q, h, size, stale = trial, h_trial, smaller, True
    if stale and float(np.abs(q - start).max()) > _FAR:
        metric = ConstraintMetric(mechanism, q, size)
    off = ~(np.abs(h) <= tolerance * scales)
    if np.any(off):
        i = int(np.argmax(np.where(off, np.abs(h) / scales, 0.0)))
        raise ConstraintLost(f"the constraints cannot be held: {mechanism.constraints[i]!r} is off by {h[i]:.3g}")
    # Twice: the second pass removes what rounding and the metric leave.
    for _ in range(2):
        v[:nd] -= metric.change(mechanism.constraint_rates(q, v))
    return q, v
