"""Expressions made ready for the core: what they use, in the core's order, and their instructions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import sympy

from leastaction.errors import DescriptionError, brief
from leastaction.mechanics.expressions.checks import check_expression
from leastaction.mechanics.expressions.symbols import Coordinate, MechanismSymbol, Rate
from leastaction.mechanics.expressions.tape_compiler import TapeCode, compile_tape
from leastaction.numerics.names import check_name

PLACES = ("point", "direction")


@dataclass(frozen=True, eq=False)
class CompiledExpression:
    """A scalar of the configuration as the core takes it.

    Its arguments, in this order: ``points``, frames whose origins it uses, three each; ``directions``, frames and unit
    vectors in their axes, three each; ``variables``, one each; ``parameters``, named numbers and their values, one
    each; and the time where it is ``timed``. ``code``: the instructions. ``is_variable``: whether it is a single
    variable and nothing else, which the core takes without a tape.
    """

    points: tuple[str, ...]
    directions: tuple[tuple[str, tuple[float, ...]], ...]
    variables: tuple[str, ...]
    parameters: tuple[tuple[str, float], ...]
    code: TapeCode
    is_variable: bool
    timed: bool = False

    @property
    def frames(self) -> tuple[str, ...]:
        """The frames of the points and directions, each once."""
        return tuple(dict.fromkeys([*self.points, *(frame for frame, _ in self.directions)]))


@dataclass(frozen=True, eq=False)
class CompiledForce:
    """A force along a scalar coordinate as the core takes it: the first of its ``coordinates``.

    The tape's arguments are all of these, then all their rates by what moves, then the ``inputs``, then the
    ``parameters``, which are named numbers and their values, then the time where it is ``timed``. ``code``: the
    instructions.
    """

    coordinates: tuple[CompiledExpression, ...]
    inputs: tuple[str, ...]
    parameters: tuple[tuple[str, float], ...]
    code: TapeCode
    timed: bool = False


def compile_expression(expression: Any, *, what: str = "the expression") -> CompiledExpression:
    """Compile a scalar of the configuration.

    ``expression``: in points, directions, variables, parameters and the time. ``what``: what it belongs to, for
    messages. Raises `DescriptionError` if it depends on a rate or an input or on nothing
    at all, gives a parameter two values, or cannot be compiled; see `compile_tape`.
    """
    scalar = _without_marks(check_expression(expression, what))
    for part in sympy.preorder_traversal(scalar):
        if isinstance(part, Rate) or (isinstance(part, MechanismSymbol) and part.role == "input"):
            raise DescriptionError(
                f"{what}: {brief(part)} occurs where only the configuration may; rates and inputs belong into an "
                "ExpressionForce, and a prescribed motion is a kinematic variable. Constraints on rates, such "
                "as of a wheel that rolls and steers, cannot be said (docs/beyond/not_yet.md)"
            )
    found = _by_role(scalar)
    if not (found["point"] or found["direction"] or found["variable"]):
        raise DescriptionError(
            f"{what}: {brief(scalar)} does not depend on the configuration; use point(...), direction(...), "
            "distance(...) or variable(...)"
        )
    points = tuple(dict.fromkeys(symbol.of[0] for symbol in found["point"]))
    directions = tuple(dict.fromkeys(symbol.of[:2] for symbol in found["direction"]))
    arguments = [
        *(MechanismSymbol("point", frame, axis) for frame in points for axis in range(3)),
        *(MechanismSymbol("direction", *of, axis) for of in directions for axis in range(3)),
        *found["variable"],
        *found["parameter"],
        *found["time"],
    ]
    return CompiledExpression(
        points=points,
        directions=directions,
        variables=tuple(symbol.of[0] for symbol in found["variable"]),
        parameters=_parameters(found["parameter"], what),
        code=compile_tape(scalar, arguments, what),
        is_variable=bool(found["variable"]) and scalar == found["variable"][0],
        timed=bool(found["time"]),
    )


def compile_force(expression: Any, along: Any, *, what: str = "the force") -> CompiledForce:
    """Compile a force ``f_i = F ds/dq_i`` along a scalar s of the configuration.

    ``expression``: F, in points, directions, variables, their rates, inputs, parameters and the time. ``along``: the
    scalar s, or the name of a variable. ``what``: what it belongs to, for messages. Raises `DescriptionError` as
    `compile_expression`; also for rates of what is not a scalar of the configuration.
    """
    first = along
    if isinstance(along, str):
        first = MechanismSymbol("variable", check_name(along, f"{what}: along"))
    split = _Split()
    split.symbol(_without_marks(check_expression(first, f"{what}: along")))
    scalar = check_expression(expression, what)
    # What the user marked comes first, so that the rest is written in it.
    for part in sympy.preorder_traversal(scalar):
        if isinstance(part, (Rate, Coordinate)):
            split.symbol(_without_marks(part.args[0]))
    inner = split.rewrite(scalar)
    found = _by_role(inner)
    arguments = [*split.values, *split.rates, *found["input"], *found["parameter"], *found["time"]]
    parameters = _parameters(found["parameter"], what)
    coordinates = tuple(
        compile_expression(part, what=f"{what}: coordinate {brief(part)}") for part in split.coordinates
    )
    _one_value(what, parameters, *(compiled.parameters for compiled in coordinates))
    return CompiledForce(
        coordinates=coordinates,
        inputs=tuple(symbol.of[0] for symbol in found["input"]),
        parameters=parameters,
        code=compile_tape(inner, arguments, what),
        timed=bool(found["time"]),
    )


class _Split:
    """Splits a force's expression into scalars of the configuration and a function of those."""

    def __init__(self) -> None:
        self.coordinates: list[sympy.Expr] = []
        self.values: list[sympy.Dummy] = []
        self.rates: list[sympy.Dummy] = []

    def symbol(self, part: sympy.Expr) -> sympy.Symbol:
        """Return the symbol of a coordinate, which is new unless it is there already."""
        if part not in self.coordinates:
            self.coordinates.append(part)
            self.values.append(sympy.Dummy(f"s{len(self.values)}", real=True))
            self.rates.append(sympy.Dummy(f"v{len(self.rates)}", real=True))
        return self.values[self.coordinates.index(part)]

    def rewrite(self, part: sympy.Expr) -> sympy.Expr:
        """Return the expression in coordinates, their rates, inputs and numbers."""
        if isinstance(part, Rate):
            scalar = _without_marks(part.args[0])
            by_itself = sympy.diff(scalar, MechanismSymbol("time"))
            return self.rates[self.coordinates.index(scalar)] + self.rewrite(by_itself)
        if isinstance(part, Coordinate):
            return self.symbol(_without_marks(part.args[0]))
        if part in self.coordinates or (isinstance(part, MechanismSymbol) and part.role == "variable"):
            return self.symbol(part)
        if part.is_Atom and not _is_place(part):
            return part
        if part.is_Pow and part.exp.is_number and _is_place(part.base):
            return self.root(part.base, part.exp)
        if part.is_Add or part.is_Mul:
            places = [argument for argument in part.args if self.is_new_place(argument)]
            if part.is_Mul:  # a number in a sum is not worth a coordinate of its own
                places = [place for place in places if not place.as_coeff_Add()[0]]
            others = [self.rewrite(argument) for argument in part.args if argument not in places]
            group = [self.place(part.func(*places))] if places else []
            return part.func(*others, *group)
        if part.is_Atom:
            return self.symbol(part)
        return part.func(*map(self.rewrite, part.args))

    def is_new_place(self, part: sympy.Expr) -> bool:
        """Whether a part is made of points and directions alone and holds no coordinate that is known."""
        return _is_place(part) and not any(
            node in self.coordinates or (node.is_Add and sympy.sqrt(node) in self.coordinates)
            for node in sympy.preorder_traversal(part)
            if not node.is_Atom
        )

    def place(self, part: sympy.Expr) -> sympy.Expr:
        """Return a part of points and directions in coordinates."""
        if part.is_Pow and part.exp.is_number:
            return self.root(part.base, part.exp)
        if part.is_Add and sympy.sqrt(part) in self.coordinates:
            return self.symbol(sympy.sqrt(part)) ** 2
        return self.symbol(part)

    def root(self, base: sympy.Expr, exponent: sympy.Expr) -> sympy.Expr:
        """Return a power of points: one of the root of the base, such as a distance, where that does."""
        root = sympy.sqrt(base)
        if root in self.coordinates or (2 * exponent).is_odd:
            return self.symbol(root) ** (2 * exponent)
        return self.rewrite(base) ** exponent


def _is_place(part: sympy.Expr) -> bool:
    """Whether a part holds points or directions, and apart from them numbers only."""
    symbols = part.free_symbols
    return (
        bool(symbols)
        and all(isinstance(symbol, MechanismSymbol) and symbol.role in PLACES for symbol in symbols)
        and not part.has(Rate, Coordinate)
    )


def _without_marks(part: sympy.Expr) -> sympy.Expr:
    return part.replace(Coordinate, lambda argument: argument)


def _by_role(part: sympy.Expr) -> dict[str, list[MechanismSymbol]]:
    """Return the quantities of an expression by role, in an order that is always the same."""
    roles: dict[str, list[MechanismSymbol]] = {
        role: [] for role in ("point", "direction", "variable", "input", "parameter", "time")
    }
    quantities = (symbol for symbol in part.free_symbols if isinstance(symbol, MechanismSymbol))
    for symbol in sorted(quantities, key=lambda symbol: symbol.name):
        roles[symbol.role].append(symbol)
    return roles


def _parameters(symbols: Iterable[MechanismSymbol], what: str) -> tuple[tuple[str, float], ...]:
    parameters = tuple((symbol.of[0], symbol.of[1]) for symbol in symbols)
    _one_value(what, parameters)
    return parameters


def _one_value(what: str, *groups: tuple[tuple[str, float], ...]) -> None:
    values: dict[str, float] = {}
    for name, value in (pair for group in groups for pair in group):
        if values.setdefault(name, value) != value:
            raise DescriptionError(
                f"{what}: the parameter {name!r} has the values {values[name]} and {value}; "
                "a name stands for one number, so give another name or the same value"
            )
