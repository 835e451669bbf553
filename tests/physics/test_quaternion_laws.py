"""Laws inside the step, and what drives and prices prescribed rotations, where these are quaternions."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives.test_prescribed_rotations import angles, swung
from leastaction import Bound, JointForce, MidpointSystem, QuadraticCost, SmoothCost, optimize
from leastaction.mechanics import (
    BodyWrench,
    Damping,
    Distance,
    Gravity,
    Mechanism,
    MidpointVI,
    Trajectory,
    ball,
    project_configuration,
    rz,
    simulate,
    to_velocity,
    tx,
    tz,
)
from leastaction.numerics.arrays import Array
from leastaction.numerics.rotations import logarithm
from leastaction.optimal import check_derivatives
from leastaction.viz import plot_residuals

TOP = {"mass": 0.8, "com": (0.0, 0.05, 0.3), "inertia": (0.1, 0.08, 0.03)}
TORQUES = [JointForce(f"top.w{letter}", f"u{letter}") for letter in "xyz"]


def test_a_law_inside_the_step_is_of_second_order() -> None:
    m = Mechanism([ball("top", **TOP)], [Gravity(), *TORQUES])
    vi, v0 = MidpointVI(m), [2.0, -1.0, 4.0]

    def law(q: Array, v: Array) -> Array:
        return -1.5 * logarithm(q) - 0.4 * v

    exact = simulate(m, [1, 0, 0, 0], v0, [0.0, 1.0], inputs=lambda t, x: law(x[:4], x[4:]), rtol=1e-12, atol=1e-12)
    errors = []
    for steps in (100, 200):
        run = vi.simulate(
            vi.start([1, 0, 0, 0], v0),
            np.linspace(0.0, 1.0, steps + 1),
            inputs=lambda t, x: law(x[:4], to_velocity(m, x[:4], x[4:])),
            law_at="midpoint",
        )
        errors.append(np.abs(run.q[-1] - exact.q[-1]).max())
    assert 3.6 < errors[0] / errors[1] < 4.4, errors
    assert errors[1] < 1e-3


@pytest.mark.parametrize("damping", [0.3, 50.0])
def test_a_law_inside_the_step_acts_as_a_damper_does(damping: float) -> None:
    """So stiff that to iterate on the law would diverge; beside a prescribed hand, on a rod."""

    def made(*elements: object) -> MidpointVI:
        hand = ball("hand", kinematic=True)
        tree = [
            hand,
            [tx(0.3, name="A")],
            tz(0.4),
            [ball("top", **TOP), [tz(0.3, name="B"), rz("spin", mass=0.1, inertia=(1, 1, 1))]],
        ]
        return MidpointVI(Mechanism(tree, [Gravity(), Distance("A", "B", 0.5, name="rod"), *elements]))

    def moved(vi: MidpointVI, **given: object) -> Trajectory:
        m = vi.mechanism
        q = project_configuration(m, m.configuration()).q
        turns = np.stack([[np.cos(t), 0.0, np.sin(t), 0.0] for t in np.linspace(0.0, 0.2, 21)])
        return vi.simulate(vi.start(q), np.linspace(0.0, 0.2, 21), rho=turns, **given)

    with_law = made(*TORQUES)

    def law(_: float, x: Array) -> Array:
        m = with_law.mechanism
        v = to_velocity(m, x[: m.nq], x[m.nq : m.nq + m.nd], x[m.nq + m.nd :])
        return -damping * v[:3]

    one = moved(with_law, inputs=law, law_at="midpoint")
    other = moved(made(Damping(dict.fromkeys(("top.wx", "top.wy", "top.wz"), damping))))
    assert one.steps == 20
    assert np.abs(one.q - other.q).max() < 1e-9


def test_what_drives_a_hand_does_the_work_that_three_angles_need() -> None:
    powers = []
    for axes in ("quaternion", "xyz"):
        run = swung(axes, 800)
        torque = MidpointVI(run.mechanism).driving_force(run)
        assert torque.shape == (799, 3)
        powers.append(np.sum(torque * 0.5 * (run.v_rho[1:-1] + run.v_rho[2:]), axis=1))
    assert np.ptp(powers[1]) > 1.0
    assert np.abs(powers[0] - powers[1]).max() < 2e-3 * np.ptp(powers[1])
    assert angles(0.0).shape == (3,)


def test_residuals_are_drawn_and_small() -> None:
    figure = plot_residuals(swung("quaternion", 100))
    lines = [line for axes in figure.axes for line in axes.get_lines() if len(line.get_xdata())]
    assert lines
    assert max(float(np.max(line.get_ydata())) for line in lines) < 1e-12


def held_bar() -> MidpointSystem:
    bar = ball("hand", kinematic=True)
    body = rz("swing", mass=0.5, com=(0.1, 0.2, 0.0), inertia=(2e-3, 2e-3, 1e-3))
    m = Mechanism([tz("lift", kinematic=True), [bar, [body]]], [Gravity(), BodyWrench("hand", torque=("a", 0.0, 0.0))])
    return MidpointSystem(MidpointVI(m), np.array([0.0, 0.05, 0.12, 0.15, 0.22, 0.3]))


def test_accelerations_of_a_hand_have_a_price() -> None:
    system = held_bar()
    m = system.mechanism
    vi, rng = system.integrator, np.random.default_rng(3)
    start = vi.start(m.configuration({"swing": 0.3}))
    u = 0.1 * rng.standard_normal((system.N, system.nu))
    x = system.rollout(start.x, np.tile(start.x, (6, 1)), u, np.zeros((5, system.nu, system.ndx)), 0, 5).x
    plain = QuadraticCost(x, u, Q=np.full(system.ndx, 0.2), R=np.ones(system.nu), space=system)
    cost = SmoothCost(plain, system, {"hand.w*": 0.4, "lift": 0.3})
    run = system.trajectory(x, u)
    rates = np.vstack([np.zeros(4), run.v[:, m.nd :]])
    a = np.diff(rates, axis=0) / np.diff(system.t)[:, None]
    wanted = 0.5 * np.sum(a**2 @ [0.3, 0.4, 0.4, 0.4])
    assert cost.value(x, u) == pytest.approx(plain.value(x, u) + wanted)
    assert check_derivatives(system, x, u, cost=cost).ok


def test_accelerations_of_a_hand_are_limited() -> None:
    """A hand that is to turn by a radian at once does it as fast as it may."""
    bar = ball("hand", kinematic=True)
    m = Mechanism([bar, [rz("swing", mass=0.5, com=(0.1, 0.0, 0.0), inertia=(1e-3,) * 3)]], [Damping(0.05)])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 1.0, 26))
    goal = m.configuration()
    goal[m.first_rho :] = [np.cos(0.5), np.sin(0.5), 0.0, 0.0]
    wanted = np.r_[goal, np.zeros(m.nv)]
    Q = np.r_[0.0, np.full(3, 50.0), np.zeros(m.nv)]
    cost = QuadraticCost(wanted, np.zeros(system.nu), Q=Q, R=np.full(3, 1e-2), space=system)
    x0 = MidpointVI(m).start(m.configuration()).x
    limits = [Bound("hand.w*", -12.0, 12.0, of="acceleration")]
    result = optimize(system, cost, initial=(x0, np.zeros((25, 3))), limits=limits)
    assert result.success, result.message
    rates = np.vstack([np.zeros(3), result.u / 0.04])
    found = np.diff(rates, axis=0) / 0.04
    assert np.abs(found).max() == pytest.approx(12.0, rel=1e-5)
