"""Plans on rigs: a machine that is not its model, with strings that go slack and sensors that are noisy and late."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from leastaction import (
    Bound,
    Distance,
    ElasticString,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    OptimizationResult,
    Played,
    QuadraticCost,
    Rig,
    SmoothCost,
    free,
    optimize,
    play,
    project_configuration,
    ry,
    tx,
    tz,
)
from leastaction.control.rigs.commands import reeled_in
from leastaction.elements import BodyWrench
from leastaction.errors import ArgumentError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.puppet_arm import hang, puppet_arm
from optimal.systems import rolled_out, strung_rig

# Plans of strings by steps of 20 ms, jagged as they are: what is played is held to the plan, not to shorter steps.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

NONE = {"spread": 0.0, "noise": 0.0, "delay": 0.0, "substeps": 1}
LEAST = 0.2  # N


@pytest.fixture(scope="module")
def upright() -> tuple[MidpointSystem, OptimizationResult]:
    """A cart whose pendulum is upright moves aside: unstable."""
    m = cart_pendulum()
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 3.0, 301))
    wanted = np.zeros((301, system.nx))
    wanted[:, m.variables.index("theta")] = np.pi
    start = system.integrator.start(wanted[0, : m.nq]).x
    wanted[:, m.variables.index("x")] = 0.3 * np.sin(2.0 * system.t) ** 2
    cost = QuadraticCost(wanted, np.zeros((300, system.nu)), Q=[10.0, 10.0, 0.0, 0.0], R=[1e-4])
    return system, optimize(system, cost, initial=(np.tile(start, (301, 1)), np.zeros((300, system.nu))))


@pytest.fixture(scope="module")
def hanging() -> tuple[MidpointSystem, OptimizationResult]:
    """An arm on one string, which pulls, waves."""
    t = np.linspace(0.0, 2.0, 101)
    vi = MidpointVI(puppet_arm())
    system = MidpointSystem(vi, t, multipliers=True)
    wanted = np.zeros((101, system.nx))
    wanted[:, 0], wanted[:, 1] = 0.5 + 0.3 * np.sin(np.pi * t) ** 2, 0.6
    q = hang(vi.mechanism, wanted[0, :2])
    cost = QuadraticCost(
        wanted, np.zeros((100, 2)), Q=[100.0, 100.0, 1e-6, 1e-6, 1e-6, 1e-6, 0.01, 0.01, 0.0], R=[1e-4, 1e-4]
    )
    start = np.r_[vi.start(q).x, 0.0], np.tile(q[2:], (100, 1))
    calm = SmoothCost(cost, system, {"string-*": 1e-3})
    return system, optimize(system, calm, initial=start, limits=[Bound("string", min=LEAST, of="tension")])


@pytest.mark.parametrize("feedback", [False, True])
def test_a_rig_that_is_its_model_does_what_is_planned(
    upright: tuple[MidpointSystem, OptimizationResult],
    hanging: tuple[MidpointSystem, OptimizationResult],
    feedback: bool,
) -> None:
    for system, plan in (upright, hanging):
        played = play(system, plan, Rig(stiffness=None, **NONE), feedback=feedback)
        assert played.failure is None
        np.testing.assert_allclose(played.x, plan.x[:, : played.x.shape[1]], atol=1e-5)
        np.testing.assert_allclose(played.u, plan.u, atol=1e-4)


def test_feedback_by_late_and_noisy_readings_holds_what_is_unstable(
    upright: tuple[MidpointSystem, OptimizationResult],
) -> None:
    system, plan = upright
    blind, held = (play(system, plan, Rig(delay=0.02), feedback=feedback) for feedback in (False, True))
    assert blind.off(plan.x[:, :2], "theta") > 0.15
    assert held.off(plan.x[:, :2], "theta") < 0.03
    # The readings that it acts on are 20 ms old: nothing is fed back before the first one.
    np.testing.assert_array_equal(held.u[:2], plan.u[:2])
    assert np.abs(held.u[2:] - plan.u[2:]).min(axis=1).max() > 0.0
    # What has been done meanwhile is reckoned with: a fifth of a second is not too late.
    assert play(system, plan, Rig(delay=0.2, noise=1e-4)).off(plan.x[:, :2], "theta") < 0.02


def test_readings_are_late_by_time_whatever_the_steps_of_the_plan() -> None:
    """With steps of 1 and 20 ms, readings 20 ms late came after one step."""
    t = np.concatenate([np.linspace(0.0, 0.05, 51), np.arange(0.07, 0.30, 0.02)])
    slide = Mechanism([tx("x", mass=1.0, name="mass")], [JointForce("x", "push")])
    system = MidpointSystem(MidpointVI(slide), t)
    plan = np.zeros((len(t), 2)), np.zeros((len(t) - 1, 1))
    start = system.integrator.start([0.01])
    for delay, first in ((0.02, 20), (0.0205, 21), (0.06, 51), (0.0, 0)):
        played = play(system, plan, Rig(noise=0.0, delay=delay, substeps=1), start=start)
        pushed = np.abs(played.u[:, 0]) > 1e-9
        assert not pushed[:first].any()
        assert pushed[first]
        assert played.x[-1, 0] < 0.01


def test_it_begins_where_it_is_told_and_comes_back(hanging: tuple[MidpointSystem, OptimizationResult]) -> None:
    system, plan = hanging
    q = hang(system.mechanism, plan.x[0, :2] + [0.1, 0.0])
    start = system.integrator.start(q)
    blind, held = (
        play(system, plan, Rig(stiffness=None, **NONE), start=start, feedback=feedback) for feedback in (False, True)
    )
    np.testing.assert_array_equal(held.q[0], q)
    apart = [np.abs(each.q[-20:, :2] - plan.x[-20:, :2]).max() for each in (blind, held)]
    assert apart[1] < 0.5 * apart[0]


def test_strings_stretch_go_slack_and_are_reeled_in(hanging: tuple[MidpointSystem, OptimizationResult]) -> None:
    system, plan = hanging
    rig = strung_rig(500.0, 1e-4)
    machine = rig.machine(system.mechanism)
    assert machine.constraints == ()
    string = machine.elements["string"]
    assert isinstance(string, ElasticString)
    assert string.tension_only
    tension = system.trajectory(plan.x, plan.u).tensions()["string"]
    assert tension[1:].min() > LEAST - 1e-3
    # By what the string is shorter, it is stretched: so much that it pulls as planned, V = k/2 r^2 by the stretch.
    x, u, shorter, least = reeled_in(system, plan.x, plan.u, rig)
    stretch = np.r_[plan.x[0, 3] - x[0, 3], plan.u[:-1, 1] - u[:-1, 1]]
    r = 1e-4 * np.logaddexp(0.0, stretch / 1e-4)
    np.testing.assert_allclose(
        500.0 * r / (1.0 + np.exp(-stretch / 1e-4)), np.r_[2.0, np.ones(99)] * tension, atol=1e-9
    )
    assert shorter == {}
    assert least == {"string": pytest.approx(min(2.0 * tension[0], tension[1:].min()) / 500.0)}
    held = play(system, plan, rig)
    assert np.degrees(held.off(plan.x[:, :2])) < 1.5


def test_what_carries_strings_of_fixed_lengths_is_lifted_where_they_are_stretched() -> None:
    """Two balls on strings of half a metre and 0.4 m below a bar that goes up and down and is tilted."""
    across = {"left": -0.3, "right": 0.3}
    bar = [
        tz("height", kinematic=True),
        [ry("tilt", kinematic=True), [tx(x, name=f"{s} end") for s, x in across.items()]],
    ]
    balls = [item for s, x in across.items() for item in (tx(x), [tz(s, mass=1.0, name=f"{s} ball")])]
    lengths = {"left": 0.5, "right": 0.4}
    strings = [Distance(f"{s} ball", f"{s} end", length, name=f"{s} string") for s, length in lengths.items()]
    m = Mechanism([*balls, *bar], [Gravity(), *strings])
    t = np.linspace(0.0, 1.0, 101)
    system = MidpointSystem(MidpointVI(m), t, multipliers=True)
    rise = 0.05 * (1.0 - np.cos(2.0 * np.pi * t))
    rho = np.stack([rise, 0.2 * rise], axis=1)
    start = project_configuration(m, m.configuration({"left": -0.5, "right": -0.4}), hold=["height", "tilt"]).q
    done = rolled_out(system, np.r_[system.integrator.start(start).x, 0.0, 0.0], rho[1:])
    plan = done.x, done.u
    tension = system.trajectory(*plan).tensions()
    rig = strung_rig(500.0, 1e-5)
    played = play(system, plan, rig, feedback=False)
    for s, length in lengths.items():
        # They are tied shorter by what they stretch in the mean (the last instant counts twice).
        pull = tension[f"{s} string"] * np.r_[2.0, np.ones(99)]
        short = played.mechanism.parameters[f"{s} string.length"]
        assert short == pytest.approx(length - np.append(pull, pull[-1]).mean() / 500.0, abs=1e-9)
    assert played.off(plan[0][:, : m.nq]) < 1e-3
    # Left as they are the balls hang 2 cm lower.
    plain = m.with_exchanged(
        {f"{s} string": [each.as_string(500.0, 1e-5)] for s, each in zip(lengths, strings, strict=True)}
    )
    sunk = MidpointVI(plain).simulate(MidpointVI(plain).start(start), t, rho=rho)
    assert np.abs(sunk.q - plan[0][:, : m.nq])[:, :2].max() > 0.02


def test_masses_are_drawn_with_their_inertias_and_factors_come_on_top() -> None:
    m = puppet_arm()
    rig = Rig(spread=0.1, seed=3, factors={"damping.*": 2.0})
    numbers, plain = rig.machine(m).parameters, rig.model(m).parameters
    for body in ("upper arm", "forearm"):
        factor = numbers[f"{body}.mass"] / plain[f"{body}.mass"]
        assert 0.9 < factor < 1.1
        assert factor != 1.0
        assert numbers[f"{body}.inertia.zz"] == pytest.approx(factor * plain[f"{body}.inertia.zz"])
    assert numbers["damping.elbow"] == pytest.approx(2.0 * plain["damping.elbow"])
    assert numbers["rail.value"] == plain["rail.value"]
    assert rig.machine(m).parameters == numbers


def test_a_drone_with_quaternions_is_held_where_it_hovers() -> None:
    wrench = BodyWrench("drone", force=(0, 0, "thrust"), torque=("roll", "pitch", "yaw"))
    m = Mechanism([free("drone", mass=1.0, inertia=(0.01, 0.02, 0.03))], [Gravity(), wrench])
    system = MidpointSystem(MidpointVI(m), 0.02 * np.arange(101))
    q = m.configuration()
    plan = np.tile(system.integrator.start(q).x, (101, 1)), np.tile([9.81, 0.0, 0.0, 0.0], (100, 1))
    blind, held = (
        play(system, plan, Rig(spread=0.1, delay=0.04), R=[1e-2, 1.0, 1.0, 1.0], feedback=feedback)
        for feedback in (False, True)
    )
    assert held.off(np.tile(q, (101, 1))) < 0.01
    assert blind.off(np.tile(q, (101, 1))) > 0.05


def test_what_cannot_be_simulated_is_said(upright: tuple[MidpointSystem, OptimizationResult]) -> None:
    system, plan = upright
    u = plan.u.copy()
    u[100:] = 1e30
    played = play(system, (plan.x, u), feedback=False)
    assert isinstance(played, Played)
    assert played.failure is not None
    assert len(played.x) == len(played.t) == len(played.u) + 1 < 301
    assert played.off(plan.x[:, :2]) == np.inf


def test_wrong_arguments_are_named(upright: tuple[MidpointSystem, OptimizationResult]) -> None:
    system, plan = upright
    for wrong, message in (
        ({"spread": 1.5}, "spread"),
        ({"noise": -1.0}, "noise"),
        ({"delay": np.nan}, "delay"),
        ({"delay": 1e308}, r"delay: got 1e\+308, expected a number"),
        ({"noise": 1e160}, "noise"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": 1e300}, "stiffness"),
        ({"smoothing": 1e-300}, "smoothing"),
        ({"factors": ["cart.mass"]}, r"factors: got .*expected a mapping"),
        ({"substeps": 0}, "substeps"),
        ({"factors": {"cart.mass": 0.0}}, "cart.mass"),
    ):
        with pytest.raises(ArgumentError, match=message):
            Rig(**wrong)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"unknown parameter 'wheel\.mass'"):
        play(system, plan, Rig(factors={"wheel.mass": 2.0}))
    with pytest.raises(ArgumentError, match="MidpointSystem"):
        play(system.integrator, plan)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match=r"start: got ndarray.*MidpointVI\(mechanism\).start"):
        play(system, plan, start=plan.x[0])  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="plan x"):
        play(system, (plan.x[1:], plan.u))
    with pytest.raises(ArgumentError, match="rig: got dict, expected a Rig"):
        play(system, plan, {"noise": 0.0})  # type: ignore[arg-type]
    for given, message in (
        (None, r"plan: got NoneType, expected a pair \(x, u\)$"),
        (SimpleNamespace(result=plan), r"plan: got SimpleNamespace, .*; \(plan.result.x, plan.result.u\) is one"),
    ):
        with pytest.raises(ArgumentError, match=message):
            play(system, given)  # type: ignore[arg-type]
    played = play(system, plan, Rig(**NONE))
    with pytest.raises(ArgumentError, match="nothing is called 'wheel'"):
        played.off(plan.x[:, :2], "wheel")
    with pytest.raises(ArgumentError, match="names: got none, expected some of 'x', 'theta'"):
        played.off(plan.x[:, :2], [])
