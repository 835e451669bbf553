"""Poses in which strings hold the puppet still.

At rest, tensions T and gravity balance: ``-V_q(q) + f(q, T) = 0`` over the body's variables. Of the poses in which they
do, with the tensions and the places of the upper ends within their limits, and strings on bars as long as they are
tied, the one of least tracking cost is sought, by sequential quadratic programming in variables scaled by their
weights.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from leastaction.errors import ArgumentError
from leastaction.models.marionette import REST, axes_of, hang_strings, heading, turns_of_angles
from leastaction.models.puppet_controls import ends_of
from leastaction.numerics import Array, one_thread
from leastaction.optimal import OptimizationResult, Status
from leastaction_marionette.markers import LIMB_MARKERS
from leastaction_marionette.tracking.plan import TrackingPlan
from leastaction_marionette.turns import body_of, differences, moved, on_the_way, turned, unit

_FIRM = 0.1  # N, by which strings that hold still pull more than they have to
_BALANCED = 1e-4  # N or N m, to which forces balance
_DIGITS, _STEPS = 1e-7, 300  # of the cost, and of the search for a pose
_NO_REST = (
    "strings: neither the motion nor a pose at rest is found in which all of them pull. Lower the least tension, allow "
    "what holds them more reach (bars: and tilt), or take more strings"
)
_HALFWAY, _SHARES = 0.5, (1.0, 0.75, 0.25)  # of the way to the pose at rest, where a search begins


class PoseSearch:
    """Poses at rest of a plan, each with its tensions behind. For one thread.

    ``tied``: whether strings on bars are as long as they are tied. ``more``: by how much tensions are above the least
    that limits allow (N).
    """

    def __init__(self, plan: TrackingPlan, *, tied: bool = True, more: float = 0.0) -> None:
        self.plan, self.mechanism, self.more = plan, plan.mechanism, more
        self.ties = plan.ties if tied else None
        cost, strings = plan.tracking_cost(), len(plan.strings)
        self.scale = np.sqrt(np.concatenate([cost.Q[: self.mechanism.nv], cost.R[:strings]]))
        self.still = np.zeros(self.mechanism.nv)
        places = plan.problem.mechanism.coordinates
        self.columns = [places.index(name) for name in self.mechanism.coordinates]

    def wanted(self, k: int | None) -> Array:
        """Return the pose that is wanted at an instant, with the tensions that carry the puppet at the start.

        ``k``: None for the mean of all instants, to which one pose for all of them is to be near.
        """
        return np.concatenate([self._of(self.plan.x_reference, k)[: self.mechanism.nq], self.plan.tension])

    def toward_rest(self, k: int | None, share: float) -> Array:
        """Return a pose between the wanted one of an instant and the puppet's at rest, upright under its strings.

        ``share``: 0 is the wanted pose but for its strings, 1 that at rest where the wanted one is and faces. From
        there a search often finds the pose that strings hold where it gets lost from the wanted one.
        """
        whole = self.plan.problem.mechanism
        q = self._of(self.plan.problem.reference, k)
        place = dict(zip(whole.coordinates[:3], q[:3], strict=True))
        rest: Mapping[str, Any] = {**REST, **place, "torso_rz": float(heading(whole, q))}
        if axes_of(whole) == "quaternion":
            rest = turns_of_angles(rest)
        body = whole.configuration(rest)[: whole.first_rho]
        q[: whole.first_rho] = on_the_way(body_of(whole), q[: whole.first_rho], body[None], share)[0]
        return np.concatenate([hang_strings(whole, q)[self.columns], self.plan.tension])

    def best(self, k: int | None, starts: Iterable[Array]) -> tuple[float, Array]:
        """Return the cheapest of the poses at rest that are found from some starts, or else from poses near rest."""
        tried = [start for start in starts if np.isfinite(start).all()]
        first = (*tried, self.toward_rest(k, _HALFWAY))
        cost, pose = min((self.nearest(k, start) for start in first), key=lambda each: each[0])
        for share in _SHARES:
            if np.isfinite(cost):
                break
            cost, pose = self.nearest(k, self.toward_rest(k, share))
        return cost, pose

    def net(self, pose: Array) -> Array:
        """Return the net forces (nd,) on the body, and how much longer strings on bars are than they are tied (m)."""
        m, (q, pull) = self.mechanism, np.split(pose, [self.mechanism.nq])
        net = (m.core.gradient(q, self.still)[0] + m.core.force(q, self.still, pull))[: m.nd]
        ties = self.ties
        return np.asarray(net if ties is None else np.concatenate([net, ties.off(q[None, :])[0]]))

    def net_derivative(self, pose: Array) -> Array:
        """Return their derivative (nd, nv + strings) by moves of the pose, and by tensions."""
        m, (q, pull) = self.mechanism, np.split(pose, [self.mechanism.nq])
        by_q, _, by_pull = m.core.force_jacobians(q, self.still, pull)
        bent = m.core.hessian(q, self.still)[0] + by_q
        for rotation in m.tree.rotations:
            # The core has them for turns about x, y and z one after the other; these are for turns in the body's axes.
            at = slice(first := m.variables.index(rotation.variables[0]), first + 3)
            bent[at, at] += np.triu(np.cross(self.net(pose)[at], np.eye(3)).T)
        slopes = np.hstack([bent[: m.nd], by_pull[: m.nd]])
        ties = self.ties
        if ties is None:
            return slopes
        return np.vstack([slopes, np.pad(ties.slopes(q), ((0, 0), (0, len(pull))))])

    def _of(self, values: Array, k: int | None) -> Array:
        """Return a copy of the values (N+1, ...) of an instant; their mean if None is given."""
        return np.array(values[k] if k is not None else unit(self.mechanism.coordinates, values.mean(axis=0)))

    def markers_off(self, pose: Array, k: int | None) -> tuple[float, Array]:
        """Return what it costs that markers are not where instant k wants them, and its slope (nv + strings,)."""
        value, slope, problem = 0.0, np.zeros(len(self.scale)), self.plan.problem
        weight, nv = problem.weights.marker, self.mechanism.nv
        if problem.follow == "joints" or problem.markers is None:
            return value, slope
        q = np.ascontiguousarray(pose[: self.mechanism.nq])
        markers = self._of(problem.markers, k)
        for i, frame in enumerate(LIMB_MARKERS.values(), start=1):
            apart = self.mechanism.frame_pose(q, frame)[:3, 3] - markers[i]
            value += 0.5 * weight * float(apart @ apart)
            slope[:nv] += weight * apart @ self.mechanism.frame_jacobian(q, frame)[:3]
        return value, slope

    def nearest(self, k: int | None, start: Array) -> tuple[float, Array]:
        """Return what a pose at rest costs at instant k, and the pose; infinity where none was found from a start."""
        wanted = self.wanted(k)
        m, limits, scale = self.mechanism, self.plan.limits, self.scale
        goal = wanted[: m.nq]
        least, most = np.full(len(scale), -np.inf), np.full(len(scale), np.inf)
        least[m.nv :], most[m.nv :] = limits.tension + self.more, limits.strength
        ends = ends_of(m)
        for names, reach in (
            ((*ends.x, *ends.y), limits.reach),
            (ends.z, limits.lift),
            (ends.headings, limits.turn),
            (ends.tilts, limits.tilt),
        ):
            at = [m.variables.index(name) for name in names]
            least[at], most[at] = -reach, reach
        for name, bounds in limits.joints_of(m).items():
            least[m.variables.index(name)], most[m.variables.index(name)] = np.subtract(
                bounds, goal[m.coordinates.index(name)]
            )
        meant = np.concatenate([np.zeros(m.nv), wanted[m.nq :]]) * scale
        turning = np.eye(len(scale))

        def pose_of(z: Array) -> Array:
            """Return the pose that is so far from the wanted one, in parts of the scale; its tensions are whole."""
            return np.concatenate([moved(m, goal[None], z[None, : m.nv] / scale[: m.nv])[0], z[m.nv :] / scale[m.nv :]])

        def by_z(z: Array, slopes: Array) -> Array:
            """Return derivatives by z of those by moves of the pose."""
            turning[: m.nv, : m.nv] = turned(m, z[: m.nv] / scale[: m.nv])
            return np.asarray(slopes @ turning / scale)

        def cost(z: Array) -> tuple[float, Array]:
            value, slope = self.markers_off(pose_of(z), k)
            return value + 0.5 * float(np.sum((z - meant) ** 2)), by_z(z, slope) + z - meant

        apart = differences(m, start[None, : m.nq], goal[None])[0]
        from_wanted = np.concatenate([apart, start[m.nq :]])
        with one_thread(), warnings.catch_warnings():
            # Older versions of SciPy tell of a step past a bound by rounding, which they take back.
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            done = minimize(
                cost,
                np.clip(from_wanted, least, most) * scale,
                jac=True,
                bounds=np.stack([least * scale, most * scale], axis=1),
                constraints={
                    "type": "eq",
                    "fun": lambda z: self.net(pose_of(z)),
                    "jac": lambda z: by_z(z, self.net_derivative(pose_of(z))),
                },
                method="SLSQP",
                options={"ftol": _DIGITS, "maxiter": _STEPS},
            )
        pose = pose_of(done.x)
        balanced = np.isfinite(pose).all() and float(np.abs(self.net(pose)).max()) < _BALANCED
        return (float(done.fun), pose) if balanced else (np.inf, pose)


def at_rest(plan: TrackingPlan, *starts: Array, k: int | None = 0) -> tuple[Array, Array]:
    """Return states and inputs of a plan in which strings hold the puppet still, nearest to where it is to begin.

    Strings on bars are as long there as they happen to be. ``starts``: poses, with their tensions, in which the search
    begins too. ``k``: another instant to be near; None: all of them, in the mean.

    Raises
    ------
    ArgumentError
        If there is none within the limits.
    """
    search, m = PoseSearch(plan, tied=False, more=_FIRM), plan.mechanism
    cost, pose = search.best(k, (search.wanted(k), *starts))
    if not np.isfinite(cost):
        raise ArgumentError(_NO_REST)
    x, u = np.zeros_like(plan.x_reference), np.zeros_like(plan.u_reference)
    x[:, : m.nq] = pose[: m.nq]
    u[:] = np.concatenate([pose[m.nq :], pose[m.first_rho : m.nq]])
    return x, u


def held_still(plan: TrackingPlan, near: OptimizationResult) -> OptimizationResult:
    """Return a motion of a plan in which strings hold the puppet still, nearest to what is wanted.

    It is in the pose nearest to where it is to begin, or to where it is to be in the mean, whichever is nearer all
    along. ``near``: what was found instead, in whose pose the search begins too. Raises `ArgumentError` as `at_rest`.
    """
    start = np.concatenate([near.x[0, : plan.mechanism.nq], near.u[0, : len(plan.strings)]])
    found = list[tuple[Array, Array]]()
    for k in (0, None):
        with suppress(ArgumentError):
            found.append(at_rest(plan, start, k=k))
    if not found:
        raise ArgumentError(_NO_REST)
    apart = plan.cost(tied=False)
    x, u = min(found, key=lambda still: apart.value(*still))
    none = np.zeros_like(near.K)
    return replace(
        near,
        status=Status.LINE_SEARCH_FAILED if near.success else near.status,
        message="No motion was found in which strings on bars keep their lengths and pull: the puppet is held still.",
        x=x,
        u=u,
        K=none,
        projection_gain=none,
        cost=plan.cost().value(x, u),
        limits=None,
    )
