"""What a result knows by name: times, states, inputs, multipliers, and the trajectory of the mechanism."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import leastaction as la
from leastaction import rx, ry, tx, ty
from leastaction.errors import ArgumentError
from leastaction.optimal import LinearSystem
from leastaction.optimal.continuous import FunctionContinuousSystem
from leastaction.optimal.discrete.system import WindowSystem


def hanging() -> la.Mechanism:
    """A bob on a string below a hook that is moved, with a spring and an input."""
    return la.Mechanism(
        [tx("hook", name="hook", kinematic=True), ty("side"), [la.tz("bob-z", name="bob", mass=1.0)]],
        [la.Gravity(), la.Distance("hook", "bob", 1.0, name="string"), la.JointForce("side", "push")],
    )


def system(*, multipliers: bool = False) -> la.MidpointSystem:
    return la.MidpointSystem(la.MidpointVI(hanging()), np.linspace(1.0, 1.5, 11), multipliers=multipliers)


def optimised(problem: la.MidpointSystem, **options: object) -> la.OptimizationResult:
    m = problem.mechanism
    q = m.configuration({"side": 0.6, "bob-z": -0.8})
    x = np.zeros(problem.nx)
    x[: m.nx] = problem.integrator.start(q, t=1.0).x
    cost = la.QuadraticCost(
        np.zeros((problem.N + 1, problem.nx)), np.zeros((problem.N, problem.nu)), Q=np.ones(problem.nx),
        R=np.ones(problem.nu),
    )  # fmt: skip
    return la.optimize(problem, cost, initial=(x, np.zeros((problem.N, problem.nu))), max_iterations=3, **options)


@pytest.mark.parametrize("multipliers", [False, True])
def test_columns_are_found_by_name(multipliers):
    problem = system(multipliers=multipliers)
    result = optimised(problem)
    assert result.state_names[:6] == ("side", "bob-z", "hook", "p_side", "p_bob-z", "v_hook")
    assert result.state_names[6:] == (("lam_string",) if multipliers else ())
    assert result.input_names == ("push", "hook")
    np.testing.assert_array_equal(result.t, problem.t)
    for i, name in enumerate(result.state_names):
        np.testing.assert_array_equal(result[name], result.x[:, i])
    np.testing.assert_array_equal(result["push"], result.u[:, 0])
    trajectory = result.trajectory
    assert isinstance(trajectory, la.Trajectory)
    for name in ("side", "bob-z", "hook", "push", "string"):
        np.testing.assert_array_equal(result[name], trajectory[name])
    # The string pulls: the weight of the bob, about.
    assert trajectory.tensions()["string"][1:].min() > 1.0
    simulated = problem.integrator.simulate(trajectory.state(0), problem.t, inputs=result.u[:, :1], rho=result.u[:, 1:])
    np.testing.assert_allclose(trajectory.lam, simulated.lam, atol=1e-9)
    with pytest.raises(ArgumentError, match=r"unknown name 'sid'; did you mean 'side'"):
        result["sid"]
    assert result.state_units[:6] == ("m", "m", "m", "kg m/s", "kg m/s", "m/s")
    assert result.input_units == ("N", "m")
    again = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(again.trajectory.lam, trajectory.lam)


def test_continuous_time():
    m = la.Mechanism(
        [rx("elbow"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("elbow", "motor")]
    )
    cost = la.ContinuousQuadraticCost([0.0, 0.0], [0.0], Q=[1.0, 1.0], R=[1.0])
    result = la.optimize(la.MechanismSystem(m), cost, initial=([0.3, 0.0], [0.0]), horizon=(1.0, 1.5), max_iterations=2)
    assert result.state_names == ("elbow", "v_elbow")
    assert (result.state_units, result.input_units) == (("rad", "rad/s"), ("N m",))
    made = result.trajectory
    assert isinstance(made, la.ContinuousTrajectory)
    np.testing.assert_array_equal(result["elbow"], made["elbow"])
    np.testing.assert_array_equal(result["motor"], made["motor"])
    np.testing.assert_array_equal(made(1.23), result.dense.x(1.23))
    np.testing.assert_allclose(made.input([1.1, 1.2]), result.dense.u([1.1, 1.2]))
    # a = u - g sin(elbow) of a bob of 1 kg at 1 m
    np.testing.assert_allclose(made.acceleration("elbow"), made["motor"] - 9.81 * np.sin(made["elbow"]), atol=1e-9)
    pickle.loads(pickle.dumps(made))


def test_through_windows_unknowns_and_callbacks():
    problem = system()
    assert isinstance(WindowSystem(problem, 2, 6).told(), la.MidpointSystem)
    seen = []
    x0 = problem.integrator.start(problem.mechanism.configuration({"side": 0.6, "bob-z": -0.8}), t=1.0).x
    window = WindowSystem(problem, 2, 6)
    cost = la.QuadraticCost(np.zeros((5, 6)), np.zeros((4, 2)), Q=np.ones(6), R=np.ones(2))
    part = la.optimize(window, cost, initial=(x0, np.zeros((4, 2))), max_iterations=1)
    np.testing.assert_array_equal(part.trajectory.t, problem.t[2:7])
    np.testing.assert_array_equal(part.t, problem.t[2:7])
    assert part.state_units[0] == "m"
    found = optimised(
        problem,
        unknowns=[la.FinalTime(guess=1.6), la.Parameter("bob.mass", guess=1.1)],
        callback=lambda record: seen.append(record.snapshot()) and None,
    )
    for each in (found, seen[1]):
        assert each.state_names == problem.state_names
        assert each.t[-1] == each.unknowns["final time"] == each.trajectory.t[-1] != problem.t[-1]
        assert each.trajectory.mechanism.parameters["bob.mass"] == each.unknowns["bob.mass"]
    more = optimised_again(problem, found)
    assert more.trajectory.t[-1] == more.unknowns["final time"]


def optimised_again(problem, found):
    cost = la.QuadraticCost(np.zeros((11, 6)), np.zeros((10, 2)), Q=np.ones(6), R=np.ones(2))
    unknowns = [la.FinalTime(guess=1.6), la.Parameter("bob.mass", guess=1.1)]
    return la.optimize(problem, cost, resume=found, unknowns=unknowns, max_iterations=1)


def test_a_system_of_no_mechanism_says_so():
    fall = LinearSystem(np.eye(1), np.eye(1), N=3)
    cost = la.QuadraticCost(np.zeros((4, 1)), np.zeros((3, 1)), Q=[1.0], R=[1.0])
    result = la.optimize(fall, cost, initial=([1.0], np.zeros((3, 1))))
    assert (result.state_names, result.input_names) == (("x[0]",), ("u[0]",))
    assert result.state_units == result.input_units == ("",)
    np.testing.assert_array_equal(result.t, [0.0, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(result["x[0]"], result.x[:, 0])
    with pytest.raises(ArgumentError, match="knows no mechanism"):
        _ = result.trajectory
    with pytest.raises(ArgumentError, match=r"unknown name 'x\[1\]'"):
        result["x[1]"]
    rate = FunctionContinuousSystem(
        lambda x, u, t: u, nx=1, nu=1, derivatives=lambda x, u, t: (np.zeros((1, 1)), np.eye(1)),
        curvature=lambda x, u, t, z: np.zeros((2, 2)),
    )  # fmt: skip
    found = la.optimize(
        rate, la.ContinuousQuadraticCost([0.0], [0.0], Q=[1.0], R=[1.0]), initial=([1.0], [0.0]), horizon=(0.0, 1.0)
    )
    with pytest.raises(ArgumentError, match="knows no mechanism"):
        _ = found.trajectory
    # One whose steps are its own has names, and no trajectory of this mechanism.

    class Own(la.MidpointSystem):
        def f(self, x, u, k):
            return x

    assert Own(la.MidpointVI(hanging()), [0.0, 1.0]).told() is None
    gapped = dataclasses.replace(optimised(system()), gap=0.5)
    with pytest.raises(ArgumentError, match="with gaps between its steps"):
        _ = gapped.trajectory


def test_what_has_a_result_inside_finds_names_the_same_way():
    m = la.Mechanism(
        [ry("elbow"), [la.tz(-1.0, name="bob", mass=1.0)]], [la.Gravity(), la.JointForce("elbow", "motor")]
    )
    t = np.linspace(0.0, 0.5, 21)
    found = la.follow(m, {"elbow": 0.2 * np.sin(t)}, t=t)
    np.testing.assert_array_equal(found.t, found.result.t)
    np.testing.assert_array_equal(found["elbow"], found.result["elbow"])
    played = la.play(found.system, found.result)
    assert played["elbow"].shape == (21,)
    np.testing.assert_array_equal(played["p_elbow"], played.x[:, 1])
    np.testing.assert_array_equal(played["motor"], played.u[:, 0])
    with pytest.raises(ArgumentError, match="unknown name 'elbo'; did you mean 'elbow'"):
        played["elbo"]
