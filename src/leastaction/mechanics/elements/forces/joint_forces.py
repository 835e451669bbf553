"""Forces on the dynamic variables; see also `damping`, `tendons`, `wrenches` and `drag`."""

from __future__ import annotations

from dataclasses import dataclass

from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class Force(Element):
    """Base of the elements that exert a force."""


@dataclass(frozen=True)
class JointForce(Force):
    """An input straight onto a dynamic variable: ``f_i = u_j`` (N or N m).

    Parameters
    ----------
    variable : str
        The dynamic variable.
    input : str
        The input; new with this element, or shared with others of the same name.
    name : str, optional
    """

    variable: str
    input: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name(self.variable, "JointForce: variable")
        check_name(self.input, "JointForce: input")

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(dynamic=(self.variable,), inputs=(self.input,))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"force({self.variable})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.input} on {self.variable}"

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        builder.add_joint_force(context.variable(self.variable), context.input(self.input))
