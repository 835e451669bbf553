"""Steps of time keep the energy but for the work that is done, or the run says that they did not."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from leastaction.errors import ArgumentError, EnergyBalanceWarning, LeastActionError, RoundingWarning
from leastaction.mechanics import (
    CoulombFriction,
    Damping,
    Distance,
    ElasticString,
    Gravity,
    IntegrationStatus,
    JointForce,
    JointSpring,
    LinearDamper,
    Mechanism,
    MidpointVI,
    PointToPoint,
    SimulationStatus,
    State,
    Trajectory,
    project_configuration,
    project_velocity,
    rx,
    to_continuous,
    ty,
    tz,
)
from leastaction.mechanics.discrete.balance import balance_of
from leastaction.models.scissor_lift import at_angle, scissor_lift


def residual_in_python(vi: MidpointVI, run: Trajectory) -> np.ndarray:
    """Return energy less work at the middle of every step, from what a mechanism and its integrator are asked."""
    m, (share_start, share_end) = vi.mechanism, vi.shares
    h, v = np.diff(run.t), run.v
    middle = 0.5 * (run.q[1:] + run.q[:-1])
    f = np.array([m.force(q, w, u).value for q, w, u in zip(middle, v, run.inputs, strict=True)])
    impulse = share_end * h[:-1, None] * f[:-1] + share_start * h[1:, None] * f[1:]
    if m.nrho:
        impulse[:, m.nd :] += 0.5 * (h[:-1] + h[1:])[:, None] * vi.driving_force(run)
    work = np.concatenate([[0.0], np.cumsum(np.sum(impulse * 0.5 * (v[1:] + v[:-1]), axis=1))])
    energy = run.energy().total
    return np.asarray(energy - energy[0] - work)


def pendulum(*elements: object) -> Mechanism:
    return Mechanism([rx("a"), [tz(-1.0, mass=1.0), [rx("b"), [tz(-1.0, mass=0.5)]]]], [Gravity(), *elements])


def reeled() -> Mechanism:
    """Return a bob on a string of a prescribed length from a prescribed cart, with dampers between all of them."""
    return Mechanism(
        [ty("cart", kinematic=True, name="cart"), ty("y"), [tz("z", mass=1.0, name="bob")]],
        [
            Gravity(),
            Distance("cart", "bob", "length"),
            LinearDamper("cart", "bob", 0.3),
            LinearDamper("world", "bob", 0.2),
        ],
    )


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_the_balance_is_that_of_energy_and_forces(split: str) -> None:
    """Held against what Python makes of energies, forces and driving forces, with steps that are not equidistant."""
    rng = np.random.default_rng(3)
    t = np.cumsum(np.r_[0.0, rng.uniform(0.002, 0.01, 300)])
    driven = pendulum(JointForce("a", input="u"), Damping({"b": 0.2}), CoulombFriction("a", 0.3, 0.1))
    vi = MidpointVI(driven, split=split)
    run = vi.simulate(vi.start([0.5, 0.2]), t, inputs=rng.normal(size=(300, 1)))
    assert run.balance is not None
    assert np.abs(run.balance.residual - residual_in_python(vi, run)).max() < 1e-12
    m = reeled()
    vi = MidpointVI(m, split=split)
    start = m.configuration({"y": np.sin(0.3), "z": -np.cos(0.3), "cart": 0.0, "length": 1.0})
    rho = np.stack([0.1 * np.sin(7.0 * t), 1.0 + 0.2 * np.sin(4.0 * t)], axis=1)
    run = vi.simulate(vi.start(start), t, rho=rho)
    assert run.balance is not None
    assert np.abs(run.balance.residual - residual_in_python(vi, run)).max() < 1e-11
    assert np.abs(vi.balance(run).residual - run.balance.residual).max() < 1e-13


def test_a_long_run_is_balanced_as_in_one_piece() -> None:
    """Where the core stops to look at Ctrl-C no work is lost, and a feedback is balanced as inputs are."""
    m = pendulum(JointForce("a", input="u"))
    vi, t = MidpointVI(m), np.linspace(0.0, 10.0, 4501)
    run = vi.simulate(vi.start([0.5, 0.2]), t, inputs=lambda t: [np.sin(5.0 * t)])
    assert run.balance is not None
    assert np.array_equal(run.balance.residual, vi.balance(run).residual)

    def law(_: float, x: np.ndarray) -> np.ndarray:
        return -x[:1] - 0.5 * x[2:3]

    for law_at in ("start", "midpoint"):
        fed = vi.simulate(vi.start([0.5, 0.2]), t[:200], inputs=law, law_at=law_at)
        assert fed.balance is not None
        assert np.abs(fed.balance.residual - residual_in_python(vi, fed)).max() < 1e-12
        assert fed.status is SimulationStatus.COMPLETED


def benign() -> dict[str, Callable[[], Trajectory]]:
    """Return runs that are right, and hard to balance: forced, stiff, overdamped, at rest, hauled slowly."""

    def of(
        m: Mechanism, q: object, t: np.ndarray, v: object = None, at: tuple[str, ...] = (), **given: object
    ) -> Callable:
        vi = MidpointVI(m, at_instants=at)
        return lambda: vi.simulate(vi.start(q, v), t, **given)  # type: ignore[arg-type]

    t = np.arange(0.0, 5.0, 0.01)
    forces = JointForce("a", input="u"), JointForce("b", input="w")
    stiff = Mechanism([tz("z", mass=0.1)], [Gravity(), JointSpring("z", 1e6), Damping({"z": 1e3})])
    slider = Mechanism([ty("y", mass=1.0)], [CoulombFriction("y", 5.0, 1e-3), JointForce("y", input="u")])
    hoist = Mechanism([tz("hoist", kinematic=True), [rx("a"), [tz(-1.0, mass=100.0)]]], [Gravity()])
    seesaw = Mechanism([rx("s"), [ty(1.0, mass=1.0), ty(-1.0, mass=1.0)]], [Gravity()])
    slow = np.arange(0.0, 100.0, 0.25)
    return {
        "forced": of(pendulum(*forces), [1.0, 2.0], t, inputs=lambda t: [5 * np.sin(4 * t), 3 * np.cos(7 * t)]),
        "forced at instants": of(
            pendulum(*forces), [1.0, 2.0], t, at=("u", "w"), inputs=lambda t: [5 * np.sin(4 * t), 1]
        ),
        "stiff and overdamped": of(stiff, [0.1], t, [3.0]),
        "friction": of(slider, [0.0], t, [3.0], inputs=lambda t: [7.0 * np.sign(np.sin(3.0 * t))]),
        "hauled": of(hoist, [0.1, 0.0], slow, rho=(5e-4 * slow**2 * (3.0 - slow / 50.0))[:, None]),
        "at rest": of(pendulum(), [0.0, 0.0], t),
        "at rest upright": of(pendulum(), [np.pi, 0.0], t),
        "balanced": of(seesaw, [0.3], t),
    }


@pytest.mark.parametrize("name", sorted(benign()))
def test_right_runs_balance(name: str) -> None:
    run = benign()[name]()
    assert run.status is SimulationStatus.COMPLETED
    assert run.balance is not None
    assert not run.balance.complaint
    assert "beside the work that was done" in str(run)


def linkage(trial: int) -> tuple[MidpointVI, State]:
    """Return a conservative four-bar in fast motion."""
    rng = np.random.default_rng(0)
    for _ in range(trial + 1):
        lengths, g = rng.uniform(0.2, 0.8, 3), rng.uniform(0.3, 0.9)
        crank = rx("a", mass=0.5, com=(0, 0, lengths[0] / 2), inertia=(0.01, 0.01, 0.001))
        coupler = rx("b", mass=0.8, com=(0, 0, lengths[1] / 2), inertia=(0.03, 0.03, 0.002))
        rocker = rx("c", mass=0.6, com=(0, 0, lengths[2] / 2), inertia=(0.02, 0.02, 0.002))
        tree = [
            crank,
            [tz(lengths[0]), [coupler, [tz(lengths[1], name="P")]]],
            ty(g),
            [rocker, [tz(lengths[2], name="Q")]],
        ]
        guess, rates = rng.uniform(-2, 2, 3), None
        m = Mechanism(tree, [Gravity(), PointToPoint("P", "Q", "yz", name="loop")])
        try:
            q = project_configuration(m, guess, attempts=5).q
        except LeastActionError:  # this linkage cannot be assembled
            continue
        rates = rng.uniform(-8, 8, 3)
    vi = MidpointVI(m)
    return vi, vi.start(q, project_velocity(m, q, rates).v)


@pytest.mark.parametrize("trial", [33, 59])
def test_energy_that_swings_for_a_few_steps_is_told(trial: int) -> None:
    """Where a linkage whips through a narrow place; with half of the step it does not."""
    vi, start = linkage(trial)
    with pytest.warns(EnergyBalanceWarning, match="does not balance: from t = "):
        run = vi.simulate(start, np.arange(0.0, 10.0, 0.005))
    assert run.balance is not None
    assert np.abs(run.balance.off).max() < run.balance.allowed
    assert run.balance.swing > 0.05 * run.balance.scale
    kept_or_told(run)
    assert vi.simulate(start, np.arange(0.0, 10.0, 0.0025)).status is SimulationStatus.COMPLETED


def test_fast_linkages_that_lose_energy_say_so() -> None:
    """A conservative four-bar, too fast for its step: half of it, and the energy is kept."""
    vi, start = linkage(25)
    with pytest.warns(EnergyBalanceWarning, match="does not balance: from t = "):
        run = vi.simulate(start, np.arange(0.0, 10.0, 0.005))
    assert run.status is SimulationStatus.UNBALANCED
    assert run.balance is not None
    assert "Do not trust" in run.message
    assert to_continuous(run).status is IntegrationStatus.UNBALANCED
    shorter = vi.simulate(start, np.arange(0.0, 10.0, 0.001))
    assert shorter.status is SimulationStatus.COMPLETED
    assert run.balance.complaint in str(run)


@pytest.mark.parametrize("segments", [10, 15, 20, 30])
@pytest.mark.parametrize("dt", [0.001, 0.002, 0.005])
def test_lifts_that_pass_upright_keep_their_energy_or_say_so(segments: int, dt: float) -> None:
    lift = scissor_lift(segments)
    vi = MidpointVI(lift)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = vi.simulate(vi.start(at_angle(lift, 0.6)[0]), np.arange(0.0, 3.0, dt))
    kept_or_told(run)


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 3e4, 1e5])
@pytest.mark.parametrize("dt", [0.002, 0.005, 0.01])
@pytest.mark.parametrize("height", [0.0, -0.5])
def test_strings_that_fall_taut_keep_the_energy_or_say_so(stiffness: float, dt: float, height: float) -> None:
    bob = [ty("y"), [tz("z", mass=1.0, name="p")]]
    m = Mechanism(bob, [Gravity(), ElasticString(["world", "p"], stiffness, 1.0, tension_only=True)])
    vi = MidpointVI(m)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = vi.simulate(vi.start([0.3, height]), np.arange(0.0, 4.0, dt))
    kept_or_told(run)


def kept_or_told(run: Trajectory) -> None:
    energy = run.energy()
    off = np.median(energy.total[-25:]) - np.median(energy.total[:25])
    kept = abs(off) <= 0.025 * energy.kinetic.max()
    assert kept or run.status in (SimulationStatus.UNBALANCED, SimulationStatus.STEP_FAILED)


def test_balances_of_nothing_are_empty_and_bad_arguments_are_named() -> None:
    m = pendulum()
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.1, 0.2]), [0.0, 0.1])
    nothing = balance_of(np.zeros(1), np.zeros((0, 5)))
    assert nothing.lost == 0.0
    assert not nothing.complaint
    assert "0 J" in str(nothing)
    other = MidpointVI(reeled())
    with pytest.raises(ArgumentError, match="trajectory"):
        other.balance(run)


@pytest.mark.parametrize("far", [1e12, 1e15])
def test_a_motion_that_rounding_eats_says_so(far: float) -> None:
    """The same cart and pole, so far away that numbers are farther apart than a step moves."""
    m = cart()
    vi = MidpointVI(m)
    with pytest.warns(RoundingWarning, match="'cart' is at .*numbers are .* apart"):
        run = vi.simulate(vi.start([far, 1.0]), np.linspace(0.0, 1.0, 101))
    assert run.status is SimulationStatus.ROUNDED
    assert "rounding eats the motion" in str(run)


@pytest.mark.parametrize("far", [4e8, 1e9, 1e10])
def test_a_step_that_rounding_fails_says_so(far: float) -> None:
    m = cart()
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([far, 1.0]), np.linspace(0.0, 1.0, 101))
    assert run.status is SimulationStatus.STEP_FAILED
    assert "failed: rounding eats the motion: 'cart' is at" in run.message
    assert "too coarse" not in run.message


def test_a_motion_not_so_far_away_is_what_it_is_at_the_origin() -> None:
    m, t = cart(), np.linspace(0.0, 1.0, 101)
    vi = MidpointVI(m)
    here, there = (vi.simulate(vi.start([far, 1.0]), t) for far in (0.0, 4e6))
    assert there.status is SimulationStatus.COMPLETED
    assert np.abs(here["pole"] - there["pole"]).max() < 1e-6
    still = vi.simulate(vi.start([4e6, 0.0]), t)
    assert still.status is SimulationStatus.COMPLETED


def cart() -> Mechanism:
    return Mechanism([ty("cart", mass=2.0), [rx("pole"), [tz(-1.0, mass=1.0, name="bob")]]], [Gravity()])
