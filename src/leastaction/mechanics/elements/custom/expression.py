"""Elements that the user writes as expressions: potentials, constraints and forces of any form.

See `leastaction.mechanics.expressions.terms` for what expressions are made of.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from leastaction.mechanics.elements.base import Context, Uses
from leastaction.mechanics.elements.builder import Builder
from leastaction.mechanics.elements.constraints.distances import Constraint
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.potentials.gravity import Potential
from leastaction.mechanics.expressions.terms import compile_expression, compile_force

if TYPE_CHECKING:
    import sympy

    from leastaction.mechanics.expressions.compiled import CompiledExpression, CompiledForce


@dataclass(frozen=True)
class ExpressionPotential(Potential):
    """A potential energy of the user's own: ``V`` (J) as an expression.

    Parameters
    ----------
    expression : sympy.Expr
        V in points, directions, distances, variables and parameters; see `leastaction.mechanics.expressions.terms`.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the expression cannot be compiled; the message names the part.
    """

    expression: sympy.Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.compiled  # so that an expression that cannot be compiled is an error here

    @cached_property
    def compiled(self) -> CompiledExpression:
        """The expression as the core takes it."""
        return compile_expression(self.expression, what=self.title)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=self.compiled.frames, variables=self.compiled.variables)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"potential({_names(self.uses)})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return _brief(self.expression)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = _slots(self, self.compiled.parameters, builder, context)
        builder.add_potential(_coordinate(self.compiled, slots, builder, context))


@dataclass(frozen=True)
class ExpressionConstraint(Constraint):
    """A holonomic constraint of the user's own: ``h(q) = 0`` with h as an expression.

    Parameters
    ----------
    expression : sympy.Expr
        h, which the motion keeps at zero; scaled like a length or an angle. In points, directions, distances,
        variables and parameters; see `leastaction.mechanics.expressions.terms`.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the expression cannot be compiled, or no dynamic variable changes it.
    """

    expression: sympy.Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.compiled  # so that an expression that cannot be compiled is an error here

    @cached_property
    def compiled(self) -> CompiledExpression:
        """The expression as the core takes it."""
        return compile_expression(self.expression, what=self.title)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=self.compiled.frames, variables=self.compiled.variables)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"constraint({_names(self.uses)})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{_brief(self.expression)} = 0"

    def check(self, context: Context) -> None:
        """Check names, and that something can keep the constraint; see `Element.check`."""
        super().check(context)
        self.check_some_dynamic(
            context,
            movers(self.compiled.frames, self.compiled.variables, context),
            "no dynamic variable changes the expression, so nothing can keep it at zero; remove the "
            "constraint or use other frames and variables",
        )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = _slots(self, self.compiled.parameters, builder, context)
        builder.add_constraint(_coordinate(self.compiled, slots, builder, context))


@dataclass(frozen=True)
class ExpressionForce(Force):
    """A force of the user's own along a scalar of the configuration: ``f_i = F ds/dq_i``.

    Parameters
    ----------
    expression : sympy.Expr or float
        F (N along a length, N m along an angle) in points, directions, distances, variables, their rates,
        inputs and parameters; see `leastaction.mechanics.expressions.terms`.
    along : str or sympy.Expr
        The name of a variable, or a scalar expression s such as a distance. F is positive where it drives s up.
    name : str, optional

    Raises
    ------
    DescriptionError
        If an expression cannot be compiled, or no dynamic variable changes the one that the force acts along.
    """

    expression: sympy.Expr | float
    along: str | sympy.Expr

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.compiled  # so that an expression that cannot be compiled is an error here

    @cached_property
    def compiled(self) -> CompiledForce:
        """The force as the core takes it."""
        return compile_force(self.expression, self.along, what=self.title)

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        parts = self.compiled.coordinates
        return Uses(
            frames=tuple(dict.fromkeys(frame for part in parts for frame in part.frames)),
            variables=tuple(dict.fromkeys(name for part in parts for name in part.variables)),
            inputs=self.compiled.inputs,
        )

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"force({self.along if isinstance(self.along, str) else _names(self.uses)})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{_brief(self.expression)} along {_brief(self.along)}"

    def check(self, context: Context) -> None:
        """Check names, and that the force acts on something; see `Element.check`."""
        super().check(context)
        first = self.compiled.coordinates[0]
        self.check_some_dynamic(
            context,
            movers(first.frames, first.variables, context),
            f"no dynamic variable changes {_brief(self.along)}, so a force along it does nothing; choose "
            "another one",
        )

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        force = self.compiled
        named = dict.fromkeys(force.parameters)
        for part in force.coordinates:
            named.update(dict.fromkeys(part.parameters))
        slots = _slots(self, named, builder, context)
        builder.add_tape_force(
            [_coordinate(part, slots, builder, context) for part in force.coordinates],
            [context.input(name) for name in force.inputs],
            force.code.tape(),
            [slots[name] for name, _ in force.parameters],
        )


def movers(frames: Iterable[str], variables: Iterable[str], context: Context) -> set[str]:
    """Return the variables that something of these frames and variables may depend on."""
    return {*variables, *(name for frame in frames for name in context.moving(frame))}


def _slots(
    element: ExpressionPotential | ExpressionConstraint | ExpressionForce,
    parameters: Iterable[tuple[str, float]],
    builder: Builder,
    context: Context,
) -> dict[str, int]:
    return {name: context.parameter(builder, element, name, value) for name, value in parameters}


def _coordinate(
    compiled: CompiledExpression, slots: dict[str, int], builder: Builder, context: Context
) -> int:
    variables = [context.variable(name) for name in compiled.variables]
    if compiled.is_variable:
        return builder.variables_coordinate(variables, [context.constant(builder, 1.0)])
    return builder.tape_coordinate(
        [context.point(builder, frame) for frame in compiled.points],
        [context.direction(builder, frame, vector) for frame, vector in compiled.directions],
        variables,
        compiled.code.tape(),
        [slots[name] for name, _ in compiled.parameters],
    )


def _names(uses: Uses) -> str:
    return ", ".join((*uses.frames, *uses.variables))


def _brief(expression: object) -> str:
    text = str(expression)
    return text if len(text) <= 60 else f"{text[:57]}..."
