"""Forces that take energy: damping and friction of joints, dampers between frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.along import FramePair
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.reading import Factors, number, positive
from leastaction.numerics.names import check_name


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

    Notes
    -----
    The parameters are ``"damping.<variable>"``.
    """

    coefficients: float | Mapping[str, float]
    default: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.coefficients, Mapping):
            named = {
                check_name(name, f"{self.title}: a variable's name"): self._coefficient(value, name)
                for name, value in self.coefficients.items()
            }
            object.__setattr__(self, "coefficients", Factors(named))
            object.__setattr__(self, "default", self._coefficient(self.default, "the others"))
        else:
            value = self._coefficient(self.coefficients, "every variable")
            if self.default != 0.0:
                raise DescriptionError(
                    f"{self.title}: default: got {self.default!r} together with one coefficient for every "
                    "variable; give a mapping of names to coefficients, or leave it out"
                )
            object.__setattr__(self, "coefficients", Factors({}))
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

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        return replace(self, coefficients={**self.named, parameter: value})

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        for index, name in enumerate(context.dynamic):
            # A zero that was written is a parameter; one that was left out is no damping.
            if name in self.named or self.default != 0.0:
                slot = builder.add_damping(index, self.named.get(name, self.default))
                context.record(self, name, slot)

    def _coefficient(self, value: object, name: str) -> float:
        what = f"{self.title}: the coefficient of {name}"
        return positive(value, what, "as damping opposes the motion", zero=True)


@dataclass(frozen=True)
class OnVariable(Force):
    """Base of the forces on one dynamic variable that depend on its velocity.

    Parameters
    ----------
    variable : str
        The dynamic variable.
    name : str, optional
    """

    variable: str

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name(self.variable, f"{self.title}: variable")

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(dynamic=(self.variable,))

    def oppose(self, builder: Builder, context: Context, kind: str, slots: Sequence[int]) -> None:
        """Add the force ``-law(v)`` of a kind with its numbers."""
        one, minus = context.constant(builder, 1.0), context.constant(builder, -1.0)
        coordinate = builder.variables_coordinate([context.variable(self.variable)], [one])
        builder.add_force(coordinate, minus, -1, -1, builder.law(kind, slots))


@dataclass(frozen=True)
class NonlinearDamping(OnVariable):
    """Damping by odd powers of the velocity: ``f = -(c1 v + c3 v^3 + c5 v^5 + ...)``.

    Parameters
    ----------
    variable : str
        The dynamic variable.
    coefficients : sequence of float
        c1, c3, c5, ... (N s/m, N s^3/m^3, ... or with N m and rad). Some may be negative, as in an oscillator
        that excites itself; the last is positive, so that fast motion is opposed.
    name : str, optional

    Raises
    ------
    DescriptionError
        If there are no coefficients or more than eight, or the last is not positive.

    Notes
    -----
    The parameters are ``"nonlinear_damping.c1"`` and so on.
    """

    coefficients: Sequence[float]

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"{self.title}: coefficients"
        given: object = self.coefficients
        text = isinstance(given, (str, bytes))
        if text or not isinstance(given, Sequence) or not 1 <= len(given) <= 8:
            raise DescriptionError(
                f"{what}: expected a list of one to eight numbers c1, c3, c5, ..., got {given!r}"
            )
        values = tuple(number(value, f"{what}: c{2 * i + 1}") for i, value in enumerate(given))
        positive(
            values[-1], f"{what}: c{2 * len(values) - 1}", "as the last one opposes fast motion"
        )
        object.__setattr__(self, "coefficients", values)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"nonlinear_damping({self.variable})"

    def describe(self) -> str:
        """Return the values in a few words."""
        terms = [f"c{2 * i + 1} {value:g}" for i, value in enumerate(self.coefficients)]
        return f"{self.variable}, {', '.join(terms)}"

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        values = list(self.coefficients)
        values[int(parameter.removeprefix("c")) // 2] = value
        return replace(self, coefficients=tuple(values))

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = []
        for i, value in enumerate(self.coefficients):
            slots.append(context.constant(builder, 0.0))
            slots.append(context.parameter(builder, self, f"c{2 * i + 1}", value))
        self.oppose(builder, context, "polynomial", slots)


@dataclass(frozen=True)
class CoulombFriction(OnVariable):
    """Dry friction, smoothed: ``f = -F tanh(v / v0)``.

    Parameters
    ----------
    variable : str
        The dynamic variable.
    force : float
        The friction F of fast motion (N or N m).
    speed : float
        The velocity v0 over which it turns round (m/s or rad/s): at v0 it is 0.76 F. Slower than that it is
        a viscous drag of F/v0, so under a small load the joint creeps instead of sticking.
    name : str, optional

    Raises
    ------
    DescriptionError
        If the force or the speed is not positive.

    Notes
    -----
    The smaller the speed, the stiffer the equations: a step should not change v by much more than v0.
    """

    force: float
    speed: float

    def __post_init__(self) -> None:
        super().__post_init__()
        force = positive(self.force, f"{self.title}: force", "as friction opposes the motion")
        speed = positive(
            self.speed, f"{self.title}: speed", "the velocity over which the friction turns round"
        )
        object.__setattr__(self, "force", force)
        object.__setattr__(self, "speed", speed)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"friction({self.variable})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.variable}, {self.force:g} beyond a speed of {self.speed:g}"

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = [
            context.parameter(builder, self, "force", self.force),
            context.parameter(builder, self, "speed", self.speed),
        ]
        self.oppose(builder, context, "tanh", slots)


@dataclass(frozen=True)
class LinearDamper(FramePair, Force):
    """A damper between two frames: ``f_i = -c sdot ds/dq_i`` with ``s = |p1 - p2|``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends. They must not meet, where the damper has no direction.
    coefficient : float
        The coefficient c (N s/m).
    name : str, optional

    Raises
    ------
    DescriptionError
        If both ends are the same frame or the coefficient is not positive.
    """

    coefficient: float

    def __post_init__(self) -> None:
        super().__post_init__()
        value = positive(
            self.coefficient, f"{self.title}: coefficient", "as a damper opposes the motion"
        )
        object.__setattr__(self, "coefficient", value)

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"damper({self.frame1}, {self.frame2})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.frame1} to {self.frame2}, {self.coefficient:g} N s/m"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_distance(context, "give way to the damper")

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slot = context.parameter(builder, self, "coefficient", self.coefficient)
        coordinate = builder.path_coordinate(list(self.points(builder, context)))
        minus = context.constant(builder, -1.0)
        builder.add_force(coordinate, minus, -1, -1, builder.law("linear", [slot]))
