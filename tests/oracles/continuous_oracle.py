"""The equations of motion of an `Oracle` in continuous time, with their first and second derivatives.

`equations` is the definition. `equation_orders` gives the same with its derivatives from those of T, V, h and f: third
orders are JAX's, and the fourth, of which one direction is enough, the difference of third orders along it. That way no
graph is compiled for the equations themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from oracles.mechanism_oracle import Oracle

# Central difference of eighth order: at this step its error and that of rounding are both some 1e-12.
STEP = 0.01
STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))


class At(NamedTuple):
    """A point: all variables' accelerations, and the multipliers."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    lam: np.ndarray
    u: np.ndarray


class Orders(NamedTuple):
    """The equations and their derivatives by ``z = [q; v; a; lam; u]``: (n,), (n, nz), (n, nz, nz)."""

    value: np.ndarray
    first: np.ndarray
    second: np.ndarray


def equations(oracle: Oracle, at: At) -> jnp.ndarray:
    """Return ``r - Dh' lam`` of the dynamic variables, then ``d2h/dt2``."""

    def L(q: jnp.ndarray, v: jnp.ndarray) -> jnp.ndarray:
        return oracle.kinetic(q, v) - oracle.potential(q)

    def path(s: jnp.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
        return at.q + s * at.v + s**2 / 2 * at.a, at.v + s * at.a

    momentum_rate = jax.jacfwd(lambda s: jax.grad(L, argnums=1)(*path(s)))(0.0)
    r = momentum_rate - jax.grad(L)(at.q, at.v) - oracle.force(at.q, at.v, at.u)
    h_rate = jax.jacfwd(jax.jacfwd(lambda s: oracle.constraints(path(s)[0])))(0.0)
    pull = at.lam @ jax.jacfwd(oracle.constraints)(at.q)
    return jnp.concatenate([(r - pull)[: oracle.nd], h_rate])


def along(function: Callable[[np.ndarray], np.ndarray], z: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return the derivative of a function along w by differences."""
    h = STEP / max(np.abs(w).max(initial=0.0), 1.0)
    terms = [c * (function(z + k * h * w) - function(z - k * h * w)) for k, c in STENCIL]
    return np.asarray(sum(terms) / h)


def equation_orders(oracle: Oracle, at: At) -> Orders:
    """Return `equations` and their derivatives."""
    nd, nq, nc, nu = oracle.nd, oracle.nq, oracle.nc, oracle.nu
    Q, V, A = (slice(k * nq, (k + 1) * nq) for k in range(3))
    M, U = slice(3 * nq, 3 * nq + nc), slice(3 * nq + nc, 3 * nq + nc + nu)
    nz = U.stop
    value, first = np.zeros(nq + nc), np.zeros((nq + nc, nz))
    second = np.zeros((nq + nc, nz, nz))

    def put(rows: slice, i: slice, j: slice, block: np.ndarray) -> None:
        """Add a block and, off the diagonal, its mirror image."""
        second[rows, i, j] += block
        if i != j:
            second[rows, j, i] += block.transpose(0, 2, 1)

    # r_i = T_(v_i z_k) w_k - T_(q_i) with z = [q; v], w = [v; a]
    z, w = np.concatenate([at.q, at.v]), np.concatenate([at.v, at.a])
    _, T1, T2, T3 = oracle.kinetic_orders(z)
    T4 = along(lambda y: oracle.kinetic_orders(y)[3], z, w)
    R = slice(0, nq)
    value[R] = T2[V] @ w - T1[Q]
    first[R, : 2 * nq] = T3[V] @ w - T2[Q]
    first[R, V] += T2[V, Q]
    first[R, A] = T2[V, V]
    second[R, : 2 * nq, : 2 * nq] = T4[V] - T3[Q]
    second[R, : 2 * nq, V] += T3[V, :, Q]
    second[R, V, : 2 * nq] += T3[V, Q, :]
    put(R, Q, A, T3[V, Q, V])
    put(R, V, A, T3[V, V, V])

    _, V1, V2, V3 = oracle.potential_orders(at.q)
    value[R] += V1
    first[R, Q] += V2
    put(R, Q, Q, V3)

    f0, f1, f2 = oracle.force_orders(np.concatenate([at.q, at.v, at.u]))
    to = np.r_[Q, V, U]
    value[R] -= f0
    first[R, to] -= f1
    second[R, to[:, None], to] -= f2

    _, h1, h2, h3 = oracle.constraint_orders(at.q)
    h4 = along(lambda y: oracle.constraint_orders(y)[3], at.q, at.v)
    value[R] -= at.lam @ h1
    first[R, Q] -= np.tensordot(at.lam, h2, 1)
    first[R, M] -= h1.T
    put(R, Q, Q, -np.tensordot(at.lam, h3, 1))
    put(R, Q, M, -h2.transpose(1, 2, 0))
    C = slice(nq, None)
    value[C] = h1 @ at.a + h2 @ at.v @ at.v
    first[C, Q] = h2 @ at.a + h3 @ at.v @ at.v
    first[C, V] = 2.0 * h2 @ at.v
    first[C, A] = h1
    put(C, Q, Q, h3 @ at.a + h4 @ at.v)
    put(C, Q, V, 2.0 * h3 @ at.v)
    put(C, V, V, 2.0 * h2)
    put(C, Q, A, h2)

    rows = np.r_[:nd, nq : nq + nc]
    return Orders(value[rows], first[rows], second[rows])


def differentiate_implicitly(orders: Orders, nd: int, nq: int, nc: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second derivatives of ``[a; lam]`` by ``[q; v; u; rho_a]``."""
    nz = orders.first.shape[1]
    y = np.r_[2 * nq : 2 * nq + nd, 3 * nq : 3 * nq + nc]
    th = np.r_[: 2 * nq, 3 * nq + nc : nz, 2 * nq + nd : 3 * nq]
    F_y = orders.first[:, y]
    Y = -np.linalg.solve(F_y, orders.first[:, th])
    change = np.zeros((nz, len(th)))
    change[y] = Y
    change[th] = np.eye(len(th))
    bent = np.einsum("kab,ai,bj->kij", orders.second, change, change, optimize=True)
    Y2 = -np.linalg.solve(F_y, bent.reshape(len(y), -1)).reshape(bent.shape)
    return Y, Y2
