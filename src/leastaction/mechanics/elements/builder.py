"""The part of the core's mechanism builder that descriptions are compiled to.

Everything that is added is an index from then on: joints (-1 is the world), points, directions,
variables (of q), inputs (of u), coordinates, laws, and slots, the places of numbers. All plain numbers of
elements live in one vector of the mechanism, so that they can change without another compilation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from leastaction.numerics.arrays import Array


class TreeBuilder(Protocol):
    """Joints, bodies, and what is fixed to them."""

    def add_joint(
        self,
        parent: int,
        pose: Array,
        twist: Array,
        variable: int,
        factor: float = 1.0,
        offset: float = 0.0,
        /,
    ) -> int:
        """Add a joint with the coordinate ``factor q[variable] + offset``.

        Its base (4, 4) is in the parent's moved frame, its twist (6,) in the base.
        """
        ...

    def couple_joint(self, joint: int, variable: int, factor: float, /) -> None:
        """Add ``factor q[variable]`` to the coordinate of a joint."""
        ...

    def add_body(self, joint: int, mass: float, com: Array, inertia: Array, /) -> None:
        """Add a body in the moved frame of a joint; inertia (3, 3) about the centre of mass."""
        ...

    def add_point(self, joint: int, offset: Array, /) -> int:
        """Add a point (3,) in the moved frame of a joint."""
        ...

    def add_direction(self, joint: int, direction: Array, /) -> int:
        """Add a vector (3,) that is fixed in the moved frame of a joint."""
        ...

    def add_number(self, value: float, /) -> int:
        """Add a number and return its slot."""
        ...

    def set_number(self, slot: int, value: float, /) -> None:
        """Change the number of a slot."""
        ...

    def set_gravity(self, g: Array, /) -> None:
        """Set the acceleration of gravity (3,)."""
        ...


class CoordinateBuilder(Protocol):
    """Scalar functions s(q), each with its gradient and Hessian; each method returns a coordinate."""

    def variables_coordinate(self, variables: Sequence[int], factor_slots: Sequence[int], /) -> int:
        """Add ``s = sum of factor q[variable]``."""
        ...

    def path_coordinate(self, points: Sequence[int], /) -> int:
        """Add the length of the polyline through two points or more (m)."""
        ...

    def component_coordinate(self, point1: int, point2: int, direction: int, /) -> int:
        """Add ``s = e . (p1 - p2)`` with the direction e (m if that has unit length)."""
        ...

    def product_coordinate(self, direction1: int, direction2: int, /) -> int:
        """Add ``s = d1 . d2``."""
        ...

    def tape_coordinate(
        self,
        points: Sequence[int],
        directions: Sequence[int],
        variables: Sequence[int],
        tape: Any,
        slots: Sequence[int],
        /,
    ) -> int:
        """Add the value of a tape.

        Its inputs are x y z of each point, x y z of each direction, the variables, then the numbers.
        """
        ...

    def python_coordinate(
        self,
        points: Sequence[int],
        directions: Sequence[int],
        variables: Sequence[int],
        function: Callable[..., Any],
        /,
    ) -> int:
        """Add the value of a Python function of the same inputs without the numbers."""
        ...


class LawBuilder(Protocol):
    """Scalar laws of one argument; each method returns a law."""

    def law(self, kind: str, slots: Sequence[int], /) -> int:
        """Add a law of a known kind with its numbers.

        ``linear`` (k): k x. ``spring`` (k, x0): k/2 (x - x0)^2. ``polynomial`` (c0, c1, ...).
        ``inverse`` (c): c/x. ``tanh`` (m, e): m tanh(x/e). ``taut`` (k, x0, e): k/2 of the square of
        ``e log(1 + exp((x - x0)/e))``.
        """
        ...

    def piecewise_law(self, breaks: Array, coefficients: Array, scale_slot: int, /) -> int:
        """Add polynomial pieces times a scale; row i in ascending powers of ``x - breaks[i]``."""
        ...

    def tape_law(self, tape: Any, slots: Sequence[int], /) -> int:
        """Add a tape of x, then the numbers."""
        ...


class Builder(TreeBuilder, CoordinateBuilder, LawBuilder, Protocol):
    """All of it: the tree, the coordinates, the laws, and the elements made of them."""

    def add_distance(self, point1: int, point2: int, length: float, variable: int = -1, /) -> int:
        """Hold the distance of two points; return the slot of the length, -1 if a variable is."""
        ...

    def add_coincidence(self, point1: int, point2: int, direction: Array, /) -> object:
        """Let two points coincide along a direction (3,) of the world."""
        ...

    def add_constraint(self, coordinate: int, slot: int = -1, variable: int = -1, /) -> object:
        """Add ``h = s - number - q[variable]``; -1 leaves a term out."""
        ...

    def add_potential(self, coordinate: int, law: int = -1, /) -> object:
        """Add ``V = law(s)``, or s itself."""
        ...

    def add_damping(self, variable: int, coefficient: float, /) -> int:
        """Add the force -c v on a variable; return the slot of c."""
        ...

    def add_joint_force(self, variable: int, input_index: int, /) -> object:
        """Add an input onto a variable."""
        ...

    def add_force(
        self,
        coordinate: int,
        gain_slot: int,
        input_index: int = -1,
        law_s: int = -1,
        law_v: int = -1,
        /,
    ) -> object:
        """Add ``f_i = F ds/dq_i`` with ``F = gain (u) law_s(s) law_v(sdot)``; -1 leaves a factor out."""
        ...

    def add_tape_force(
        self,
        coordinates: Sequence[int],
        inputs: Sequence[int],
        tape: Any,
        slots: Sequence[int],
        /,
    ) -> object:
        """Add ``f_i = F ds/dq_i`` along the first coordinate.

        F is a tape of all coordinates, all their rates, the inputs, then the numbers.
        """
        ...

    def add_wrench(
        self,
        kind: str,
        joint: int,
        pose: Array,
        slots: Sequence[int],
        inputs: Sequence[int],
        /,
    ) -> object:
        """Add a ``spatial``, ``body`` or ``hybrid`` wrench ``[fx fy fz tx ty tz]`` on a frame.

        The frame has a pose (4, 4) in the joint's moved frame; of each component either the slot of its
        number or its input is given, the other is -1.
        """
        ...
