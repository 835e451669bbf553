"""Motors: inputs straight onto variables, sums of them, angles and distances between frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.directions import Direction, triad
from leastaction.mechanics.elements.fields import AXIS, DYNAMIC_SUM, END, FRAME, INPUT, not_zero
from leastaction.mechanics.elements.looks import Push
from leastaction.mechanics.elements.units import common, force_along
from leastaction.numerics.arrays import Array
from leastaction.numerics.public import public

_ACTS = "as else the input does nothing"


@public
@dataclass(frozen=True)
class JointForce(Force):
    """An input straight onto a dynamic variable, ``f_i = u``, or onto a sum of some, ``f_i = factor_i u``.

    The force on a sum ``s = sum of factor q`` does the work ``u ds``: half of it for each of two joints that
    a motor drives by a differential, ``{"left": 0.5, "right": 0.5}``. On a turn of a joint whose rotation is a
    quaternion, ``"hip.wx"``, it is a torque about that axis behind the joint.

    Parameters
    ----------
    variable : str or mapping of str to float
        The dynamic variable, or the factors of a sum that holds one.
    input : str
        The input u (N or N m); new with this element, or shared with others of the same name.

    Raises
    ------
    DescriptionError
        If a factor is zero or not finite, or no variable of the sum is dynamic.
    """

    variable: str | Mapping[str, float] = field(metadata=DYNAMIC_SUM)
    input: str = field(metadata=INPUT)

    called = "force"
    reads = "{input} on {variable}"
    needs_dynamic = True

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        names = (self.variable,) if isinstance(self.variable, str) else self.variable
        return {self.input: force_along(common(of.get(name, "") for name in names))}

    @property
    def pushes(self) -> tuple[Push, ...]:
        factors = {self.variable: 1.0} if isinstance(self.variable, str) else self.variable
        return tuple(Push(name, (((f, 0.0, 0.0), self.input),), joint=True) for name, f in factors.items())

    def add_to(self, core: Compiler) -> None:
        if isinstance(self.variable, str) and self.variable not in core.context.turns:
            core.builder.add_joint_force(core.variable(self.variable), core.input(self.input))
        else:
            core.force_by_rate(self.variable, 1.0, self.input)


@public
@dataclass(frozen=True)
class Motor(Force):
    """A motor that turns one frame against another: ``f_i = gain u dphi/dq_i``.

    phi is the angle of frame2 about an axis of frame1, as that of a `TorsionalSpring`.

    Parameters
    ----------
    frame1, frame2 : str
        The frames that carry the stator and the rotor.
    input : str
        The input u: the torque (N m) with the gain 1. New with this element, or shared with others.
    axis : str or array_like, shape (3,), optional
        Axis in frame1: ``"x"``, ``"y"``, ``"z"`` or three numbers.
    gain : float, optional
        Factor, not zero: a gear's ratio, or a constant of the motor (N m per unit of the input).

    Raises
    ------
    DescriptionError
        If both are the same frame, the axis is none, or the gain is zero.
    """

    frame1: str = field(metadata=FRAME)
    frame2: str = field(metadata=FRAME)
    input: str = field(metadata=INPUT)
    axis: Direction = field(default="z", metadata=AXIS)
    gain: float = field(default=1.0, metadata=not_zero(_ACTS))

    called = "motor"
    reads = "{input} turns {frame2} against {frame1} about {axis}, gain {gain}"
    task, turning, needs_dynamic = "follow the motor", True, True

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        return {self.input: "N m" if self.gain == 1.0 else ""}

    @property
    def pushes(self) -> tuple[Push, ...]:
        x, y, z = (self.gain * float(c) for c in triad(self.axis)[0])
        return (Push(self.frame2, (((x, y, z), self.input),), axes=self.frame1, turning=True),)

    def add_to(self, core: Compiler) -> None:
        core.force(core.angle(self.frame1, self.frame2, self.axis), "gain", self.input)


@public
@dataclass(frozen=True)
class LinearMotor(Force):
    """A motor that pushes two frames apart: ``f_i = gain u ds/dq_i`` with their distance s.

    Parameters
    ----------
    frame1, frame2 : str
        The frames whose origins are the ends. They must not meet, where the motor has no direction.
    input : str
        The input u: the force (N) with the gain 1, positive where it pushes. New with this element, or shared.
    gain : float, optional
        Factor, not zero (N per unit of the input).

    Raises
    ------
    DescriptionError
        If both are the same frame, they always coincide, or the gain is zero.
    """

    frame1: str = field(metadata=END)
    frame2: str = field(metadata=END)
    input: str = field(metadata=INPUT)
    gain: float = field(default=1.0, metadata=not_zero(_ACTS))

    called = "linear_motor"
    reads = "{input} between {frame1} and {frame2}, gain {gain}"
    task, needs_dynamic = "follow the motor", True
    seen_as = "motor"

    def pull(self, length: Array, rate: Array, values: Mapping[str, Array]) -> Array:
        return -self.gain * values[self.input]

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        return {self.input: "N" if self.gain == 1.0 else ""}

    def add_to(self, core: Compiler) -> None:
        core.force(core.path((self.frame1, self.frame2)), "gain", self.input)
