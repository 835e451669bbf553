"""The midpoint step of an `Oracle`, and its derivatives by implicit differentiation.

`step_residuals` is the definition. `step_orders` gives the same and its first two derivatives from those of T, V, h
and f, by nothing but the linear substitutions of the midpoint rule: that way no graph is compiled for the step
itself. `derivatives/elements/test_step.py` holds the two to each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from oracles.mechanism_oracle import Oracle

Orders = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class StepShape:
    """Sizes, and where the parts of ``z = [q2 dynamic; lam; q1; p1; u; rho2]`` are, as matrices that select them."""

    nd: int
    nq: int
    nc: int
    nu: int

    @property
    def ny(self) -> int:
        return self.nd + self.nc

    @property
    def nz(self) -> int:
        return self.ny + self.nq + self.nd + self.nu + self.nq - self.nd

    def _rows(self, *slices: slice) -> np.ndarray:
        return np.eye(self.nz)[np.r_[slices]]

    @property
    def q2(self) -> np.ndarray:
        rho2 = slice(self.nz - self.nq + self.nd, self.nz)
        return np.vstack([self._rows(slice(0, self.nd)), self._rows(rho2)])

    @property
    def lam(self) -> np.ndarray:
        return self._rows(slice(self.nd, self.ny))

    @property
    def q1(self) -> np.ndarray:
        return self._rows(slice(self.ny, self.ny + self.nq))

    @property
    def p1(self) -> np.ndarray:
        return self._rows(slice(self.ny + self.nq, self.ny + self.nq + self.nd))

    @property
    def u(self) -> np.ndarray:
        start = self.ny + self.nq + self.nd
        return self._rows(slice(start, start + self.nu))


def shape_of(oracle: Oracle) -> StepShape:
    return StepShape(oracle.nd, oracle.nq, oracle.nc, oracle.nu)


def force_shares(dt: float, split: str) -> tuple[float, float]:
    """Return how much of a force acts at the start and at the end of a step."""
    return {"symmetric": (dt / 2, dt / 2), "left": (dt, 0.0)}[split]


def step_residuals(oracle: Oracle, dt: float, split: str, z: jnp.ndarray) -> jnp.ndarray:
    """Return ``[F1; F2; p2]``: p1 + D1Ld + fd- - Dh(q1)^T lam, h(q2), D2Ld + fd+."""
    s = shape_of(oracle)
    q1, q2, p1, lam, u = s.q1 @ z, s.q2 @ z, s.p1 @ z, s.lam @ z, s.u @ z
    before, after = force_shares(dt, split)

    def Ld(a: jnp.ndarray, b: jnp.ndarray) -> jnp.ndarray:
        middle, v = (a + b) / 2, (b - a) / dt
        return dt * (oracle.kinetic(middle, v) - oracle.potential(middle))

    D1, D2 = (slot[: s.nd] for slot in jax.grad(Ld, argnums=(0, 1))(q1, q2))
    f = oracle.force((q1 + q2) / 2, (q2 - q1) / dt, u)[: s.nd]
    pull = (lam @ jax.jacfwd(oracle.constraints)(q1))[: s.nd]
    return jnp.concatenate([p1 + D1 + before * f - pull, oracle.constraints(q2), D2 + after * f])


def step_orders(oracle: Oracle, dt: float, split: str, z: np.ndarray) -> Orders:
    """Return `step_residuals` and its first two derivatives by z."""
    s = shape_of(oracle)
    nd, nq = s.nd, s.nq
    middle, rate = (s.q1 + s.q2) / 2, (s.q2 - s.q1) / dt
    moving = np.vstack([middle, rate])
    T = oracle.kinetic_orders(moving @ z)
    V = oracle.potential_orders(middle @ z)
    L = [T[order].copy() for order in range(4)]
    for order in range(4):
        L[order][(slice(nq),) * order] -= V[order]
    slopes = _substituted(L[1:], moving)
    L_q, L_v = ([part[:nd] for part in _rows(slopes, at)] for at in (slice(nq), slice(nq, None)))
    forces = _substituted(oracle.force_orders(np.vstack([moving, s.u]) @ z), np.vstack([moving, s.u]))
    f = _rows(forces, slice(nd))
    before, after = force_shares(dt, split)
    out = []
    pulls = _pulls(oracle, s, z)
    ends = _substituted(oracle.constraint_orders(s.q2 @ z)[:3], s.q2)
    for order in range(3):
        start = dt / 2 * L_q[order] - L_v[order] + before * f[order] - pulls[order][:nd]
        if order < 2:
            start = start + (s.p1 @ z if order == 0 else s.p1)
        end = dt / 2 * L_q[order] + L_v[order] + after * f[order]
        out.append(np.concatenate([start, ends[order], end]))
    return out[0], out[1], out[2]


def _rows(parts: list[np.ndarray], at: slice) -> list[np.ndarray]:
    return [part[at] for part in parts]


def _substituted(parts: list[np.ndarray], by: np.ndarray) -> list[np.ndarray]:
    """Return a function's value, Jacobian and Hessians by z, where its argument is ``by @ z``."""
    value, first, second = parts
    return [value, first @ by, np.einsum("kab,ai,bj->kij", second, by, by, optimize=True)]


def _pulls(oracle: Oracle, s: StepShape, z: np.ndarray) -> list[np.ndarray]:
    """Return ``Dh(q1)^T lam`` and its derivatives by z."""
    _, D, D2, D3 = oracle.constraint_orders(s.q1 @ z)
    lam = s.lam @ z
    first = np.einsum("c,cab,bi->ai", lam, D2, s.q1) + D.T @ s.lam
    both = np.einsum("cab,ci,bj->aij", D2, s.lam, s.q1)
    bent = np.einsum("c,cabd,bi,dj->aij", lam, D3, s.q1, s.q1, optimize=True)
    return [D.T @ lam, first, bent + both + both.transpose(0, 2, 1)]
