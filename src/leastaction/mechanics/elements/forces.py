"""Forces: generalised forces on the dynamic variables, with or without an input."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from leastaction.errors import DescriptionError
from leastaction.mechanics.arguments import as_number
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.frames import check_name


@dataclass(frozen=True)
class Force(Element):
    """Base of the elements that exert a force."""


@dataclass(frozen=True)
class Damping(Force):
    """Linear damping of the dynamic variables: ``f_i = -c_i v_i``.

    Parameters
    ----------
    coefficients : float or mapping of str to float
        The coefficient of every dynamic variable, or of those that are named (N s/m or N m s/rad).
    default : float, optional
        The coefficient of the dynamic variables that are not named.
    name : str, optional

    Raises
    ------
    DescriptionError
        If a coefficient is negative or not finite.
    """

    coefficients: float | Mapping[str, float]
    default: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.coefficients, Mapping):
            named = {
                check_name(name, "Damping: a variable's name"): _coefficient(value, name)
                for name, value in self.coefficients.items()
            }
            object.__setattr__(self, "coefficients", _Named(named))
            object.__setattr__(self, "default", _coefficient(self.default, "default"))
        else:
            value = _coefficient(self.coefficients, "coefficients")
            object.__setattr__(self, "coefficients", _Named({}))
            object.__setattr__(self, "default", value)

    @property
    def named(self) -> Mapping[str, float]:
        """The coefficients that were given by name; `default` holds for the other variables."""
        assert isinstance(self.coefficients, Mapping)
        return self.coefficients

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(dynamic=tuple(self.named))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return "damping"

    def describe(self) -> str:
        """Return the values in a few words."""
        parts = [f"{name} {value:g}" for name, value in self.named.items()]
        if self.default or not parts:
            parts.append(f"{'others' if parts else 'every dynamic variable'} {self.default:g}")
        return ", ".join(parts)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        for index, name in enumerate(context.dynamic):
            coefficient = self.named.get(name, self.default)
            if coefficient != 0.0:
                builder.add_damping(index, coefficient)


class _Named(dict[str, float]):
    """Coefficients by name that can be hashed, as the fields of a frozen element must be."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


def _coefficient(value: object, name: str) -> float:
    number = as_number(value, f"Damping: {name}", error=DescriptionError)
    if number < 0.0:
        raise DescriptionError(
            f"Damping: {name} has the coefficient {number}; expected zero or more, as damping opposes "
            "the motion"
        )
    return number


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
