"""The main job: a marionette learns to follow a wanted motion.

The wanted motion gives the body's variables only. `track` guesses the strings that go with it, finds a first
trajectory that the puppet can make, and improves it with `leastaction.optimal.optimize`.

The first trajectory is what the puppet does when its strings simply hang above the wanted hooks. Where that
goes wrong, because the motion is fast or the strings lose their grip on a stretched limb, it is found by
*dynamic embedding* (dissertation 6.6.1): every joint gets a motor, with which any motion can be followed;
the motors are made ever more expensive until they do nothing, and are then taken away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError, closest
from leastaction.mechanics import JointForce, Mechanism, MidpointVI, SimulationStatus
from leastaction.models.marionette import STRINGS, UNHELD, hang_strings
from leastaction.optimal import (
    CostGradient,
    CostHessian,
    OptimizationResult,
    QuadraticCost,
    optimize,
)
from leastaction.optimal.optimize import Callback
from leastaction.systems import MidpointSystem

Array = npt.NDArray[np.float64]

_ROOT = ("torso_tx", "torso_ty", "torso_tz")
_SLANT = 1.0  # m that slanted strings lean ahead
_GOOD_START_ANGLE = np.deg2rad(15.0)  # largest rms error of a held joint in a first trajectory
_GOOD_START_DISTANCE = 0.15  # m, the same for the pelvis
# Price of a motor's square, and the iterations at that price.
_EMBEDDING = (
    (1e-6, 3),
    (1e-5, 3),
    (1e-4, 4),
    (1e-3, 6),
    (1e-2, 8),
    (1e-1, 8),
    (1.0, 8),
    (10.0, 8),
)
# Parts of the final price of tension, and the iterations at that price, on the way there.
_TENSION_STAGES = ((0.0, 15), (0.001, 15), (0.01, 15), (0.1, 15))


class WantedMotion(Protocol):
    """What `track` needs to know of a motion: times, names and one column a name."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""

    @property
    def t(self) -> Array:
        """Times (s), shape (N+1,)."""

    @property
    def q(self) -> Array:
        """Values, shape (N+1, len(names))."""


@dataclass(frozen=True, kw_only=True)
class TrackingWeights:
    """Weights of the tracking cost; each multiplies half the square of an error.

    Attributes
    ----------
    joint : float
        Angle of a joint (1/rad^2).
    unheld : float
        Angle of a joint behind which no string is tied, `UNHELD` (1/rad^2).
    root : float
        Position of the pelvis (1/m^2).
    rate : float
        Velocity of every body variable, measured by its momentum and inertia (s^2/rad^2 or s^2/m^2).
    string : float
        Place of a string's upper end and its length, about the guess that goes with the motion (1/m^2).
    string_acceleration : float
        Acceleration of the same: keeps the hand that holds the strings calm (s^4/m^2).
    tension : float
        Tension of a string about what it bears at rest (1/N^2).
    """

    joint: float = 1.0
    unheld: float = 1.0
    root: float = 10.0
    rate: float = 1e-4
    string: float = 1e-3
    string_acceleration: float = 1e-6
    tension: float = 1e-7

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0):
                raise ArgumentError(f"weights: {name} is {value}, expected a finite number >= 0")
        if self.string <= 0.0:
            raise ArgumentError(
                "weights: string is 0, expected a positive weight: without one nothing says where the "
                "strings should be"
            )


GENTLE = TrackingWeights()
"""For a motion that the puppet nearly makes by itself: all joints count, the strings go where they like."""

FORCED = TrackingWeights(unheld=0.01, string=0.1, string_acceleration=1e-5, tension=1e-6)
"""For a motion that it must be made to do: what no string holds may swing, and the strings of the limbs keep
their slant, without which they would lose their grip."""


@dataclass(frozen=True)
class TrackingRun:
    """A motion of the marionette, and what it was asked to do.

    Attributes
    ----------
    mechanism : Mechanism
    t : ndarray, shape (N+1,)
        Times (s).
    q, p : ndarray, shape (N+1, nq) and (N+1, nd)
        Configurations and momenta.
    u : ndarray, shape (N, nrho)
        Inputs: the string variables at the ends of the steps.
    lam : ndarray, shape (N, nc)
        Multipliers.
    tension : ndarray, shape (N, nc)
        String tensions (N), in the order of the constraints.
    wanted : ndarray, shape (N+1, nq)
        The wanted configurations, with the strings that were guessed for them.
    embedded : bool
        Whether the first trajectory was found by dynamic embedding.
    result : OptimizationResult
        Of the optimiser; its states are ``[q; rho; p; v_rho; lam]``.
    """

    mechanism: Mechanism = field(repr=False)
    t: Array = field(repr=False)
    q: Array = field(repr=False)
    p: Array = field(repr=False)
    u: Array = field(repr=False)
    lam: Array = field(repr=False)
    tension: Array = field(repr=False)
    wanted: Array = field(repr=False)
    embedded: bool
    result: OptimizationResult

    def errors_in_degrees(self) -> dict[str, tuple[float, float]]:
        """Return the (rms, largest) tracking error of every joint angle, in degrees, by name."""
        error = np.rad2deg(self.q - self.wanted)
        return {
            name: (float(np.sqrt(np.mean(error[:, i] ** 2))), float(np.max(np.abs(error[:, i]))))
            for i, name in enumerate(self.mechanism.dynamic)
            if name not in _ROOT
        }


class TrackingCost(QuadraticCost):
    """Quadratic tracking cost with a price on the acceleration of the kinematic variables.

    The acceleration over a step is ``((rho_next - rho)/dt - v_rho)/dt``: linear in state and input, so the
    cost stays quadratic.

    Parameters
    ----------
    x_wanted, u_wanted, Q, R
        As in `QuadraticCost`; Q and R diagonal.
    dt : float
        Time step (s).
    rho, v_rho, rho_next : slice
        Where these are in the state and in the input.
    acceleration : float
        Weight of half the squared acceleration.
    """

    def __init__(
        self,
        x_wanted: Array,
        u_wanted: Array,
        *,
        Q: Array,
        R: Array,
        dt: float,
        rho: slice,
        v_rho: slice,
        rho_next: slice,
        acceleration: float,
    ) -> None:
        super().__init__(x_wanted, u_wanted, Q=Q, R=R)
        nx, nu = len(Q), len(R)
        count = rho.stop - rho.start
        a_x, a_u = np.zeros((count, nx)), np.zeros((count, nu))
        diagonal = np.arange(count)
        a_x[diagonal, rho.start + diagonal] = -1.0 / dt**2
        a_x[diagonal, v_rho.start + diagonal] = -1.0 / dt
        a_u[diagonal, rho_next.start + diagonal] = 1.0 / dt**2
        self._dt, self._rho, self._v_rho, self._rho_next = dt, rho, v_rho, rho_next
        self._weight = acceleration
        self._hessian = CostHessian(
            np.diag(Q) + acceleration * a_x.T @ a_x,
            np.diag(R) + acceleration * a_u.T @ a_u,
            acceleration * a_x.T @ a_u,
            self.Q_final,
        )

    def stage_values(self, x: Array, u: Array, start: int) -> Array:
        """Return the costs (n,) of steps from `start` on."""
        squares = np.sum(self._acceleration(x, u) ** 2, axis=1)
        return np.asarray(super().stage_values(x, u, start) + 0.5 * self._weight * squares)

    def gradient(self, x: Array, u: Array) -> CostGradient:
        """Return the first derivatives along a trajectory."""
        tracking = super().gradient(x, u)
        slope = self._weight * self._acceleration(x[:-1], u)
        q, r = tracking.q.copy(), tracking.r.copy()
        q[:, self._rho] -= slope / self._dt**2
        q[:, self._v_rho] -= slope / self._dt
        r[:, self._rho_next] += slope / self._dt**2
        return CostGradient(q, r, tracking.q_final)

    def hessian(self, x: Array, u: Array) -> CostHessian:  # noqa: ARG002
        """Return the second derivatives, the same along every trajectory."""
        return self._hessian

    def _acceleration(self, x: Array, u: Array) -> Array:
        velocity = (u[:, self._rho_next] - x[:, self._rho]) / self._dt
        return np.asarray((velocity - x[:, self._v_rho]) / self._dt)


def track(
    mechanism: Mechanism,
    motion: WantedMotion,
    *,
    weights: TrackingWeights | None = None,
    method: str = "auto",
    max_iterations: int = 100,
    tolerance: float | None = None,
    callback: Callback | None = None,
    progress: Callable[[str], None] | None = None,
    resume: OptimizationResult | None = None,
    threads: int = 0,
) -> TrackingRun:
    """Find the motion of the marionette that follows a wanted one best, with its strings and gains.

    Parameters
    ----------
    mechanism : Mechanism
        From `leastaction.models.marionette.marionette`.
    motion : WantedMotion
        Wanted values of all body variables, equidistant in time. It need not be possible.
    weights : TrackingWeights, optional
        What matters how much. If not given, `GENTLE` where the hanging strings give a good first
        trajectory, else `FORCED`.
    method, max_iterations, callback, resume
        As in `leastaction.optimal.optimize`, for the last optimisation.
    tolerance : float, optional
        Likewise. If not given, 1e-6, or 1e-4 where the first trajectory had to be found by embedding:
        such a motion is far from what the puppet does by itself, and its last digits cost much.
    progress : callable, optional
        Called with a line of text as the search for a first trajectory goes on.
    threads : int, optional
        Threads for derivatives; 0: as many as there are cores.

    Returns
    -------
    TrackingRun

    Raises
    ------
    ArgumentError
        If the motion does not name the variables, is too short, or no first trajectory is found.
    """
    problem = _Problem(mechanism, motion, weights or GENTLE, threads)
    initial = problem.hang()
    embedded = initial is None
    if embedded:
        problem = _Problem(mechanism, motion, weights or FORCED, threads, ahead=_SLANT)
    if resume is not None:
        initial = None
    elif initial is None:
        initial = problem.embed(progress or (lambda _: None))
    result = optimize(
        problem.system,
        problem.cost(problem.weights.tension),
        initial=initial,
        resume=resume,
        method=method,  # type: ignore[arg-type]
        max_iterations=max_iterations,
        tolerance=tolerance or (1e-4 if embedded else 1e-6),
        callback=callback,
    )
    trajectory = problem.system.trajectory(result.x, result.u)
    named = trajectory.tensions()
    tension = np.stack([named[name] for name in mechanism.constraints], axis=1)
    tension[0] *= 2.0  # the first impulse is that of half a step, see Trajectory.tensions
    return TrackingRun(
        mechanism,
        trajectory.t,
        trajectory.q,
        trajectory.p,
        result.u,
        trajectory.lam,
        tension,
        problem.wanted,
        embedded,
        result,
    )


class _Problem:
    """The tracking problem of one motion: wanted states, systems and costs."""

    def __init__(
        self,
        mechanism: Mechanism,
        motion: WantedMotion,
        weights: TrackingWeights,
        threads: int,
        *,
        ahead: float = 0.0,
    ) -> None:
        self.mechanism, self.weights, self.threads = mechanism, weights, threads
        self.t = np.ascontiguousarray(motion.t, dtype=np.float64)
        self.body = _columns(mechanism, motion)
        self.dt = float(self.t[1] - self.t[0])
        self.integrator = MidpointVI(mechanism, threads=threads)
        self.system = MidpointSystem(self.integrator, self.t, multipliers=True)
        self._want(ahead)

    def hang(self) -> tuple[Array, Array] | None:
        """Return what the puppet does under hanging strings, or None where that is no good start."""
        m = self.mechanism
        run = self.integrator.simulate(
            self.integrator.start(self.wanted[0]), self.t, rho=self.wanted[:, m.nd :]
        )
        if run.status is not SimulationStatus.COMPLETED:
            return None
        rms = np.sqrt(np.mean((run.q - self.wanted)[:, : m.nd] ** 2, axis=0))
        far = [
            error > (_GOOD_START_DISTANCE if name in _ROOT else _GOOD_START_ANGLE)
            for name, error in zip(m.dynamic, rms, strict=True)
            if name not in UNHELD
        ]
        if any(far):
            return None
        x = np.vstack([self.x_wanted[:1], np.hstack([run.x[1:], run.lam])])
        return x, run.u

    def embed(self, say: Callable[[str], None]) -> tuple[Array, Array]:
        """Return a first trajectory found with motors on all joints that become ever more expensive."""
        m = self.mechanism
        motors = [JointForce(name, f"motor of {name}") for name in m.dynamic]
        helped = MidpointVI(m.with_elements(motors), threads=self.threads)
        system = MidpointSystem(helped, self.t, multipliers=True)
        x, u = (
            self.x_wanted,
            np.hstack([np.zeros((len(self.t) - 1, m.nd)), self.wanted[1:, m.nd :]]),
        )
        for price, iterations in _EMBEDDING:
            result = optimize(
                system,
                self.cost(0.0, motor=price),
                initial=(x, u),
                method="quasi-newton",
                max_iterations=iterations,
                tolerance=1e-2,
            )
            x, u = result.x, result.u
            effort = float(np.max(np.sqrt(np.mean(u[:, : m.nd] ** 2, axis=0))))
            say(f"motors at price {price:g}: the strongest gives {effort:.2g} N or N m (rms)")
        u = np.ascontiguousarray(u[:, m.nd :])
        for part, iterations in _TENSION_STAGES:
            result = optimize(
                self.system,
                self.cost(part * self.weights.tension),
                initial=(x, u),
                max_iterations=iterations,
                tolerance=1e-4,
            )
            x, u = result.x, result.u
            say(f"without motors, tension at {part:.0%} of its price: cost {result.cost:.4g}")
        return x, u

    def cost(self, tension: float, *, motor: float | None = None) -> TrackingCost:
        """Return the cost at a price of tension; with motors as further inputs if they have a price."""
        m, w = self.mechanism, self.weights
        inertia = np.diag(m.mass_matrix(self.wanted[0]))[: m.nd]
        body = np.array(
            [w.root if n in _ROOT else w.unheld if n in UNHELD else w.joint for n in m.dynamic]
        )
        rate = w.rate * np.array([w.unheld if n in UNHELD else 1.0 for n in m.dynamic]) / inertia**2
        # lam is an impulse for |p1 - p2|^2 - L^2: a newton of tension is dt / (2 L) of it.
        lengths = self.wanted[0, [m.variables.index(s.length) for s in STRINGS]]
        pull = tension * (2.0 * lengths / self.dt) ** 2
        Q = np.concatenate([body, np.full(m.nrho, w.string), rate, np.zeros(m.nrho), pull])
        R = np.full(m.nrho, 0.01 * w.string)
        u_wanted = self.wanted[1:, m.nd :]
        motors = 0
        if motor is not None:
            motors = m.nd
            R = np.concatenate([np.full(motors, motor), R])
            u_wanted = np.hstack([np.zeros((len(u_wanted), motors)), u_wanted])
        return TrackingCost(
            self.x_wanted,
            u_wanted,
            Q=Q,
            R=R,
            dt=self.dt,
            rho=slice(m.nd, m.nq),
            v_rho=slice(m.nq + m.nd, m.nx),
            rho_next=slice(motors, motors + m.nrho),
            acceleration=w.string_acceleration,
        )

    def _want(self, ahead: float) -> None:
        """Set the wanted configurations and states, with strings that go with the body's motion."""
        m, N = self.mechanism, len(self.t) - 1
        q = np.zeros((N + 1, m.nq))
        q[:, : m.nd] = self.body
        self.wanted = hang_strings(m, q, ahead=ahead)
        v = np.gradient(self.wanted, self.t, axis=0)
        start = self.integrator.start(self.wanted[0])
        x = np.zeros((N + 1, self.system.nx))
        x[:, : m.nq] = self.wanted
        x[:, m.nq : m.nq + m.nd] = [
            m.momentum(a, b)[: m.nd] for a, b in zip(self.wanted, v, strict=True)
        ]
        x[1:, m.nq + m.nd : m.nx] = np.diff(self.wanted[:, m.nd :], axis=0) / self.dt
        x[0, : m.nx] = start.x
        x[:, m.nx :] = self._tension_at_rest()
        self.x_wanted = x

    def _tension_at_rest(self) -> Array:
        """Return the multipliers (nc,) with which the strings carry the puppet as it hangs at the start."""
        m = self.mechanism
        q = hang_strings(m, self.wanted[0])
        weight = -m.core.gradient(q, np.zeros(m.nq))[0][: m.nd]
        # Statics: gravity is carried by the constraints as well as they can, with the least forces.
        columns = -m.constraint_jacobian(q)[:, : m.nd].T / self.dt
        return np.asarray(np.linalg.lstsq(columns, weight, rcond=1e-6)[0])


def _columns(mechanism: Mechanism, motion: WantedMotion) -> Array:
    """Return the motion's columns in the order of the mechanism's dynamic variables, checked."""
    needed = {name for string in STRINGS for name in (string.x, string.y, string.length)}
    if not needed <= set(mechanism.kinematic):
        missing = ", ".join(sorted(needed - set(mechanism.kinematic))[:4])
        raise ArgumentError(
            f"track: the mechanism lacks the string variables {missing}, ...; expected the marionette of "
            "leastaction.models.marionette. For another mechanism use MidpointSystem and optimize"
        )
    for name in mechanism.dynamic:
        if name not in motion.names:
            raise ArgumentError(
                f"motion: no column for {name!r}; {closest(name, motion.names, what='columns')}"
            )
    t = np.asarray(motion.t, dtype=np.float64)
    q = np.asarray(motion.q, dtype=np.float64)
    if t.ndim != 1 or len(t) < 3 or q.shape != (len(t), len(motion.names)):
        raise ArgumentError(
            f"motion: got t of shape {t.shape} and q of shape {q.shape}, expected (N+1,) and "
            f"(N+1, {len(motion.names)}) with N >= 2"
        )
    if not (np.all(np.isfinite(t)) and np.all(np.isfinite(q))):
        raise ArgumentError("motion: times and values must be finite")
    steps = np.diff(t)
    if np.any(steps <= 0.0) or np.ptp(steps) > 1e-6 * steps[0]:
        raise ArgumentError(
            "motion: times must increase in equal steps; use Motion.resample(dt) to make them so"
        )
    return q[:, [motion.names.index(name) for name in mechanism.dynamic]]
