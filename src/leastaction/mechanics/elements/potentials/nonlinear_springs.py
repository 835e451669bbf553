"""Springs with a law of their own: a curve of force, a string that goes slack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from leastaction.mechanics.elements.along import Along, Path, Sum, with_factor
from leastaction.mechanics.elements.base import Builder, Context, Element
from leastaction.mechanics.elements.potentials.gravity import Potential
from leastaction.mechanics.elements.reading import PULLS_BACK, flag, positive, read_curve
from leastaction.numerics.curve import Curve


@dataclass(frozen=True)
class NonlinearSpring(Along, Potential):
    """A spring whose force is a smooth curve: ``V(s) = integral of F``, so that it drives with ``-F(s)``.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is: a configuration variable, a sum of some by their factors, or the length of the path
        through the origins of two frames or more.
    force : Curve
        The force F at s (N or N m), positive where the spring drives s down: for a length, a tension.
    name : str, optional

    Raises
    ------
    DescriptionError
        If ``on`` is none of these or the force no `Curve`.

    Notes
    -----
    The parameter ``"spring.scale"`` multiplies the curve; it is 1.
    """

    on: str | Mapping[str, float] | Sequence[str]
    force: Curve

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"{self.title}: on"
        if isinstance(self.on, (str, Mapping)):
            object.__setattr__(self, "on", Sum.read(self.on, what))
        else:
            object.__setattr__(self, "on", Path.read(self.on, what))
        read_curve(self.force, f"{self.title}: force")

    @property
    def scalar(self) -> Sum | Path:
        """What the spring acts along."""
        return Sum.of(self.on) if isinstance(self.on, (str, Mapping)) else Path(tuple(self.on))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"nonlinear_spring({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        return f"{self.scalar}, force over {self.force.start:g} to {self.force.end:g}"

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        changed = with_factor(self, "on", parameter, value)
        return super().with_number(parameter, value) if changed is None else changed

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        energy = self.force.integral()
        scale = context.parameter(builder, self, "scale", 1.0)
        law = builder.piecewise_law(energy.breaks, energy.coefficients, scale)
        builder.add_potential(self.coordinate(builder, context), law)


@dataclass(frozen=True)
class ElasticString(Along, Potential):
    """An elastic string through the origins of frames, the ends and the via-points, of length s.

    Both ways it is a spring, ``V = k/2 (s - L)^2``; with tension only, ``V = k/2 r^2`` with the smooth
    stretch ``r = e log(1 + exp((s - L)/e))``, which is ``s - L`` where taut and nearly zero where slack.

    Parameters
    ----------
    frames : sequence of str
        Two frames or more, in the order of the string.
    stiffness : float
        The stiffness k of the whole string (N/m).
    length : float
        Its slack length L (m).
    tension_only : bool, optional
        Whether it goes slack when shorter than its length.
    smoothing : float, optional
        The length e over which it does (m): at ``s = L`` the stretch is ``e log 2``.
    name : str, optional

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, or a number is not positive.

    Notes
    -----
    Consecutive frames must not meet, where the string has no direction. A small ``smoothing`` makes a
    sharp corner, which Newton's method and the step must resolve.
    """

    frames: Sequence[str]
    stiffness: float
    length: float
    tension_only: bool = True
    smoothing: float = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        title = self.title
        object.__setattr__(self, "frames", Path.read(self.frames, f"{title}: frames"))
        for field, why in (
            ("stiffness", PULLS_BACK),
            ("length", "in metres"),
            (
                "smoothing",
                "the length over which the string gets taut; tension_only=False has no corner",
            ),
        ):
            value = positive(getattr(self, field), f"{title}: {field}", why)
            object.__setattr__(self, field, value)
        ways = flag(self.tension_only, f"{title}: tension_only")
        object.__setattr__(self, "tension_only", ways)

    @property
    def scalar(self) -> Path:
        """What the string acts along."""
        return Path(tuple(self.frames))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"elastic_string({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        ways = "tension only" if self.tension_only else "both ways"
        return f"{self.scalar}, {self.stiffness:g} N/m, length {self.length:g} m, {ways}"

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots = [
            context.parameter(builder, self, "stiffness", self.stiffness),
            context.parameter(builder, self, "length", self.length),
        ]
        if self.tension_only:
            slots.append(context.parameter(builder, self, "smoothing", self.smoothing))
        law = builder.law("taut" if self.tension_only else "spring", slots)
        builder.add_potential(self.coordinate(builder, context), law)
