"""A step is a function: whoever asks, from whatever guess, its solution is that which short steps lead to."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from leastaction.errors import CoarseStepWarning, EnergyBalanceWarning, StepError
from leastaction.mechanics import (
    Distance,
    Element,
    Gravity,
    JointForce,
    JointSpring,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointToPoint,
    SimulationStatus,
    project_configuration,
    rx,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.models.scissor_lift import at_angle, scissor_lift
from leastaction.numerics.step_quality import StepQuality
from leastaction.systems import MidpointSystem
from oracles.root_oracle import follow

G = 9.81


def double_pendulum(outer: float = 1.0) -> Mechanism:
    links = [rx("a"), [tz(-0.5, mass=1.0), tz(-1.0), [rx("b"), [tz(-1.0, mass=outer)]]]]
    return Mechanism(links, [Gravity((0, 0, -G)), JointForce("b", input="u")])


def two_rods() -> Mechanism:
    """Two particles in the plane, on a rod to a pivot and on one between them."""
    return Mechanism(
        [
            tx("x1"), [ty("y1", name="P", mass=1.0)],
            tx("x2"), [ty("y2", name="Q", mass=2.0)],
        ],
        [
            Gravity((0, -G, 0)), JointForce("x2", input="u"),
            Distance("P", "world", 1.0, name="upper"), Distance("P", "Q", 1.0, name="lower"),
        ],
    )  # fmt: skip


def four_bar() -> Mechanism:
    bar = {"mass": 1.0, "com": (0.5, 0.0, 0.0), "inertia": (0.0, 1 / 12, 1 / 12)}
    loop = [rz("a", **bar), [tx(0.8), [rz("b", **bar), [tx(1.7, name="C")]]]]
    crank = [tx(2.0), [rz("c", **bar), [tx(1.3, name="D")]]]
    elements = [Gravity((0, -G, 0)), JointForce("a", input="u"), PointToPoint("C", "D", "xy")]
    return Mechanism([*loop, *crank], elements)


def wheel_pendulum(eccentric: float = 0.0, elements: tuple[Element, ...] = ()) -> Mechanism:
    """A pole with a wheel at its end."""
    wheel = rx("wheel", mass=0.5, com=(0.0, eccentric, 0.0), inertia=(2e-3, 1e-3, 1e-3))
    tree = [rx("pole", mass=0.5, com=(0.0, 0.0, -0.25)), [tz(-0.5), [wheel, [ty(0.1, name="mark")]]]]
    return Mechanism(tree, [Gravity((0, 0, -G)), JointForce("wheel", input="u"), *elements])


def gyroscope() -> Mechanism:
    """A wheel whose axis turns with an arm in space."""
    wheel = rz("wheel", mass=0.5, inertia=(1e-3, 1e-3, 2e-3))
    tree = [rz("yaw"), [rx("arm", mass=0.5, com=(0.0, 0.0, -0.25), inertia=(0.02, 0.02, 0.01)), [tz(-0.5), [wheel]]]]
    return Mechanism(tree, [Gravity((0, 0, -G)), JointForce("wheel", input="u")])


def random_state(kind: str, m: Mechanism, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a configuration, and a direction to move in."""
    q = rng.uniform(-np.pi, np.pi, m.nd)
    if kind == "two rods":
        a, b = rng.uniform(-np.pi, np.pi, 2)
        q = np.array([np.sin(a), -np.cos(a), np.sin(a) + np.sin(b), -np.cos(a) - np.cos(b)])
    if kind == "four-bar":
        q = project_configuration(m, [rng.uniform(-0.5, 0.5), 1.0, 1.6]).q
    v = rng.normal(size=m.nd)
    C = m.constraint_jacobian(q)
    return q, v - np.linalg.pinv(C) @ (C @ v) if m.nc else v


CASES = {
    "double pendulum": double_pendulum,
    "two rods": two_rods,
    "four-bar": four_bar,
    "wheel pendulum": wheel_pendulum,
    "gyroscope": gyroscope,
}


@pytest.fixture
def issue():
    """Return the run that used to end 5.8 rad away from its steps one by one."""
    vi = MidpointVI(double_pendulum())
    u = np.array([[18.68], [25.09], [40.69], [21.14], [-10.27], [-13.43], [-16.58]])
    return vi, vi.start([0.231, -0.9291], p=[3.4612, 2.7268]), 0.02 * np.arange(8), u


@pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning")
@pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning")
def test_a_run_and_its_steps_one_by_one_agree(issue) -> None:
    vi, state, t, u = issue
    run = vi.simulate(state, t, inputs=u)
    for k, row in enumerate(u):
        state = vi.step(state, 0.02, inputs=row).state
        assert state.x == pytest.approx(run.x[k + 1], abs=1e-11)
    assert run.q[-1] == pytest.approx([-0.891, 1.855], abs=1e-3)


def test_the_worst_step_is_told_of(issue) -> None:
    vi, state, t, u = issue
    told = r"coarse at t = 0\.06 s: s = 19.*'b' moved by 1\.07 rad"
    with pytest.warns(CoarseStepWarning, match=told), pytest.warns(EnergyBalanceWarning, match="from t = 0.06 s"):
        run = vi.simulate(state, t, inputs=u)
    worst = run.worst_step
    assert (worst.t, worst.variable) == (pytest.approx(0.06), "b")
    assert worst.s > 10.0
    assert worst.angle == pytest.approx(abs(run.q[4, 1] - run.q[3, 1]))
    assert worst.is_coarse
    assert "the time step is coarse at t = 0.06 s" in str(run)
    fine = vi.simulate(vi.start([0.231, -0.9291]), 0.001 * np.arange(8))
    assert fine.worst_step.s == pytest.approx(1.0, abs=1e-3)
    assert not fine.worst_step.is_coarse


def test_a_wheel_that_is_round_may_turn_far_in_a_step() -> None:
    """It comes to no other place by that: a step is as fine as the others' motion makes it."""

    def worst(m: Mechanism) -> StepQuality:
        vi = MidpointVI(m)
        run = vi.simulate(vi.start([0.3, 0.0], [0.0, 300.0]), 0.02 * np.arange(51))
        assert np.diff(run["wheel"]).min() > 5.0
        return run.worst_step

    round_one = worst(wheel_pendulum())
    assert round_one.variable == "pole"
    assert round_one.angle < 0.1
    # As soon as anything can tell where it stands, it counts.
    weak = LinearSpring("mark", "world", stiffness=1e-6)
    soft = JointSpring("wheel", stiffness=1e-9)
    for m in (wheel_pendulum(1e-6), wheel_pendulum(elements=(weak,)), wheel_pendulum(elements=(soft,))):
        seen = worst(m)
        assert seen.variable == "wheel"
        assert seen.angle > 5.0


@pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning")
@pytest.mark.parametrize("kind", CASES)
def test_the_solution_is_the_one_that_short_steps_lead_to(kind) -> None:
    """Large steps from random states, against an independent continuation."""
    rng = np.random.default_rng(7)
    vi = MidpointVI(CASES[kind]())
    m = vi.mechanism
    met = 0
    for _ in range(12):
        q, v = random_state(kind, m, rng)
        dt = 10 ** rng.uniform(-2.0, -1.0)
        v *= rng.choice([0.1, 0.3, 1.0]) / dt
        p = m.momentum(q, v)[: m.nd]
        u = rng.normal(size=1) * 10 ** rng.uniform(-1.0, 2.5)
        expected = follow(vi, q, p, u, dt)
        try:
            step = vi.step(vi.start(q, p=p), dt, inputs=u)
        except StepError as error:
            refused = error
        else:
            refused = None
        if refused is not None:
            assert "too coarse" in str(refused)
            assert refused.quality is not None
            assert expected is None
            continue
        if expected is None:
            assert step.quality.s < 0.0, "a way through a configuration without rank, no fold"
            continue
        assert step.state.q == pytest.approx(expected[0], rel=1e-6, abs=1e-6)
        assert step.quality.s == pytest.approx(expected[1], rel=1e-2)
        met += 1
    assert met >= 6


@pytest.mark.parametrize("kind", CASES)
def test_no_guess_and_no_chunk_changes_a_roll_out(kind) -> None:
    """The reference, from which guesses are made, may be anything; so may the pieces it is made in."""
    rng = np.random.default_rng(11)
    vi = MidpointVI(CASES[kind]())
    m, N = vi.mechanism, 12
    whole = 0
    for trial in range(20):
        q, v = random_state(kind, m, rng)
        dt = 10 ** rng.uniform(-2.5, -1.0)
        x0 = np.concatenate([q, m.momentum(q, rng.choice([0.05, 0.2, 0.6]) / dt * v)[: m.nd]])
        u = rng.normal(size=(N, 1)) * 10 ** rng.uniform(-1.0, 2.0)
        system = MidpointSystem(vi, dt * np.arange(N + 1))
        no_gain = np.zeros((N, 1, m.nx))
        x, steps = [x0], N
        for k in range(N):
            try:
                x.append(system.f(x[-1], u[k], k))
            except StepError:
                steps = k
                break
        one_by_one = np.array(x)
        scale = np.abs(one_by_one).max()
        for spread in (0.0, 0.1, 3.0):
            xbar = np.tile(x0, (N + 1, 1))
            xbar += spread * rng.normal(size=xbar.shape)
            out = system.rollout(x0, xbar, u, no_gain, 0, N)
            assert out.steps_done == steps, (trial, out.failure)
            assert np.abs(out.x - one_by_one).max() <= 1e-8 * scale, trial
        begun = [x0]
        for start in range(0, min(steps, 12), 4):
            part = system.rollout(begun[-1], xbar, u, no_gain, start, min(start + 4, steps))
            begun += list(part.x[1:])
        assert np.abs(np.array(begun) - one_by_one).max() <= 1e-8 * scale, trial
        whole += steps == N
    assert whole >= 10


def test_a_roll_out_is_continuous_in_its_inputs() -> None:
    """Where one step had two solutions by history, a change of 1e-8 moved the end by thousands of radians."""
    vi = MidpointVI(double_pendulum())
    m, N = vi.mechanism, 40
    system = MidpointSystem(vi, 0.02 * np.arange(N + 1))
    rng = np.random.default_rng(3)
    moved = 0
    for _ in range(10):
        u = 15.0 * rng.normal(size=(N, 1))
        x0 = np.concatenate([rng.uniform(-1.0, 1.0, 2), rng.normal(size=2)])
        xbar = np.tile(x0, (N + 1, 1))
        out = system.rollout(x0, xbar, u, np.zeros((N, 1, m.nx)), 0, N)
        other = system.rollout(x0, xbar, u + 1e-9, np.zeros((N, 1, m.nx)), 0, N)
        assert other.steps_done == out.steps_done
        if out.steps_done < N:
            continue
        moved += 1
        assert out.worst_step.s > 0.0
        # What the derivatives along the way foretell.
        along = system.linearize(out.x, out.u)
        dx = np.zeros(m.nx)
        for k in range(N):
            dx = along.A[k] @ dx + along.B[k] @ np.array([1e-9])
        assert np.abs(other.x[-1] - out.x[-1]).max() <= 3.0 * np.abs(dx).max() + 1e-10
    assert moved >= 5


def test_a_step_that_is_too_coarse_fails_and_says_so(issue) -> None:
    vi, state, t, u = issue
    before = vi.simulate(state, t[:4], inputs=u[:3])
    with pytest.raises(
        StepError,
        match=r"too coarse.* can be followed .* up to 0\.019.*'b' moves at 1\.\d* rad a step",
    ) as caught:
        vi.step(before.last, 0.02, inputs=[30.0])
    assert caught.value.quality.s > 10.0
    assert caught.value.quality.variable == "b"
    u[3] = 30.0
    run = vi.simulate(state, t, inputs=u)
    assert run.status is SimulationStatus.STEP_FAILED
    assert run.steps == 3
    assert "too coarse" in run.message
    assert run.worst_step.t == pytest.approx(0.06)
    assert run.worst_step.s > 10.0
    system = MidpointSystem(vi, t)
    out = system.rollout(state.x, np.tile(state.x, (8, 1)), u, np.zeros((7, 1, 4)), 0, 7)
    assert out.steps_done == 3
    assert "too coarse" in out.failure
    assert out.worst_step == run.worst_step


def test_a_step_that_goes_on_as_the_last_is_not_followed_anew() -> None:
    """It turns by up to half a radian; each is the solution that an independent continuation finds."""
    vi = MidpointVI(wheel_pendulum(0.02))
    m, N, dt = vi.mechanism, 60, 0.02
    p = m.momentum([0.3, 0.0], [0.0, 20.0])[: m.nd]
    run = vi.core.roll_out(dt * np.arange(N + 1), np.concatenate([[0.3, 0.0], p]), None, np.zeros((N, 1)), None)
    turned = np.abs(np.diff(run.x[:, : m.nd], axis=0)).max(axis=1)
    far = np.flatnonzero((turned > 0.25) & (turned < 0.5))
    assert run.steps == N
    assert far.size >= 40
    assert run.followed <= 5
    for k in far[::10]:
        found, s = follow(vi, run.x[k, : m.nd], run.x[k, m.nd :], np.zeros(1), dt)
        assert run.x[k + 1, : m.nd] == pytest.approx(found, rel=1e-8, abs=1e-8)
        assert 0.5 < s < 1.6


def test_a_long_lift_passes_upright_with_half_the_step() -> None:
    """At 20 segments no step of 10 ms can be followed through; with 5 ms it passes, and shorter ones agree."""
    lift = scissor_lift(20)
    vi, highest = MidpointVI(lift), {}
    for dt in (0.01, 0.005, 0.0025, 0.00125):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", EnergyBalanceWarning)  # of the longest that passes
            run = vi.simulate(vi.start(*at_angle(lift, 0.9)), dt * np.arange(round(1.6 / dt) + 1))
        highest[dt] = run["L0"].max()
        if dt == 0.01:
            assert run.status is SimulationStatus.STEP_FAILED
            assert "too coarse" in run.message
            assert highest[dt] < np.pi / 2
        else:
            passed = SimulationStatus.UNBALANCED if dt == 0.005 else SimulationStatus.COMPLETED
            assert run.status is passed, run.message
            assert highest[dt] > 2.0
    assert abs(highest[0.0025] - highest[0.00125]) < 0.25 * abs(highest[0.005] - highest[0.00125])
