"""An independent Lagrangian, and the midpoint step on it, by automatic differentiation (JAX).

Nothing here knows of twists in world coordinates, composite inertias or ancestors: poses are 4x4 matrices,
velocities their derivatives along v, and the kinetic energy of a body is ``tr(G' J G'^T) / 2`` with its 4x4
pseudo-inertia J. One compiled graph serves all trees of the same size.
"""

from __future__ import annotations

from dataclasses import fields
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from derivatives.random_tree import Tree

Data = dict[str, jnp.ndarray]


def data_of(tree: Tree) -> Data:
    """Return the tree as arrays, with the 4x4 constants of its twists and bodies."""
    out = {
        f.name: jnp.asarray(getattr(tree, f.name))
        for f in fields(tree)
        if f.name not in ("n_dynamic", "n_kinematic", "com", "inertia", "twist")
    }
    hats = np.zeros((len(tree.twist), 4, 4))
    for hat, (x, y, z, a, b, c) in zip(hats, tree.twist, strict=True):
        hat[:3] = [[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z]]
    out["hat"] = jnp.asarray(hats)
    out["rate"] = jnp.asarray(np.linalg.norm(tree.twist[:, 3:], axis=1))
    pseudo = np.zeros((len(tree.mass), 4, 4))
    for J, m, c, inertia in zip(pseudo, tree.mass, tree.com, tree.inertia, strict=True):
        # int r r^T dm about the centre of mass from int (r.r E - r r^T) dm, then moved by c
        J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia + m * np.outer(c, c)
        J[:3, 3] = J[3, :3] = m * c
        J[3, 3] = m
    # Empty bodies fill up, so that trees of the same size share one compiled graph.
    spare = len(tree.parent) + 1 - len(pseudo)
    out["pseudo"] = jnp.asarray(np.concatenate([pseudo, np.zeros((spare, 4, 4))]))
    out["body_joint"] = jnp.asarray(np.concatenate([tree.body_joint, np.full(spare, -1)]))
    del out["mass"]
    return out


def exponential(hat: jnp.ndarray, rate: jnp.ndarray, s: jnp.ndarray) -> jnp.ndarray:
    """Return exp(hat s): hat^4 = -rate^2 hat^2 for every twist, so the series ends after hat^3."""
    turns = rate > 0.0
    w = jnp.where(turns, rate, 1.0)
    second = jnp.where(turns, (1.0 - jnp.cos(w * s)) / w**2, 0.0)
    third = jnp.where(turns, (w * s - jnp.sin(w * s)) / w**3, 0.0)
    return jnp.eye(4) + s * hat + second * hat @ hat + third * hat @ hat @ hat


def poses(d: Data, q: jnp.ndarray) -> jnp.ndarray:
    """Return the poses of the joints' moved frames, and that of the world as the last one."""
    n = len(d["parent"])
    start = jnp.tile(jnp.eye(4), (n + 1, 1, 1))

    def move(G: jnp.ndarray, joint: tuple) -> tuple[jnp.ndarray, None]:
        j, parent, base, hat, rate, variable = joint
        return G.at[j].set(G[parent] @ base @ exponential(hat, rate, q[variable])), None

    names = ("parent", "pose", "hat", "rate", "variable")
    return jax.lax.scan(move, start, (jnp.arange(n), *(d[name] for name in names)))[0]


joint_poses = jax.jit(poses)


def lagrangian(d: Data, q: jnp.ndarray, v: jnp.ndarray) -> jnp.ndarray:
    G, G_dot = jax.jvp(partial(poses, d), (q,), (v,))
    J = d["pseudo"]
    kinetic = 0.5 * jnp.einsum("bij,bjk,bik", G_dot[d["body_joint"]], J, G_dot[d["body_joint"]])
    return kinetic + jnp.einsum("i,bij,bj", d["gravity"], G[d["body_joint"], :3], J[:, :, 3])


def constraints(d: Data, q: jnp.ndarray) -> jnp.ndarray:
    offset = jnp.concatenate([d["point_offset"], jnp.ones((len(d["point_offset"]), 1))], axis=1)
    points = jnp.einsum("pij,pj->pi", poses(d, q)[d["point_joint"]], offset)[:, :3]
    apart = points[d["ends"][:, 0]] - points[d["ends"][:, 1]]
    length = jnp.where(d["length_variable"] < 0, d["length"], q[d["length_variable"]])
    return jnp.sum(apart**2, axis=1) - length**2


@jax.jit
def kernel(d: Data, q: jnp.ndarray, v: jnp.ndarray, dq: jnp.ndarray, dv: jnp.ndarray) -> dict:
    """Return the gradient, the Hessian and its derivative along (dq, dv), all by z = [q; v]."""
    n = len(q)

    def L(z: jnp.ndarray) -> jnp.ndarray:
        return lagrangian(d, z[:n], z[n:])

    z, dz = jnp.concatenate([q, v]), jnp.concatenate([dq, dv])
    hessian, third = jax.jvp(jax.jacfwd(jax.jacfwd(L)), (z,), (dz,))
    return {"L": L(z), "gradient": jax.jacfwd(L)(z), "hessian": hessian, "third": third}


@jax.jit
def constraint_values(d: Data, q: jnp.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
    """Return h and Dh."""
    return constraints(d, q), jax.jacfwd(partial(constraints, d))(q)


def step_equations(d: Data, nd: int, step: jnp.ndarray, y: jnp.ndarray, th: jnp.ndarray) -> jnp.ndarray:
    """Return ``[F1; F2; p2]`` of one step at y = [q2 dynamic; lam], th = [q1; p1; u; rho2].

    ``step`` is ``[dt, kappa-, kappa+]``: the forces act with kappa- f at the start and kappa+ f at the end.
    """
    dt, before, after = step
    nu = d["inputs"].shape[1]
    nq = (len(th) - nu) // 2
    q1, p1, u, rho2 = jnp.split(th, [nq, nq + nd, nq + nd + nu])
    q2, lam = jnp.concatenate([y[:nd], rho2]), y[nd:]

    def Ld(a: jnp.ndarray, b: jnp.ndarray) -> jnp.ndarray:
        return dt * lagrangian(d, (a + b) / 2, (b - a) / dt)

    D1, D2 = (slot[:nd] for slot in jax.grad(Ld, argnums=(0, 1))(q1, q2))
    f = d["inputs"] @ u - d["damping"] * (q2 - q1)[:nd] / dt
    pull = jax.vjp(partial(constraints, d), q1)[1](lam)[0][:nd]
    return jnp.concatenate([p1 + D1 + before * f - pull, constraints(d, q2), D2 + after * f])


@partial(jax.jit, static_argnums=1)
def step_derivatives(
    d: Data, nd: int, step: jnp.ndarray, y: jnp.ndarray, th: jnp.ndarray
) -> tuple[jnp.ndarray, jnp.ndarray, jnp.ndarray]:
    """Return `step_equations`, their Jacobian and their second derivatives by ``[y; th]``."""
    ny = len(y)

    def equations(z: jnp.ndarray) -> jnp.ndarray:
        return step_equations(d, nd, step, z[:ny], z[ny:])

    z = jnp.concatenate([y, th])
    return equations(z), jax.jacfwd(equations)(z), jax.jacfwd(jax.jacfwd(equations))(z)


def differentiate_implicitly(
    values: tuple[np.ndarray, np.ndarray, np.ndarray], nd: int, ny: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second derivatives of ``[q2; lam; p2]`` by th from those of the equations.

    From F(y(th), th) = 0, differentiated once and twice; p2 = G(y(th), th) by the chain rule.
    """
    _, first, second = (np.asarray(value) for value in values)
    n_th = first.shape[1] - ny
    F_y = first[:ny, :ny]
    Y = -np.linalg.solve(F_y, first[:ny, ny:])
    along = np.vstack([Y, np.eye(n_th)])  # d[y; th]/dth
    bent = np.einsum("kab,ai,bj->kij", second, along, along)
    Y2 = -np.linalg.solve(F_y, bent[:ny].reshape(ny, -1)).reshape(ny, n_th, n_th)
    P = first[ny:] @ along
    P2 = bent[ny:] + np.einsum("ka,aij->kij", first[ny:, :ny], Y2)
    return np.vstack([Y, P]), np.concatenate([Y2, P2])
