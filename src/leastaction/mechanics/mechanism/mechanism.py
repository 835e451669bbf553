"""`Mechanism`: a compiled, immutable mechanism and the questions it answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from leastaction import _core
from leastaction.mechanics.description.branch import Branch
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.description.masses import check_inertia, recheck_inertia
from leastaction.mechanics.elements import Element
from leastaction.mechanics.mechanism.compilation import Plan, plan
from leastaction.mechanics.mechanism.constraint_queries import ConstraintQueries
from leastaction.mechanics.mechanism.frame_queries import FrameQueries
from leastaction.mechanics.mechanism.mass_queries import Energy as Energy
from leastaction.mechanics.mechanism.mass_queries import MassQueries
from leastaction.mechanics.mechanism.parameters import (
    Length,
    Place,
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


class Mechanism(FrameQueries, ConstraintQueries, MassQueries):
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
        Order of the names in every array. By default the order in which the tree, then the elements meet
        them.

    Attributes
    ----------
    frames, dynamic, kinematic, inputs, constraints : tuple of str
        Names, in the order of the arrays. The world frame is the first of the frames.
    variables : tuple of str
        The dynamic, then the kinematic names: the order of q and v.
    nd, nrho, nq, nu, nc, nx : int
        How many dynamic variables, kinematic ones, both, inputs (of forces), scalar constraints, and
        entries of the discrete state ``x = [q; rho; p; v_rho]``.
    elements : dict of str to Element
        The elements by name (a copy).
    tree : Tree
        The frames and joints that the description came to.
    balls : tuple of Ball
        The ball joints, those of free joints too.
    mass : float
        Mass of all bodies (kg).
    core : _core.Mechanism
        The compiled mechanism.

    Raises
    ------
    DescriptionError
        For an unknown or duplicate name, a cycle, a number that is not finite, a mass or inertia that no
        body has, a dynamic variable that moves no mass, or an element that does not fit.
    """

    __slots__ = ()

    def __init__(
        self,
        description: Branch | Sequence[Any],
        elements: Sequence[Element] = (),
        *,
        dynamic: Sequence[str] | None = None,
        kinematic: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
    ) -> None:
        self._compile(
            plan(
                flatten(description), elements, dynamic=dynamic, kinematic=kinematic, inputs=inputs
            )
        )

    def _compile(self, settled: Plan, *, like: _core.Mechanism | None = None) -> None:
        nd, nrho, nu = len(settled.dynamic), len(settled.kinematic), len(settled.inputs)
        builder = _core.MechanismBuilder(nd, nrho, nu)
        context = settled.emit(builder)
        fields: dict[str, Any] = {
            "_plan": settled,
            "_frame_index": {f.name: i for i, f in enumerate(settled.tree.frames)},
            "_slots": context.parameters,
            "_owners": context.owners,
            "core": builder.build() if like is None else _build_like(builder, like),
            "nd": nd,
            "nrho": nrho,
            "nq": nd + nrho,
            "nu": nu,
            "nc": len(settled.constraints),
            "nx": 2 * (nd + nrho),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        if like is None:
            check_names(self.tree, context.parameters)
            check_inertia(self.tree, self.variables, self.core)

    def with_elements(self, elements: Sequence[Element]) -> Mechanism:
        """Return the same mechanism with more elements; names and orders stay, new inputs come last.

        Parameters
        ----------
        elements : sequence of Element
            What to add.

        Returns
        -------
        Mechanism

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

    # Parameters

    @property
    def parameters(self) -> dict[str, float]:
        """Every number of the description by name, such as ``"bob.mass"`` or ``"spring.stiffness"``.

        Of bodies the mass (kg), the centre of mass (m) and the inertia (kg m^2); of constant frames the
        coordinate or the translation (m or rad); of elements their numbers, in the units of each.
        """
        numbers = self.core.numbers
        return {
            name: parameter_value(self.tree, place, numbers)
            for name, place in parameter_places(self.tree, self._slots).items()
        }

    def parameter_places(self, names: Sequence[str]) -> dict[str, Place]:
        """Return where some named parameters are; raise an `ArgumentError` for a name that is none."""
        return find(parameter_places(self.tree, self._slots), names)

    def with_parameters(self, values: Mapping[str, float]) -> Mechanism:
        """Return the same mechanism with other numbers; its structure is shared, not compiled again.

        Parameters
        ----------
        values : mapping of str to float
            New values by the names of `parameters`; the other numbers stay.

        Returns
        -------
        Mechanism

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
            recheck_inertia(tree, result.variables, result.core, self.core)
        return result

    def with_free_lengths(self, lengths: Mapping[str, Length]) -> Mechanism:
        """Return the mechanism with constant coordinates as kinematic variables, after all the others.

        A derivative by a length is one by a prescribed variable that does not move.
        """
        result = Mechanism.__new__(Mechanism)
        settled = replace(
            self._plan, tree=freed(self.tree, lengths), kinematic=(*self.kinematic, *lengths)
        )
        result._compile(settled)
        return result

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
            f"<Mechanism: {len(self.frames)} frames, nd {self.nd}, nrho {self.nrho}, nu {self.nu}, "
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
