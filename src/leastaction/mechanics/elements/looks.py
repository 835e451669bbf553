"""What elements look like and where they push, as plain data for those who draw them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

LookKind = Literal["string", "rod", "spring", "damper", "motor"]


@dataclass(frozen=True)
class Look:
    """A line through the origins of frames: what an element is seen as.

    ``kind``: how it is drawn. ``frames``: the ends, and between them the via-points; two at least.
    """

    kind: LookKind
    frames: tuple[str, ...]


@dataclass(frozen=True)
class Push:
    """A force or a torque that an element exerts: ``sum of direction * source``.

    ``on``: the frame at whose origin it acts, or the variable whose joints it drives (along their axes). ``terms``:
    directions with what each is multiplied by: a number, the name of an input, or, of a constraint, the suffix of the
    equation whose multiplier it is. ``axes``: the frame in whose axes directions are; those of the world if None.
    ``turning``: whether it is a torque. ``joint``: whether ``on`` is a variable; each direction is then a factor alone,
    (f, 0, 0).
    """

    on: str
    terms: tuple[tuple[tuple[float, float, float], float | str], ...]
    axes: str | None = None
    turning: bool = False
    joint: bool = False


def along_axes(sources: dict[str, float | str]) -> tuple[tuple[tuple[float, float, float], float | str], ...]:
    """Return the terms of a `Push` from what acts along some of the axes x, y and z; zeros are left out."""
    units = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    return tuple((units[axis], source) for axis, source in sources.items() if source != 0.0)
