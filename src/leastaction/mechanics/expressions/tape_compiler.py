"""From a SymPy expression to the instructions of a tape.

Common subexpressions are computed once, polynomials by Horner's scheme, whole powers by multiplications,
and everything that is a number is worked out here, in more digits than a double holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from leastaction import _core
from leastaction.errors import DescriptionError, brief
from leastaction.mechanics.expressions.checks import FUNCTIONS, RECIPROCALS, check_expression

CODES = {name: code for code, name in enumerate(_core.Tape.operations)}

DIGITS = 20


@dataclass(frozen=True, eq=False)
class TapeCode:
    """The arguments of `_core.Tape`; plain arrays, so it can be pickled.

    ``n_inputs``: number of arguments. ``instructions`` (n, 3): operation and two operands each; values are numbered
    arguments first, then constants, then results. ``constants`` (k,).
    """

    n_inputs: int
    instructions: NDArray[np.int64]
    constants: NDArray[np.float64]

    def __post_init__(self) -> None:
        self.instructions.setflags(write=False)
        self.constants.setflags(write=False)

    def __reduce__(self) -> tuple[Any, ...]:
        # Made anew, so that the arrays are read-only again.
        return TapeCode, (self.n_inputs, self.instructions, self.constants)

    def tape(self) -> _core.Tape:
        """Return the tape."""
        return _core.Tape(self.n_inputs, self.instructions, self.constants)


def compile_tape(expression: Any, arguments: Sequence[sympy.Symbol], what: str) -> TapeCode:
    """Compile a scalar expression in the arguments.

    ``arguments``: the inputs of the tape in their order; other symbols in the expression are an error. ``what``: what
    the expression belongs to, for messages. Raises `DescriptionError` for anything that is not real, finite and smooth;
    see `check_expression`.
    """
    scalar = check_expression(expression, what, allowed=arguments)
    parts, (final,) = sympy.cse(_horner(scalar), symbols=sympy.numbered_symbols(cls=sympy.Dummy))
    emitter = _Emitter(what, {symbol: place for place, symbol in enumerate(arguments)})
    for symbol, part in parts:
        emitter.known[symbol] = emitter.visit(part)
    return emitter.finish(emitter.visit(final))


def _horner(expression: sympy.Expr) -> sympy.Expr:
    """Return the expression with sums of powers of one symbol nested: x*(a*x + b) + c."""
    if expression.is_Atom:
        return expression
    if expression.is_Add:
        symbol = _polynomial_in(expression)
        if symbol is not None:
            by_power: dict[int, sympy.Expr] = {}
            for term in expression.args:
                power, rest = _power_of(symbol, term)
                by_power[power] = by_power.get(power, sympy.Integer(0)) + rest
            powers = sorted(by_power, reverse=True)
            nested = _horner(by_power[powers[0]])
            for higher, lower in zip(powers, [*powers[1:], 0], strict=True):
                nested = nested * symbol ** (higher - lower)
                if lower in powers[1:] and higher > lower:
                    nested = nested + _horner(by_power[lower])
            return nested
    return expression.func(*map(_horner, expression.args))


def _polynomial_in(total: sympy.Expr) -> sympy.Symbol | None:
    """Return the symbol of which the terms of a sum hold the most different whole powers, if two or more."""
    powers: dict[sympy.Symbol, set[int]] = {}
    for term in total.args:
        for factor in sympy.Mul.make_args(term):
            base, power = factor.as_base_exp()
            if base.is_Symbol and power.is_Integer and power > 0:
                powers.setdefault(base, set()).add(int(power))
    best = max(powers, key=lambda symbol: (len(powers[symbol]), symbol.name), default=None)
    return best if best is not None and len(powers[best]) > 1 else None


def _power_of(symbol: sympy.Symbol, term: sympy.Expr) -> tuple[int, sympy.Expr]:
    for factor in sympy.Mul.make_args(term):
        base, power = factor.as_base_exp()
        if base == symbol and power.is_Integer and power > 0:
            return int(power), term / factor
    return 0, term


@dataclass
class _Emitter:
    """Makes instructions; a value is an argument (0, 1, ...), a constant (-1, -2, ...) or a result."""

    what: str
    known: dict[sympy.Expr, int]
    constants: list[float] = field(default_factory=list)
    rows: list[tuple[int, int, int]] = field(default_factory=list)
    made: dict[tuple[int, int, int], int] = field(default_factory=dict)
    n_inputs: int = field(init=False)

    def __post_init__(self) -> None:
        self.n_inputs = len(self.known)

    def finish(self, result: int) -> TapeCode:
        if result != self.n_inputs + len(self.rows) - 1 or not self.rows:
            # The result is the last value: one that is an argument or a constant is made again.
            self.made.clear()
            self.emit("add", result, self.constant(0.0))
        shift = len(self.constants)

        def place(value: int) -> int:
            if value < 0:
                return self.n_inputs - 1 - value
            return value if value < self.n_inputs else value + shift

        rows = [(code, place(a), place(b)) for code, a, b in self.rows]
        return TapeCode(
            self.n_inputs, np.array(rows, dtype=np.int64).reshape(-1, 3), np.array(self.constants, dtype=np.float64)
        )

    def emit(self, name: str, a: int, b: int | None = None) -> int:
        second = a if b is None else b
        if name in ("add", "mul") and a > second:
            a, second = second, a
        row = (CODES[name], a, second)
        if row not in self.made:
            self.rows.append(row)
            self.made[row] = self.n_inputs + len(self.rows) - 1
        return self.made[row]

    def constant(self, value: float) -> int:
        if value not in self.constants:
            self.constants.append(value)
        return -1 - self.constants.index(value)

    def number(self, expression: sympy.Expr) -> float:
        value = complex(expression.evalf(DIGITS))
        if abs(value.imag) > 1e-15 * abs(value):  # less is rounding, as in roots of cubics
            raise DescriptionError(f"{self.what}: found {brief(expression)}, which is not real; expected real numbers")
        if not np.isfinite(value.real):
            raise DescriptionError(
                f"{self.what}: found {brief(expression)}, which is {value.real} in double precision; "
                "expected finite numbers"
            )
        return value.real

    def visit(self, expression: sympy.Expr) -> int:
        if expression not in self.known:
            self.known[expression] = self.make(expression)
        return self.known[expression]

    def make(self, expression: sympy.Expr) -> int:
        if expression.is_number:
            return self.constant(self.number(expression))
        if expression.is_Add:
            return self.make_sum(expression)
        if expression.is_Mul:
            return self.make_product(expression)
        if expression.is_Pow:
            return self.make_power(*expression.args)
        operands = [self.visit(argument) for argument in expression.args]
        if type(expression) in RECIPROCALS:
            return self.emit("div", self.constant(1.0), self.emit(RECIPROCALS[type(expression)], *operands))
        return self.emit(FUNCTIONS[type(expression)], *operands)

    def make_sum(self, total: sympy.Expr) -> int:
        numbers = [term for term in total.args if term.is_number]
        positive: list[sympy.Expr] = []
        negative: list[sympy.Expr] = []
        for term in total.args:
            if not term.is_number:
                (negative if term.as_coeff_Mul()[0].is_negative else positive).append(term)
        values = [self.visit(term) for term in positive]
        if numbers:
            values.insert(0, self.constant(self.number(sympy.Add(*numbers))))
        if not values:
            values.append(self.emit("neg", self.visit(-negative.pop())))
        result = values[0]
        for value in values[1:]:
            result = self.emit("add", result, value)
        for term in negative:
            result = self.emit("sub", result, self.visit(-term))
        return result

    def make_product(self, product: sympy.Expr) -> int:
        coefficient = self.number(sympy.Mul(*[f for f in product.args if f.is_number]))
        above, below = [], []
        for factor in product.args:
            if factor.is_number:
                continue
            base, power = factor.as_base_exp() if factor.is_Pow else (factor, sympy.Integer(1))
            if power.is_number and power.is_negative:
                below.append(self.divisor(base, -power))
            else:
                above.append(self.visit(factor))
        negate = coefficient == -1.0
        if abs(coefficient) != 1.0 or not above:
            above.insert(0, self.constant(coefficient))
            negate = False
        result = self.product_of(above)
        if below:
            result = self.emit("div", result, self.product_of(below))
        return self.emit("neg", result) if negate else result

    def product_of(self, values: Sequence[int]) -> int:
        result = values[0]
        for value in values[1:]:
            result = self.emit("mul", result, value)
        return result

    def make_power(self, base: sympy.Expr, exponent: sympy.Expr) -> int:
        if not exponent.is_number:
            # The base must be positive; where it is not, the result is no number, as that of log is.
            if base.is_number and not base.is_positive:
                raise DescriptionError(
                    f"{self.what}: {base}**({brief(exponent)}) is not real unless the exponent is a whole number; "
                    "give a positive base"
                )
            return self.emit("exp", self.visit(exponent * sympy.log(base)))
        power = self.number(exponent)
        if power < 0.0:
            return self.emit("div", self.constant(1.0), self.divisor(base, -exponent))
        if power == 0.5:
            return self.emit("sqrt", self.visit(base))
        if power.is_integer():
            return self.whole_power(self.visit(base), int(power))
        return self.emit("pow", self.visit(base), self.constant(power))

    def divisor(self, base: sympy.Expr, exponent: sympy.Expr) -> int:
        twice = 2.0 * self.number(exponent)
        if twice.is_integer() and twice % 2.0 == 1.0:
            # Faster than pow, and as one divides by it, zero is no place where this could be worse.
            return self.whole_power(self.visit(sympy.sqrt(base)), int(twice))
        return self.visit(base**exponent)

    def whole_power(self, base: int, power: int) -> int:
        if power == 0:
            return self.constant(1.0)
        result, square = None, base
        while True:
            if power % 2:
                result = square if result is None else self.emit("mul", result, square)
            power //= 2
            if not power:
                break
            square = self.emit("mul", square, square)
        assert result is not None
        return result
