"""Equilibria: where a mechanism stays at rest, and whether it comes back to it.

    V_q - f(q, 0, u) + Dh(q)^T lam = 0,   h(q) = 0

over the dynamic variables that are not held. A minimum of the potential on the constraints is sought by Newton's
method in their tangent space, with Z a basis of it and ``W = V_qq - f_q + sum_i lam_i d2h_i``::

    d = -Z |Z^T W Z|^-1 Z^T (V_q - f)

where ``|B|`` has the eigenvalues of B with their signs dropped, so that d descends and leaves saddles. Every
step is brought back onto the constraints and must lessen the potential (less the work of f).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from leastaction.errors import EquilibriumError, some, worst_first
from leastaction.mechanics.configuration.assembly import project_configuration
from leastaction.mechanics.configuration.null_space import (
    Indices,
    NullSpace,
    all_finite,
    free_variables,
    restoring,
    row_scales,
)
from leastaction.mechanics.mechanism.arguments import inputs_of, single
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import difference, moved_by
from leastaction.numerics.arrays import Array, Row, as_choice, as_count, as_number, require_instance
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public

Kind = Literal["minimum", "any"]

_ON_CONSTRAINTS = 1e-12  # relative residual of the constraints at every iterate
_FLAT = 1e-9  # eigenvalues below this part of the largest count as zero
_NEAR = 0.2  # m: frames of a path that are nearer, or nearer than this part of it, are told of where a search fails
_REST = 1e-6  # of the largest force: a net force of less is none
_FIRST_RADIUS, _LONGEST = 0.5, 1e6  # bound on the first step, on every step (m or rad)
_FAR = 1e5  # from the guess, where the potential has no bound


class Stability(Enum):
    """What a small push does to an equilibrium; the value says it in words."""

    STABLE = "stable: after a small push it swings about the equilibrium"
    UNSTABLE = "unstable: after a small push it moves away from the equilibrium"
    MARGINAL = "marginal: some motion meets no resistance, so the second order does not decide"


@public
@dataclass(frozen=True)
class Equilibrium(Frozen):
    """A configuration in which the mechanism stays at rest.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration (m or rad).
    multipliers : dict of str to float
        Multiplier of each constraint by name: the constraints exert ``-Dh^T lam``. Those of least norm where
        constraints are redundant.
    holding : dict of str to float
        Force (N or N m) that keeps each held and each kinematic variable where it is.
    potential : float
        Potential energy (J).
    residual : float
        Largest net force along the free directions (N or N m).
    stability : Stability
        Undamped, with the held variables held.
    eigenvalues : ndarray, shape (nf,)
        Of the stiffness relative to the mass matrix on the nf free directions, ascending (1/s^2); complex
        where forces that have no potential couple the variables.
    modes : ndarray, shape (nv, nf)
        The motions that belong to them, as columns.
    iterations : int
        Newton steps that were made.
    """

    q: Array
    multipliers: dict[str, float]
    holding: dict[str, float]
    potential: float
    residual: float
    stability: Stability
    eigenvalues: NDArray[np.inexact] = field(repr=False)
    modes: NDArray[np.inexact] = field(repr=False)
    iterations: int

    @property
    def frequencies(self) -> Array:
        """Natural angular frequencies (rad/s), ascending; empty unless the equilibrium is stable."""
        if self.stability is not Stability.STABLE:
            return np.zeros(0)
        result: Array = np.sqrt(np.real(self.eigenvalues))
        return result

    def __str__(self) -> str:
        """Say whether it is stable, how fast it swings about it, and what holds it."""
        found = f"potential {self.potential:.6g} J, largest net force {self.residual:.2g} after {self.iterations} steps"
        lines = [self.stability.value, found]
        if len(self.frequencies):
            lines.append("natural frequencies (rad/s) " + some([f"{w:.4g}" for w in self.frequencies]))
        if self.holding:
            lines.append("held by " + some([f"{name!r} {force:.4g}" for name, force in self.holding.items()]))
        return "\n".join(lines)


@public
def equilibrium(
    mechanism: Mechanism,
    q_guess: Row,
    *,
    hold: Sequence[str] = (),
    inputs: ArrayLike | None = None,
    kind: Kind = "minimum",
    tolerance: float = 1e-12,
    max_iterations: int = 200,
) -> Equilibrium:
    """Return an equilibrium under the constraints, with the kinematic and the held variables where they are.

    Parameters
    ----------
    mechanism : Mechanism
    q_guess : array_like, shape (nq,)
        Where to start; need not satisfy the constraints.
    hold : sequence of str, optional
        Dynamic variables that must not move; a joint whose rotation is a quaternion by its name.
    inputs : array_like, shape (n_inputs,), optional
        Inputs, constant; zero if not given.
    kind : {"minimum", "any"}, optional
        Go down to a minimum of the potential, never to a saddle; or to any equilibrium near the guess.
    tolerance : float, optional
        Largest net force of the result, relative to the size of the forces (and of the stiffness, at a
        deflection of one metre or radian).
    max_iterations : int, optional
        Bound on the Newton steps.

    Raises
    ------
    ArgumentError
        For a wrong shape, a value that is not finite, or an unknown name or kind.
    InconsistentStartError
        If the guess cannot be brought onto the constraints; see `project_configuration`.
    EquilibriumError
        If none is found, with the net forces by name and what was reached: the potential has no minimum
        or is not smooth there, or the iterations were too few.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    as_choice(kind, "kind", get_args(Kind))
    as_number(tolerance, "tolerance", above=0.0, below=1.0)
    as_count(max_iterations, "max_iterations", 0)
    u = inputs_of(mechanism, inputs)
    start = single(mechanism, q_guess, "q_guess")
    search = _Search(mechanism, free_variables(mechanism, hold), u)
    if mechanism.nc:
        start = project_configuration(mechanism, start, hold=hold).q
    return search.run(start.copy(), kind, tolerance, max_iterations)


@dataclass
class _Point:
    """What is known at one configuration on the constraints."""

    q: Array
    slope: Array  # V_q - f, (nv,)
    jacobian: Array  # (nc, nv)
    lam: Array  # (nc,)
    basis: Array  # of the free directions, (n_free, nf)
    stiffness: Array  # Z^T W Z, (nf, nf)
    force: Array  # f(q, 0, u), (nd,)
    size: float  # of the forces, and of the stiffness at a deflection of one

    along: Array  # slope along the free directions, (nf,)
    load: float  # the largest force, of the potential or given


class _Search:
    def __init__(self, mechanism: Mechanism, free: Indices, u: Array) -> None:
        self.m, self.free, self.u = mechanism, free, u
        self.rest = np.zeros(mechanism.nv)

    def at(self, q: Array) -> _Point:
        m, free, core = self.m, self.free, self.m.core
        force = np.zeros(m.nv)
        force[: m.nd] = core.force(q, self.rest, self.u)[: m.nd]
        potential_slope = -core.gradient(q, self.rest)[0]
        slope = potential_slope - force
        stiffness = -core.hessian(q, self.rest)[0]
        stiffness[: m.nd] -= core.force_jacobians(q, self.rest, self.u)[0][: m.nd]
        jacobian = m.constraint_jacobian(q)
        space = NullSpace.of(jacobian[:, free])
        lam = space.multiplier(slope[free])
        if m.nc and len(free):
            stiffness = stiffness + core.constraint_hessian(q, lam)
        reduced = space.reduced(stiffness[np.ix_(free, free)])
        load = max(float(np.abs(each[free]).max(initial=0.0)) for each in (potential_slope, force))
        size = max(load, float(np.abs(reduced).max(initial=0.0)))
        along = space.basis.T @ slope[free]
        return _Point(q, slope, jacobian, lam, space.basis, reduced, force, size, along, load)

    def run(self, q: Array, kind: str, tolerance: float, max_iterations: int) -> Equilibrium:
        start, radius = q, _FIRST_RADIUS
        point = self.at(q)
        if not np.isfinite(point.size):
            raise self.error(point, 0, "the potential or a force has no finite slope at the guess")
        for iteration in range(max_iterations + 1):
            at_rest = float(np.abs(point.along).max(initial=0.0)) <= tolerance * point.size
            values, vectors = np.linalg.eigh(0.5 * (point.stiffness + point.stiffness.T))
            flat = _FLAT * float(np.abs(values).max(initial=0.0))
            saddle = kind == "minimum" and bool(np.any(values < -flat))
            if at_rest and not saddle:
                # Beside a kink the stiffness has no bound, and any force is small against it.
                net, rounding = float(np.abs(point.along).max(initial=0.0)), float(np.spacing(point.size))
                if net > max(_REST * point.load, rounding) and near_a_kink(self.m, point.q):
                    raise self.error(point, iteration, "the potential or a force has no slope where it led")
                return self.result(point, iteration)
            if iteration == max_iterations:
                raise self.error(point, iteration, f"none was found in {iteration} iterations")
            if float(np.abs(point.q - start).max()) > _FAR:
                name = self.m.coordinates[int(np.argmax(np.abs(point.q - start)))]
                raise self.error(point, iteration, f"the potential falls without bound along {name!r}")
            if kind == "any":
                following, radius = self.towards_any(point, radius)
            else:
                following, radius = self.down(point, values, vectors, flat, radius)
            if following is None:
                close = float(np.abs(point.along).max(initial=0.0)) <= 1e4 * tolerance * point.size
                if close and not saddle:
                    return self.result(point, iteration)  # rounding is reached
                raise self.error(
                    point,
                    iteration,
                    "a saddle of the potential was reached that no motion on the constraints leaves"
                    if close
                    else "no step lessens the potential any more",
                )
            point = following
        raise AssertionError("unreachable")

    def down(
        self, point: _Point, values: Array, vectors: Array, flat: float, radius: float
    ) -> tuple[_Point | None, float]:
        """Return a point of less potential, and the bound on the next step."""
        slope = vectors.T @ point.along
        # Bounded direction by direction, so that one that meets no resistance does not hold up the others.
        stiff = np.maximum(np.maximum(np.abs(values), flat), np.abs(slope) / radius)
        d = -slope / np.maximum(stiff, np.finfo(float).tiny)
        if values[0] < -flat:
            # Near a saddle the slope says little: leave it along the most negative curvature.
            d[0] = -np.copysign(radius, slope[0])
        direction = point.basis @ (vectors @ d)
        here = self.m.core.potential_energy(point.q)
        # Rounding of the energy, below which Armijo's test cannot see.
        rounding = 1e-14 * max(1.0, abs(here), point.size)
        share = 1.0
        for _ in range(40):
            q = self.moved(point, share * direction)
            if q is not None:
                expected = share * float(slope @ d) + 0.5 * share**2 * float(np.minimum(values, 0.0) @ d**2)
                work = float(point.force @ difference(self.m, q, point.q))
                gained = self.m.core.potential_energy(q) - here - work
                following = self.at(q)
                allowed = 1e-4 * expected
                if -expected < 1e3 * rounding and (np.linalg.norm(following.along) < 0.5 * np.linalg.norm(point.along)):
                    allowed += rounding
                if gained <= allowed:
                    grown = 2.0 * radius if share == 1.0 else share * radius
                    return following, min(max(grown, 1e-6), _LONGEST)
            share *= 0.5
        return None, radius

    def towards_any(self, point: _Point, radius: float) -> tuple[_Point | None, float]:
        """Return a point with less net force, and the bound on the next step."""
        here = float(np.linalg.norm(point.along))
        newton = -np.linalg.lstsq(point.stiffness, point.along, rcond=_FLAT)[0]
        steepest = -point.stiffness.T @ point.along
        for d in (newton, steepest):
            length = float(np.linalg.norm(d))
            share = min(1.0, radius / length) if length > 0.0 else 0.0
            while share * length > 1e-12:
                q = self.moved(point, point.basis @ (share * d))
                if q is not None:
                    following = self.at(q)
                    if float(np.linalg.norm(following.along)) < (1.0 - 1e-4 * share) * here:
                        return following, min(2.0 * max(share * length, 1e-6), _LONGEST)
                share *= 0.5
        return None, radius

    def moved(self, point: _Point, change: Array) -> Array | None:
        """Return the configuration after a change of the free variables, brought back onto the constraints."""
        m, move = self.m, np.zeros(self.m.nv)
        move[self.free] = change
        q = moved_by(m, point.q, move)
        if not m.nc:
            return q
        allowed = 2.0 * float(np.linalg.norm(change)) + 1e-9
        for _ in range(25):
            jacobian = m.constraint_jacobian(q)
            values = m.constraint_values(q)
            if not all_finite(values, jacobian):
                return None
            if np.all(np.abs(values) <= _ON_CONSTRAINTS * row_scales(jacobian)):
                return q
            move[self.free] = restoring(jacobian[:, self.free], values)
            q = moved_by(m, q, move)
            if np.linalg.norm(difference(m, q, point.q)[self.free]) > allowed:
                return None
        return None

    def result(self, point: _Point, iterations: int) -> Equilibrium:
        m, free = self.m, self.free
        mass = point.basis.T @ m.mass_matrix(point.q)[np.ix_(free, free)] @ point.basis
        values, vectors = _modes(point.stiffness, mass)
        modes = np.zeros((m.nv, len(values)), dtype=vectors.dtype)
        modes[free] = point.basis @ vectors
        held = np.setdiff1d(np.arange(m.nv), free)
        holding = point.slope + point.jacobian.T @ point.lam
        return Equilibrium(
            q=point.q,
            multipliers=dict(zip(m.constraints, map(float, point.lam), strict=True)),
            holding={m.variables[i]: float(holding[i]) for i in held},
            potential=float(m.core.potential_energy(point.q)),
            residual=float(np.abs(point.basis @ point.along).max(initial=0.0)),
            stability=_stability(values),
            eigenvalues=values,
            modes=modes,
            iterations=iterations,
        )

    def error(self, point: _Point, iterations: int, what: str) -> EquilibriumError:
        m = self.m
        net = np.zeros(m.nv)
        net[self.free] = point.basis @ point.along
        residuals = {f"force on {m.variables[i]!r}": float(-net[i]) for i in self.free}
        values = m.constraint_values(point.q)
        residuals |= {f"constraint {n!r}": float(h) for n, h in zip(m.constraints, values, strict=True)}
        shown = ", ".join(f"{n}: {r:.3g}" for n, r in list(worst_first(residuals).items())[:3])
        kink = near_a_kink(m, point.q)
        reached = self.result(point, iterations) if np.isfinite(point.size) else None
        return EquilibriumError(
            f"no equilibrium: {what}; largest residuals {shown}. {kink}Start nearer, hold variables along which "
            "nothing resists, allow more iterations, or ask for kind='any'",
            residuals=residuals,
            iteration=iterations,
            reached=reached,
        )


def near_a_kink(m: Mechanism, q: Array) -> str:
    """Return a sentence on the frames of a path that are nearest, if they are near; where they meet it has a kink."""
    found: list[tuple[float, str]] = []
    for name, element in m.elements.items():
        for path in element.strings:
            places = m.positions(q, path)
            pieces = [float(np.linalg.norm(b - a)) for a, b in itertools.pairwise(places)]
            k = int(np.argmin(pieces))
            if pieces[k] < _NEAR * max(1.0, sum(pieces)):
                found.append((pieces[k], f"{path[k]!r} and {path[k + 1]!r} of {name!r}"))
    if not found:
        return ""
    apart, frames = min(found)
    return (
        f"The frames {frames} are {apart:.2g} m apart there; where they meet, the length has a kink and a pull no "
        "direction: keep them apart, or choose other points. "
    )


def _modes(stiffness: Array, mass: Array) -> tuple[NDArray[np.inexact], NDArray[np.inexact]]:
    """Return the eigenvalues, ascending, and the modes of a stiffness relative to a mass matrix."""
    import scipy.linalg  # slow to import, and needed here only

    if not len(stiffness):
        return np.zeros(0), np.zeros((0, 0))
    scale = float(np.abs(stiffness).max())
    if np.abs(stiffness - stiffness.T).max() <= 1e-9 * scale:
        try:
            values, vectors = scipy.linalg.eigh(0.5 * (stiffness + stiffness.T), mass)
            return values, vectors
        except np.linalg.LinAlgError:
            pass  # some motion moves no mass
    values, vectors = scipy.linalg.eig(stiffness, mass)
    order = np.argsort(values.real)
    values, vectors = values[order], vectors[:, order]
    if np.abs(values.imag[np.isfinite(values)]).max(initial=0.0) <= _FLAT * scale:
        return values.real, vectors.real
    return values, vectors


def _stability(values: NDArray[np.inexact]) -> Stability:
    if not len(values):
        return Stability.STABLE
    finite = values[np.isfinite(values)]
    flat = _FLAT * float(np.abs(finite).max(initial=0.0))
    # v'' = -value v: anything but a positive number has a root that grows.
    if np.any(finite.real < -flat) or np.any(np.abs(finite.imag) > flat):
        return Stability.UNSTABLE
    return Stability.MARGINAL if np.any(finite.real <= flat) else Stability.STABLE
