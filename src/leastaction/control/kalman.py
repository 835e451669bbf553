"""The state of a system by noisy readings: an extended, or an unscented, Kalman filter.

Over a step ``x+ = f(x, u) + w``, with readings ``y = h(x) + v``, w of covariance W and v of V::

    predict   x <- f(x, u)     P <- A P A' + W
    correct   S = C P C' + V   L = P C' S^-1   x <- x + L (y - h(x))   P <- (1 - L C) P (1 - L C)' + L V L'

A and C are the exact derivatives about the estimate itself. What is not known is a direction in which the system's
state can move: of a mechanism with constraints the covariance has the rank of the tangent space, the noise of a step
is projected into it, and a corrected state is brought back onto the constraints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.readings import (
    Measured,
    Readings,
    Spread,
    Stated,
    covariance,
    covariance_of_states,
    of_an_instant,
    step_of,
)
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array, as_array, as_choice, read_only, require_instance
from leastaction.numerics.public import public
from leastaction.optimal.discrete.system import DiscreteSystem

FilterKind = Literal["extended", "unscented"]


@public
@dataclass(frozen=True, eq=False)
class Estimate:
    """States by readings, over a whole record.

    Attributes
    ----------
    t : ndarray (N+1,)
        Times (s).
    x : ndarray (N+1, nx)
        Estimates, after the reading of each instant.
    P : ndarray (N+1, ndx, ndx)
        Their covariances.
    innovations : ndarray (N+1, ny)
        Readings less what was expected.
    surprise : ndarray (N+1,)
        Normalised innovations squared, ``e' S^-1 e``: ny in the mean, of a filter that is consistent.
    x_predicted, P_predicted : ndarray (N+1, nx), (N+1, ndx, ndx)
        Before the reading of each instant.
    A : ndarray (N, ndx, ndx)
        Derivatives of the steps.
    """

    t: Array
    x: Array
    P: Array
    innovations: Array
    surprise: Array
    x_predicted: Array
    P_predicted: Array
    A: Array

    def smoothed(self, system: DiscreteSystem) -> tuple[Array, Array]:
        """Return states (N+1, nx) and covariances (N+1, ndx, ndx) by all readings, the later ones too.

        That of Rauch, Tung and Striebel, backwards along what the filter did.

        Parameters
        ----------
        system : DiscreteSystem
            The filter's, which says how states are compared and where they may be.
        """
        x, P = self.x.copy(), self.P.copy()
        for k in range(len(self.A) - 1, -1, -1):
            # Where nothing is uncertain nothing is gained: a covariance may be singular.
            G = self.P[k] @ self.A[k].T @ np.linalg.pinv(self.P_predicted[k + 1], rcond=1e-12, hermitian=True)
            x[k] = system.moved_start(self.x[k], G @ system.difference(x[k + 1], self.x_predicted[k + 1]))
            P[k] = _symmetric(self.P[k] + G @ (P[k + 1] - self.P_predicted[k + 1]) @ G.T)
        return x, P


@public
class KalmanFilter:
    """A Kalman filter along the linearisations of a system. It goes forward in time: not for several threads.

    Parameters
    ----------
    system : DiscreteSystem
        Such as a `MidpointSystem`. After its last step the filter goes on with steps like that one.
    measure : str, sequence of str, Quantity, callable or array_like
        What is read: entries of the state by name with wildcards (``["shoulder", "elbow"]``), of a ball or free joint
        its quaternion, of either sign; a `Quantity` of the state, a function ``h(x)``, or a matrix (ny, nx).
    noise : float, array_like or mapping
        Of readings: standard deviations, one for all, (ny,), or by name; or a covariance (ny, ny).
    process : float, array_like, mapping or callable
        Of what a step adds to the state by chance, likewise, (nx,) or ``{"p_*": 0.01}``, or (nx, nx);
        of states that are no plain vectors ndx for nx. Or a function of the state that returns a covariance (ndx, ndx).
    x : array_like (nx,), State or mapping of str to float
        Where it is believed to begin, by name what is not given is zero.
    spread : float, array_like or mapping
        How far off that may be, likewise.
    kind : {"extended", "unscented"}, optional
        Linearised, or by 2 n points about the estimate (n the dimension of the tangent space), which sees curvature.
        They lie at the root of n standard deviations, so filters of more states see farther: of a spread of 0.3 rad in
        readings of a quaternion, a ball and a hinge about the same axis are estimated with 6e-3 rad between them.

    Attributes
    ----------
    x, P : ndarray (nx,), (ndx, ndx)
        The estimate now and its covariance.
    k : int
        Steps that it has gone.
    innovation, surprise : ndarray (ny,), float
        The last reading less what was expected, and its square by its covariance: ny in the mean.

    Raises
    ------
    ArgumentError
        Wrong shapes, unknown names, or what is no covariance.

    Examples
    --------
    >>> import numpy as np
    >>> from leastaction import JointForce, Mechanism, MidpointSystem, MidpointVI, tx
    >>> from leastaction.control import KalmanFilter
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 1.0, 101))
    >>> kalman = KalmanFilter(system, measure=["x"], noise=0.01, process={"p_x": 1e-3}, x=[0.0, 0.0], spread=0.1)
    >>> kalman.correct([0.2]).round(2)
    array([0.2, 0. ])
    >>> kalman.predict([1.0]).round(2)
    array([0.2 , 0.01])
    """

    def __init__(
        self,
        system: DiscreteSystem,
        *,
        measure: Measured,
        noise: Spread,
        process: Spread | Callable[[Array], Array],
        x: Stated,
        spread: Spread = 1.0,
        kind: FilterKind = "extended",
    ) -> None:
        require_instance(system, "system", DiscreteSystem, "such as a MidpointSystem")
        as_choice(kind, "kind", get_args(FilterKind))
        self.system, self.kind = system, kind
        self.readings = Readings(system, measure)
        self.V = covariance(noise, self.readings.names, "noise", definite=True)
        self._process = process if callable(process) else None
        self.W = np.zeros((system.ndx,) * 2) if callable(process) else covariance_of_states(process, system, "process")
        self.x = system.state_given(x).copy()
        self.P = self._tangent(covariance_of_states(spread, system, "spread"))
        self.k = 0
        self.innovation, self.surprise = np.zeros(self.readings.ny), np.nan
        self.A = np.eye(system.ndx)  # of the last step

    # ---- One step after the other -------------------------------------------------------------------

    def predict(self, u: ArrayLike) -> Array:
        """Go on over one step under inputs u (nu,); return the estimate (nx,) at its end.

        Raises
        ------
        ArgumentError
            A wrong shape.
        StepError
            The system has no such step from the estimate.
        """
        u = of_an_instant(u, "u", self.system.input_names)
        k = step_of(self.system, self.k)
        if self._process is not None:
            self.W = as_array(self._process(read_only(self.x)), "process(x)", self.P.shape, meaning="(ndx, ndx)")
        if self.kind == "extended":
            self.A = np.asarray(self.system.derivatives(self.x, u, k)[0])
            self.x = np.asarray(self.system.f(self.x, u, k)).copy()
            P = self.A @ self.P @ self.A.T
        else:
            P = self._predict_points(u, k)
        self.P = _symmetric(P + self._tangent(self.W))
        self.k += 1
        return self.x

    def correct(self, y: ArrayLike) -> Array:
        """Make use of readings y (ny,) of the state now, return the estimate (nx,).

        Raises
        ------
        ArgumentError
            A wrong shape, or readings that are not finite: leave out what was not read by not calling this.
        """
        y = self.readings.given(y, self.x, self.k)
        if self.kind == "extended":
            C = self.readings.jacobian(self.x, self.k)
            expected, cross, S = self.readings(self.x, self.k), self.P @ C.T, C @ self.P @ C.T + self.V
        else:
            expected, cross, S = self._expect_points()
        self.innovation = y - expected
        L = np.linalg.solve(S, cross.T).T
        self.surprise = float(self.innovation @ np.linalg.solve(S, self.innovation))
        if self.kind == "extended":
            rest = np.eye(len(self.P)) - L @ C
            self.P = _symmetric(rest @ self.P @ rest.T + L @ self.V @ L.T)
        else:
            self.P = _symmetric(self.P - L @ S @ L.T)
        self.x = self.system.moved_start(self.x, L @ self.innovation)
        return self.x

    # ---- A whole record -----------------------------------------------------------------------------

    def run(self, y: ArrayLike, u: ArrayLike) -> Estimate:
        """Go through readings y (N+1, ny) and the inputs u (N, nu) between them.

        Raises
        ------
        ArgumentError
            Wrong shapes.
        StepError
            The system has no step from an estimate.
        """
        u = as_array(u, "u", (None, self.system.nu), meaning="(N, nu)", names=self.system.input_names)
        N, nx, ndx, ny = len(u), self.system.nx, self.system.ndx, self.readings.ny
        y = as_array(y, "y", (N + 1, ny), meaning="(N+1, ny)", names=self.readings.names)
        x, x_predicted = np.empty((N + 1, nx)), np.empty((N + 1, nx))
        P, P_predicted, A = np.empty((N + 1, ndx, ndx)), np.empty((N + 1, ndx, ndx)), np.empty((N, ndx, ndx))
        e, surprise, first = np.empty((N + 1, ny)), np.empty(N + 1), self.k
        for k in range(N + 1):
            if k > 0:
                self.predict(u[k - 1])
                A[k - 1] = self.A
            x_predicted[k], P_predicted[k] = self.x, self.P
            self.correct(y[k])
            x[k], P[k], e[k], surprise[k] = self.x, self.P, self.innovation, self.surprise
        t = _times(self.system, first, N)
        return Estimate(*(read_only(each) for each in (t, x, P, e, surprise, x_predicted, P_predicted, A)))

    # ---- In the tangent space -----------------------------------------------------------------------

    def _tangent(self, spread: Array) -> Array:
        """Return a covariance in the directions in which the state can move from the estimate."""
        Z = self.system.start_directions(self.x, None)
        if Z.shape[1] == len(Z):
            return spread
        basis = np.linalg.qr(Z)[0]
        onto = basis @ basis.T
        return np.asarray(onto @ spread @ onto)

    def _points(self) -> tuple[Array, Array]:
        """Return 2 n states (2n, nx) about the estimate, that have its covariance, and their differences from it."""
        values, vectors = np.linalg.eigh(self.P)
        real = values > 1e-14 * max(float(values[-1]), np.finfo(np.float64).tiny)
        away = (vectors[:, real] * np.sqrt(real.sum() * values[real])).T
        away = np.concatenate([away, -away])
        states = np.array([self.system.moved_start(self.x, each) for each in away]).reshape(-1, len(self.x))
        return states, away

    def _predict_points(self, u: Array, k: int) -> Array:
        states, away = self._points()
        before, P = self.P, np.zeros_like(self.P)
        if not len(states):
            self.x = np.asarray(self.system.f(self.x, u, k)).copy()
            return P
        ends = np.array([self.system.f(state, u, k) for state in states])
        at = np.asarray(self.system.f(self.x, u, k))
        off = np.array([self.system.difference(end, at) for end in ends])
        mean = off.mean(axis=0)
        self.x = self.system.moved_start(at, mean)
        off = off - mean
        # What smoothing takes for the derivative of the step: the regression of its ends on its starts.
        self.A = off.T @ away / len(away) @ np.linalg.pinv(before, rcond=1e-12, hermitian=True)
        return np.asarray(off.T @ off / len(off))

    def _expect_points(self) -> tuple[Array, Array, Array]:
        """Return the readings that are expected, their covariance with the state, and their own."""
        states, away = self._points()
        if not len(states):
            return self.readings(self.x, self.k), np.zeros((len(self.P), self.readings.ny)), self.V
        read = np.array([self.readings(state, self.k) for state in states])
        mean = read.mean(axis=0)
        off = read - mean
        return mean, away.T @ off / len(off), off.T @ off / len(off) + self.V


def _symmetric(P: Array) -> Array:
    return 0.5 * (P + P.T)


def _times(system: DiscreteSystem, first: int, N: int) -> Array:
    """Return the times of instants from one on; those after the horizon go on as its last step."""
    times, last = system.times, system.N
    dt = times[-1] - times[-2]
    k = np.arange(first, first + N + 1)
    return np.asarray(np.where(k <= last, times[np.minimum(k, last)], times[-1] + (k - last) * dt))


def check_estimator(estimator: object) -> None:
    """Complain about what cannot be asked for an estimate."""
    if not all(callable(getattr(estimator, name, None)) for name in ("predict", "correct")):
        raise ArgumentError(
            f"estimator: got {type(estimator).__name__}, expected a KalmanFilter, or what has `predict(u)`, "
            "`correct(y)` and `x`"
        )
