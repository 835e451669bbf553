"""The mechanism as its elements see it while they are checked: names, and what moves what."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from leastaction.mechanics.description.poses import exponential
from leastaction.mechanics.description.tree import WORLD, Tree, TreeFrame
from leastaction.numerics.arrays import Array

# Distance of two points, relative to the lengths that it sums, below which it is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Context:
    """Frames, joints and names in their final order.

    Attributes
    ----------
    tree : Tree
        Frames and joints.
    dynamic, kinematic, inputs : tuple of str
        Names in their final order.
    """

    tree: Tree
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    inputs: tuple[str, ...]

    @cached_property
    def frames(self) -> Mapping[str, int]:
        """Index of every frame in ``tree.frames``."""
        return {frame.name: index for index, frame in enumerate(self.tree.frames)}

    @cached_property
    def variables(self) -> Mapping[str, int]:
        """Index of every configuration variable in q: dynamic first, then kinematic."""
        return {name: index for index, name in enumerate(self.dynamic + self.kinematic)}

    @cached_property
    def is_dynamic(self) -> frozenset[str]:
        """The names of the dynamic variables."""
        return frozenset(self.dynamic)

    @cached_property
    def turns(self) -> Mapping[str, str]:
        """The turns of rotations that are quaternions, with the names of their joints: rates without a coordinate."""
        return {name: rotation.name for rotation in self.tree.rotations for name in rotation.variables}

    @property
    def world(self) -> str:
        """Name of the world frame."""
        return self.tree.frames[0].name

    def placed(self, frame: str) -> TreeFrame:
        """Return a frame of the tree: its joint, and its pose there."""
        return self.tree.frames[self.frames[frame]]

    def moving(self, *frames: str, turning: bool = False) -> frozenset[str]:
        """The variables that move (or turn) consecutive frames relative to each other.

        For a single frame, relative to the world.
        """
        path = frames if len(frames) > 1 else (self.world, *frames)
        joints: set[int] = set()
        for frame1, frame2 in pairwise(path):
            joints |= set(self._above(frame1)) ^ set(self._above(frame2))
        return frozenset(
            name
            for joint in (self.tree.joints[index] for index in joints)
            if not turning or joint.twist[3:].any()
            for name in joint.variables
        )

    def behind(self, frames: Iterable[str], variables: Iterable[str]) -> frozenset[str]:
        """The variables that a function of these frames and variables may depend on."""
        return frozenset(variables).union(*(self.moving(frame) for frame in frames))

    def always_together(self, frame1: str, frame2: str) -> bool:
        """Whether the origins of two frames coincide in every configuration.

        Two configurations of no special shape tell: what holds at both holds everywhere.
        """
        common = set(self._above(frame1)) & set(self._above(frame2))
        for at in self._somewhere:
            # Lengths near the largest double may overflow; they are not together then.
            with np.errstate(over="ignore", invalid="ignore"):
                (first, reach1), (second, reach2) = (self._origin(frame, common, at) for frame in (frame1, frame2))
                apart = float(np.abs(first - second).max())
            if not apart <= ROUNDING * (reach1 + reach2) < np.inf:
                return False
        return True

    @cached_property
    def _somewhere(self) -> tuple[dict[str, float], ...]:
        values = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(self.variables)))
        return tuple(dict(zip(self.variables, row.tolist(), strict=True)) for row in values)

    def _origin(self, frame: str, common: set[int], values: Mapping[str, float]) -> tuple[Array, float]:
        """Origin of a frame (3,) before the nearest of the common joints, and the lengths it sums."""
        placed = self.placed(frame)
        origin, joint = placed.pose[:3, 3], placed.joint
        reach = float(np.abs(origin).max())
        while joint != WORLD and joint not in common:
            passed = self.tree.joints[joint]
            value = passed.coordinate.offset + sum(f * values[name] for name, f in passed.coordinate.terms)
            motion = passed.pose @ exponential(passed.twist, value)
            origin = motion[:3, :3] @ origin + motion[:3, 3]
            reach += float(np.abs(passed.pose[:3, 3]).max() + np.abs(motion[:3, 3]).max())
            joint = passed.parent
        return origin, reach

    def _above(self, frame: str) -> tuple[int, ...]:
        joint = self.placed(frame).joint
        return () if joint == WORLD else self.tree.ancestors(joint)
