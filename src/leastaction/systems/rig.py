"""A rig, a machine that is not quite its model, and what it did when a plan was played on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError, closest, unknown
from leastaction.mechanics.elements.base import Constraint
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.queries.units import input_units, state_units
from leastaction.mechanics.mechanism.text import text_of
from leastaction.numerics.arrays import Array, as_array, as_count, as_number, require_mapping
from leastaction.numerics.dataset import STEP, TIME, Dataset, Savable
from leastaction.numerics.dataset.plain import plain
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.names import matching
from leastaction.numerics.public import public
from leastaction.systems.quantities.discrete import quantity_of

_MOST = 1e12  # rad, m, s or N/m: squares and quotients of larger numbers overflow, and no rig has them


@public
@dataclass(frozen=True, kw_only=True)
class Rig(Frozen):
    """What a machine has that its model has not. Frozen; threads may share it.

    Attributes
    ----------
    spread : float
        Masses, with the inertias of the same body, are off by up to this share of them, drawn by chance.
    factors : mapping of str to float
        Factors of parameters by their names or patterns of them (``"damping.*"``), on top of that.
    stiffness : float or None
        Of strings (N/m): in the place of each constraint that is a string comes an elastic one, which pulls and does
        not push; 2000 N/m is a millimetre of nylon a metre long. None: strings are what they are in the model.
    smoothing : float
        The length over which such a string becomes taut (m).
    noise : float
        Standard deviation of every reading of a dynamic variable (rad or m).
    delay : float
        How late readings are (s); they are used from the next instant of the plan on.
    substeps : int
        Steps in which the machine is simulated to each step of the plan.
    seed : int
        Of what is drawn by chance.

    Raises
    ------
    ArgumentError
        A number out of range.
    """

    spread: float = 0.05
    factors: Mapping[str, float] = field(default_factory=dict)
    stiffness: float | None = 2e3
    smoothing: float = 1e-3
    noise: float = 1e-3
    delay: float = 0.02
    substeps: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        require_mapping(self.factors, "Rig: factors", "{'damping.*': 1.2}")
        object.__setattr__(self, "factors", MappingProxyType(dict(self.factors)))
        for name, below in (("spread", 1.0), ("noise", _MOST), ("delay", _MOST)):
            as_number(getattr(self, name), f"Rig: {name}", least=0.0, below=below)
        for name in ("smoothing", *(() if self.stiffness is None else ("stiffness",))):
            as_number(getattr(self, name), f"Rig: {name}", above=1.0 / _MOST, below=_MOST)
        as_count(self.substeps, "Rig: substeps", 1)
        as_count(self.seed, "Rig: seed", 0)
        for name, factor in self.factors.items():
            as_number(factor, f"Rig: the factor of {name!r}", above=0.0)
        super().__post_init__()

    def model(self, mechanism: Mechanism) -> Mechanism:
        """Return a mechanism with elastic strings in the place of those that are constraints."""
        if self.stiffness is None:
            return mechanism
        found = {
            name: each.as_string(self.stiffness, self.smoothing)
            for name, each in mechanism.elements.items()
            if isinstance(each, Constraint)
        }
        return mechanism.with_exchanged({name: [each] for name, each in found.items() if each is not None})

    def machine(self, mechanism: Mechanism) -> Mechanism:
        """Return the mechanism as it is built: the model with the parameters that it really has.

        Raises
        ------
        ArgumentError
            A factor of something that is no parameter.
        """
        model = self.model(mechanism)
        numbers, chance = model.parameters, np.random.default_rng(self.seed)
        values = dict(numbers)
        for mass in [name for name in numbers if name.endswith(".mass")]:
            factor = 1.0 + self.spread * chance.uniform(-1.0, 1.0)
            for name in numbers:
                if name == mass or name.startswith(f"{mass.removesuffix('mass')}inertia."):
                    values[name] *= factor
        names = list(numbers)
        for pattern, factor in self.factors.items():
            chosen = matching(names, pattern)
            if not chosen:
                raise unknown("parameter", pattern, names, "Rig")
            for i in chosen:
                values[names[i]] *= factor
        return model.with_parameters({name: value for name, value in values.items() if value != numbers[name]})


@public
@dataclass(frozen=True, kw_only=True)
class Played(Frozen, Savable):
    """What a rig did. Frozen; threads may share it.

    Attributes
    ----------
    mechanism : Mechanism
        The rig's.
    t : ndarray, shape (N+1,)
        Times of the plan (s); those of the part that was played where it failed.
    x : ndarray, shape (N+1, nx)
        States ``[q; rho; p; v_rho]``.
    u : ndarray, shape (N, nu)
        What was commanded: the inputs, and the prescribed variables at the ends of the steps.
    failure : str or None
        Why it ended early; None if it did not.
    """

    mechanism: Mechanism = field(repr=False, metadata={"recorded": False})
    t: Array = field(repr=False)
    x: Array = field(repr=False)
    u: Array = field(repr=False)
    failure: str | None = None

    @property
    def q(self) -> Array:
        """Configurations (N+1, nq)."""
        return self.x[:, : self.mechanism.nq]

    def __getitem__(self, name: str) -> Array:
        """Return a variable, a momentum ("p_elbow"), a rate ("v_hook") or an input over time by name."""
        m = self.mechanism
        state = quantity_of(m, "state", self.t, multipliers=False).names
        for names, values in ((state, self.x), ((*m.inputs, *m.kinematic), self.u)):
            if name in names:
                return values[:, names.index(name)]
        raise ArgumentError(f"unknown name {name!r}; {closest(name, (*state, *m.inputs), what='states and inputs')}")

    def dataset(self) -> Dataset:
        m = self.mechanism
        arrays: dict[str, Any] = {}
        content, units = plain(self, arrays), m.units
        return Dataset(
            kind=type(self).__name__,
            t=self.t,
            arrays=arrays,
            dims={"t": (TIME,), "x": (TIME, "state"), "u": (STEP, "input")},
            labels={
                "state": quantity_of(m, "state", self.t, multipliers=False).names,
                "input": (*m.inputs, *m.kinematic),
            },
            units={
                "t": "s",
                "x": state_units(m, momenta=True),
                "u": (*input_units(m), *(units[name] for name in m.kinematic)),
            },
            content=content,
            model=text_of(m),
        )

    def off(self, wanted: ArrayLike, names: str | Sequence[str] = "*") -> float:
        """Return the root mean square distance of dynamic variables from configurations (N+1, nq) or (N+1, nd).

        ``names``: of the variables, or patterns of them. Infinite if the rig failed.
        """
        m = self.mechanism
        patterns = (names,) if isinstance(names, str) else tuple(names)
        chosen = sorted({i for each in patterns for i in matching(m.dynamic, each)})
        if not patterns:
            raise ArgumentError(f"names: got none, expected some of {', '.join(map(repr, m.dynamic))}, or patterns")
        if not chosen:
            raise ArgumentError(
                f"names: nothing is called {names!r}; {closest(patterns[0], m.dynamic, what='variables')}"
            )
        if self.failure is not None:
            return float("inf")
        goal = as_array(wanted, "wanted", (len(self.t), m.nq), (len(self.t), m.nd), meaning="(N+1, nq) or (N+1, nd)")
        return float(np.sqrt(np.mean((self.x[:, chosen] - goal[:, chosen]) ** 2)))
