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
from leastaction.control.rigs.commands import reeled_in
from leastaction.control.rigs.play import _Controller
from leastaction.control.rigs.regulator import _PUSHING, Regulator
from leastaction.control.rigs.strings import Strings, as_springs, stretch_of, tension_of
from leastaction.errors import StepError
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.numerics.arrays import Array
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


def reeled(system: MidpointSystem, x: Array, u: Array, rig: Rig = RIG) -> tuple[MidpointSystem, Array, Array]:
    """Return the model of a rig, and what is commanded of it."""
    x, u, _, _ = reeled_in(system, x, u, rig)
    return MidpointSystem(system.integrator.like(rig.model(system.mechanism)), T), x, u


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
    strings = Strings(m)
    assert strings.names == ("string", "rope")
    np.testing.assert_array_equal(strings.stiffness, [K, 300.0])
    stretch = np.stack([HIGH - q[:, 0] - q[:, 1], HIGH - q[:, 0] + 0.3 - 2.2], axis=1)
    np.testing.assert_allclose(strings.stretches(q), stretch, atol=1e-15)
    expected = np.stack([tension_of(stretch[:, i], k, SMOOTH) / k for i, k in enumerate((K, 300.0))], axis=1)
    np.testing.assert_allclose(strings.room(stretch), expected, atol=1e-15)
    np.testing.assert_allclose(strings.slopes(q), np.tile([[-1.0, -1.0], [-1.0, 0.0]], (3, 1, 1)), atol=1e-12)
    # As springs they push, with the same numbers: the energy is that of springs.
    assert as_springs(m).parameters["rope.stiffness"] == 300.0
    push = float(as_springs(m).energy(q[2], np.zeros(2)).potential - m.energy(q[2], np.zeros(2)).potential)
    squares = 0.5 * np.array([K, 300.0]) @ np.minimum(stretch[2], 0.0) ** 2
    assert push == pytest.approx(squares, abs=1e-6)


def regulator_of(falling: tuple[MidpointSystem, Array, Array]) -> Regulator:
    model, x, u = reeled(*falling)
    return Regulator(model, x, u, WEIGHTS, np.ones(1))


def later(regulator: Regulator, k: int, x: Array, times: int = 30) -> tuple[Array, Array]:
    """Return what it plans at instant k from a state, after many steps in place of one."""
    regulator._begin(k)
    for _ in range(times):
        regulator.mpc(x, float(regulator.t[k]))
        assert regulator.mpc.info.planned
    return regulator.mpc.x.copy(), regulator.mpc.u.copy()


def law(regulator: Regulator, k: int, x: Array) -> Array:
    """Return the input by the linear-quadratic problem along the plan."""
    return np.asarray(regulator.u[k] - regulator.K[k] @ (x - regulator.x[k]))


def pushed(regulator: Regulator, k: int, x: Array) -> Array:
    """Return by how much each spring pushes (n, m) in states from instant k + 1 on, in metres."""
    return regulator.pushing.slack(np.ascontiguousarray(x[:, :2]), k + 1)


@pytest.mark.parametrize(("k", "n", "stiffness"), [(30, 40, K), (50, 2, 2.0 * K), (190, 40, K)])
def test_what_is_planned_ahead_is_the_least_of_what_is_stated(
    k: int, n: int, stiffness: float, falling: tuple[MidpointSystem, Array, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By roll-outs of the springs, and a cost that is written out: it is least in all directions of the inputs."""
    monkeypatch.setattr("leastaction.control.rigs.regulator._AHEAD", n * DT)
    model, xbar, ubar = reeled(*falling, strung_rig(stiffness, SMOOTH))
    regulator = Regulator(model, xbar, ubar, WEIGHTS, np.ones(1))
    assert regulator.ahead == n
    start = regulator.x[k] + [0.03, 0.0, 0.02, 0.0]
    x, u = later(regulator, k, start, 8)
    n = min(n, N - k)  # after the end there is nothing to be planned
    np.testing.assert_allclose(u[n:], np.broadcast_to(ubar[-1], u[n:].shape), atol=1e-9)
    x, u = x[: n + 1], u[:n]

    def made(inputs: Array) -> Array:
        states = [start]
        for j in range(n):
            states.append(regulator.springs.f(states[-1], inputs[j], k + j))
        return np.array(states)

    # What the rest of the plan costs, by the recursion of Riccati along it, written out.
    along = MidpointSystem(regulator.springs.integrator, T)
    ends = along.step_each(xbar, ubar).x
    A, B = along.linearize_each(xbar, ubar, ends)
    P, b = np.diag(WEIGHTS), np.zeros(4)
    for j in range(N - 1, k + n - 1, -1):
        c = ends[j] - xbar[j + 1]
        inner, pull = np.eye(1) + B[j].T @ P @ B[j], B[j].T @ (P @ c + b)
        gain = np.linalg.solve(inner, B[j].T @ P @ A[j])
        b = A[j].T @ (P @ c + b) - gain.T @ pull
        P = np.diag(WEIGHTS) + A[j].T @ P @ A[j] - gain.T @ inner @ gain

    def cost(inputs: Array) -> float:
        states = made(inputs)
        z, du = states - xbar[k : k + n + 1], inputs - ubar[k : k + n]
        end = 0.5 * z[-1] @ P @ z[-1] + b @ z[-1]
        stages = 0.5 * np.sum(WEIGHTS * z[:-1] ** 2) + 0.5 * np.sum(du**2)
        return float(stages + 0.5 * _PUSHING * stiffness * np.sum(pushed(regulator, k, states[1:]) ** 2) + end)

    np.testing.assert_allclose(made(u), x, atol=1e-9)
    assert (pushed(regulator, k, x[1:]) < -1e-4)[-1 if n < 10 else slice(None)].any()  # the price of that counts
    least, chance = cost(u), np.random.default_rng(0)
    for _ in range(10):
        way = chance.standard_normal(u.shape)
        up, down = (cost(u + s * 1e-2 * way) for s in (1.0, -1.0))
        assert min(up, down) > least
        slopes = [(cost(v + 1e-6 * way) - cost(v - 1e-6 * way)) / 2e-6 for v in (u, u + 1e-2 * way)]
        assert abs(slopes[0]) < 1e-4 * abs(slopes[1])


def test_a_regulator_of_what_is_linear_is_the_law_along_the_plan() -> None:
    slide = Mechanism([tx("x", mass=1.0), tx("y", mass=2.0)], [JointForce("x", "push"), JointForce("y", "shove")])
    system = MidpointSystem(MidpointVI(slide), 0.02 * np.arange(101))
    chance = np.random.default_rng(1)
    # A plan that the system does not go along at all, by a twentieth of its state in every step.
    x, u = np.cumsum(0.05 * chance.standard_normal((101, 4)), axis=0), chance.standard_normal((100, 2))
    regulator = Regulator(system, x, u, np.array([20.0, 3.0, 1.0, 0.5]), np.array([0.1, 1.0]))
    state = x[0] + [0.3, -0.2, 0.1, 0.5]
    for k in range(100):
        given = regulator.command(k, state)
        np.testing.assert_allclose(given, law(regulator, k, state), atol=1e-7)
        state = system.f(state, given, k) + 0.01 * chance.standard_normal(4)


def test_a_regulator_does_not_push_on_strings(falling: tuple[MidpointSystem, Array, Array]) -> None:
    regulator = regulator_of(falling)
    k = 50  # where it falls
    low, high = (regulator.x[k] + [z, 0.0, 0.0, 0.0] for z in (-1e-5, 0.02))
    # A ball that is too low is lifted as a linear regulator does; one that is too high is not pushed down.
    assert later(regulator, k, low)[1][0] == pytest.approx(law(regulator, k, low), abs=1e-5)
    by_law = [high]
    for j in range(k, k + regulator.ahead):
        by_law.append(regulator.springs.f(by_law[-1], law(regulator, j, by_law[-1]), j))
    pushing = pushed(regulator, k, np.array(by_law[1:]))
    ahead = pushed(regulator, k, later(regulator, k, high)[0][1:])
    # Slack is reeled in sooner than the law has it, and what is on its way is not paid out again.
    assert pushing[4:].min() < -1e-2
    assert ahead[4:].min() > -1e-3
    assert np.sum(ahead**2) < 0.5 * np.sum(pushing**2)


def test_a_regulator_looks_ahead(falling: tuple[MidpointSystem, Array, Array]) -> None:
    """Before the ball falls it knows that its string will be slack then, while the next steps are fine."""
    regulator = regulator_of(falling)
    k = 20
    high = regulator.x[k] + [0.005, 0.0, 0.0, 0.0]
    x, u = later(regulator, k, high)
    assert not pushed(regulator, k, x[1:11]).any()
    assert np.abs(u[0] - law(regulator, k, high)).max() > 1e-4


def test_a_regulator_holds_where_a_law_along_the_plan_does_not() -> None:
    """A pole that is 1.1 rad off the upright, on a cart that is to stay where it is."""
    system = MidpointSystem(MidpointVI(cart_pendulum()), 0.01 * np.arange(401))
    upright = np.tile([0.0, np.pi, 0.0, 0.0], (401, 1))
    regulator = Regulator(system, upright, np.zeros((400, 1)), np.array([1.0, 1.0, 0.0, 0.0]), np.array([1e-4]))
    off = []
    for command in (regulator.command, lambda k, x: law(regulator, k, x)):
        x = upright[0] + [0.0, 1.1, 0.0, 0.0]
        for k in range(400):
            x = system.f(x, command(k, x), k)
        off.append(abs(x[1] - np.pi))
    assert off[0] < 0.05
    assert off[1] > 1.0


def test_a_regulator_begins_anew_where_what_it_found_leads_nowhere(
    falling: tuple[MidpointSystem, Array, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    regulator = regulator_of(falling)
    x = regulator.x[0] + [1e-3, 0.0, 0.0, 0.0]
    anew = regulator.command(0, x)
    monkeypatch.setattr(regulator, "_go_on", lambda k: regulator.mpc._x.fill(np.nan))
    np.testing.assert_array_equal(regulator.command(0, x), anew)
    assert regulator.mpc.info.planned
    # Nowhere along the plan either: the law, which looks at no steps.
    monkeypatch.setattr(regulator.mpc, "_improve", lambda *_: "nowhere")
    np.testing.assert_allclose(regulator.command(0, x), law(regulator, 0, x), atol=1e-12)
    assert not regulator.mpc.info.planned


def test_an_estimate_follows_what_the_model_does_not_have() -> None:
    """A push of 0.5 N that nobody told it of: without a surprise it would be sure of itself, and stay behind."""
    slide = Mechanism([tx("x", mass=1.0)], [JointForce("x", "push")])
    system = MidpointSystem(MidpointVI(slide), 0.02 * np.arange(101))
    chance = np.random.default_rng(0)
    truth = np.zeros(2)
    controller = _Controller(system, np.zeros((101, 2)), np.zeros((100, 1)), np.ones(2), np.ones(1), 1e-3)
    for k in range(100):
        controller.read(truth[:1] + 1e-3 * chance.standard_normal(1))
        off = np.abs(controller.kalman.x - truth)
        truth = system.f(truth, np.array([0.5]), k)
    assert off[0] < 0.02
    assert off[1] < 0.1


def test_an_estimate_follows_a_string_that_is_slack(falling: tuple[MidpointSystem, Array, Array]) -> None:
    """A string 5 cm longer than planned: the ball falls, and the estimate with it, where one about the plan is lost."""
    system, x, u = falling
    model, x, u = reeled(system, x, u)
    slack = u + 0.05
    truth = [x[0]]
    for k in range(40):
        truth.append(model.f(truth[-1], slack[k], k))
    controller = _Controller(model, x, slack, WEIGHTS, np.ones(1), 1e-4)
    controller.kalman.x = x[0] + [0.003, 0.0, 0.0, 0.0]
    for k in range(41):
        controller.read(truth[k][:1])
    np.testing.assert_allclose(controller.kalman.x, truth[40], atol=1e-4)
    made = model.step_each(x, u)
    A, B = model.linearize_each(x, u, made.x)
    z = truth[0] - x[0]
    for k in range(40):
        z = A[k] @ z + B[k] @ (slack[k] - u[k])
    assert np.abs(x[40] + z - truth[40]).max() > 0.02


def test_a_feedback_goes_on_where_its_model_has_no_step(
    falling: tuple[MidpointSystem, Array, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As far from the plan as before: so it is beside the singular pose of three angles, for some steps."""
    system, x, u = falling
    start = MidpointVI(RIG.model(system.mechanism)).start([0.02, HIGH])
    held = play(system, (x, u), RIG, start=start)
    step = MidpointSystem.f
    missing: list[int] = []

    def f(self: MidpointSystem, state: Array, inputs: Array, k: int) -> Array:
        if 20 <= k < 25 and self.N == N:
            missing.append(k)
            raise StepError("no such step", t=float(self.t[k]), residuals={}, iteration=0)
        return step(self, state, inputs, k)

    monkeypatch.setattr(MidpointSystem, "f", f)
    played = play(system, (x, u), RIG, start=start)
    assert set(missing) == {20, 21, 22, 23, 24}
    assert played.failure is None
    assert played.off(x[:, :2], "z") < held.off(x[:, :2], "z") + 0.01


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
