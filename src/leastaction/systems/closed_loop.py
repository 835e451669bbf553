"""What happened in a loop that was closed by a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.errors import some, unknown
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.text import text_of
from leastaction.numerics.arrays import Array
from leastaction.numerics.dataset import STEP, TIME, Dataset, Savable
from leastaction.numerics.dataset.plain import plain
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public


@public
@dataclass(frozen=True)
class PredictiveInfo:
    """What the last call of a predictive controller did.

    Attributes
    ----------
    t : float
        Its time (s).
    seconds : float
        How long it took.
    iterations : int
        Real-time iterations; of a first call those of its optimisation; 0 of a fallback.
    interior_iterations : int
        Of the quadratic problems, in all.
    violation : float
        Largest violation of a limit along the plan, in its scale (the width of a bound).
    active : tuple of str
        The limits that are active somewhere along the plan.
    cost : float
        Of the motion that the plan was improved from.
    planned : bool
        Whether there is a new plan; else the last one was followed under its gains.
    message : str
        Why not.
    """

    t: float
    seconds: float
    iterations: int
    interior_iterations: int
    violation: float
    active: tuple[str, ...]
    cost: float
    planned: bool
    message: str = ""


@public
@dataclass(frozen=True, eq=False)
class ClosedLoop(Frozen, Savable):
    """What happened in a closed loop. Frozen; threads may share it.

    Attributes
    ----------
    t : ndarray (n+1,)
        Instants that were reached (s).
    x : ndarray (n+1, nx)
        States of the plant.
    u : ndarray (n, nu)
        Inputs that were given.
    y : ndarray (n+1, ny)
        Readings, when they were taken.
    estimates : ndarray (n, nx') or None
        States that the controller was given, where there is an estimator.
    surprise : ndarray (n,) or None
        The estimator's normalised innovations squared; NaN before the first reading has arrived.
    infos : tuple
        What the controller says of each call (`PredictiveInfo` of an `MPC`); empty of a law.
    state_names, input_names, reading_names : tuple of str
    failure : str or None
        Why the loop ended early.
    units : mapping of str to str
        Of states and inputs by their names, where they are known.
    mechanism : Mechanism or None
        The plant's, where it is one.
    interrupted : bool
        Whether Ctrl-C ended it.
    """

    t: Array
    x: Array
    u: Array
    y: Array
    estimates: Array | None
    surprise: Array | None
    infos: tuple[Any, ...]
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]
    failure: str | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    reading_names: tuple[str, ...] = ()
    mechanism: Mechanism | None = field(default=None, repr=False, metadata={"recorded": False})
    interrupted: bool = False

    @property
    def q(self) -> Array | None:
        """Configurations of the mechanism (n+1, nq); None where there is none."""
        return None if self.mechanism is None else self.x[:, : self.mechanism.nq]

    @property
    def state_units(self) -> tuple[str, ...]:
        """Units of the entries of the state; "" where none is known."""
        return tuple(self.units.get(name, "") for name in self.state_names)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs, likewise."""
        return tuple(self.units.get(name, "") for name in self.input_names)

    def __getitem__(self, name: str) -> Array:
        """Return an entry of the state, or an input, over time by its name."""
        if name in self.state_names:
            return np.asarray(self.x[:, self.state_names.index(name)])
        if name in self.input_names:
            return np.asarray(self.u[:, self.input_names.index(name)])
        raise unknown("name", name, (*self.state_names, *self.input_names), "name")

    def dataset(self) -> Dataset:
        arrays: dict[str, Any] = {}
        content = plain(self, arrays)
        dims = {
            "t": (TIME,), "x": (TIME, "state"), "u": (STEP, "input"), "y": (TIME, "reading"),
            "estimates": (STEP, "estimate"), "surprise": (STEP,),
        }  # fmt: skip
        return Dataset(
            kind=type(self).__name__,
            t=self.t,
            arrays=arrays,
            dims={name: dim for name, dim in dims.items() if name in arrays},
            labels={"state": self.state_names, "input": self.input_names, "reading": self.reading_names},
            units={"t": "s", "x": self.state_units, "u": self.input_units},
            content=content,
            model=None if self.mechanism is None else text_of(self.mechanism),
        )

    def __str__(self) -> str:
        """Say how far the loop came, where it ended, and what the largest inputs and the estimator came to."""
        ended = self.failure or f"{len(self.u)} steps, t = {self.t[0]:g} to {self.t[-1]:g} s"
        lines = [ended, "ends at " + _by_name(self.state_names, self.x[-1])]
        if self.u.size:
            lines.append("largest inputs " + _by_name(self.input_names, np.abs(self.u).max(axis=0)))
        if self.surprise is not None and np.isfinite(self.surprise).any():
            lines.append(f"mean surprise {np.nanmean(self.surprise):.3g} of {self.y.shape[1]} readings")
        # A controller of one's own may say something else of its calls.
        plans = [info for info in self.infos if isinstance(info, PredictiveInfo)]
        if plans:
            missed, slowest = sum(not info.planned for info in plans), 1e3 * max(info.seconds for info in plans)
            lines.append(f"{len(plans)} plans, {missed} of them not found; the slowest took {slowest:.3g} ms")
        return "\n".join(lines)


def _by_name(names: tuple[str, ...], values: Array) -> str:
    return some([f"{name} {value:.4g}" for name, value in zip(names, values, strict=True)])
