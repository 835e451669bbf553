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

import numpy as np

from leastaction.apps.marionette.tracking.cost import TrackingCost
from leastaction.apps.marionette.tracking.problem import ROOT, SLANT, Problem, WantedMotion
from leastaction.apps.marionette.tracking.weights import FORCED, GENTLE, TrackingWeights
from leastaction.mechanics import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.optimal import OptimizationResult, optimize
from leastaction.optimal.optimize import Callback

__all__ = [
    "FORCED",
    "GENTLE",
    "TrackingCost",
    "TrackingRun",
    "TrackingWeights",
    "WantedMotion",
    "track",
]


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
            if name not in ROOT
        }


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
    KeyboardInterrupt
        For Ctrl-C while a first trajectory is sought; later it ends the optimisation with what it has.
    ArgumentError
        If the motion does not name the variables, is too short, or no first trajectory is found.
    """
    problem = Problem(mechanism, motion, weights or GENTLE, threads)
    initial = problem.hang()
    embedded = initial is None
    if embedded:
        problem = Problem(mechanism, motion, weights or FORCED, threads, ahead=SLANT)
    if resume is not None:
        initial = None
    elif initial is None:
        initial = problem.embed(progress or (lambda _: None))
    result = optimize(  # type: ignore[call-overload]
        problem.system,
        problem.cost(problem.weights.tension),
        initial=initial,
        resume=resume,
        method=method,
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
