"""`Model`: a mechanism and what its file says beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from leastaction.mechanics import Mechanism
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics.public import public
from leastaction.optimal import Limit


@public
@dataclass(frozen=True)
class LeftOut:
    """Something that a file says and the mechanism does not have.

    Attributes
    ----------
    name : str
        What it is, by its name in the file.
    why : str
        Why it was left out, or what stands in its place.
    """

    name: str
    why: str

    def __str__(self) -> str:
        return f"{self.name}: {self.why}"


@public
@dataclass(frozen=True)
class Keyframe:
    """A configuration that a file names.

    Attributes
    ----------
    q, v : mapping of str to float
        Value of each coordinate, and rate of each variable (m or rad, m/s or rad/s):
        ``mechanism.configuration(keyframe.q)``, ``mechanism.velocity(keyframe.v)``.
    inputs : mapping of str to float
        The inputs that belong to it, where the file gives them.
    """

    q: Mapping[str, float]
    v: Mapping[str, float] = field(default_factory=dict)
    inputs: Mapping[str, float] = field(default_factory=dict)


@public
@dataclass(frozen=True, kw_only=True)
class Model:
    """A mechanism and what its file says beside it; made by `leastaction.load`.

    Attributes
    ----------
    mechanism : Mechanism
        The mechanism.
    name : str
        What the file calls it.
    limits : tuple of Limit
        `Bound` of inputs, variables and rates, `PathBound` of lengths of tendons, and `Oriented` of the angles of ball
        joints, ready for `optimize`.
    keyframes : mapping of str to Keyframe
        Configurations by name.
    reference : mapping of str to float
        The configuration in which the file draws it, by coordinate (m or rad).
    shapes : tuple of Shape
        What its frames look like.
    left_out : tuple of LeftOut
        What the file says and the mechanism does not have, and why.
    """

    mechanism: Mechanism
    name: str = ""
    limits: tuple[Limit, ...] = ()
    keyframes: Mapping[str, Keyframe] = field(default_factory=dict)
    reference: Mapping[str, float] = field(default_factory=dict)
    shapes: tuple[Shape, ...] = ()
    left_out: tuple[LeftOut, ...] = ()

    def __str__(self) -> str:
        """Return a summary: the mechanism, and how much there is beside it."""
        m = self.mechanism
        counts = {"variable": m.nv, "input": m.n_inputs, "constraint": m.nc}
        counts |= {"limit": len(self.limits), "shape": len(self.shapes)}
        told = (f"{count} {what}{'s' * (count != 1)}" for what, count in counts.items())
        lines = [f"{self.name or 'model'}: {', '.join(told)}"]
        if self.keyframes:
            lines.append(f"keyframes: {', '.join(self.keyframes)}")
        lines += [f"left out: {each}" for each in self.left_out]
        return "\n".join(lines)
