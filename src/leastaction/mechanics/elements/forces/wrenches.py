"""Forces and torques on a frame, in its own axes or in those of the world."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Force
from leastaction.mechanics.elements.compiler import Compiler
from leastaction.mechanics.elements.fields import FRAME
from leastaction.mechanics.elements.kinds import Kind, Number, Uses
from leastaction.mechanics.elements.looks import Push, along_axes
from leastaction.mechanics.elements.units import common
from leastaction.numerics.names import check_name

_Three = tuple[float | str, ...]


@dataclass(frozen=True)
class _Components(Kind):
    """Three components, each a number or the name of an input; the parameters are called by a letter.

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
        return tuple(
            check_name(c, f"{what}: {axis}") if isinstance(c, str) else Number().read(c, f"{what}: {axis}")
            for axis, c in zip("xyz", value, strict=True)
        )

    def uses(self, value: _Three) -> Uses:
        return Uses(inputs=tuple(c for c in value if isinstance(c, str)))

    def named(self, value: _Three) -> dict[str, float | str]:
        """The components by name."""
        return {f"{self.letter}{axis}": c for axis, c in zip("xyz", value, strict=True)}

    def show(self, value: _Three) -> str:
        shown = ", ".join(c if isinstance(c, str) else f"{c:g}" for c in value)
        return f"({shown}) {self.unit}"


_FORCE, _TORQUE = _Components("f", "N"), _Components("t", "N m")


@dataclass(frozen=True)
class Wrench(Force):
    """Base of the wrenches; they differ in where the force acts and in whose axes it is given.

    Parameters
    ----------
    frame : str
        The frame on which it acts.
    force : sequence of three float or str, optional
        The force (N): each component a number, or the name of an input, new with this element or shared
        with others of the same name. Zero if not given.
    torque : sequence of three float or str, optional
        The torque (N m), likewise.

    Raises
    ------
    DescriptionError
        If neither force nor torque is given, or one is not three numbers or names.

    Notes
    -----
    The components that are numbers are the parameters ``"wrench.fx"``, ``"wrench.fy"``, ``"wrench.fz"``,
    ``"wrench.tx"``, ``"wrench.ty"``, ``"wrench.tz"``.
    """

    frame: str = field(metadata=FRAME)
    force: Sequence[float | str] | None = field(default=None, metadata={"kind": _FORCE})
    torque: Sequence[float | str] | None = field(default=None, metadata={"kind": _TORQUE})

    kind: ClassVar[str]
    task = "follow the wrench"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.force is None and self.torque is None:
            raise DescriptionError(f"{self.label}: neither a force nor a torque is given; give force= or torque=")

    @property
    def components(self) -> dict[str, float | str]:
        """The six components by name: numbers or inputs."""
        zero = (0.0, 0.0, 0.0)
        return _FORCE.named(tuple(self.force or zero)) | _TORQUE.named(tuple(self.torque or zero))

    @property
    def numbers(self) -> dict[str, float]:
        return {n: c for n, c in self.components.items() if not isinstance(c, str)}

    def with_number(self, parameter: str, value: float) -> Wrench:
        values = list({**self.components, parameter: value}.values())
        return replace(self, force=values[:3], torque=values[3:])

    def describe(self) -> str:
        parts = [self.frame]
        if self.force is not None:
            parts.append(f"force {_FORCE.show(tuple(self.force))}")
        if self.torque is not None:
            parts.append(f"torque {_TORQUE.show(tuple(self.torque))}")
        return ", ".join(parts)

    def units(self, of: Mapping[str, str]) -> dict[str, str]:
        given: list[tuple[str, str]] = []
        for kind, components in ((_FORCE, self.force), (_TORQUE, self.torque)):
            given += [(each, kind.unit) for each in components or () if isinstance(each, str)]
        return {name: common(unit for other, unit in given if other == name) for name, _ in given}

    @property
    def pushes(self) -> tuple[Push, ...]:
        parts = self.components
        force, torque = ({axis: parts[letter + axis] for axis in "xyz"} for letter in "ft")
        axes = self.frame if self.kind == "body" else None
        found = (
            Push(self.frame, along_axes(force), axes),
            Push(self.frame, along_axes(torque), axes, turning=True),
        )
        return tuple(push for push in found if push.terms)

    def add_to(self, core: Compiler) -> None:
        slots, inputs = [], []
        for name, value in self.components.items():
            inputs.append(core.input(value) if isinstance(value, str) else -1)
            slots.append(-1 if isinstance(value, str) else core.slot(name))
        placed = core.context.placed(self.frame)
        pose = np.ascontiguousarray(placed.pose)
        core.builder.add_wrench(self.kind, placed.joint, pose, slots, inputs)


@dataclass(frozen=True)
class BodyWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the frame.

    It turns with the frame, as the thrust of a rocket does. The generalised force is the transposed body
    Jacobian times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind = "body"
    called = "body_wrench"


@dataclass(frozen=True)
class HybridWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the world.

    It keeps its direction while the frame turns, as a weight does. Parameters, errors and names of the
    components: see `Wrench`.
    """

    kind = "hybrid"
    called = "hybrid_wrench"


@dataclass(frozen=True)
class SpatialWrench(Wrench):
    """A force along a line through the world's origin and a torque about it, in the axes of the world.

    The wrench as seen from the world: the generalised force is the transposed spatial Jacobian of the frame
    times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind = "spatial"
    called = "spatial_wrench"
