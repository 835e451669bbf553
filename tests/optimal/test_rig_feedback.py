"""What is fed back on rigs whose strings do not push: the regulator, the estimate, and what they go along."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Distance,
    ElasticString,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    Rig,
    play,
    project_configuration,
    tx,
    tz,
)
from leastaction.numerics.arrays import Array
from leastaction.systems.rigs.commands import _follow_stretch, reeled_in
from leastaction.systems.rigs.estimator import Estimator
from leastaction.systems.rigs.reference import made_by
from leastaction.systems.rigs.regulator import _SLACK, Regulator, _keep_taut
from leastaction.systems.rigs.strings import Strings, as_springs, stretch_of, tension_of
from optimal.systems import rolled_out, strung_rig

K, SMOOTH = 500.0, 1e-4  # N/m, m
HIGH = 2.0  # m
N, DT = 200, 0.01
T = DT * np.arange(N + 1)
WEIGHTS = np.array([20.0, 0.1, 0.0, 10.0])  # of z, length, p, v_length
RIG = strung_rig(K, SMOOTH)


def lift() -> Mechanism:
    """Return a ball of half a kilogram on a string from a ceiling, which is reeled in and out."""
    ball = [tz("z", mass=0.5, name="ball")]
    return Mechanism(
        [*ball, tz(HIGH, name="ceiling")], [Gravity(), Distance("ball", "ceiling", "length", name="string")]
    )


@pytest.fixture(scope="module")
def falling() -> tuple[MidpointSystem, Array, Array]:
    """A ball that all but falls freely every second, its string pulling by 0.1 N then, and is caught in between."""
    system = MidpointSystem(MidpointVI(lift()), T, multipliers=True)
    pull = 0.5 * 9.81 + (0.5 * 9.81 - 0.1) * np.cos(2.0 * np.pi * T)
    z = (0.5 * 9.81 - 0.1) / 0.5 / (2.0 * np.pi) ** 2 * (1.0 - np.cos(2.0 * np.pi * T))
    assert pull.min() == pytest.approx(0.1)
    m = system.mechanism
    q = project_configuration(m, [0.0, HIGH], hold=["z"]).q
    start = system.integrator.start(q).x
    done = rolled_out(system, np.r_[start, 0.0], (HIGH - z[1:])[:, None])
    return system, done.x, done.u


def reeled(system: MidpointSystem, x: Array, u: Array) -> tuple[MidpointSystem, Array, Array]:
    """Return the model of a rig, and what is commanded of it."""
    x, u, _ = reeled_in(system, x, u, RIG)
    return MidpointSystem(system.integrator.like(RIG.model(system.mechanism)), T), x, u


def test_strings_are_stretched_as_much_as_makes_them_pull() -> None:
    stretch = np.linspace(-6.0, 40.0, 93) * SMOOTH
    # The derivative of V = k/2 r^2 by a complex step.
    moved = stretch + 1e-30j
    r = SMOOTH * np.log(1.0 + np.exp(moved / SMOOTH))
    np.testing.assert_allclose(tension_of(stretch, K, SMOOTH), (0.5 * K * r**2).imag / 1e-30, rtol=1e-9)
    pull = np.r_[np.geomspace(1e-3 * K * SMOOTH, 1e3, 50), 1e4]
    np.testing.assert_allclose(tension_of(stretch_of(pull, K, SMOOTH), K, SMOOTH), pull, rtol=1e-10)
    # What pushes or pulls by nothing is a string that is nearly slack, by some lengths over which it becomes so.
    assert -8.0 * SMOOTH < float(stretch_of(np.array(-3.0), K, SMOOTH)) < -2.0 * SMOOTH


def test_stretches_of_strings_of_all_kinds_are_known_along_a_motion() -> None:
    """One that is prescribed, one over a via-point with a number for its length, changed later; not one that pushes."""
    ends = [tz(HIGH, name="ceiling"), [tx(0.3, name="aside")]]
    m = Mechanism(
        [tz("z", mass=0.5, name="ball"), *ends],
        [
            Gravity(),
            ElasticString(("ball", "ceiling"), K, "length", smoothing=SMOOTH, name="string"),
            ElasticString(("ball", "ceiling", "aside"), K, 2.0, smoothing=SMOOTH, name="rope"),
            ElasticString(("ball", "ceiling"), K, 1.0, tension_only=False, name="rubber"),
        ],
    ).with_parameters({"rope.length": 2.2, "rope.stiffness": 300.0})
    q = np.array([[0.01, 1.98995], [0.2, 1.75], [-0.1, 2.2]])  # the first is taut by half the smoothing length
    strings = Strings.along(m, q)
    assert strings.names == ("string", "rope")
    stretch = np.stack([HIGH - q[:, 0] - q[:, 1], HIGH - q[:, 0] + 0.3 - 2.2], axis=1)
    expected = np.stack([tension_of(stretch[:, i], k, SMOOTH) / k for i, k in enumerate((K, 300.0))], axis=1)
    np.testing.assert_allclose(strings.room, expected, atol=1e-15)
    np.testing.assert_allclose(strings.slopes, np.tile([[-1.0, -1.0], [-1.0, 0.0]], (3, 1, 1)), atol=1e-12)
    # As springs they push, with the same numbers: the energy is that of springs.
    assert as_springs(m).parameters["rope.stiffness"] == 300.0
    push = float(as_springs(m).energy(q[2], np.zeros(2)).potential - m.energy(q[2], np.zeros(2)).potential)
    squares = 0.5 * np.array([K, 300.0]) @ np.minimum(stretch[2], 0.0) ** 2
    assert push == pytest.approx(squares, abs=1e-6)


def test_least_inputs_that_keep_strings_taut_are_found() -> None:
    """The minimum of ``1/2 y'y + weight/2 min(0, influence y + room)^2``, which is convex: its gradient is zero."""
    chance = np.random.default_rng(0)
    for _ in range(50):
        rows, columns = chance.integers(1, 60), chance.integers(1, 40)
        influence, room = chance.standard_normal((rows, columns)), chance.standard_normal(rows)
        y = _keep_taut(influence, room)
        missing = np.minimum(influence @ y + room, 0.0)
        pull = -_SLACK * missing
        np.testing.assert_allclose(y, influence.T @ pull, atol=1e-6 * (1.0 + pull.sum()))


def test_a_regulator_does_not_push_on_strings(falling: tuple[MidpointSystem, Array, Array]) -> None:
    system, x, u = falling
    model, x, u = reeled(system, x, u)
    x, u = made_by(model, x, u, WEIGHTS, np.ones(1))
    # What it goes along is a motion of the model itself.
    assert np.abs(model.step_each(x, u).x - x[1:]).max() < 1e-4
    regulator = Regulator(model, x, u, WEIGHTS, np.ones(1))
    k = 50  # where it falls
    low, high = (np.array([z, 0.0, 0.0, 0.0]) for z in (-1e-5, 0.02))
    # A ball that is too low is lifted as a linear regulator does; one that is too high is not pushed down.
    np.testing.assert_array_equal(regulator.correction(k, low), -regulator.K[k] @ low)
    springs = MidpointSystem(model.integrator.like(as_springs(model.mechanism)), T)
    A, B = springs.linearize_each(x, u, springs.step_each(x, u).x)

    def room_after(du: Array) -> float:
        after = A[k] @ high + B[k] @ du
        return float((regulator.strings.room[k + 1] + regulator.strings.slopes[k + 1] @ after[:2])[0])

    pushing = room_after(-regulator.K[k] @ high)
    assert pushing < -1e-2
    assert room_after(regulator.correction(k, high)) > 0.1 * pushing


def test_a_regulator_looks_ahead(falling: tuple[MidpointSystem, Array, Array]) -> None:
    """Before the ball falls it knows that its string will be slack then, while the next steps are fine."""
    system, x, u = falling
    model, x, u = reeled(system, x, u)
    x, u = made_by(model, x, u, WEIGHTS, np.ones(1))
    regulator = Regulator(model, x, u, WEIGHTS, np.ones(1))
    k, high = 20, np.array([0.005, 0.0, 0.0, 0.0])
    assert regulator._foretold(k, k + 10, high).min() > 5e-3
    assert regulator._foretold(k, k + 40, high).min() < -2e-3
    assert np.abs(regulator.correction(k, high) + regulator.K[k] @ high).max() > 1e-4


def test_what_moves_strings_by_next_to_nothing_is_left_where_it_is() -> None:
    """A slide above a ball that hangs beside the vertical by a milliradian would go half a metre for a millimetre."""
    m = Mechanism(
        [
            tx("aside", kinematic=True, name="slide"),
            tz("height", kinematic=True, name="lift"),
            tx(1e-3), [tz("right", mass=1.0, name="right ball")],
            tz("left", mass=1.0, name="left ball"),
        ],
        [Distance("slide", "right ball", 1.0, name="right"), Distance("lift", "left ball", 1.0, name="left")],
    )  # fmt: skip
    planned = np.zeros((2, m.nx))
    planned[:, : m.nq] = m.configuration({"right": -1.0, "left": -1.0})
    before = planned.copy()
    _follow_stretch(m, planned, {name: np.full(2, 1e-3) for name in ("right", "left")}, 10.0)
    np.testing.assert_allclose(planned[:, m.variables.index("height")], 1e-3, rtol=1e-2)
    np.testing.assert_array_equal(
        np.delete(planned, m.variables.index("height"), axis=1), np.delete(before, m.variables.index("height"), axis=1)
    )


def test_an_estimate_follows_what_the_model_does_not_have() -> None:
    """A push of 0.5 N that nobody told it of: without a surprise it would be sure of itself, and stay behind."""
    slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", "push")])
    system = MidpointSystem(MidpointVI(slide), 0.02 * np.arange(101))
    chance = np.random.default_rng(0)
    truth, estimate = np.zeros(2), Estimator(system, np.zeros(2), 1e-3)
    for k in range(100):
        estimate.read(truth[:1] + 1e-3 * chance.standard_normal(1))
        estimate.advance(k, np.zeros(1))
        truth = system.f(truth, np.array([0.5]), k)
    assert abs(estimate.x[0] - truth[0]) < 0.02
    assert abs(estimate.x[1] - truth[1]) < 0.1


def test_an_estimate_follows_a_string_that_is_slack(falling: tuple[MidpointSystem, Array, Array]) -> None:
    """A string 5 cm longer than planned: the ball falls, and the estimate with it, where one about the plan is lost."""
    system, x, u = falling
    model, x, u = reeled(system, x, u)
    slack = u + 0.05
    truth = [x[0]]
    for k in range(40):
        truth.append(model.f(truth[-1], slack[k], k))
    off = np.array([0.003, 0.0, 0.0, 0.0])
    estimate = Estimator(model, x[0] + off, 1e-4)
    for k in range(40):
        estimate.read(truth[k][:1])
        estimate.advance(k, slack[k])
    np.testing.assert_allclose(estimate.x, truth[40], atol=1e-4)
    made = model.step_each(x, u)
    A, B = model.linearize_each(x, u, made.x)
    z = truth[0] - x[0]
    for k in range(40):
        z = A[k] @ z + B[k] @ (slack[k] - u[k])
    assert np.abs(x[40] + z - truth[40]).max() > 0.02


@pytest.mark.parametrize("rig", [RIG, Rig(stiffness=K, smoothing=SMOOTH)])
def test_a_string_is_not_paid_out_to_push(falling: tuple[MidpointSystem, Array, Array], rig: Rig) -> None:
    """A ball begins 0.2 m too high, its string slack. A linear feedback makes it longer by 0.7 m, and it falls."""
    system, x, u = falling
    start = MidpointVI(rig.model(system.mechanism)).start([0.2, HIGH])
    played = play(system, (x, u), rig, start=start)
    slack = HIGH - played.x[:, 0] - played.x[:, 1]
    assert slack.min() > -0.2 - 1e-6
    assert played.off(x[:, :2], "z") < 0.1
    assert (played.x[:, 0] - x[:, 0]).min() > -0.02
