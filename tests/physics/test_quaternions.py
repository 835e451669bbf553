"""Rotations that are quaternions: what bodies keep, at which order, and the same motion however described."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Gravity,
    Mechanism,
    MidpointVI,
    PointToPoint,
    Trajectory,
    ball,
    free,
    project_configuration,
    project_velocity,
    tx,
)
from leastaction.numerics.arrays import Array

INERTIA, COM, GRAVITY = np.array([0.35, 0.4, 0.25]), np.array([0.05, -0.03, 0.4]), 9.81
SPIN = np.array([1.0, -2.0, 9.0])
TURNED = np.array([0.5, 0.5, -0.5, 0.5])


def heavy_top() -> Mechanism:
    return Mechanism([ball("top", axes="quaternion", mass=1.1, com=COM, inertia=INERTIA)], [Gravity()])


def turns(run: Trajectory, name: str) -> Rotation:
    """Return the rotation of a joint over time."""
    return Rotation.from_quat(np.stack([run[f"{name}.q{letter}"] for letter in "xyzw"], axis=-1))


def by_equations(t: float) -> Rotation:
    """Return where the top is after a time, by Euler's equations and a method of order eight."""
    about_point = np.diag(INERTIA) + 1.1 * (COM @ COM * np.eye(3) - np.outer(COM, COM))

    def rate(_: float, y: Array) -> Array:
        q, w = y[:4], y[4:]
        down = Rotation.from_quat(np.roll(q, -1)).inv().apply([0.0, 0.0, -GRAVITY])
        torque = 1.1 * np.cross(COM, down) - np.cross(w, about_point @ w)
        turning = 0.5 * np.r_[-q[1:] @ w, q[0] * w + np.cross(q[1:], w)]
        return np.r_[turning, np.linalg.solve(about_point, torque)]

    found = solve_ivp(rate, (0.0, t), np.r_[TURNED, SPIN], method="DOP853", rtol=1e-12, atol=1e-13)
    return Rotation.from_quat(np.roll(found.y[:4, -1], -1))


def test_heavy_top_is_followed_to_second_order() -> None:
    vi, exact, errors = MidpointVI(heavy_top()), by_equations(2.0), []
    for steps in (200, 400, 800):
        run = vi.simulate(vi.start(TURNED, SPIN), np.linspace(0.0, 2.0, steps + 1))
        errors.append((exact.inv() * turns(run, "top")[-1]).magnitude())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - 2.0).max() < 0.01, (errors, orders)
    assert errors[-1] < 1e-4


def test_heavy_top_keeps_its_vertical_momentum_and_its_energy() -> None:
    vi = MidpointVI(heavy_top(), tolerance=1e-15)
    run = vi.simulate(vi.start(TURNED, SPIN), np.arange(2001) * 0.01)
    vertical = turns(run, "top").apply(run.p.copy())[:, 2]
    assert np.ptp(vertical) < 1e-13 * np.abs(run.p).max()
    energy = run.energy().total
    first, last = energy[:500], energy[-500:]
    assert abs(first.mean() - last.mean()) < 0.1 * np.ptp(first)
    assert np.ptp(energy) < 1e-2 * np.abs(energy).max()
    quaternions = run.q[:, :4]
    assert np.abs(np.linalg.norm(quaternions, axis=1) - 1.0).max() < 1e-15
    # The quaternion goes on without a jump where another of the same rotation is nearer to the first.
    assert np.linalg.norm(np.diff(quaternions, axis=0), axis=1).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-13, 1e-15])
def test_momentum_maps_over_many_steps(tolerance: float) -> None:
    """The rounding of one step is 1e-16 of it; over 1e5 it must not add up, whatever residual steps are left with."""
    vi = MidpointVI(heavy_top(), tolerance=tolerance)
    run = vi.simulate(vi.start(TURNED, SPIN), np.arange(100_001) * 0.01)
    vertical = turns(run, "top").apply(run.p.copy())[:, 2]
    assert np.ptp(vertical) < 1e-12 * np.abs(run.p).max()
    for speed in (np.zeros(3), -np.cross([1e-3, 8.0, 1e-3], NUT_COM)):  # it travels 800 m, or stays
        vi = MidpointVI(nut(), tolerance=tolerance)
        run = vi.simulate(vi.start(nut().configuration(), [*speed, 1e-3, 8.0, 1e-3]), np.arange(100_001) * 0.01)
        angular, size = angular_momentum(run)
        assert np.ptp(run.p[:, :3], axis=0).max() == 0.0
        assert np.ptp(angular, axis=0).max() < 1e-12 * size


@pytest.mark.slow
def test_energy_has_no_drift_over_a_million_steps() -> None:
    vi = MidpointVI(heavy_top())
    run = vi.simulate(vi.start(TURNED, SPIN), np.arange(1_000_001) * 0.01)
    energy = run.energy().total
    parts = energy.reshape(10, -1)
    assert np.ptp(parts.mean(axis=1)) < 0.05 * np.ptp(energy)
    assert np.ptp(energy) < 1e-2 * np.abs(energy).max()
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1.0).max() < 1e-15


NUT_COM = np.array([0.1, 0.0, -0.05])


def nut() -> Mechanism:
    return Mechanism([free("nut", axes="quaternion", mass=0.7, com=NUT_COM, inertia=(0.2, 0.3, 0.4))])


def angular_momentum(run: Trajectory) -> tuple[Array, float]:
    """Return that of the nut about the world's origin, (N+1, 3), and the size of what it is the sum of."""
    # Momenta are along the world's axes for slides, along the body's for turns.
    own, orbital = turns(run, "nut").apply(run.p[:, 3:].copy()), np.cross(run.q[:, :3], run.p[:, :3])
    size = np.linalg.norm(run.q[:, :3], axis=1) * np.linalg.norm(run.p[:, :3], axis=1)
    return own + orbital, float(np.abs(own).max() + size.max())


def test_free_body_keeps_its_momenta_through_its_flips() -> None:
    """A nut that flips about its middle axis."""
    vi = MidpointVI(nut())
    start = vi.start(nut().configuration(), [0.0, 0.0, 0.0, 1e-3, 8.0, 1e-3])
    run = vi.simulate(start, np.arange(3001) * 0.01)
    angular, size = angular_momentum(run)
    assert np.ptp(run.p[:, :3], axis=0).max() == 0.0
    assert np.ptp(angular, axis=0).max() < 1e-13 * size
    middle = turns(run, "nut").apply([0.0, 1.0, 0.0])[:, 1]
    assert middle.min() < -0.9
    assert middle.max() > 0.9


def test_angles_follow_the_same_motion_where_they_are_regular() -> None:
    """A double spherical pendulum, by quaternions and by three angles."""
    ends = []
    for steps in (100, 200):
        runs = []
        for axes in ("quaternion", "xyz"):
            lower = ball("lower", axes=axes, mass=0.5, com=(0.0, 0.02, -0.3), inertia=(0.02, 0.02, 0.01))
            upper = ball("upper", axes=axes, name="top", mass=0.8, com=(0.03, 0.0, -0.2), inertia=(0.03, 0.02, 0.02))
            m = Mechanism([upper, [tx(0.4), [lower]]], [Gravity()])
            vi = MidpointVI(m)
            speed = np.array([0.5, 0.3, -1.0, 0.0, 0.4, 0.7])
            runs.append(vi.simulate(vi.start(m.configuration(), speed), np.linspace(0.0, 0.3, steps + 1)))
        poses = [run.mechanism.frame_pose(run.q[-1], "lower") for run in runs]
        ends.append(np.abs(poses[0] - poses[1]).max())
    assert 3.8 < ends[0] / ends[1] < 4.2
    assert ends[1] < 1e-3


def test_a_turn_of_the_world_turns_the_motion() -> None:
    turn = np.array([0.3, -0.4, 0.5, 0.7071067811865476])
    turn /= np.linalg.norm(turn)
    w, v = turn[0], turn[1:]
    runs = []
    for first in (np.array([1.0, 0.0, 0.0, 0.0]), turn):
        down = Rotation.from_quat(np.roll(first, -1)).apply([0.0, 0.0, -GRAVITY])
        top = ball("top", axes="quaternion", mass=1.1, com=COM, inertia=INERTIA)
        m = Mechanism([top], [Gravity(tuple(down))])
        q = np.r_[
            first[0] * TURNED[0] - first[1:] @ TURNED[1:],
            first[0] * TURNED[1:] + TURNED[0] * first[1:] + np.cross(first[1:], TURNED[1:]),
        ]
        vi = MidpointVI(m)
        runs.append(vi.simulate(vi.start(q, SPIN), np.arange(301) * 0.01))
    moved = Rotation.from_quat(np.r_[v, w]) * turns(runs[0], "top")
    assert (moved.inv() * turns(runs[1], "top")).magnitude().max() < 1e-12
    assert np.abs(runs[0].p - runs[1].p).max() < 1e-12


@pytest.mark.parametrize("turn", [3.0, 4.5, 5.6])
def test_energy_of_steps_past_half_a_turn(turn: float) -> None:
    """A ball spins about an axis, and so far a step that the shorter way round is the other one."""
    vi = MidpointVI(Mechanism([ball("top", mass=1.0, inertia=(0.2, 0.2, 0.3))], [Gravity()]))
    dt = 0.05
    x0 = vi.start(TURNED, [0.0, 0.0, turn / dt]).x
    t, u = dt * np.arange(5), np.zeros((4, 0))
    made = vi.core.roll_out(t, x0, None, u, None, energies=True)
    assert made.energies[:, 0] == pytest.approx(0.5 * 0.3 * (turn / dt) ** 2)
    for sign in (1.0, -1.0) if turn < np.pi else (1.0,):  # numbers that go the shorter way may change it too
        x = made.x.copy()
        x[1::2, :4] *= sign
        assert vi.core.energies(t, x, u, made.lam) == pytest.approx(made.energies)


def test_forces_of_rotations_act_half_at_each_end() -> None:
    with pytest.raises(ArgumentError, match=r"split: got 'left' where rotations are quaternions \(top\)"):
        MidpointVI(heavy_top(), split="left")


def ring(rods: int, heavy: float) -> tuple[Mechanism, Array]:
    """Rods in a closed ring that flies free, every other one so many times as heavy; and a regular polygon."""
    length, rest = 1.0, []
    for i in reversed(range(1, rods)):
        mass = 0.1 * (heavy if i % 2 else 1.0)
        joint = ball(f"b{i}", mass=mass, com=(0.5, 0, 0), inertia=(mass / 60, mass / 12, mass / 12))
        rest = [joint, [tx(length, name=f"n{i}"), *([rest] if rest else [])]]
    base = free("base", mass=0.1, com=(0.5, 0, 0), inertia=(0.1 / 60, 0.1 / 12, 0.1 / 12))
    m = Mechanism([base, [tx(length), rest]], [PointToPoint(f"n{rods - 1}", "base", axes="xyz")])
    corner = np.pi / rods
    turned = {f"b{i}.qw": np.cos(corner) for i in range(1, rods)} | {f"b{i}.qz": np.sin(corner) for i in range(1, rods)}
    return m, project_configuration(m, m.configuration(turned)).q


@pytest.mark.parametrize(("rods", "heavy"), [(6, 1.0), (6, 1000.0), (20, 1.0)])
def test_closed_rings_of_balls_keep_their_momenta_and_their_energy(rods: int, heavy: float) -> None:
    m, q = ring(rods, heavy)
    vi = MidpointVI(m)
    v = project_velocity(m, q, np.random.default_rng(0).normal(size=m.nv)).v
    run = vi.simulate(vi.start(q, v), 0.0025 * np.arange(201))
    assert run.status.name == "COMPLETED", run.message
    place = np.stack([run[f"base.{letter}"] for letter in "xyz"], axis=-1)
    linear, body = run.p[:, :3], run.p[:, 3:6].copy()
    angular = np.cross(place, linear) + turns(run, "base").apply(body)
    assert np.ptp(linear, axis=0).max() < 1e-13 * np.abs(linear).max()
    assert np.ptp(angular, axis=0).max() < 1e-13 * np.abs(angular).max()
    energy = run.energy().total
    assert np.ptp(energy) < 1e-4 * energy.mean()
