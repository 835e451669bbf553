"""What was measured of a motion, and what drove it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, unknown
from leastaction.mechanics.discrete.prescribed import inputs_along
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.turns import prescribed_rotations
from leastaction.numerics.arrays import Array, as_array, as_flag, as_number, as_times, as_wanted, read_only
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.optimal.discrete.charts import states_between
from leastaction.optimal.space import Rotations

_RATE = "rate of "

Signal = ArrayLike | Callable[[float], float]
"""A number, values over time, or a function of the time (s)."""


@public
@dataclass(frozen=True)
class Experiment(Frozen):
    """One motion that was measured. Frozen: threads may share it.

    Parameters
    ----------
    t : array_like (N+1,)
        Instants of the measurements (s).
    measured : mapping of str to array_like
        By name: a variable (N+1,); ``"rate of elbow"``, the mean rate of a variable over each interval, (N,); a
        frame, the place of its origin in the world, (N+1, 3); or a joint whose rotation is a quaternion, that, (N+1,
        4), by the rotation vector (rad) that is missing. NaN where nothing was measured.
    sigma : float or mapping of str to float, optional
        Standard deviation of the noise, of all or by name with wildcards, in the units of what is measured. Left out it
        is taken from the residuals, for all that is measured alike.
    inputs : mapping of str to number, array_like or callable, optional
        Forces, held over each interval (N,), and prescribed variables, at the instants (N+1,), linear between them; of
        a prescribed rotation, by the name of its joint, quaternions (N+1, 4), evenly turned between them. What is left
        out is zero, or no rotation.
    start : (q, v), optional
        Configuration (nq,) and velocity (nv,) to begin with, or a guess of them; q alone begins at rest. From what is
        measured first, if left out.
    free_start : bool
        Whether the start is found too.
    name : str
        What messages and plots call it.

    Raises
    ------
    ArgumentError
        Nothing measured, times that do not increase, a deviation that is not positive.
    """

    t: Array
    measured: Mapping[str, Any]
    sigma: float | Mapping[str, float] | None = None
    inputs: Mapping[str, Signal] = field(default_factory=dict, kw_only=True)
    start: Any = field(default=None, kw_only=True)
    free_start: bool = field(default=True, kw_only=True)
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", read_only(as_times(self.t)))
        for what in ("measured", "inputs"):
            if not isinstance(getattr(self, what), Mapping):
                got = type(getattr(self, what)).__name__
                raise ArgumentError(f"{what}: got {got}, expected values by name, such as {{'elbow': angles}}")
        if not self.measured:
            raise ArgumentError("measured: got nothing, expected values by name, such as {'elbow': angles}")
        as_flag(self.free_start, "free_start")
        sigma = self.sigma
        for name, value in sigma.items() if isinstance(sigma, Mapping) else () if sigma is None else [("", sigma)]:
            as_number(value, f"sigma[{name!r}]" if name else "sigma", above=0.0)
        super().__post_init__()


@dataclass(frozen=True, eq=False)
class Channel:
    """One thing that was measured: values (n, m) with NaN in the gaps, over a deviation.

    ``kind``: "variable", "rate", "frame" or "turn". ``at``: the variable in the mechanism's order, the frame by name,
    or where the quaternion and its turns begin.
    """

    name: str
    kind: str
    at: Any
    values: Array
    sigma: float

    @property
    def labels(self) -> tuple[str, ...]:
        """What each column is."""
        return tuple(f"{self.name}.{axis}" for axis in "xyz") if self.kind in ("frame", "turn") else (self.name,)


def channels(experiment: Experiment, m: Mechanism) -> list[Channel]:
    """Return what was measured of a mechanism, checked."""
    N, found = len(experiment.t) - 1, []
    for name, given in experiment.measured.items():
        bare = name.removeprefix(_RATE)
        at: Any = name
        shape: tuple[int, ...] = (N + 1,)
        turns = {each.name: each for each in m.tree.rotations}
        if name in turns and np.shape(given)[-1:] == (4,):
            kind, shape = "turn", (N + 1, 4)
            at = m.coordinates.index(turns[name].quaternion[0]), m.variables.index(turns[name].variables[0])
        elif bare in m.variables and (bare != name or bare in m.coordinates):
            kind, at = "variable" if bare == name else "rate", m.variables.index(bare)
            shape = (N + (bare == name),)
        elif name in m.tree.index:
            kind, shape = "frame", (N + 1, 3)
        else:
            plain = [each for each in m.variables if each in m.coordinates]
            known = [*plain, *(_RATE + each for each in m.variables), *m.frames, *turns]
            raise unknown("variable or frame", name, known, "measured")
        values = as_wanted(given, f"measured[{name!r}]", shape)
        if np.isnan(values).all():
            raise ArgumentError(f"measured[{name!r}]: got nothing but NaN, expected some numbers")
        found.append(Channel(name, kind, at, values.reshape(len(values), -1), _sigma_of(experiment.sigma, name)))
    given_sigma = experiment.sigma
    if isinstance(given_sigma, Mapping):
        for pattern in given_sigma:
            if not matching(list(experiment.measured), pattern):
                raise unknown("measured name", pattern, list(experiment.measured), "sigma")
    return found


def _sigma_of(sigma: float | Mapping[str, float] | None, name: str) -> float:
    if not isinstance(sigma, Mapping):
        return 1.0 if sigma is None else float(sigma)
    for pattern, value in sigma.items():
        if matching([name], pattern):
            return float(value)
    raise ArgumentError(f"sigma: got none for {name!r}, expected one for each that is measured")


def drive(experiment: Experiment, m: Mechanism, t: Array, substeps: int) -> tuple[Array, Array]:
    """Return inputs (n, nu) over the steps between instants t (n+1,), and what is prescribed (n+1, nq - first_rho)."""
    N, turned = len(experiment.t) - 1, {each.name: place for each, place, _ in prescribed_rotations(m)}
    plain = [name for name in m.kinematic if name in m.coordinates]
    for name in experiment.inputs:
        if name not in (*m.inputs, *plain, *turned):
            raise unknown("input or prescribed variable", name, [*m.inputs, *plain, *turned], "inputs")
    forces, middle = np.zeros((len(t) - 1, m.n_inputs)), 0.5 * (t[1:] + t[:-1])
    for j, name in enumerate(m.inputs):
        given: Any = experiment.inputs.get(name, 0.0)
        if callable(given):
            forces[:, j] = [as_number(given(float(at)), f"inputs[{name!r}]") for at in middle]
        else:
            held = given if np.ndim(given) else np.full(N, given)
            forces[:, j] = np.repeat(as_array(held, f"inputs[{name!r}]", (N,), meaning="(N,)"), substeps)
    rho = np.zeros((len(t), m.nq - m.first_rho))
    for name in plain:
        given, j = experiment.inputs.get(name, 0.0), m.coordinates.index(name) - m.first_rho
        if callable(given):
            rho[:, j] = [as_number(given(float(at)), f"inputs[{name!r}]") for at in t]
        else:
            at_samples = given if np.ndim(given) else np.full(N + 1, given)
            values = as_array(at_samples, f"inputs[{name!r}]", (N + 1,), meaning="(N+1,)")
            rho[:, j] = np.interp(t, experiment.t, values)
    for name, j in turned.items():
        rho[:, j : j + 4] = _turned(experiment.inputs.get(name, [1.0, 0.0, 0.0, 0.0]), name, experiment.t, t)
    return np.hstack([forces, inputs_along(m, rho)]), rho


def _turned(given: Any, name: str, at: Array, t: Array) -> Array:
    """Return quaternions (n, 4) at times t of what is given of a rotation at others (N+1,)."""
    what, space = f"inputs[{name!r}]", Rotations()
    if callable(given):
        rows = np.array([as_array(given(float(each)), what, (4,)) for each in t])
        space.check(rows, what)
        return rows
    rows = as_array(given, what, (4,), (len(at), 4), meaning="(N+1, 4), or (4,) of one that stays")
    space.check(rows, what)
    return states_between(space, np.broadcast_to(rows, (len(at), 4)), at, t)
