"""Estimation over a moving horizon: the states that explain the last readings best, within limits.

Over the last n steps, with ``x_{k+1} = f(x_k, u_k) + G w_k`` and readings ``y_k = h(x_k) + v_k``::

    minimise  1/2 |x_0 - xbar|^2_{P^-1} + 1/2 sum |w_k|^2 + 1/2 sum |y_k - h(x_k)|^2_{V^-1}  within limits

by the optimiser, with a free start and the disturbances as its inputs. What came before the horizon is in ``xbar`` and
P, which a Kalman filter carries along. Of a linear system without limits the last state is the Kalman filter's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.kalman import KalmanFilter
from leastaction.control.readings import Measured, Readings, Spread, Stated, of_an_instant
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_count, read_only
from leastaction.numerics.public import public
from leastaction.optimal.discrete.cost import Cost, CostGradient
from leastaction.optimal.discrete.hessians import CostHessian
from leastaction.optimal.discrete.system import DiscreteSystem, SystemAround
from leastaction.optimal.limits.limit import Limit, checked_limits
from leastaction.optimal.optimization import optimize
from leastaction.optimal.options import Options
from leastaction.optimal.quantity import Entries, Quantity
from leastaction.optimal.result import OptimizationResult
from leastaction.optimal.system import Linearization, keeps

_OPTIONS = Options(tolerance=1e-8, max_iterations=50)


@public
class MovingHorizonEstimator:
    """An estimator by the optimiser: as a `KalmanFilter`, but within limits. Not for several threads.

    Parameters
    ----------
    system, measure, noise, process, x, spread
        As of `KalmanFilter`.
    horizon : int, optional
        Steps back that are looked at.
    limits : sequence of Limit, optional
        On quantities of the state, such as ``Bound("height", min=0.0)``: what is known of every state.

    Attributes
    ----------
    x : ndarray (nx,)
        The estimate now.
    result : OptimizationResult or None
        The last optimisation: the states of the horizon, with the disturbances as inputs.

    Raises
    ------
    ArgumentError
        Wrong shapes, unknown names, or what is no covariance.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import Bound, JointForce, Mechanism, MidpointSystem, MidpointVI, tx
    >>> from leastaction.control import MovingHorizonEstimator
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 21))
    >>> estimator = MovingHorizonEstimator(
    ...     system, measure=["x"], noise=0.1, process={"p_x": 0.1}, x=[0.5, 0.0], limits=[Bound("x", min=0.0)]
    ... )
    >>> for y in (0.1, -0.2, -0.3):
    ...     x = estimator.correct([y])
    ...     x = estimator.predict([0.0])
    >>> bool(estimator.result.x[:, 0].min() > -1e-6)
    True
    """

    def __init__(
        self,
        system: DiscreteSystem,
        *,
        measure: Measured,
        noise: Spread,
        process: Spread,
        x: Stated,
        spread: Spread = 1.0,
        horizon: int = 20,
        limits: Sequence[Limit] = (),
    ) -> None:
        self.before = KalmanFilter(system, measure=measure, noise=noise, process=process, x=x, spread=spread)
        self.system, self.readings = system, self.before.readings
        self.horizon, self.limits = as_count(horizon, "horizon", 1), checked_limits(limits)
        if self.horizon > system.N:
            raise ArgumentError(f"horizon: got {horizon}, expected at most the {system.N} steps of the system")
        space = system.charts()
        if space is not None:
            # Of what rotates, only momenta and rates are disturbed: what is added to these is added to numbers.
            plain = (space.pattern.sum(axis=0) == 1) & space.pattern[space.pattern.sum(axis=1) == 1].any(axis=0)
            if self.before.W.diagonal()[~plain].any():
                raise ArgumentError(
                    "process: got a disturbance of rotations, expected one of plain entries of the state, such as "
                    "{'p_*': 0.01}; or use a KalmanFilter"
                )
        values, vectors = np.linalg.eigh(self.before.W)
        some = values > 0.0
        if not some.any():
            raise ArgumentError("process: got no disturbance at all, expected one of some entry of the state")
        self._G = vectors[:, some] * np.sqrt(values[some])
        self._inverse_V: Array = np.asarray(np.linalg.inv(self.before.V), dtype=np.float64)
        self.x, self.k = self.before.x.copy(), 0
        self.innovation, self.surprise = np.zeros(self.readings.ny), np.nan
        self.result: OptimizationResult | None = None
        self._x, self._u, self._w = [self.x], list[Array](), list[Array]()
        self._y: list[Array | None] = [None]

    def predict(self, u: ArrayLike) -> Array:
        """Go on over one step under inputs u (nu,); return the estimate (nx,) at its end.

        Raises
        ------
        ArgumentError
            A wrong shape.
        StepError
            The system has no such step from the estimate.
        """
        given = of_an_instant(u, "u", self.system.input_names)
        self.x = np.array(self.system.f(self.x, given, 0))
        self._x.append(self.x)
        self._u.append(given)
        self._w.append(np.zeros(self._G.shape[1]))
        self._y.append(None)
        self.k += 1
        if len(self._u) > self.horizon:
            first = self._y.pop(0)
            if first is not None:
                self.before.correct(first)
            self.before.predict(self._u.pop(0))
            self._x.pop(0)
            self._w.pop(0)
        return self.x

    def correct(self, y: ArrayLike) -> Array:
        """Make use of readings y (ny,) of the state now, return the estimate (nx,).

        Raises
        ------
        ArgumentError
            A wrong shape, or readings that are not finite.
        """
        given = self.readings.given(y, self.x)
        self.innovation = given - self.readings(self.x, 0)
        self._y[-1] = given
        n = len(self._u)
        if n == 0:
            self.x = self._first(given)
            self._x[-1] = self.x
            return self.x
        disturbed = _DisturbedSystem(self.system.window(0, n), np.array(self._u), self._G)
        cost = _ReadingCost(self.readings, list(self._y), self._inverse_V, self.before.x, self._known(), self.system)
        self.result = optimize(
            disturbed, cost, initial=(np.array(self._x), np.array(self._w)), limits=self.limits, free_start=True,
            options=_OPTIONS,
        )  # fmt: skip
        self._x, self._w = list(self.result.x), list(self.result.u)
        self.x = np.array(self.result.x[-1])
        return self.x

    def _known(self) -> Array:
        """Return the inverse of the covariance of what the horizon begins with, in the directions in which it moves."""
        P, Z = self.before.P, self.system.start_directions(self.before.x, None)
        basis = np.linalg.qr(Z)[0] if Z.shape[1] < len(Z) else np.eye(len(P))
        inverse = np.linalg.pinv(basis.T @ P @ basis, rcond=1e-12, hermitian=True)
        return np.asarray(basis @ inverse @ basis.T, dtype=np.float64)

    def _first(self, y: Array) -> Array:
        """Return the estimate by a single reading, which is the Kalman filter's."""
        C, P = self.readings.jacobian(self.before.x, 0), self.before.P
        gain = np.linalg.solve(C @ P @ C.T + self.before.V, C @ P).T
        return np.asarray(self.system.moved_start(self.before.x, gain @ (y - self.readings(self.before.x, 0))))


class _DisturbedSystem(SystemAround):
    """``x+ = f(x, u_k, k) + G w`` with given inputs u: the disturbances w are what is found."""

    def __init__(self, system: DiscreteSystem, u: Array, G: Array) -> None:
        super().__init__(system)
        self.given, self.G = read_only(u), G
        self.nu, self.N, self.has_curvature = G.shape[1], system.N, False

    def f(self, x: Array, u: Array, k: int) -> Array:
        return np.asarray(self.system.plus(self.system.f(x, self.given[k], k), self.G @ u))

    def derivatives(self, x: Array, u: Array, k: int) -> tuple[Array, Array]:  # noqa: ARG002
        return self.system.derivatives(x, self.given[k], k)[0], self.G

    def own_linearize(self, x: Array, u: Array, out: Linearization | None) -> Linearization | None:  # noqa: ARG002
        """Return the derivatives: those of the system by a way of its own, if it has one, and G."""
        if keeps(self.system, DiscreteSystem, "linearize", "own_linearize"):
            return None
        A, _ = self.system.linearize(x, self.given)
        return Linearization(A, np.ascontiguousarray(np.broadcast_to(self.G, (self.N, *self.G.shape))))

    def told(self) -> None:
        """Return None: a motion with other inputs is none of a mechanism's."""

    def own_input_name(self, i: int) -> str:
        return f"w[{i}]"

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(self.input_name(i) for i in range(self.nu))

    @property
    def input_units(self) -> tuple[str, ...]:
        return ("",) * self.nu

    def own_when(self, k: int) -> str:
        return self.system.when(k)

    def own_time(self, k: int) -> float:
        return self.system.time(k)

    @property
    def quantities(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(kind for kind in self.system.quantities if kind != "input" and self.system.quantity(kind).of_state)

    def own_quantity(self, kind: str, t: Array | None) -> Quantity:  # noqa: ARG002 - time goes in steps
        if kind == "input":
            return Entries([self.input_name(i) for i in range(self.nu)], range(self.nu), of_state=False)
        return self.system.quantity(kind)


class _ReadingCost(Cost):
    """What readings, disturbances, and the start are off by; see the module."""

    nonnegative = True

    def __init__(
        self,
        readings: Readings,
        y: Sequence[Array | None],
        inverse_V: Array,
        x: Array,
        inverse_P: Array,
        system: DiscreteSystem,
    ) -> None:
        self.readings, self.y, self.inverse_V, self.system = readings, y, inverse_V, system
        self.first, self.inverse_P = x, inverse_P

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        return np.array(
            [self._of_state(x[i], start + i) + 0.5 * float(u[i] @ u[i]) for i in range(len(u))], dtype=np.float64
        )

    def final_value(self, x: Array) -> float:
        return self._of_state(x, len(self.y) - 1)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        slopes = np.array([self._slope(x[k], k) for k in range(len(x))])
        return CostGradient(slopes[:-1], np.array(u), slopes[-1])

    def hessian(self, x: Array, u: Array) -> CostHessian:
        """Return Gauss and Newton's second derivatives."""
        bends = np.array([self._bend(x[k], k) for k in range(len(x))])
        return CostHessian(bends[:-1], np.ones(u.shape[1]), None, bends[-1])

    def own_convex_hessian(self, x: Array, u: Array) -> CostHessian:
        """Return all of it, which is convex; see `Cost`."""
        return self.hessian(x, u)

    def _off(self, x: Array, k: int) -> Array:
        y = self.y[k]
        return np.zeros(self.readings.ny) if y is None else self.readings(x, k) - y

    def _of_state(self, x: Array, k: int) -> float:
        e = self._off(x, k)
        total = float(e @ self.inverse_V @ e)
        if k == 0:
            away = self.system.difference(x, self.first)
            total += float(away @ self.inverse_P @ away)
        return 0.5 * total

    def _slope(self, x: Array, k: int) -> Array:
        out = self.readings.jacobian(x, k).T @ (self.inverse_V @ self._off(x, k))
        return out + self.inverse_P @ self.system.difference(x, self.first) if k == 0 else out

    def _bend(self, x: Array, k: int) -> Array:
        C = self.readings.jacobian(x, k) * float(self.y[k] is not None)
        out = C.T @ self.inverse_V @ C
        return out + self.inverse_P if k == 0 else out
