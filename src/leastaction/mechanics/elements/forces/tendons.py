"""Tendons and strings that pull with an input: muscles, cables, winches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from leastaction.errors import DescriptionError
from leastaction.mechanics.elements.along import Along, Path
from leastaction.mechanics.elements.base import Builder, Context, Uses
from leastaction.mechanics.elements.forces.joint_forces import Force
from leastaction.mechanics.elements.reading import number, read_curve
from leastaction.numerics.curve import Curve
from leastaction.numerics.names import check_name


@dataclass(frozen=True)
class TendonForce(Along, Force):
    """The tension of a string over via-points: ``f_i = -gain u fl(s) fv(sdot) ds/dq_i``.

    The length s is that of the straight pieces through the frames; a positive tension shortens it.

    Parameters
    ----------
    frames : sequence of str
        Two frames or more, in the order of the string: the ends, and between them the via-points.
    input : str
        The input u: the tension (N) with the gain 1, an activation with the gain of a muscle's strength. New
        with this element, or shared with others of the same name.
    gain : float, optional
        Factor, not zero (N per unit of the input).
    force_length : Curve, optional
        Factor fl by the length (m); 1 if not given.
    force_velocity : Curve, optional
        Factor fv by the rate of the length (m/s), which is negative while the string shortens; 1 if not given.
    name : str, optional

    Raises
    ------
    DescriptionError
        If there are fewer than two frames, one follows itself, the gain is zero, or a curve is none.

    Notes
    -----
    Nothing keeps the tension from being negative: bound the input where it is chosen. Consecutive frames
    must not meet, where the string has no direction.
    """

    frames: Sequence[str]
    input: str
    gain: float = 1.0
    force_length: Curve | None = None
    force_velocity: Curve | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        title = self.title
        object.__setattr__(self, "frames", Path.read(self.frames, f"{title}: frames"))
        check_name(self.input, f"{title}: input")
        gain = number(self.gain, f"{title}: gain")
        if gain == 0.0:
            raise DescriptionError(
                f"{title}: gain: got zero, so the input does nothing; give a number that is not"
            )
        object.__setattr__(self, "gain", gain)
        for field in ("force_length", "force_velocity"):
            if getattr(self, field) is not None:
                read_curve(getattr(self, field), f"{title}: {field}")

    @property
    def scalar(self) -> Path:
        """What the tendon pulls along."""
        return Path(tuple(self.frames))

    @property
    def uses(self) -> Uses:
        """The names that the element uses; see `Element.uses`."""
        return Uses(frames=tuple(self.frames), inputs=(self.input,))

    @property
    def default_name(self) -> str:
        """The name if none is given."""
        return f"tendon({self.scalar.names})"

    def describe(self) -> str:
        """Return the values in a few words."""
        parts = [f"{self.input} along {self.scalar}"]
        if self.gain != 1.0:
            parts.append(f"gain {self.gain:g}")
        if self.force_length is not None:
            parts.append("force by length")
        if self.force_velocity is not None:
            parts.append("force by velocity")
        return ", ".join(parts)

    def add_to(self, builder: Builder, context: Context) -> None:
        """Add the element to the core; see `Element.add_to`."""
        minus, one = context.constant(builder, -1.0), context.constant(builder, 1.0)
        # The sign goes into the first factor, so that the gain is what the user gave.
        if self.force_length is None:
            by_length = builder.law("polynomial", [minus])
        else:
            curve = self.force_length
            by_length = builder.piecewise_law(curve.breaks, curve.coefficients, minus)
        by_velocity = -1
        if self.force_velocity is not None:
            curve = self.force_velocity
            by_velocity = builder.piecewise_law(curve.breaks, curve.coefficients, one)
        gain = context.parameter(builder, self, "gain", self.gain)
        coordinate = self.coordinate(builder, context)
        builder.add_force(coordinate, gain, context.input(self.input), by_length, by_velocity)
