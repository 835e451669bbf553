"""What is asked of a mechanism, as arrays: the functions that are its methods read their arguments here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction import _core
from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.description.tree import BallRotation, Tree
from leastaction.mechanics.elements import Element, Parts
from leastaction.numerics.arrays import Array, Row, as_array, row_by_name, shape_of

_QUATERNION = "a unit quaternion, scalar first"
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


def configuration_by_name(m: Compiled, values: Mapping[str, ArrayLike], what: str = "q", rest: float = 0.0) -> Array:
    """Return a configuration (nq,) from values by name, with quaternions of no rotation where they are not given."""
    plain: dict[str, Any] = dict(values)
    for rotation in m.tree.rotations:
        _spell(plain, rotation.name, rotation.quaternion, what, _QUATERNION)
    return configuration_on(m, row_by_name(plain, what, m.coordinates, rest, unturned(m)), what)


def state_by_name(m: Compiled, values: Mapping[str, ArrayLike], what: str = "x") -> dict[str, Any]:
    """Return numbers of a state by name: those of rotations one by one, and those of no rotation where none are given.

    They may stand together by the name of a joint, its momenta and rates with ``"p_"`` and ``"v_"`` before that.
    """
    plain: dict[str, Any] = dict(values)
    for rotation in m.tree.rotations:
        _spell(plain, rotation.name, rotation.quaternion, what, _QUATERNION)
        for letter in "pv":
            names = [f"{letter}_{name}" for name in rotation.variables]
            _spell(plain, f"{letter}_{rotation.name}", names, what, "by turns about the axes of the body")
    return unturned(m) | plain


def _spell(plain: dict[str, Any], name: str, names: Sequence[str], what: str, meaning: str) -> None:
    """Take numbers that stand together by a name apart, if there are some."""
    if name in plain:
        numbers = as_array(plain.pop(name), f"{what}: the value of {name!r}", (len(names),), meaning=meaning)
        plain.update(zip(names, numbers, strict=True))


def unturned(m: Compiled) -> dict[str, float]:
    """Return the numbers of quaternions by name where nothing is turned."""
    still = (1.0, 0.0, 0.0, 0.0)
    return {name: value for each in m.tree.rotations for name, value in zip(each.quaternion, still, strict=True)}


def single(m: Compiled, q: Row, what: str = "q") -> Array:
    """Return one configuration (nq,), which may be given by name."""
    if isinstance(q, Mapping):
        return configuration_by_name(m, q, what)
    return configuration_on(m, as_array(q, what, (m.nq,), names=m.coordinates), what)


def rates(m: Compiled, v: Row, what: str = "v", *, rows: int | None = None) -> Array:
    """Return velocities or the like, (nv,), which may be given by name, or (rows, nv)."""
    if isinstance(v, Mapping):
        v = velocity_by_name(m, v, what)
    return as_array(v, what, (m.nv,) if rows is None else (rows, m.nv), names=m.variables)


def velocity_by_name(m: Compiled, values: Mapping[str, ArrayLike], what: str = "v", rest: float = 0.0) -> Array:
    """Return a velocity (nv,) from values by name, those of a rotation together by the name of its joint."""
    plain: dict[str, Any] = dict(values)
    for rotation in m.tree.rotations:
        _spell(plain, rotation.name, rotation.variables, what, "an angular velocity in axes of the body")
    return row_by_name(plain, what, m.variables, rest)


def configuration_on(m: Compiled, q: Array, what: str) -> Array:
    """Return configurations (..., nq) with quaternions of unit length; raise for those that are far from it."""
    if not m.tree.rotations:
        return q
    out = np.array(q)
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        out[..., first : first + 4] = unit_quaternions(rotation, out[..., first : first + 4], what)
    return out


def unit_quaternions(rotation: BallRotation, numbers: Array, what: str) -> Array:
    """Return the quaternions (..., 4) of a rotation at unit length; raise for those that are far from it."""
    length = np.linalg.norm(numbers, axis=-1, keepdims=True)
    off = np.abs(length - 1.0)
    if (off > _UNIT).any():
        raise ArgumentError(
            f"{what}: {', '.join(rotation.quaternion)} are a unit quaternion, scalar first, whose length is 1; got "
            f"the length {float(length.flat[int(np.argmax(off))]):.6g}. No rotation is 1, 0, 0, 0, as is what a "
            "mapping leaves out; an angle a about an axis e (of length 1) is cos(a/2), sin(a/2) e"
        )
    return np.where(off > _ROUNDING, numbers / length, numbers)


def of_unit_length(m: Compiled, q: Array) -> Array:
    """Return configurations (N, nq) with quaternions brought back to unit length, as between two that are near."""
    out = np.array(q)
    for rotation in m.tree.rotations:
        first = m.coordinates.index(rotation.quaternion[0])
        out[:, first : first + 4] /= np.linalg.norm(out[:, first : first + 4], axis=1, keepdims=True)
    return out


def inputs_of(m: Compiled, inputs: ArrayLike | None, what: str = "inputs") -> Array:
    """Return inputs (n_inputs,), zero if not given."""
    return np.zeros(m.n_inputs) if inputs is None else as_array(inputs, what, (m.n_inputs,), names=m.inputs)


def batch(m: Compiled, q: Row, what: str = "q", *, rows: int | None = None) -> tuple[Array, bool]:
    """Return q as (N, nq), and whether it was a single configuration."""
    if len(shape_of(q) or ()) == 2:
        return configuration_on(m, as_array(q, what, (rows, m.nq), names=m.coordinates), what), False
    return single(m, q, what)[None, :], True


def batch_of_states(m: Compiled, q: Row, v: Row) -> tuple[Array, Array, bool]:
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
        raise unknown("frame", name, m.frames)
    return index
