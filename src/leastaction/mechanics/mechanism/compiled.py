"""The named parts of a compiled mechanism, which every question to it starts from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from leastaction import _core
from leastaction.errors import ArgumentError, closest
from leastaction.mechanics.description.tree import Ball, Tree
from leastaction.mechanics.elements import Element
from leastaction.mechanics.mechanism.compilation import Plan
from leastaction.numerics.arrays import Array, as_array, as_number, shape_of


class Compiled:
    """Names, sizes and the compiled core; see `Mechanism`, which is one."""

    __slots__ = (
        "_frame_index", "_owners", "_plan", "_slots", "core", "nc", "nd", "nq", "nrho", "nu", "nx",
    )  # fmt: skip

    _plan: Plan
    _frame_index: Mapping[str, int]
    _slots: Mapping[str, int]
    _owners: Mapping[str, tuple[str, str]]
    core: _core.Mechanism
    nd: int
    nrho: int
    nq: int
    nu: int
    nc: int
    nx: int

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

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The ball joints, those of free joints too, whose singularity is watched."""
        return self.tree.balls

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

    def _single(self, q: npt.ArrayLike, what: str = "q") -> Array:
        return as_array(q, what, (self.nq,), names=self.variables)

    def _batch(
        self, q: npt.ArrayLike, what: str = "q", *, rows: int | None = None
    ) -> tuple[Array, bool]:
        """Return q as (N, nq), and whether it was a single configuration."""
        if len(shape_of(q) or ()) == 2:
            return as_array(q, what, (rows, self.nq), names=self.variables), False
        return self._single(q, what)[None, :], True
