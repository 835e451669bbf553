"""A minimum over motions that no shorter step of time would make: `optimize` says so, as `simulate` would."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from leastaction.costs import OrientationCost
from leastaction.errors import CoarseStepWarning, EnergyBalanceWarning, ResidualWarning
from leastaction.mechanics import Damping, Gravity, JointForce, JointSpring, Mechanism, MidpointVI, ball, rx, tx, tz
from leastaction.optimal import Optimizer, Parameter, QuadraticCost, Status, optimize
from leastaction.systems import MidpointSystem

Problem = tuple[MidpointSystem, QuadraticCost, tuple[np.ndarray, np.ndarray]]


def thrown_up(N: int) -> Problem:
    """An arm of two links is thrown up by cheap motors in 0.6 s, of N steps."""
    m = Mechanism(
        [rx("a"), [tz(-0.5, mass=1.0), tz(-0.5), [rx("b"), [tz(-0.5, mass=1.0)]]]],
        [Gravity(), JointForce("a", input="u"), JointForce("b", input="w")],
    )
    system = MidpointSystem(MidpointVI(m, threads=1), np.linspace(0.0, 0.6, N + 1))
    wanted = np.tile([3.0, -2.5, 0.0, 0.0], (N + 1, 1))
    k = 12.0 / N
    cost = QuadraticCost(wanted, np.zeros((N, 2)), Q=k * np.array([50.0, 50.0, 0.0, 0.0]), R=2 * [k * 1e-4])
    return system, cost, (np.zeros(4), np.zeros((N, 2)))


def test_a_minimum_on_coarse_steps_says_so() -> None:
    system, cost, initial = thrown_up(6)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = optimize(system, cost, initial=initial)
        once = len(caught)
        again = Optimizer(system, cost).run(initial)
    assert result.status is Status.CONVERGED
    assert {each.category for each in caught[:once]} <= {CoarseStepWarning, EnergyBalanceWarning}
    assert once > 0
    assert len(caught) == once  # who runs it again and again reads the message
    assert all(each.filename == __file__ for each in caught)
    # The message says what is warned of, and so does a simulation of it.
    assert all(str(each.message) in result.message for each in caught[:once])
    assert again.message == result.message
    vi = system.integrator
    with pytest.warns((CoarseStepWarning, EnergyBalanceWarning)):
        run = vi.simulate(vi.start(result.x[0, :2]), system.t, inputs=result.u)
    assert run.balance is not None
    assert run.balance.complaint == vi.balance(result.trajectory).complaint


def test_a_ball_that_turns_far_within_a_step_is_doubted() -> None:
    """A body at rest is to be turned along a curve past half a turn: it turns back by 156 degrees in one step."""
    t = np.linspace(0.0, 2.0, 81)
    body = [ball("b", mass=1.0, inertia=(0.1, 0.1, 0.1), name="body")]
    m = Mechanism(body, [JointForce(f"b.w{axis}", input=axis) for axis in "xyz"])
    vi = MidpointVI(m, threads=1)
    system, x0 = MidpointSystem(vi, t), vi.start(m.configuration()).x
    cost = QuadraticCost(np.tile(x0, (81, 1)), np.zeros((80, 3)), Q=np.zeros(6), R=[1e-3] * 3, space=system)
    wanted = Rotation.from_rotvec(np.outer(0.95 * np.pi * t, [0.0, 0.0, 1.0])).as_matrix()
    missing = OrientationCost(cost, system, {"body": wanted}, {"body": 100.0})
    with pytest.warns(CoarseStepWarning, match=r"'b\.wz' moved by 2\.7.* more than a right angle"):
        result = optimize(system, missing, initial=(x0, np.zeros((80, 3))))
    assert "more than a right angle" in result.message
    # A start that turns along has nothing to be doubted: warnings are errors here.
    begun = vi.start(m.configuration(), {"b.wz": 0.95 * np.pi}).x
    assert optimize(system, missing, initial=(begun, np.zeros((80, 3)))).status is Status.CONVERGED


def test_steps_that_are_short_enough_are_not_doubted() -> None:
    """Warnings are errors here."""
    system, cost, initial = thrown_up(240)
    result = optimize(system, cost, initial=initial)
    assert result.status is Status.CONVERGED
    assert "But" not in result.message


def test_a_run_that_found_nothing_yet_is_not_doubted() -> None:
    system, cost, initial = thrown_up(6)
    assert optimize(system, cost, initial=initial, max_iterations=2).status is Status.ITERATION_LIMIT


def test_a_fit_that_misses_what_its_weights_say_is_told() -> None:
    """Damping that the model does not have, where every place is known to 2 mm."""
    t = np.linspace(0.0, 4.0, 161)
    spring = JointSpring("x", 9.0, name="spring")
    true = Mechanism([tx("x", mass=1.0)], [spring, Damping(0.5), JointForce("x", input="push")])
    vi = MidpointVI(true)
    run = vi.simulate(vi.start([0.2]), t)
    for m, warns in ((true, False), (Mechanism([tx("x", mass=1.0)], [spring, JointForce("x", input="push")]), True)):
        system = MidpointSystem(MidpointVI(m), t)
        measured = run.x + np.r_[0.002, 0.0] * np.random.default_rng(0).normal(size=run.x.shape)
        cost = QuadraticCost(measured, np.zeros((160, 1)), Q=[1.0 / 0.002**2, 0.0], R=[1e9])
        asked = {"initial": (run.x[0], np.zeros((160, 1))), "unknowns": [Parameter("spring.stiffness", guess=8.0)]}
        if warns:
            with pytest.warns(ResidualWarning, match="times what the weights Q say"):
                result = optimize(system, cost, **asked)
            assert "times what the weights Q say" in result.message
        else:
            assert "weights" not in optimize(system, cost, **asked).message
