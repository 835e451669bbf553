"""`Mechanism`: a compiled, immutable mechanism and the questions it answers."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import unknown
from leastaction.mechanics.description.branch import Branch, grown
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.description.masses import check_masses, check_matter
from leastaction.mechanics.description.tree import BallAngles
from leastaction.mechanics.elements import Element, Parts
from leastaction.mechanics.mechanism import queries
from leastaction.mechanics.mechanism.arguments import Compiled, batch, configuration_by_name, velocity_by_name
from leastaction.mechanics.mechanism.changes import freed, with_values
from leastaction.mechanics.mechanism.compilation import Plan, bodies_of, plan
from leastaction.mechanics.mechanism.equality import names_hash, same
from leastaction.mechanics.mechanism.parameters import (
    ElementNumber,
    Place,
    Prescribed,
    check_names,
    checked,
    find,
    parameter_places,
    parameter_value,
)
from leastaction.mechanics.mechanism.shared import check_values, joined, members_of, spread
from leastaction.mechanics.mechanism.view import tree_view
from leastaction.mechanics.mechanism.view_html import html_view
from leastaction.numerics.arrays import Array, Row, as_number, require_mapping
from leastaction.numerics.public import public


@public
@final
class Mechanism(Compiled):
    """A mechanism: a tree of frames with bodies, and the elements that act on it.

    The description is checked and compiled once; after that nothing in a mechanism changes, so threads
    may share one. Configurations are arrays in the order of `variables`: dynamic first, then kinematic. Where q, or q
    and v, may be of shape (N, nq) they are a batch, and what is returned has as many rows.

    Parameters
    ----------
    description : nested list of frames, or Branch
        Frames, each of which may be followed by the list of its children; or the result of chained calls
        that started at `world`.
    elements : sequence of Element, optional
        Gravity, forces, constraints.
    dynamic, kinematic, inputs : sequence of str, optional
        Order of the names in every array. By default the order in which the tree, then the elements meet them.
    shared : mapping of str to sequence of str, optional
        Parameters that stand for several: ``{"k": ["left.stiffness", "right.stiffness"]}``. In `parameters` there is
        ``"k"`` in their place, which `with_parameters` changes, and by which steps are differentiated.

    Attributes
    ----------
    tree : Tree
        The frames and joints that the description came to.
    frames : tuple of str
        Names of the frames in depth-first order; the world first.
    dynamic, kinematic, variables : tuple of str
        Names of the dynamic variables, in the order of the first nd entries of q; of the kinematic ones, in that of the
        last nrho; and of all of them.
    inputs, constraints : tuple of str
        Names of the force inputs, and of the scalar constraint equations.
    nd, nrho, nq, n_inputs, nc, nx : int
        How many dynamic variables, kinematic ones, both, inputs (of forces), scalar constraints, and
        entries of the discrete state ``x = [q; rho; p; v_rho]``.
    first_rho : int
        Where the kinematic variables begin in a configuration: at nd, or behind the quaternions of dynamic rotations.
    core : _core.Mechanism
        The compiled mechanism.
    parts : mapping of str to Parts
        Where the parts of each element stand in the core; under None, those of all.

    Raises
    ------
    DescriptionError
        For an unknown or duplicate name, a cycle, a number that is not finite, a mass or inertia that no
        body has, a dynamic variable that moves no mass, or an element that does not fit.
    """

    _plan: Plan
    _slots: Mapping[str, int]
    _owners: Mapping[str, tuple[str, str]]

    def __init__(
        self,
        description: Branch | Sequence[Any],
        elements: Sequence[Element] = (),
        *,
        dynamic: Sequence[str] | None = None,
        kinematic: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        shared: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        tree = flatten(description)
        self._compile(plan(tree, elements, dynamic=dynamic, kinematic=kinematic, inputs=inputs, shared=shared))

    @classmethod
    def _of(cls, settled: Plan, *, like: _core.Mechanism | None = None) -> Mechanism:
        """Return the mechanism of a plan, with the structure of another one where that is given."""
        result = cls.__new__(cls)
        result._compile(settled, like=like)
        return result

    def _compile(self, settled: Plan, *, like: _core.Mechanism | None = None) -> None:
        if like is None:
            check_matter(settled.tree, settled.rotors)
        nd, nrho, n_inputs = map(len, (settled.dynamic, settled.kinematic, settled.inputs))
        builder = _core.MechanismBuilder(nd, nrho, n_inputs)
        context = settled.emit(builder)
        coordinates = settled.tree.coordinates(settled.dynamic + settled.kinematic)
        whole = Parts(_core.ElementCounts(), builder.counts(), uniform_gravity=True)
        fields: dict[str, Any] = {
            "_plan": settled,
            "_slots": context.parameters,
            "_owners": context.owners,
            "parts": {**context.parts, None: whole},
            "core": builder.build() if like is None else _build_like(builder, like),
            "tree": settled.tree,
            "frames": settled.tree.named,
            "dynamic": settled.dynamic,
            "kinematic": settled.kinematic,
            "variables": settled.dynamic + settled.kinematic,
            "inputs": settled.inputs,
            "constraints": settled.constraints,
            "nd": nd,
            "nrho": nrho,
            "first_rho": len(settled.tree.coordinates(settled.dynamic)),
            "nq": len(coordinates),
            "nv": nd + nrho,
            "coordinates": coordinates,
            "n_inputs": n_inputs,
            "nc": len(settled.constraints),
            "nx": len(coordinates) + nd + nrho,
            "ndx": 2 * (nd + nrho),
            "time": 0.0,
        }
        vars(self).update(fields)
        if like is None:
            check_names(self.tree, context.parameters)
            check_values(settled.shared, self._each_parameter())
            check_masses(self.tree, settled.rotors, self.variables, self.core)

    # Names

    @property
    def elements(self) -> dict[str, Element]:
        """The elements by name (a copy)."""
        return dict(self._plan.elements)

    @property
    def nu(self) -> int:
        """The same as `n_inputs`."""
        return self.n_inputs

    @property
    def balls(self) -> tuple[BallAngles, ...]:
        """The ball joints, those of free joints too, whose singularity is watched."""
        return self.tree.balls

    def configuration(self, values: Mapping[str, ArrayLike] | None = None, *, default: float = 0.0) -> Array:
        """Return a configuration from values by name; without quaternions a velocity is made in the same way.

        Parameters
        ----------
        values : mapping of str to float or array_like (4,), optional
            Value of some coordinates (m or rad). The four numbers of a quaternion go together, scalar first:
            ``{"hull": [0.8, 0.6, 0.0, 0.0]}`` by the name of its joint.
        default : float, optional
            Value of the others, but for quaternions: those are of no rotation, 1, 0, 0, 0.

        Returns
        -------
        ndarray, shape (nq,)

        Raises
        ------
        ArgumentError
            For an unknown name or a value that is not a finite number.
        """
        return configuration_by_name(self, _given(values), "values", as_number(default, "default"))

    def velocity(self, values: Mapping[str, ArrayLike] | None = None, *, default: float = 0.0) -> Array:
        """Return a velocity, or another number for each variable such as a weight, from values by name.

        Parameters
        ----------
        values : mapping of str to float or array_like (3,), optional
            Velocity of some variables (m/s or rad/s), angular velocities of quaternions among them (``"base.wx"``), or
            all three of one by the name of its joint, ``{"base": [0.0, 0.0, 8.0]}``.
        default : float, optional
            That of the others.

        Returns
        -------
        ndarray, shape (nv,)

        Raises
        ------
        ArgumentError
            For an unknown name or a value that is not a finite number.
        """
        return velocity_by_name(self, _given(values), "values", as_number(default, "default"))

    def named(self, q: Row) -> dict[str, Any]:
        """Return the entries of a configuration by name: floats, or arrays (N,) for a batch (N, nq)."""
        values, single = batch(self, q)
        columns = values.T
        return {
            name: float(column[0]) if single else column.copy()
            for name, column in zip(self.coordinates, columns, strict=True)
        }

    # The same with changes

    def with_frames(self, parent: str, description: Sequence[Any]) -> Mechanism:
        """Return the same mechanism with more frames; orders stay, new variables come last of their kind.

        Parameters
        ----------
        parent : str
            The frame that they are put on, behind those that are there; of the world too.
        description : nested list of frames
            What to add, as of a description.

        Raises
        ------
        ArgumentError
            For a name that no frame has.
        DescriptionError
            If they do not fit, as when they are given with the description.
        """
        if parent not in self.tree.index:
            raise unknown("frame", parent, self.frames, "parent")
        first, *rest = self.tree.frames
        frames, parents = [None, *(at.frame for at in rest)], [-1, *(at.parent for at in rest)]
        tree = flatten(grown(first.name, frames, parents, self.tree.index[parent]).add(description))
        return self._of(
            plan(
                tree,
                list(self._plan.elements.values()),
                dynamic=[*self.dynamic, *(name for name in tree.dynamic if name not in self.dynamic)],
                kinematic=[*self.kinematic, *(name for name in tree.kinematic if name not in self.kinematic)],
                inputs=self.inputs,
                numbers=self._plan.numbers,
                shared=self.shared,
            )
        )

    def with_elements(self, elements: Sequence[Element]) -> Mechanism:
        """Return the same mechanism with more elements; orders stay, new names come last of their kind.

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
        new = [name for e in elements for name in (*e.uses.kinematic, *e.uses.either) if name not in self.variables]
        return self._of(
            plan(
                self.tree,
                [*self._plan.elements.values(), *elements],
                dynamic=self.dynamic,
                kinematic=[*self.kinematic, *dict.fromkeys(new)],
                inputs=[*self.inputs, *dict.fromkeys(added)],
                numbers=self._plan.numbers,
                shared=self.shared,
            )
        )

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
                raise unknown("element", name, self.elements, "elements")
        kept = [(elements.get(name, (each,))) for name, each in self._plan.elements.items()]
        flat = [each for group in kept for each in group]
        used = [name for each in flat for name in (*each.uses.kinematic, *each.uses.either)]
        kinematic = [name for name in self.kinematic if name in self.tree.kinematic or name in used]
        inputs = [name for each in flat for name in each.uses.inputs]
        gone = tuple(f"{name}." for name in elements)
        left = {name: [n for n in members if not n.startswith(gone)] for name, members in self.shared.items()}
        return self._of(
            plan(
                self.tree,
                flat,
                dynamic=self.dynamic,
                kinematic=kinematic,
                inputs=list(dict.fromkeys([*(n for n in self.inputs if n in inputs), *inputs])),
                numbers={n: value for n, value in self._plan.numbers.items() if not n.startswith(gone)},
                shared={name: kept for name, kept in left.items() if kept},
            )
        )

    @property
    def parameters(self) -> dict[str, float]:
        """Every number of the description by name, such as ``"bob.mass"`` or ``"spring.stiffness"``.

        Those of a frame begin with its name, or where it was given none with that of the variable that moves it:
        ``tx("cart", mass=1.0)`` has ``"cart.mass"``. Of bodies the mass (kg), the centre of mass (m) and the
        inertia (kg m^2); of constant frames the coordinate or the translation (m or rad); of joints that move by more
        than one plain variable the factors and the offset, of screws the pitch (m/rad); of elements their numbers, in
        the units of each.
        """
        return joined(self.shared, self._each_parameter())

    def _each_parameter(self) -> dict[str, float]:
        numbers = self.core.numbers
        return {
            name: parameter_value(self.tree, place, numbers)
            for name, place in parameter_places(self.tree, self._slots).items()
        }

    @property
    def shared(self) -> dict[str, tuple[str, ...]]:
        """What each parameter that stands for several stands for, by its name (a copy)."""
        return dict(self._plan.shared)

    def parameter_places(self, names: Sequence[str]) -> dict[str, Place]:
        """Return where some named parameters are; raise an `ArgumentError` for a name that is none.

        Of one that is shared, those that it stands for are to be named (see `members_of`).
        """
        return find(self.tree, self._slots, names)

    def members_of(self, names: Sequence[str]) -> tuple[list[str], Array]:
        """Return what some parameters stand for, and sums over that: (members, names) of ones and zeros.

        Each stands for itself, unless it is `shared`: a derivative by one is the sum of those by its members.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            self.parameter_places(names)  # says what is wrong
        names = list(names)
        if not self._plan.shared:
            return names, np.eye(len(names))
        find(self.tree, {**self._slots, **dict.fromkeys(self._plan.shared, 0)}, names)
        return members_of(self._plan.shared, names)

    def with_parameters(self, values: Mapping[str, float], *, allow_nonphysical: bool = False) -> Mechanism:
        """Return the same mechanism with other numbers; its structure is shared, not compiled again.

        The factors of a joint's coordinate are part of the structure: where one changes, it is compiled again.

        Parameters
        ----------
        values : mapping of str to float
            New values by the names of `parameters`; the other numbers stay.
        allow_nonphysical : bool, optional
            Whether bodies whose numbers change may have inertias that no real body has, as of `Body`.

        Raises
        ------
        ArgumentError
            For an unknown name, or a value that is not a finite number.
        DescriptionError
            For a mass, an inertia or a coefficient that cannot be, or where a dynamic variable is left
            without a mass to move.
        """
        numbers = spread(self._plan.shared, checked(values))
        places = self.parameter_places(list(numbers))
        tree = with_values(
            self.tree, {places[name]: value for name, value in numbers.items()}, allow_nonphysical=allow_nonphysical
        )
        settled = self._plan.with_numbers(tree, numbers, self._owners)
        slots = {name: place.slot for name, place in places.items() if isinstance(place, ElementNumber)}
        if tree.joints is self.tree.joints and not self._of_gravity(slots.values()):
            core = self.core
            if slots:
                all_numbers = core.numbers
                all_numbers[list(slots.values())] = [numbers[name] for name in slots]
                core = core.with_numbers(all_numbers)
            if tree is not self.tree:
                core = core.with_bodies(bodies_of(tree))
            result = Mechanism.__new__(Mechanism)
            vars(result).update({**vars(self), "_plan": settled, "tree": tree, "frames": tree.named, "core": core})
        else:
            result = self._of(settled, like=self.core)
        if tree is not self.tree:
            check_masses(tree, settled.rotors, self.variables, result.core, self.core)
        return result.at_time(self.time)

    def at_time(self, t: float) -> Mechanism:
        """Return the same mechanism, asked about at a time: what `expressions.time` stands for where no other is told.

        Constraints, forces and potentials that change with the time are those of that instant, for
        `project_configuration`, `project_velocity`, `check_consistent` and `equilibrium` too. A run goes through its
        own times, whatever this is.

        Parameters
        ----------
        t : float
            Time (s). Without `at_time` it is zero.
        """
        when = as_number(t, "t")
        if not self.core.timed or when == self.time:
            return self
        result = Mechanism.__new__(Mechanism)
        vars(result).update({**vars(self), "core": self.core.at_time(when), "time": when})
        return result

    def slots_of_elements(self, names: Sequence[str]) -> list[int] | None:
        """Return where the core has parameters that are numbers of elements; None if one is none, or gravity's.

        Of one that is shared, those that it stands for are to be named (see `members_of`).
        """
        places = self.parameter_places(list(names)).values()
        slots = [place.slot for place in places if isinstance(place, ElementNumber)]
        return None if len(slots) < len(places) or self._of_gravity(slots) else slots

    def _of_gravity(self, slots: Iterable[int]) -> bool:
        first = self.core.gravity_slot
        return first >= 0 and any(0 <= slot - first < 3 for slot in slots)

    def with_free_lengths(self, lengths: Mapping[str, Prescribed]) -> Mechanism:
        """Return the mechanism with numbers of frames as kinematic variables, after all the others.

        A derivative by a length is one by a prescribed variable that does not move; what a number of a joint changes is
        a prescribed motion, zero where the number has its value.
        """
        kinematic = (*self.kinematic, *lengths)
        freely = self._of(replace(self._plan, tree=freed(self.tree, lengths), kinematic=kinematic, shared={}))
        return freely.at_time(self.time)

    # What it may be asked: functions, each explained where it stands

    frame_pose = queries.frames.frame_pose
    frame_pose_derivative = queries.frames.frame_pose_derivative
    positions = queries.frames.positions
    frame_jacobian = queries.frames.frame_jacobian
    frame_jacobian_derivative = queries.frames.frame_jacobian_derivative
    frame_velocity = queries.frames.frame_velocity
    frame_velocity_derivative = queries.frames.frame_velocity_derivative

    energy = queries.masses.energy
    momentum = queries.masses.momentum
    total_momentum = queries.masses.total_momentum
    mass_matrix = queries.masses.mass_matrix
    center_of_mass = queries.masses.center_of_mass

    @property
    def mass(self) -> float:
        """Mass of all bodies (kg), those fixed in the world too."""
        return queries.masses.mass_of(self)

    @property
    def units(self) -> Mapping[str, str]:
        """The unit of each variable, input and constraint equation by its name, such as "rad", "m", "N m", "m^2".

        "" where there is none, as of products of unit vectors, or where none is known: of a variable that moves joints
        of both kinds, of a sum of variables with several units, of what a factor or an expression of one's own scales.
        """
        return queries.units.units_of(self)

    constraint_values = queries.constraints.constraint_values
    constraint_residuals = queries.constraints.constraint_residuals
    constraint_jacobian = queries.constraints.constraint_jacobian
    constraint_rates = queries.constraints.constraint_rates
    constraint_rank = queries.constraints.constraint_rank
    degrees_of_freedom = queries.constraints.degrees_of_freedom
    redundancy = queries.constraints.redundancy

    lagrangian = queries.functions.lagrangian
    potential = queries.functions.potential
    force = queries.functions.force
    constraint = queries.functions.constraint

    # Files

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the mechanism to a file, from which `load` makes the same one, bit by bit.

        Parameters
        ----------
        path : path
            The file: YAML with the ending ``.yaml`` or ``.yml``, JSON with ``.json``. It is there whole or not at all.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ModelFileError
            For another ending, or an element that no file can say: one that calls Python.
        OutputError
            If the file cannot be written.
        """
        from leastaction.mechanics.mechanism.record import write_plan  # here, so that to import the package is quick

        return write_plan(self._plan, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Mechanism:
        """Return the mechanism of a file that `save` wrote, or somebody by hand.

        Parameters
        ----------
        path : path
            A file in YAML (``.yaml``, ``.yml``) or JSON (``.json``).

        Raises
        ------
        ModelFileError
            For a file that is not there or is broken, and for what does not fit, with its line and place in the file.
        DescriptionError
            For a mechanism that cannot be, such as one with a dynamic variable that moves no mass.
        """
        from leastaction.mechanics.mechanism.record import read_plan

        return cls._of(read_plan(path))

    # Python

    def __eq__(self, other: object) -> bool:
        """Tell whether both are the same in description, names, numbers and elements."""
        if not isinstance(other, Mechanism):
            return NotImplemented
        return self is other or same(self._plan, other._plan)

    def __hash__(self) -> int:
        return names_hash(self._plan)

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
        return _restored, (self._plan, self.time)

    def __repr__(self) -> str:
        return (
            f"<Mechanism: {len(self.frames)} frames, nd {self.nd}, nrho {self.nrho}, n_inputs {self.n_inputs}, "
            f"nc {self.nc}>"
        )

    def __str__(self) -> str:
        return tree_view(self._plan)

    def _repr_html_(self) -> str:
        return html_view(self._plan)


def _given(values: Mapping[str, ArrayLike] | None) -> Mapping[str, Any]:
    """Return values by name, none where there are none."""
    given = {} if values is None else values
    require_mapping(given, "values", "{'pole': 1.0}")
    return given


def _build_like(builder: _core.MechanismBuilder, like: _core.Mechanism) -> _core.Mechanism:
    """Build with the structure of another mechanism; from scratch where numbers were part of it."""
    try:
        return builder.build_like(like)
    except ValueError:
        return builder.build()


def _restored(settled: Plan, t: float) -> Mechanism:
    return Mechanism._of(settled).at_time(t)
