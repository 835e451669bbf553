"""Rotations that are prescribed as quaternions: derivatives of steps by the vectors that they turn by, and a twin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from derivatives.along_directions import check_step
from derivatives.test_quaternions import turned
from leastaction.mechanics import (
    BodyWrench,
    Distance,
    Element,
    Gravity,
    LinearDamper,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    ball,
    free,
    project_velocity,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.numerics.arrays import Array


def carried(*elements: Element) -> Mechanism:
    """A bar that a hand holds and turns, with two bodies that hang on it, and a body beside."""
    lower = ball("hip", axes="quaternion", name="lower", mass=0.4, com=(0.1, 0.03, 0.05), inertia=(0.02, 0.01, 0.015))
    upper = rz("swing", name="upper", mass=0.5, com=(0.1, 0.0, -0.2), inertia=(0.02, 0.01, 0.03))
    bar = free("bar", axes="quaternion", kinematic=True, mass=0.3, com=(0.02, 0.0, 0.05), inertia=(0.01, 0.02, 0.015))
    tip = tx(0.4, name="tip")
    tree: list[Any] = [bar, [tip, ty(0.2), [upper, [tz(-0.4), [lower, [tx(0.2, name="toe")]]]]]]
    beside = free("beside", axes="quaternion", mass=0.6, com=(0.02, 0.0, 0.05), inertia=(0.01, 0.02, 0.015))
    return Mechanism([*tree, beside, [tx(0.1, name="eye")]], [Gravity(), *elements])


FORCES = (LinearSpring("toe", "tip", 40.0, 0.3), LinearDamper("toe", "eye", 0.7), LinearSpring("tip", "eye", 30.0, 0.1))
WRENCHES = (
    BodyWrench("lower", force=(0.1, "push", 0.0), torque=("roll", 0.3, "yaw")),
    BodyWrench("bar", force=(0.0, "blow", 0.2)),
)
ROD = Distance("eye", "tip", 0.9, name="rod")
PIN = PointToPoint("eye", "tip", name="pin")
CASES = {"free": (), "forces": FORCES, "wrenches": WRENCHES, "rod": (ROD,), "all": (PIN, *FORCES, *WRENCHES)}


@pytest.mark.parametrize("elements", list(CASES.values()), ids=list(CASES))
def test_derivatives_are_those_of_differences(elements: tuple[Element, ...]) -> None:
    m = carried(*elements)
    rng = np.random.default_rng(3)
    v = 2.0 * rng.standard_normal(m.nv)
    q = turned(m, rng)
    beside = [m.coordinates.index(f"beside.{letter}") for letter in "xyz"]
    if PIN in elements:
        q[beside] += m.positions(q, ("tip",))[0] - m.positions(q, ("eye",))[0]
    if ROD in elements:
        apart = float(np.linalg.norm(np.diff(m.positions(q, ("eye", "tip")), axis=0)))
        m = m.with_parameters({"rod.length": apart})
    v = project_velocity(m, q, v).v if m.nc else v
    vi = MidpointVI(m, tolerance=1e-15)
    dt = 0.05
    u = np.concatenate(
        [0.3 * rng.standard_normal(m.n_inputs), q[m.first_rho : m.first_rho + 3] + dt * v[m.nd : m.nd + 3]]
    )
    u = np.append(u, dt * v[m.nd + 3 :] + [0.3, -0.2, 0.4])
    check_step(vi, vi.start(q, v).x, u, rng, step=2e-3)


def angles(t: float) -> Array:
    return np.array([0.6 * np.sin(5.0 * t), 0.4 * np.sin(4.0 * t + 0.3), 2.0 * t])


def quaternion(t: float) -> Array:
    return np.roll(Rotation.from_euler("XYZ", angles(t)).as_quat(), 1)


def swung(axes: str, steps: int) -> Trajectory:
    """Simulate a double pendulum on a bar that is turned, by quaternions or by three angles."""
    bar = ball("bar", axes=axes, kinematic=True, mass=0.3, com=(0.1, 0.0, 0.05), inertia=(0.01, 0.02, 0.015))
    upper = rz("swing", name="upper", mass=0.5, com=(0.1, 0.0, -0.2), inertia=(0.02, 0.01, 0.03))
    m = Mechanism([bar, [tx(0.4), [upper, [tz(-0.4), [rz("knee", mass=0.3, com=(0.1, 0.1, 0.0))]]]]], [Gravity()])
    vi, given = MidpointVI(m), quaternion if axes == "quaternion" else angles
    start = vi.start(np.r_[0.3, -0.2, given(0.0)], np.r_[1.0, -2.0, np.zeros(3)])
    return vi.simulate(start, np.linspace(0.0, 1.0, steps + 1), rho=given)


def test_a_bar_that_is_turned_carries_as_by_three_angles() -> None:
    apart, work = [], []
    for steps in (200, 400):
        one, other = swung("quaternion", steps), swung("xyz", steps)
        apart.append(np.abs(one.q[-1, :2] - other.q[-1, :2]).max())
        assert one.balance is not None
        assert other.balance is not None
        work.append(
            abs(
                (one.energy().total[-1] - one.energy().total[0]) / np.ptp(other.energy().total)
                - (other.energy().total[-1] - other.energy().total[0]) / np.ptp(other.energy().total)
            )
        )
    assert 3.6 < apart[0] / apart[1] < 4.4, apart
    assert apart[1] < 1e-3
    assert work[1] < 1e-3


def test_energy_and_work_of_the_hand_balance() -> None:
    balances = [swung(axes, 400).balance for axes in ("quaternion", "xyz")]
    residuals = []
    for balance in balances:
        assert balance is not None
        residuals.append(float(np.abs(balance.residual).max()) / balance.scale)
    assert residuals[0] < 2.0 * residuals[1] + 1e-4


def test_only_turns_of_the_start_and_of_the_step_move_it() -> None:
    """Where it ends is R exp(phi): its derivatives are the exponential's."""
    m = carried()
    vi = MidpointVI(m)
    rows = np.stack([np.r_[0.0, 0.0, 0.0, quaternion(0.1 * k)] for k in range(4)])
    start = m.configuration()
    start[m.first_rho :] = rows[0]
    run = vi.simulate(vi.start(start), 0.01 * np.arange(4), rho=rows)
    assert np.abs(run.rho - rows).max() < 1e-15 or np.abs(run.rho + rows).max() < 1e-15
    phi = run.u[:, -3:]
    exp = Rotation.from_rotvec(phi)
    turns = Rotation.from_quat(np.roll(rows[:, 3:], -1, axis=1))
    assert ((turns[:-1] * exp).inv() * turns[1:]).magnitude().max() < 1e-14
    assert np.abs(run.v_rho[1:, 3:] - phi / 0.01).max() < 1e-12
    d = vi.linearize(run)
    ball_rows = slice(m.nv - 3, m.nv)
    assert np.abs(d.A[:, ball_rows, ball_rows] - exp.inv().as_matrix()).max() < 1e-14
    assert np.abs(d.A[:, ball_rows, : m.nv - 3]).max() == 0.0
