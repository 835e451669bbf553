"""What is asked of a mechanism, as arrays: the functions that are its methods read their arguments here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.elements import Element, Parts
from leastaction.numerics.arrays import Array, as_array, shape_of


class Compiled(ABC):
    """A `Mechanism`, as far as its queries ask it; each field is explained there."""

    core: _core.Mechanism
    tree: Tree
    parts: Mapping[str | None, Parts]
    frames: tuple[str, ...]
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    variables: tuple[str, ...]
    inputs: tuple[str, ...]
    constraints: tuple[str, ...]
    nd: int
    nrho: int
    nq: int
    n_inputs: int
    nc: int
    nx: int

    @property
    @abstractmethod
    def elements(self) -> Mapping[str, Element]:
        """Its elements by name."""


def check_same_names(theirs: Compiled, ours: Compiled, what: str, advice: str = "") -> None:
    """Raise unless two mechanisms have the same variables, inputs and constraints; ``advice``: what to do, if any."""
    if (theirs.variables, theirs.inputs, theirs.constraints) != (ours.variables, ours.inputs, ours.constraints):
        raise ArgumentError(f"{what}: it is of {theirs!r} with other names, expected one of {ours!r}{advice}")


def single(m: Compiled, q: ArrayLike, what: str = "q") -> Array:
    """Return one configuration, velocity or the like (nq,)."""
    return as_array(q, what, (m.nq,), names=m.variables)


def inputs_of(m: Compiled, inputs: ArrayLike | None, what: str = "inputs") -> Array:
    """Return inputs (n_inputs,), zero if not given."""
    return np.zeros(m.n_inputs) if inputs is None else as_array(inputs, what, (m.n_inputs,), names=m.inputs)


def batch(m: Compiled, q: ArrayLike, what: str = "q", *, rows: int | None = None) -> tuple[Array, bool]:
    """Return q as (N, nq), and whether it was a single configuration."""
    if len(shape_of(q) or ()) == 2:
        return as_array(q, what, (rows, m.nq), names=m.variables), False
    return single(m, q, what)[None, :], True


def batch_of_states(m: Compiled, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array, bool]:
    """Return q and v as (N, nq), and whether it was a single state."""
    values, one = batch(m, q)
    return values, single(m, v, "v")[None, :] if one else as_array(v, "v", (len(values), m.nq), names=m.variables), one


def shaped(result: Array, one: bool) -> Array:
    """Return the result for a single configuration, or for the batch that it was asked for."""
    return result[0] if one else result


def frame_index(m: Compiled, name: object) -> int:
    """Return the index of a frame by name."""
    index = m.tree.index.get(name) if isinstance(name, str) else None
    if index is None:
        raise unknown("frame", name, m.tree.index)
    return index
