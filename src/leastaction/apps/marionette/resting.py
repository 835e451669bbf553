"""What strings can hold: for instants of a motion, the pose nearest to the wanted one in which the puppet can rest.

At rest, tensions T and gravity balance: ``-V_q(q) + f(q, T) = 0`` over the body's variables. Of the poses in which they
do, with the tensions and the places of the upper ends within their limits, the one of least tracking cost is sought, by
sequential quadratic programming in variables scaled by their weights. What a slow motion is off by is this error: it
tells what the strings' table cannot hold from what is too fast.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize

from leastaction.apps.marionette.markers import LIMB_MARKERS, MARKERS
from leastaction.apps.marionette.tracking.found import TrackingRun, held_error
from leastaction.apps.marionette.tracking.limits import PuppetLimits
from leastaction.apps.marionette.tracking.plan import Plan
from leastaction.apps.marionette.tracking.problem import ROOT, TrackingProblem
from leastaction.apps.marionette.tracking.weights import FORCED, TrackingWeights
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import freeze_arrays, restore_state, saved_state
from leastaction.viz.figures import BLUE, ORANGE, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BALANCED = 1e-4  # N or N m, to which forces balance
_DIGITS, _STEPS = 1e-7, 100  # of the cost, and of the search for a pose


@dataclass(frozen=True, kw_only=True)
class RestingPoses:
    """The poses nearest to a wanted motion in which the puppet can rest on its strings. Frozen: threads may share it.

    Attributes
    ----------
    t : ndarray (n,)
        Instants (s) for which one was found.
    wanted, q : ndarray (n, nq)
        The wanted configurations, and these, with the strings' upper ends and lengths.
    tension : ndarray (n, strings)
        What holds them (N), in the order of the constraints.
    error : float
        Root mean square (degrees) of the joints that strings hold.
    missing : int
        Instants for which none was found.
    markers : float
        Of a run that follows markers: how far these are off, root mean square (m).
    """

    t: Array = field(repr=False)
    wanted: Array = field(repr=False)
    q: Array = field(repr=False)
    tension: Array = field(repr=False)
    error: float
    missing: int
    markers: float = np.nan

    __getstate__, __setstate__ = saved_state, restore_state

    def __post_init__(self) -> None:
        freeze_arrays(self)


def resting(
    run: TrackingRun,
    *,
    limits: PuppetLimits | None = None,
    weights: TrackingWeights = FORCED,
    instants: int = 24,
) -> RestingPoses:
    """Return the poses nearest to what a run was asked to follow in which the puppet can rest.

    Parameters
    ----------
    run : TrackingRun
    limits : PuppetLimits, optional
        Those of tensions, joints and reach are kept to; the run's if not given.
    weights : TrackingWeights, optional
        How far from the wanted pose is.
    instants : int, optional
        How many poses, evenly over the motion.

    Returns
    -------
    RestingPoses
        Minima near the pose before, the wanted one, and that of the run, the best of them: no proof that there is none
        that is nearer.

    Raises
    ------
    ArgumentError
        Less than one instant.
    """
    if instants < 1:
        raise ArgumentError(f"instants: got {instants}, expected 1 or more")
    limits = limits or run.limits or PuppetLimits()
    plan = Plan(TrackingProblem(run.mechanism, run.motion, weights, 1, run.follow), weights, limits)
    search = _Search(plan)
    last = len(plan.t) - 1
    made = np.stack([run.trajectory[name] for name in plan.mechanism.variables], axis=1)
    pulls = np.vstack([run.tension, run.tension[-1:]])
    found: list[tuple[int, Array]] = []
    chosen = np.unique(np.linspace(0, last, instants).astype(int))
    for k in chosen:
        wanted = search.wanted(k)
        starts = [wanted, np.concatenate([made[k], pulls[k]]), *(pose for _, pose in found[-1:])]
        best = min((search.nearest(k, start) for start in starts), key=lambda each: each[0])
        if np.isfinite(best[0]):
            found.append((int(k), best[1]))
    at = np.array([k for k, _ in found], dtype=int)
    poses = np.array([pose for _, pose in found]).reshape(len(found), len(search.scale))
    q = run.reference[at]
    q[:, search.columns] = poses[:, : plan.mechanism.nq]
    places = (
        run.mechanism.positions(q, names) for names in zip(*((s.hook, s.control) for s in plan.strings), strict=True)
    )
    q[:, [run.mechanism.variables.index(s.length) for s in plan.strings]] = np.linalg.norm(np.subtract(*places), axis=2)
    return RestingPoses(
        t=plan.t[at],
        wanted=run.reference[at],
        q=q,
        tension=poses[:, plan.mechanism.nq :].copy(),
        error=held_error(run.mechanism, run.reference[at], q) if found else np.nan,
        missing=len(chosen) - len(found),
        markers=float(np.sqrt(np.mean(run.markers_apart(q, at) ** 2))) if found and run.follow == "markers" else np.nan,
    )


class _Search:
    """Poses at rest, each with its tensions behind."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.mechanism = plan, plan.mechanism
        cost, strings = plan.tracking_cost(), len(plan.strings)
        Q, R, _, _ = cost.cost.hessian(plan.x_reference, plan.u_reference)
        self.scale = np.sqrt(np.concatenate([Q[: self.mechanism.nq], R[:strings]]))
        self.still = np.zeros(self.mechanism.nq)
        places = plan.problem.mechanism.variables
        self.columns = [places.index(name) for name in self.mechanism.variables]
        self.lengths = [places.index(string.length) for string in plan.strings]
        self.joined = [string.hook for string in plan.strings], [string.control for string in plan.strings]

    def wanted(self, k: int) -> Array:
        """Return the pose that is wanted at an instant, with the tensions that carry the puppet at the start."""
        return np.concatenate([self.plan.x_reference[k, : self.mechanism.nq], self.plan.tension])

    def net(self, pose: Array) -> Array:
        """Return the net forces (nd,) on the body."""
        m, (q, pull) = self.mechanism, np.split(pose, [self.mechanism.nq])
        return np.asarray((m.core.gradient(q, self.still)[0] + m.core.force(q, self.still, pull))[: m.nd])

    def net_derivative(self, pose: Array) -> Array:
        """Return their derivative (nd, nq + strings)."""
        m, (q, pull) = self.mechanism, np.split(pose, [self.mechanism.nq])
        by_q, _, by_pull = m.core.force_jacobians(q, self.still, pull)
        return np.hstack([m.core.hessian(q, self.still)[0][: m.nd] + by_q[: m.nd], by_pull[: m.nd]])

    def markers_off(self, pose: Array, k: int) -> tuple[float, Array]:
        """Return what it costs that markers are not where instant k wants them, and its slope (nq + strings,)."""
        value, slope, problem = 0.0, np.zeros(len(pose)), self.plan.problem
        if problem.follow == "joints" or problem.markers is None:
            return value, slope
        q = np.ascontiguousarray(pose[: self.mechanism.nq])
        for i, frame in enumerate(LIMB_MARKERS.values(), start=1):
            apart = self.mechanism.frame_pose(q, frame)[:3, 3] - problem.markers[k, i]
            value += 0.5 * self.plan.weights.marker * float(apart @ apart)
            slope[: len(q)] += self.plan.weights.marker * apart @ self.mechanism.frame_jacobian(q, frame)[:3]
        return value, slope

    def nearest(self, k: int, start: Array) -> tuple[float, Array]:
        """Return what a pose at rest costs at instant k, and the pose; infinity where none was found from a start."""
        wanted = self.wanted(k)
        m, limits, scale = self.mechanism, self.plan.limits, self.scale
        least, most = np.full(len(wanted), -np.inf), np.full(len(wanted), np.inf)
        least[m.nq :] = limits.tension
        least[m.nd : m.nq], most[m.nd : m.nq] = wanted[m.nd : m.nq] - limits.reach, wanted[m.nd : m.nq] + limits.reach
        for name, bounds in limits.joints.items():
            i = m.variables.index(name)
            least[i], most[i] = bounds
        goal = wanted * scale

        def cost(z: Array) -> tuple[float, Array]:
            value, slope = self.markers_off(z / scale, k)
            return value + 0.5 * float(np.sum((z - goal) ** 2)), slope / scale + z - goal

        with warnings.catch_warnings():
            # Older versions of SciPy tell of a step past a bound by rounding, which they take back.
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            done = minimize(
                cost,
                np.clip(start, least, most) * scale,
                jac=True,
                bounds=np.stack([least * scale, most * scale], axis=1),
                constraints={
                    "type": "eq",
                    "fun": lambda z: self.net(z / scale),
                    "jac": lambda z: self.net_derivative(z / scale) / scale,
                },
                method="SLSQP",
                options={"ftol": _DIGITS, "maxiter": _STEPS},
            )
        pose = done.x / scale
        balanced = np.isfinite(pose).all() and float(np.abs(self.net(pose)).max()) < _BALANCED
        return (float(done.fun), pose) if balanced else (np.inf, pose)


@styled
def plot_resting(run: TrackingRun, rest: RestingPoses) -> Figure:
    """Draw the error of every joint, or marker, as a run made it and in the nearest poses at rest, and both over time.

    ``rest``: from `resting`.
    """
    if run.follow == "markers":
        labels, unit, what = [name.replace("_", " ") for name in MARKERS], "mm", "all markers"
        made = 1e3 * run.markers_apart()
        apart = 1e3 * run.markers_apart(rest.q, np.searchsorted(run.trajectory.t, rest.t - 1e-9))
    else:
        joints = [i for i, name in enumerate(run.mechanism.dynamic) if name not in ROOT]
        labels, unit, what = [run.mechanism.dynamic[i] for i in joints], "degrees", "all joints"
        made = np.rad2deg(run.trajectory.q - run.reference)[:, joints]
        apart = np.rad2deg(rest.q - rest.wanted)[:, joints]
    figure = new_figure(9.0, 5.0)
    bars, over_time = figure.subplots(1, 2)
    for shift, errors, color, label in ((-0.2, made, BLUE, "as made"), (0.2, apart, ORANGE, "nearest poses at rest")):
        bars.barh(np.arange(len(labels)) + shift, np.sqrt(np.mean(errors**2, axis=0)), 0.4, color=color, label=label)
    bars.set_yticks(range(len(labels)), labels, fontsize=8)
    bars.invert_yaxis()
    bars.set(xlabel=f"off by ({unit}, rms)")
    bars.legend(frameon=False, fontsize=8)
    over_time.plot(run.trajectory.t, np.sqrt(np.mean(made**2, axis=1)), color=BLUE)
    over_time.plot(rest.t, np.sqrt(np.mean(apart**2, axis=1)), "o-", color=ORANGE, markersize=3)
    over_time.set(xlabel="time (s)", ylabel=f"{what} off by ({unit}, rms)", ylim=(0.0, None))
    return figure
