"""Parameters of a mechanism from what was measured of its motions: least squares over all of them at once.

``minimise  sum ((measured - predicted(p, starts)) / sigma)^2 + sum weight (p - wanted)^2``

With independent normal noise that is the most likely choice, and ``(J'J)^-1`` at the minimum is the covariance of the
estimates (G. A. F. Seber and C. J. Wild, Nonlinear Regression, 1989, 2.1). A long motion has many minima: the horizon
grows, each part begins with what the last one found.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import numpy as np

from leastaction.errors import ArgumentError, ResidualWarning, unknown
from leastaction.identification.experiment import Experiment
from leastaction.identification.model import Measured
from leastaction.identification.result import Identification, Residuals, doubts_of
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array, as_count, as_number, read_only, require_instance
from leastaction.numerics.blas import one_thread
from leastaction.numerics.public import public
from leastaction.numerics.warn import warn
from leastaction.optimal.unknowns.unknown import Parameter

_HORIZONS = (0.125, 0.25, 0.5, 1.0)
_LEAST = 3  # samples for each number that is found, in the first parts
_BLIND = 1e-10  # singular value, in parts of the largest, of a combination that measurements do not tell
_SOME = 0.03  # of the largest entry of such a combination is one that belongs to it
_ROUNDS = 3  # coordinates of the start are counted anew so often, at most
_STILL = 1e-9  # coordinates of the start, in parts of its size, that need not be


@public
def identify(
    mechanism: Mechanism | MidpointVI,
    data: Experiment | Sequence[Experiment],
    parameters: Sequence[Parameter | str],
    *,
    horizons: Sequence[float] = _HORIZONS,
    substeps: int = 1,
    tolerance: float = 1e-10,
    max_iterations: int = 100,
) -> Identification:
    """Return the parameters of a mechanism with which it moves as was measured, and how well they are known.

    Parameters
    ----------
    mechanism : Mechanism or MidpointVI
        With first guesses of the parameters.
    data : Experiment or sequence of Experiment
        Motions that were measured; all have the same parameters, each has a start of its own.
    parameters : sequence of Parameter or str
        Names among ``mechanism.parameters``, or a `Parameter` with bounds, a guess, or a `weight`: what is known
        beforehand, ``1 / sigma^2`` of `wanted`.
    horizons : sequence of float
        Parts of every experiment that are fitted one after the other, growing to 1. Parts with too few samples are left
        out. ``[1.0]`` is all at once.
    substeps : int
        Steps of time between two measurements: steps that are too long bias the estimates.
    tolerance : float
        Relative change of the sum of squares, or of the numbers, at which the search ends.
    max_iterations : int
        Of every part.

    Returns
    -------
    Identification
        Estimates, standard errors, residuals; `doubts` says what speaks against them.

    Raises
    ------
    ArgumentError
        Unknown names, wrong shapes, horizons that do not grow to 1, fewer measurements than unknown numbers, or a
        mechanism that cannot move from where it begins.

    Warns
    -----
    ResidualWarning
        Residuals that are not noise by their size or because neighbours are alike, parameters that the measurements do
        not tell, or a search that has not ended.

    Examples
    --------
    The stiffness and the damping of a swinging mass, of which every place is off by 2 mm:

    >>> import numpy as np
    >>> from leastaction import Damping, JointSpring, Mechanism, MidpointVI, tx
    >>> from leastaction.identification import Experiment, identify
    >>> def slide(k, d):
    ...     return Mechanism([tx("x", mass=1.0)], [JointSpring("x", k, name="spring"), Damping(d, name="oil")])
    >>> t = np.linspace(0.0, 4.0, 201)
    >>> vi = MidpointVI(slide(9.0, 0.4))
    >>> x = vi.simulate(vi.start([0.1]), t)["x"] + 0.002 * np.random.default_rng(0).normal(size=201)
    >>> found = identify(slide(5.0, 0.1), Experiment(t, {"x": x}, 0.002), ["spring.stiffness", "oil.x"])
    >>> print(found)  # doctest: +SKIP
    >>> abs(found["spring.stiffness"] - 9.0) < 3.0 * found.errors["spring.stiffness"]
    True
    """
    integrator = mechanism if isinstance(mechanism, MidpointVI) else MidpointVI(mechanism, threads=1)
    experiments = list(data) if isinstance(data, (list, tuple)) else [cast(Experiment, data)]
    for i, each in enumerate(experiments):
        require_instance(each, f"data[{i}]", Experiment, "Experiment(t, {'elbow': angles}, sigma) is one")
    if not experiments:
        raise ArgumentError("data: got no experiment, expected one at least")
    asked = _checked(integrator.mechanism, parameters)
    parts = [as_number(part, "horizons", above=0.0) for part in horizons]
    if not parts or parts[-1] != 1.0 or any(b <= a for a, b in pairwise(parts)):
        raise ArgumentError(f"horizons: got {list(horizons)}, expected parts that grow to 1")
    count = as_count(substeps, "substeps", 1)
    begun = {p.name: p.guess for p in asked if p.guess is not None}
    start = integrator.like(integrator.mechanism.with_parameters(begun)) if begun else integrator
    fits = [Measured(each, start, [p.name for p in asked], count) for each in experiments]
    search = _LeastSquares(
        asked, fits, as_number(tolerance, "tolerance", above=0.0), as_count(max_iterations, "max_iterations", 1)
    )
    taken = [part for part in parts if part == 1.0 or search.tells_enough(part)]
    for part in taken:
        search.fit(part)
    found = search.result(integrator, tuple(taken))
    for doubt in found.doubts:
        warn(doubt, ResidualWarning)
    return found


def _checked(m: Mechanism, parameters: Sequence[Parameter | str]) -> list[Parameter]:
    given = [parameters] if isinstance(parameters, (str, Parameter)) else list(parameters)
    asked = [Parameter(each) if isinstance(each, str) else each for each in given]
    for each in asked:
        require_instance(each, "parameters", Parameter, "Parameter('bob.mass') is one, or its name alone")
        if each.name not in m.parameters:
            raise unknown("parameter", each.name, m.parameters, "parameters")
    if not asked or len({each.name for each in asked}) < len(asked):
        raise ArgumentError(f"parameters: got {[each.name for each in asked]}, expected one or several, each once")
    return asked


class _LeastSquares:
    """The numbers that are found: parameters, then the starts of the experiments."""

    def __init__(self, asked: list[Parameter], fits: list[Measured], tolerance: float, most: int) -> None:
        self.asked, self.fits, self.tolerance, self.most = asked, fits, tolerance, most
        known = fits[0].base.mechanism.parameters
        own = [known[p.name] for p in asked]
        self.values = np.array(own)
        self.wanted = np.array([v if p.wanted is None else p.wanted for p, v in zip(asked, own, strict=True)])
        self.weight = np.sqrt([p.weight for p in asked])
        self.iterations, self.converged, self.message = 0, False, ""
        P = len(asked)
        self.ends = P + np.cumsum([0, *(fit.n_start for fit in fits)])

    def samples(self, fit: Measured, part: float) -> int:
        """Return how many intervals a part of an experiment has."""
        return max(2, int(np.ceil(part * (len(fit.experiment.t) - 1))))

    def tells_enough(self, part: float) -> bool:
        """Whether a part has measurements enough for what is found."""
        count = sum(int(np.sum(~np.isnan(c.values[: self.samples(f, part)]))) for f in self.fits for c in f.channels)
        return count >= _LEAST * int(self.ends[-1])

    def fit(self, part: float) -> None:
        """Fit a part of all experiments."""
        from scipy.optimize import least_squares  # slow to import, and not needed by most

        P, total = len(self.asked), int(self.ends[-1])
        low, high = np.full(total, -np.inf), np.full(total, np.inf)
        low[:P] = [-np.inf if p.min is None else p.min for p in self.asked]
        high[:P] = [np.inf if p.max is None else p.max for p in self.asked]
        for _ in range(_ROUNDS):
            made: dict[bytes, tuple[Array, Array]] = {}

            def both(z: Array, made: dict[bytes, tuple[Array, Array]] = made) -> tuple[Array, Array]:
                key = z.tobytes()
                if key not in made:
                    made.clear()
                    made[key] = self.residuals(z, part)
                return made[key]

            z0 = np.concatenate([self.values, np.zeros(total - P)])
            if self.iterations == 0 and not all(np.isfinite(np.vdot(each, each)) for each in both(z0)):
                raise ArgumentError(
                    "the residuals at the start, or their derivatives, are no numbers whose squares can be added; give "
                    "other guesses of parameters, or a larger sigma"
                )
            # A search within bounds begins off them.
            room = 1e-9 * np.minimum(1.0 + np.abs(z0), high - low)
            z0 = np.clip(z0, low + room, high - room)
            with one_thread():
                found = least_squares(
                    lambda z: both(z)[0], z0, jac=lambda z: both(z)[1],
                    bounds=(low, high), x_scale="jac", ftol=self.tolerance, xtol=self.tolerance, gtol=1e-15,
                    max_nfev=self.most,
                )  # fmt: skip
            self.iterations += int(found.nfev)
            self.converged, self.message = found.status > 0, str(found.message)
            self.values = found.x[:P]
            moved = 0.0
            for fit, a, b in zip(self.fits, self.ends[:-1], self.ends[1:], strict=True):
                moved = max(moved, float(np.abs(found.x[a:b]).max(initial=0.0)) / (1.0 + float(np.abs(fit.x0).max())))
                fit.rebase(found.x[a:b])
            if moved <= _STILL:
                return

    def residuals(self, z: Array, part: float) -> tuple[Array, Array]:
        """Return all residuals and their derivatives; those of what is known beforehand last."""
        P, total = len(self.asked), int(self.ends[-1])
        rows, slopes = [], []
        for fit, a, b in zip(self.fits, self.ends[:-1], self.ends[1:], strict=True):
            r, J = fit.residuals(z[:P], z[a:b], self.samples(fit, part))
            whole = np.zeros((len(r), total))
            whole[:, :P], whole[:, a:b] = J[:, :P], J[:, P:]
            rows.append(r)
            slopes.append(whole)
        prior = self.weight > 0.0
        rows.append((self.weight * (z[:P] - self.wanted))[prior])
        slopes.append(np.hstack([np.diag(self.weight)[prior], np.zeros((int(prior.sum()), total - P))]))
        return np.concatenate(rows), np.concatenate(slopes)

    def result(self, integrator: MidpointVI, horizons: tuple[float, ...]) -> Identification:
        """Return what was found."""
        P, total = len(self.asked), int(self.ends[-1])
        r, J = self.residuals(np.concatenate([self.values, np.zeros(total - P)]), 1.0)
        if len(r) < total:
            raise ArgumentError(f"data: got {len(r)} measurements for {total} unknown numbers, expected more than that")
        known = all(each.experiment.sigma is not None for each in self.fits)
        chi_squared, freedom = float(r @ r), len(r) - total
        covariance, blind = _covariance(J, P)
        if not known:
            covariance = covariance * (chi_squared / max(freedom, 1))
        names = [p.name for p in self.asked]
        runs = tuple(fit.trajectory(self.values) for fit in self.fits)
        residuals = tuple(
            {
                label: Residuals(t, predicted + sigma * scaled, predicted, scaled)
                for label, (t, predicted, scaled, sigma) in _with_sigma(fit, run)
            }
            for fit, run in zip(self.fits, runs, strict=True)
        )
        doubts = [] if self.converged else [f"the search has not ended: {self.message}"]
        doubts += [
            f"the measurements do not tell {' and '.join(repr(names[j]) for j in group)}"
            + (" apart" if len(group) > 1 else "")
            for group in blind
        ]
        at_bound = [p.name for p, v in zip(self.asked, self.values, strict=True) if _is_at_bound(p, v)]
        doubts += [f"{name!r} is at its bound" for name in at_bound]
        doubts += doubts_of(residuals, tuple(f.experiment.name for f in self.fits), chi_squared, freedom, known=known)
        return Identification(
            dict(zip(names, self.values.tolist(), strict=True)),
            dict(zip(names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
            read_only(covariance), chi_squared, freedom, known, residuals,
            integrator.mechanism.with_parameters(dict(zip(names, self.values.tolist(), strict=True))),
            runs, self.converged, "The sum of squares is at a minimum." if self.converged else self.message,
            tuple(doubts), horizons, self.iterations,
        )  # fmt: skip


def _with_sigma(fit: Measured, run: object) -> list[tuple[str, tuple[Array, Array, Array, float]]]:
    sigma = {label: each.sigma for each in fit.channels for label in each.labels}
    return [(label, (*told, sigma[label])) for label, told in fit.told(run).items()]  # type: ignore[arg-type]


def _is_at_bound(p: Parameter, value: float) -> bool:
    """Whether an estimate is at a bound, where its standard error says little."""
    bounds = [bound for bound in (p.min, p.max) if bound is not None]
    return any(abs(value - bound) <= 1e-6 * (1.0 + abs(bound)) for bound in bounds)


def _covariance(J: Array, P: int) -> tuple[Array, list[list[int]]]:
    """Return the covariance (P, P) of the first numbers, and which of them are not told, or not apart.

    Those have infinite variances.
    """
    size = np.linalg.norm(J, axis=0)
    size[size == 0.0] = 1.0
    _, s, V = np.linalg.svd(J / size, full_matrices=False)
    seen = s > _BLIND * s[0]
    inverse = (V[seen].T / s[seen] ** 2) @ V[seen] / np.outer(size, size)
    blind = [np.flatnonzero(np.abs(v[:P]) > _SOME * np.abs(v).max()).tolist() for v in V[~seen]]
    groups = [group for group in blind if group]
    covariance = inverse[:P, :P].copy()
    for j in {j for group in groups for j in group}:
        covariance[j, j] = np.inf
    return covariance, groups
