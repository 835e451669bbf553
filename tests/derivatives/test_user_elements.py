"""Elements of the user's own: as expressions and as Python classes, against SymPy and against each other."""

from __future__ import annotations

import copy
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy

from derivatives import user_elements as user
from leastaction import _core, check_derivatives
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import ContinuousDynamics, Gravity, JointForce, Mechanism, MidpointVI
from leastaction.mechanics.elements import (
    Element,
    ExpressionConstraint,
    ExpressionForce,
    ExpressionPotential,
    PythonConstraint,
    PythonPotential,
)
from leastaction.mechanics.elements.custom.python_function import PythonForce
from leastaction.mechanics.expressions.terms import (
    coordinate,
    input_,
    parameter,
    point,
    speed,
    variable,
)

Q = np.array([0.7, 0.04, 0.3, 0.4, -0.6, 0.15])
V = np.array([0.9, -0.3, 0.5, 0.8, -1.1, 0.2])
DQ = np.array([0.3, 0.5, -0.2, 0.7, 0.4, -0.6])
NQ, ND = 6, 5


def relative(ours: np.ndarray | float, theirs: np.ndarray | float) -> float:
    ours, theirs = np.asarray(ours), np.asarray(theirs, dtype=float)
    assert ours.shape == theirs.shape
    assert np.abs(theirs).max() > 1e-6, "nothing is compared with nothing"
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def derivatives(scalar: sympy.Expr, symbols: tuple[sympy.Symbol, ...], at: np.ndarray, orders: int) -> list[np.ndarray]:
    """Return value, gradient ... to an order from SymPy; at a complex step too, for one order more."""
    tensor, out = sympy.Array(scalar), []
    for order in range(orders + 1):
        if order:
            tensor = sympy.derive_by_array(tensor, symbols)
        function = sympy.lambdify(symbols, sympy.flatten(tensor), "numpy", cse=True)
        out.append(np.array(function(*at)).reshape((len(symbols),) * order))
    return out


@cache
def taylor(expression: sympy.Expr) -> list[np.ndarray]:
    """Return value, gradient and Hessian by q at Q of an expression of the user's, and the third order along DQ."""
    values = {s: s.of[1] for s in expression.free_symbols if s.role == "parameter"}
    whole = expression.subs(values).subs(user.kinematics())
    stepped = derivatives(whole, user.SYMBOLS, Q + 1e-30j * DQ, 2)
    return [*(part.real for part in stepped), stepped[2].imag / 1e-30]


@pytest.mark.parametrize("element", user.MAGNETS, ids=lambda e: type(e).__name__)
def test_potential(element: Element) -> None:
    core, still = user.machine(element).core, np.zeros(NQ)
    value, gradient, hessian, third = taylor(user.DIPOLES)
    assert core.potential_energy(Q) == pytest.approx(float(value), rel=1e-12)
    # At rest the kinetic energy adds nothing to what differentiates by q.
    assert relative(-core.gradient(Q, still)[0], gradient) < 1e-12
    assert relative(-core.hessian(Q, still)[0], hessian) < 1e-10
    assert relative(-core.third(Q, still, DQ, still)[0], third) < 1e-8


@pytest.mark.parametrize("way", [0, 1], ids=["expression", "python"])
@pytest.mark.parametrize("name", user.CONSTRAINTS)
def test_constraint(name: str, way: int) -> None:
    core = user.machine(user.CONSTRAINTS[name][way]).core
    value, gradient, hessian, _ = taylor(user.CONSTRAINTS[name][2])
    assert core.constraints(Q) == pytest.approx([float(value)], rel=1e-12)
    assert relative(core.constraint_jacobian(Q)[0], gradient) < 1e-12
    assert relative(core.constraint_hessian(Q, np.array([-1.7])), -1.7 * hessian) < 1e-10


def force_of(expression: sympy.Expr, along: sympy.Expr) -> tuple[list[Any], tuple[Any, ...]]:
    """Return the generalised forces F ds/dq_i in symbols of q, v and u."""
    v = sympy.symbols("v:6", real=True)
    inputs = sorted((s for s in expression.free_symbols if s.role == "input"), key=str)
    places = user.kinematics()

    def speed_of(argument: sympy.Expr) -> sympy.Expr:
        inner = argument.subs(places)
        return sum(sympy.diff(inner, s) * w for s, w in zip(user.SYMBOLS, v, strict=True))

    values = {s: s.of[1] for s in expression.free_symbols if s.role == "parameter"}
    whole = expression.replace(lambda e: e.func.__name__ == "Rate", lambda e: speed_of(e.args[0]))
    u = sympy.symbols(f"u:{len(inputs)}", real=True)
    whole = whole.subs(values).subs(places).subs(dict(zip(inputs, u, strict=True)))
    coordinate = along.subs(places)
    forces = [whole * sympy.diff(coordinate, s) for s in user.SYMBOLS[:ND]]
    return forces, (*user.SYMBOLS, *v, *u)


@pytest.mark.parametrize(
    ("element", "expression", "along"),
    [
        (user.ATTRACTION[0], user.PULL, user.GAP),
        (user.ATTRACTION[1], user.PULL, user.GAP),
        (ExpressionForce(user.MOTOR, "theta"), user.MOTOR, user.ANGLE),
        (ExpressionForce(user.MOTOR, user.GAP), user.MOTOR, user.GAP),
    ],
    ids=["attraction expression", "attraction python", "motor", "motor along a distance"],
)
def test_force(element: Element, expression: sympy.Expr, along: sympy.Expr) -> None:
    core = user.machine(element).core
    u = np.array([1.4])
    forces, symbols = force_of(expression, along)
    at = np.concatenate([Q, V, u])
    mu = np.array([0.4, -0.7, 1.1, 0.9, 0.6, 0.0])
    contracted = sum(float(m) * f for m, f in zip(mu, forces, strict=False))
    values, gradient = (
        sympy.lambdify(symbols, expressions, "numpy", cse=True)
        for expressions in (forces, [sympy.diff(contracted, symbol) for symbol in symbols])
    )
    steps = [at + 1e-30j * direction for direction in np.eye(len(at))]
    jacobian = np.array([np.imag(values(*z)) for z in steps]).T / 1e-30
    second = np.array([np.imag(gradient(*z)) for z in steps]).T / 1e-30
    assert relative(core.force(Q, V, u)[:ND], np.array(values(*at))) < 1e-12
    ours = np.concatenate(core.force_jacobians(Q, V, u), axis=1)[:ND]
    assert relative(ours, jacobian) < 1e-11
    assert relative(core.force_curvature(Q, V, u, mu), second) < 1e-9


def steps(which: int) -> tuple[MidpointVI, Any]:
    elements = (
        *(pair[which] for pair in user.CONSTRAINTS.values()),
        user.MAGNETS[which],
        user.ATTRACTION[which],
        JointForce("theta", "torque"),
        Gravity((0.0, -9.81, 0.0)),
    )
    mechanism = user.machine(*elements)
    vi = MidpointVI(mechanism, threads=1)
    q0 = mechanism.configuration({"theta": 0.7, "alpha": 0.3, "beta": -0.4, "height": 0.1})
    q0[mechanism.variables.index("lift")] = 0.05 * (1 - np.cos(0.7)) + 0.01 * np.sin(1.4) ** 2
    q0[mechanism.variables.index("nut")] = 0.02 * 0.7 + 0.003 * 0.7**3
    t = np.arange(6) * 0.01
    rho = np.column_stack([0.1 + 0.02 * np.sin(9 * t[1:])])
    run = vi.simulate(vi.start(q0), t, inputs=np.tile([0.8, 3.0], (5, 1)), rho=rho)
    assert run.steps == 5, run.message
    return vi, run


def test_a_run_is_the_same_both_ways() -> None:
    (vi, run), (other_vi, other) = steps(0), steps(1)
    assert np.abs(run.q[-1] - run.q[0]).max() > 1e-3, "nothing moves"
    assert relative(run.q, other.q) < 1e-12
    assert np.abs(vi.mechanism.core.constraints(run.q[-1])).max() < 1e-12
    assert relative(run.lam, other.lam) < 1e-7
    ours, theirs = vi.linearize(run), other_vi.linearize(other)
    assert relative(ours.A, theirs.A) < 1e-9
    assert relative(ours.B, theirs.B) < 1e-9
    assert relative(vi.tensors(run, 2).x, other_vi.tensors(other, 2).x) < 1e-7


def test_check_derivatives_of_right_ones() -> None:
    rng = np.random.default_rng(3)
    for function, m in (
        (user.Cam(), 4),
        (user.Screw(), 2),
        (user.Dipoles(1.0), 12),
        (user.Flux(), 6),
    ):
        report = check_derivatives(function, rng.uniform(0.5, 1.5, m) * np.arange(1, m + 1))
        assert report.ok
        assert report.wrong == ()
        assert "WRONG" not in str(report)


class WrongGradient(user.Screw):
    def gradient(self, z: np.ndarray) -> np.ndarray:
        return np.array([1.0, -0.02 - 0.008 * z[1] ** 2])


class WrongHessian(user.Cam):
    def hessian(self, z: np.ndarray) -> np.ndarray:
        out = super().hessian(z)
        out[3, 1] += 0.5
        return out


class NotAnalytic(user.Screw):
    def value(self, z: np.ndarray) -> Any:
        return super().value(z) + np.abs(z[0]) ** 2

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return super().gradient(z) + np.array([2.0 * z[0], 0.0])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        return super().hessian(z) + np.array([[2.0, 0.0], [0.0, 0.0]])


class WrongShape(user.Screw):
    def hessian(self, z: np.ndarray) -> np.ndarray:
        return np.zeros(2)


class Broken(user.Screw):
    def value(self, z: np.ndarray) -> Any:
        return np.nan


@pytest.mark.parametrize(
    ("function", "z", "message"),
    [
        (
            WrongGradient(),
            [0.5, 0.8],
            r"WrongGradient.gradient: entry \[1\] is -0.02512, but .* -0.02576",
        ),
        (WrongHessian(), [1.0, 2.0, 3.0, 0.4], r"WrongHessian.hessian: entry \[3, 1\] is 0.5"),
        (NotAnalytic(), [0.5, 0.8], "NotAnalytic.value does not follow complex z"),
        (
            WrongShape(),
            [0.5, 0.8],
            r"hessian: returned float64 of shape \(2,\), expected .*\(2, 2\)",
        ),
        (Broken(), [0.5, 0.8], "Broken.*nan"),
        (user.Screw(), "z", "check_derivatives: z: got .*, expected real numbers"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_check_derivatives_names_what_is_wrong(function: Any, z: Any, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        check_derivatives(function, z)


def test_check_derivatives_can_report_instead() -> None:
    report = check_derivatives(WrongGradient(), [0.5, 0.8], strict=False)
    assert not report.ok
    assert report.wrong == ("gradient", "hessian")
    assert report.worst["gradient"] == (1,)
    assert str(report).count("WRONG") == 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ExpressionPotential("theta"), "ExpressionPotential: got the text"),
        (
            lambda: ExpressionConstraint(sympy.Symbol("x"), name="cam"),
            "ExpressionConstraint 'cam': the symbol x stands for nothing",
        ),
        (lambda: ExpressionForce(1.0, ""), "ExpressionForce: along: a name is a string"),
        (lambda: PythonPotential(user.Screw()), "nothing to depend on; give points="),
        (
            lambda: PythonPotential(user.Screw, variables=["nut", "theta"]),
            "is a class; make an object",
        ),
        (lambda: PythonConstraint(object(), variables=["nut"]), "has no method 'value'"),
        (lambda: PythonConstraint(user.Cam(), points="follower"), "got 'follower' alone"),
        (lambda: PythonPotential(user.Cam(), directions=["coil"]), "pairs of a frame and a vector"),
        (lambda: PythonPotential(user.Cam(), directions=[("coil", "w")]), "got 'w', expected"),
        (lambda: PythonForce(user.Flux(), "", points=["coil"]), "PythonForce: input"),
        (lambda: PythonForce(user.Flux(), "u", points=["coil"], gain=np.inf), "PythonForce: gain"),
        (lambda: PythonForce(user.Flux(), points=["coil"]), "nothing says how large it is; give an input, magnitude="),
        (lambda: PythonForce("theta", "u", measured=["nut"]), "measured: there is no magnitude that depends on it"),
        (lambda: PythonForce("theta", "u", points=["coil"]), "along the variable 'theta', so there is no z; leave out"),
        (lambda: PythonForce("theta", magnitude=user.Cam), "PythonForce: .*is a class; make an object"),
        (lambda: PythonForce("", "u"), "PythonForce: function, a variable: a name is a string"),
    ],
)
def test_broken_elements_are_named(make: Any, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        make()


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (ExpressionPotential(point("mgnet")[0]), "unknown frame 'mgnet'; did you mean 'magnet'"),
        (ExpressionPotential(variable("gamma") ** 2), "unknown variable 'gamma'"),
        (ExpressionForce(1.0, "height"), "no dynamic variable changes height"),
        (ExpressionConstraint(point("coil")[2] - 1), "no dynamic variable changes the expression"),
        (ExpressionForce(input_("u"), point("world")[0]), "no dynamic variable changes"),
        (PythonPotential(user.Screw(), variables=["nut", "thta"]), "did you mean 'theta'"),
        (PythonConstraint(user.Screw(), variables=["height"]), "no dynamic variable changes"),
        (PythonForce(user.Flux(), "u", points=["coil"]), "no dynamic variable changes"),
        (PythonForce("height", "u"), "no dynamic variable changes"),
        (PythonForce("thta", "u"), "unknown variable 'thta'; did you mean 'theta'"),
        (PythonForce("height", magnitude=user.Screw(), measured=["theta"]), "no dynamic variable changes"),
    ],
)
def test_elements_that_do_not_fit_are_named(element: Element, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        user.machine(element)


def test_a_python_function_of_the_wrong_shape_says_whose_it_is() -> None:
    element = PythonPotential(WrongShape(), variables=["nut", "theta"], name="spring")
    message = r"'spring': WrongShape.hessian returned float64 of shape \(2,\)"
    with pytest.raises(ArgumentError, match=message):
        user.machine(element).core.hessian(Q, V)


def test_elements_show_what_they_are() -> None:
    mechanism: Mechanism = user.machine(*user.MAGNETS[:1], user.CONSTRAINTS["screw"][1])
    assert "parameter('strength', 0.002)" in str(mechanism)
    assert "Screw in Python = 0" in str(mechanism)
    assert ExpressionPotential(user.ANGLE**2).default_name == "potential(theta)"
    assert ExpressionForce(1.0, "theta").default_name == "force(theta)"
    assert PythonForce("theta", magnitude=user.Screw()).default_name == "force(theta)"
    assert (
        PythonForce("theta", "u", magnitude=user.Screw(), gain=2.0).describe() == "2 Screw in Python of u along theta"
    )
    assert PythonForce("theta", "u").describe() == "1 u along theta"


@pytest.mark.parametrize("way", [0, 1], ids=["expression", "python"])
def test_mechanisms_with_them_can_be_pickled(way: int) -> None:
    mechanism = user.machine(user.MAGNETS[way], user.CONSTRAINTS["cam"][way], user.ATTRACTION[way])
    again = pickle.loads(pickle.dumps(mechanism))
    assert again.core.potential_energy(Q) == mechanism.core.potential_energy(Q)
    assert again.core.constraints(Q) == mechanism.core.constraints(Q)
    u = np.array([1.2])
    assert np.array_equal(again.core.force(Q, V, u), mechanism.core.force(Q, V, u))


def test_named_numbers_of_expressions_are_parameters() -> None:
    def spring(k: float, free: float, c: float) -> Element:
        force = parameter("k", k) * (user.GAP - parameter("free", free))
        damper = parameter("c", c) * speed("nut")
        along = coordinate(parameter("k", k) * variable("theta") ** 2)
        return ExpressionForce(force - damper, along=along, name="spring")

    first, second = user.machine(spring(2.0, 0.1, 3.0)), user.machine(spring(2.5, 0.2, 1.0))
    builder = _core.MechanismBuilder(ND, NQ - ND, 0)
    context = second._plan.emit(builder)
    names = [name for name in context.parameters if name.startswith("spring.")]
    assert sorted(names) == ["spring.c", "spring.free", "spring.k"]
    # The structure of the first with the numbers of the second is the second.
    u = np.zeros(0)
    changed, wanted = builder.build_like(first.core).force(Q, V, u), second.core.force(Q, V, u)
    assert np.array_equal(changed, wanted)
    assert relative(first.core.force(Q, V, u), wanted) > 0.1


class Friction(user.Screw):
    """F = u - 0.3 theta' - 0.1 sin(theta) theta'^3 of y = [theta, theta', u]."""

    def value(self, y: np.ndarray) -> Any:
        return y[2] - 0.3 * y[1] - 0.1 * np.sin(y[0]) * y[1] ** 3

    def gradient(self, y: np.ndarray) -> np.ndarray:
        return np.array([-0.1 * np.cos(y[0]) * y[1] ** 3, -0.3 - 0.3 * np.sin(y[0]) * y[1] ** 2, 1.0])

    def hessian(self, y: np.ndarray) -> np.ndarray:
        out = np.zeros((3, 3), dtype=y.dtype)
        out[0, 0], out[1, 1] = 0.1 * np.sin(y[0]) * y[1] ** 3, -0.6 * np.sin(y[0]) * y[1]
        out[0, 1] = out[1, 0] = -0.3 * np.cos(y[0]) * y[1] ** 2
        return out


def test_a_force_in_python_with_rates_is_the_expression() -> None:
    """In a run, its derivatives of both orders, in continuous time, and by its gain."""
    law = input_("u") - 0.3 * speed("theta") - sympy.sin(variable("theta")) * speed("theta") ** 3 / 10
    check_derivatives(Friction(), [0.7, 0.9, 1.4])
    found = []
    for element in (
        ExpressionForce(parameter("gain", 1.5) * law, "theta", name="friction"),
        PythonForce("theta", "u", magnitude=Friction(), gain=1.5, name="friction"),
    ):
        mechanism = user.machine(element, Gravity((0.0, -9.81, 0.0)))
        vi = MidpointVI(mechanism, threads=1)
        start = vi.start(mechanism.configuration({"theta": 0.7, "alpha": 0.3}), 0.5 * np.array([*V[:ND], 0.0]))
        run = vi.simulate(start, np.arange(6) * 0.01, inputs=np.full((5, 1), 1.4))
        assert run.steps == 5, run.message
        d = vi.linearize(run)
        dynamics = ContinuousDynamics(mechanism)
        found.append(
            [
                run.q,
                d.A,
                d.B,
                d.curvature(np.ones((5, mechanism.nx))),
                dynamics.linearize(Q, V, [1.4]).all,
                dynamics.curvature(Q, V, [1.4], z_a=np.ones(ND)),
                vi.differentiate_by(run, ["friction.gain"]).x,
                mechanism.force(Q, V, [1.4], "friction").hessian,
            ]
        )
    for ours, theirs in zip(found[1], found[0], strict=True):
        assert relative(ours, theirs) < 1e-10


class Greedy(user.Cam):
    """Writes into its argument, so that the gradient would be that of another place."""

    def value(self, z: Any) -> Any:
        result = super().value(z)
        z[0] = 0.0
        return result


def test_a_function_cannot_write_into_what_it_is_given() -> None:
    with pytest.raises(ValueError, match="read-only"):
        user.machine(PythonPotential(Greedy(), points=["follower"], variables=["theta"]))
    with pytest.raises(ValueError, match="read-only"):
        check_derivatives(Greedy(), Q[:4])


def test_elements_can_be_copied_and_their_tapes_stay_read_only() -> None:
    force = ExpressionForce(input_("u") - parameter("c", 0.3) * speed("theta"), "theta", name="f")
    for again in (copy.deepcopy(force), pickle.loads(pickle.dumps(force))):
        assert again == force
        assert hash(again) == hash(force)
        assert not again.compiled.code.instructions.flags.writeable
        assert not again.compiled.code.constants.flags.writeable
