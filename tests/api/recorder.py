"""A builder that records the calls made to it, and its own forward kinematics in NumPy."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import expm


def twist_matrix(twist):
    """The 4x4 matrix of a twist [v; w], whose exponential is the motion."""
    v, w = twist[:3], twist[3:]
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]
    matrix[:3, 3] = v
    return matrix


@dataclass
class Recorder:
    """Stands in for the core's builder."""

    joints: list[tuple[int, Any, Any, int]] = field(default_factory=list)
    bodies: list[tuple[int, float, Any, Any]] = field(default_factory=list)
    points: list[tuple[int, Any]] = field(default_factory=list)
    gravity: Any = None
    distances: list[tuple[int, int, float, int]] = field(default_factory=list)
    damping: list[tuple[int, float]] = field(default_factory=list)
    forces: list[tuple[int, int]] = field(default_factory=list)

    def add_joint(self, parent, pose, twist, variable):
        assert -1 <= parent < len(self.joints), "parents come before children"
        assert pose.shape == (4, 4)
        assert twist.shape == (6,)
        self.joints.append((parent, pose, twist, variable))
        return len(self.joints) - 1

    def add_body(self, joint, mass, com, inertia):
        assert -1 <= joint < len(self.joints)
        assert com.shape == (3,)
        assert inertia.shape == (3, 3)
        self.bodies.append((joint, mass, com, inertia))

    def add_point(self, joint, offset):
        assert offset.shape == (3,)
        self.points.append((joint, offset))
        return len(self.points) - 1

    def set_gravity(self, g):
        self.gravity = g

    def add_distance(self, point1, point2, length, variable=-1):
        self.distances.append((point1, point2, length, variable))

    def add_damping(self, variable, coefficient):
        self.damping.append((variable, coefficient))

    def add_joint_force(self, variable, input):  # noqa: A002 - the core's name
        self.forces.append((variable, input))

    def joint_poses(self, q):
        """World pose of the moved frame of every joint."""
        poses = []
        for parent, base, twist, variable in self.joints:
            carrier = np.eye(4) if parent < 0 else poses[parent]
            poses.append(carrier @ base @ expm(twist_matrix(twist) * q[variable]))
        return poses

    def subtrees_are_contiguous(self):
        """Whether the joints are in depth-first preorder."""
        for index, (parent, *_) in enumerate(self.joints):
            # In preorder, the parent is the previous joint or an ancestor of it.
            previous, ancestors = index - 1, {-1}
            while previous >= 0:
                ancestors.add(previous)
                previous = self.joints[previous][0]
            if parent not in ancestors:
                return False
        return True
