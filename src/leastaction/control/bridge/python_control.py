"""python-control: a mechanism about a state as one of its linear systems."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.control.readings import Measured, Readings
from leastaction.errors import ArgumentError
from leastaction.numerics.arrays import as_array, as_number
from leastaction.numerics.extras import extra
from leastaction.optimal.continuous.system import ContinuousSystem
from leastaction.optimal.discrete.system import DiscreteSystem


def state_space(
    system: DiscreteSystem | ContinuousSystem,
    x: ArrayLike,
    u: ArrayLike,
    *,
    measure: Measured | None = None,
    t: float = 0.0,
) -> Any:
    """Return the linearisation of a system about a state and an input, with its names.

    Parameters
    ----------
    system : DiscreteSystem or ContinuousSystem
        Of the former its first step is linearised, whose length is the system's ``dt``.
    x, u : array_like (nx,), (nu,)
        About which; an equilibrium, or else its drift is left out.
    measure : optional
        The outputs, as of `KalmanFilter`; the state if left out. Where rotations are quaternions the states are
        what they turn by, ``dx_3`` and on.
    t : float, optional
        Time (s), of what is in continuous time.

    Returns
    -------
    control.StateSpace

    Raises
    ------
    ArgumentError
        Wrong shapes, or what is no system.
    MissingExtraError
        python-control is not installed.
    """
    if not isinstance(system, (DiscreteSystem, ContinuousSystem)):
        raise ArgumentError(f"system: got {type(system).__name__}, expected a discrete or a continuous system")
    control = extra("control", of="control", why="bridge.python_control")
    state = as_array(x, "x", (system.nx,), names=system.state_names)
    held = as_array(u, "u", (system.nu,), names=system.input_names)
    if isinstance(system, DiscreteSystem):
        A, B = system.derivatives(state, held, 0)
        dt = float(system.times[1] - system.times[0])
    else:
        A, B = system.derivatives(state, held, as_number(t, "t (s)"))
        space = system.charts()
        if space is not None:
            changes, plus = space.changes(state[None])[0], space.plus_derivative(state[None])[0]
            A, B = changes @ A @ plus, changes @ B
        dt = 0.0
    readings = Readings(system, np.eye(system.nx) if measure is None else measure)
    outputs = list(system.state_names) if measure is None else list(readings.names)
    return control.ss(
        np.array(A), np.array(B), readings.jacobian(state), np.zeros((readings.ny, system.nu)), dt,
        inputs=[_plain(name) for name in system.input_names],
        states=[_plain(name) for name in _directions(system)],
        outputs=[f"y_{_plain(name)}" if name in system.state_names else _plain(name) for name in outputs],
    )  # fmt: skip


def _directions(system: DiscreteSystem | ContinuousSystem) -> list[str]:
    """Return names of what a linearisation moves: entries of the state, or by number what turns several of them."""
    space = system.charts()
    if space is None:
        return list(system.state_names)
    moved = [np.flatnonzero(column) for column in space.pattern.T]
    return [system.state_names[m[0]] if len(m) == 1 else f"dx_{i}" for i, m in enumerate(moved)]


def _plain(name: str) -> str:
    """Return a name as python-control takes them: dots are its own."""
    return name.replace(".", "_")
