"""The Legendre transform between velocities and momenta, with the velocities of kinematic variables given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.continuous.stabilisation import ConstraintMetric
from leastaction.mechanics.mechanism.arguments import configuration_on
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import momentum_derivatives
from leastaction.numerics.arrays import Array, as_array, as_flag, require_instance, shape_of
from leastaction.numerics.public import public

_SINGULAR = (
    "the mass matrix is singular at this configuration, so velocities do not follow from momenta; give every dynamic "
    "variable a mass to move"
)


@public
def to_momentum(mechanism: Mechanism, q: ArrayLike, v: ArrayLike) -> Array:
    """Return the momenta ``p = dL/dv`` of the dynamic variables.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)
        Configurations and velocities, kinematic ones too: ``p = M_dd v_d + M_dk v_rho``.

    Returns
    -------
    ndarray, shape (nd,) or (N, nd)
    """
    require_instance(mechanism, "mechanism", Mechanism)
    m = mechanism
    single, (qs, vs) = _rows(m, {"q": (q, m.nq), "v": (v, m.nv)})
    p = np.empty((len(qs), m.nd))
    m.core.momenta(configuration_on(m, qs, "q"), vs, p)
    return p[0] if single else p


@public
def to_velocity(
    mechanism: Mechanism,
    q: ArrayLike,
    p: ArrayLike,
    v_rho: ArrayLike | None = None,
    *,
    keep_constraints: bool = False,
    t: ArrayLike | None = None,
) -> Array:
    """Return the velocities that belong to momenta: ``v_d = M_dd^-1 (p - M_dk v_rho)``, then v_rho.

    Parameters
    ----------
    mechanism : Mechanism
    q : array_like, shape (nq,) or (N, nq)
        Configurations.
    p : array_like, shape (nd,) or (N, nd)
        Momenta of the dynamic variables.
    v_rho : array_like, shape (nrho,) or (N, nrho), optional
        Velocities of the kinematic variables; zero if not given.
    keep_constraints : bool, optional
        Leave out the part that the constraints stop, as they do with a discrete momentum: the nearest velocity
        with ``Dh v = 0`` in the metric of the mass matrix, or ``Dh v + dh/dt = 0``.
    t : array_like, shape () or (N,), optional
        Times (s), where constraints change with the time; those of `Mechanism.at_time` if not given.

    Returns
    -------
    ndarray, shape (nv,) or (N, nv)

    Raises
    ------
    ArgumentError
        For wrong shapes, values that are not finite, or a mass matrix that is singular.
    """
    require_instance(mechanism, "mechanism", Mechanism)
    as_flag(keep_constraints, "keep_constraints")
    m, nd = mechanism, mechanism.nd
    given = {"q": (q, m.nq), "p": (p, nd)}
    if v_rho is not None:
        given["v_rho"] = (v_rho, m.nrho)
    single, (qs, ps, *rhos) = _rows(m, given)
    v = np.empty((len(qs), m.nv))
    if not m.core.velocities(configuration_on(m, qs, "q"), ps, rhos[0] if rhos else None, v):
        raise ArgumentError(_SINGULAR)
    if keep_constraints and m.nc:
        times = np.broadcast_to(m.time if t is None else as_array(t, "t", (), (len(qs),)), len(qs))
        for row, at, when in zip(v, qs, times, strict=True):
            then = m.at_time(when)
            row[:nd] -= ConstraintMetric(then, at).change(then.constraint_rates(at, row))
    return v[0] if single else v


@public
def legendre_jacobian(mechanism: Mechanism, q: ArrayLike, v: ArrayLike) -> Array:
    """Return the derivative T of ``[q; rho; p; v_rho]`` by ``[q; rho; v; v_rho]``.

    Identity but for the rows of p, which are ``[L_vq, L_vv]``. By it a small deviation of one state is one of the
    other: ``dx_discrete = T dx_continuous``. Of rotations that are quaternions both are by turns in the body.

    Parameters
    ----------
    mechanism : Mechanism
    q, v : array_like, shape (nq,) and (nv,), or (N, nq) and (N, nv)

    Returns
    -------
    ndarray, shape (ndx, ndx) or (N, ndx, ndx)
    """
    require_instance(mechanism, "mechanism", Mechanism)
    m, nd, nv = mechanism, mechanism.nd, mechanism.nv
    single, (qs, vs) = _rows(m, {"q": (q, m.nq), "v": (v, nv)})
    T = np.tile(np.eye(2 * nv), (len(qs), 1, 1))
    qs = configuration_on(m, qs, "q")
    for block, at, speed in zip(T, qs, vs, strict=True):
        block[nv : nv + nd, :nv], block[nv : nv + nd, nv:] = momentum_derivatives(m, at, speed)
    return T[0] if single else T


def _rows(m: Mechanism, given: dict[str, tuple[ArrayLike, int]]) -> tuple[bool, list[Array]]:
    """Return whether arguments are single ones, and all of them as rows of equal number."""
    names = {"q": m.coordinates, "v": m.variables, "p": m.dynamic, "v_rho": m.kinematic}
    first = next(iter(given.values()))[0]
    shape = shape_of(first)
    single = shape is None or len(shape) < 2
    count = None if single or shape is None else shape[0]
    wanted = (lambda n: (n,)) if single else (lambda n: (count, n))
    arrays = [as_array(a, what, wanted(n), names=names[what]) for what, (a, n) in given.items()]
    return single, [array[None, :] if single else array for array in arrays]


def solve_mass(matrix: Array, right: Array) -> Array:
    """Return the solution of equations with a mass matrix or with T; an `ArgumentError` if there is none."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        raise ArgumentError(_SINGULAR) from None
