"""Forces and torques on a frame, in its own axes or in those of the world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.fields import FRAME, not_zero
from leastaction.mechanics.elements.kinds import Kind, Number, Uses
from leastaction.mechanics.elements.looks import Push
from leastaction.mechanics.elements.scalars import Factors
from leastaction.mechanics.elements.units import common
from leastaction.numerics.names import check_name
from leastaction.numerics.public import public

Component = float | str | Mapping[str, float]
_Three = tuple[Component, ...]


def _read_component(value: Any, what: str) -> Component:
    if isinstance(value, str):
        return check_name(value, what)
    if not isinstance(value, Mapping):
        return Number().read(value, what)
    if len(value) != 1:
        raise DescriptionError(f"{what}: expected one input with its factor such as {{'thrust': 0.02}}, got {value!r}")
    (name, factor) = next(iter(value.items()))
    return Factors({check_name(name, what): Number().read(factor, f"{what}: the factor of {name!r}")})


def _input_of(component: Component) -> str | None:
    """The input of a component, if it has one."""
    if isinstance(component, Mapping):
        return next(iter(component))
    return component if isinstance(component, str) else None


def _number_of(component: Component) -> float | None:
    """The number of a component, which multiplies the input if there is one."""
    if isinstance(component, Mapping):
        return next(iter(component.values()))
    return None if isinstance(component, str) else component


def _terms(components: Iterable[Component], gain: float) -> tuple[tuple[tuple[float, float, float], float | str], ...]:
    """The terms of a push along x, y and z; inputs without a factor of their own have the gain."""
    found: list[tuple[tuple[float, float, float], float | str]] = []
    for component, axis in zip(components, np.eye(3), strict=True):
        name, number = _input_of(component), _number_of(component)
        x, y, z = (float(c) for c in (axis if name is None else (gain if number is None else number) * axis))
        source = number if name is None else name
        if source is not None and source != 0.0:
            found.append(((x, y, z), source))
    return tuple(found)


def _show(component: Component) -> str:
    name, number = _input_of(component), _number_of(component)
    return " ".join(([] if number is None else [f"{number:g}"]) + ([] if name is None else [name]))


@dataclass(frozen=True)
class _Components(Kind):
    """Three components, each a number, an input, or one with a factor; the parameters are called by a letter.

    They are numbers of the wrench, which has all six components.
    """

    letter: str
    unit: str

    def read(self, value: Any, what: str) -> _Three:
        if (
            isinstance(value, (str, bytes))
            or not isinstance(value, (Sequence, np.ndarray))
            or getattr(value, "ndim", 1) == 0
            or len(value) != 3
        ):
            raise DescriptionError(
                f"{what}: expected three components along x, y and z, each a number or the name of an input, "
                f"got {value!r}"
            )
        return tuple(_read_component(c, f"{what}: {axis}") for axis, c in zip("xyz", value, strict=True))

    def uses(self, value: _Three) -> Uses:
        return Uses(inputs=tuple(dict.fromkeys(name for c in value if (name := _input_of(c)) is not None)))

    def named(self, value: _Three) -> dict[str, Component]:
        """The components by name."""
        return {f"{self.letter}{axis}": c for axis, c in zip("xyz", value, strict=True)}

    def show(self, value: _Three) -> str:
        shown = ", ".join(map(_show, value))
        return f"({shown}) {self.unit}"


_FORCE, _TORQUE = _Components("f", "N"), _Components("t", "N m")


@public
@dataclass(frozen=True)
class Wrench(Force):
    """Base of the wrenches; they differ in where the force acts and in whose axes it is given.

    Parameters
    ----------
    frame : str
        The frame on which it acts.
    force : sequence of three float, str, or mapping of str to float, optional
        The force (N): each component a number, or the name of an input, new with this element or shared
        with others of the same name, or an input with its factor, ``{"thrust": 0.02}``. Zero if not given.
    torque : sequence of three float, str, or mapping of str to float, optional
        The torque (N m), likewise.
    gain : float, optional
        One factor of all inputs that have none of their own (N and N m per unit of the inputs), not zero.

    Raises
    ------
    DescriptionError
        If neither force nor torque is given, one is not three numbers or names, or there is a gain of no input.

    Notes
    -----
    The components that are numbers, and the factors of inputs, are the parameters ``"wrench.fx"``, ``"wrench.fy"``,
    ``"wrench.fz"``, ``"wrench.tx"``, ``"wrench.ty"``, ``"wrench.tz"``, and the gain is ``"wrench.gain"``.
    """

    frame: str = field(metadata=FRAME)
    force: Sequence[Component] | None = field(default=None, metadata={"kind": _FORCE})
    torque: Sequence[Component] | None = field(default=None, metadata={"kind": _TORQUE})
    gain: float | None = field(default=None, metadata=not_zero("as else the inputs do nothing"))

    kind: ClassVar[str]
    task = "follow the wrench"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.force is None and self.torque is None:
            raise DescriptionError(f"{self.label}: neither a force nor a torque is given; give force= or torque=")
        if self.gain is not None and not any(isinstance(each, str) for each in self.components.values()):
            raise DescriptionError(
                f"{self.label}: the gain {self.gain:g} is of no input; name one as a component, such as "
                "force=(0, 0, 'thrust'), or leave it out"
            )

    @property
    def components(self) -> dict[str, Component]:
        """The six components by name: numbers, inputs, or inputs with a factor."""
        zero = (0.0, 0.0, 0.0)
        return _FORCE.named(tuple(self.force or zero)) | _TORQUE.named(tuple(self.torque or zero))

    @property
    def numbers(self) -> dict[str, float]:
        found = {n: number for n, c in self.components.items() if (number := _number_of(c)) is not None}
        return found if self.gain is None else {**found, "gain": self.gain}

    def with_number(self, parameter: str, value: float) -> Wrench:
        if parameter == "gain":
            return replace(self, gain=value)
        name = _input_of(self.components[parameter])
        values = list({**self.components, parameter: value if name is None else {name: value}}.values())
        return replace(self, force=values[:3], torque=values[3:])

    def describe(self) -> str:
        parts = [self.frame]
        if self.force is not None:
            parts.append(f"force {_FORCE.show(tuple(self.force))}")
        if self.torque is not None:
            parts.append(f"torque {_TORQUE.show(tuple(self.torque))}")
        if self.gain is not None:
            parts.append(f"gain {self.gain:g}")
        return ", ".join(parts)

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        given: list[tuple[str, str]] = []
        if self.gain not in (None, 1.0):
            return {name: "" for name in self.components.values() if isinstance(name, str)}
        for kind, components in ((_FORCE, self.force), (_TORQUE, self.torque)):
            given += [(each, kind.unit) for each in components or () if isinstance(each, str)]
        return {name: common(unit for other, unit in given if other == name) for name, _ in given}

    @property
    def pushes(self) -> tuple[Push, ...]:
        parts = self.components
        gain = 1.0 if self.gain is None else self.gain
        force, torque = (_terms([parts[letter + axis] for axis in "xyz"], gain) for letter in "ft")
        axes = self.frame if self.kind == "body" else None
        found = (Push(self.frame, force, axes), Push(self.frame, torque, axes, turning=True))
        return tuple(push for push in found if push.terms)

    def add_to(self, core: Compiler) -> None:
        slots, inputs = [], []
        for name, value in self.components.items():
            input_ = _input_of(value)
            inputs.append(-1 if input_ is None else core.input(input_))
            own = _number_of(value) is not None
            slots.append(core.slot(name) if own else core.slot("gain") if self.gain is not None else -1)
        placed = core.context.placed(self.frame)
        pose = np.ascontiguousarray(placed.pose)
        core.builder.add_wrench(self.kind, placed.joint, pose, slots, inputs)


@public
@dataclass(frozen=True)
class BodyWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the frame.

    It turns with the frame, as the thrust of a rocket does. The generalised force is the transposed body
    Jacobian times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind = "body"
    called = "body_wrench"


@public
@dataclass(frozen=True)
class HybridWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the world.

    It keeps its direction while the frame turns, as a weight does. Parameters, errors and names of the
    components: see `Wrench`.
    """

    kind = "hybrid"
    called = "hybrid_wrench"


@public
@dataclass(frozen=True)
class SpatialWrench(Wrench):
    """A force along a line through the world's origin and a torque about it, in the axes of the world.

    The wrench as seen from the world: the generalised force is the transposed spatial Jacobian of the frame
    times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind = "spatial"
    called = "spatial_wrench"
