"""Forces and torques on a frame, in its own axes or in those of the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.base import Builder, Context, Element, Uses
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.reading import number
from leastaction.numerics.names import check_name

_COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")


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
    name : str, optional

    Raises
    ------
    DescriptionError
        If neither force nor torque is given, or one is not three numbers or names.

    Notes
    -----
    The components that are numbers are the parameters ``"wrench.fx"``, ``"wrench.fy"``, ``"wrench.fz"``,
    ``"wrench.tx"``, ``"wrench.ty"``, ``"wrench.tz"``.
    """

    frame: str
    force: Sequence[float | str] | None = None
    torque: Sequence[float | str] | None = None

    kind: ClassVar[str]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_name(self.frame, f"{self.title}: frame")
        if self.force is None and self.torque is None:
            raise DescriptionError(
                f"{self.label}: neither a force nor a torque is given; give force= or torque="
            )
        for field in ("force", "torque"):
            if getattr(self, field) is not None:
                object.__setattr__(self, field, self._three(field))

    @property
    def components(self) -> dict[str, float | str]:
        """The six components by name: numbers or inputs."""
        zero = (0.0, 0.0, 0.0)
        values = (*(self.force or zero), *(self.torque or zero))
        return dict(zip(_COMPONENTS, values, strict=True))

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        inputs = [value for value in self.components.values() if isinstance(value, str)]
        return Uses(frames=(self.frame,), inputs=tuple(dict.fromkeys(inputs)))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"{self.kind}_wrench({self.frame})"

    def describe(self) -> str:
        """Return the values in a few words."""
        parts = []
        for field, unit in (("force", "N"), ("torque", "N m")):
            values = getattr(self, field)
            if values is not None:
                shown = ", ".join(v if isinstance(v, str) else f"{v:g}" for v in values)
                parts.append(f"{field} ({shown}) {unit}")
        return f"{self.frame}, {', '.join(parts)}"

    def check(self, context: Context) -> None:
        """Check names, and that the element can do its work; see `Element.check`."""
        super().check(context)
        self.check_moved(
            context,
            context.moving(self.frame),
            f"moves {self.frame!r}, so the wrench does nothing; remove it or choose another frame",
        )

    def with_number(self, parameter: str, value: float) -> Element | None:
        """Return the element with another value of a parameter; see `Element.with_number`."""
        values = list({**self.components, parameter: value}.values())
        return replace(self, force=values[:3], torque=values[3:])

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        slots, inputs = [], []
        for name, value in self.components.items():
            given = isinstance(value, str)
            inputs.append(context.input(value) if isinstance(value, str) else -1)
            slots.append(-1 if given else context.parameter(builder, self, name, float(value)))
        placed = context.placed(self.frame)
        pose = np.ascontiguousarray(placed.pose)
        builder.add_wrench(self.kind, placed.joint, pose, slots, inputs)

    def _three(self, field: str) -> tuple[float | str, ...]:
        given, what = getattr(self, field), f"{self.title}: {field}"
        if (
            isinstance(given, (str, bytes))
            or not isinstance(given, (Sequence, np.ndarray))
            or getattr(given, "ndim", 1) == 0
            or len(given) != 3
        ):
            raise DescriptionError(
                f"{what}: expected three components along x, y and z, each a number or the name of an input, "
                f"got {given!r}"
            )
        return tuple(
            check_name(value, f"{what}: {axis}")
            if isinstance(value, str)
            else number(value, f"{what}: {axis}")
            for axis, value in zip("xyz", given, strict=True)
        )


@dataclass(frozen=True)
class BodyWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the frame.

    It turns with the frame, as the thrust of a rocket does. The generalised force is the transposed body
    Jacobian times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind: ClassVar[str] = "body"


@dataclass(frozen=True)
class HybridWrench(Wrench):
    """A force at a frame's origin and a torque, both in the axes of the world.

    It keeps its direction while the frame turns, as a weight does. Parameters, errors and names of the
    components: see `Wrench`.
    """

    kind: ClassVar[str] = "hybrid"


@dataclass(frozen=True)
class SpatialWrench(Wrench):
    """A force along a line through the world's origin and a torque about it, in the axes of the world.

    The wrench as seen from the world: the generalised force is the transposed spatial Jacobian of the frame
    times the wrench. Parameters, errors and names of the components: see `Wrench`.
    """

    kind: ClassVar[str] = "spatial"
