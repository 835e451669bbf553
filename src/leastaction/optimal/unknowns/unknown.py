"""Unknown numbers of a system, as users state them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from leastaction.errors import ArgumentError, unknown
from leastaction.numerics.arrays import as_number
from leastaction.numerics.public import public
from leastaction.optimal.discrete.system import DiscreteSystem
from leastaction.optimal.system import FINAL_TIME, System


@public
@dataclass(frozen=True)
class Unknown:
    """A number of the system that is found together with its motion. Frozen, so any number of threads may share it.

    It costs ``price * value + 1/2 weight (value - wanted)^2``.

    Parameters
    ----------
    name : str
        Among the names of ``system.parameters``.
    min, max : float, optional
        Limits, as those of `Bound`.
    guess : float, optional
        Where to start; the system's own value if left out.
    price : float
        Cost of a unit of it.
    weight : float
        Of the square of its distance from `wanted`: what is known of it beforehand, or how little it should change.
    wanted : float, optional
        The system's own value if left out.

    Raises
    ------
    ArgumentError
        Numbers that are not finite, a least value that is not below the largest, or a negative weight.
    """

    name: str
    min: float | None = None
    max: float | None = None
    guess: float | None = field(default=None, kw_only=True)
    price: float = field(default=0.0, kw_only=True)
    weight: float = field(default=0.0, kw_only=True)
    wanted: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for what in ("min", "max", "guess", "price", "weight", "wanted"):
            value = getattr(self, what)
            if value is not None:
                as_number(value, f"{self}: {what}", least=0.0 if what == "weight" else None)
        if self.min is not None and self.max is not None and not self.min < self.max:
            raise ArgumentError(
                f"{self}: got min {self.min:.6g} and max {self.max:.6g}, expected the least value below the largest"
            )

    def __str__(self) -> str:
        return "FinalTime" if self.name == FINAL_TIME else f"{type(self).__name__}({self.name!r})"

    def value_of(self, system: System, horizon: tuple[float, float] | None = None) -> float:
        """Return the value that a system has, or of the final time a horizon (s) in continuous time.

        Raises
        ------
        ArgumentError
            If it has no such number, or for a final time that is not after the first.
        """
        known = system.parameters if horizon is None else {**system.parameters, FINAL_TIME: horizon[1]}
        if self.name not in known:
            if not system.parameters:
                raise ArgumentError(
                    f"unknowns: got {self} for a {type(system).__name__}, whose numbers cannot be found: it has no "
                    "`parameters`"
                )
            raise unknown("parameter", self.name, known, "unknowns")
        if self.name == FINAL_TIME:
            self._check_times(system, horizon)
        return known[self.name]

    def _check_times(self, system: System, horizon: tuple[float, float] | None) -> None:
        """Complain about times that are not after the first."""
        start = horizon[0] if horizon is not None else system.time(0) if isinstance(system, DiscreteSystem) else 0.0
        for what, given in (("min", self.min), ("max", self.max), ("guess", self.guess)):
            if given is not None and not (given > start or (what == "min" and given == start)):
                expected = f"expected a time after the first, {start:.6g} s"
                raise ArgumentError(f"{self}: {what}: got {given:.6g} s, {expected}")


@public
@dataclass(frozen=True)
class Parameter(Unknown):
    """A parameter of the system that is found together with its motion, such as a mass, a length or a stiffness.

    See `Unknown` for what it takes. Those of a mechanism have the names of `Mechanism.parameters`; in a motion of a
    fixed start it is the momentum there that is held.

    Examples
    --------
    The stiffness for which a mass swings along with a wanted motion, without any push:

    >>> import numpy as np
    >>> from leastaction import JointForce, JointSpring, Mechanism, MidpointSystem, MidpointVI, Parameter
    >>> from leastaction import QuadraticCost, optimize, tx
    >>> slide = Mechanism([tx("x", mass=1.0)], [JointSpring("x", 3.0, name="spring"), JointForce("x", input="push")])
    >>> system = MidpointSystem(MidpointVI(slide), np.linspace(0.0, 2.0, 101))
    >>> wanted = np.stack([np.cos(2.0 * system.t), -2.0 * np.sin(2.0 * system.t)], axis=1)
    >>> cost = QuadraticCost(wanted, np.zeros((100, 1)), Q=[1.0, 0.0], R=[1.0])
    >>> start = wanted[0], np.zeros((100, 1))
    >>> result = optimize(system, cost, initial=start, unknowns=[Parameter("spring.stiffness", 1.0, 10.0)])
    >>> round(result.unknowns["spring.stiffness"], 2)
    4.0
    """


@public
@dataclass(frozen=True)
class FinalTime(Unknown):
    """The final time of the motion (s): all time steps grow or shrink with it.

    See `Unknown` for what else it takes; ``FinalTime(0, 5)`` is any time up to 5 s, of a motion that begins at 0 s, and
    ``FinalTime(price=1.0)`` minimises the time. What a cost or a limit is over time holds at the same
    fractions of the motion, as given over the times that the system has, or in continuous time over the horizon that
    the optimisation begins with. The cost of a stage does not grow with its step; a cost in continuous time is the
    integral over the time that the motion takes.
    """

    name: str = field(default=FINAL_TIME, init=False)
    min: float | None = None
    max: float | None = None


def checked_unknowns(unknowns: Sequence[Unknown]) -> list[Unknown]:
    """Return unknowns, or complain about what is none, or named twice."""
    given: list[Unknown] = [unknowns] if isinstance(unknowns, Unknown) else list(unknowns)
    names: list[str] = []
    for i, each in enumerate(given):
        if not isinstance(each, Unknown):
            raise ArgumentError(
                f"unknowns[{i}]: got {type(each).__name__}, expected such as Parameter('bob.mass') or FinalTime()"
            )
        if each.name in names:
            raise ArgumentError(f"unknowns: {each.name!r} is listed twice; name each one once")
        names.append(each.name)
    return given
