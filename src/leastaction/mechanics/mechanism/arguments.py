"""What is asked of a mechanism, as arrays: the functions that are its methods read their arguments here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import NOT_YET, ArgumentError, unknown
from leastaction.mechanics.description.tree import Tree
from leastaction.mechanics.elements import Element, Parts
from leastaction.numerics.arrays import Array, as_array, as_number, require_mapping, shape_of

_UNIT = 1e-6  # how far rounding of a file may take the length of a quaternion from one
_ROUNDING = 1e-14  # and how far from one it stays as it is


class Compiled(ABC):
    """A `Mechanism`, as far as its queries ask it; each field is explained there."""

    core: _core.Mechanism
    tree: Tree
    parts: Mapping[str | None, Parts]
    frames: tuple[str, ...]
    dynamic: tuple[str, ...]
    kinematic: tuple[str, ...]
    variables: tuple[str, ...]
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    constraints: tuple[str, ...]
    nd: int
    nrho: int
    first_rho: int
    nq: int
    nv: int
    n_inputs: int
    nc: int
    nx: int
    ndx: int
    time: float

    @property
    @abstractmethod
    def elements(self) -> Mapping[str, Element]:
        """Its elements by name."""


def check_same_names(theirs: Compiled, ours: Compiled, what: str, advice: str = "") -> None:
    """Raise unless two mechanisms have the same variables, inputs and constraints; ``advice``: what to do, if any."""
    if (theirs.variables, theirs.inputs, theirs.constraints) != (ours.variables, ours.inputs, ours.constraints):
        raise ArgumentError(f"{what}: it is of {theirs!r} with other names, expected one of {ours!r}{advice}")


def by_name(
    names: Sequence[str], values: Mapping[str, float] | None, default: float, known: Mapping[str, float] | None = None
) -> Array:
    """Return numbers of variables (len(names),): as given by name, else as ``known``, else ``default``."""
    given = {} if values is None else values
    require_mapping(given, "values", "{'pole': 1.0}")
    rest = as_number(default, "default")
    found = dict.fromkeys(names, rest) | dict(known or {})
    for name, value in given.items():
        if name not in found:
            raise unknown("variable", name, names)
        found[name] = as_number(value, f"the value of {name!r}")
    return np.array(list(found.values()), dtype=np.float64)


def single(m: Compiled, q: ArrayLike, what: str = "q") -> Array:
    """Return one configuration (nq,)."""
    return configuration_on(m, as_array(q, what, (m.nq,), names=m.coordinates), what)


def rates(m: Compiled, v: ArrayLike, what: str = "v", *, rows: int | None = None) -> Array:
    """Return velocities or the like, (nv,), or (rows, nv)."""
    return as_array(v, what, (m.nv,) if rows is None else (rows, m.nv), names=m.variables)


def configuration_on(m: Compiled, q: Array, what: str) -> Array:
    """Return configurations (..., nq) with quaternions of unit length; raise for those that are far from it."""
    if not m.tree.rotations:
        return q
    out = np.array(q)
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        numbers = out[..., first : first + 4]
        length = np.linalg.norm(numbers, axis=-1, keepdims=True)
        off = np.abs(length - 1.0)
        if (off > _UNIT).any():
            raise ArgumentError(
                f"{what}: {', '.join(rotation.quaternion)} are a unit quaternion, scalar first, whose length is 1; got "
                f"the length {float(length.flat[int(np.argmax(off))]):.6g}. No rotation is 1, 0, 0, 0; an angle a "
                "about an axis e (of length 1) is cos(a/2), sin(a/2) e"
            )
        out[..., first : first + 4] = np.where(off > _ROUNDING, numbers / length, numbers)
    return out


def of_unit_length(m: Compiled, q: Array) -> Array:
    """Return configurations (N, nq) with quaternions brought back to unit length, as between two that are near."""
    out = np.array(q)
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        out[:, first : first + 4] /= np.linalg.norm(out[:, first : first + 4], axis=1, keepdims=True)
    return out


def angles_only(m: Compiled, what: str) -> None:
    """Raise where a rotation is a quaternion, for what is not done, or has no meaning, without angles."""
    if m.tree.rotations:
        raise ArgumentError(
            f"{what}: not yet for a mechanism in which a rotation is a quaternion, as that of "
            f"{m.tree.rotations[0].name!r}; give the joint angles, axes='xyz'; {NOT_YET}"
        )


def none_prescribed_as_quaternion(m: Compiled, what: str) -> None:
    """Raise where a rotation that is a quaternion is prescribed, for what takes none."""
    for rotation in m.tree.rotations:
        if rotation.variables[0] in m.kinematic:
            raise ArgumentError(
                f"{what}: not yet where a rotation that is a quaternion is prescribed, as that of {rotation.name!r}; "
                f"prescribe joint angles, axes='xyz'; {NOT_YET}"
            )


def inputs_of(m: Compiled, inputs: ArrayLike | None, what: str = "inputs") -> Array:
    """Return inputs (n_inputs,), zero if not given."""
    return np.zeros(m.n_inputs) if inputs is None else as_array(inputs, what, (m.n_inputs,), names=m.inputs)


def batch(m: Compiled, q: ArrayLike, what: str = "q", *, rows: int | None = None) -> tuple[Array, bool]:
    """Return q as (N, nq), and whether it was a single configuration."""
    if len(shape_of(q) or ()) == 2:
        return configuration_on(m, as_array(q, what, (rows, m.nq), names=m.coordinates), what), False
    return single(m, q, what)[None, :], True


def batch_of_states(m: Compiled, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array, bool]:
    """Return q (N, nq) and v (N, nv), and whether it was a single state."""
    values, one = batch(m, q)
    return values, rates(m, v)[None, :] if one else rates(m, v, rows=len(values)), one


def shaped(result: Array, one: bool) -> Array:
    """Return the result for a single configuration, or for the batch that it was asked for."""
    return result[0] if one else result


def frame_index(m: Compiled, name: object) -> int:
    """Return the index of a frame by name."""
    index = m.tree.index.get(name) if isinstance(name, str) else None
    if index is None:
        raise unknown("frame", name, m.tree.index)
    return index
