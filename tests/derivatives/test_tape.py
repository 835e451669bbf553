"""Tapes against SymPy's symbolic derivatives, to third order: every operation, and random expressions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from leastaction import _core
from leastaction.errors import DescriptionError
from leastaction.mechanics.expressions.checks import FUNCTIONS, RECIPROCALS
from leastaction.mechanics.expressions.tape_compiler import compile_tape

X, Y, Z = sympy.symbols("x y z", real=True)
CODES = {name: code for code, name in enumerate(_core.Tape.operations)}

# Every operation once, as an expression that is curved in all its operands, over x, y > 0 and |x|, |y| < 1.
OPERATIONS = {
    "add": (X + Y) ** 3,
    "sub": (X - Y) ** 3,
    "mul": X * Y * (X + 2),
    "div": X / Y,
    "neg": sympy.exp(-X),
    "pow": X**2.7 * Y**-1.3,
    "sqrt": sympy.sqrt(X),
    "exp": sympy.exp(X * Y),
    "log": sympy.log(X),
    "sin": sympy.sin(3 * X),
    "cos": sympy.cos(3 * X),
    "tan": sympy.tan(X),
    "asin": sympy.asin(X),
    "acos": sympy.acos(X),
    "atan": sympy.atan(X),
    "atan2": sympy.atan2(X, Y),
    "sinh": sympy.sinh(X),
    "cosh": sympy.cosh(X),
    "tanh": sympy.tanh(X),
    "asinh": sympy.asinh(X),
    "acosh": sympy.acosh(1 + X),
    "atanh": sympy.atanh(X),
    "abs": sympy.Abs(X - 5) * Y**2 + sympy.Abs(Y) * X,
}
MORE = {
    "atan2 in every quadrant": sympy.atan2(-X, Y) + sympy.atan2(X, -Y) + sympy.atan2(-Y, -X),
    "whole powers": X**7 - 3 * Y**-5 + (X + Y) ** 11,
    "half powers": X ** sympy.Rational(3, 2) + (X**2 + Y**2) ** sympy.Rational(-3, 2) + Y**-0.5,
    "variable exponent": (1 + X) ** Y + 2**X + sympy.pi**Y,
    "polynomial": 1 - 2 * X + X**2 / 3 - 5 * X**5 + Y * X**3 - sympy.sqrt(2) * Y**2,
    "reciprocals": sum(function(X + 0.1) for function in RECIPROCALS),
    "quotients": -X / (3 * Y * (1 + X) ** 2) + 1 / (X * Y),
    "shared parts": sympy.sin(X * Y) ** 2 + sympy.cos(X * Y) * sympy.sin(X * Y) + (X * Y) ** 4,
    "negative sum": -X - Y**2 - X * Y,
    "one input": X,
    "the last input": Y,
}


def relative(ours: np.ndarray | float, theirs: np.ndarray | float) -> float:
    ours, theirs = np.asarray(ours), np.asarray(theirs, dtype=float)
    assert ours.shape == theirs.shape
    return float(np.abs(ours - theirs).max() / (1.0 + np.abs(theirs).max()))


def symbolic(expression: sympy.Expr, symbols: Sequence[sympy.Symbol], z: np.ndarray) -> list[np.ndarray]:
    """Return value, gradient, Hessian and third derivative, in more digits than are compared."""
    at = dict(zip(symbols, map(sympy.Float, z), strict=True))
    tensor = sympy.Array(expression)
    out = []
    for order in range(4):
        if order:
            tensor = sympy.derive_by_array(tensor, symbols)
        values = [float(entry.subs(at).evalf(30)) for entry in sympy.flatten(tensor)]
        out.append(np.array(values).reshape((len(symbols),) * order))
    return out


def compare(expression: sympy.Expr, symbols: Sequence[sympy.Symbol], z: np.ndarray) -> None:
    tape = compile_tape(expression, symbols, "test").tape()
    wanted = symbolic(expression, symbols, z)
    n = len(symbols)
    for order in range(3):
        results = tape.evaluate(z, n, order)
        for k in range(3):
            expected = wanted[k] if k <= order else np.zeros_like(wanted[k])
            assert relative(results[k], expected) < (1e-12, 1e-12, 1e-10)[k]
    assert np.array_equal(results[2], results[2].T)
    dz = np.linspace(-1.0, 1.3, n)
    along = tape.third(z, dz, n)
    for k in range(3):
        assert relative(along[k], wanted[k + 1] @ dz) < (1e-12, 1e-10, 1e-8)[k]


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation(name: str) -> None:
    expression = OPERATIONS[name]
    rows = compile_tape(expression, [X, Y], "test").instructions
    assert CODES[name] in rows[:, 0], "the expression does not use what it is to test"
    compare(expression, [X, Y], np.array([0.37, 0.81]))


def test_nothing_is_left_out() -> None:
    assert list(OPERATIONS) == list(_core.Tape.operations)
    assert set(FUNCTIONS.values()) <= set(OPERATIONS)


@pytest.mark.parametrize("name", MORE)
def test_expressions(name: str) -> None:
    compare(MORE[name], [X, Y], np.array([0.37, 0.81]))


def test_absolute_value_below_zero_and_at_zero() -> None:
    tape = compile_tape(sympy.Abs(X) * Y, [X, Y], "test").tape()
    value, gradient, hessian = tape.evaluate(np.array([-0.3, 2.0]), 2)
    assert value == pytest.approx(0.6, rel=1e-15)
    assert gradient.tolist() == pytest.approx([-2.0, 0.3], rel=1e-15)
    assert hessian.tolist() == [[0.0, -1.0], [-1.0, 0.0]]
    assert tape.evaluate(np.array([0.0, 2.0]), 2)[1].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("m", [0, 1, 2, 3])
def test_derivatives_by_the_first_inputs_only(m: int) -> None:
    expression = sympy.sin(X * Z) * Y**2 + Z / (X + Y) + sympy.atan2(Z, X) + Z**3
    z, dz = np.array([0.4, 0.7, 1.1]), np.array([0.5, -0.2, 0.8])
    tape = compile_tape(expression, [X, Y, Z], "test").tape()
    wanted = symbolic(expression, [X, Y, Z], z)
    _, gradient, hessian = tape.evaluate(z, m)
    assert gradient.shape == (m,)
    assert np.allclose(gradient, wanted[1][:m], rtol=1e-13, atol=0)
    assert np.allclose(hessian, wanted[2][:m, :m], rtol=1e-12, atol=1e-13)
    # The direction of the third order may lead along the other inputs too: derivatives by numbers.
    along = tape.third(z, dz, m)
    assert along[0] == pytest.approx(wanted[1] @ dz, rel=1e-12)
    assert np.allclose(along[1], (wanted[2] @ dz)[:m], rtol=1e-12, atol=1e-13)
    assert np.allclose(along[2], (wanted[3] @ dz)[:m, :m], rtol=1e-11, atol=1e-12)


UNARY = [
    sympy.sin,
    sympy.cos,
    sympy.tanh,
    sympy.atan,
    sympy.asinh,
    lambda x: sympy.exp(x / 3),
    lambda x: sympy.sqrt(1 + x**2),
    lambda x: sympy.log(2 + x**2),
    lambda x: (1 + x**2) ** sympy.Rational(-3, 2),
    lambda x: -x,
    lambda x: x**3,
]
BINARY = [
    lambda x, y: x + y,
    lambda x, y: x - y,
    lambda x, y: x * y,
    lambda x, y: x / (2 + y**2),
    lambda x, y: sympy.atan2(x, 3 + y**2),
]
LEAVES = st.one_of(
    st.sampled_from([X, Y, Z]),
    st.floats(0.2, 2.0).map(lambda x: sympy.Float(round(x, 3))),
    st.integers(1, 3).map(lambda n: sympy.Rational(n, 3)),
)
EXPRESSIONS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(lambda f, x: f(x), st.sampled_from(UNARY), inner),
        st.builds(lambda f, x, y: f(x, y), st.sampled_from(BINARY), inner, inner),
    ),
    max_leaves=6,
)


@settings(max_examples=60)
@given(EXPRESSIONS)
def test_random_expressions(expression: sympy.Expr) -> None:
    compare(sympy.sympify(expression), [X, Y, Z], np.array([0.43, -0.62, 0.91]))


def test_whatever_is_not_finite_is_passed_on() -> None:
    tape = compile_tape(sympy.log(X) + sympy.sqrt(Y), [X, Y], "test").tape()
    value, gradient, hessian = tape.evaluate(np.array([-1.0, 1.0]), 2)
    assert np.isnan(value)
    assert gradient[1] == 0.5
    assert hessian[1, 1] == -0.25
    assert tape.evaluate(np.array([0.0, 1.0]), 2)[0] == -np.inf
    assert np.isnan(tape.evaluate(np.array([np.nan, 1.0]), 2)[0])


def test_scale_is_that_of_the_terms_that_cancel() -> None:
    for expression, z, scale in (
        (X - Y, [3.0, 3.0], 3.0),
        (2 * X - 6 * Y, [3.0, 1.0], 6.0),
        (sympy.cos(X) - sympy.cos(Y), [0.0, 0.0], 1.0),  # where no input changes the value
        (5 * (1 - sympy.cos(X)) + Y, [0.0, 0.0], 5.0),
        (sympy.sqrt(X**2 + Y**2) - 500, [300.0, 400.0], 500.0),
        (X * Y, [0.0, 0.0], 0.0),
    ):
        tape = compile_tape(expression, [X, Y], "test").tape()
        assert tape.scale(np.array(z), 2) == pytest.approx(scale, rel=1e-12)


def test_the_same_is_computed_once() -> None:
    part = sympy.sqrt((X - Y) ** 2 + Z**2)
    once = len(compile_tape(part, [X, Y, Z], "test").instructions)
    twice = compile_tape(part + sympy.exp(-part) / part**3, [X, Y, Z], "test").instructions
    assert once == 5
    assert len(twice) == once + 6  # two products, neg, exp, quotient, sum


def test_polynomials_take_one_product_a_degree() -> None:
    code = compile_tape(sum((k + 2) * X**k for k in range(7)), [X], "test")
    operations = np.bincount(code.instructions[:, 0], minlength=4)
    assert operations[CODES["mul"]] == 6
    assert operations[CODES["add"]] == 6
    assert operations.sum() == 12


def test_numbers_are_worked_out_beforehand() -> None:
    code = compile_tape(sympy.pi**2 * sympy.sqrt(2) * X * sympy.exp(1), [X], "test")
    assert len(code.instructions) == 1
    assert code.constants.tolist() == [float((sympy.pi**2 * sympy.sqrt(2) * sympy.E).evalf(20))]


@pytest.mark.parametrize("wrong", [sympy.Symbol("w"), X * Y, sympy.Function("f")(X)])
def test_symbols_and_functions_that_are_no_arguments(wrong: sympy.Expr) -> None:
    with pytest.raises(DescriptionError, match=r"curve: .*(stands for nothing|cannot be compiled)"):
        compile_tape(wrong, [X], "curve")


def tape(n: int, rows: list[list[int]], constants: Sequence[float] = ()) -> _core.Tape:
    return _core.Tape(n, np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(constants, dtype=float))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1, [[len(CODES), 0, 0]]), "unknown operation 23"),
        ((1, [[-1, 0, 0]]), "unknown operation -1"),
        ((1, [[0, 0, 1]]), "add of value 1; expected a value before its own, 0 to 0"),
        ((1, [[0, -1, 0]]), "add of value -1"),
        ((1, [[9, 0, 0], [9, 2, 2]]), "instruction 1 of the tape: sin of value 2"),
        ((2, [[CODES["pow"], 0, 1]]), "the exponent of pow is value 1, which is no constant"),
        ((1, [[2**40, 0, 0]]), "no operation and no value"),
        ((-1, [[0, 0, 0]]), "number of inputs is negative"),
        ((0, []), "no result"),
    ],
)
def test_broken_tapes_are_refused(arguments: tuple[int, list[list[int]]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        tape(*arguments)


def test_arguments_of_a_tape_are_checked() -> None:
    sine = tape(1, [[CODES["sin"], 0, 0]])
    assert sine.n_inputs == 1
    for wrong, message in (
        ((np.zeros(2), 1), "z: got length 2, expected 1"),
        ((np.zeros(1), 2), "m: got 2, expected 0 to 1"),
        ((np.zeros(1), 1, 3), "order: got 3"),
    ):
        with pytest.raises(ValueError, match=message):
            sine.evaluate(*wrong)
    with pytest.raises(ValueError, match="expected 3"):
        _core.Tape(1, np.zeros((1, 2), dtype=np.int64), np.zeros(0))


def test_a_tape_without_instructions_is_its_last_value() -> None:
    assert tape(1, [], [4.0]).evaluate(np.array([7.0]), 1)[0] == 4.0
    value, gradient, _ = tape(2, []).evaluate(np.array([7.0, 8.0]), 2)
    assert (value, gradient.tolist()) == (8.0, [0.0, 1.0])
