"""Springs: energies of a variable, a length or an angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Element, Potential
from leastaction.mechanics.elements.compiler import Compiler, Paths, Scalar
from leastaction.mechanics.elements.directions import Direction
from leastaction.mechanics.elements.fields import (
    AXIS,
    CURVE,
    END,
    FLAG,
    FRAME,
    PATH,
    PULLS_BACK,
    SUM,
    SUM_OR_PATH,
    not_negative,
    number,
    positive,
)
from leastaction.mechanics.elements.units import common
from leastaction.numerics.arrays import Array
from leastaction.numerics.curve import Curve
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class JointSpring(Potential):
    """A spring on a configuration variable, or on a sum of some: ``V = k/2 (s - s0)^2``.

    A turn of a joint whose rotation is a quaternion, ``"hip.wx"``, stands for that component of its rotation vector
    (rad), smooth below half a turn: three such springs pull back about the axis of the rotation.

    Parameters
    ----------
    variable : str or mapping of str to float
        The variable s, or the factors of the sum ``s = sum of factor q``.
    stiffness : float
        The stiffness k (N/m or N m/rad).
    rest : float or str, optional
        Value s0 of s at which the spring is slack (m or rad), or the name of the variable that is it. A name
        that no frame uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If the stiffness is not positive, a factor is zero, or a number is not finite.
    """

    variable: str | Mapping[str, float] = field(metadata=SUM)
    stiffness: float = field(metadata=positive(PULLS_BACK))
    rest: float | str = field(default=0.0, metadata=number(variable="either"))

    called = "joint_spring"
    reads = "{variable}, stiffness {stiffness}, rest {rest}"

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        names = (self.variable,) if isinstance(self.variable, str) else self.variable
        return dict.fromkeys(super().units(of), common(of.get(name, "") for name in names))

    def add_to(self, core: Compiler) -> None:
        s, rest = core.less(core.sum(self.variable), "rest", self.rest)
        core.potential(s, core.law("spring", "stiffness", rest))


@public
@dataclass(frozen=True)
class LinearSpring(Potential):
    """A spring between two frames: ``V = k/2 (|p1 - p2| - L)^2``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends.
    stiffness : float
        The stiffness k (N/m).
    length : float or str, optional
        Length L of the slack spring (m), or the name of the variable that is it. A name that no frame uses
        is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If both ends are the same frame, the stiffness is not positive or the length negative.

    Notes
    -----
    The ends of a spring with a length must not meet: there it has no direction to push in. Without one the energy is
    ``k/2 |p1 - p2|^2``, which is smooth everywhere; such a spring has no parameter ``"spring.length"``.
    """

    frame1: str = field(metadata=END)
    frame2: str = field(metadata=END)
    stiffness: float = field(metadata=positive(PULLS_BACK, unit="N/m"))
    length: float | str = field(default=0.0, metadata=not_negative("in metres", unit="m", variable="either"))

    called = "spring"
    reads = "{frame1} to {frame2}, {stiffness}, length {length}"
    task = "give way to the spring"
    seen_as = "spring"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array:
        rest = values[self.length] if isinstance(self.length, str) else self.length
        return self.stiffness * (length - rest)

    @property
    def strings(self) -> tuple[tuple[str, ...], ...]:
        return () if self.length == 0.0 else super().strings

    def with_number(self, parameter: str, value: float) -> Element | None:
        if parameter == "length" and value == 0.0:
            raise DescriptionError(
                f"{self.label}: length: got 0, but a spring that was described with a length keeps one; "
                "describe the mechanism anew with a spring without"
            )
        return super().with_number(parameter, value)

    def add_to(self, core: Compiler) -> None:
        ends = (self.frame1, self.frame2)
        if self.length != 0.0:
            s, length = core.less(core.path(ends), "length", self.length)
            core.potential(s, core.law("spring", "stiffness", length))
            return
        law = core.law("spring", "stiffness", 0.0)
        for axis in np.eye(3):
            core.potential(core.component(*ends, core.context.world, axis), law)


@public
@dataclass(frozen=True)
class TorsionalSpring(Potential):
    """A spring against the turning of one frame relative to another: ``V = k/2 (phi - phi0)^2``.

    The angle is that of frame2 about an axis a of frame1: with e fixed across the axis in frame1, and
    d the same vector of frame2, ``phi = atan2((a x e) . d, e . d)``.

    Parameters
    ----------
    frame1, frame2 : str
        The frames; at the same attitude the angle is zero.
    stiffness : float
        The stiffness k (N m/rad).
    axis : str or array_like, shape (3,), optional
        Axis in frame1: ``"x"``, ``"y"``, ``"z"`` or three numbers.
    rest : float or str, optional
        Angle phi0 of the slack spring (rad), between -pi and pi, or the name of the variable that is it. A
        name that no frame uses is a new kinematic variable.

    Raises
    ------
    DescriptionError
        If both are the same frame, the stiffness is not positive, the axis is none, or the rest lies
        outside of (-pi, pi).

    Notes
    -----
    The angle lies in (-pi, pi) and jumps there, and so would the energy: for a joint that turns further
    use `JointSpring`. If frame2 tilts too, the angle is that of the projection of d on the plane across
    the axis; it is not determined where d is along the axis.
    """

    frame1: str = field(metadata=FRAME)
    frame2: str = field(metadata=FRAME)
    stiffness: float = field(metadata=positive(PULLS_BACK, unit="N m/rad"))
    axis: Direction = field(default="z", metadata=AXIS)
    rest: float | str = field(
        default=0.0,
        metadata=number(
            lambda angle: abs(angle) < np.pi,
            "an angle in (-pi, pi)",
            "where the spring's angle lies; use JointSpring for joints that turn further",
            unit="rad",
            variable="either",
        ),
    )

    called = "torsional_spring"
    reads = "{frame1} to {frame2} about {axis}, {stiffness}, rest {rest}"
    task = "give way to the spring"
    turning = True

    def add_to(self, core: Compiler) -> None:
        s, rest = core.less(core.angle(self.frame1, self.frame2, self.axis), "rest", self.rest)
        core.potential(s, core.law("spring", "stiffness", rest))


@public
@dataclass(frozen=True)
class NonlinearSpring(Potential):
    """A spring whose force is a smooth curve: ``V(s) = integral of F``, so that it drives with ``-F(s)``.

    Parameters
    ----------
    on : str, mapping of str to float, or sequence of str
        What s is: a configuration variable, a sum of some by their factors, or the length of the path
        through the origins of two frames or more.
    force : Curve
        The force F at s (N or N m), positive where the spring drives s down: for a length, a tension.

    Raises
    ------
    DescriptionError
        If ``on`` is none of these or the force no `Curve`.

    Notes
    -----
    The parameter ``"spring.scale"`` multiplies the curve; it is 1.
    """

    on: Scalar = field(metadata=SUM_OR_PATH)
    force: Curve = field(metadata=CURVE)

    called = "nonlinear_spring"
    reads = "{on}, force {force}"
    seen_as = "spring"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array | None:
        if isinstance(self.on, Mapping):
            return None  # its pieces pull differently, by the length of all
        return np.asarray(self.force(length), dtype=float)

    def add_to(self, core: Compiler) -> None:
        scale = core.parameter("scale", 1.0)
        core.potential(core.along(self.on), core.curve(self.force.integral(), scale))


@public
@dataclass(frozen=True)
class ElasticString(Potential):
    """An elastic string through the origins of frames, the ends and the via-points, of length s.

    Both ways it is a spring, ``V = k/2 (s - L)^2``; with tension only, ``V = k/2 r^2`` with the smooth
    stretch ``r = e log(1 + exp((s - L)/e))``, which is ``s - L`` where taut and nearly zero where slack.

    Parameters
    ----------
    frames : sequence of str, or mapping of such to float
        Two frames or more, in the order of the string.
    stiffness : float
        The stiffness k of the whole string (N/m).
    length : float or str
        Its slack length L (m), or the name of the variable that is it. A name that no frame uses is a new
        kinematic variable.
    tension_only : bool, optional
        Whether it goes slack when shorter than its length.
    smoothing : float, optional
        The length e over which it does (m): at ``s = L`` the stretch is ``e log 2``.

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, or a number is not positive.

    Notes
    -----
    Consecutive frames must not meet, where the string has no direction. A small ``smoothing`` makes a
    sharp corner, which Newton's method and the step must resolve.
    """

    frames: Paths = field(metadata=PATH)
    stiffness: float = field(metadata=positive(PULLS_BACK, unit="N/m"))
    length: float | str = field(metadata=positive("in metres", unit="m", variable="either"))
    tension_only: bool = field(default=True, metadata=FLAG)
    smoothing: float = field(
        default=1e-3,
        metadata=positive("the length over which the string gets taut; tension_only=False has no corner", unit="m"),
    )

    called = "elastic_string"
    reads = "{frames}, {stiffness}, length {length}"
    seen_as = "string"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array | None:
        if isinstance(self.frames, Mapping):
            return None  # its pieces pull differently, by the length of all
        stretch = length - (values[self.length] if isinstance(self.length, str) else self.length)
        if not self.tension_only:
            return self.stiffness * stretch
        share = stretch / self.smoothing
        taut = np.logaddexp(0.0, share)
        return np.asarray(self.stiffness * self.smoothing * taut * np.exp(share - taut))

    def describe(self) -> str:
        return f"{super().describe()}, {'tension only' if self.tension_only else 'both ways'}"

    def add_to(self, core: Compiler) -> None:
        s, length = core.less(core.path(self.frames), "length", self.length)
        if self.tension_only:
            law = core.law("taut", "stiffness", length, "smoothing")
        else:
            law = core.law("spring", "stiffness", length)
        core.potential(s, law)
