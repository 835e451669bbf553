"""Inputs, prescribed motions, events and failures of a simulation in continuous time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from leastaction.errors import ArgumentError
from leastaction.mechanics import Damping, JointForce, Mechanism, rz, tx, ty
from leastaction.mechanics.continuous.events import Event
from leastaction.mechanics.continuous.prescribed import PrescribedMotion
from leastaction.mechanics.continuous.signals import Feedback
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, IntegrationStatus
from leastaction.numerics.piecewise import PiecewisePolynomial
from oracles.closed_forms import damped_velocity, pendulum_period
from physics.laws import G, mass_on_string, pendulum, times
from physics.test_order import driven_arm, fine, inputs, reeled, table


def done(run: ContinuousTrajectory) -> ContinuousTrajectory:
    assert run.status is IntegrationStatus.COMPLETED, run.message
    return run


def slider(damping: float = 0.0) -> Mechanism:
    """Return a mass of 2 kg that slides along x under a force."""
    return Mechanism([tx("x", mass=2.0)], [JointForce("x", input="push"), Damping({"x": damping}, default=0.0)])


def turntable() -> PrescribedMotion:
    return PrescribedMotion(*(lambda t, i=i: [table(t)[i]] for i in range(3)))


# Inputs


def test_a_constant_force_against_damping() -> None:
    t = times(3.0, 20)
    run = done(simulate(slider(0.8), [0.0], [1.0], t, inputs=[3.0], rtol=1e-11, atol=1e-12))
    np.testing.assert_allclose(run.velocity("x"), damped_velocity(t, 1.0, 2.0, 0.8, 3.0), atol=1e-10)
    assert np.array_equal(run["push"], np.full(21, 3.0))


@pytest.mark.parametrize("method", ["DOP853", "BDF", "LSODA"])
def test_held_inputs_jump_where_they_should(method: str) -> None:
    rng = np.random.default_rng(5)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, 8))])
    rows = np.repeat(rng.uniform(-5.0, 5.0, (4, 1)), 2, axis=0)
    run = done(simulate(slider(), [0.0], [0.0], t, inputs=rows, method=method, rtol=1e-10, atol=1e-10))
    steps = np.diff(t)
    v = np.concatenate([[0.0], np.cumsum(rows[:, 0] / 2.0 * steps)])
    x = np.concatenate([[0.0], np.cumsum((v[:-1] + v[1:]) / 2.0 * steps)])
    np.testing.assert_allclose(run.v[:, 0], v, atol=1e-8)
    np.testing.assert_allclose(run.q[:, 0], x, atol=1e-8)
    np.testing.assert_allclose(run["push"], [*rows[:, 0], rows[-1, 0]])
    np.testing.assert_allclose(run.input(t[3] + 0.01), rows[3])
    if method == "DOP853":
        # Polynomials of the second order between jumps: a step each is enough, and none straddles a jump.
        assert run.effort.steps < 60


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_a_function_of_time_is_one_of_time_and_state(method: str) -> None:
    t, options = times(2.0, 20), {"method": method, "rtol": 1e-9, "atol": 1e-10}
    of_time = done(simulate(slider(), [0.0], [0.5], t, inputs=lambda t: [2.0 * np.cos(t)], **options))
    of_both = done(simulate(slider(), [0.0], [0.5], t, inputs=lambda t, x: [2.0 * np.cos(t) + 0.0 * x[0]], **options))
    assert np.abs(of_time["x"] - (0.5 * t + 1.0 - np.cos(t))).max() < 1e-7
    assert np.abs(of_time["x"] - of_both["x"]).max() < 1e-7


def test_rows_at_the_instants_are_joined_by_lines() -> None:
    t = times(2.0, 4)
    rows = np.array([0.0, 2.0, -2.0, 1.0, 1.0])[:, None]
    run = done(simulate(slider(), [0.0], [0.0], t, inputs=rows, rtol=1e-10, atol=1e-12))
    v = np.concatenate([[0.0], np.cumsum(0.25 * (rows[1:, 0] + rows[:-1, 0]) / 2.0)])
    np.testing.assert_allclose(run.v[:, 0], v, atol=1e-8)
    np.testing.assert_allclose(run.input([0.25, 1.5, 2.0])[:, 0], [1.0, 1.0, 1.0])


def test_a_piecewise_polynomial_is_an_input_and_a_prescribed_motion() -> None:
    """One function of time serves wherever one is asked for, with its derivatives and its jumps."""
    t = times(2.0, 4)
    rows = np.array([0.0, 2.0, -2.0, 1.0, 1.0])[:, None]
    for kind, given in (("linear", rows), ("hold", rows[1:])):
        function = PiecewisePolynomial.through(t, given, kind=kind)
        by_rows, by_function = (
            done(simulate(slider(), [0.0], [0.0], t, inputs=signal, rtol=1e-10, atol=1e-12))
            for signal in (given, function)
        )
        np.testing.assert_allclose(by_function.q, by_rows.q, atol=1e-9)
        np.testing.assert_allclose(by_function["push"], by_rows["push"], atol=1e-14)
    carried = Mechanism([tx("rho", kinematic=True, mass=1.0), [ty("y", mass=1.0)]], [])
    spline = CubicSpline(t, rows)
    runs = [
        done(simulate(carried, [0.0, 0.0], None, t, rho=motion))
        for motion in (spline, PiecewisePolynomial.through(t, rows))
    ]
    np.testing.assert_allclose(runs[1].q, runs[0].q, atol=1e-12)
    np.testing.assert_allclose(runs[1].v, runs[0].v, atol=1e-12)
    np.testing.assert_allclose(runs[1].a, runs[0].a, atol=1e-10)


def test_a_function_of_another_shape_is_no_input() -> None:
    t = times(1.0, 2)
    with pytest.raises(ArgumentError, match=r"inputs at t = 0 s: got shape \(2,\), expected \(1,\)"):
        simulate(slider(), [0.0], [0.0], t, inputs=PiecewisePolynomial.constant([1.0, 2.0], 0.0, 1.0))


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_feedback_makes_a_spring_and_a_damper(method: str) -> None:
    # 2 x'' = 4 - 18 (x - 1) - 2.4 x': a damped oscillation about 1 + 4/18.
    law = Feedback(np.array([[18.0, 2.4]]), np.array([1.0, 0.0]), np.array([4.0]))
    t, rest = times(3.0, 30), 1.0 + 4.0 / 18.0
    decay, frequency = 0.6, np.sqrt(9.0 - 0.36)
    runs = [
        done(simulate(slider(), [0.0], [0.0], t, method=method, rtol=1e-9, atol=1e-11, **given))
        for given in ({"inputs": law}, {"u": law}, {"inputs": lambda t, x: law(t, x)})
    ]
    turn = np.cos(frequency * t) + decay / frequency * np.sin(frequency * t)
    for run in runs:
        np.testing.assert_allclose(run["x"], rest * (1.0 - np.exp(-decay * t) * turn), atol=1e-7)
        np.testing.assert_allclose(run["push"], [law(0.0, x)[0] for x in run.x])


# Prescribed motion


@pytest.mark.parametrize("given", ["motion", "accelerations", "everything"])
def test_driven_arm_on_its_turntable(given: str) -> None:
    m = driven_arm()
    q0, v0 = np.array([0.3, 0.2, -0.4, 0.0]), np.array([1.0, -0.5, 0.8, 1.4])
    signals = {
        "motion": {"inputs": lambda t, x: inputs(t), "rho": turntable()},
        "accelerations": {"inputs": lambda t, x: inputs(t), "rho_a": lambda t, x: [table(t)[2]]},
        "everything": {"u": lambda t, x: [*inputs(t), table(t)[2]]},
    }[given]
    t = times(1.0, 10)
    run = done(simulate(m, q0, v0, t, rtol=1e-11, atol=1e-12, **signals))
    exact = fine(m, q0, v0, lambda t, v: np.append(inputs(t), 0.0) - np.array([0.8, 0.5, 0.1]) * v, table)
    np.testing.assert_allclose(run.q[:, :3], exact(t)[:3].T, atol=1e-8)
    tolerance = 1e-15 if given == "motion" else 1e-8
    np.testing.assert_allclose(run["table"], [table(at)[0] for at in t], atol=tolerance)
    np.testing.assert_allclose(run(0.37)[[3, 7]], table(0.37)[:2], atol=tolerance)
    np.testing.assert_allclose(run.u[:, 2], [table(at)[2] for at in t], atol=1e-12)


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_a_string_that_is_reeled(method: str) -> None:
    length, angle = reeled()
    m, t = mass_on_string(), times(1.0, 20)
    motion = PrescribedMotion(
        lambda t: [length(t)], lambda t: [0.9 * np.cos(3.0 * t)], lambda t: [-2.7 * np.sin(3.0 * t)]
    )
    th, start = 0.8, {"x": 1.2 * np.sin(0.8), "z": -1.2 * np.cos(0.8), "length": 1.2}
    speed = {
        "x": 0.9 * np.sin(th) + 1.2 * np.cos(th),
        "z": -0.9 * np.cos(th) + 1.2 * np.sin(th),
        "length": 0.9,
    }
    run = done(
        simulate(m, m.configuration(start), m.configuration(speed), t, rho=motion, method=method, rtol=1e-9)
    )  # fmt: skip
    np.testing.assert_allclose(run["x"], [length(at) for at in t] * np.sin(angle(t)), atol=1e-6)
    assert run.drift["string0"].h < 1e-13  # a hundred roundings of terms of 2 m^2


def test_motions_by_splines_and_rows() -> None:
    m = Mechanism([tx("cart", kinematic=True), [rz("theta"), [ty(-1.0, mass=1.0)]]], [])
    t = times(1.0, 40)
    rows = np.sin(2.0 * t)[:, None]
    spline = CubicSpline(t, rows)
    start, speed = [0.3, 0.0], [0.0, 2.0]
    exact = PrescribedMotion(lambda t: [np.sin(2 * t)], lambda t: [2 * np.cos(2 * t)], lambda t: [-4 * np.sin(2 * t)])
    wanted = done(simulate(m, start, speed, t, rho=exact, rtol=1e-10, atol=1e-12))
    by_rows = done(simulate(m, start, None, t, rho=rows, rtol=1e-10, atol=1e-12))
    by_spline = done(simulate(m, start, None, t, rho=spline, rtol=1e-10, atol=1e-12))
    np.testing.assert_allclose(by_rows["theta"], wanted["theta"], atol=1e-7)
    np.testing.assert_allclose(by_spline["theta"], wanted["theta"], atol=1e-5)
    assert np.array_equal(by_spline.q[:, 1], spline(t)[:, 0])


def test_without_accelerations_prescribed_variables_go_on_as_they_started() -> None:
    m = Mechanism([tx("cart", kinematic=True), [rz("theta"), [ty(-1.0, mass=1.0)]]], [])
    run = done(simulate(m, [0.0, 0.0], [0.5, 2.0], times(1.0, 5)))
    np.testing.assert_allclose(run["cart"], 2.0 * run.t, atol=1e-12)
    np.testing.assert_allclose(run["theta"], 0.5 * run.t, atol=1e-9)


# Events


def bottom(t: float, x: np.ndarray) -> float:
    return float(np.sin(x[0]))


def test_events_at_exact_times_by_name() -> None:
    period = pendulum_period(2.0)
    passages = period * (np.arange(6) / 2.0 + 0.25)
    run = done(
        simulate(
            pendulum(), [2.0], None, [0.0, 2.9 * period], rtol=1e-12, atol=1e-12,
            events={
                "bottom": "theta", "left": Event(bottom, direction=-1.0), "right": Event(bottom, direction=1.0),
                "top": Event(lambda t, x: x[1], direction=-1.0), "never": Event("theta", value=3.0),
            },
        )
    )  # fmt: skip
    np.testing.assert_allclose(run.events["bottom"].t, passages, atol=1e-10)
    np.testing.assert_allclose(run.events["left"].t, passages[::2], atol=1e-10)
    np.testing.assert_allclose(run.events["right"].t, passages[1::2], atol=1e-10)
    np.testing.assert_allclose(run.events["top"].t, period * np.arange(1, 3), atol=1e-9)
    np.testing.assert_allclose(run.events["bottom"].x[:, 0], 0.0, atol=1e-12)
    assert len(run.events["never"].t) == 0
    assert run.events["never"].x.shape == (0, 2)


@pytest.mark.parametrize("method", ["RK45", "Radau", "BDF", "LSODA"])
def test_a_terminal_event_ends_the_simulation_there(method: str) -> None:
    quarter = pendulum_period(1.0) / 4.0
    options = {"method": method, "rtol": 1e-8, "atol": 1e-10}
    t = times(5.0, 100)
    run = simulate(pendulum(), [1.0], None, t, events={"low": Event("theta", terminal=True)}, **options)
    assert run.status is IntegrationStatus.EVENT
    assert "'low'" in run.message
    assert run.t[-1] == run.events["low"].t[0] == pytest.approx(quarter, abs=1e-4)
    assert abs(run["theta"][-1]) < 1e-12
    assert np.array_equal(run.t[:-1], t[t < run.t[-1]])
    third = simulate(pendulum(), [1.0], None, t, events={"low": Event("theta", terminal=3)}, **options)
    assert len(third.events["low"].t) == 3
    assert third.t[-1] == pytest.approx(5.0 * quarter, abs=1e-3)
    # On from the event, which is none at the start.
    on = simulate(
        pendulum(), run.last.q, run.last.v, [run.t[-1], 10.0], events={"low": Event("theta", terminal=True)}, **options
    )  # fmt: skip
    assert on.t[-1] - run.t[-1] == pytest.approx(2.0 * quarter, abs=1e-3)


def test_a_bouncing_ball() -> None:
    m = Mechanism([ty("y", mass=1.0), ], [])  # fmt: skip
    m = m.with_elements([JointForce("y", input="weight")])
    q, v, now, heights = np.array([1.0]), np.array([0.0]), 0.0, []
    for _ in range(4):
        run = simulate(
            m, q, v, [now, now + 10.0], inputs=[-G], events={"floor": Event("y", terminal=True, direction=-1.0)}
        )  # fmt: skip
        assert run.status is IntegrationStatus.EVENT
        q, v, now = np.maximum(run.last.q, 0.0), -0.8 * run.last.v, run.last.t
        heights.append(float(v[0] ** 2 / (2.0 * G)))
    np.testing.assert_allclose(heights, 0.64 ** np.arange(1, 5), rtol=1e-9)
    fall = np.sqrt(2.0 / G)
    assert now == pytest.approx(fall * (1.0 + 2.0 * sum(0.8**k for k in range(1, 4))), abs=1e-9)


def test_events_that_scipy_would_take() -> None:
    def reaches(t: float, x: np.ndarray) -> float:
        return float(x[0] - 0.25)

    reaches.terminal = True
    run = simulate(slider(), [0.0], [1.0], [0.0, 1.0], events={"there": reaches})
    assert run.status is IntegrationStatus.EVENT
    assert run.t[-1] == pytest.approx(0.25, abs=1e-12)


# Failures


@pytest.mark.parametrize("method", ["RK23", "DOP853", "Radau", "BDF", "LSODA"])
def test_a_motion_that_blows_up_returns_what_there_is(method: str) -> None:
    # 2 v' = 2 v^3 from v = 1: v = 1 / sqrt(1 - 2 t).
    t = times(1.0, 20)
    run = simulate(
        slider(), [0.0], [1.0], t, inputs=lambda t, x: [2.0 * x[1] ** 3], method=method, rtol=1e-6, max_steps=5000
    )  # fmt: skip
    assert run.status is IntegrationStatus.FAILED
    assert f"{method} failed after t = 0." in run.message
    assert "x = " in run.message
    assert "rate" in run.message
    assert 0.45 < run.t[-1] < 0.51
    whole = run.t < 0.42
    assert whole.sum() == 9
    np.testing.assert_allclose(run.v[whole, 0], 1.0 / np.sqrt(1.0 - 2.0 * run.t[whole]), rtol=1e-2)
    assert np.all(np.isfinite(run.x))
    assert np.all(np.isfinite(run(0.4)))


def test_a_failure_says_which_input_is_not_finite() -> None:
    run = simulate(slider(), [0.0], [1.0], times(1.0, 10), inputs=lambda t, x: [np.nan if t > 0.5 else 0.0])
    assert run.status is IntegrationStatus.FAILED
    assert "the input 'push' is not finite" in run.message
    assert run.t[-1] == pytest.approx(0.5, abs=1e-6)
    at_once = simulate(slider(), [0.0], [1.0], times(1.0, 10), inputs=lambda t, x: [np.inf])
    assert at_once.status is IntegrationStatus.FAILED
    assert len(at_once.t) == 1
    assert np.all(np.isnan(at_once.a))


def test_a_string_reeled_in_beyond_reach() -> None:
    # Two anchors 2 m apart hold a mass on strings that are reeled in until they cannot meet.
    from leastaction.mechanics import Distance

    m = Mechanism(
        [tx("x"), [ty("y", name="bob", mass=1.0)], tx(-1.0, name="west"), tx(1.0, name="east")],
        [Distance("bob", "west", "left"), Distance("bob", "east", "right")],
    )
    q0 = m.configuration({"x": 0.0, "y": -1.0, "left": np.sqrt(2.0), "right": np.sqrt(2.0)})
    reel = PrescribedMotion(lambda t: [np.sqrt(2.0) - t**2] * 2, lambda t: [-2.0 * t] * 2, lambda t: [-2.0] * 2)
    run = simulate(m, q0, None, times(1.0, 20), rho=reel, max_steps=3000)
    assert run.status is IntegrationStatus.FAILED
    assert 0.5 < run.t[-1] < np.sqrt(np.sqrt(2.0) - 1.0) + 1e-9
    assert np.abs(m.constraint_values(run.q)).max() < 1e-9


def test_steps_have_a_limit() -> None:
    run = simulate(pendulum(), [1.0], None, times(10.0, 10), max_steps=5)
    assert run.status is IntegrationStatus.FAILED
    assert run.effort.steps == 5
    assert "max_steps" in run.message


def test_ctrl_c_returns_what_there_is() -> None:
    def stop(t: float, end: float) -> None:
        if t > 1.0:
            raise KeyboardInterrupt

    t = times(5.0, 50)
    run = simulate(pendulum(), [1.0], None, t, progress=stop)
    assert run.status is IntegrationStatus.INTERRUPTED
    assert "interrupted at t = 1." in run.message
    assert 1.0 < run.t[-1] < 2.0
    assert np.array_equal(run.t[:10], t[:10])
    whole = simulate(pendulum(), [1.0], None, t)
    np.testing.assert_allclose(run(0.55), whole(0.55), atol=1e-12)
    on = simulate(pendulum(), run.last.q, run.last.v, [run.last.t, 5.0])
    np.testing.assert_allclose(on.x[-1], whole.x[-1], atol=1e-6)
