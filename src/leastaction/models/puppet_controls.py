"""What the strings of the marionette hang from: hands that move single strings, and bars that strings are tied to.

A hand moves the upper end of its string in a horizontal plane and draws it in or lets it out. A bar is a rigid body
whose pose is prescribed: its place, and turns about z, y and x in this order. Strings tied to it have fixed lengths.
With all strings on one bar, the "cross", one hand's pose moves the puppet; the knees may be on a bar of their own, as
on controls whose leg bar comes off, and the strings of the puppet's hands may be picked up.

Axes: x to the puppet's right, y ahead, z up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from leastaction.mechanics import Mechanism, rx, ry, rz, tx, ty, tz
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public


class PuppetString(NamedTuple):
    """One string held by a hand: the frames that it joins and the kinematic variables that move it.

    ``hook``: the frame on the puppet; ``control``: the upper end; ``x``, ``y``: variables of the upper
    end's place in the plane; ``length``: variable of the length.
    """

    name: str
    hook: str
    control: str
    x: str
    y: str
    length: str


class TiedString(NamedTuple):
    """One string tied to a bar, of a fixed length: the mechanism's parameter of this name.

    ``hook``: the frame on the puppet; ``control``: the frame on the bar; ``length``: name of the parameter.
    """

    name: str
    hook: str
    control: str
    length: str


@dataclass(frozen=True)
class Bar(Frozen):
    """A rigid control bar. Frozen: threads may share it.

    Attributes
    ----------
    name : str
    ends : mapping of str to (float, float)
        Where its strings are tied, x and y (m) as seen from its middle, by the strings' names.
    ahead : float
        How far ahead of the pelvis it is held when nothing else is wanted (m).
    turns : str
        The axes that it is turned about, one after the other, the first of them z; a bar whose ends are on one line is
        not turned about that.
    """

    name: str
    ends: Mapping[str, tuple[float, float]]
    ahead: float = 0.0
    turns: str = "zyx"

    def __post_init__(self) -> None:
        object.__setattr__(self, "ends", MappingProxyType(dict(self.ends)))
        super().__post_init__()

    @property
    def places(self) -> tuple[str, str, str]:
        """The variables of its place (m): x and y over the ground, and z over the plane of the hands."""
        return f"{self.name}-x", f"{self.name}-y", f"{self.name}-z"

    @property
    def angles(self) -> tuple[str, ...]:
        """The variables of its turns (rad), in their order."""
        return tuple(f"{self.name}-r{axis}" for axis in self.turns)

    @property
    def variables(self) -> tuple[str, ...]:
        """All its variables."""
        return (*self.places, *self.angles)

    def beam(self, string: str) -> str:
        """Return the name of the frame in the middle of the beam that carries a string's end."""
        return f"{self.name}_beam_of_{string}"

    def tree(self) -> list[Any]:
        """Return its frames, to stand on the plane of the hands."""
        ends: list[Any] = []
        for string, (x, y) in self.ends.items():
            ends += [ty(y, name=self.beam(string)), [tx(x, name=_control(string))]]
        whole = ends
        turn = {"x": rx, "y": ry, "z": rz}
        for i, (variable, axis) in reversed(list(enumerate(zip(self.angles, self.turns, strict=True)))):
            name = self.name if i == len(self.turns) - 1 else variable
            whole = [turn[axis](variable, name=name, kinematic=True), whole]
        for variable, move in reversed(list(zip(self.places, (tx, ty, tz), strict=True))):
            whole = [move(variable, kinematic=True), whole]
        return whole


AnyString = PuppetString | TiedString
"""A string of the marionette."""


class Ends(NamedTuple):
    """The variables that move the strings' upper ends, by what they are.

    ``x``, ``y``: places over the ground, of hands, then of bars (m); ``z``: heights of bars over the plane of the hands
    (m); ``headings``: turns of bars about the vertical (rad); ``tilts``: their other turns (rad).
    """

    x: tuple[str, ...]
    y: tuple[str, ...]
    z: tuple[str, ...]
    headings: tuple[str, ...]
    tilts: tuple[str, ...]

    @property
    def angles(self) -> tuple[str, ...]:
        """All angles."""
        return (*self.headings, *self.tilts)


def _control(string: str) -> str:
    return f"{string}_control"


@public
def held(part: str) -> PuppetString:
    """Return the string of a part of the puppet, held by a hand."""
    name = f"{part}_string"
    return PuppetString(name, f"{name}_hook", _control(name), f"{name}-x", f"{name}-y", f"{name}-length")


@public
def tied(name: str) -> TiedString:
    """Return a string that is tied to a bar."""
    return TiedString(name, f"{name}_hook", _control(name), f"{name}.length")


_SIX = ("right_leg", "left_arm", "upper_torso", "right_arm", "lower_torso", "left_leg")
_FEET, _ELBOWS = ("left_foot", "right_foot"), ("left_elbow", "right_elbow")
_ALL = tuple(held(part) for part in (*_SIX, *_FEET, "back", *_ELBOWS, "neck"))


def _strings(*parts: str) -> tuple[PuppetString, ...]:
    return tuple(string for string in _ALL if string.name in {f"{part}_string" for part in parts})


STRINGS: tuple[PuppetString, ...] = _strings(*_SIX)
"""The six strings, in the order of the constraints and of the kinematic variables."""

NINE_STRINGS: tuple[PuppetString, ...] = _strings(
    "right_leg", "left_arm", "right_arm", "left_leg", *_FEET, *_ELBOWS, "neck"
)
"""Nine strings: two at each leg, at the knee and at the foot, two at each arm, at the wrist and behind the elbow, and
one at the neck. A limb of four angles on a single string swings about the line from its joint to the hook: at rest its
elbow or knee hangs straight below that line. So the second strings are at the limbs, which hold the trunk as well."""

Count = Literal[6, 7, 8, 9, 11]
Control = Literal["cross", "cross+legs", "cross+hands", "cross+legs+hands"]
Hanging = Count | Control
"""What a marionette hangs on: so many strings, each from a hand of its own, or a control."""

STRING_SETS: Mapping[Count, tuple[PuppetString, ...]] = MappingProxyType(
    {
        6: STRINGS,
        7: _strings(*_SIX, "back"),
        8: _strings(*_SIX, *_FEET),
        9: NINE_STRINGS,
        11: _strings(*_SIX, *_FEET, "back", *_ELBOWS),
    }
)
"""The sets of strings by their number: the six; and the back; or the feet; two at each limb and the neck; the six with
feet, back, and elbows."""

_KNEES = ("left_leg_string", "right_leg_string")
_HANDS = ("left_arm_string", "right_arm_string")
_TRUNK: Mapping[str, tuple[float, float]] = {
    "upper_torso_string": (-0.12, 0.0),
    "lower_torso_string": (0.12, 0.0),
    "back_string": (0.0, -0.25),
}
_CROSS: Mapping[str, tuple[float, float]] = {
    **_TRUNK,
    **dict(zip(_HANDS, ((-0.25, 0.15), (0.25, 0.15)), strict=True)),
    **dict(zip(_KNEES, ((-0.15, 0.3), (0.15, 0.3)), strict=True)),
}


def _cross(*apart: str) -> Bar:
    """Return the cross without the strings that are held apart from it."""
    return Bar("cross", {name: end for name, end in _CROSS.items() if name not in apart})


_LEG_BAR = Bar("legs", {"left_leg_string": (-0.15, 0.0), "right_leg_string": (0.15, 0.0)}, 0.3, "zy")

CONTROLS: Mapping[Control, tuple[Bar, ...]] = MappingProxyType(
    {
        "cross": (_cross(),),
        "cross+legs": (_cross(*_KNEES), _LEG_BAR),
        "cross+hands": (_cross(*_HANDS),),
        "cross+legs+hands": (_cross(*_KNEES, *_HANDS), _LEG_BAR),
    }
)
"""The controls by name, each with the seven strings of `STRING_SETS`: all of them tied to one cross; the knees' on a
bar of their own; those of the puppet's hands picked up; or both. The shoulders are tied to the middle beam of the
cross, the back to its rear end, hands and knees to beams ahead."""


@public
def strings_on(hanging: Hanging) -> tuple[AnyString, ...]:
    """Return the strings of a set, or of a control, in the order of the constraints."""
    found = next((each for count, each in STRING_SETS.items() if count == hanging), None)
    if found is not None:
        return found
    bars = next(bars for name, bars in CONTROLS.items() if name == hanging)
    on_bars = {name for bar in bars for name in bar.ends}
    return tuple(tied(string.name) if string.name in on_bars else string for string in STRING_SETS[7])


@public
def set_of(mechanism: Mechanism) -> Hanging:
    """Return which of `STRING_SETS` and `CONTROLS` a marionette hangs on."""
    control = _control_of(mechanism)
    if control is not None:
        return control
    strings = strings_of(mechanism)
    return next(count for count, each in STRING_SETS.items() if each == strings)


@public
def bars_of(mechanism: Mechanism) -> tuple[Bar, ...]:
    """Return the bars that strings of a marionette are tied to; none where hands hold all."""
    control = _control_of(mechanism)
    return () if control is None else CONTROLS[control]


@public
def strings_of(mechanism: Mechanism) -> tuple[AnyString, ...]:
    """Return the strings of a marionette, in the order of its constraints, or of its tensions as inputs."""
    control = _control_of(mechanism)
    if control is not None:
        return strings_on(control)
    names = mechanism.constraints or mechanism.inputs
    return tuple(string for string in _ALL if string.name in names)


@public
def held_strings(mechanism: Mechanism) -> tuple[PuppetString, ...]:
    """Return the strings of a marionette that hands hold, in the order of `strings_of`."""
    return tuple(string for string in strings_of(mechanism) if isinstance(string, PuppetString))


@public
def tied_strings(mechanism: Mechanism) -> tuple[TiedString, ...]:
    """Return the strings of a marionette that are tied to bars, in the order of `strings_of`."""
    return tuple(string for string in strings_of(mechanism) if isinstance(string, TiedString))


@public
def ends_of(mechanism: Mechanism) -> Ends:
    """Return the variables that move the upper ends of a marionette's strings."""
    hands, bars = held_strings(mechanism), bars_of(mechanism)
    x, y, z = ([bar.places[axis] for bar in bars] for axis in range(3))
    return Ends(
        x=(*(s.x for s in hands), *x),
        y=(*(s.y for s in hands), *y),
        z=tuple(z),
        headings=tuple(bar.angles[0] for bar in bars),
        tilts=tuple(angle for bar in bars for angle in bar.angles[1:]),
    )


@public
def string_lengths(mechanism: Mechanism, q: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return how far the upper ends of a marionette's strings are from their hooks.

    Parameters
    ----------
    mechanism : Mechanism
        From `leastaction.models.marionette.marionette`.
    q : array_like, shape (nq,) or (N, nq)
        Configurations.

    Returns
    -------
    ndarray, shape (strings,) or (N, strings)
        In m, in the order of `strings_of`: the lengths of strings that are taut.
    """
    strings = strings_of(mechanism)
    hooks = mechanism.positions(q, [string.hook for string in strings])
    return np.asarray(np.linalg.norm(hooks - mechanism.positions(q, [string.control for string in strings]), axis=-1))


def _control_of(mechanism: Mechanism) -> Control | None:
    moved = set(mechanism.kinematic)
    for control, bars in CONTROLS.items():
        hands = [string for string in strings_on(control) if isinstance(string, PuppetString)]
        needed = {name for bar in bars for name in bar.variables} | {name for s in hands for name in (s.x, s.y)}
        if moved - {s.length for s in hands} == needed:
            return control
    return None
