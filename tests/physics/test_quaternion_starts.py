"""Rotations that are quaternions: configurations and velocities on constraints, and equilibria, in their directions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from leastaction.errors import ContradictoryConstraintsError
from leastaction.mechanics import (
    Distance,
    Gravity,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    equilibrium,
    free,
    pose,
    project_configuration,
    project_velocity,
    tx,
)
from leastaction.mechanics.mechanism.turns import difference, moved_by
from leastaction.numerics.arrays import Array

TURNED = np.array([0.3, -0.5, 0.7, 0.4]) / np.linalg.norm([0.3, -0.5, 0.7, 0.4])


def pinned(axes: str = "quaternion") -> Mechanism:
    """A floating body pinned at one point, with an arm on a ball joint that a rod holds."""
    base = free("base", axes=axes, mass=2.0, com=(0.1, 0.0, 0.05), inertia=(0.1, 0.2, 0.15))
    arm = ball("arm", axes=axes, mass=0.5, com=(0.2, 0.07, 0.02), inertia=(0.01, 0.02, 0.03))
    tree = [base, [pose(translation=(0.0, -0.3, 0.1), name="pin"), tx(0.3), [arm, [tx(0.4, name="tip")]]]]
    springs = [LinearSpring("tip", "hook", 30.0, 0.1), LinearSpring("base", "hook", 10.0, 0.1)]
    rest = [pose(translation=(0.2, 0.5, 0.3), name="hook"), pose(translation=(0.0, 0.0, 0.6), name="nail")]
    held = [PointToPoint("pin", "nail", name="joint"), Distance("tip", "hook", 0.7, name="rod")]
    return Mechanism([*tree, *rest], [Gravity(), *springs, *held])


def begun(m: Mechanism) -> Array:
    q = m.configuration({"base.x": 0.2, "base.z": 0.3})
    for name in ("base", "arm"):
        place = m.coordinates.index(f"{name}.qw")
        q[place : place + 4] = TURNED
    return q


@pytest.mark.parametrize("weighed", [False, True])
def test_nearest_configuration(weighed: bool) -> None:
    """Against SciPy's SLSQP on rotation vectors."""
    m = pinned()
    q = begun(m)
    weights = {"base.wx": 4.0, "arm.wz": 0.3} if weighed else {}
    found = project_configuration(m, q, weights=weights)
    w = m.velocity(weights, default=1.0)
    best = minimize(
        lambda d: 0.5 * d @ (w * d), np.zeros(m.nv), jac=lambda d: w * d, method="SLSQP", tol=1e-14,
        constraints={"type": "eq", "fun": lambda d: m.constraint_values(moved_by(m, q, d))}, options={"maxiter": 500},
    )  # fmt: skip
    assert best.success
    assert np.abs(m.constraint_values(found.q)).max() < 1e-14
    moved = difference(m, found.q, q)
    assert 0.5 * moved @ (w * moved) == pytest.approx(best.fun, rel=1e-9)
    assert np.abs(moved - best.x).max() < 1e-6
    assert found.correction == pytest.approx(dict(zip(m.variables, moved, strict=True)))
    assert max(found.correction, key=lambda name: abs(found.correction[name])) == next(iter(found.correction))
    MidpointVI(m).start(found.q)


def test_what_is_held_stays() -> None:
    m = pinned()
    q = begun(m)
    found = project_configuration(m, q, hold=["base.wx", "base.wy", "base.wz"])
    assert difference(m, found.q, q)[3:6] == pytest.approx(np.zeros(3), abs=1e-15)
    with pytest.raises(ContradictoryConstraintsError, match=r"'rod'.*'arm\.w"):
        project_configuration(m, q, hold=[name for name in m.variables if name.startswith(("arm", "base.w"))])


def test_nearest_velocity() -> None:
    m = pinned()
    q = project_configuration(m, begun(m)).q
    wanted = np.linspace(-1.0, 1.0, m.nv)
    found = project_velocity(m, q, wanted, weights={"base.wx": 3.0})
    h = 1e-6
    rate = (m.constraint_values(moved_by(m, q, h * found.v)) - m.constraint_values(moved_by(m, q, -h * found.v))) / h
    assert np.abs(rate).max() < 1e-8
    # What is left is across all velocities that keep the constraints, in the metric of the weights.
    along = np.linalg.svd(m.constraint_jacobian(q))[2][m.nc :]
    assert np.abs(along @ (m.velocity({"base.wx": 3.0}, default=1.0) * (found.v - wanted))).max() < 1e-12


def test_equilibrium_is_that_of_angles() -> None:
    m, twin = pinned(), pinned("xyz")
    found = equilibrium(m, begun(m))
    angles = [Rotation.from_quat(np.roll(TURNED, -1)).as_euler("XYZ")] * 2
    place = begun(m)[:3]
    other = equilibrium(twin, np.r_[place, angles[0], angles[1]])
    if other.potential > found.potential + 1e-9:  # each went down its own way
        poses = [m.frame_pose(found.q, name)[:3, :3] for name in ("base", "arm")]
        parts = [poses[0], poses[0].T @ poses[1]]
        angles = [Rotation.from_matrix(R).as_euler("XYZ") for R in parts]
        other = equilibrium(twin, np.r_[found.q[:3], angles[0], angles[1]])
    assert found.residual < 1e-10
    assert found.potential == pytest.approx(other.potential, rel=1e-12)
    assert found.stability is other.stability
    assert found.eigenvalues == pytest.approx(other.eigenvalues, rel=1e-7)
    assert m.positions(found.q, ("tip",))[0] == pytest.approx(twin.positions(other.q, ("tip",))[0], abs=1e-8)
    for name, value in found.multipliers.items():
        assert value == pytest.approx(other.multipliers[name], rel=1e-7)


def test_springs_of_the_joint_hold_a_beam() -> None:
    """A beam that sticks out along x sinks by ``m g l cos a = k a``."""
    beam = ball("clamp", axes="quaternion", mass=1.0, com=(0.5, 0.0, 0.0), inertia=(0.01, 0.1, 0.1))
    m = Mechanism([beam], [Gravity((0.0, 0.0, -9.81)), *[JointSpring(f"clamp.w{x}", 8.0) for x in "xyz"]])
    found = equilibrium(m, m.configuration())
    angle = Rotation.from_quat(np.roll(found.q, -1)).as_rotvec()
    assert angle[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert 8.0 * angle[1] == pytest.approx(9.81 * 0.5 * np.cos(angle[1]), rel=1e-12)
    # Where it stays, it stays in time.
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(found.q), np.linspace(0.0, 1.0, 51))
    assert np.abs(run.q - found.q).max() < 1e-12
