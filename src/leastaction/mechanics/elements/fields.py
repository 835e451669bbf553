"""What the fields of elements are declared with: metadata of plain dataclass fields.

::

    frame1: str = field(metadata=FRAME)
    stiffness: float = field(metadata=positive("as a spring drives back to its rest", unit="N/m"))
    rest: float | str = field(default=0.0, metadata=number(unit="m", variable="either"))

Behind each stands a `Kind`. A field whose default is None may be left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from leastaction.mechanics.elements import kinds
from leastaction.mechanics.elements.kinds import Kind, Number
from leastaction.mechanics.elements.scalars import Path, Sum, SumOrPath

PULLS_BACK = "as a spring drives back to its rest"
Metadata = Mapping[str, Kind]

FRAME: Metadata = {"kind": kinds.Frame()}
END: Metadata = {"kind": kinds.Frame(end=True)}
FRAMES: Metadata = {"kind": kinds.Names("frames")}
PATH: Metadata = {"kind": Path()}
DYNAMIC: Metadata = {"kind": kinds.Variable("dynamic")}
KINEMATIC: Metadata = {"kind": kinds.Variable("kinematic")}
SUM: Metadata = {"kind": Sum()}
DYNAMIC_SUM: Metadata = {"kind": Sum("dynamic")}
FACTORS: Metadata = {"kind": Sum("")}
SUM_OR_PATH: Metadata = {"kind": SumOrPath()}
DYNAMIC_SUM_OR_PATH: Metadata = {"kind": SumOrPath("dynamic")}
OTHER_SUM_OR_PATH: Metadata = {"kind": SumOrPath(prefix="of")}
INPUT: Metadata = {"kind": kinds.Input()}
VECTOR: Metadata = {"kind": kinds.Vector()}
AXIS: Metadata = {"kind": kinds.Axis()}
ROTATION: Metadata = {"kind": kinds.Rotation()}
FLAG: Metadata = {"kind": kinds.Flag()}
CURVE: Metadata = {"kind": kinds.SmoothCurve()}


def number(
    accept: Callable[[float], bool] | None = None,
    expected: str = "",
    why: str = "",
    *,
    unit: str = "",
    variable: str | None = None,
) -> Metadata:
    """Return the metadata of a finite number.

    ``accept``: whether the element can have it. ``expected``, ``why``: what the message says if it cannot. ``unit``:
    shown behind the number. ``variable`` {"kinematic", "either"}: the kind of variable that may stand for the number;
    none by default.
    """
    kind = Number(accept, expected, why, unit)
    return {"kind": kind if variable is None else kinds.NumberOrVariable(kind, variable)}


def positive(why: str, *, unit: str = "", variable: str | None = None) -> Metadata:
    """Return the metadata of a positive number; see `number`."""
    return number(lambda x: x > 0.0, "a positive number", why, unit=unit, variable=variable)


def not_negative(why: str, *, unit: str = "", variable: str | None = None) -> Metadata:
    """Return the metadata of a number that is zero or more; see `number`."""
    return number(lambda x: x >= 0.0, "zero or more", why, unit=unit, variable=variable)


def not_zero(why: str, *, unit: str = "") -> Metadata:
    """Return the metadata of a number that is not zero; see `number`."""
    return number(lambda x: x != 0.0, "a number that is not zero", why, unit=unit)
