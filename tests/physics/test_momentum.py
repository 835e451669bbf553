"""Noether: what the mechanism does not depend on, its momentum keeps.

The midpoint rule keeps a momentum to rounding where the symmetry acts on the variables by an affine map: on
translations, and on turns about the fixed axis of the first rotation of the root, which turn the translations
and shift that angle. The other two components of the angular momentum it keeps to second order.
"""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import Damping, Gravity, JointForce, Mechanism, Trajectory
from physics.laws import floating_chain, in_motion, measured_order, swing, times

ROUNDING = 1e-12  # a step, relative to the size of the momentum


def momentum(run: Trajectory, name: str) -> np.ndarray:
    return run.p[:, run.mechanism.dynamic.index(name)]


def assert_kept(values: np.ndarray, size: float) -> None:
    assert np.abs(np.diff(values)).max() < ROUNDING * size
    # No drift either: rounding alone, which wanders with the root of the number of steps.
    assert np.abs(values - values[0]).max() < ROUNDING * size * np.sqrt(len(values))


def about_axis(run: Trajectory, first: str) -> np.ndarray:
    """Return the angular momentum about the axis of the first rotation, through the world's origin."""
    axis = "xyz".index(first[1])
    i, j = (axis + 1) % 3, (axis + 2) % 3
    moved = run["xyz"[i]] * momentum(run, "xyz"[j]) - run["xyz"[j]] * momentum(run, "xyz"[i])
    return moved + momentum(run, "a")


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_linear_momentum_of_a_free_chain(seed: int) -> None:
    m = floating_chain()
    run = swing(m, *in_motion(m, seed), times(2.0, 200))
    size = np.abs(run.p).max()
    for name in "xyz":
        assert_kept(momentum(run, name), size)
    assert np.ptp(momentum(run, "b")) > 1e-2 * size  # the others do change


@pytest.mark.parametrize("first", ["rx", "ry", "rz"])
def test_angular_momentum_about_the_axis_of_the_first_rotation(first: str) -> None:
    m = floating_chain(first)
    run = swing(m, *in_motion(m, 1), times(2.0, 200))
    values = about_axis(run, first)
    assert np.abs(values[0]) > 1e-2
    assert_kept(values, max(np.abs(run.p).max(), np.abs(run["x"] * momentum(run, "y")).max()))


def test_gravity_keeps_what_is_level_and_turns_about_it() -> None:
    m = floating_chain(elements=[Gravity((0.0, 0.0, -3.0))])
    run = swing(m, *in_motion(m, 3), times(2.0, 200))
    size = np.abs(run.p).max()
    assert_kept(momentum(run, "x"), size)
    assert_kept(momentum(run, "y"), size)
    assert_kept(about_axis(run, "rz"), size)
    mass = m.mass_matrix(np.zeros(m.nq))[0, 0]
    fallen = momentum(run, "z") - momentum(run, "z")[0]
    assert fallen == pytest.approx(-3.0 * mass * run.t, abs=1e-9)


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_forces_inside_the_chain_keep_the_momentum(split: str) -> None:
    inside = [Damping({"shoulder": 0.3, "elbow": 0.2}), JointForce("hip", input="motor")]
    m = floating_chain(elements=inside)
    run = swing(m, *in_motion(m, 5), times(2.0, 200), inputs=lambda t: [np.sin(9 * t)], split=split)
    size = np.abs(run.p).max()
    for name in "xyz":
        assert_kept(momentum(run, name), size)
    assert_kept(about_axis(run, "rz"), size)


def angular_momentum(m: Mechanism, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the angular momentum about the world's origin from dL/dv, through the turns of the root."""
    p = m.momentum(q, v)
    cos, sin = np.cos, np.sin
    a, b = q[3], q[4]
    # Axes of the root's rotations rz(a) rx(b) ry(c); a turn w of the world is w = axes (da, db, dc).
    Z = np.array([[cos(a), -sin(a), 0.0], [sin(a), cos(a), 0.0], [0.0, 0.0, 1.0]])
    X = np.array([[1.0, 0.0, 0.0], [0.0, cos(b), -sin(b)], [0.0, sin(b), cos(b)]])
    axes = np.column_stack([[0.0, 0.0, 1.0], Z[:, 0], (Z @ X)[:, 1]])
    rates = np.linalg.inv(axes)  # column i: rates of the angles for a turn about axis i of the world
    return np.cross(q[:3], p[:3]) + rates.T @ p[3:6]


def test_all_of_the_angular_momentum_is_kept_to_second_order() -> None:
    m = floating_chain()
    assert m.dynamic[:6] == ("x", "y", "z", "a", "b", "c")
    q, v = in_motion(m, 2)

    def error(steps: int) -> float:
        run = swing(m, q, v, times(1.0, steps))
        values = [angular_momentum(m, x, w) for x, w in zip(0.5 * (run.q[1:] + run.q[:-1]), run.v, strict=True)]
        return float(np.abs(np.array(values) - angular_momentum(m, q, v)).max())

    assert measured_order(error, (200, 400, 800)) == pytest.approx(2.0, abs=0.1)
