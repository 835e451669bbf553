"""Simulation in continuous time against closed forms, with every solver."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from leastaction.mechanics import Gravity, InverseSquareGravity, Mechanism, rz, tx, ty
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, IntegrationStatus
from leastaction.models.chain import pendulum_chain
from leastaction.numerics.ode import SOLVERS, Interpolant, March
from oracles.closed_forms import pendulum_angle
from physics.laws import mass_on_string, measured_order, pendulum, swing, times

ACCURACY = {
    "RK23": (1e-6, 1e-3), "RK45": (1e-9, 1e-6), "DOP853": (1e-9, 1e-7),
    "Radau": (1e-7, 1e-6), "BDF": (1e-8, 1e-4), "LSODA": (1e-9, 1e-5),
}  # fmt: skip
"""Of each method: the relative tolerance, and the error that the motion may have."""


def done(run: ContinuousTrajectory) -> ContinuousTrajectory:
    assert run.status is IntegrationStatus.COMPLETED, run.message
    return run


@pytest.mark.parametrize("method", SOLVERS)
def test_every_method_swings_a_pendulum_as_jacobis_functions_do(method: str) -> None:
    rtol, error = ACCURACY[method]
    t = times(5.0, 50)
    run = done(simulate(pendulum(), [2.0], None, t, method=method, rtol=rtol, atol=0.01 * rtol))
    np.testing.assert_allclose(run["theta"], pendulum_angle(t, 2.0), atol=error)
    between = np.linspace(0.0, 5.0, 333)
    np.testing.assert_allclose(run(between)[:, 0], pendulum_angle(between, 2.0), atol=error)
    assert np.array_equal(run.t, t)


@pytest.mark.parametrize("method", SOLVERS)
def test_every_method_swings_a_mass_on_a_string_and_stays_on_it(method: str) -> None:
    # The projection goes into each solver in its own way; a wrong one would spoil the accuracy or the speed.
    rtol, error = ACCURACY[method]
    m, t = mass_on_string(length=1.0), times(5.0, 50)
    start = m.configuration({"x": np.sin(1.0), "z": -np.cos(1.0)})
    options = {"method": method, "rtol": rtol, "atol": 0.01 * rtol}
    run = done(simulate(m, start, None, t, **options))
    loose = done(simulate(m, start, None, t, constraints="none", **options))
    np.testing.assert_allclose(run["x"], np.sin(pendulum_angle(t, 1.0)), atol=error)
    assert run.drift["string0"].h < 1e-14 < loose.drift["string0"].h
    assert run.drift["string0"].h_step > run.drift["string0"].h
    assert run.effort.steps < 1.2 * loose.effort.steps
    between = np.linspace(0.0, 5.0, 333)
    x = run(between)
    np.testing.assert_allclose(x[:, 0], np.sin(pendulum_angle(between, 1.0)), atol=error)
    assert np.abs(m.constraint_values(x[:, :2])).max() < 1e-14


@pytest.mark.parametrize("method", SOLVERS)
def test_a_state_put_into_a_solver_is_where_it_goes_on_from(method: str) -> None:
    # y' = -y, moved by a tenth at some step: all that follows is as if it had started there.
    rtol, accuracy = ACCURACY[method]
    change = np.array([0.1, -0.1])
    moved: list[tuple[float, np.ndarray]] = []
    slopes: list[tuple[float, np.ndarray]] = []

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        slopes.append((t, y.copy()))
        return -y

    def hold(t: float, y: np.ndarray) -> np.ndarray:
        if t < 1.0 or moved:
            return y
        moved.append((t, y + change))
        return y + change

    y0 = np.array([1.0, 2.0])
    march = March(rate, 0.0, 5.0, y0, solver=method, rtol=rtol, atol=0.01 * rtol, hold=hold)
    for step in march:
        if not moved or step.end == moved[0][0]:
            continue
        t, y = moved[0]
        np.testing.assert_allclose(step.y, y * np.exp(t - step.end), atol=10.0 * accuracy)
        middle = 0.5 * (step.start + step.end)
        np.testing.assert_allclose(step.interpolant()(middle), y * np.exp(t - middle), atol=10.0 * accuracy)
    t, y = moved[0]
    if method not in ("BDF", "LSODA"):
        assert any(at == t and np.allclose(of, y, rtol=1e-14) for at, of in slopes), (
            "the slope that the next step begins with"
        )
    assert march.t == 5.0


def test_an_interpolant_ends_where_the_step_was_moved_to() -> None:
    change = np.array([0.1, -0.2])
    piece = Interpolant(lambda t: np.multiply.outer([1.0, 2.0], np.asarray(t)), 1.0, 3.0, change=change)
    np.testing.assert_allclose(piece(1.0), [1.0, 2.0])
    np.testing.assert_allclose(piece(3.0), [3.1, 5.8])
    times = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(piece(times), [[1.0, 2.05, 3.1], [2.0, 3.9, 5.8]])
    slopes = [(piece(t + 1e-6) - piece(t)) / 1e-6 for t in (1.0, 3.0 - 1e-6)]
    np.testing.assert_allclose(slopes, [[1.0, 2.0], [1.0, 2.0]], atol=1e-5)


def kepler(eccentricity: float) -> tuple[Mechanism, np.ndarray, np.ndarray]:
    """Return a planet of 1 kg about a fixed sun, and its state at the perihelion of an ellipse of axis 1."""
    m = Mechanism(
        [tx(0.0, name="sun"), tx("x"), [ty("y", name="planet", mass=1.0)]],
        [InverseSquareGravity("sun", "planet", 1.0)],
    )
    e = eccentricity
    return m, np.array([1.0 - e, 0.0]), np.array([0.0, np.sqrt((1.0 + e) / (1.0 - e))])


@pytest.mark.parametrize("method", ["DOP853", "LSODA"])
def test_keplers_ellipse(method: str) -> None:
    e = 0.6
    m, q0, v0 = kepler(e)
    anomaly = np.linspace(0.0, 4.0 * np.pi, 81)
    t = anomaly - e * np.sin(anomaly)  # Kepler's equation: the time at each eccentric anomaly
    run = done(simulate(m, q0, v0, t, method=method, rtol=1e-11, atol=1e-12))
    ellipse = np.stack([np.cos(anomaly) - e, np.sqrt(1.0 - e**2) * np.sin(anomaly)], axis=1)
    np.testing.assert_allclose(run.q, ellipse, atol=1e-7)
    np.testing.assert_allclose(run.energy().total, -0.5, atol=1e-9)
    area = run["x"] * run.velocity("y") - run["y"] * run.velocity("x")
    np.testing.assert_allclose(area, np.sqrt(1.0 - e**2), atol=1e-9)
    pull = -run.q / np.linalg.norm(run.q, axis=1, keepdims=True) ** 3
    np.testing.assert_allclose(run.a, pull, atol=1e-12)


def test_double_pendulum_keeps_its_energy_as_well_as_the_tolerance_says() -> None:
    m = pendulum_chain(2)
    drift = []
    for rtol in (1e-6, 1e-9, 1e-12):
        run = done(simulate(m, [2.0, 1.0], [0.0, 1.0], times(10.0, 200), rtol=rtol, atol=rtol))
        energy = run.energy().total
        drift.append(np.abs(energy - energy[0]).max())
    assert drift[0] > 10.0 * drift[1] > 100.0 * drift[2]
    assert drift[2] < 1e-9


@pytest.mark.parametrize(("method", "order"), [("RK23", 3), ("RK45", 4), ("DOP853", 7)])
@pytest.mark.parametrize("constrained", [False, True])
def test_order_of_the_dense_output(method: str, order: int, constrained: bool) -> None:
    # Steps of one size: tolerances that never bite, and as many steps as fit.
    m = mass_on_string(length=1.0) if constrained else pendulum()
    start = [np.sin(1.0), -np.cos(1.0)] if constrained else [1.0]
    between = np.linspace(0.0, 1.0, 101)
    angle = pendulum_angle(between, 1.0)

    def error(steps: int) -> float:
        size = 1.0 / steps
        run = done(
            simulate(m, start, None, [0.0, 1.0], method=method, rtol=0.9, atol=1e3, max_step=size, first_step=size)
        )  # fmt: skip
        assert run.effort.steps in (steps, steps + 1)
        wanted = np.sin(angle) if constrained else angle
        return float(np.abs(run(between)[:, 0] - wanted).max())

    steps = (4, 8, 16) if method == "DOP853" else (16, 32, 64)
    assert measured_order(error, steps) > order - 0.4


def test_midpoint_runs_converge_to_it_with_the_second_order() -> None:
    m = pendulum_chain(3)
    q0, v0 = np.array([1.0, -0.5, 0.3]), np.array([0.2, 1.0, -1.0])
    exact = done(simulate(m, q0, v0, [0.0, 1.0], rtol=1e-12, atol=1e-13)).q[-1]

    def error(steps: int) -> float:
        return float(np.abs(swing(m, q0, v0, times(1.0, steps)).q[-1] - exact).max())

    assert measured_order(error, (100, 200, 400)) == pytest.approx(2.0, abs=0.05)


def test_what_a_trajectory_tells_by_name() -> None:
    m = mass_on_string()
    q0 = m.configuration({"x": 0.6, "z": -0.8, "length": 1.0})
    run = done(simulate(m, q0, None, times(1.0, 10), method="Radau"))
    assert np.array_equal(run["z"], run.q[:, 1])
    assert np.array_equal(run.velocity("x"), run.v[:, 0])
    assert np.array_equal(run.acceleration("x"), run.a[:, 0])
    # At rest the string carries m g cos(angle), of which h = |p|^2 - L^2 sees 2 L lam; lam < 0 pulls.
    assert -2.0 * run["string0"][0] == pytest.approx(2.0 * 9.81 * 0.8)
    assert run.x.shape == (11, 6)
    assert run.u.shape == (11, 1)
    assert run.steps == 10
    assert np.array_equal(run.last.x, run.x[-1])
    assert np.array_equal(run(0.3), run([0.3])[0])
    assert np.array_equal(run(0.0), run.x[0])
    assert run.effort.jacobians > 0
    assert "drift of 'string0'" in str(run)
    with pytest.raises(ValueError, match="read-only"):
        run.q[0, 0] = 1.0


def test_a_mechanism_or_its_dynamics_and_results_that_travel() -> None:
    m = pendulum()
    one = simulate(m, [1.0], None, [0.0, 1.0])
    other = pickle.loads(pickle.dumps(simulate(ContinuousDynamics(m), [1.0], None, [0.0, 1.0])))
    assert np.array_equal(one.q, other.q)
    assert np.array_equal(one(0.37), other(0.37))


def test_progress_is_told() -> None:
    told: list[tuple[float, float]] = []
    simulate(pendulum(), [1.0], None, [1.0, 3.0], progress=lambda t, end: told.append((t, end)))
    assert [end for _, end in told] == [3.0] * len(told)
    assert told[-1][0] == 3.0
    assert np.all(np.diff([t for t, _ in told]) > 0.0)


def test_results_are_the_same_with_and_without_dense_output() -> None:
    m = Mechanism([rz("theta"), [tx(1.0, mass=1.0)]], [Gravity((0.0, -9.81, 0.0))])
    t = times(2.0, 37)
    dense, bare = (simulate(m, [0.5], None, t, dense_output=kept) for kept in (True, False))
    assert np.array_equal(dense.x, bare.x)
    assert bare.dense is None
