"""Ways to a first trajectory: each on a problem that is not solved without it, and none loses what it has."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from leastaction import (
    Bound,
    Damping,
    Distance,
    Gravity,
    JointForce,
    LinearSpring,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    StageTable,
    StartStatus,
    Status,
    coarse_to_fine,
    continuation,
    embed,
    optimize,
    project_configuration,
    receding_horizon,
    rx,
    rz,
    tx,
    ty,
    tz,
    warm_start,
    world,
)
from leastaction.errors import ArgumentError, ProjectionError
from leastaction.optimal import (
    Cost,
    CostGradient,
    CostHessian,
    DiscreteSystem,
    FinalTime,
    FunctionSystem,
    HelpedCost,
    LinearSystem,
    ProjectionOperator,
    WindowCost,
    WindowSystem,
    check_derivatives,
    resample,
)
from leastaction.optimal.quantity import Samples
from leastaction.optimal.system import System
from optimal.systems import CartPendulum, is_trajectory, rolled_out

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks.robustness_problems import (
    _HOOKS,
    PROBLEMS,
    Given,
    arm,
    cart,
    double_pendulum,
    posed,
    puppet_arm,
    rod,
)

# Motors and strings by few steps, for the ways: shorter steps would have other minima.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

BY_NAME = {problem.name: problem for problem in PROBLEMS}


def steer(m, t, goal, *, q0=None, Q=0.1, rates=1e-2, R=1e-2, final=1e4):
    """Return a system, and the cost of going to a goal: variables by name, constant or over time."""
    h = (t[1] - t[0]) / 0.02
    start = m.configuration(q0 or {})
    x = np.zeros((len(t), m.nx))
    x[:, : m.nq] = start
    for name, values in goal.items():
        x[:, m.variables.index(name)] = values
    u = np.zeros((len(t) - 1, m.n_inputs + m.nrho))
    u[:, m.n_inputs :] = start[m.nd :]
    weight = h * np.concatenate([np.full(m.nq, Q), np.full(m.nx - m.nq, rates)])
    last = np.concatenate([np.full(m.nq, final), np.full(m.nx - m.nq, 0.1 * final)])
    cost = QuadraticCost(x, u, Q=weight, R=np.full(u.shape[1], h * R), Q_final=last)
    return MidpointSystem(MidpointVI(m, threads=1), t), cost


def at_rest(system, q0=None):
    """Return the initial state, and inputs of zero."""
    m = system.integrator.mechanism
    u = np.zeros((system.N, system.nu))
    q = m.configuration(q0 or {})
    u[:, m.n_inputs :] = q[m.nd :]
    return np.concatenate([q, np.zeros(system.nx - m.nq)]), u


# ---- Continuation -----------------------------------------------------------------------------------


def far(value):
    """Return the result of a tiny problem whose solution goes with the parameter."""
    system = LinearSystem(np.eye(1), np.ones((1, 1)), N=3)
    cost = QuadraticCost(np.full((4, 1), value), np.zeros((3, 1)), Q=[1.0], R=[1.0])
    return optimize(system, cost, initial=(np.zeros(1), np.zeros((3, 1))))


class Stubborn:
    """Solves only close to what was solved before."""

    def __init__(self, reach, interrupt=0):
        self.reach, self.at, self.calls, self.interrupt = reach, None, 0, interrupt

    def __call__(self, value, earlier):
        self.calls += 1
        if self.calls == self.interrupt:
            raise KeyboardInterrupt
        assert (earlier is None) == (self.at is None)
        if self.at is not None and abs(value - self.at) > self.reach:
            raise ArgumentError(f"{value} is too far from {self.at}")
        self.at = value
        return far(value)


def test_continuation_halves_and_doubles_its_step():
    found = continuation(Stubborn(0.3), [0.0, 1.0])
    assert found.status is StartStatus.COMPLETED
    assert found.value == 1.0
    tried = [stage.value for stage in found.stages]
    assert tried == [0.0, 1.0, 0.5, 0.25, 0.75, 0.5, 1.0, 0.75, 1.0]
    assert [stage.accepted for stage in found.stages] == [True, False, False, True, False, True, False, True, True]
    assert found.stages[1].status == "ArgumentError"
    assert "too far" in found.stages[1].note
    assert found.cost == far(1.0).cost
    np.testing.assert_array_equal(found.x, far(1.0).x)
    # What is easy all along takes ever larger steps, past the values that were given.
    easy = continuation(Stubborn(np.inf), np.linspace(0.0, 1.0, 16))
    np.testing.assert_allclose([stage.value for stage in easy.stages], np.array([0, 2, 6, 14, 15]) / 15.0)


def test_continuation_in_a_price_goes_by_factors():
    found = continuation(Stubborn(70.0), [100.0, 1.0], scale="log")
    np.testing.assert_allclose(
        [stage.value for stage in found.stages], [100.0, 1.0, 10.0, 100.0**0.75, 100.0**0.25, 1.0]
    )
    assert found.success
    assert found.value == pytest.approx(1.0)
    part = continuation(Stubborn(70.0), [100.0, 1.0], scale="log", max_stages=4)
    assert part.value == pytest.approx(100.0**0.75)
    whole = continuation(lambda v, e: far(v), [100.0, 1.0], scale="log", resume=part)
    assert whole.stages[-1].value == pytest.approx(1.0)


def test_continuation_gives_up_with_the_best():
    found = continuation(Stubborn(1e-3), [2.0, 3.0], least_step=0.1, name="load")
    assert found.status is StartStatus.GAVE_UP
    assert not found.success
    assert found.value == 2.0
    assert found.cost == far(2.0).cost
    assert "At load = 2, not even 2.125" in found.message
    assert "too far" in found.message
    hopeless = continuation(lambda v, e: far(v), [0.0, 1.0], accept=lambda r: False)
    assert hopeless.status is StartStatus.GAVE_UP
    assert "first problem" in hopeless.message
    with pytest.raises(ArgumentError, match="no way"):
        continuation(lambda v, e: (_ for _ in ()).throw(ArgumentError("no way")), [0.0, 1.0])


def test_continuation_goes_on_where_it_was_stopped():
    stubborn = Stubborn(0.3, interrupt=6)
    part = continuation(stubborn, [0.0, 1.0])
    assert part.status is StartStatus.INTERRUPTED
    assert part.value == 0.25
    np.testing.assert_array_equal(part.x, far(0.25).x)
    whole = continuation(stubborn, [0.0, 1.0], resume=part)
    assert whole.success
    assert [stage.stage for stage in whole.stages] == list(range(1, len(whole.stages) + 1))
    assert whole.iterations == sum(stage.iterations for stage in whole.stages)
    assert continuation(stubborn, [0.0, 1.0], resume=whole) is whole
    stopped = continuation(Stubborn(0.3), [0.0, 1.0], callback=lambda stage: stage.value == 0.5)
    assert stopped.status is StartStatus.STOPPED_BY_CALLBACK
    assert stopped.value == 0.0
    few = continuation(Stubborn(0.3), [0.0, 1.0], max_stages=4)
    assert few.status is StartStatus.STAGE_LIMIT
    assert few.value == 0.25
    assert continuation(Stubborn(0.3), [0.0, 1.0], done=lambda r: r.cost > 0.0).value == 0.25
    with pytest.raises(KeyboardInterrupt):
        continuation(Stubborn(0.3, interrupt=1), [0.0, 1.0])


def test_an_interrupted_stage_does_not_count():
    def solve(value, earlier):
        if value == 1.0:
            system = CartPendulum(50, 0.02)
            cost = QuadraticCost(np.ones((51, 4)), np.zeros((50, 1)), Q=np.ones(4), R=[1.0])

            def stop(record):
                raise KeyboardInterrupt

            return optimize(system, cost, initial=(np.zeros(4), np.zeros((50, 1))), callback=stop)
        return far(value)

    found = continuation(solve, [0.0, 1.0])
    assert found.status is StartStatus.INTERRUPTED
    assert found.x.shape == (4, 1)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"values": [1.0]}, "values.*at least two"),
        ({"values": [0.0, 1.0, 1.0]}, "values.*increase"),
        ({"values": [0.0, np.nan]}, "values"),
        ({"values": [0.0, 1.0], "scale": "log"}, "values.*positive"),
        ({"values": [0.0, 1.0], "scale": "cubic"}, "scale.*'linear' or 'log'"),
        ({"values": [0.0, 1.0], "solve": 3}, "solve.*function"),
        ({"values": [0.0, 1.0], "least_step": 0.0}, "least_step"),
        ({"values": [0.0, 1.0], "max_stages": 0}, "max_stages"),
    ],
)
def test_continuation_names_what_is_wrong(arguments, match):
    with pytest.raises(ArgumentError, match=match):
        continuation(**{"solve": lambda v, e: far(v), **arguments})


def test_an_acrobot_swings_up_as_the_end_matters_more_and_more():
    t = 0.02 * np.arange(201)
    m = double_pendulum("elbow")

    def problem(share):
        return steer(m, t, {"shoulder": np.pi}, R=1e-3, final=1e6 * share)

    system, cost = problem(1.0)
    rest = at_rest(system)
    alone = optimize(system, cost, initial=rest, max_iterations=140)
    assert alone.status is Status.ITERATION_LIMIT

    def solve(share, earlier):
        start = rest if earlier is None else (earlier.x, earlier.u)
        return optimize(system, problem(share)[1], initial=start, max_iterations=100, tolerance=1e-5)

    found = continuation(solve, [1e-4, 1.0], scale="log", name="share")
    assert found.success
    assert found.iterations <= 140  # from 94 to 102 by the variant of the core
    assert found.cost < 0.95 * alone.cost


# ---- Windows ----------------------------------------------------------------------------------------


class Banked(Cost):
    """A cost that differs from stage to stage, and has cross terms."""

    def _parts(self, x, u, k):
        return x[:, 0] * (1.0 + 0.1 * k), u[:, 0]

    def stage_values(self, x, u, start):
        a, b = self._parts(x, u, start + np.arange(len(u)))
        return 0.5 * (a**2 + b**2 + a * b) + 0.1 * a

    def final_value(self, x):
        return float(x[0] ** 2)

    def gradient(self, x, u):
        k = np.arange(len(u))
        a, b = self._parts(x[:-1], u, k)
        q, r = np.zeros((len(u), x.shape[1])), np.zeros(u.shape)
        q[:, 0], r[:, 0] = (1.0 + 0.1 * k) * (a + 0.5 * b + 0.1), b + 0.5 * a
        last = np.zeros(x.shape[1])
        last[0] = 2.0 * x[-1, 0]
        return CostGradient(q, r, last)

    def hessian(self, x, u):
        n, nx = len(u), x.shape[1]
        weight = 1.0 + 0.1 * np.arange(n)
        Q, S, R = np.zeros((n, nx, 1)), np.zeros((n, nx, u.shape[1])), np.zeros((n, u.shape[1], 1))
        Q[:, 0, 0], S[:, 0, 0], R[:, 0, 0] = weight**2, 0.5 * weight, 1.0
        last = np.zeros(nx)
        last[0] = 2.0
        return CostHessian(Q, R, S, last)


def test_windows_that_follow_begin_where_the_one_before_has_led() -> None:
    """Whatever is free of the initial state: the parts that are kept are one trajectory, of one system."""
    m = Mechanism(
        [ty("cart", mass=4.0), [rx("pole"), [tz(-1.0, mass=1.0)]]],
        [Gravity(), Damping(0.05), JointForce("cart", "push")],
    )
    system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 2.0, 41))
    wanted = np.zeros((41, 4))
    wanted[:, 0] = 0.3 * np.sin(3.0 * system.t + 1.0)
    cost = QuadraticCost(wanted, np.zeros((40, 1)), Q=[10.0, 1.0, 1e-3, 1e-3], R=[1e-3])
    how = {"initial": (np.zeros(4), np.zeros((40, 1))), "window": 20}
    found = receding_horizon(system, cost, free_start=True, **how)
    assert found.success
    assert found.x[0, 0] > 0.1
    assert is_trajectory(system, found.x, found.u)
    with pytest.raises(ArgumentError, match="unknowns: got some, expected none: each window"):
        receding_horizon(system, cost, unknowns=[FinalTime(1.0, 3.0)], **how)


@pytest.mark.parametrize(("start", "stop"), [(0, 7), (5, 12), (13, 20)])
def test_a_window_is_a_problem_of_its_own(rng, start, stop):
    whole = CartPendulum(20, 0.02)
    part = whole.window(start, stop)
    assert isinstance(part, WindowSystem)
    x, u = 0.1 * rng.standard_normal((21, 4)), rng.standard_normal((20, 1))
    cost = Banked().window(start, stop, N=20, nu=1)
    assert isinstance(cost, WindowCost)
    assert check_derivatives(part, x[start : stop + 1], u[start:stop], cost=cost).ok
    for mine, convex in zip(
        cost.hessian(x[start : stop + 1], u[start:stop]), cost.convex_hessian(x[start : stop + 1], u[start:stop]),
        strict=True,
    ):  # fmt: skip
        np.testing.assert_array_equal(convex, mine)
    cost.check_shapes(stop - start, 4, 1)
    with pytest.raises(ArgumentError, match=f"a window of {stop - start} steps with 1 inputs, expected 3 with 1"):
        cost.check_shapes(3, 4, 1)
    K = rng.standard_normal((20, 1, 4))
    run = whole.rollout(x[start], x, u, K, start, stop)
    own = ProjectionOperator(part, K[start:stop])(x[start : stop + 1], u[start:stop])
    np.testing.assert_array_equal(run.x, own.x)
    np.testing.assert_array_equal(run.u, own.u)
    nested = part.window(2, 5)
    assert nested.when(1) == whole.when(start + 3)
    assert nested.N == 3


@pytest.mark.parametrize("stop", [12, 20])
@pytest.mark.parametrize("stages", [False, True])
def test_a_window_of_a_quadratic_cost_is_one(rng, stop, stages):
    Q = rng.random((20, 4)) if stages else np.diag(rng.random(4))
    cost = QuadraticCost(rng.random((21, 4)), np.zeros((20, 1)), Q=Q, R=[0.1], Q_final=np.arange(4.0))
    own, general = cost.window(5, stop, N=20, nu=1), WindowCost(cost, 5, stop, N=20, nu=1)
    assert type(own) is QuadraticCost
    x, u = rng.random((stop - 4, 4)), rng.random((stop - 5, 1))
    assert own.value(x, u) == pytest.approx(general.value(x, u), rel=1e-14)
    for mine, theirs in zip(own.gradient(x, u), general.gradient(x, u), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-14)
    for mine, theirs in zip(own.hessian(x, u), general.hessian(x, u), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_window_of_a_mechanism_is_one(rng):
    system, _ = steer(puppet_arm(2), 0.02 * np.arange(21), {}, q0=HANGING)
    system = MidpointSystem(system.integrator, system.t, multipliers=True)
    x0, u = at_rest(system, HANGING)
    run = rolled_out(system, x0, u)
    part = system.window(4, 15)
    assert type(part) is MidpointSystem
    for mine, theirs in zip(part.linearize(run.x[4:16], u[4:15]), system.linearize(run.x, u), strict=True):
        np.testing.assert_array_equal(mine, theirs[4:15])

    class Own(MidpointSystem):
        """One that gives more than it takes."""

        def f(self, x, u, k):
            return 2.0 * super().f(x, u, k) + self.time(k)

    own = Own(system.integrator, system.t)
    later = own.window(4, 15)
    assert type(later) is Own
    np.testing.assert_array_equal(later.f(run.x[6, : own.nx], u[6], 2), own.f(run.x[6, : own.nx], u[6], 6))
    heavier = own.with_parameters({"final time": 0.8})
    assert (type(heavier), heavier.time(20)) == (Own, 0.8)
    for start, stop in ((3, 3), (-1, 4), (10, 21)):
        for make in (system.window, CartPendulum(20).window):
            with pytest.raises(ArgumentError, match="window: got the steps"):
                make(start, stop)


# ---- Receding horizon -------------------------------------------------------------------------------


def balancing(N=200):
    """Return a pole that is to stay up while its cart goes back and forth; without a push it falls at once."""
    t = 0.02 * np.arange(N + 1)
    goal = {"pole0": np.pi, "cart": 0.5 * np.sin(1.5 * t)}
    q0 = {"pole0": np.pi - 0.3}
    system, cost = steer(cart(), t, goal, q0=q0, Q=10.0, final=100.0)
    return system, cost, at_rest(system, q0)


def test_a_pole_that_falls_is_balanced_window_by_window():
    system, cost, rest = balancing()
    alone = optimize(system, cost, initial=rest, max_iterations=100)
    found = receding_horizon(system, cost, initial=rest, window=80, keep=40)
    assert found.success
    assert is_trajectory(system, found.x, found.u)
    assert found.cost == pytest.approx(cost.value(found.x, found.u))
    best = optimize(system, cost, initial=found.initial)
    assert best.status is Status.CONVERGED
    assert found.iterations + best.iterations <= 100
    assert best.cost < 0.1 * alone.cost


def test_windows_go_on_where_they_were_stopped():
    system, cost, rest = balancing(100)
    how = {"window": 40, "keep": 15}
    whole = receding_horizon(system, cost, initial=rest, **how)
    assert [stage.value for stage in whole.stages] == [0, 15, 30, 45, 60]
    part = receding_horizon(system, cost, initial=rest, callback=lambda stage: stage.stage == 2, **how)
    assert part.status is StartStatus.STOPPED_BY_CALLBACK
    assert part.value == 30
    assert part.x.shape == (31, 4)
    assert np.isnan(part.cost)
    np.testing.assert_array_equal(part.x, whole.x[:31])
    rest_of_it = receding_horizon(system, cost, initial=rest, resume=part, **how)
    assert rest_of_it.success
    assert is_trajectory(system, rest_of_it.x, rest_of_it.u)
    np.testing.assert_array_equal(rest_of_it.x[:31], whole.x[:31])
    assert len(rest_of_it.stages) == len(whole.stages)


class Cliff(DiscreteSystem):
    """A point that moves as it is told, but not past a wall, nor on from step `end`."""

    has_curvature = False

    def __init__(self, end=99):
        self.nx = self.nu = 1
        self.N, self.end = 12, end

    def f(self, x, u, k):
        if x[0] + u[0] > 1.0 or k >= self.end:
            raise ArithmeticError("there is a wall")
        return x + u

    def derivatives(self, x, u, k):
        return np.eye(1), np.eye(1)


def test_a_window_that_cannot_be_begun_is_shortened():
    cost = QuadraticCost(np.zeros((13, 1)), np.zeros((12, 1)), Q=[1.0], R=[1.0])
    initial = np.zeros(1), np.full((12, 1), 0.3)  # runs into the wall at the fourth step
    with pytest.raises(ArgumentError, match="roll-out failed"):
        optimize(Cliff(), cost, initial=initial, shooting="single")
    found = receding_horizon(Cliff(), cost, initial=initial, window=8, keep=2)
    assert found.success
    assert found.x.shape == (13, 1)
    assert [stage.name for stage in found.stages][:2] == ["steps 0 to 8", "steps 0 to 4"]
    assert found.stages[0].status == "ProjectionError"
    assert not found.stages[0].accepted
    over = receding_horizon(Cliff(end=6), cost, initial=initial, window=4, keep=2)
    assert over.status is StartStatus.GAVE_UP
    assert over.value == 6
    assert over.x.shape == (7, 1)
    assert "Not even step 6" in over.message
    assert "wall" in over.message


def test_limits_hold_in_every_window():
    system, cost, rest = balancing(60)
    how = {"initial": rest, "window": 30, "keep": 10}
    free = receding_horizon(system, cost, **how)
    most = 0.6 * np.abs(free.u).max()
    found = receding_horizon(system, cost, limits=[Bound("push", -most, most)], **how)
    assert found.success
    assert is_trajectory(system, found.x, found.u)
    assert np.abs(found.u).max() <= most * (1.0 + 1e-9)
    # A system that has no windows of its own knows its quantities and times in them all the same.
    part, whole = WindowSystem(system, 20, 50), system.window(20, 50)
    assert part.quantities == whole.quantities
    assert part.time(3) == whole.time(3) == system.t[23]
    assert part.instant(system.t[25], "t") == 5
    x, u = found.x[20:51], found.u[20:50]
    k = np.arange(30)
    at = Samples(k, x[:-1], u, x[1:])
    for kind in part.quantities:
        mine, theirs = part.quantity(kind), whole.quantity(kind)
        assert mine.names == theirs.names
        if kind == "input rate":  # of the step before too, which only a run remembers
            continue
        np.testing.assert_array_equal(mine.values(at), theirs.values(at))
        np.testing.assert_array_equal(mine.jacobian(at), theirs.jacobian(at))


def test_ctrl_c_keeps_the_windows_that_are_done():
    system, cost, rest = balancing(60)

    def window(start, stop):
        if start == 20:
            raise KeyboardInterrupt
        return cost.window(start, stop, N=60, nu=1)

    found = receding_horizon(system, cost, initial=rest, window=20, keep=10, cost_of=window)
    assert found.status is StartStatus.INTERRUPTED
    assert found.value == 20
    assert is_trajectory(system, found.x, found.u)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"window": 0}, "window"),
        ({"keep": 9}, "keep: got 9.*at most.*8"),
        ({"cost": 3}, "cost: got int"),
        ({"initial": (np.zeros(3), np.zeros((12, 1)))}, "initial x"),
        ({"initial": np.zeros(1)}, "initial"),
        ({"horizon": (0, 1)}, "horizon"),
        ({"system": None}, "system"),
    ],
)
def test_receding_horizon_names_what_is_wrong(changed, match):
    cost = QuadraticCost(np.zeros((13, 1)), np.zeros((12, 1)), Q=[1.0], R=[1.0])
    given = {"system": Cliff(), "cost": cost, "initial": (np.zeros(1), np.zeros((12, 1))), "window": 8}
    with pytest.raises(ArgumentError, match=match):
        receding_horizon(**{**given, **changed})


# ---- Coarse to fine ---------------------------------------------------------------------------------


def swing_up(t):
    return steer(cart(), t, {"pole0": np.pi})


@pytest.mark.parametrize("transfer", [None, warm_start])
def test_a_swing_up_is_found_with_long_steps(transfer):
    t = 0.01 * np.arange(301)
    system, cost = swing_up(t)
    rest = at_rest(system)
    found = coarse_to_fine(swing_up, t, initial=rest, factors=(4, 2, 1), transfer=transfer)
    assert found.success
    assert found.result.status is Status.CONVERGED
    assert [stage.name for stage in found.stages] == ["75 steps", "150 steps", "300 steps"]
    assert found.x.shape == (301, 4)
    # As many iterations as are needed at the end do not lead there from rest.
    few = found.stages[-1].iterations
    assert few <= 5
    alone = optimize(system, cost, initial=rest, max_iterations=4 * few)
    assert alone.status is Status.ITERATION_LIMIT
    assert found.cost < 0.9 * alone.cost


@pytest.mark.slow
def test_a_long_swing_up_is_found_with_long_steps():
    t = 0.02 * np.arange(401)
    system, cost = swing_up(t)
    rest = at_rest(system)
    alone = optimize(system, cost, initial=rest, max_iterations=100)
    assert alone.status is Status.ITERATION_LIMIT
    found = coarse_to_fine(swing_up, t, initial=rest, max_iterations=100, transfer=warm_start)
    assert found.result.status is Status.CONVERGED
    assert found.cost < 0.7 * alone.cost


def test_resampling_keeps_what_it_can(rng):
    t = np.array([0.0, 0.1, 0.3, 0.4])
    x, u = rng.random((4, 2)), rng.random((3, 1))
    same = resample(x, u, t, t)
    np.testing.assert_array_equal(same[0], x)
    np.testing.assert_array_equal(same[1], u)
    fine = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.35, 0.4, 0.5])
    x_fine, u_fine = resample(x, u, t, fine)
    np.testing.assert_allclose(x_fine[[0, 2, 4, 6]], x, rtol=1e-15)
    np.testing.assert_allclose(x_fine[3], 0.5 * (x[1] + x[2]))
    np.testing.assert_array_equal(x_fine[-1], x[-1])
    assert u_fine.shape == (7, 1)
    with pytest.raises(ArgumentError, match=r"x: got shape"):
        resample(x[:-1], u, t, fine)


def test_a_stage_that_cannot_be_begun_is_left_out():
    t = 0.02 * np.arange(13)

    def build(times):
        n = len(times) - 1
        system = Cliff(end=0 if n in bad else 99)
        system.N = n
        return system, QuadraticCost(np.zeros((n + 1, 1)), np.zeros((n, 1)), Q=[1.0], R=[1.0])

    initial = np.array([0.5]), np.zeros((12, 1))
    bad = {6}
    found = coarse_to_fine(build, t, initial=initial, factors=(4, 2, 1))
    assert found.success
    assert [stage.status for stage in found.stages] == ["CONVERGED", "ProjectionError", "CONVERGED"]
    bad = {12}
    found = coarse_to_fine(build, t, initial=initial, factors=(4, 2, 1))
    assert found.status is StartStatus.GAVE_UP
    assert found.value == 2
    assert found.x.shape == (7, 1)
    bad = {3, 6, 12}
    with pytest.raises(ArgumentError, match="wall"):
        coarse_to_fine(build, t, initial=initial, factors=(4, 2, 1))
    bad = set()
    stopped = coarse_to_fine(build, t, initial=initial, factors=(4, 2, 1), callback=lambda stage: True)
    assert stopped.status is StartStatus.STOPPED_BY_CALLBACK
    assert stopped.value == 4
    whole = coarse_to_fine(build, t, initial=initial, factors=(4, 2, 1), resume=stopped)
    assert whole.success
    assert [stage.name for stage in whole.stages] == ["3 steps", "6 steps", "12 steps"]
    with pytest.raises(ArgumentError, match="resume: got 3 steps, expected the 5"):
        coarse_to_fine(
            build, np.arange(18.0), initial=(initial[0], np.zeros((17, 1))), factors=(4, 2, 1), resume=stopped
        )


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"factors": (2, 4, 1)}, "factors.*decrease"),
        ({"factors": (4, 2)}, "factors.*decrease"),
        ({"factors": (400, 1)}, "factors.*at most 20"),
        ({"factors": ()}, "factors"),
        ({"t": [0.0, 0.0]}, "t: times must increase"),
        ({"initial": (np.zeros(4), np.zeros((3, 1)))}, "initial u"),
        ({"build": lambda t: 3}, "build: got int"),
        ({"build": lambda t: (3, 4)}, "build: got int of None steps"),
        ({"horizon": (0, 1)}, "horizon"),
    ],
)
def test_coarse_to_fine_names_what_is_wrong(changed, match):
    given = {"build": swing_up, "t": 0.02 * np.arange(21), "initial": (np.zeros(4), np.zeros((20, 1)))}
    with pytest.raises(ArgumentError, match=match):
        coarse_to_fine(**{**given, **changed})


# ---- Warm starts ------------------------------------------------------------------------------------


def hanging():
    """Return angles of an arm of two links with the length of its string."""
    m = puppet_arm(2)
    hook = m.positions(m.configuration(), ["hook1"])[0]
    q = m.configuration({"joint0": 0.6, "joint1": 0.5})
    return {"joint0": 0.6, "joint1": 0.5, "string1": float(np.linalg.norm(m.positions(q, ["end1"])[0] - hook))}


HANGING = hanging()


@pytest.fixture(scope="module")
def short():
    """A swing-up in three seconds."""
    system, cost = swing_up(0.02 * np.arange(151))
    return system, optimize(system, cost, initial=at_rest(system))


def test_a_motion_is_its_own_warm_start(short):
    system, result = short
    x, u = warm_start(result, system, system)
    np.testing.assert_allclose(x, result.x, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(u, result.u)


def test_a_short_swing_up_starts_a_long_one(short):
    system, cost = swing_up(0.02 * np.arange(401))
    alone = optimize(system, cost, initial=at_rest(system), max_iterations=30)
    assert alone.status is Status.ITERATION_LIMIT
    x, u = warm_start(short[1], short[0], system)
    np.testing.assert_array_equal(x[300, 2:], 0.0)  # held, at rest
    np.testing.assert_allclose(x[300, :2], short[1].x[-1, :2], rtol=1e-14)
    best = optimize(system, cost, initial=(x, u), max_iterations=30)
    assert best.status is Status.CONVERGED
    assert best.cost < 0.8 * alone.cost


def test_a_swing_up_starts_that_of_a_heavier_bob_with_longer_steps(short):
    heavy = cart().with_parameters({"bob0.mass": 1.2})
    system, cost = steer(heavy, 0.03 * np.arange(101), {"pole0": np.pi})
    alone = optimize(system, cost, initial=at_rest(system))
    x, u = warm_start(short[1], short[0], system)
    best = optimize(system, cost, initial=(x, u))
    assert best.status is Status.CONVERGED
    assert best.cost == pytest.approx(alone.cost, rel=1e-6)
    assert best.iterations < 0.6 * alone.iterations


def test_motors_start_strings():
    """An arm moved by motors, whose strings were not there, starts one that hangs on them."""
    t = 0.02 * np.arange(61)
    goal = {"joint0": 0.6 + 0.3 * np.sin(3 * t), "joint1": 0.5 + 0.3 * np.sin(4 * t)}
    strung = puppet_arm(2)
    place = {name: q for name, q in HANGING.items() if name in strung.dynamic}
    tree = world()
    tree.rx("joint0", bodies=[rod(0.4, 0.5)]).tz(-0.4).rx("joint1", bodies=[rod(0.4, 0.5)]).tz(-0.4)
    driven = Mechanism(tree, [Gravity(), Damping(0.05), JointForce("joint0", "a"), JointForce("joint1", "b")])
    motors, cost = steer(driven, t, goal, q0=place, Q=10.0, final=10.0)
    found = optimize(motors, cost, initial=at_rest(motors, place))
    assert found.success

    times = 0.01 * np.arange(121)
    fine = {name: np.interp(times, t, angles) for name, angles in goal.items()}
    system, cost = steer(strung, times, fine, q0=HANGING, Q=10.0, final=10.0)
    full = MidpointSystem(system.integrator, times, multipliers=True)
    start = system.integrator.start(strung.configuration(HANGING))
    x, u = warm_start(found, motors, full, start=start)
    np.testing.assert_array_equal(x[0, : strung.nx], start.x)
    q = x[:, : strung.nq]
    assert np.abs(strung.constraint_values(q)).max() < 1e-10
    # The strings took all of the change, and keep the constraints in their velocities too.
    np.testing.assert_allclose(q[::2, :2], found.x[:, :2], atol=1e-3)
    np.testing.assert_array_equal(u[:, -1], q[1:, 2])
    np.testing.assert_allclose(x[1:, strung.nx - 1], np.diff(q[:, 2]) / 0.01, rtol=1e-9)
    best = optimize(system, cost, initial=(x[:, : strung.nx], u), max_iterations=60)
    assert best.success
    # Without a start that is given, the string is as long as the arm has it.
    x, _ = warm_start(found, motors, system)
    np.testing.assert_allclose(x[0, : strung.nq], start.q, atol=1e-6)


def test_springs_start_strings():
    """A motion on a soft spring, with lengths that a string in its place could not have: they follow."""
    tree = world()
    place = tree
    for k in range(2):
        place = place.rx(f"joint{k}", bodies=[rod(0.4, 0.5)]).tz(-0.4, name=f"end{k}")
    tree.pose(translation=(0.0, *_HOOKS[1]), name="hook1")
    tree.tx("string1", kinematic=True)
    spring = LinearSpring("end1", "hook1", stiffness=1.0, length="string1")
    soft = MidpointSystem(MidpointVI(Mechanism(tree, [Gravity(), spring])), 0.02 * np.arange(41))
    x0, u = at_rest(soft, {**HANGING, "string1": 0.2})
    run = rolled_out(soft, x0, u)
    assert run.complete
    m = puppet_arm(2)
    strung = MidpointSystem(MidpointVI(m), soft.t)
    x, u = warm_start((run.x, run.u), soft, strung)
    assert np.abs(m.constraint_values(x[:, : m.nq])).max() < 1e-10
    assert np.abs(x[:, :2] - run.x[:, :2]).max() < 0.7
    np.testing.assert_array_equal(u[:, -1], x[1:, 2])


def test_prescribed_variables_begin_as_fast_as_they_did():
    m = Mechanism([tx("x", mass=1.0), ty("y", kinematic=True)], [JointForce("x", "push")])
    slow, fine = (MidpointSystem(MidpointVI(m), np.linspace(0.0, 0.4, n)) for n in (5, 9))
    run = rolled_out(slow, np.array([0.0, 0.0, 0.0, 0.3]), np.column_stack([np.zeros(4), 0.03 * np.arange(1, 5)]))
    x, u = warm_start((run.x, run.u), slow, fine)
    np.testing.assert_allclose(x[:, 3], 0.3, rtol=1e-9)
    np.testing.assert_allclose(u[:, 1], 0.015 * np.arange(1, 9), rtol=1e-9)


def test_names_may_have_changed(short):
    system, result = short
    place = world().ty("trolley", mass=2.0).rx("rod").tz(-0.8, name="bob", mass=0.4)
    other = Mechanism(place, [Gravity(), JointForce("trolley", "pull")])
    to = MidpointSystem(MidpointVI(other), system.t)
    with pytest.raises(ArgumentError, match=r"no variable of trolley, rod is among cart, pole0"):
        warm_start(result, system, to)
    x, u = warm_start(result, system, to, rename={"cart": "trolley", "pole0": "rod", "push": "pull"})
    np.testing.assert_allclose(x, result.x, rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(u, result.u)


def test_multipliers_are_impulses():
    system, _ = steer(puppet_arm(2), 0.02 * np.arange(21), {}, q0=HANGING)
    coarse = MidpointSystem(system.integrator, system.t, multipliers=True)
    x0, u = at_rest(coarse, HANGING)
    run = rolled_out(coarse, x0, u)
    fine = MidpointSystem(system.integrator, 0.005 * np.arange(81), multipliers=True)
    x, _ = warm_start((run.x, run.u), coarse, fine)
    lam = run.x[:, -1]
    np.testing.assert_allclose(x[::4, -1], 0.25 * lam, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda s, r: (3, s, s), "found: got int"),
        (lambda s, r: (r, CartPendulum(), s), "from_system: got CartPendulum"),
        (lambda s, r: (r, s, None), "to_system: got NoneType"),
        (lambda s, r: ((r.x[1:], r.u), s, s), "x: got shape"),
    ],
)
def test_warm_starts_name_what_is_wrong(short, change, match):
    with pytest.raises(ArgumentError, match=match):
        warm_start(*change(*short))
    with pytest.raises(ArgumentError, match=r"rename: unknown name 'carts'.*cart"):
        warm_start(short[1], short[0], short[0], rename={"carts": "cart"})


# ---- Dynamic embedding ------------------------------------------------------------------------------


def straight(given: Given):
    """Return the line from where a problem starts to what it wants in the end."""
    x0 = np.atleast_2d(given.x)[0]
    share = np.linspace(0.0, 1.0, given.system.N + 1)[:, None]
    return (1.0 - share) * x0 + share * given.cost.x_wanted[-1], 0.0 * given.u


def test_embedding_finds_a_swing_up_that_is_not_found_without():
    given = BY_NAME["acrobot, swing-up, R 0.001, final 1e+06, random 2"].build()
    system, cost = given.system, given.cost
    seen = []
    found = embed(system, cost, initial=straight(given), callback=seen.append)
    assert found.success
    assert found.result.status is Status.CONVERGED
    assert is_trajectory(system, found.x, found.u)
    assert found.x.shape == (system.N + 1, system.nx)
    assert found.u.shape == (system.N, system.nu)
    assert tuple(seen) == found.stages
    assert seen[-1].name == "without help"
    assert seen[-1].value == np.inf
    efforts = [float(stage.note.rsplit(" ", 1)[1]) for stage in seen[:-1] if stage.accepted]
    assert all(a > b for a, b in pairwise(efforts))
    assert efforts[-1] <= 1e-3
    # "auto" would begin again there, with dear inputs.
    alone = optimize(
        system, cost, initial=(given.x, given.u), max_iterations=found.iterations, method="newton"
    )  # fmt: skip
    assert not alone.success
    assert alone.cost > 10.0 * found.cost


@pytest.mark.slow
def test_embedding_finds_a_motion_of_strings():
    """Fast motions of an arm on a string: cheap help leads where the string has no grip, and must be left again."""
    m = puppet_arm(2)

    def wanted(t):
        return {"joint0": 0.6 + 1.2 * np.sin(6.0 * t), "joint1": 0.5 + 1.2 * np.sin(9.0 * t)}

    how = {"N": 100, "dt": 0.02, "Q": 10.0, "final": 100.0, "R": 1e-2, "kind": "rest"}
    given = posed(m, HANGING, wanted, **how)
    system, cost = given.system, given.cost
    alone = optimize(system, cost, initial=(given.x, given.u), max_iterations=100)
    assert alone.status is Status.ITERATION_LIMIT
    found = embed(system, cost, initial=(cost.x_wanted, given.u), max_iterations=100)
    assert found.success
    assert is_trajectory(system, found.x, found.u)
    assert np.abs(m.constraint_values(found.x[:, : m.nq])).max() < 1e-9
    assert found.cost < 0.5 * alone.cost


def test_any_help_will_do():
    """A motor between cart and pole instead of forces on each; in its own scale and price."""
    system, cost = swing_up(0.02 * np.arange(101))
    x0, u = at_rest(system)
    line = np.linspace(0.0, 1.0, 101)[:, None] * cost.x_wanted[-1]
    for help_ in (["pole0"], [JointForce({"cart": 1.0, "pole0": -1.0}, "rope")]):
        found = embed(system, cost, initial=(line, u), help=help_, scale=2.0, price=0.1, tolerance=1e-2)
        assert found.success
        assert found.u.shape == u.shape
        assert is_trajectory(system, found.x, found.u)
    assert embed(system, cost, initial=(x0, u), help=["pole0"]).success


def test_limits_hold_with_help_and_without():
    system, cost = swing_up(0.02 * np.arange(151))
    line = np.linspace(0.0, 1.0, 151)[:, None] * cost.x_wanted[-1]
    limits = [Bound("push", -12.0, 12.0)]
    stages = []
    found = embed(system, cost, initial=(line, at_rest(system)[1]), limits=limits, callback=stages.append)
    assert found.success
    assert found.result.success
    assert np.abs(found.u).max() <= 12.0 * (1.0 + 1e-9)
    free = embed(system, cost, initial=(line, at_rest(system)[1]))
    assert np.abs(free.u).max() > 12.0


def test_embedding_keeps_what_it_has():
    system, cost = swing_up(0.02 * np.arange(101))
    _, u = at_rest(system)
    line = np.linspace(0.0, 1.0, 101)[:, None] * cost.x_wanted[-1]
    stopped = embed(system, cost, initial=(line, u), callback=lambda stage: stage.stage == 2)
    assert stopped.status is StartStatus.STOPPED_BY_CALLBACK
    assert stopped.u.shape == (100, 3)
    assert stopped.value == stopped.stages[-1].value
    whole = embed(system, cost, initial=(line, u), resume=stopped)
    assert whole.success
    assert whole.stages[:2] == stopped.stages
    assert whole.u.shape == (100, 1)
    with pytest.raises(ArgumentError, match="resume: got inputs of shape"):
        embed(system, cost, initial=(line, u), resume=whole)
    calls = []

    def interrupt(stage):
        calls.append(stage)
        if len(calls) == 2:
            raise KeyboardInterrupt

    assert embed(system, cost, initial=(line, u), callback=interrupt).status is StartStatus.INTERRUPTED
    assert embed(system, cost, initial=(line, u), max_stages=1).status is StartStatus.STAGE_LIMIT


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"system": CartPendulum()}, "system: got CartPendulum"),
        ({"cost": None}, "cost: got NoneType"),
        ({"help": ["pole"]}, "help: unknown dynamic variable 'pole'.*pole0"),
        ({"help": "pole0"}, "help: got 'pole0', expected a list"),
        ({"help": []}, "help: got 0 elements without new inputs"),
        ({"help": [JointForce("pole0", "push")]}, "help: got 1 elements without new inputs"),
        ({"help": [Distance("bob0", "world", 1.0)]}, "help: got elements that are constraints"),
        ({"scale": 0.0}, "scale"),
        ({"scale": [1.0, 2.0, 3.0]}, "scale"),
        ({"price": -1.0}, "price"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"initial": (np.zeros(4), np.zeros((3, 1)))}, "initial u"),
        ({"horizon": None}, "horizon"),
    ],
)
def test_embedding_names_what_is_wrong(changed, match):
    system, cost = swing_up(0.02 * np.arange(11))
    given = {"system": system, "cost": cost, "initial": at_rest(system)}
    with pytest.raises(ArgumentError, match=match):
        embed(**{**given, **changed})


def test_what_costs_nothing_has_no_price_to_compare_with():
    system, cost = steer(arm("xx"), 0.02 * np.arange(11), {})
    with pytest.raises(ArgumentError, match=r"price.*costs nothing"):
        embed(system, cost, initial=at_rest(system))


@pytest.mark.parametrize(
    "R", [[0.1, 0.2], [[0.2, 0.1], [0.1, 0.3]], np.full((6, 2), 0.1), np.full((6, 2, 2), 0.1) + np.eye(2)]
)
def test_the_price_of_help_is_a_cost(rng, R):
    own = QuadraticCost(rng.random((7, 4)), rng.random((6, 2)), Q=np.ones(4), R=R)
    cost = HelpedCost(own, np.array([1, 3]), np.array([2.0, 3.0]))
    x, u = rng.random((7, 4)), rng.random((6, 4))
    system = LinearSystem(np.eye(4), np.eye(4), N=6)
    assert check_derivatives(system, x, u, cost=cost).ok
    without = own.value(x, u[:, [0, 2]])
    spent = np.sum(u[:, 1] ** 2) + 1.5 * np.sum(u[:, 3] ** 2)
    assert cost.value(x, u) == pytest.approx(without + spent)
    window = HelpedCost(Banked(), np.array([0]), np.array([2.0]))
    assert check_derivatives(LinearSystem(np.eye(1), np.ones((1, 2)), N=6), x[:, :1], u[:, :2], cost=window).ok
    with pytest.raises(ArgumentError, match="price"):
        HelpedCost(own, np.array([1]), np.array([0.0]))


# ---- What is told -----------------------------------------------------------------------------------


def test_the_table_shows_every_stage(capsys):
    answers = []
    table = StageTable(then=lambda stage: answers.append(stage.stage))
    found = continuation(Stubborn(0.6), [0.0, 1.0], name="load", callback=table)
    lines = capsys.readouterr().out.splitlines()
    assert "iterations" in lines[0]
    assert sum("load = " in line for line in lines) == len(found.stages) == len(answers)
    assert any("ArgumentError" in line for line in lines)
    assert any("too far" in line for line in lines)
    assert "COMPLETED" in str(found)
    assert f"{len(found.stages)} stages" in str(found)
    assert found.initial[0] is found.x


def test_a_start_off_the_constraints_is_named_as_such() -> None:
    """Not as steps that are too coarse: no shorter ones would help."""
    m = Mechanism(
        [rz("a"), [tx(1.0, mass=1.0, name="A")], rz("b"), [tx(1.0, mass=1.0, name="B")]],
        [Distance("A", "B", 0.5), JointForce("a", "turn")],
    )
    system = MidpointSystem(MidpointVI(m), np.linspace(0.0, 1.0, 51))
    cost = QuadraticCost(np.zeros((51, 4)), np.zeros((50, 1)), Q=np.ones(4), R=[1.0])
    with pytest.raises(ProjectionError, match=r"'distance\(A, B\)' is off by 0.669. Use project_configuration"):
        optimize(system, cost, initial=([0.0, 1.0, 0.0, 0.0], np.zeros((50, 1))))
    # Also where the first step would lead onto them: the motion would begin with a leap.
    near = project_configuration(m, [0.0, 0.5]).q + np.array([0.0, 1e-3])
    with pytest.raises(ProjectionError, match="first state, which is fixed, is no state of the mechanism"):
        optimize(system, cost, initial=([*near, 0.0, 0.0], np.zeros((50, 1))))
    assert optimize(system, cost, initial=([*near, 0.0, 0.0], np.zeros((50, 1))), free_start=True).success


class OwnSystem(FunctionSystem):
    """A system with answers of its own, which a window of it has too."""

    asked: tuple[str, ...] = ()

    def start_directions(self, x, free):
        del x, free
        return np.array([[1.0], [1.0]])

    def moved_start(self, x, dx):
        return np.round(x + dx, 6)

    def linearize(self, x, u, out=None):
        found = super().linearize(x, u, out)
        object.__setattr__(self, "asked", (*self.asked, "linearize"))
        return found

    def check_start(self, x):
        if x[0] > 5.0:
            raise ProjectionError("too far")

    def hello(self):
        return "hello"


def test_a_window_has_what_its_system_has_of_its_own(rng):
    system = OwnSystem(
        lambda x, u, k: np.array([x[0] + 0.1 * x[1], x[1] + 0.1 * u[0] + 0.01 * k]), nx=2, nu=1, N=12,
        derivatives="complex-step", curvature="differences",
    )  # fmt: skip
    part = WindowSystem(system, 3, 8)
    x, u = rng.normal(size=(6, 2)), rng.normal(size=(5, 1))
    np.testing.assert_array_equal(part.start_directions(x[0], None), [[1.0], [1.0]])
    assert part.moved_start(np.zeros(2), np.array([1.23456789, 0.0]))[0] == 1.234568
    assert part.hello() == "hello"
    with pytest.raises(ProjectionError, match="too far"):
        part.check_start(np.array([6.0, 0.0]))
    A, B = part.linearize(x, u)
    assert system.asked == ("linearize",)
    for k in range(5):
        a, b = system.derivatives(x[k], u[k], 3 + k)
        np.testing.assert_allclose(A[k], a)
        np.testing.assert_allclose(B[k], b)
    z = rng.normal(size=(5, 2))
    expected = [system.curvature(x[k], u[k], 3 + k, z[k]) for k in range(5)]
    np.testing.assert_allclose(part.linearize(x, u).curvature(z), expected, atol=1e-6)
    # A search by windows starts where the system says that it may.
    wanted = np.tile([1.0, 0.0], (13, 1))
    cost = QuadraticCost(wanted, np.zeros((12, 1)), Q=[1.0, 0.1], R=[0.1])
    start = np.zeros(2), np.zeros((12, 1))
    found = receding_horizon(system, cost, initial=start, window=6, keep=3, free_start=True)
    assert found.success
    assert found.x[0, 0] == found.x[0, 1] != 0.0


def test_whatever_a_system_is_asked_a_window_answers():
    """By the other system where it is of states and inputs: nothing is forgotten."""
    names = {name for name in vars(System) if not name.startswith("_")}
    window = set(vars(WindowSystem))
    of_steps = set(vars(DiscreteSystem)) | {name for name in names if f"own_{name}" in window}
    assert {"difference", "plus", "charts", "check_start", "start_directions", "beside", "space"} <= window
    assert names - window - of_steps == {"has_curvature"}  # which is set
