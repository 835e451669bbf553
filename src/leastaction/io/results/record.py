"""A finished run as plain arrays and text: what the result file holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from leastaction.errors import ArgumentError

Array: TypeAlias = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A finished (or stopped) optimisation, as plain arrays and text.

    Time comes first in every array; ``N`` is the number of steps. SI units and radians.

    Parameters
    ----------
    mechanism
        Name of the mechanism.
    variables
        Names of the configuration variables, dynamic first, then kinematic; ``nq`` of them.
    n_dynamic
        How many of them are dynamic, ``nd``; ``nrho = nq - nd``.
    inputs
        Names of the entries of ``u``: force inputs, then the next value of each kinematic variable;
        ``nu`` of them.
    constraints
        Names of the constraints; ``nc`` of them.
    t
        Times, (N+1,), s.
    q
        Configuration, (N+1, nq).
    p
        Momentum of the dynamic variables, (N+1, nd).
    v
        Velocity of the kinematic variables, (N+1, nrho).
    u
        Inputs, (N, nu).
    lam
        Constraint multipliers of each step, (N, nc).
    x
        State of the discrete system as the optimiser holds it, (N+1, nx): ``[q; p; v]``, and what else
        it steers by, such as the multipliers.
    K
        Feedback gains, (N, nu, nx): ``u = u_k - K_k (x - x_k)``.
    K_projection
        Gains by which the trajectory was reached, (N, nu, nx), or None; with them a run that goes on
        makes the iterates of one that was never stopped.
    x_wanted, u_wanted
        The wanted state (N+1, nx) and input (N, nu) of the cost, or None.
    q_wanted
        The wanted configuration, (N+1, nq), or None.
    tension
        Force in each constraint, (N, nc), N, positive when it pulls, or None.
    histories
        One entry per iteration in each: ``cost`` (first, before any step), ``expected_decrease``,
        ``step_length``, ``method``, ...
    settings
        What the run was asked to do: finite numbers, texts, lists and dictionaries.
    versions
        Versions of the programs that made it; see `current_versions`.
    status, message
        How the run ended, in one word and in one sentence.
    created
        Time of writing, ISO 8601; filled in when empty.

    Raises
    ------
    ArgumentError
        The shapes do not fit each other.
    """

    mechanism: str
    variables: tuple[str, ...]
    n_dynamic: int
    inputs: tuple[str, ...]
    constraints: tuple[str, ...]
    t: Array
    q: Array
    p: Array
    v: Array
    u: Array
    lam: Array
    x: Array
    K: Array
    K_projection: Array | None = None
    x_wanted: Array | None = None
    u_wanted: Array | None = None
    q_wanted: Array | None = None
    tension: Array | None = None
    histories: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    status: str = ""
    message: str = ""
    created: str = ""

    def __post_init__(self) -> None:
        """Check every shape against the names and the time grid."""
        n, nq, nd = len(self.t) - 1, len(self.variables), self.n_dynamic
        nu, nc, nx = len(self.inputs), len(self.constraints), self.x.shape[-1]
        expected: dict[str, tuple[int, ...]] = {
            "t": (n + 1,),
            "q": (n + 1, nq),
            "p": (n + 1, nd),
            "v": (n + 1, nq - nd),
            "u": (n, nu),
            "lam": (n, nc),
            "x": (n + 1, nx),
            "K": (n, nu, nx),
            "K_projection": (n, nu, nx),
            "x_wanted": (n + 1, nx),
            "u_wanted": (n, nu),
            "q_wanted": (n + 1, nq),
            "tension": (n, nc),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise ArgumentError(
                    f"{name} has shape {value.shape}, expected {shape} for {n} steps, {nq} variables ({nd} dynamic), "
                    f"{nu} inputs and {nc} constraints"
                )

    @property
    def rho(self) -> Array:
        """The kinematic variables, (N+1, nrho): the last columns of ``q``."""
        return self.q[:, self.n_dynamic :]

    def variable(self, name: str) -> Array:
        """Return one configuration variable over time, (N+1,), by its name.

        Raises
        ------
        ArgumentError
            No variable has that name.
        """
        if name not in self.variables:
            raise ArgumentError(
                f"no variable is called {name!r}; there are: {', '.join(self.variables)}"
            )
        return self.q[:, self.variables.index(name)]
