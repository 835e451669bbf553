"""`Mechanism`: a compiled, immutable mechanism and the questions it answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction import _core
from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.arguments import Array, as_array, as_number, shape_of
from leastaction.mechanics.branch import Branch
from leastaction.mechanics.compilation import Plan, plan
from leastaction.mechanics.elements import Element
from leastaction.mechanics.masses import check_inertia
from leastaction.mechanics.tree import WORLD, Tree, flatten
from leastaction.mechanics.view import tree_view


@dataclass(frozen=True)
class Energy:
    """Energy of a mechanism (J): floats, or arrays (N,) for a batch of states."""

    kinetic: Any
    potential: Any

    @property
    def total(self) -> Any:
        """Kinetic and potential energy together (J)."""
        return self.kinetic + self.potential


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
    core : _core.Mechanism
        The compiled mechanism.

    Raises
    ------
    DescriptionError
        For an unknown or duplicate name, a cycle, a number that is not finite, a mass or inertia that no
        body has, a dynamic variable that moves no mass, or an element that does not fit.
    """

    __slots__ = ("_frame_index", "_plan", "core", "nc", "nd", "nq", "nrho", "nu", "nx")

    _plan: Plan
    _frame_index: Mapping[str, int]
    core: _core.Mechanism
    nd: int
    nrho: int
    nq: int
    nu: int
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
        self._compile(
            plan(
                flatten(description), elements, dynamic=dynamic, kinematic=kinematic, inputs=inputs
            )
        )

    def _compile(self, settled: Plan) -> None:
        nd, nrho, nu = len(settled.dynamic), len(settled.kinematic), len(settled.inputs)
        builder = _core.MechanismBuilder(nd, nrho, nu)
        settled.emit(builder)
        fields: dict[str, Any] = {
            "_plan": settled,
            "_frame_index": {f.name: i for i, f in enumerate(settled.tree.frames)},
            "core": builder.build(),
            "nd": nd,
            "nrho": nrho,
            "nq": nd + nrho,
            "nu": nu,
            "nc": len(settled.constraints),
            "nx": 2 * (nd + nrho),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
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
            )
        )
        return result

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
    def constraints(self) -> tuple[str, ...]:
        """Names of the scalar constraint equations."""
        return self._plan.constraints

    def configuration(
        self, values: Mapping[str, float] | None = None, *, default: float = 0.0
    ) -> Array:
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
                raise ArgumentError(
                    f"unknown variable {name!r}; {closest(name, order, what='variables')}"
                )
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

    # Frames

    def frame_pose(self, q: npt.ArrayLike, name: str) -> Array:
        """Return the pose of a frame in the world.

        Parameters
        ----------
        q : array_like, shape (nq,) or (N, nq)
            One configuration or a batch.
        name : str
            The frame.

        Returns
        -------
        ndarray, shape (4, 4) or (N, 4, 4)
            Takes coordinates in the frame to coordinates in the world.
        """
        values, single = self._batch(q)
        poses = self._poses(self.core.joint_poses(values), self._frame(name))
        return poses[0] if single else poses

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
        joints = self.core.joint_poses(values)
        points = np.empty((len(values), len(indices), 3))
        for column, index in enumerate(indices):
            points[:, column] = self._poses(joints, index)[:, :3, 3]
        return points[0] if single else points

    # Dynamics

    def energy(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Energy:
        """Return the kinetic and potential energy (J) at q, v of shape (nq,), or (N, nq) for a batch."""
        values, single = self._batch(q)
        speeds, _ = self._batch(v, "v", rows=None if single else len(values))
        pairs = list(zip(values, speeds, strict=True))
        kinetic = np.array([self.core.kinetic_energy(a, b) for a, b in pairs])
        potential = np.array([self.core.potential_energy(a) for a, _ in pairs])
        if single:
            return Energy(float(kinetic[0]), float(potential[0]))
        return Energy(kinetic, potential)

    def momentum(self, q: npt.ArrayLike, v: npt.ArrayLike) -> Array:
        """Return dL/dv at q, v of shape (nq,): the momentum of every variable, kinematic ones too."""
        return self.core.gradient(self._single(q), self._single(v, "v"))[1]

    def mass_matrix(self, q: npt.ArrayLike) -> Array:
        """Return the inertia matrix (nq, nq) of all variables at q of shape (nq,)."""
        # L is quadratic in v, so its second derivative by v is the same at any velocity.
        return self.core.hessian(self._single(q), np.zeros(self.nq))[2]

    # Constraints

    def constraint_values(self, q: npt.ArrayLike) -> Array:
        """Return h(q), shape (nc,), or (N, nc) for a batch."""
        values, single = self._batch(q)
        result = np.empty((len(values), self.nc))
        for row, configuration in zip(result, values, strict=True):
            row[:] = self.core.constraints(configuration)
        return result[0] if single else result

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

    def degrees_of_freedom(self, q: npt.ArrayLike) -> int:
        """Return nd less the rank of the constraints on the dynamic variables at q of shape (nq,)."""
        jacobian = self.constraint_jacobian(q)[:, : self.nd]
        return self.nd - (int(np.linalg.matrix_rank(jacobian)) if jacobian.size else 0)

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

    def _frame(self, name: str) -> int:
        index = self._frame_index.get(name)
        if index is None:
            raise ArgumentError(
                f"unknown frame {name!r}; {closest(name, self.frames, what='frames')}"
            )
        return index

    def _poses(self, joints: Array, index: int) -> Array:
        frame = self.tree.frames[index]
        if frame.joint == WORLD:
            return np.broadcast_to(frame.pose, (len(joints), 4, 4)).copy()
        return joints[:, frame.joint] @ frame.pose

    def _single(self, q: npt.ArrayLike, what: str = "q") -> Array:
        return as_array(q, what, (self.nq,), names=self.variables)

    def _batch(
        self, q: npt.ArrayLike, what: str = "q", *, rows: int | None = None
    ) -> tuple[Array, bool]:
        """Return q as (N, nq), and whether it was a single configuration."""
        if len(shape_of(q) or ()) == 2:
            return as_array(q, what, (rows, self.nq), names=self.variables), False
        return self._single(q, what)[None, :], True


def _restore(settled: Plan) -> Mechanism:
    mechanism = Mechanism.__new__(Mechanism)
    mechanism._compile(settled)
    return mechanism
