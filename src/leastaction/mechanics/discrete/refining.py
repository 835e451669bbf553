"""Instants between given ones, where steps of the given length do not keep the energy, or cannot be made.

A step is held against two shorter ones from the same state, with the same input and prescribed motion: they have the
same energy, in the middle and at the end, but for what their lengths do to it. Where they do not, each of the two is
judged anew. What is decided follows from the state at the start of a given step alone, so that a run that goes on from
one of these goes on as it did.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.outcome import quality_of
from leastaction.mechanics.discrete.prescribed import held, inputs_along, prescribed_rows, reached
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.signals import Signal, signal_rows
from leastaction.numerics.step_quality import StepQuality

_HALVINGS = 12  # partings of a given step, one within the other
# Places at which a step is parted, of its length. The next is tried where one before meets a configuration from which
# no way leads on, such as a lift that is upright.
_PARTS = (0.5, 0.45, 0.41)
_SHORT = 2.0**-10  # length, of a step, at whose middle the energy is still that of its start
_ROUNDING = 1e-10  # rounding of an energy, of the sizes of all its terms


class Controls:
    """Inputs, and prescribed variables at the end, of parts of steps.

    ``u``: of the steps (N, n_inputs + nrho). ``places``: the prescribed part of q at all instants.
    """

    def __init__(self, m: Mechanism, t: Array, inputs: Signal, rho: Signal, u: Array, places: Array) -> None:
        self.m, self.t, self.u, self.places = m, t, u, places
        self.inputs, self.rho = inputs, rho

    def __call__(self, k: int, begin: float, end: float) -> Array:
        """Return those of a part of step k between two times."""
        m, n = self.m, self.m.n_inputs
        row = np.array(self.u[k])
        if begin == self.t[k] and end == self.t[k + 1]:
            return row
        if callable(self.inputs):
            row[:n] = signal_rows(self.inputs, np.array([0.5 * (begin + end)]), m.inputs, "inputs", row[:n])[0]
        if m.nrho:
            row[n:] = inputs_along(m, np.vstack([self._place(k, begin), self._place(k, end)]))[0]
        return row

    def _place(self, k: int, at: float) -> Array:
        """Return the prescribed part of q at a time within step k."""
        for j in (k, k + 1):
            if at == self.t[j]:
                return self.places[j]
        if callable(self.rho):
            whole = np.zeros(self.m.nq)
            whole[self.m.first_rho :] = self.places[k]
            return prescribed_rows(self.m, self.rho, np.array([at]), whole)[0]
        share = (at - self.t[k]) / (self.t[k + 1] - self.t[k])
        return reached(self.m, self.places[k], self.u[k, self.m.n_inputs :], share)


@dataclass
class Refined:
    """Steps between given instants, with those that were added.

    ``t``: their ends; ``u``: their controls; ``x``, ``lam``: states at their ends, and multipliers, of all but the last
    where that could not be made. ``qualities``: how coarse each was. ``redundant``: whether constraints were found to
    be. ``interrupted``: whether Ctrl-C ended it.
    """

    t: list[float] = field(default_factory=list)
    u: list[Array] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    lam: list[Array] = field(default_factory=list)
    qualities: list[StepQuality | None] = field(default_factory=list)
    redundant: bool = False
    interrupted: bool = False

    def cut(self, length: int) -> None:
        """Forget all steps from one on."""
        for each in (self.t, self.u, self.x, self.lam, self.qualities):
            del each[length:]


def refined(
    vi: Integrator,
    start: Array,
    t: Array,
    controls: Controls,
    tolerance: float,
    progress: Callable[[int, int], None] | None,
) -> Refined:
    """Return steps between instants (N+1,), with more where they do not keep the energy.

    They end early with a step of t where even the shortest part of it cannot be made, or at Ctrl-C.

    ``start``: the state x there. ``tolerance``: what the length of a step may do to the energy (J).
    ``progress``: called with the number of given steps done and of all.
    """
    refiner = _Refiner(vi, controls, tolerance)
    x, made = start, 0
    try:
        for k in range(len(t) - 1):
            end = refiner.make(k, x, float(t[k]), float(t[k + 1]))
            made = len(refiner.found.t)
            if end is None:
                break
            x = end
            if progress is not None:
                progress(k + 1, len(t) - 1)
    except KeyboardInterrupt:
        refiner.found.cut(made)
        refiner.found.interrupted = True
    return refiner.found


@dataclass(frozen=True)
class _Made:
    """Steps one after the other: the end of the last, its multipliers, and what is noted of all their energies."""

    x: Array
    lam: Array
    energies: Array
    quality: StepQuality | None
    redundant: bool


class _Refiner:
    def __init__(self, vi: Integrator, controls: Controls, tolerance: float) -> None:
        self.vi, self.controls, self.tolerance = vi, controls, tolerance
        self.found = Refined()

    def make(self, k: int, x: Array, begin: float, end: float) -> Array | None:
        """Return the state at the end of step k, or None where it cannot be made; it is then noted as it was given."""
        before = len(self.found.t)
        for part in _PARTS:
            reached = self._go(k, x, begin, end, part, _HALVINGS)
            if reached is not None:
                return reached
            self.found.cut(before)
        self._note(k, begin, end)
        return None

    def _go(self, k: int, x: Array, begin: float, end: float, part: float, halvings: int) -> Array | None:
        """Return the state at the end of a part of step k, or None where it cannot be reached."""
        whole = self._steps(k, x, (begin, end))
        inner = begin + part * (end - begin)
        if whole is not None and (halvings == 0 or self._keeps_energy(k, x, (begin, inner, end), whole)):
            return self._note(k, begin, end, whole)
        if halvings == 0:
            return None
        before = len(self.found.t)
        first = self._go(k, x, begin, inner, part, halvings - 1)
        second = None if first is None else self._go(k, first, inner, end, part, halvings - 1)
        if second is not None:
            return second
        self.found.cut(before)
        # Where its parts meet a configuration from which no way leads on it strides across.
        return None if whole is None else self._note(k, begin, end, whole)

    def _note(self, k: int, begin: float, end: float, made: _Made | None = None) -> Array | None:
        """Note a step, and what was made of it; return the state at its end."""
        self.found.t.append(end)
        self.found.u.append(self.controls(k, begin, end))
        if made is None:
            return None
        self.found.x.append(made.x)
        self.found.lam.append(made.lam)
        self.found.qualities.append(made.quality)
        self.found.redundant = self.found.redundant or made.redundant
        return made.x

    def _steps(self, k: int, x: Array, times: tuple[float, ...]) -> _Made | None:
        """Make steps between times; None where one fails."""
        t, u = np.array(times), np.array([self.controls(k, a, b) for a, b in pairwise(times)])
        out = self.vi.core.roll_out(t, x.copy(), None, u, None, energies=True)
        if out.steps < len(u):
            return None
        quality = quality_of(self.vi.mechanism, out, t)
        return _Made(np.array(out.x[-1]), np.array(out.lam[-1]), np.array(out.energies), quality, out.rank_deficient)

    def _keeps_energy(self, k: int, x: Array, times: tuple[float, ...], whole: _Made) -> bool:
        parts = self._steps(k, x, times)
        if parts is None:
            return False
        u, h = self.controls(k, times[0], times[-1]), times[-1] - times[0]
        at_end, by_parts = (self._energy(each, u, times[-1], h) for each in (whole.x, parts.x))
        if at_end is None or by_parts is None:
            return False
        (energy, size), (better, _) = at_end, by_parts
        noted = np.vstack((whole.energies, parts.energies))
        of_whole, of_first, of_second = noted[:, 0] + noted[:, 1]
        # From the middle of the first part to that of the second the energy goes evenly, to the second order.
        there = of_first + (times[2] - times[1]) / h * (of_second - of_first)
        off = max(abs(energy - better), abs(of_whole - there))
        return bool(off <= self.tolerance + _ROUNDING * size)

    def _energy(self, x: Array, u: Array, t: float, h: float) -> tuple[float, float] | None:
        """Return the energy at a state, and the sizes of its terms: in the middle of a very short step."""
        m, short = self.vi.mechanism, _SHORT * h
        row = u.copy()
        row[m.n_inputs :] = held(m, x[m.first_rho : m.nq]) + short * x[m.nx - m.nrho :]
        out = self.vi.core.roll_out(np.array((t, t + short)), x.copy(), None, row[None, :], None, energies=True)
        if out.steps < 1:
            return None
        kinetic, potential, _, _, size = out.energies[0]
        return float(kinetic + potential), float(size)
