"""What a problem file says, typed. Names are those of the functions that take it: `follow`, `optimize`, `Bound` ..."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, UnsetType

from leastaction.optimal.options import Method, Regulator

FORMAT = "problem 1"
"""What the first line of a file says: its kind, and the version of the format."""

Three = Annotated[list[float], Meta(min_length=3, max_length=3)]
Pair = Annotated[list[float | Three], Meta(min_length=2, max_length=2)]
OverTime = float | list[float] | str
"""A number, one for every instant, or a formula in the time t."""
Names = str | list[str] | dict[str, float]
When = str | int | float | list[float]


class Part(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A part of a file, in which every key is known."""

    def given(self, *without: str) -> dict[str, Any]:
        """Return what was given, by key."""
        values = {name: getattr(self, name) for name in self.__struct_fields__ if name not in without}
        return {name: value for name, value in values.items() if value is not UNSET}


class ModelPart(Part, kw_only=True):
    """A mechanism from a file, and how that is read; as the arguments of `leastaction.load`."""

    file: str
    floating: bool | UnsetType = UNSET
    fixed: list[str] | UnsetType = UNSET
    packages: list[str] | UnsetType = UNSET
    motors: bool | list[str] | UnsetType = UNSET
    inertia: Literal["strict", "repair"] | UnsetType = UNSET
    strict: bool | UnsetType = UNSET


class TimePart(Part, kw_only=True):
    """The horizon: its length (s), and the number of steps or their length (s)."""

    duration: Annotated[float, Meta(gt=0.0)]
    steps: Annotated[int, Meta(ge=1, le=1_000_000)] | UnsetType = UNSET
    dt: Annotated[float, Meta(gt=0.0)] | UnsetType = UNSET


class StartPart(Part, kw_only=True):
    """Where the motion begins: a keyframe of the model, and values of variables (m or rad) and of their rates.

    With constraints it is the nearest configuration that keeps them; variables to ``hold`` stay what they are.
    """

    keyframe: str | UnsetType = UNSET
    q: dict[str, float] | UnsetType = UNSET
    v: dict[str, float] | UnsetType = UNSET
    hold: list[str] = []


class WantedPart(Part, tag_field="type", kw_only=True):
    """What is wanted of a variable (m or rad), or of the place of a frame (m)."""


class ConstantPart(WantedPart, tag="constant", kw_only=True):
    """One value all the time."""

    name: str
    value: float | Three


class KeyframesPart(WantedPart, tag="keyframes", kw_only=True):
    """Values at some times: ``[t, value]``; between them nothing is wanted, or the smooth curve through them."""

    name: str
    points: Annotated[list[Pair], Meta(min_length=1)]
    between: Literal["free", "smooth"] = "free"


class PosesPart(WantedPart, tag="poses", kw_only=True):
    """Configurations of the model's keyframes at some times: of all variables, or of those that ``names`` match."""

    points: Annotated[list[tuple[float, str]], Meta(min_length=1)]
    names: list[str] | UnsetType = UNSET
    between: Literal["free", "smooth"] = "free"


class FormulaPart(WantedPart, tag="formula", kw_only=True):
    """A formula in the time t, or three of them; nothing is wanted before ``start`` and after ``end`` (s)."""

    name: str
    value: str | Annotated[list[str | float], Meta(min_length=3, max_length=3)]
    start: float | UnsetType = UNSET
    end: float | UnsetType = UNSET


class FilePart(WantedPart, tag="file", kw_only=True):
    """Columns of a CSV with a first line of names (``x`` or ``x [m]``), or arrays of an NPZ; ``t`` are the times (s).

    ``columns``: the column of each name, where it is called otherwise; of a frame ``name.x``, ``name.y``, ``name.z``.
    All columns that are variables or frames are taken if it is left out. ``degrees``: columns that are in degrees.
    """

    file: str
    columns: dict[str, str] | UnsetType = UNSET
    degrees: list[str] = []


class CapturePart(WantedPart, tag="capture", kw_only=True):
    """Places of joints of a motion capture (BVH, AMC), each for a frame: ``scale * turned place + offset`` (m).

    ``up``: the capture's axis that becomes ``upwards``, that of the mechanism.
    """

    file: str
    frames: Annotated[dict[str, str], Meta(min_length=1)]
    scale: float = 0.01
    offset: Three | UnsetType = UNSET
    up: Literal["x", "y", "z"] = "y"
    upwards: Literal["x", "y", "z"] = "z"
    speed: Annotated[float, Meta(gt=0.0)] = 1.0
    skeleton: str | UnsetType = UNSET
    frame_rate: float | UnsetType = UNSET


class LimitPart(Part, tag_field="type", kw_only=True):
    """What the motion has to keep to."""


class BoundPart(LimitPart, tag="Bound", kw_only=True):
    """Least and largest values of quantities by name."""

    names: Names
    min: OverTime | UnsetType = UNSET
    max: OverTime | UnsetType = UNSET
    of: str | UnsetType = UNSET
    at: When | UnsetType = UNSET


class EqualPart(LimitPart, tag="Equal", kw_only=True):
    """Values at some instants, the last one if ``at`` is left out."""

    names: Names
    value: OverTime = 0.0
    of: str | UnsetType = UNSET
    at: When | UnsetType = UNSET


class BallPart(Part, tag="Ball", tag_field="type", kw_only=True):
    """A ball: its centre (m), or three formulas in the time t, and its radius (m)."""

    center: Annotated[list[float | str], Meta(min_length=3, max_length=3)]
    radius: float


class BoxPart(Part, tag="Box", tag_field="type", kw_only=True):
    """A box along the axes (m)."""

    low: Three
    high: Three


class HalfSpacePart(Part, tag="HalfSpace", tag_field="type", kw_only=True):
    """One side of a plane: ``normal . p >= offset``."""

    normal: Three
    offset: float = 0.0


Region = BallPart | BoxPart | HalfSpacePart


class KeepPart(LimitPart, tag="Keep", kw_only=True):
    """A frame inside or outside of a part of space; seen from another frame if ``origin`` is given."""

    frame: str
    inside: Region | UnsetType = UNSET
    outside: Region | UnsetType = UNSET
    point: Three | UnsetType = UNSET
    origin: str | UnsetType = UNSET
    at: When | UnsetType = UNSET


class PeriodicPart(LimitPart, tag="Periodic", kw_only=True):
    """The last state is the first one; that is free then."""

    names: str | list[str] = "*"
    offset: dict[str, float] | UnsetType = UNSET
    modulo: dict[str, float] | UnsetType = UNSET


class UnknownPart(Part, tag_field="type", kw_only=True):
    """A number that is found together with the motion."""

    min: float | UnsetType = UNSET
    max: float | UnsetType = UNSET
    guess: float | UnsetType = UNSET
    price: float | UnsetType = UNSET
    weight: float | UnsetType = UNSET
    wanted: float | UnsetType = UNSET


class ParameterPart(UnknownPart, tag="Parameter", kw_only=True):
    """A parameter of the mechanism."""

    name: str


class FinalTimePart(UnknownPart, tag="FinalTime", kw_only=True):
    """The final time (s)."""


class OptimizerPart(Part, kw_only=True):
    """How the optimiser works; as the arguments of `optimize`."""

    method: Method | UnsetType = UNSET
    regulator: Regulator | UnsetType = UNSET
    shooting: Literal["auto", "single", "multiple"] | UnsetType = UNSET
    max_iterations: Annotated[int, Meta(ge=0)] | UnsetType = UNSET
    tolerance: Annotated[float, Meta(ge=0.0)] | UnsetType = UNSET
    free_start: bool | list[str] | UnsetType = UNSET


class OutputPart(Part, kw_only=True):
    """What is written beside the result and the summary."""

    plots: bool = True
    animation: bool = True


class ProblemRecord(Part, kw_only=True):
    """A problem: a mechanism, what is wanted of it, at which weights, and its limits. SI units and radians."""

    leastaction: Literal["problem 1"]
    title: str = ""
    model: str | ModelPart
    parameters: dict[str, float] = {}
    time: TimePart
    start: StartPart | UnsetType = UNSET
    wanted: Annotated[
        list[ConstantPart | KeyframesPart | PosesPart | FormulaPart | FilePart | CapturePart], Meta(min_length=1)
    ]
    weights: dict[str, float] = {}
    limits: list[BoundPart | EqualPart | KeepPart | PeriodicPart] = []
    model_limits: bool = False
    unknowns: list[ParameterPart | FinalTimePart] = []
    optimizer: OptimizerPart = msgspec.field(default_factory=OptimizerPart)
    output: OutputPart = msgspec.field(default_factory=OutputPart)
