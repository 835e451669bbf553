"""A builder that records the calls made to it, and its own forward kinematics in NumPy."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
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
    coordinates: list[tuple[dict[int, float], float]] = field(default_factory=list)
    bodies: list[tuple[int, float, Any, Any]] = field(default_factory=list)
    points: list[tuple[int, Any]] = field(default_factory=list)
    gravity: Any = None
    distances: list[tuple[int, int, float, int]] = field(default_factory=list)
    damping: list[tuple[int, float]] = field(default_factory=list)
    forces: list[tuple[int, int]] = field(default_factory=list)
    numbers: list[float] = field(default_factory=list)
    directions: list[tuple[int, Any]] = field(default_factory=list)
    scalars: list[tuple[Any, ...]] = field(default_factory=list)
    laws: list[tuple[Any, ...]] = field(default_factory=list)
    elements: list[tuple[Any, ...]] = field(default_factory=list)

    def add_joint(self, parent, pose, twist, variable, factor=1.0, offset=0.0):
        assert -1 <= parent < len(self.joints), "parents come before children"
        assert pose.shape == (4, 4)
        assert twist.shape == (6,)
        self.joints.append((parent, pose, twist, variable))
        self.coordinates.append(({variable: factor}, offset))
        return len(self.joints) - 1

    def couple_joint(self, joint, variable, factor):
        factors, _ = self.coordinates[joint]
        assert variable not in factors, "one term for each variable"
        factors[variable] = factor

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
        assert g.shape == (3,)
        self.gravity = g
        first = len(self.numbers)
        self.numbers.extend(map(float, g))
        return first

    def add_distance(self, point1, point2, length, variable=-1):
        self.distances.append((point1, point2, length, variable))
        return self.add_number(length) if variable < 0 else -1

    def add_damping(self, variable, coefficient):
        self.damping.append((variable, coefficient))
        return self.add_number(coefficient)

    def add_joint_force(self, variable, input):  # noqa: A002 - the core's name
        self.forces.append((variable, input))

    # What elements are made of: numbers, directions, scalar coordinates, laws. Points, directions and slots are
    # written down as what they stand for, so that tests can read them.

    def add_number(self, value):
        assert isinstance(value, float)
        self.numbers.append(value)
        return len(self.numbers) - 1

    def add_direction(self, joint, direction):
        assert direction.shape == (3,)
        assert direction.flags.c_contiguous
        self.directions.append((joint, direction))
        return len(self.directions) - 1

    def add_coincidence(self, point1, point2, direction):
        self.elements.append(("coincidence", point1, point2, tuple(direction)))

    def scalar(self, *call):
        self.scalars.append(call)
        return len(self.scalars) - 1

    def variables_coordinate(self, variables, factor_slots):
        assert len(variables) == len(factor_slots) > 0
        return self.scalar("sum", tuple(variables), self.at(factor_slots))

    def offset_coordinate(self, coordinate, slot=-1, variable=-1):
        number = None if slot < 0 else self.numbers[slot]
        return self.scalar("offset", self.scalars[coordinate], number, variable)

    def path_coordinate(self, points):
        assert isinstance(points, list)
        assert all(0 <= point < len(self.points) for point in points)
        return self.scalar("path", tuple(points))

    def component_coordinate(self, point1, point2, direction):
        return self.scalar("component", point1, point2, direction)

    def product_coordinate(self, direction1, direction2):
        return self.scalar("product", direction1, direction2)

    def tape_coordinate(self, points, directions, variables, tape, slots):
        assert tape.n_inputs == 3 * len(points) + 3 * len(directions) + len(variables) + len(slots)
        return self.scalar("tape", points, directions, variables, tape, self.at(slots))

    def new_law(self, *call):
        self.laws.append(call)
        return len(self.laws) - 1

    def law(self, kind, slots):
        return self.new_law(kind, *self.at(slots))

    def piecewise_law(self, breaks, coefficients, scale_slot):
        assert coefficients.shape[0] == len(breaks) - 1
        assert coefficients.flags.c_contiguous
        return self.new_law("piecewise", breaks, coefficients, self.numbers[scale_slot])

    def tape_law(self, tape, slots):
        assert tape.n_inputs == 1 + len(slots)
        return self.new_law("tape", tape, *self.at(slots))

    def add_constraint(self, coordinate, slot=-1, variable=-1):
        number = None if slot < 0 else self.numbers[slot]
        self.elements.append(("constraint", self.scalars[coordinate], number, None if variable < 0 else variable))

    def add_potential(self, coordinate, law=-1):
        shape = None if law < 0 else self.laws[law]
        self.elements.append(("potential", self.scalars[coordinate], shape))

    def add_force(self, coordinate, gain_slot, input=-1, law_s=-1, law_v=-1):  # noqa: A002
        laws = [None if law < 0 else self.laws[law] for law in (law_s, law_v)]
        given = None if input < 0 else input
        self.elements.append(("force", self.scalars[coordinate], self.numbers[gain_slot], given, *laws))

    def add_tape_force(self, coordinates, inputs, tape, slots):
        assert tape.n_inputs == 2 * len(coordinates) + len(inputs) + len(slots)
        along = [self.scalars[coordinate] for coordinate in coordinates]
        self.elements.append(("tape force", along, tuple(inputs), tape, self.at(slots)))

    def counts(self):
        # What the core counts, as far as a description is compiled by it: whether an element is a potential of its own.
        return SimpleNamespace(potentials=sum(kind == "potential" for kind, *_ in self.elements))

    def add_wrench(self, kind, joint, pose, slots, inputs):
        assert pose.shape == (4, 4)
        assert len(slots) == len(inputs) == 6
        assert all((slot < 0) != (given < 0) for slot, given in zip(slots, inputs, strict=True))
        numbers = [None if slot < 0 else self.numbers[slot] for slot in slots]
        self.elements.append(("wrench", kind, joint, pose, numbers, list(inputs)))

    def at(self, slots):
        """The numbers in slots."""
        return tuple(self.numbers[slot] for slot in slots)

    def joint_poses(self, q):
        """World pose of the moved frame of every joint."""
        poses = []
        for (parent, base, twist, _), (factors, offset) in zip(self.joints, self.coordinates, strict=True):
            carrier = np.eye(4) if parent < 0 else poses[parent]
            s = offset + sum(factor * q[variable] for variable, factor in factors.items())
            poses.append(carrier @ base @ expm(twist_matrix(twist) * s))
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
