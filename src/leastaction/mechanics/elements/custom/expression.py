"""Elements that the user writes as expressions: potentials, constraints and forces of any form.

See `leastaction.mechanics.expressions.terms` for what expressions are made of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from leastaction.errors import brief
from leastaction.mechanics.elements.base import Constraint, Element, Force, Potential
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.context import Context
from leastaction.mechanics.elements.kinds import Uses
from leastaction.mechanics.expressions.terms import symbols
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

if TYPE_CHECKING:
    import sympy

    from leastaction.mechanics.expressions.compiled import CompiledExpression, CompiledForce
    from leastaction.mechanics.expressions.cords import ExpressionCord


class _ScalarExpression(Element):
    """An element that is one scalar expression of the user's."""

    expression: sympy.Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.compiled  # so that an expression that cannot be compiled is an error here

    @cached_property
    def compiled(self) -> CompiledExpression:
        """The expression as the core takes it."""
        symbols()  # or say that SymPy is needed
        from leastaction.mechanics.expressions.compiled import compile_expression

        return compile_expression(self.expression, what=self.title)

    @cached_property
    def cord(self) -> ExpressionCord | None:
        """The expression as a cord."""
        from leastaction.mechanics.expressions.cords import cord_of

        return cord_of(self.expression)

    def slope(self, pieces: Mapping[tuple[str, str], Array], values: Mapping[str, Array | float]) -> Array | None:
        """The slope of the expression by distances, where it is one of distances alone."""
        cord = self.cord
        return None if cord is None else cord.by_lengths(np.array([pieces[pair] for pair in cord.pieces]), values)

    @property
    def uses(self) -> Uses:
        return Uses(frames=self.compiled.frames, variables=self.compiled.variables)


@public
@dataclass(frozen=True)
class ExpressionPotential(_ScalarExpression, Potential):
    """A potential energy of the user's own: ``V`` (J) as an expression.

    Parameters
    ----------
    expression : sympy.Expr
        V in points, directions, distances, variables, parameters and the time; see
        `leastaction.mechanics.expressions.terms`.

    Raises
    ------
    DescriptionError
        If the expression cannot be compiled; the message names the part.
    """

    expression: sympy.Expr

    called = "potential"

    def describe(self) -> str:
        return brief(self.expression)

    def add_to(self, core: Compiler) -> None:
        core.potential(_scalar(self.compiled, core))


@public
@dataclass(frozen=True)
class ExpressionConstraint(_ScalarExpression, Constraint):
    """A holonomic constraint of the user's own: ``h(q, t) = 0`` with h as an expression.

    Parameters
    ----------
    expression : sympy.Expr
        h, which the motion keeps at zero; scaled like a length or an angle. In points, directions, distances,
        variables, parameters and the time; see `leastaction.mechanics.expressions.terms`.

    Raises
    ------
    DescriptionError
        If the expression cannot be compiled, or no dynamic variable changes it.
    """

    expression: sympy.Expr

    called = "constraint"

    def describe(self) -> str:
        return f"{brief(self.expression)} = 0"

    def check(self, context: Context) -> None:
        super().check(context)
        self.check_moved(
            context,
            context.behind(self.compiled.frames, self.compiled.variables),
            "changes the expression, so nothing can keep it at zero; remove the constraint or use other "
            "frames and variables",
        )

    def add_to(self, core: Compiler) -> None:
        core.constraint(_scalar(self.compiled, core))


@public
@dataclass(frozen=True)
class ExpressionForce(Force):
    """A force of the user's own along a scalar of the configuration: ``f_i = F ds/dq_i``.

    Parameters
    ----------
    expression : sympy.Expr or float
        F (N along a length, N m along an angle) in points, directions, distances, variables, their rates,
        inputs, parameters and the time; see `leastaction.mechanics.expressions.terms`.
    along : str or sympy.Expr
        The name of a variable, or a scalar expression s such as a distance, of the time too. F is positive where it
        drives s up.

    Raises
    ------
    DescriptionError
        If an expression cannot be compiled, or no dynamic variable changes the one that the force acts along.
    """

    expression: sympy.Expr | float
    along: str | sympy.Expr

    called = "force"
    needs_dynamic = True

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.compiled  # so that an expression that cannot be compiled is an error here

    @cached_property
    def compiled(self) -> CompiledForce:
        """The force as the core takes it."""
        symbols()  # or say that SymPy is needed
        from leastaction.mechanics.expressions.compiled import compile_force

        return compile_force(self.expression, self.along, what=self.title)

    @property
    def uses(self) -> Uses:
        parts = [Uses(part.frames, variables=part.variables) for part in self.compiled.coordinates]
        return sum(parts, Uses(inputs=self.compiled.inputs))

    @property
    def default_name(self) -> str:
        return f"force({self.along})" if isinstance(self.along, str) else super().default_name

    def describe(self) -> str:
        return f"{brief(self.expression)} along {brief(self.along)}"

    def check(self, context: Context) -> None:
        super().check(context)
        first = self.compiled.coordinates[0]
        self.check_moved(
            context,
            context.behind(first.frames, first.variables),
            f"changes {brief(self.along)}, so a force along it does nothing; choose another one",
        )

    def add_to(self, core: Compiler) -> None:
        force = self.compiled
        named = dict(force.parameters)
        for part in force.coordinates:
            named.update(part.parameters)
        slots = {name: core.parameter(name, value) for name, value in named.items()}
        coordinates = [_coordinate(part, slots, core) for part in force.coordinates]
        own = [*(slots[name] for name, _ in force.parameters), *core.time(force.timed)]
        core.tape_force(coordinates, force.inputs, force.code.tape(), own)


def _scalar(compiled: CompiledExpression, core: Compiler) -> int:
    """Add the coordinate that an expression is, with its parameters."""
    return _coordinate(compiled, {name: core.parameter(name, value) for name, value in compiled.parameters}, core)


def _coordinate(compiled: CompiledExpression, slots: Mapping[str, int], core: Compiler) -> int:
    if compiled.is_variable:
        return core.sum(compiled.variables[0])
    return core.builder.tape_coordinate(
        [core.point(frame) for frame in compiled.points],
        [core.direction(frame, vector) for frame, vector in compiled.directions],
        [core.variable(name) for name in compiled.variables],
        compiled.code.tape(),
        [*(slots[name] for name, _ in compiled.parameters), *core.time(compiled.timed)],
    )
