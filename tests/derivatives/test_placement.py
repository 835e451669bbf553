"""Where joints put their frames: the core's own sines and cosines, and screws against the matrix exponential."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from leastaction import _core


def one_joint(twist: list[float]) -> _core.Mechanism:
    builder = _core.MechanismBuilder(1, 0, 0)
    joint = builder.add_joint(-1, np.eye(4), np.array(twist), 0)
    builder.add_body(joint, 1.0, np.array([0.1, 0.2, 0.3]), np.eye(3))
    return builder.build()


def test_sines_and_cosines_to_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(0)
    quarter = np.pi / 2 * np.arange(-40, 41)
    angles = np.concatenate(
        [
            rng.uniform(-10.0, 10.0, 20001),
            rng.uniform(-9e4, 9e4, 20001),
            rng.uniform(-1e-8, 1e-8, 101),
            quarter,
            np.nextafter(quarter, np.inf),
            np.pi / 4 * np.arange(-41, 42, 2),
        ]
    )
    poses = one_joint([0, 0, 0, 0, 0, 1]).joint_poses(angles[:, None])
    exact = angles.astype(np.longdouble)
    for computed, reference in (
        (poses[:, 0, 1, 0], np.sin(exact)),
        (poses[:, 0, 0, 0], np.cos(exact)),
    ):
        error = np.abs(computed - reference).astype(float)
        assert np.max(error / np.spacing(np.maximum(np.abs(computed), 1e-5))) < 2.2
    assert np.abs(poses[:, 0, 1, 0]).max() > 0.9


def test_angles_beyond_the_fast_range() -> None:
    angles = np.array([1e5, -3e5, 1e9, 2.5e15, 0.3])
    poses = one_joint([0, 0, 0, 0, 0, 1]).joint_poses(angles[:, None])
    np.testing.assert_allclose(poses[:, 0, 1, 0], np.sin(angles), rtol=0, atol=2e-16)
    np.testing.assert_allclose(poses[:, 0, 0, 0], np.cos(angles), rtol=0, atol=2e-16)


def test_screws_against_the_matrix_exponential() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        v, w = rng.normal(size=3), rng.normal(size=3)
        generator = np.zeros((4, 4))
        generator[:3, :3] = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        generator[:3, 3] = v
        q = rng.uniform(-3.0, 3.0)
        pose = one_joint([*v, *w]).joint_poses(np.array([[q]]))[0, 0]
        np.testing.assert_allclose(pose, expm(generator * q), atol=5e-14)
