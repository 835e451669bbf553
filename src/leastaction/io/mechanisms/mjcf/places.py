"""`Places`: where the bodies and sites of an MJCF are as the file draws it, and what moves them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np

from leastaction.io.mechanisms.mjcf.spec import pose_in_body
from leastaction.io.mechanisms.names import Names
from leastaction.numerics.arrays import Array


class Places:
    """Bodies and sites of a specification by name; "world" is the world, and so is an empty name."""

    def __init__(self, spec: Any) -> None:
        self.spec = spec

    @cached_property
    def bodies(self) -> dict[str, Any]:
        """Every named body."""
        return {body.name: body for body in _below(self.spec.worldbody) if body.name}

    @cached_property
    def sites(self) -> dict[str, Any]:
        """Every named site."""
        return {site.name: site for site in self.spec.sites if site.name}

    def body(self, name: str) -> Any:
        """Return a body by its name."""
        return self.spec.worldbody if name in ("", "world") else self.bodies[name]

    def body_pose(self, body: Any) -> Array:
        """Return the pose (4, 4) of a body in the world."""
        pose = np.eye(4)
        while body.parent is not None and body.name != "world":
            pose, body = pose_in_body(body, self.spec) @ pose, body.parent
        return pose

    def site_pose(self, name: str) -> Array:
        """Return the pose (4, 4) of a site in the world."""
        site = self.sites[name]
        return self.body_pose(site.parent) @ pose_in_body(site, self.spec)

    def movers(self, body: Any, names: Names) -> frozenset[str]:
        """Return the joints that move a body in the mechanism."""
        found: set[str] = set()
        while body.parent is not None and body.name != "world":
            for joint in body.joints:
                # One without a name cannot be asked for, so nobody has fixed it.
                known = names.joints.get(joint.name)
                if not joint.name or known is not None:
                    found.add(joint.name or f"a joint of {body.name}")
            body = body.parent
        return frozenset(found)


def _below(body: Any) -> Iterator[Any]:
    for child in body.bodies:
        yield child
        yield from _below(child)
