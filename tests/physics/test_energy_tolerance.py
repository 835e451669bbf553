"""Instants that are added within steps which do not keep the energy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from leastaction.errors import ArgumentError, CoarseStepWarning, EnergyBalanceWarning, LeastActionError
from leastaction.mechanics import (
    Damping,
    ElasticString,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PointToPoint,
    SimulationStatus,
    State,
    Trajectory,
    project_configuration,
    project_velocity,
    rx,
    ty,
    tz,
)
from leastaction.models.scissor_lift import at_angle, scissor_lift


def off(run: Trajectory) -> float:
    """Return how far the energy was off, as a part of the largest kinetic energy."""
    energy = run.energy()
    return float(np.abs(energy.total - energy.total[0]).max() / energy.kinetic.max())


def given_among(t: np.ndarray, run: Trajectory) -> np.ndarray:
    """Return where the given instants are in a run; all of them must be there."""
    at = np.searchsorted(run.t, t)
    np.testing.assert_array_equal(run.t[at], t)
    return at


def passing(segments: int, dt: float, until: float, kinetic: float) -> None:
    lift = scissor_lift(segments)
    vi, t = MidpointVI(lift, threads=1), np.arange(0.0, until, dt)
    start = vi.start(at_angle(lift, 0.6)[0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoarseStepWarning)
        run = vi.simulate(start, t, energy_tolerance=3e-4 * kinetic)
    assert run.status is SimulationStatus.COMPLETED, run.message
    assert 0.5 < run.balance.scale / kinetic < 2.0
    links = run.q[:, lift.variables.index("L0")]
    assert links.min() < 0.5 * np.pi - 0.3 < 0.5 * np.pi + 0.3 < links.max(), "it passes upright"
    assert np.abs(run.balance.off).max() < 0.01 * run.balance.scale
    assert run.steps < len(t) - 1 + 400
    given_among(t, run)


def test_a_lift_of_thirty_segments_passes_upright_with_its_energy() -> None:
    passing(30, 2e-3, 1.5, 3.8e3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("segments", "dt", "until", "kinetic"), [(50, 1e-3, 1.9, 1.2e4), (100, 5e-4, 2.6, 4.5e4), (200, 2.5e-4, 3.7, 1.8e5)]
)
def test_long_lifts_pass_upright_with_their_energy(segments: int, dt: float, until: float, kinetic: float) -> None:
    passing(segments, dt, until, kinetic)


@pytest.mark.parametrize(("stiffness", "dt", "low"), [(1e4, 0.01, 0.0), (1e5, 0.005, -0.5)])
def test_a_string_that_falls_taut_within_a_step_keeps_the_energy(stiffness: float, dt: float, low: float) -> None:
    string = ElasticString(["world", "bob"], stiffness, 1.0, tension_only=True)
    m = Mechanism([ty("y"), [tz("z", mass=1.0, name="bob")]], [Gravity(), string])
    vi, t = MidpointVI(m), np.arange(0.0, 2.0, dt)
    with pytest.warns(EnergyBalanceWarning, match="does not balance"):
        plain = vi.simulate(vi.start([0.3, low]), t)
    assert off(plain) > 0.05
    run = vi.simulate(vi.start([0.3, low]), t, energy_tolerance=1e-4 * plain.balance.scale)
    assert run.status is SimulationStatus.COMPLETED
    assert off(run) < 0.01


def test_fast_linkages_keep_their_energy() -> None:
    """Two of sixty four-bars that swung by 15 and by 9 % of their kinetic energy."""
    rng = np.random.default_rng(0)
    tried = 0
    for trial in range(60):
        size, g = rng.uniform(0.2, 0.8, 3), rng.uniform(0.3, 0.9)
        crank = rx("a", mass=0.5, com=(0, 0, size[0] / 2), inertia=(0.01, 0.01, 0.001))
        coupler = rx("b", mass=0.8, com=(0, 0, size[1] / 2), inertia=(0.03, 0.03, 0.002))
        rocker = rx("c", mass=0.6, com=(0, 0, size[2] / 2), inertia=(0.02, 0.02, 0.002))
        tree = [crank, [tz(size[0]), [coupler, [tz(size[1], name="P")]]], ty(g), [rocker, [tz(size[2], name="Q")]]]
        m = Mechanism(tree, [Gravity(), PointToPoint("P", "Q", "yz", name="loop")])
        try:
            q = project_configuration(m, rng.uniform(-2, 2, 3), attempts=5).q
        except LeastActionError:
            continue
        v = project_velocity(m, q, rng.uniform(-8, 8, 3)).v
        if trial not in (26, 59):
            continue
        vi, t = MidpointVI(m), np.arange(0.0, 6.0, 0.005)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            plain = vi.simulate(vi.start(q, v), t)
        assert off(plain) > 0.05
        run = vi.simulate(vi.start(q, v), t, energy_tolerance=1e-3 * plain.balance.scale)
        assert run.status is SimulationStatus.COMPLETED
        assert off(run) < 0.02
        tried += 1
    assert tried == 2


def driven() -> Mechanism:
    string = ElasticString(["cart", "bob"], 1e4, 1.0, tension_only=True)
    return Mechanism(
        [ty("cart", kinematic=True, name="cart"), ty("y"), [tz("z", mass=1.0, name="bob")]],
        [Gravity(), string, Damping(0.1), JointForce("y", "push")],
    )


def test_a_run_goes_on_from_a_given_instant_as_it_did() -> None:
    vi, t = MidpointVI(driven()), np.linspace(0.0, 1.0, 101)
    signals = {"inputs": lambda at: [np.sin(5.0 * at)], "rho": lambda at: [0.2 * np.sin(3.0 * at)]}
    run = vi.simulate(vi.start([0.3, 0.0, 0.0], [0.0, 0.0, 0.6]), t, **signals, energy_tolerance=2e-3)
    assert run.steps > 110
    at = given_among(t, run)
    for k in (30, 77):
        i = at[k]
        later = vi.simulate(
            State(float(t[k]), run.q[i], run.p[i], run.v_rho[i]), t[k:], **signals, energy_tolerance=2e-3
        )
        np.testing.assert_array_equal(later.t, run.t[i:])
        np.testing.assert_allclose(later.q, run.q[i:], atol=1e-9)
    # Its steps are like any: the same instants give the same motion.
    again = vi.simulate(vi.start(run.q[0], p=run.p[0]), run.t, inputs=run.inputs, rho=run.rho)
    np.testing.assert_allclose(again.q, run.q, atol=1e-11)


def test_rows_hold_over_their_step_and_prescribed_rows_are_joined_by_lines() -> None:
    vi, t = MidpointVI(driven()), np.linspace(0.0, 1.0, 101)
    inputs, rho = np.sin(7.0 * t[1:, None]), 0.2 * np.sin(3.0 * t[:, None])
    run = vi.simulate(vi.start([0.3, 0.0, 0.0]), t, inputs=inputs, rho=rho, energy_tolerance=2e-3)
    step = np.searchsorted(t, 0.5 * (run.t[1:] + run.t[:-1])) - 1
    assert len(step) > 110
    np.testing.assert_array_equal(run.inputs, inputs[step])
    np.testing.assert_allclose(run.rho[:, 0], np.interp(run.t, t, rho[:, 0]), atol=1e-15)
    by_function = vi.simulate(
        vi.start([0.3, 0.0, 0.0]), t, inputs=lambda at: [at], rho=lambda at: [at**2], energy_tolerance=2e-3
    )
    assert by_function.steps > 110
    np.testing.assert_allclose(by_function.inputs[:, 0], 0.5 * (by_function.t[1:] + by_function.t[:-1]), atol=1e-15)
    np.testing.assert_allclose(by_function.rho[:, 0], by_function.t**2, atol=1e-15)


def test_nothing_is_added_where_steps_keep_the_energy() -> None:
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity()])
    vi, t = MidpointVI(m), np.linspace(0.0, 2.0, 401)
    plain, held = (vi.simulate(vi.start([0.5]), t, energy_tolerance=each) for each in (None, 1e-3))
    np.testing.assert_array_equal(held.t, t)
    np.testing.assert_allclose(held.q, plain.q, atol=1e-12)
    assert held.balance.swing == pytest.approx(plain.balance.swing, rel=1e-6)
    assert held.worst_step is not None


def test_where_no_step_can_be_made_the_run_says_so() -> None:
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity(), JointForce("a", "u")])
    vi = MidpointVI(m)
    blown = lambda at: [0.0 if at < 0.5 else 1e200]  # noqa: E731
    run = vi.simulate(vi.start([0.5]), np.linspace(0.0, 1.0, 11), inputs=blown, energy_tolerance=1e-3)
    assert run.status is SimulationStatus.STEP_FAILED
    assert 0.39 < run.t[-1] <= 0.5


def test_ctrl_c_keeps_what_was_made() -> None:
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity(), JointForce("a", "u")])
    vi, t = MidpointVI(m), np.linspace(0.0, 1.0, 11)

    def stop(done: int, steps: int) -> None:
        assert steps == 10
        if done == stop_after:
            raise KeyboardInterrupt

    for stop_after in (1, 4):
        run = vi.simulate(vi.start([0.5]), t, energy_tolerance=1.0, progress=stop)
        assert run.status is SimulationStatus.INTERRUPTED
        np.testing.assert_array_equal(run.t, t[: stop_after + 1])

    given = iter([[0.0]] * 10)

    def stops_at_once(at: float) -> list[float]:  # once the rows of the given steps are known
        row = next(given, None)
        if row is None:
            raise KeyboardInterrupt
        return row

    run = vi.simulate(vi.start([0.5]), t, inputs=stops_at_once, energy_tolerance=1e-9)
    assert (run.steps, run.status) == (0, SimulationStatus.INTERRUPTED)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"energy_tolerance": 0.0}, "energy_tolerance: got 0"),
        ({"energy_tolerance": "low"}, "energy_tolerance.*'low'"),
        ({"energy_tolerance": 0.1, "inputs": lambda t, x: [0.0]}, "energy_tolerance: got one and a feedback"),
    ],
)
def test_what_is_wrong_is_named(options: dict, message: str) -> None:
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity(), JointForce("a", "u")])
    vi = MidpointVI(m)
    with pytest.raises(ArgumentError, match=message):
        vi.simulate(vi.start([0.5]), [0.0, 0.1], **options)
