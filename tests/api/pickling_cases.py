"""An object of every public class, and what worker processes do with them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from typing import Any

import numpy as np
import sympy

import leastaction as la
from leastaction import costs, elements, optimal, starts
from leastaction.optimal import continuous


class Square(la.PythonFunction):
    """``z[0]^2``, a user's own function."""

    def value(self, z):
        return z[0] ** 2

    def gradient(self, z):
        return np.array([2.0 * z[0], *np.zeros(len(z) - 1)])

    def hessian(self, z):
        return np.diag([2.0, *np.zeros(len(z) - 1)])


def swing(t, x):
    return np.array([np.sin(t) - x[0]])


def oscillator(x, u, k):
    return np.array([x[0] + 0.1 * x[1], x[1] - 0.1 * np.sin(x[0]) + 0.1 * u[0]])


def oscillator_rate(x, u, t):
    return np.array([x[1], u[0] - np.sin(x[0])])


@cache
def mechanism() -> la.Mechanism:
    return la.Mechanism(
        [
            la.tx("x", name="cart", mass=2.0),
            [la.rz("theta", inertia=(0.1, 0.2, 0.25), mass=0.1), [la.ty(-1.0, name="bob", mass=0.5)]],
            la.pose(translation=[2.0, 0.0, 0.0], name="post"),
            [la.ball("ball", axes="xyz", name="end", mass=0.3, com=(0.1, 0.0, 0.2), inertia=(0.1, 0.1, 0.1))],
            la.tx("hand", kinematic=True, name="hand"),
        ],
        [
            la.Gravity((0.0, -9.81, 0.0)),
            la.JointForce("x", input="F"),
            la.LinearSpring("hand", "bob", stiffness=3.0, length=0.5, name="spring"),
            la.Damping(0.1, name="damping"),
        ],
    )  # fmt: skip


@cache
def changed() -> la.Mechanism:
    """The mechanism after its numbers were changed, a body's down to zero and to one that it had not."""
    return (
        mechanism()
        .with_parameters({"bob.mass": 0.7, "spring.stiffness": 5.0})
        .with_parameters({"bob.mass": 0.0, "post.translation.x": 1.5})
    )  # fmt: skip


@cache
def strung() -> la.Mechanism:
    return la.Mechanism(
        [la.tx("x", mass=1.0), [la.rz("theta", name="arm"), [la.ty(-1.0, name="bob", mass=1.0)]],
         la.pose(translation=[0.0, 1.0, 0.0], name="hook"), la.tz("L", kinematic=True)],
        [la.Gravity((0.0, -9.81, 0.0)), la.Distance("bob", "hook", "L", name="string")],
        dynamic=["x", "theta"],
    )  # fmt: skip


def integrator() -> la.MidpointVI:
    return la.MidpointVI(changed(), split="left", tolerance=1e-12, max_iterations=30, threads=1)


def start() -> la.State:
    return integrator().start(mechanism().configuration({"theta": 0.3, "hand": 0.4}))


@cache
def trajectory() -> la.Trajectory:
    return integrator().simulate(start(), 0.01 * np.arange(6))


@cache
def continuous_trajectory() -> la.ContinuousTrajectory:
    q = mechanism().configuration({"theta": 0.3})
    return la.simulate(
        mechanism(), q, np.zeros(len(q)), t=np.linspace(0.0, 0.1, 4), inputs=swing,
        events={"late": la.Event(late)},
    )  # fmt: skip


def late(t, x):
    return t - 0.05


def dynamics() -> la.ContinuousDynamics:
    return la.ContinuousDynamics(strung(), constraint_damping=2.0, constraint_stiffness=1.0, threads=1)


def system() -> la.MidpointSystem:
    return la.MidpointSystem(la.MidpointVI(mechanism()), 0.01 * np.arange(6))


def cost() -> la.QuadraticCost:
    s = system()
    return la.QuadraticCost(np.ones((s.N + 1, s.nx)), np.zeros((s.N, s.nu)), Q=np.ones(s.nx), R=np.eye(s.nu))


def along() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((system().N + 1, system().nx)), np.zeros((system().N, system().nu))


@cache
def optimised() -> la.OptimizationResult:
    s = system()
    x0 = la.MidpointVI(mechanism()).start(mechanism().configuration({"theta": 0.3})).x
    return la.optimize(s, cost(), initial=(x0, np.zeros((s.N, s.nu))), max_iterations=2)


@cache
def followed() -> la.Followed:
    t = 0.01 * np.arange(6)
    return la.follow(mechanism(), {"theta": 0.3 + t}, {"theta": 10.0}, t=t, tolerance=1e-3)


@cache
def optimised_continuous() -> Any:
    return la.optimize_continuous(
        oscillating(),
        continuous_cost(),
        initial=([0.5, 0.0], np.zeros(1)),
        horizon=(0.0, 1.0),
        max_iterations=1,
    )


def oscillating() -> continuous.FunctionContinuousSystem:
    return continuous.FunctionContinuousSystem(oscillator_rate, nx=2, nu=1, derivatives="finite-differences")


def continuous_cost() -> la.ContinuousQuadraticCost:
    return la.ContinuousQuadraticCost(np.zeros(2), np.zeros(1), Q=np.ones(2), R=np.ones(1), Q_final=np.ones(2))


@cache
def started() -> la.StartResult:
    """Return a trajectory made window by window."""
    problem = system()
    inputs = np.zeros((problem.N, problem.nu))
    return la.receding_horizon(problem, cost(), initial=(start().x, inputs), window=3, max_iterations=2)


def height(x: Any) -> Any:
    return x[:, 1]


def limited() -> Any:
    """A swing down with a bounded push, and its duals."""
    given = system()
    N, nx, nu = given.N, given.nx, given.nu
    weights = la.QuadraticCost(np.zeros((N + 1, nx)), np.zeros((N, nu)), Q=np.ones(nx), R=np.ones(nu))
    start = np.zeros(nx)
    start[0] = 0.2
    name = given.quantity("input").names[0]
    return la.optimize(given, weights, initial=(start, np.zeros((N, nu))), limits=[la.Bound(name, -0.1, 0.1)])


PUBLIC: dict[str, Callable[[], Any]] = {
    "Ball": lambda: la.Ball((0.0, 1.0, 0.0), 0.5),
    "Baumgarte": lambda: la.Baumgarte(10.0),
    "Body": lambda: la.Body(1.0, com=(0.1, 0.2, 0.3), inertia=(1.0, 2.0, 2.5)),
    "BodyWrench": lambda: la.BodyWrench("bob", force=("F", 0.0, 1.0)),
    "Bound": lambda: la.Bound("x", -1.0, 1.0, of="rate"),
    "Box": lambda: la.Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    "ContinuousDynamics": dynamics,
    "ContinuousQuadraticCost": continuous_cost,
    "ContinuousTrajectory": continuous_trajectory,
    "CoulombFriction": lambda: la.CoulombFriction("x", 1.0, speed=0.1),
    "Coupling": lambda: la.Coupling({"x": 1.0, "theta": -2.0}),
    "Curve": lambda: la.Curve([0.0, 1.0, 3.0], [1.0, 2.0, -1.0]),
    "Damping": lambda: la.Damping({"x": 1.0}, default=0.3),
    "Distance": lambda: la.Distance("bob", "hand", "L", name="string"),
    "Drag": lambda: la.Drag("bob", 0.3),
    "ElasticString": lambda: la.ElasticString(["bob", "hand"], stiffness=3.0, length=1.0),
    "Equal": lambda: la.Equal("x", 0.5, at=0.1),
    "Event": lambda: la.Event(late),
    "ExpressionConstraint": lambda: la.ExpressionConstraint(la.point("bob")[0] - la.variable("x")),
    "ExpressionForce": lambda: la.ExpressionForce(la.input_("u") * la.parameter("k", 2.0) * la.speed("x"), along="x"),
    "ExpressionPotential": lambda: la.ExpressionPotential(la.distance("bob", "hand") ** 2),
    "Feedback": lambda: la.Feedback(np.ones((1, 4)), np.zeros(4), np.zeros(1)),
    "Followed": followed,
    "FixedOrientation": lambda: la.FixedOrientation("bob", "hand"),
    "FunctionQuantity": lambda: la.FunctionQuantity("height", height),
    "Gravity": lambda: la.Gravity((0.0, 0.0, -9.81)),
    "HalfSpace": lambda: la.HalfSpace((0.0, 1.0, 0.0), -0.2),
    "HingeLoop": lambda: la.HingeLoop("bob", "hand", axis="z"),
    "HybridWrench": lambda: la.HybridWrench("bob", torque=("T", 0.0, 1.0)),
    "IntegrationStatus": lambda: la.IntegrationStatus.EVENT,
    "InverseSquareGravity": lambda: la.InverseSquareGravity("bob", "hand", 2.0),
    "IterationTable": la.IterationTable,
    "JointForce": lambda: la.JointForce("x", input="F"),
    "JointSpring": lambda: la.JointSpring("x", stiffness=2.0, rest=0.1),
    "Keep": lambda: la.Keep("bob", inside=la.Ball((0.0, 0.0, 0.0), 3.0)),
    "LeastActionError": lambda: la.LeastActionError("what happened"),
    "LinearDamper": lambda: la.LinearDamper("bob", "hand", 2.0),
    "LinearMotor": lambda: la.LinearMotor("bob", "hand", "F", gain=2.0),
    "Armature": lambda: la.Armature("x", 0.1),
    "PolynomialCoupling": lambda: la.PolynomialCoupling("x", "theta", (0.0, 1.0, 0.5)),
    "Servo": lambda: la.Servo("x", "F", 2.0, stiffness=2.0),
    "Motor": lambda: la.Motor("bob", "hand", "F", axis="x"),
    "LinearSpring": lambda: la.LinearSpring("bob", "hand", stiffness=2.0, length=1.0),
    "Mechanism": changed,
    "MechanismSystem": lambda: la.MechanismSystem(dynamics()),
    "KalmanFilter": lambda: la.KalmanFilter(
        system(), measure=np.eye(1, system().nx), noise=0.1, process=0.1, x=np.zeros(system().nx)
    ),
    "MPC": lambda: la.MPC(system(), cost()),
    "MidpointSystem": system,
    "MidpointVI": integrator,
    "NonlinearDamping": lambda: la.NonlinearDamping("x", [0.0, 1.0, 2.0]),
    "NonlinearSpring": lambda: la.NonlinearSpring("x", la.Curve([0.0, 1.0, 3.0], [1.0, 2.0, -1.0])),
    "OptimizationResult": optimised,
    "PathLength": lambda: la.PathLength(["bob", "post", "hand"], 3.0),
    "PlaceCost": lambda: la.PlaceCost(cost(), system(), {"bob": [0.0, -1.0, np.nan]}, {"bob": 2.0}),
    "Played": lambda: la.play(followed().system, followed().result, la.Rig(noise=0.0, delay=0.0)),
    "PointOnLine": lambda: la.PointOnLine("bob", "hand", direction="x"),
    "PointOnPlane": lambda: la.PointOnPlane("bob", "hand", normal="x"),
    "PointToPoint": lambda: la.PointToPoint("bob", "hand"),
    "PrescribedMotion": lambda: la.PrescribedMotion.through(np.arange(8.0), np.arange(8.0)[:, None] ** 2),
    "PrescribedPath": lambda: la.PrescribedPath("bob", x="px", z="pz"),
    "Projection": lambda: la.Projection(),
    "PythonConstraint": lambda: la.PythonConstraint(Square(), points=["bob"]),
    "PythonForce": lambda: la.PythonForce(Square(), "u", variables=["x"]),
    "PythonFunction": Square,
    "PythonPotential": lambda: la.PythonPotential(Square(), points=["bob"], variables=["x"]),
    "Parameter": lambda: la.Parameter("bob.mass", 0.5, 2.0, guess=1.0, weight=0.1),
    "Periodic": lambda: la.Periodic(["x", "p_x"], offset={"x": 0.4}),
    "FinalTime": lambda: la.FinalTime(1.0, 3.0, price=1.0),
    "QuadraticCost": cost,
    "Rig": lambda: la.Rig(spread=0.1, factors={"bob.mass": 1.2}),
    "SimulationStatus": lambda: la.SimulationStatus.STEP_FAILED,
    "SmoothCost": lambda: la.SmoothCost(cost(), system(), {}),
    "SpatialWrench": lambda: la.SpatialWrench("bob", force=("F", 0.0, 1.0)),
    "StageRecord": lambda: started().stages[0],
    "StageTable": la.StageTable,
    "StartResult": started,
    "StartStatus": lambda: la.StartStatus.COMPLETED,
    "State": start,
    "Status": lambda: la.Status.CONVERGED,
    "TapeMeasure": lambda: la.TapeMeasure(mechanism(), mechanism().frames[:1] + mechanism().frames[-1:]),
    "TendonForce": lambda: la.TendonForce(["bob", "hand"], input="T"),
    "TorsionalSpring": lambda: la.TorsionalSpring("bob", "hand", 2.0, axis="z"),
    "Trajectory": trajectory,
    "Within": lambda: la.Within(la.FunctionQuantity("height", height), max=2.0),
}
"""By their names: of the root, and those that it still finds though they have moved."""

OTHERS: dict[str, Callable[[], Any]] = {
    "limited result": limited,
    "Accelerations": lambda: dynamics().accelerations([0.0, 0.3, 1.0], np.zeros(3)),
    "Affine": lambda: 2.0 * la.var("a") + 1.0,
    "Branch": lambda: la.world().tx("x", mass=1.0).rz("theta").ty(-1.0, name="bob", mass=1.0),
    "Composition": lambda: la.ball("b", axes="xyz", mass=1.0, inertia=(1.0, 1.0, 1.0)),
    "ConfigurationProjection": lambda: la.project_configuration(strung(), [0.0, 0.3, 1.5]),
    "ContinuousOptimizationResult": optimised_continuous,
    "ContinuousState": lambda: continuous_trajectory().last,
    "DiscreteBalance": lambda: trajectory().balance,
    "Energy": lambda: trajectory().energy(),
    "Equilibrium": lambda: la.equilibrium(mechanism(), mechanism().configuration()),
    "Frame": lambda: la.pose(translation=[1.0, 0.0, 0.0], name="f", mass=1.0),
    "FunctionContinuousSystem": oscillating,
    "FunctionSystem": lambda: optimal.FunctionSystem(oscillator, nx=2, nu=1, N=5, derivatives="finite-differences"),
    "LinearSystem": lambda: optimal.LinearSystem(np.ones((5, 2, 2)), np.ones((5, 2, 1))),
    "Step": lambda: integrator().step(start(), 0.01),
    "an expression": lambda: la.direction("bob", "x")[0] * la.speed("x"),
    "WindowCost": lambda: optimal.WindowCost(cost(), 1, 3, N=5, nu=1),
    "WindowSystem": lambda: optimal.WindowSystem(system(), 1, 3),
    "a description": lambda: [la.tx("x"), [la.rz({"x": 2.0}, offset=0.1)]],
    "DescriptionError": lambda: la.errors.DescriptionError("what was given"),
    "CostGradient": lambda: cost().gradient(*along()),
    "FunctionReport": lambda: elements.check_function(Square(), np.array([0.3, 0.2])),
    "HelpedCost": lambda: starts.HelpedCost(cost(), np.array([0]), np.array([2.0])),
    "LimitReport": lambda: limited().limits,
    "LimitState": lambda: limited().limits.sides[0],
    "RateGradient": lambda: costs.RateGradient(np.ones((3, 2)), np.zeros((3, 1))),
    "RateHessian": lambda: costs.RateHessian(np.ones((3, 2, 2)), np.zeros((3, 1, 1)), None),
    "StepError": lambda: la.errors.StepError("no solution", t=1.0, residuals={"x": 1.0}, iteration=3, state=start()),
}
"""What the public functions return and take besides."""


CASES = {**PUBLIC, **OTHERS}

PLAIN = (str, bytes, int, float, complex, type(None), type, sympy.Basic, sympy.MatrixBase)


def parts(value: Any, where: str = "", seen: set[int] | None = None) -> Iterator[tuple[str, Any]]:
    """Every object that a value is made of, with the path to it; what the core holds is left out."""
    seen = set() if seen is None else seen
    if id(value) in seen:
        return
    yield where, value
    if isinstance(value, (*PLAIN, np.ndarray)) or (callable(value) and inspect.isroutine(value)):
        return
    seen.add(id(value))
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from parts(entry, f"{where}[{key!r}]", seen)
    elif isinstance(value, (list, tuple)):
        for index, entry in enumerate(value):
            yield from parts(entry, f"{where}[{index}]", seen)
    if isinstance(value, partial):
        yield from parts(value.keywords, where, seen)
    fields = dict(getattr(value, "__dict__", {}))
    for cls in type(value).__mro__:
        names = getattr(cls, "__slots__", ())
        for name in (names,) if isinstance(names, str) else names:
            if hasattr(value, name) and name not in ("__weakref__", "__dict__"):
                fields[name] = getattr(value, name)
    for name, entry in fields.items():
        made_again = name in ("core", "_console") or type(entry).__module__.endswith("._core")
        if not made_again:
            yield from parts(entry, f"{where}.{name}", seen)


def writable(value: Any) -> set[str]:
    """The paths of the arrays in a value that can be written to."""
    return {where for where, part in parts(value) if isinstance(part, np.ndarray) and part.flags.writeable}


def look(value: Any) -> tuple[Any, set[str]]:
    """Return a value from a worker process, and what could be written to in it there."""
    return value, writable(value)


def swing_down(number: int, problem: la.MidpointSystem, weights: la.QuadraticCost) -> Any:
    """Optimise from one of many starts."""
    vi = problem.integrator
    angle = 0.02 * number
    x0 = vi.start(vi.mechanism.configuration({"theta": angle})).x
    u = np.zeros((problem.N, problem.nu))
    result = la.optimize(problem, weights, initial=(x0, u), max_iterations=3)
    return result, problem.trajectory(result.x, result.u)
