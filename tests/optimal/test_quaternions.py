"""A satellite without singular attitudes: turned by any angle, with Newton's quadratic tail."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction import _core
from leastaction.errors import CoarseStepWarning
from leastaction.mechanics import (
    BodyWrench,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    ball,
    project_configuration,
    rz,
    tx,
    ty,
)
from leastaction.optimal import Bound, FinalTime, QuadraticCost, Status, check_derivatives, optimize
from leastaction.optimal.quantity import Samples
from leastaction.systems import MidpointSystem, embed, follow, relax, tracking, warm_start

AXIS = np.array([0.48, 0.6, 0.64])
N = 40


def satellite() -> MidpointSystem:
    hull = ball("hull", axes="quaternion", mass=1.0, inertia=(1.0, 1.3, 0.7))
    m = Mechanism([hull, [rz("wheel", mass=0.2, inertia=(0.05, 0.05, 0.1))]], [BodyWrench("hull", torque=tuple("abc"))])
    return MidpointSystem(MidpointVI(m), np.linspace(0.0, 2.0, N + 1))


def to_attitude(system: MidpointSystem, angle: float) -> tuple[QuadraticCost, np.ndarray]:
    m = system.mechanism
    start = system.integrator.start(m.configuration(), [0.3, -0.2, 0.1, 1.0])
    wanted = np.zeros(system.nx)
    wanted[:4] = np.cos(angle / 2.0), *(np.sin(angle / 2.0) * AXIS)
    Q_final = np.r_[np.full(3, 100.0), 0.0, np.full(3, 100.0), 0.0]
    cost = QuadraticCost(
        np.tile(wanted, (N + 1, 1)),
        np.zeros((N, 3)),
        Q=np.r_[np.zeros(4), np.full(4, 0.01)],
        R=np.full(3, 0.01),
        Q_final=Q_final,
        space=system,
    )
    return cost, start.x


@pytest.mark.parametrize("angle", [0.5, np.pi / 2.0, 3.0])
def test_a_satellite_turns_by_any_angle(angle: float) -> None:
    system = satellite()
    assert (system.nx, system.ndx) == (9, 8)
    cost, x0 = to_attitude(system, angle)
    found = optimize(
        system, cost, initial=(x0, np.zeros((N, 3))), method="newton", tolerance=1e-24, absolute_tolerance=0.0
    )
    # So tight a tolerance is met, or rounding stands before it.
    assert found.status in (Status.CONVERGED, Status.STALLED)
    away = system.difference(found.x[-1], np.asarray(cost.x_wanted)[-1])
    assert np.abs(away[:3]).max() < 0.05
    # Newton's tail is quadratic.
    newton = [k for k, method in enumerate(found.history.method) if method == "newton"]
    decreases = found.history.expected_decrease
    assert newton
    assert decreases[newton[-1]] < 1e-11
    for k in newton:
        if k - 1 in newton:
            assert decreases[k] < decreases[k - 1] ** 2 + 1e-17


def test_newton_is_quadratic_where_the_final_time_is_free() -> None:
    system = satellite()
    cost, x0 = to_attitude(system, 3.0)
    found = optimize(
        system, cost, initial=(x0, np.zeros((N, 3))), unknowns=[FinalTime(price=0.5)], method="newton",
        tolerance=1e-24, absolute_tolerance=0.0,
    )  # fmt: skip
    assert 2.9 < found.t[-1] < 3.2
    decreases = np.array(found.history.expected_decrease[-4:])
    assert set(found.history.method[-4:]) == {"newton"}
    assert np.all(decreases[1:] < decreases[:-1] ** 1.6)
    assert decreases[-1] < 1e-18


@pytest.mark.filterwarnings("ignore:the energy does not balance")
def test_a_search_backs_off_where_a_step_turns_by_nearly_a_full_turn() -> None:
    """No chart goes past a full turn: a step close to it is refused as too coarse, and no search goes on from there."""
    hull = ball("hull", mass=1.0, inertia=(1.0, 1.3, 0.7))
    m = Mechanism([hull], [BodyWrench("hull", torque=tuple("abc"))])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 2.0, 21))
    axis = np.array([0.35, 0.82, 0.33]) / np.linalg.norm([0.35, 0.82, 0.33])
    start = system.integrator.start(m.configuration(), 45.0 * axis)
    weights, still = np.full(6, 100.0), np.eye(system.nx)[0]
    cost = QuadraticCost(
        np.tile(still, (21, 1)), np.zeros((20, 3)), Q=np.r_[np.zeros(3), np.full(3, 0.01)], R=[0.01] * 3,
        Q_final=weights, space=system,
    )  # fmt: skip
    with pytest.warns(CoarseStepWarning):
        found = optimize(system, cost, initial=(start.x, np.zeros((20, 3))), shooting="single")
    assert found.status is Status.CONVERGED, found.message
    for along in (axis, np.eye(3)[2]):
        for speed, completed in ((45.0, True), (80.0, False)):
            x0 = system.integrator.start(m.configuration(), speed * along).x
            run = system.rollout(x0, found.x, found.u, np.zeros((20, 3, 6)), 0, 1)
            assert (run.failure is None) == completed
            assert completed or "the time step is too coarse" in run.failure


def test_derivatives_of_the_system_and_windows() -> None:
    system = satellite()
    cost, x0 = to_attitude(system, 2.0)
    rng = np.random.default_rng(1)
    u = rng.standard_normal((N, 3))
    run = system.rollout(x0, np.tile(x0, (N + 1, 1)), u, np.zeros((N, 3, 8)), 0, N)
    assert run.failure is None
    assert check_derivatives(system, run.x, run.u, cost=cost).ok
    gains = 0.3 * rng.standard_normal((N, 3, 8))
    bar = system.plus(run.x, np.tile(1e-2 * rng.standard_normal(8), (N + 1, 1)))
    fast = system.rollout(x0, bar, u, gains, 0, N)
    slow = super(MidpointSystem, system).rollout(x0, bar, u, gains, 0, N)
    assert np.abs(fast.x - slow.x).max() < 1e-9


def test_with_bounds_on_torques() -> None:
    system = satellite()
    cost, x0 = to_attitude(system, 2.5)
    found = optimize(system, cost, limits=[Bound(["a", "b", "c"], -2.5, 2.5)], initial=(x0, np.zeros((N, 3))))
    assert found.status is Status.CONVERGED
    assert np.abs(found.u).max() <= 2.5
    assert np.abs(found.u).max() > 2.4


def test_limits_on_angular_velocities() -> None:
    """Mean ones over steps, those of a wheel behind the joint beside them."""
    system = satellite()
    cost, x0 = to_attitude(system, 2.5)
    quantity = system.quantity("rate")
    assert quantity.names == system.mechanism.variables
    limits = [Bound("hull.w*", -1.0, 1.0, of="rate"), Bound("wheel", -0.9, 0.99, of="rate")]
    found = optimize(system, cost, limits=limits, initial=(x0, np.zeros((N, 3))))
    assert found.status is Status.CONVERGED
    v = system.trajectory(found.x, found.u).v
    # The wheel spins at 1 rad/s as it begins, and nothing but its own rotation takes part of that away.
    assert 0.99 < np.abs(v[:, :3]).max() < 1.0 + 1e-6
    assert v[:, 3].max() < 0.99 + 1e-6


def test_derivatives_of_angular_velocities() -> None:
    system = satellite()
    m, rng = system.mechanism, np.random.default_rng(7)
    quantity = system.quantity("rate").select([0, 2, 3])
    x = np.zeros((2, 3, system.nx))
    x[:, :, : m.nq] = rng.standard_normal((2, 3, m.nq))
    x[:, :, :4] /= np.linalg.norm(x[:, :, :4], axis=2, keepdims=True)
    k, y = np.arange(3), rng.standard_normal((3, 3))

    def values(d: np.ndarray) -> np.ndarray:
        ends = [system.plus(each, part) for each, part in zip(x, np.split(d, 2, axis=1), strict=True)]
        return quantity.values(Samples(k, ends[0], np.zeros((3, 3)), ends[1]))

    columns = quantity.columns(system.ndx, 3)
    at = np.where(columns >= system.ndx + 3, columns - 3, columns)
    here = Samples(k, x[0], np.zeros((3, 3)), x[1])
    first, second = np.zeros((3, 3, 2 * system.ndx)), np.zeros((3, 2 * system.ndx, 2 * system.ndx))
    first[:, :, at] = quantity.jacobian(here)
    second[:, at[:, None], at] = quantity.curvature(here, y)
    for _ in range(6):
        e, h = rng.standard_normal((3, 2 * system.ndx)), 1e-3
        e[:, [4, 5, 6, 7, 12, 13, 14, 15]] = 0.0  # momenta
        ends = [values(step * h * e) for step in (-2, -1, 0, 1, 2)]
        slope = (ends[0] - 8.0 * ends[1] + 8.0 * ends[3] - ends[4]) / (12.0 * h)
        bend = (-ends[0] + 16.0 * ends[1] - 30.0 * ends[2] + 16.0 * ends[3] - ends[4]) / (12.0 * h**2)
        assert np.abs(np.einsum("kmi,ki->km", first, e) - slope).max() < 1e-8 * np.abs(slope).max()
        assert (
            np.abs(np.einsum("ki,kij,kj->k", e, second, e) - np.sum(y * bend, axis=1)).max() < 1e-5 * np.abs(bend).max()
        )


def test_costs_by_name() -> None:
    system = satellite()
    turned = Rotation.from_rotvec(0.7 * AXIS)
    weights = {"hull.w?": 100.0, "*.v": 0.1, "p_wheel": 0.01}
    cost = tracking(system, weights, {"hull": turned.as_matrix(), "wheel": 0.4}, effort=0.01)
    assert cost.x_wanted[0, :5] == pytest.approx([*np.roll(turned.as_quat(), 1), 0.4])
    assert np.diag(cost.Q[0])[:4] == pytest.approx([100.0, 100.0, 100.0, 0.0])
    m = system.mechanism
    inverse = np.linalg.inv(m.mass_matrix(m.configuration()))
    assert cost.Q[0, 4:, 4:] == pytest.approx(0.1 * inverse @ inverse + np.diag([0, 0, 0, 0.01]))
    over_time = tracking(system, weights, {"hull": lambda t: Rotation.from_rotvec(t * AXIS).as_matrix()})
    assert over_time.x_wanted[-1, 0] == pytest.approx(np.cos(1.0))
    found = optimize(system, cost, initial=(system.integrator.start(m.configuration()).x, np.zeros((N, 3))))
    assert found.status is Status.CONVERGED
    missing = turned.inv() * Rotation.from_quat(np.roll(found.x[-1, :4], -1))
    assert missing.magnitude() < 0.01


def hanging(length: float | str = 0.5) -> Mechanism:
    """A body on a ball joint, and a rod from its end to a point of the world."""
    arm = ball("arm", axes="quaternion", mass=1.0, com=(0.2, 0.0, 0.0), inertia=(0.01, 0.02, 0.02))
    tree = [arm, [tx(0.4, name="tip")], tx(0.3), [ty(0.4, name="post")]]
    rod = Distance("tip", "post", length, name="rod")
    return Mechanism(tree, [Gravity(), *[JointForce(f"arm.w{x}", f"u{x}") for x in "xyz"], rod])


def test_ways_to_a_first_motion_with_a_closed_loop() -> None:
    m = hanging()
    vi, t = MidpointVI(m), np.linspace(0.0, 0.5, 26)
    system = MidpointSystem(vi, t)
    start = vi.start(project_configuration(m, m.configuration()).q)
    cost = tracking(system, {"arm.w*": 1.0, "*.v": 1e-3}, start.x, effort=1e-3)
    x0, still = start.x, np.zeros((25, 3))
    plain = optimize(system, cost, initial=(x0, still))
    assert plain.status is Status.CONVERGED
    for way in (relax, embed):
        found = way(system, cost, initial=(np.tile(x0, (26, 1)), still))
        assert found.success, found.message
        assert found.cost == pytest.approx(plain.cost, rel=1e-4)
    # The same motion on half the steps.
    coarse = MidpointSystem(vi, t[::2])
    x, _ = warm_start(plain, system, coarse)
    off = _core.difference(m.core, x[1:, : m.nx].copy(), plain.x[2::2, : m.nx].copy())[:, : m.nv]
    assert np.abs(off).max() < 1e-6


def test_places_of_frames_are_followed() -> None:
    m = hanging("rod")
    vi, t = MidpointVI(m), np.linspace(0.0, 1.0, 41)
    q = project_configuration(
        m, m.configuration({"rod": 0.5}), hold=["arm.wx", "arm.wy", "arm.wz"], move_kinematic=True
    ).q
    tip = m.positions(q, ("tip",))[0]
    angle = 0.6 * np.sin(np.pi * t)
    places = np.stack([tip[0] * np.cos(angle), tip[0] * np.sin(angle), 0.0 * t], axis=1)
    found = follow(m, {"tip": places}, {"tip": 100.0}, t=t, start=vi.start(q))
    assert found.result.success, found.result.message
    assert found.errors["tip"] < 0.02


def test_a_curve_is_left_where_a_step_turns_past_a_full_turn():
    top = ball("top", mass=1.0, com=(0.0, 0.0, -0.15), inertia=(8e-3, 8e-3, 1e-3))
    m = Mechanism([top], [Gravity(), *[JointForce(f"top.w{a}", a) for a in "xyz"]])
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 0.2, 11))
    rest = system.integrator.start(m.configuration()).x
    x, u = np.tile(rest, (11, 1)), np.zeros((10, 3))
    x[5, 6] = 0.18  # spins about its axis, by 3.6 rad a step
    spun = system.step_each(x, u)
    assert spun.complete
    assert x[5, :4] @ spun.x[5, :4] < 0.0
    assert np.isfinite(system.linearize_each(x, u, spun.x).A).all()
    x[5, 4:] = 0.35, 0.82, 0.33
    made = system.step_each(x, u)
    assert made.steps_done == len(made.x) == 5
    assert made.failure.startswith("step 5 at t = 0.1 s could not be solved, the time step is too coarse")
    cost = QuadraticCost(rest, np.zeros(3), Q=np.full(6, 0.1), R=np.ones(3), Q_final=np.ones(6), space=system)
    found = optimize(system, cost, initial=(x, u), shooting="multiple")
    assert found.status is Status.CONVERGED
