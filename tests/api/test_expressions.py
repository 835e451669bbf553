"""Expressions of the user's own: symbols that know what they mean, and errors that say what to do."""

from __future__ import annotations

import copy
import importlib
import pickle
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import sympy

from leastaction.errors import DescriptionError
from leastaction.mechanics.expressions.compiled import compile_expression, compile_force
from leastaction.mechanics.expressions.terms import (
    coordinate,
    direction,
    distance,
    input_,
    parameter,
    point,
    rate,
    speed,
    variable,
)

THETA = variable("theta")
GAP = distance("a", "b")

SYMBOLS = [
    point("hand")[1],
    direction("hand", "y")[2],
    direction("hand", (1.0, 2.0, 2.0))[0],
    variable("theta"),
    input_("theta"),
    parameter("theta", 2.0),
    parameter("theta", 3.0),
    point("theta")[0],
    point("it's (odd), 'x'")[0],
]


@pytest.mark.parametrize("symbol", SYMBOLS, ids=str)
def test_symbols_keep_their_meaning(symbol: Any) -> None:
    for again in (pickle.loads(pickle.dumps(symbol)), copy.deepcopy(symbol)):
        assert again == symbol
        assert hash(again) == hash(symbol)
        assert (again.role, again.of) == (symbol.role, symbol.of)
    other = [s for s in SYMBOLS if s is not symbol]
    assert symbol not in other
    assert symbol.is_real
    assert symbol != sympy.Symbol(symbol.name, real=True)


def test_symbols_made_twice_are_equal() -> None:
    assert variable("theta") - THETA == 0
    assert point("a") == point("a")
    assert direction("a", "z") == direction("a", (0.0, -0.0, 5.0))
    assert direction("a", "z") != direction("a", (0.0, 0.0, -5.0))
    assert direction("a", "z") == direction("a", (0.0, 0.0, 1e300)) == direction("a", (0, 0, 5e-324))
    assert parameter("k", 2) == parameter("k", 2.0)
    assert distance("a", "b") == GAP
    assert rate(GAP) == rate(distance("a", "b"))
    assert str(THETA + point("a")[0]) == "point('a').x + variable('theta')"


def test_expressions_survive_what_sympy_does_with_them() -> None:
    expression = (THETA**2 + 2 * THETA + 1) / (THETA + 1) * rate(GAP) + coordinate(THETA)
    assert pickle.loads(pickle.dumps(expression)) == expression
    simple = sympy.simplify(expression)
    assert simple.free_symbols == expression.free_symbols
    assert simple.has(rate(GAP))
    swapped = GAP.subs(point("b")[0], THETA)
    assert compile_expression(swapped).variables == ("theta",)
    assert coordinate(THETA**2).diff(THETA) == 2 * THETA
    assert sympy.sqrt(THETA**2) == sympy.Abs(THETA)  # symbols are real
    assert rate(3) == 0
    assert speed("theta") == rate(THETA) == rate("theta")


def test_quantities_in_the_order_of_the_core() -> None:
    expression = (
        parameter("k", 2.0) * GAP
        + variable("z")
        + variable("a") * parameter("c", 3.0)
        + direction("b", "x").dot(point("c") - point("b"))
    )
    compiled = compile_expression(expression)
    assert compiled.points == ("a", "b", "c")
    assert compiled.directions == (("b", (1.0, 0.0, 0.0)),)
    assert compiled.variables == ("a", "z")
    assert compiled.parameters == (("c", 3.0), ("k", 2.0))
    assert compiled.frames == ("a", "b", "c")
    assert not compiled.is_variable
    z = np.arange(1.0, 17.0) ** 1.1
    a, b, c, d = z[:3], z[3:6], z[6:9], z[9:12]
    wanted = z[15] * np.linalg.norm(a - b) + z[13] + z[12] * z[14] + d @ (c - b)
    assert compiled.code.tape().evaluate(z, 14, 0)[0] == pytest.approx(wanted, rel=1e-14)
    again = pickle.loads(pickle.dumps(compiled))
    assert again.code.tape().evaluate(z, 14, 0)[0] == pytest.approx(wanted, rel=1e-14)


def test_one_component_of_a_point_is_an_expression() -> None:
    compiled = compile_expression(point("a")[1])
    value, gradient, _ = compiled.code.tape().evaluate(np.array([1.0, 2.0, 3.0]), 3)
    assert value == 2.0
    assert gradient.tolist() == [0.0, 1.0, 0.0]
    assert compile_expression(THETA).is_variable


W = sympy.Symbol("w")
BROKEN: list[tuple[Any, str]] = [
    ("theta", "got the text 'theta'"),
    (sympy.Symbol("theta"), r"symbol theta stands for nothing; write variable\('theta'\)"),
    (W * THETA, "symbol w stands for nothing"),
    (sympy.oo * GAP, "found oo, expected finite numbers"),
    (THETA + sympy.nan, "found nan, expected finite"),
    (sympy.Mul(THETA, sympy.zoo, evaluate=False), "found zoo"),
    (sympy.Float("1e400") * THETA, "which is inf in double precision"),
    (THETA + sympy.I, "found I, which is not real"),
    (sympy.sqrt(-2) * THETA, "not real"),
    (sympy.acos(2) * THETA, r"acos\(2\), which is not real"),
    ((-2) ** THETA, "is not real unless the exponent is a whole number"),
    (sympy.Max(THETA, 0), "jump or a kink.*smooth function"),
    (sympy.Piecewise((THETA, THETA > 0), (0, True)), "jump or a kink"),
    (sympy.Heaviside(THETA), "jump or a kink"),
    (sympy.sign(THETA), "jump or a kink"),
    (sympy.Function("f")(THETA), r"f\(variable\('theta'\)\) \(f\) cannot be compiled"),
    (sympy.erf(THETA), r"\(erf\) cannot be compiled"),
    (sympy.Derivative(sympy.Function("f")(THETA), THETA), "cannot be compiled.*doit"),
    (point("a"), r"matrix of shape \(3, 1\), expected a scalar"),
    (THETA > 0, "expected a scalar expression"),
    (None, "expected a scalar expression"),
    ([THETA], "expected a scalar expression"),
    pytest.param(object(), "expected a scalar expression", id="object"),
    (3, "does not depend on the configuration"),
    (parameter("k", 1.0), "does not depend on the configuration"),
    (speed("theta"), "rates and inputs belong into an ExpressionForce"),
    (input_("u") * THETA, "rates and inputs belong into an ExpressionForce"),
    (parameter("k", 1) * THETA + parameter("k", 2), "parameter 'k' has the values 1.0 and 2.0"),
]


@pytest.mark.parametrize(("expression", "message"), BROKEN, ids=lambda value: str(value)[:40])
def test_broken_expressions_are_named(expression: Any, message: str) -> None:
    with pytest.raises(DescriptionError, match=f"(?s)^magnet: .*{message}"):
        compile_expression(expression, what="magnet")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: variable(""), "variable: the name"),
        (lambda: point(3), "point: the frame"),  # type: ignore[arg-type]
        (lambda: distance("a", "a"), "both ends are the frame 'a'"),
        (lambda: direction("a", "w"), "got 'w', expected 'x', 'y', 'z'"),
        (lambda: direction("a", (0, 0, 0)), "points nowhere"),
        (lambda: direction("a", (1, 2)), "got shape"),
        (lambda: parameter("k", float("inf")), "parameter 'k': got inf"),
        (lambda: parameter("k", "soft"), "parameter 'k'"),  # type: ignore[arg-type]
        (lambda: coordinate("theta"), r"write variable\('theta'\)"),
        (lambda: coordinate(point("a")), "expected a scalar expression"),
        (lambda: coordinate(object()), "expected a scalar expression"),
    ],
)
def test_broken_symbols_are_named(make: Any, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        make()


def test_a_force_is_split_into_few_coordinates() -> None:
    pull = input_("i") ** 2 / GAP**4 - parameter("c", 0.3) * rate(GAP) * (GAP**2 + 1)
    compiled = compile_force(pull, GAP)
    assert len(compiled.coordinates) == 1
    assert compiled.inputs == ("i",)
    assert compiled.parameters == (("c", 0.3),)
    # arguments: the distance, its rate, the input, the number
    d, v, i, c = 1.3, -0.4, 2.0, 0.3
    value = compiled.code.tape().evaluate(np.array([d, v, i, c]), 4, 0)[0]
    assert value == pytest.approx(i**2 / d**4 - c * v * (d**2 + 1), rel=1e-14)


FORCES = {
    "distance cubed": (1 / GAP**3, GAP, 1),
    "another distance": (1 / GAP**3 + distance("a", "c") ** -1, GAP, 2),
    "variables": (THETA * variable("x") * speed("x"), "theta", 2),
    "parts of points": (
        (point("a")[0] - point("b")[0]) * THETA + sympy.cos(point("c")[2]),
        "theta",
        3,
    ),
    "marked": (coordinate(point("a")[0] * sympy.cos(THETA)) * input_("u"), "theta", 2),
    "numbers": (parameter("k", 2.0) * (GAP - parameter("free", 0.5)), GAP, 1),
    "a plain number": (3.5, "theta", 1),
    "square of a distance": (GAP**2 + 2, point("a")[0], 2),
}


@pytest.mark.parametrize("name", FORCES)
def test_a_split_force_has_the_value_of_the_whole(name: str) -> None:
    expression, along, count = FORCES[name]
    compiled = compile_force(expression, along)
    assert len(compiled.coordinates) == count
    rng = np.random.default_rng(5)
    at: dict[Any, float] = {}

    def number(symbol: Any) -> float:
        return at.setdefault(symbol, float(rng.uniform(0.5, 2.0)))

    values = []
    for part in compiled.coordinates:
        z = [number(s) for frame in part.points for s in point(frame)]
        z += [number(variable(v)) for v in part.variables]
        values.append(part.code.tape().evaluate(np.array(z), len(z), 0)[0])
    rates = rng.uniform(0.5, 2.0, count)
    inputs = [number(input_(u)) for u in compiled.inputs]
    arguments = [*values, *rates, *inputs, *(value for _, value in compiled.parameters)]
    ours = compiled.code.tape().evaluate(np.array(arguments), len(arguments), 0)[0]

    whole = sympy.sympify(expression).subs(speed("x"), rates[-1])
    whole = whole.replace(lambda e: e.func.__name__ == "Coordinate", lambda e: e.args[0])
    for name_, value in compiled.parameters:
        whole = whole.subs(parameter(name_, value), value)
    assert ours == pytest.approx(float(whole.subs(at)), rel=1e-13)


@pytest.mark.parametrize(
    ("force", "along", "message"),
    [
        (THETA, "", "the force: along: a name is a string that is not empty"),
        (THETA, sympy.Symbol("s"), "along: the symbol s stands for nothing"),
        (THETA, 3.0, "does not depend on the configuration"),
        (THETA, speed("theta"), "rates and inputs belong"),
        (rate(input_("u")), "theta", "rates and inputs belong"),
        (rate(speed("theta")), "theta", "rates and inputs belong"),
        (W, "theta", "symbol w stands for nothing"),
        (
            parameter("k", 1.0) * coordinate(parameter("k", 2.0) * GAP),
            "theta",
            "parameter 'k' has the values",
        ),
    ],
    ids=str,
)
def test_broken_forces_are_named(force: Any, along: Any, message: str) -> None:
    with pytest.raises(DescriptionError, match=message):
        compile_force(force, along)


def test_without_sympy_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sympy", None)
    for name in list(sys.modules):
        if name == "leastaction.mechanics.expressions.symbols":
            monkeypatch.delitem(sys.modules, name)
    package = importlib.import_module("leastaction.mechanics.expressions")
    if hasattr(package, "symbols"):
        monkeypatch.delattr(package, "symbols")
    with pytest.raises(DescriptionError, match=r"pip install 'leastaction\[expressions\]'"):
        variable("theta")


def test_sympy_is_imported_by_the_first_expression_only() -> None:
    code = (
        "import sys, leastaction, leastaction.mechanics, leastaction.mechanics.expressions.terms as e\n"
        "assert 'sympy' not in sys.modules\n"
        "e.variable('x')\n"
        "assert 'sympy' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
