"""What a mechanism says that would be measured, and how that follows from numbers and start: exact sensitivities.

Along the motion ``x+ = f(x, u; p)`` the sensitivities ``S = dx/d(p, z)`` obey ``S+ = A S + [df/dp, 0]``, where the
coordinates z move the start along its tangent. Residuals are (measured - predicted) / sigma.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from leastaction.errors import ArgumentError, LeastActionError
from leastaction.identification.experiment import Channel, Experiment, channels, drive
from leastaction.mechanics.configuration.assembly import project_configuration, project_velocity
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.discrete.trajectory import Trajectory
from leastaction.mechanics.mechanism.arguments import rates, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import difference, differences
from leastaction.numerics.arrays import Array
from leastaction.numerics.differences import fourth_order
from leastaction.numerics.rotations import inverse, logarithm, logarithm_derivative, product
from leastaction.systems.midpoint import MidpointSystem

_FEW = 5  # samples whose slope is a first guess of a rate
_PART = 1e-3  # of a parameter, by which it is moved for differences
_LOST = 1e3  # residual of what a motion did not come to, in deviations


class Measured:
    """An experiment with a mechanism, up to some sample of it.

    ``names``: the parameters. ``substeps``: steps of time between two samples.
    """

    def __init__(self, experiment: Experiment, integrator: MidpointVI, names: Sequence[str], substeps: int) -> None:
        m = integrator.mechanism
        self.experiment, self.names, self.substeps = experiment, tuple(names), substeps
        N = len(experiment.t) - 1
        part = np.arange(substeps * N + 1) / substeps
        self.t = np.interp(part, np.arange(N + 1), experiment.t)
        self.channels = channels(experiment, m)
        self.u, rho = drive(experiment, m, self.t, substeps)
        self.base = MidpointSystem(integrator, self.t)
        self.q, self.v = self._guess(m, rho)
        self.x0 = self._start(self.base)

    def _guess(self, m: Mechanism, rho: Array) -> tuple[Array, Array]:
        """Return configuration and velocity to begin with."""
        given, q, v = self.experiment.start, m.configuration(), np.zeros(m.nv)
        if given is not None:
            both = isinstance(given, (tuple, list)) and len(given) == 2 and np.ndim(given[0]) == 1
            q, v = given if both else (given, v)
            return single(m, q, "start q"), rates(m, v, "start v")
        for each in self.channels:
            times = self.experiment.t if each.kind != "rate" else self.experiment.t[:-1]
            known = np.flatnonzero(~np.isnan(each.values[:, 0]))[:_FEW]
            if each.kind == "variable":
                line = np.polyfit(times[known] - times[0], each.values[known, 0], min(len(known) - 1, 1))
                q[m.coordinates.index(m.variables[each.at])] = line[-1]
                v[each.at] = line[0] if len(line) > 1 else 0.0
            if each.kind == "turn":
                number, move = each.at
                turns = each.values[known]
                q[number : number + 4] = turns[0]
                if len(known) > 1:
                    way = logarithm(product(inverse(turns[0]), turns[-1]))
                    v[move : move + 3] = way / (times[known[-1]] - times[known[0]])
        for each in self.channels:
            if each.kind == "rate":
                v[each.at] = each.values[~np.isnan(each.values[:, 0]), 0][0]
        if m.nrho:
            still = np.tile(q[: m.first_rho], (2, 1))
            ends = np.hstack([still, rho[:2]])
            q[m.first_rho :] = rho[0]
            v[m.nd :] = difference(m, ends[1], ends[0])[m.nd :] / (self.t[1] - self.t[0])
        if m.nc:
            now = m.at_time(self.t[0])
            q = project_configuration(now, q).q
            v = project_velocity(now, q, v).v
        return q, v

    def _start(self, system: MidpointSystem) -> Array:
        return np.asarray(system.integrator.start(self.q, self.v, t=float(self.t[0])).x)

    # ---- Numbers ----------------------------------------------------------------------------------

    @property
    def n_start(self) -> int:
        """How many coordinates the start has."""
        return self.directions.shape[1] if self.experiment.free_start else 0

    @property
    def directions(self) -> Array:
        """Directions (ndx, n) in which the start moves; not those of prescribed variables."""
        m = self.base.mechanism
        prescribed = {*range(m.first_rho, m.nq), *range(m.nq + m.nd, m.nx)}
        free = [name for i, name in enumerate(self.base.state_names) if i not in prescribed]
        return self.base.start_directions(self.x0, free if prescribed else None)

    def rebase(self, z: Array) -> None:
        """Count coordinates of the start from where they have come to."""
        if self.n_start:
            self.x0 = self.base.moved_start(self.x0, self.directions @ z)

    def residuals(self, values: Array, z: Array, samples: int) -> tuple[Array, Array]:
        """Return residuals (n,) of the first samples, and their derivatives (n, P + n_start)."""
        P, Z = len(values), self.directions if self.n_start else np.zeros((self.base.ndx, 0))
        steps = samples * self.substeps
        try:
            system = self.at(values).window(0, steps)
            x0 = self.base.moved_start(self.x0, Z @ z) if self.n_start else self._start(self.at(values))
            run = system.rollout(
                x0, np.tile(x0, (steps + 1, 1)), self.u[:steps], np.zeros((steps, system.nu, system.ndx)), 0, steps
            )
        except LeastActionError:
            run = None
        if run is None or not run.complete:
            n = sum(int(np.sum(~np.isnan(self._part(each, samples)))) for each in self.channels)
            return np.full(n, _LOST), np.zeros((n, P + Z.shape[1]))
        (A, _), by = system.linearize_by(run.x, self.u[:steps], self.names)
        S = np.empty((steps + 1, system.ndx, P + Z.shape[1]))
        S[0, :, P:] = Z
        S[0, :, :P] = self._start_by(values)
        for k in range(steps):
            S[k + 1] = A[k] @ S[k]
            S[k + 1, :, :P] += by[k]
        x, S = run.x[:: self.substeps], S[:: self.substeps]
        parts = [self._of(each, x, S, values, samples) for each in self.channels]
        return np.concatenate([r for r, _ in parts]), np.concatenate([J for _, J in parts])

    def _start_by(self, values: Array) -> Array:
        """Return the derivatives of the start by the parameters (ndx, P)."""
        if self.n_start:
            return np.asarray(self.base.start_by_parameters(self.x0, self.names, True))
        x0 = self.x0

        def moved(system: MidpointSystem) -> Array:
            return system.difference(self._start(system), x0)

        slopes = [self._by_parameter(values, j, moved) for j in range(len(values))]
        return np.array(slopes).reshape(len(values), -1).T

    def _by_parameter(self, values: Array, j: int, of: object) -> Array:
        """Return the derivative of what follows from a system by one parameter, by differences of fourth order."""
        step = _PART * (abs(float(values[j])) or 1.0)

        def at(by: float) -> Array:
            moved = values.copy()
            moved[j] += by
            return np.asarray(of(self.base.with_parameters_near(dict(zip(self.names, moved.tolist(), strict=True)))))  # type: ignore[operator]

        return np.asarray(fourth_order(at, step))

    def _of(self, each: Channel, x: Array, S: Array, values: Array, samples: int) -> tuple[Array, Array]:
        """Return residuals and their derivatives of what one channel tells."""
        wanted = self._part(each, samples)
        if each.kind == "turn":
            missing, known = _missing(wanted, x, each.at[0]), ~np.isnan(wanted[:, :3])
            by = -logarithm_derivative(-missing) @ S[:, each.at[1] : each.at[1] + 3]
            return missing[known] / each.sigma, by[known] / each.sigma
        predicted, slopes = self._predicted(each, x, S, values)
        known = ~np.isnan(wanted)
        return (wanted - predicted)[known] / each.sigma, -slopes[known] / each.sigma

    def _predicted(self, each: Channel, x: Array, S: Array, values: Array) -> tuple[Array, Array]:
        m = self.base.mechanism
        q = np.ascontiguousarray(x[:, : m.nq])
        if each.kind == "variable":
            return q[:, m.coordinates.index(m.variables[each.at]), None], S[:, None, each.at]
        if each.kind == "turn":
            return logarithm(q[:, each.at[0] : each.at[0] + 4]), S[:, each.at[1] : each.at[1] + 3]
        if each.kind == "rate":
            dt = np.diff(self.experiment.t[: len(x)])[:, None]
            ways, slopes = _ways(m, q, S, each.at)
            return ways / dt, slopes / dt[..., None]
        m = self.at(values).mechanism
        slopes = m.frame_jacobian(q, each.at)[:, :3] @ S[:, : m.nv]
        for j in range(len(values)):  # frames may be elsewhere on other bodies
            slopes[:, :, j] += self._by_parameter(
                values, j, lambda system: system.mechanism.positions(q, [each.at])[:, 0]
            )
        return m.positions(q, [each.at])[:, 0], slopes

    def _part(self, each: Channel, samples: int) -> Array:
        return each.values[: samples + (each.kind != "rate")]

    # ---- What was found ---------------------------------------------------------------------------

    def at(self, values: Array) -> MidpointSystem:
        """Return the system with values of the parameters."""
        return self.base.with_parameters(dict(zip(self.names, values.tolist(), strict=True)))

    def trajectory(self, values: Array) -> Trajectory:
        """Return the motion with values of the parameters.

        Raises
        ------
        ArgumentError
            If the mechanism cannot move so.
        """
        system, N = self.at(values), self.base.N
        x0 = self.x0 if self.n_start else self._start(system)
        run = system.rollout(x0, np.tile(x0, (N + 1, 1)), self.u, np.zeros((N, system.nu, system.nx)), 0, N)
        if not run.complete:
            raise ArgumentError(f"the motion cannot be made with what was found: {run.failure}")
        return system.trajectory(run.x, self.u)

    def told(self, run: Trajectory) -> dict[str, tuple[Array, Array, Array]]:
        """Return times, predictions and residuals (in deviations) of every channel's columns, by label."""
        x, found = run.x[:: self.substeps], {}
        nothing = np.zeros((len(x), self.base.ndx, 0))
        t = self.experiment.t
        for each in self.channels:
            if each.kind == "frame":
                predicted = run.mechanism.positions(np.ascontiguousarray(x[:, : self.base.mechanism.nq]), [each.at])[
                    :, 0
                ]
            else:
                predicted = self._predicted(each, x, nothing, np.zeros(0))[0]
            times = 0.5 * (t[1:] + t[:-1]) if each.kind == "rate" else t
            turned = each.kind == "turn"
            missing = _missing(each.values, x, each.at[0]) if turned else each.values - predicted
            for j, label in enumerate(each.labels):
                found[label] = times, predicted[:, j], missing[:, j] / each.sigma
        return found


def _missing(wanted: Array, x: Array, place: int) -> Array:
    """Return the rotation vectors (n, 3) from where a quaternion is in states x to where it was measured, NaN too."""
    return logarithm(product(inverse(x[:, place : place + 4]), wanted))


def _ways(m: Mechanism, q: Array, S: Array, variable: int) -> tuple[Array, Array]:
    """Return how far a variable moves between instants (N, 1), of a turn the rotation vector's component, and slopes.

    ``S`` (N+1, ndx, P): how configurations q (N+1, nq) move.
    """
    ways = differences(m, q[1:], q[:-1])
    for rotation in m.tree.rotations:
        first = m.variables.index(rotation.variables[0])
        if first <= variable < first + 3:
            e, row = ways[:, first : first + 3], variable - first
            moved = S[:, first : first + 3]
            slopes = logarithm_derivative(e) @ moved[1:] - logarithm_derivative(-e) @ moved[:-1]
            return ways[:, variable, None], slopes[:, row, None]
    return ways[:, variable, None], np.diff(S[:, None, variable], axis=0)
