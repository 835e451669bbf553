"""What strings can hold: for instants of a motion, the pose nearest to the wanted one in which the puppet can rest.

They are found by `PoseSearch`. What a slow motion is off by is this error: it tells what the strings' table cannot hold
from what is too fast.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.models.marionette import held_strings, string_lengths
from leastaction.numerics import Array, Frozen
from leastaction.viz import BLUE, ORANGE, new_figure, styled
from leastaction_marionette.markers import MARKERS
from leastaction_marionette.tracking.found import TrackingRun, held_error
from leastaction_marionette.tracking.limits import PuppetLimits
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.tracking.poses import PoseSearch
from leastaction_marionette.tracking.problem import ROOT, TrackingProblem
from leastaction_marionette.tracking.weights import FORCED, TrackingWeights
from leastaction_marionette.turns import differences

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class RestingPoses(Frozen):
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
        Minima near the pose before, the wanted one, that of the run, and one on the way to the pose of rest, the best
        of them: no proof that there is none that is nearer.

    Raises
    ------
    ArgumentError
        Less than one instant.
    """
    if instants < 1:
        raise ArgumentError(f"instants: got {instants}, expected 1 or more")
    limits = limits or run.limits
    plan = TrackingPlan(TrackingProblem(run.mechanism, run.motion, weights, limits, follow=run.follow, threads=1))
    search = PoseSearch(plan)
    last = len(plan.t) - 1
    made = np.stack([run.trajectory[name] for name in plan.mechanism.coordinates], axis=1)
    pulls = np.vstack([run.tension, run.tension[-1:]])
    found: list[tuple[int, Array]] = []
    chosen = np.unique(np.linspace(0, last, instants).astype(int))
    for k in chosen:
        wanted = search.wanted(k)
        starts = [wanted, np.concatenate([made[k], pulls[k]]), *(pose for _, pose in found[-1:])]
        best = search.best(int(k), starts)
        if np.isfinite(best[0]):
            found.append((int(k), best[1]))
    at = np.array([k for k, _ in found], dtype=int)
    poses = np.array([pose for _, pose in found]).reshape(len(found), plan.mechanism.nq + len(plan.strings))
    q = run.reference[at]
    q[:, search.columns] = poses[:, : plan.mechanism.nq]
    lengths = string_lengths(run.mechanism, q)
    held = held_strings(run.mechanism)
    q[:, [run.mechanism.coordinates.index(s.length) for s in held]] = lengths[:, [plan.strings.index(s) for s in held]]
    return RestingPoses(
        t=plan.t[at],
        wanted=run.reference[at],
        q=q,
        tension=poses[:, plan.mechanism.nq :].copy(),
        error=held_error(run.mechanism, run.reference[at], q) if found else np.nan,
        missing=len(chosen) - len(found),
        markers=float(np.sqrt(np.mean(run.markers_apart(q, at) ** 2))) if found and run.follow == "markers" else np.nan,
    )


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
        made = np.rad2deg(differences(run.mechanism, run.trajectory.q, run.reference))[:, joints]
        apart = np.rad2deg(differences(run.mechanism, rest.q, rest.wanted))[:, joints]
    figure = new_figure(9.0, 5.0)
    bars, over_time = figure.subplots(1, 2)
    for shift, errors, color, label in ((-0.2, made, BLUE, "as made"), (0.2, apart, ORANGE, "nearest poses at rest")):
        if len(errors):  # there may be no pose at rest
            rms = np.sqrt(np.mean(errors**2, axis=0))
            bars.barh(np.arange(len(labels)) + shift, rms, 0.4, color=color, label=label)
    bars.set_yticks(range(len(labels)), labels, fontsize=8)
    bars.invert_yaxis()
    bars.set(xlabel=f"off by ({unit}, rms)")
    bars.legend(frameon=False, fontsize=8)
    over_time.plot(run.trajectory.t, np.sqrt(np.mean(made**2, axis=1)), color=BLUE)
    over_time.plot(rest.t, np.sqrt(np.mean(apart**2, axis=1)), "o-", color=ORANGE, markersize=3)
    over_time.set(xlabel="time (s)", ylabel=f"{what} off by ({unit}, rms)", ylim=(0.0, None))
    return figure
