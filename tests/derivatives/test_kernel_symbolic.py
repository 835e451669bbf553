"""The kernel against symbolic differentiation (SymPy), so that it is proved without JAX too."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from derivatives.random_tree import Tree, random_tree


def symbolic_lagrangian(tree: Tree, q: list, v: list) -> sympy.Expr:
    """Return L = T - V from 4x4 poses; T of a body is tr(G' J G'^T) / 2 with its 4x4 pseudo-inertia."""
    poses = []
    for parent, base, twist, variable in zip(tree.parent, tree.pose, tree.twist, tree.variable, strict=True):
        x, y, z, a, b, c = (sympy.Float(float(e)) for e in twist)
        hat = sympy.Matrix([[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z], [0, 0, 0, 0]])
        w, s = sympy.sqrt(a**2 + b**2 + c**2), q[variable]
        moved = sympy.eye(4) + s * hat
        if w != 0:
            moved += (1 - sympy.cos(w * s)) / w**2 * hat**2
            moved += (w * s - sympy.sin(w * s)) / w**3 * hat**3
        start = sympy.eye(4) if parent < 0 else poses[parent]
        poses.append(start * sympy.Matrix(base) * moved)
    L = sympy.Integer(0)
    g = sympy.Matrix(tree.gravity)
    for joint, m, com, inertia in zip(tree.body_joint, tree.mass, tree.com, tree.inertia, strict=True):
        J = np.zeros((4, 4))
        J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia + m * np.outer(com, com)
        J[:3, 3] = J[3, :3] = m * com
        J[3, 3] = m
        J = sympy.Matrix(J)
        G = sympy.eye(4) if joint < 0 else poses[joint]
        G_dot = sum((G.diff(a) * b for a, b in zip(q, v, strict=True)), sympy.zeros(4, 4))
        L += (G_dot * J * G_dot.T).trace() / 2 + (g.T * G[:3, :] * J[:, 3])[0]
    return L


@pytest.mark.parametrize(("seed", "kind"), [(0, 0), (1, 0), (4, 4)])
def test_kernel_is_what_sympy_derives(seed: int, kind: int) -> None:
    tree = random_tree(seed, joints=3, kinematic=2, lengths=0, inputs=1, kind=kind)
    tree = tree.without_constraints()
    core, n = tree.core(), tree.nq
    names = sympy.symbols(f"q:{n} v:{n} e:{2 * n}")
    q, v, along = names[:n], names[n : 2 * n], names[2 * n :]
    L = symbolic_lagrangian(tree, q, v)
    z = [*q, *v]
    gradient = [L.diff(a) for a in z]
    hessian = [[row.diff(a) for a in z[: i + 1]] for i, row in enumerate(gradient)]
    third = [[sum(entry.diff(a) * e for a, e in zip(z, along, strict=True)) for entry in row] for row in hessian]
    flat = [L, *gradient, *(e for row in hessian for e in row), *(e for row in third for e in row)]
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, 4 * n)
    wanted = np.array(sympy.lambdify(names, flat, "math", cse=True)(*values), dtype=float)
    rows, columns = np.tril_indices(2 * n)
    at = np.split(wanted, [1, 1 + 2 * n, 1 + 2 * n + len(rows)])

    at_q, at_v, dq, dv = values.reshape(4, n)
    value = core.kinetic_energy(at_q, at_v) - core.potential_energy(at_q)
    assert value == pytest.approx(at[0][0], rel=1e-13)
    compare(np.concatenate(core.gradient(at_q, at_v)), at[1], 1e-12)
    compare(whole(core.hessian(at_q, at_v))[rows, columns], at[2], 1e-12)
    compare(whole(core.third(at_q, at_v, dq, dv))[rows, columns], at[3], 1e-12)


def whole(blocks: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    qq, vq, vv = blocks
    matrix = np.block([[qq, vq.T], [vq, vv]])
    assert np.array_equal(matrix, matrix.T)
    return matrix


def compare(ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> None:
    assert np.abs(theirs).max() > 1e-2
    assert np.abs(ours - theirs).max() < tolerance * np.abs(theirs).max()
