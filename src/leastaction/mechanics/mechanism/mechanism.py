"""`Mechanism`: a compiled, immutable mechanism and the questions it answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, final

import numpy as np
import numpy.typing as npt

from leastaction import _core
from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.description.branch import Branch
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.description.masses import check_masses
from leastaction.mechanics.description.tree import Ball, Tree
from leastaction.mechanics.elements import Constraint, Element, Force, Parts, Potential
from leastaction.mechanics.mechanism.compilation import Plan, plan
from leastaction.mechanics.mechanism.constraint_queries import dependent_rows
from leastaction.mechanics.mechanism.frame_derivatives import jacobian_derivative, pose_derivative
from leastaction.mechanics.mechanism.frame_queries import Axes, PathMotion, inverted, origins_of, poses_of
from leastaction.mechanics.mechanism.function_derivatives import FunctionDerivatives
from leastaction.mechanics.mechanism.function_queries import ConstraintsAt, ForceAt, LagrangianAt, PotentialAt
from leastaction.mechanics.mechanism.mass_queries import (
    Energy,
    center_of_mass_of,
    energy_of,
    mass_of,
    total_momentum_of,
)
from leastaction.mechanics.mechanism.parameters import (
    Place,
    Prescribed,
    check_names,
    checked,
    find,
    freed,
    parameter_places,
    parameter_value,
    with_values,
)
from leastaction.mechanics.mechanism.view import tree_view
from leastaction.mechanics.mechanism.view_html import html_view
from leastaction.numerics.arrays import Array, as_array, as_count, as_number, shape_of
from leastaction.numerics.memory import MAX_BYTES, check_memory

__all__ = ["Energy", "Mechanism"]


@final
class Mechanism:
    """A mechanism: a tree of frames with bodies, and the elements that act on it.

    The description is checked and compiled once; after that nothing in a mechanism changes, so threads
    may share one. Configurations are arrays in the order of `variables`: dynamic first, then kinematic.

    Parameters
    ----------
    description : nested list of frames, or Branch
        Frames, each of which may be followed by the list of its children; or the result of chained calls
        that started at `world`.
    elements : sequence of Element, optional
        Gravity, forces, constraints.
    dynamic, kinematic, inputs : sequence of str, optional
        Order of the names in every array. By default the order in which the tree, then the elements meet them.

    Attributes
    ----------
    nd, nrho, nq, n_inputs, nc, nx : int
        How many dynamic variables, kinematic ones, both, inputs (of forces), scalar constraints, and
        entries of the discrete state ``x = [q; rho; p; v_rho]``.
    core : _core.Mechanism
        The compiled mechanism.

    Raises
    ------
    DescriptionError
        For an unknown or duplicate name, a cycle, a number that is not finite, a mass or inertia that no
        body has, a dynamic variable that moves no mass, or an element that does not fit.
    """

    __slots__ = (
        "_frame_index", "_owners", "_parts", "_plan", "_slots", "_whole", "core", "n_inputs", "nc", "nd", "nq", "nrho",
        "nx",
    )  # fmt: skip

    _plan: Plan
    _frame_index: Mapping[str, int]
    _slots: Mapping[str, int]
    _owners: Mapping[str, tuple[str, str]]
    _parts: Mapping[str, Parts]
    _whole: Parts
    core: _core.Mechanism
    nd: int
    nrho: int
    nq: int
    n_inputs: int
    nc: int
    nx: int

    def __init__(
        self,
        description: Branch | Sequence[Any],
        elements: Sequence[Element] = (),
        *,
        dynamic: Sequence[str] | None = None,
        kinematic: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
    ) -> None:
        self._compile(plan(flatten(description), elements, dynamic=dynamic, kinematic=kinematic, inputs=inputs))

    def _compile(self, settled: Plan, *, like: _core.Mechanism | None = None) -> None:
        nd, nrho, n_inputs = map(len, (settled.dynamic, settled.kinematic, settled.inputs))
        builder = _core.MechanismBuilder(nd, nrho, n_inputs)
        context = settled.emit(builder)
        fields: dict[str, Any] = {
            "_plan": settled,
            "_frame_index": {f.name: i for i, f in enumerate(settled.tree.frames)},
            "_slots": context.parameters,
            "_owners": context.owners,
            "_parts": context.parts,
            "_whole": Parts(_core.ElementCounts(), builder.counts(), uniform_gravity=True),
            "core": builder.build() if like is None else _build_like(builder, like),
            "nd": nd,
            "nrho": nrho,
            "nq": nd + nrho,
            "n_inputs": n_inputs,
            "nc": len(settled.constraints),
            "nx": 2 * (nd + nrho),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        if like is None:
            check_names(self.tree, context.parameters)
            check_masses(self.tree, self.variables, self.core)

    # Names

    @property
    def tree(self) -> Tree:
        """The frames and joints that the description came to."""
        return self._plan.tree

    @property
    def elements(self) -> dict[str, Element]:
        """The elements by name (a copy)."""
        return dict(self._plan.elements)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the frames in depth-first order; the world first."""
        return tuple(self._frame_index)

    @property
    def dynamic(self) -> tuple[str, ...]:
        """Names of the dynamic variables, in the order of the first nd entries of q."""
        return self._plan.dynamic

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Names of the kinematic variables, in the order of the last nrho entries of q."""
        return self._plan.kinematic

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of all configuration variables, in the order of q."""
        return self._plan.dynamic + self._plan.kinematic

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the force inputs."""
        return self._plan.inputs

    @property
    def nu(self) -> int:
        """The same as `n_inputs`."""
        return self.n_inputs

    @property
    def constraints(self) -> tuple[str, ...]:
        """Names of the scalar constraint equations."""
        return self._plan.constraints

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The ball joints, those of free joints too, whose singularity is watched."""
        return self.tree.balls

    def configuration(self, values: Mapping[str, float] | None = None, *, default: float = 0.0) -> Array:
        """Return a configuration (or velocity) from values by name.

        Parameters
        ----------
        values : mapping of str to float, optional
            Value of some variables (m or rad).
        default : float, optional
            Value of the others.

        Returns
        -------
        ndarray, shape (nq,)

        Raises
        ------
        ArgumentError
            For an unknown name or a value that is not a finite number.
        """
        q = np.full(self.nq, as_number(default, "default"))
        order = {name: index for index, name in enumerate(self.variables)}
        for name, value in (values or {}).items():
            if name not in order:
                raise ArgumentError(f"unknown variable {name!r}; {closest(name, order, what='variables')}")
            q[order[name]] = as_number(value, f"the value of {name!r}")
        return q

    def named(self, q: npt.ArrayLike) -> dict[str, Any]:
        """Return the entries of a configuration by name: floats, or arrays (N,) for a batch (N, nq)."""
        values, single = self._batch(q)
        columns = values.T
        return {
            name: float(column[0]) if single else column.copy()
            for name, column in zip(self.variables, columns, strict=True)
        }

    # The same with changes

    def with_elements(self, elements: Sequence[Element]) -> Mechanism:
        """Return the same mechanism with more elements; names and orders stay, new inputs come last.

        Parameters
        ----------
        elements : sequence of Element
            What to add.

        Raises
        ------
        DescriptionError
            If they do not fit, as when they are given with the description.
        """
        added = [name for e in elements for name in e.uses.inputs if name not in self.inputs]
        result = Mechanism.__new__(Mechanism)
        result._compile(
            plan(
                self.tree,
                [*self._plan.elements.values(), *elements],
                dynamic=self.dynamic,
                kinematic=self.kinematic,
                inputs=[*self.inputs, *dict.fromkeys(added)],
                numbers=self._plan.numbers,
            )
        )
        return result

    def with_exchanged(self, elements: Mapping[str, Sequence[Element]]) -> Mechanism:
        """Return the same mechanism with others in the place of some elements; orders stay, new names come last.

        Parameters
        ----------
        elements : mapping of str to sequence of Element
            What comes in the place of elements, by their names; nothing in that of an empty sequence.

        Raises
        ------
        ArgumentError
            For a name that no element has.
        DescriptionError
            If they do not fit, as when they are given with the description.
        """
        for name in elements:
            if name not in self.elements:
                raise ArgumentError(f"elements: unknown name {name!r}; {closest(name, self.elements, what='elements')}")
        kept = [(elements.get(name, (each,))) for name, each in self._plan.elements.items()]
        flat = [each for group in kept for each in group]
        used = [name for each in flat for name in (*each.uses.kinematic, *each.uses.either)]
        kinematic = [name for name in self.kinematic if name in self.tree.kinematic or name in used]
        inputs = [name for each in flat for name in each.uses.inputs]
        gone = tuple(f"{name}." for name in elements)
        result = Mechanism.__new__(Mechanism)
        result._compile(
            plan(
                self.tree,
                flat,
                dynamic=self.dynamic,
                kinematic=kinematic,
                inputs=list(dict.fromkeys([*(n for n in self.inputs if n in inputs), *inputs])),
                numbers={n: value for n, value in self._plan.numbers.items() if not n.startswith(gone)},
            )
        )
        return result

    @property
    def parameters(self) -> dict[str, float]:
        """Every number of the description by name, such as ``"bob.mass"`` or ``"spring.stiffness"``.

        Those of a frame begin with its name, or where it was given none with that of the variable that moves it:
        ``tx("cart", mass=1.0)`` has ``"cart.mass"``. Of bodies the mass (kg), the centre of mass (m) and the
        inertia (kg m^2); of constant frames the coordinate or the translation (m or rad); of joints that move by more
        than one plain variable the factors and the offset, of screws the pitch (m/rad); of elements their numbers, in
        the units of each.
        """
        numbers = self.core.numbers
        return {
            name: parameter_value(self.tree, place, numbers)
            for name, place in parameter_places(self.tree, self._slots).items()
        }

    def parameter_places(self, names: Sequence[str]) -> dict[str, Place]:
        """Return where some named parameters are; raise an `ArgumentError` for a name that is none."""
        return find(self.tree, self._slots, names)

    def with_parameters(self, values: Mapping[str, float]) -> Mechanism:
        """Return the same mechanism with other numbers; its structure is shared, not compiled again.

        The factors of a joint's coordinate are part of the structure: where one changes, it is compiled again.

        Parameters
        ----------
        values : mapping of str to float
            New values by the names of `parameters`; the other numbers stay.

        Raises
        ------
        ArgumentError
            For an unknown name, or a value that is not a finite number.
        DescriptionError
            For a mass, an inertia or a coefficient that cannot be, or where a dynamic variable is left
            without a mass to move.
        """
        numbers = checked(values)
        places = self.parameter_places(list(numbers))
        tree = with_values(self.tree, {places[name]: value for name, value in numbers.items()})
        result = Mechanism.__new__(Mechanism)
        result._compile(self._plan.with_numbers(tree, numbers, self._owners), like=self.core)
        if tree is not self.tree:
            check_masses(tree, self.variables, result.core, self.core)
        return result

    def with_free_lengths(self, lengths: Mapping[str, Prescribed]) -> Mechanism:
        """Return the mechanism with numbers of frames as kinematic variables, after all the others.

        A derivative by a length is one by a prescribed variable that does not move; what a number of a joint changes is
        a prescribed motion, zero where the number has its value.
        """
        result = Mechanism.__new__(Mechanism)
        settled = replace(self._plan, tree=freed(self.tree, lengths), kinematic=(*self.kinematic, *lengths))
        result._compile(settled)
        return result

    # Frames

    def frame_pose(self, q: npt.ArrayLike, name: str, *, inverse: bool = False) -> Array:
        """Return the pose of a frame in the world.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        name : str
            The frame.
        inverse : bool, optional
            Return its inverse: the pose of the world in the frame.

        Returns
        -------
        ndarray, shape (4, 4) or (N, 4, 4)
            Takes coordinates in the frame to coordinates in the world; the inverse takes them back.
        """
        values, single = self._batch(q)
        poses = poses_of(self.tree, self._frame(name), self.core.joint_poses(values))
        return _of(inverted(poses) if inverse else poses, single)

    def frame_pose_derivative(
        self,
        q: npt.ArrayLike,
        frame: str,
        *,
        order: int = 1,
        along: Sequence[npt.ArrayLike] = (),
        inverse: bool = False,
        max_bytes: float = MAX_BYTES,
    ) -> Array:
        """Return the derivative of `frame_pose` by the configuration, of any order (dissertation 2.11, 2.12).

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        frame : str
            The frame.
        order : int, optional
            How often it is differentiated.
        along : sequence of array_like, shape (nq,), optional
            Directions that the last of these derivatives are taken along, `order` of them at most.
        inverse : bool, optional
            Differentiate the inverse of the pose.
        max_bytes : float, optional
            What the result may take: ``128 N nq^(order - len(along))`` bytes.

        Returns
        -------
        ndarray, shape (4, 4, nq, ...) or (N, 4, 4, nq, ...)
            With one axis of nq for every derivative that is along no direction; symmetric in them.

        Raises
        ------
        ArgumentError
            For an unknown frame, an order below one, a wrong shape, or, before anything is made, for a result that
            takes more.
        """
        values, single = self._batch(q)
        motion = self._path_motion(values, frame, (0.0, 0.0, 0.0), "world")
        slots = self._slots_of(motion, "frame_pose_derivative", order, along)
        self._check_size((len(values), 4, 4), slots, max_bytes, "frame_pose_derivative")
        poses = poses_of(self.tree, self._frame(frame), self.core.joint_poses(values))
        return _of(_without(along, pose_derivative(motion, poses, slots, inverse=inverse)), single)

    def positions(self, q: npt.ArrayLike, names: Sequence[str] | None = None) -> Array:
        """Return the origins of frames in the world.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        names : sequence of str, optional
            The frames; all of them, in the order of `frames`, if not given.

        Returns
        -------
        ndarray, shape (len(names), 3) or (N, len(names), 3)
            Metres.
        """
        values, single = self._batch(q)
        if isinstance(names, str):
            raise ArgumentError(f"names: expected a list of frames, got the string {names!r}")
        indices = [self._frame(name) for name in (self.frames if names is None else names)]
        return _of(origins_of(self.tree, indices, self.core.joint_poses(values)), single)

    def frame_jacobian(
        self, q: npt.ArrayLike, frame: str, *, point: npt.ArrayLike = (0.0, 0.0, 0.0), axes: Axes = "world"
    ) -> Array:
        """Return the Jacobian of a frame: its velocity is ``J v``.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        frame : str
            The frame.
        point : array_like, shape (3,), optional
            The point whose velocity is meant, in the frame (m); its origin if not given.
        axes : {"world", "frame"}, optional
            The axes in which the velocities are resolved.

        Returns
        -------
        ndarray, shape (6, nq) or (N, 6, nq)
            Linear velocity of the point, then angular velocity, by the velocity of every variable.

        Raises
        ------
        ArgumentError
            For an unknown frame, other axes or a wrong shape.
        """
        values, single = self._batch(q)
        return _of(self._path_motion(values, frame, point, axes).jacobian(), single)

    def frame_velocity(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
    ) -> Array:
        """Return the velocity of a frame.

        Parameters
        ----------
        q, v : array_like, shape (nq,) or (N, nq)
            Configuration and velocity, or batches of them.
        frame, point, axes
            As in `frame_jacobian`.

        Returns
        -------
        ndarray, shape (6,) or (N, 6)
            Linear velocity of the point (m/s), then angular velocity (rad/s).
        """
        values, speeds, single = self._states(q, v)
        return _of(self._path_motion(values, frame, point, axes).velocity(speeds), single)

    def frame_jacobian_derivative(
        self,
        q: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
        order: int = 1,
        along: Sequence[npt.ArrayLike] = (),
        max_bytes: float = MAX_BYTES,
    ) -> Array:
        """Return the derivative of `frame_jacobian` by the configuration, of any order.

        With ``axes="frame"`` these are the derivatives of the body velocity by one velocity and `order` configuration
        variables (dissertation 2.14, 2.15).

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        frame, point, axes
            As in `frame_jacobian`.
        order, along, max_bytes
            As in `frame_pose_derivative`; the result takes ``48 N nq^(1 + order - len(along))`` bytes.

        Returns
        -------
        ndarray, shape (6, nq, nq, ...) or (N, 6, nq, nq, ...)
            Entry ``[a, i, j]`` is ``dJ[a, i] / dq_j``. The linear half in world axes is symmetric in i and j,
            being the second derivative of a position; the angular one is not, since an angular velocity is
            no derivative of anything.

        Raises
        ------
        ArgumentError
            As `frame_jacobian` and `frame_pose_derivative`.
        """
        values, single = self._batch(q)
        motion = self._path_motion(values, frame, point, axes)
        slots = self._slots_of(motion, "frame_jacobian_derivative", order, along)
        self._check_size((len(values), 6, self.nq), slots, max_bytes, "frame_jacobian_derivative")
        if order == 1 and not len(along):
            return _of(motion.jacobian_derivative(), single)
        slots = [motion.E[None], *slots]
        return _of(_without(along, self._velocity_derivative(motion, values, frame, point, slots)), single)

    def frame_velocity_derivative(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike,
        frame: str,
        *,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
        axes: Axes = "world",
        order: int = 1,
        along: Sequence[npt.ArrayLike] = (),
        max_bytes: float = MAX_BYTES,
    ) -> Array:
        """Return the derivative of `frame_velocity` by the configuration, of any order.

        By the velocity it is linear: `frame_jacobian` and its derivatives. With ``axes="frame"`` it is the derivative
        of the body velocity (dissertation 2.13).

        Parameters
        ----------
        q, v : array_like, shape (nq,) or (N, nq)
            Configuration and velocity, or batches of them.
        frame, point, axes
            As in `frame_jacobian`.
        order, along, max_bytes
            As in `frame_pose_derivative`; the result takes ``48 N nq^(order - len(along))`` bytes.

        Returns
        -------
        ndarray, shape (6, nq, ...) or (N, 6, nq, ...)
            With one axis of nq for every derivative that is along no direction; symmetric in them.

        Raises
        ------
        ArgumentError
            As `frame_jacobian` and `frame_pose_derivative`.
        """
        values, speeds, single = self._states(q, v)
        motion = self._path_motion(values, frame, point, axes)
        slots = self._slots_of(motion, "frame_velocity_derivative", order, along)
        self._check_size((len(values), 6), slots, max_bytes, "frame_velocity_derivative")
        slots = [(speeds @ motion.E.T)[:, :, None], *slots]
        found = self._velocity_derivative(motion, values, frame, point, slots)[:, :, 0]
        return _of(_without(along, found), single)

    # Masses

    def energy(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Energy:
        """Return the kinetic and potential energy (J) at q, v of shape (nq,), or (N, nq) for a batch."""
        values, speeds, single = self._states(q, v)
        energy = energy_of(self.core, values, speeds)
        if single:
            return Energy(float(energy.kinetic[0]), float(energy.potential[0]))
        return energy

    def momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return dL/dv at q, v of shape (nq,): the momentum of every variable, kinematic ones too."""
        momentum: Array = self.core.gradient(self._single(q), self._single(v, "v"))[1]
        return momentum

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """Return the inertia matrix (nq, nq) of all variables at q of shape (nq,)."""
        # L is quadratic in v, so its second derivative by v is the same at any velocity.
        inertia: Array = self.core.hessian(self._single(q), np.zeros(self.nq))[2]
        return inertia

    @property
    def mass(self) -> float:
        """Mass of all bodies (kg), those fixed in the world too."""
        return mass_of(self.tree)

    def center_of_mass(self, q: npt.ArrayLike) -> Array:
        """Return the centre of mass of all bodies, those fixed in the world too.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.

        Returns
        -------
        ndarray, shape (3,) or (N, 3)
            In the world (m).

        Raises
        ------
        ArgumentError
            If the mechanism has no mass.
        """
        values, single = self._batch(q)
        return _of(center_of_mass_of(self.tree, self.core.joint_poses(values)), single)

    def total_momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return the linear and angular momentum of all bodies.

        Parameters
        ----------
        q, v : array_like, shape (nq,) or (N, nq)
            Configuration and velocity, or batches of them.

        Returns
        -------
        ndarray, shape (6,) or (N, 6)
            Linear momentum (kg m/s), then angular momentum about the world origin (kg m^2/s), world axes.
        """
        values, speeds, single = self._states(q, v)
        return _of(total_momentum_of(self.tree, self.core, self.variables, values, speeds), single)

    # Constraints

    def constraint_values(self, q: npt.ArrayLike) -> Array:
        """Return h(q), shape (nc,), or (N, nc) for a batch."""
        values, single = self._batch(q)
        result = np.empty((len(values), self.nc))
        for row, configuration in zip(result, values, strict=True):
            row[:] = self.core.constraints(configuration)
        return _of(result, single)

    def constraint_residuals(self, q: npt.ArrayLike) -> dict[str, Any]:
        """Return h(q) by constraint name: floats, or arrays (N,) for a batch."""
        values = self.constraint_values(q)
        if values.ndim == 1:
            return {n: float(h) for n, h in zip(self.constraints, values, strict=True)}
        return dict(zip(self.constraints, values.T, strict=True))

    def constraint_jacobian(self, q: npt.ArrayLike) -> Array:
        """Return Dh(q), shape (nc, nq), at q of shape (nq,)."""
        jacobian = self.core.constraint_jacobian(self._single(q))
        return np.asarray(jacobian).reshape(self.nc, self.nq)

    def constraint_rank(self, q: npt.ArrayLike) -> int:
        """Return the rank of the constraints on the dynamic variables at q of shape (nq,)."""
        return self.nc - len(self.redundancy(q))

    def degrees_of_freedom(self, q: npt.ArrayLike) -> int:
        """Return nd less the rank of the constraints on the dynamic variables at q of shape (nq,)."""
        return self.nd - self.constraint_rank(q)

    def redundancy(self, q: npt.ArrayLike) -> dict[str, tuple[str, ...]]:
        """Return the constraint equations that ask for nothing new at a configuration.

        Parameters
        ----------
        q : array_like, shape (nq,)
            The configuration.

        Returns
        -------
        dict of str to tuple of str
            Every equation whose gradient by the dynamic variables is a linear combination of those of
            equations listed before it in `constraints`, and which these are; none for a gradient of zero.
            Empty where all equations are independent. At a singular configuration, as a four-bar linkage
            in one line, equations are dependent that are independent elsewhere.

        Raises
        ------
        ArgumentError
            If a gradient is not finite there, as that of a path two points of which meet.
        """
        return dependent_rows(self.constraint_jacobian(q)[:, : self.nd], self.constraints)

    # Functions and their derivatives

    def lagrangian(self, q: npt.ArrayLike, v: npt.ArrayLike) -> FunctionDerivatives:
        """Return the Lagrangian ``L = T - V`` (J) at a state, by ``q`` and ``v``, to the fourth order.

        Parameters
        ----------
        q, v : array_like, shape (nq,)
            Configuration and velocity.

        Returns
        -------
        FunctionDerivatives
            ``L.by("v", "q")`` is `L_vq`, ``L.along(q=dq, v=dv).hessian`` the third order contracted with a direction.
            To the third order where there is a `PythonPotential`.

        Raises
        ------
        ArgumentError
            For wrong shapes or values that are not finite.
        """
        at, speed = self._single(q).copy(), self._single(v, "v").copy()
        evaluate = LagrangianAt(self, self._parts_of(None, Potential), at, speed)
        arguments = {"q": self.nq, "v": self.nq}
        return FunctionDerivatives.of("L", arguments, evaluate, highest_order=self._highest_order(None, Potential))

    def potential(self, q: npt.ArrayLike, element: str | None = None) -> FunctionDerivatives:
        """Return the potential energy (J) at a configuration, by ``q``, to the fourth order.

        Parameters
        ----------
        q : array_like, shape (nq,)
            Configuration.
        element : str, optional
            The potential whose energy is meant; that of all together if not given.

        Returns
        -------
        FunctionDerivatives
            To the third order where there is a `PythonPotential`.

        Raises
        ------
        ArgumentError
            For a wrong shape, an unknown element or one that is no potential.
        """
        evaluate = PotentialAt(self, self._parts_of(element, Potential), self._single(q).copy())
        order = self._highest_order(element, Potential)
        return FunctionDerivatives.of(_called("V", element), {"q": self.nq}, evaluate, highest_order=order)

    def force(
        self, q: npt.ArrayLike, v: npt.ArrayLike, u: npt.ArrayLike | None = None, element: str | None = None
    ) -> FunctionDerivatives:
        """Return the generalised forces (N or N m) on all variables, by ``q``, ``v`` and ``u``, to the second order.

        Parameters
        ----------
        q, v : array_like, shape (nq,)
            Configuration and velocity.
        u : array_like, shape (n_inputs,), optional
            Inputs; zero if not given.
        element : str, optional
            The force that is meant; all together if not given.

        Returns
        -------
        FunctionDerivatives
            Of nq functions, one for each variable, kinematic ones too; `FunctionDerivatives.weighed` contracts them.

        Raises
        ------
        ArgumentError
            For wrong shapes, an unknown element or one that is no force.
        """
        at, speed = self._single(q).copy(), self._single(v, "v").copy()
        given = np.zeros(self.n_inputs) if u is None else as_array(u, "u", (self.n_inputs,), names=self.inputs).copy()
        evaluate = ForceAt(self, self._parts_of(element, Force), at, speed, given)
        arguments = {"q": self.nq, "v": self.nq, "u": self.n_inputs}
        return FunctionDerivatives.of(_called("f", element), arguments, evaluate, rows=self.variables, highest_order=2)

    def constraint(self, q: npt.ArrayLike, element: str | None = None) -> FunctionDerivatives:
        """Return the constraint functions h(q) at a configuration, by ``q``, to the fourth order.

        Parameters
        ----------
        q : array_like, shape (nq,)
            Configuration; the constraints need not hold there.
        element : str, optional
            The constraint that is meant; all of them if not given.

        Returns
        -------
        FunctionDerivatives
            Of as many functions as there are equations; `FunctionDerivatives.weighed` contracts them, with
            multipliers for example. To the third order where there is a `PythonConstraint`.

        Raises
        ------
        ArgumentError
            For a wrong shape, an unknown element or one that is no constraint.
        """
        parts = self._parts_of(element, Constraint)
        rows = self.constraints[parts.first.constraints : parts.last.constraints]
        evaluate = ConstraintsAt(self, parts, self._single(q).copy())
        order = self._highest_order(element, Constraint)
        return FunctionDerivatives.of(_called("h", element), {"q": self.nq}, evaluate, rows=rows, highest_order=order)

    # Arguments

    def _parts_of(self, element: str | None, kind: type[Any]) -> Parts:
        """Return the parts of an element of a kind, or of all elements."""
        if element is None:
            return self._whole
        found = self._plan.elements.get(element)
        known = [name for name, each in self._plan.elements.items() if isinstance(each, kind)]
        if not isinstance(found, kind):
            what = f"{kind.__name__.lower()}s"
            given = f"unknown element {element!r}" if found is None else f"{element!r} is a {type(found).__name__}"
            raise ArgumentError(f"element: {given}; {closest(element, known, what=what)}")
        return self._parts[element]

    def _highest_order(self, element: str | None, kind: type[Any]) -> int:
        """Return to which order the core differentiates an element of a kind, or all of that kind."""
        elements = self._plan.elements
        asked = elements.values() if element is None else [elements[element]]
        return min((each.highest_order for each in asked if isinstance(each, kind)), default=4)

    def _path_motion(self, q: Array, frame: str, point: npt.ArrayLike, axes: Axes) -> PathMotion:
        index, offset = self._frame(frame), as_array(point, "point", (3,))
        return PathMotion.of(self.tree, self.core, self.variables, q, index, offset, axes)

    def _slots_of(self, motion: PathMotion, what: str, order: int, along: Sequence[npt.ArrayLike]) -> list[Array]:
        """Return by what to differentiate: so often by all variables, and along directions."""
        count = as_count(order, f"{what}: order", 1)
        directions = as_array(along, f"{what}: along", (None, self.nq), names=self.variables) if len(along) else ()
        if len(directions) > count:
            raise ArgumentError(f"{what}: got {len(directions)} directions for derivatives of order {count}")
        free = [motion.E[None]] * (count - len(directions))
        return free + [(motion.E @ direction)[None, :, None] for direction in directions]

    def _check_size(self, lead: tuple[int, ...], slots: Sequence[Array], max_bytes: float, what: str) -> None:
        shape = (*lead, *(slot.shape[2] for slot in slots))
        check_memory(shape, max_bytes, what, "give directions, along=[...]")

    def _velocity_derivative(
        self, motion: PathMotion, q: Array, frame: str, point: npt.ArrayLike, slots: Sequence[Array]
    ) -> Array:
        poses = poses_of(self.tree, self._frame(frame), self.core.joint_poses(q))
        return jacobian_derivative(motion, poses, as_array(point, "point", (3,)), slots)

    def _frame(self, name: str) -> int:
        index = self._frame_index.get(name)
        if index is None:
            raise ArgumentError(f"unknown frame {name!r}; {closest(name, self.frames, what='frames')}")
        return index

    def _single(self, q: npt.ArrayLike, what: str = "q") -> Array:
        return as_array(q, what, (self.nq,), names=self.variables)

    def _batch(self, q: npt.ArrayLike, what: str = "q", *, rows: int | None = None) -> tuple[Array, bool]:
        """Return q as (N, nq), and whether it was a single configuration."""
        if len(shape_of(q) or ()) == 2:
            return as_array(q, what, (rows, self.nq), names=self.variables), False
        return self._single(q, what)[None, :], True

    def _states(self, q: npt.ArrayLike, v: npt.ArrayLike) -> tuple[Array, Array, bool]:
        """Return q and v as (N, nq), and whether it was a single state."""
        values, single = self._batch(q)
        return values, self._batch(v, "v", rows=None if single else len(values))[0], single

    # Python

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a Mechanism is immutable ({name} cannot be set); describe a new one")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Mechanism is immutable ({name} cannot be deleted)")

    def __copy__(self) -> Mechanism:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Mechanism:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        # The compiled part is rebuilt from the plan, so that a mechanism can go to a worker process.
        return _restore, (self._plan,)

    def __repr__(self) -> str:
        return (
            f"<Mechanism: {len(self.frames)} frames, nd {self.nd}, nrho {self.nrho}, n_inputs {self.n_inputs}, "
            f"nc {self.nc}>"
        )

    def __str__(self) -> str:
        return tree_view(self._plan)

    def _repr_html_(self) -> str:
        return html_view(self._plan)


def _build_like(builder: _core.MechanismBuilder, like: _core.Mechanism) -> _core.Mechanism:
    """Build with the structure of another mechanism; from scratch where numbers were part of it."""
    try:
        return builder.build_like(like)
    except ValueError:
        return builder.build()


def _restore(settled: Plan) -> Mechanism:
    mechanism = Mechanism.__new__(Mechanism)
    mechanism._compile(settled)
    return mechanism


def _without(along: Sequence[npt.ArrayLike], result: Array) -> Array:
    """Return a result without its last axes, of length one, for directions."""
    return result.reshape(result.shape[: result.ndim - len(along)])


def _called(symbol: str, element: str | None) -> str:
    """Return how messages call a function of the mechanism, or of one element."""
    return symbol if element is None else f"{symbol} of {element!r}"


def _of(result: Array, single: bool) -> Array:
    """Return the result for a single configuration, or for the batch that it was asked for."""
    return result[0] if single else result
