"""Limits on the lengths of paths over frames: what a string, a tendon or a cylinder can reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.mechanics.mechanism.tape_measure import TapeMeasure
from leastaction.numerics.arrays import Array, as_number
from leastaction.numerics.public import public
from leastaction.optimal.limits.limit import Horizon, Limit, Value, When, Within
from leastaction.optimal.limits.rows import Rows
from leastaction.optimal.quantity import Quantity, Samples
from leastaction.systems.frames import OfConfiguration, frames_of, places_alike

PathOrSum = Sequence[str] | Mapping[tuple[str, ...], float]


class LengthOfPaths(OfConfiguration):
    """A weighted sum of the lengths of paths, as one function of the configuration."""

    kind, unit = "length of", "m"

    def __init__(self, mechanism: Mechanism, limit: PathBound) -> None:
        super().__init__(mechanism)
        self.limit, self.names = limit, (limit.names,)
        self.parts = [(factor, TapeMeasure(mechanism, path)) for path, factor in limit.terms.items()]

    def values(self, at: Samples) -> Array:
        q = self.q(at)
        return np.asarray(sum(factor * tape.length(q) for factor, tape in self.parts))[:, None]

    def jacobian(self, at: Samples) -> Array:
        q = self.q(at)
        return np.asarray(sum(factor * tape.gradient(q) for factor, tape in self.parts))[:, None]

    def curvature(self, at: Samples, y: Array) -> Array:
        q = self.q(at)
        return np.asarray(y[:, :, None] * sum(factor * tape.hessian(q) for factor, tape in self.parts))

    def own_is_like(self, other: Quantity) -> bool:
        return (
            isinstance(other, LengthOfPaths)
            and self.limit is other.limit
            and places_alike(self.mechanism, other.mechanism)
        )


@public
@dataclass(frozen=True)
class PathBound(Limit):
    """Least and largest length of a path through the origins of frames, in either kind of time.

    Parameters
    ----------
    path : sequence of str, or mapping of tuple of str to float
        Two frames or more, in the order of the path; or several paths with a factor each, as elements along paths take
        them.
    min, max : float, array_like (n,), or callable, optional
        Lengths (m), as of `Bound`.
    at : str, int, float or sequence, optional
        As of `Bound`: every instant if left out.
    name : str, optional
        How to speak of it; its frames if left out.

    Raises
    ------
    ArgumentError
        Neither a least nor a largest length, a path of fewer than two frames, a factor that is zero; by `optimize`,
        unknown frames, or a motion to start from in which two of them that follow each other meet.

    Examples
    --------
    >>> from leastaction.limits import PathBound
    >>> str(PathBound(["shoulder", "elbow", "hand"], 0.2, 0.6))
    "PathBound('shoulder - elbow - hand')"
    """

    path: PathOrSum
    min: Value = None
    max: Value = None
    at: When = field(default=None, kw_only=True)
    name: str = field(default="", kw_only=True)

    of = "length"

    def __post_init__(self) -> None:
        given: Any = self.path
        if isinstance(given, Mapping) and not given:
            raise ArgumentError("PathBound: path: got no path, expected frames, or paths and their factors")
        for path in given if isinstance(given, Mapping) else [given]:
            if isinstance(path, str) or len(path) < 2:
                raise ArgumentError(f"PathBound: path: got {path!r}, expected two frames or more")
        for path, factor in self.terms.items():
            if as_number(factor, f"PathBound: factor of {path!r}") == 0.0:
                raise ArgumentError(f"PathBound: got a factor of 0 for {path!r}, expected a sum without it")
        if self.min is None and self.max is None:
            raise ArgumentError(f"{self}: got neither min nor max, expected one of them at least")

    @property
    def terms(self) -> dict[tuple[str, ...], float]:
        """The paths by their factors."""
        if isinstance(self.path, Mapping):
            return dict(self.path)
        return {tuple(self.path): 1.0}

    @property
    def names(self) -> str:
        """How to speak of the length."""
        return self.name or " and ".join(" - ".join(path) for path in self.terms)

    def __str__(self) -> str:
        return f"PathBound({self.names!r})"

    def rows(self, system: Horizon, first: int) -> list[Rows]:
        """Return the rows for a `MidpointSystem`, or for the points of a `MechanismSystem`'s horizon."""
        mechanism, _ = frames_of(system, self)
        rows = Within(LengthOfPaths(mechanism, self), self.min, self.max, at=self.at).rows(system, first)
        return [replace(row, limit=str(self)) for row in rows]
