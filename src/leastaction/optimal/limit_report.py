"""What a result says of its limits: values, multipliers, and where they are active."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from leastaction.errors import ArgumentError, closest
from leastaction.numerics.arrays import Array
from leastaction.numerics.frozen import Frozen
from leastaction.numerics.public import public

_NAMED = 3  # most limits that a sentence names, the worst ones
_LITTLE = 1e-3  # price of a violation, in parts of the largest, below which it is not named


@dataclass(frozen=True)
class Barrier(Frozen):
    """What an optimisation with limits needs to go on as if it had not been stopped.

    ``size``: the cost at the start. ``tolerance``: of the optimisation. ``first_mu``, ``last_mu``: parameters of the
    first and the last stage. ``duals``, ``scale``, ``prices``, ``leeway`` (n,): of all sides, those of equations twice,
    one after the other. ``part``: how much of the leeway limits still have; none in files from before there was any.
    """

    size: float
    tolerance: float
    first_mu: float
    last_mu: float
    duals: Array
    scale: Array
    prices: Array
    leeway: Array = field(default_factory=lambda: np.empty(0))
    part: float = 0.0


@public
@dataclass(frozen=True)
class LimitState(Frozen):
    """One side of a limit along the trajectory. Frozen.

    Attributes
    ----------
    limit : str
        What was stated.
    labels : tuple of str (m,)
        What each column says, such as ``"push <= 5"``.
    equation : bool
        Whether it is an equation.
    k : ndarray of int (n,)
        Instants (of quantities of the state) or steps.
    value : ndarray (n, m)
        How far inside: negative where the limit is not met. Of an equation, how far above.
    dual : ndarray (n, m)
        By how much the cost would fall for a unit more of room. Of an equation, how fast the cost rises with its value.
    price : ndarray (m,)
        What a unit of excess cost in the end.
    active : ndarray of bool (n, m)
        Where the limit holds the motion back.
    t : ndarray (n,) or None
        In continuous time: the times (s) of the instants, which are those of the points of the horizon's pieces. Duals
        of what holds all along are then per second.
    """

    limit: str
    labels: tuple[str, ...]
    equation: bool
    k: np.ndarray[tuple[int], np.dtype[np.int64]]
    value: Array
    dual: Array
    price: Array
    active: np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]
    t: Array | None = None

    def broken(self, column: int) -> bool:
        """Whether what a column says is not enforced by its price somewhere."""
        return bool((np.abs(self.dual[:, column]) > 0.5 * self.price[column]).any())


@public
@dataclass(frozen=True)
class LimitReport:
    """The limits of an optimisation where it ended. Frozen, so any number of threads may share it.

    Attributes
    ----------
    sides : tuple of LimitState
        Every side of every limit, in the order in which they were given. An equation has one.
    mu : float
        The last parameter of the barrier: each dual times its slack, in units of the cost.
    excess : float
        The largest violation, relative to the limit's scale; 0 if all are met.
    """

    sides: tuple[LimitState, ...]
    mu: float
    excess: float
    barrier: Barrier | None = field(repr=False, default=None)

    def __getitem__(self, label: str) -> Array:
        """Return the values (n,) of a side by its label; see `LimitState`."""
        state, j = self._find(label)
        return np.asarray(state.value[:, j])

    def dual(self, label: str) -> Array:
        """Return the duals (n,) of a side by its label."""
        state, j = self._find(label)
        return np.asarray(state.dual[:, j])

    def active(self, label: str) -> Array:
        """Return where a side holds the motion back, indices by its label."""
        state, j = self._find(label)
        return np.asarray(state.k[state.active[:, j]])

    def sides_shaped(self) -> list[tuple[tuple[str, ...], tuple[int, ...]]]:
        """Return labels and shapes of the sides."""
        return [(side.labels, side.value.shape) for side in self.sides]

    @property
    def labels(self) -> tuple[str, ...]:
        """All labels."""
        return tuple(label for side in self.sides for label in side.labels)

    def _find(self, label: str) -> tuple[LimitState, int]:
        for side in self.sides:
            if label in side.labels:
                return side, side.labels.index(label)
        raise ArgumentError(f"limits: {closest(label, list(self.labels), what='limits')}")

    def __str__(self) -> str:
        width = max((len(label) for label in self.labels), default=0)
        lines = [f"{'limit':{width}s}  {'active at':>14s}  {'largest dual':>12s}  {'least room':>10s}"]
        for side in self.sides:
            for j, label in enumerate(side.labels):
                share = f"{int(side.active[:, j].sum())} of {len(side.k)}"
                room = -np.abs(side.value[:, j]).max() if side.equation else side.value[:, j].min()
                dual = np.abs(side.dual[:, j]).max()
                lines.append(f"{label:{width}s}  {share:>14s}  {dual:12.4g}  {room:10.2g}")
        return "\n".join(lines)

    def violated(self, when: Callable[[int], str]) -> str:
        """Return which limits are violated, by how much and where, the dearest first; not what hardly matters."""
        found = _Worst()
        for side, j, i, value in self._worst():
            if np.isnan(value):  # of a function outside of where it is defined: it explains all else
                return f"{side.labels[j]!r} is no number at {when(int(side.k[i]))}"
            if value < 0.0:
                found.add(side, j, -side.price[j] * value, f" by {-value:.3g} at {when(int(side.k[i]))}")
        return found.text(least=_LITTLE)

    def contradiction(self, when: Callable[[int], str]) -> str:
        """Return which limits are not met and where, and which ones stand against them."""
        broken, against, met = _Worst(), _Worst(), _Worst()
        worst = [(side, j, i, -side.price[j] * value) for side, j, i, value in self._worst()]
        least = _LITTLE * max((price for side, j, _, price in worst if side.broken(j)), default=0.0)
        for side, j, i, price in worst:
            if side.broken(j) and price >= least:
                off = max(float(price / side.price[j]), 0.0)
                broken.add(side, j, price, f" by {off:.3g} at {when(int(side.k[i]))}")
            elif side.broken(j) or side.active[:, j].any():
                # Off by next to nothing, at the highest price, is met at the expense of others.
                i = int(np.argmax(np.abs(side.dual[:, j])))
                text = f" (most at {when(int(side.k[i]))})"
                # What holds all along has little of a dual at each instant.
                (met if side.broken(j) else against).add(side, j, float(np.abs(side.dual[:, j]).sum()), text)
        stands = against.text() or met.text()
        return f"Not met: {broken.text()}." + (f" Against that stand {stands}." if stands else "")

    def _worst(self) -> Iterator[tuple[LimitState, int, int, float]]:
        """Yield each side, its columns, where each has the least room, and how much that is."""
        for side in self.sides:
            room = -np.abs(side.value) if side.equation else side.value
            for j, i in enumerate(np.argmin(room, axis=0)):
                yield side, j, int(i), float(room[i, j])


class _Worst:
    """What labels say at their worst: a label may stand on several sides, and the worst of them speaks for it."""

    def __init__(self) -> None:
        self.found: dict[str, tuple[float, str]] = {}

    def add(self, side: LimitState, column: int, price: float, text: str) -> None:
        label = side.labels[column]
        said = max(float(price), 0.0), f"{label!r}{text}"
        self.found[label] = max(self.found.get(label, said), said)

    def text(self, least: float = 0.0) -> str:
        """Return the dearest but those of less than a part of the dearest's price."""
        worst = sorted(self.found.values(), reverse=True)[:_NAMED]
        return ", ".join(text for price, text in worst if price >= least * worst[0][0])
