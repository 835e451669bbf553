"""The kernel and the constraints against automatic differentiation on random trees."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jax")

from scipy.linalg import expm

from derivatives.random_tree import Tree, random_tree
from oracles import lagrangian as oracle

SEEDS = range(12)


def relative(ours: np.ndarray, theirs: np.ndarray) -> float:
    theirs = np.asarray(theirs)
    assert ours.shape == theirs.shape
    assert np.abs(theirs).max() > 1e-2, "nothing is compared with nothing"
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def point(tree: Tree, seed: int) -> np.ndarray:
    return np.random.default_rng([seed, 1]).uniform(-1.0, 1.0, (4, tree.nq))


def by_qv(blocks: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return (L_qq, L_vq, L_vv) as the whole matrix by [q; v]."""
    qq, vq, vv = blocks
    return np.block([[qq, vq.T], [vq, vv]])


def test_trees_have_what_they_are_to_prove() -> None:
    trees = [random_tree(seed) for seed in SEEDS]
    branched = [np.bincount(t.parent + 1, minlength=2)[1:].max() > 1 for t in trees]
    assert all(not np.array_equal(t.variable, np.arange(len(t.variable))) for t in trees)  # an order of their own
    assert sum(branched) >= 6
    assert all(np.isin(t.body_joint, np.flatnonzero(t.variable >= t.n_dynamic)).any() for t in trees)
    assert all(len(set(t.body_joint)) < len(t.body_joint) for t in trees)  # two bodies on one joint
    assert all(np.abs(t.inertia[0] - np.diag(np.diag(t.inertia[0]))).max() > 1e-3 for t in trees)
    # every kind of joint: axes, lines, screws
    kinds = {(bool(v.any()), bool(w.any())) for t in trees for v, w in t.twist.reshape(-1, 2, 3)}
    assert kinds == {(True, True), (True, False), (False, True)}


def test_exponential_of_the_oracle_is_the_exponential() -> None:
    tree = random_tree(3)
    d = oracle.data_of(tree)
    for hat, rate in zip(d["hat"], d["rate"], strict=True):
        for s in (-2.0, 1e-3, 0.7):
            difference = oracle.exponential(hat, rate, s) - expm(np.asarray(hat) * s)
            assert np.abs(difference).max() < 1e-14


@pytest.mark.parametrize("seed", SEEDS)
def test_lagrangian(seed: int) -> None:
    tree = random_tree(seed)
    core, (q, v, dq, dv) = tree.core(), point(tree, seed)
    wanted = oracle.kernel(oracle.data_of(tree), q, v, dq, dv)
    value = core.kinetic_energy(q, v) - core.potential_energy(q)
    assert value == pytest.approx(float(wanted["L"]), rel=1e-12, abs=1e-12)
    assert relative(np.concatenate(core.gradient(q, v)), wanted["gradient"]) < 1e-12
    assert relative(by_qv(core.hessian(q, v)), wanted["hessian"]) < 1e-12


@pytest.mark.parametrize("seed", SEEDS)
def test_third_order_along_a_direction(seed: int) -> None:
    tree = random_tree(seed)
    core, (q, v, dq, dv) = tree.core(), point(tree, seed)
    wanted = oracle.kernel(oracle.data_of(tree), q, v, dq, dv)
    third = by_qv(core.third(q, v, dq, dv))
    assert relative(third, wanted["third"]) < 1e-12
    # It is not the finite difference itself, which is near, but not that near.
    h = 1e-5
    plus, minus = (by_qv(core.hessian(q + e * dq, v + e * dv)) for e in (h, -h))
    assert 1e-12 < relative((plus - minus) / (2 * h), wanted["third"]) < 1e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_joint_poses(seed: int) -> None:
    tree = random_tree(seed)
    q = point(tree, seed)[:2]
    ours = tree.core().joint_poses(q)
    for row, configuration in zip(ours, q, strict=True):
        theirs = np.asarray(oracle.joint_poses(oracle.data_of(tree), configuration))[:-1]
        assert np.abs(row - theirs[tree.core_joints()]).max() < 1e-13


@pytest.mark.parametrize("seed", SEEDS)
def test_distance(seed: int) -> None:
    tree = random_tree(seed)
    core, q = tree.core(), point(tree, seed)[0]
    h, Dh = oracle.constraint_values(oracle.data_of(tree), q)
    assert len(h) == 3
    assert relative(core.constraints(q), h) < 1e-12
    assert relative(core.constraint_jacobian(q), Dh) < 1e-12
    assert np.all(np.abs(Dh).max(axis=1) > 1e-2)
