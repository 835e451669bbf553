"""What is given in place of another object is named, with what was expected, at the call and not behind it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import leastaction as la
from leastaction.models.cart_pendulum import cart_pendulum

mechanism = cart_pendulum()
vi = la.MidpointVI(mechanism)
t = np.linspace(0.0, 0.1, 3)
run = vi.simulate(vi.start([0.0, 0.1]), t)
system = la.MidpointSystem(vi, t)
cost = la.QuadraticCost(np.zeros((3, 4)), np.zeros((2, 1)), Q=np.ones(4), R=[1.0])
pair = (run.x, run.u)

CALLS = [
    (
        "integrator: got Mechanism, expected a MidpointVI; MidpointVI(mechanism)",
        lambda: la.MidpointSystem(mechanism, t),
    ),
    ("mechanism: got list, expected a Mechanism", lambda: la.MidpointVI([la.rx("a")])),
    ("dynamics: got MidpointVI, expected a Mechanism or its", lambda: la.MechanismSystem(vi)),
    ("dynamics: got list, expected a Mechanism or its", lambda: la.simulate([], [0.0], [0.0], t)),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.ContinuousDynamics(vi)),
    ("mechanism: got MidpointSystem, expected a Mechanism", lambda: la.equilibrium(system, [0.0, 0.0])),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.project_configuration(vi, [0.0, 0.0])),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.project_velocity(vi, [0.0, 0.0], [0.0, 0.0])),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.check_consistent(vi, [0.0, 0.0])),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.to_momentum(vi, [0.0, 0.0], [0.0, 0.0])),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.to_velocity(vi, [0.0, 0.0], [0.0, 0.0])),
    ("trajectory: got ndarray, expected a Trajectory; simulate()", lambda: vi.linearize(run.x)),
    ("trajectory: got Trajectory, expected a ContinuousTrajectory", lambda: la.to_discrete(run, vi)),
    ("run: got MidpointVI, expected a Trajectory", lambda: la.to_continuous(vi)),
    ("state: got list, expected a State; start()", lambda: vi.simulate([0.0, 0.1], t)),
    ("mechanism: got MidpointVI, expected a Mechanism", lambda: la.follow(vi, {"x": t}, t=t)),
    ("motion: got NoneType, expected a Motion, or by name what is wanted", lambda: la.follow(mechanism, None)),
    ("start: got ndarray, expected a State", lambda: la.follow(mechanism, {"x": t}, t=t, start=np.zeros(2))),
    (
        "initial: got Trajectory, expected a pair (x, u); (initial.x, initial.u)",
        lambda: la.optimize(system, cost, initial=run),
    ),
    ("initial: got ndarray, expected a pair (x, u)", lambda: la.optimize(system, cost, initial=run.x)),
    ("resume: got Trajectory, expected an OptimizationResult", lambda: la.optimize(system, cost, resume=run)),
    (
        "free_start: unknown name 'y'; the entries of the state are 'x'",
        lambda: la.optimize(system, cost, initial=pair, free_start=["y"]),
    ),
    (
        "Bound('psh'): unknown name 'psh'; the names are 'x-force'",
        lambda: la.optimize(system, cost, initial=pair, limits=[la.Bound("psh", -1.0, 1.0)]),
    ),
    (
        "Bound(['x-force', 'x']): the names are of several quantities",
        lambda: la.optimize(system, cost, initial=pair, limits=[la.Bound(["x-force", "x"], -1.0, 1.0)]),
    ),
    (
        "Within: quantity: got str, expected a Quantity; FunctionQuantity",
        lambda: la.optimize(system, cost, initial=pair, limits=[la.Within("height", max=1.0)]),
    ),
    ("A, B: got MidpointSystem and ndarray, expected arrays", lambda: la.regulate(system, run.x)),
    ("t: got shape (), expected (any,), that is (N+1,)", lambda: vi.simulate(run.state(0), 1.0)),
    ("system: got MidpointVI, expected a MidpointSystem", lambda: la.relax(vi, cost, initial=pair)),
    ("cost: got Trajectory, expected a Cost", lambda: la.embed(system, run, initial=pair)),
    ("values: got [1.0] (list), expected a mapping of names to values", lambda: mechanism.configuration([1.0])),
    ("unknown name 'y'", lambda: la.project_configuration(mechanism, {"y": 1.0})),
    (
        "(list), expected a mapping of names to values, such as {'hand': 100.0}",
        lambda: la.follow(mechanism, {"x": t}, [la.Bound("x", max=1.0)], t=t),
    ),
    ("accelerations: got None (NoneType), expected a mapping", lambda: la.SmoothCost(cost, system, None)),
    ("limits: got 3, expected a list of limits", lambda: la.optimize(system, cost, initial=pair, limits=3)),
    ("limits: got 'x', expected a list of limits", lambda: la.optimize(system, cost, initial=pair, limits="x")),
    ("free_start: got 3, expected True, False or names", lambda: la.optimize(system, cost, initial=pair, free_start=3)),
    ("from_system: got MidpointVI, expected a MidpointSystem", lambda: la.warm_start(pair, vi, system)),
]


@pytest.mark.parametrize(("message", "call"), CALLS)
def test_another_object_is_named_with_what_was_expected(message: str, call: Callable[[], object]) -> None:
    with pytest.raises(la.LeastActionError) as caught:
        call()
    assert message in str(caught.value)
