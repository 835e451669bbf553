"""What files of mechanisms say, in one form for all formats: links, joints, masses, in SI units and radians.

The readers (`urdf`, `mjcf`) make it, and `assembly` makes a mechanism of it. Names of links and of joints are unique.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from leastaction.io.mechanisms.model import LeftOut
from leastaction.mechanics.description.shapes import Shape
from leastaction.numerics.arrays import Array

Axes = Literal["quaternion", "xyz"]
"""How a ball or a free joint turns."""

Range = tuple[float | None, float | None]
"""The least and the largest value; None where there is no bound."""


@dataclass(frozen=True)
class Mimic:
    """How one joint follows another: ``value = factor * value of joint + offset``."""

    joint: str
    factor: float
    offset: float


@dataclass(frozen=True, kw_only=True)
class JointPart:
    """A joint of a link, in the frame of the link.

    ``axis``, ``point``: of a hinge or a slide. ``reference``: its value where the link is as the file draws it.
    ``range``: of its value. ``effort``: of the forces of all actuators on it. ``damping``, ``stiffness``: coefficients
    of rising powers. ``rest``: value at which the spring is slack. ``friction``: dry friction (N or N m).
    ``settles``: time constant (s) and damping ratio that its spring and damper are to have at its reference. ``axes``:
    of a ball or a free joint, a unit quaternion or angles about x, then y, then z.
    """

    name: str
    kind: Literal["hinge", "slide", "ball", "free"]
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    point: Array = field(default_factory=lambda: np.zeros(3))
    reference: float = 0.0
    range: Range = (None, None)
    speed: float | None = None
    effort: Range = (None, None)
    damping: tuple[float, ...] = ()
    stiffness: tuple[float, ...] = ()
    rest: float = 0.0
    armature: float = 0.0
    friction: float = 0.0
    settles: tuple[float, float] | None = None
    mimic: Mimic | None = None
    axes: Axes = "quaternion"


@dataclass(frozen=True)
class MassPart:
    """Mass (kg), centre of mass (m) and inertia about it (kg m^2), in the frame of the link."""

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class SitePart:
    """A named place on a link."""

    name: str
    pose: Array


@dataclass(frozen=True, kw_only=True)
class LinkPart:
    """A link: where it is in its parent (an index, -1 for the world), its joints one behind the other, its mass.

    ``lift``: the share of its weight that something takes off it.
    """

    name: str
    parent: int
    pose: Array
    joints: tuple[JointPart, ...] = ()
    mass: MassPart | None = None
    sites: tuple[SitePart, ...] = ()
    lift: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A whole file: links in depth-first order, the world's own sites, gravity, what it looks like.

    ``world``: the name of the world's frame. ``left_out``: what the reader did not take over.
    """

    name: str
    links: tuple[LinkPart, ...]
    gravity: Array
    world: str = "world"
    sites: tuple[SitePart, ...] = ()
    shapes: tuple[Shape, ...] = ()
    left_out: tuple[LeftOut, ...] = ()

    @property
    def joints(self) -> dict[str, JointPart]:
        """Every joint by name, in the order of the links."""
        return {joint.name: joint for link in self.links for joint in link.joints}


def world_name(links: list[str]) -> str:
    """Return the name of the world's frame: "world", or "ground" where a link is called that."""
    names = ("world", "ground", "fixed_world")
    return next(name for name in names if name not in links)
