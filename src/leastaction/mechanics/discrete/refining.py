"""Instants between given ones, where steps of the given length do not keep the energy, or cannot be made.

A step is held against two shorter ones from the same state, with the same input and prescribed motion: they have the
same energy, in the middle and at the end, but for what their lengths do to it. Where they do not, each of the two is
judged anew. What is decided follows from the state at the start of a given step alone, so that a run that goes on from
one of these goes on as it did.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.outcome import quality_of
from leastaction.mechanics.mechanism.mechanism import Mechanism
from leastaction.numerics.arrays import Array
from leastaction.numerics.signals import Signal, signal_rows
from leastaction.numerics.step_quality import StepQuality

_HALVINGS = 12  # partings of a given step, one within the other
# Places at which a step is parted, of its length. The next is tried where one before meets a configuration from which
# no way leads on, such as a lift that is upright, and strides across with another energy.
_PARTS = (0.5, 0.45, 0.41, 0.55, 0.37, 0.6)
_SHORT = 2.0**-10  # length, of a step, at whose middle the energy is still that of its start
_ROUNDING = 1e-10  # rounding of an energy, of the sizes of all its terms


class Controls:
    """Inputs, and prescribed variables at the end, of parts of steps.

    ``u``: of the steps (N, n_inputs + nrho). ``rho_start``: the prescribed variables at the first instant.
    """

    def __init__(self, m: Mechanism, t: Array, inputs: Signal, rho: Signal, u: Array, rho_start: Array) -> None:
        self.m, self.t, self.u = m, t, u
        self.inputs, self.rho = inputs, rho
        self.places = np.vstack((rho_start[None, :], u[:, m.n_inputs :]))

    def __call__(self, k: int, begin: float, end: float) -> Array:
        """Return those of a part of step k between two times."""
        m, n = self.m, self.m.n_inputs
        row = np.array(self.u[k])
        if begin == self.t[k] and end == self.t[k + 1]:
            return row
        if callable(self.inputs):
            row[:n] = signal_rows(self.inputs, np.array([0.5 * (begin + end)]), m.inputs, "inputs", row[:n])[0]
        if callable(self.rho):
            row[n:] = signal_rows(self.rho, np.array([end]), m.kinematic, "rho", row[n:])[0]
        elif m.nrho:
            share = (end - self.t[k]) / (self.t[k + 1] - self.t[k])
            row[n:] = self.places[k] + share * (self.places[k + 1] - self.places[k])
        return row


class RefinedStep(NamedTuple):
    """A step, or a part of one: its end (s), its controls, the state there, multipliers, how coarse it was.

    ``redundant``: whether constraints were found to be.
    """

    t: float
    u: Array
    x: Array
    lam: Array
    quality: StepQuality | None
    redundant: bool


@dataclass(frozen=True)
class _Made:
    """Steps one after the other: the end of the last, its multipliers, and what is noted of all their energies."""

    x: Array
    lam: Array
    energies: Array
    quality: StepQuality | None
    redundant: bool


class Refiner:
    """Makes steps between given instants, with more where they do not keep the energy.

    ``tolerance``: what the length of a step may do to the energy (J).
    """

    def __init__(self, vi: Integrator, controls: Controls, tolerance: float) -> None:
        self.vi, self.controls, self.tolerance = vi, controls, tolerance
        self.found: list[RefinedStep] = []
        self.strayed = 0.0  # energy (J) that came or went in strides of these

    def make(self, k: int, x: Array) -> list[RefinedStep]:
        """Return the parts of given step k from the state x at its start; none where one of them cannot be made."""
        begin, end = self.controls.t[k : k + 2].tolist()
        best, least = list[RefinedStep](), np.inf
        for part in _PARTS:
            self.found, self.strayed = [], 0.0
            if self._go(k, x, begin, end, part, _HALVINGS) is not None and self.strayed <= least:
                best, least = self.found, self.strayed
            if least <= self.tolerance:
                break
        return best

    def _go(self, k: int, x: Array, begin: float, end: float, part: float, halvings: int) -> Array | None:
        """Return the state at the end of a part of step k, or None where it cannot be reached."""
        whole = self._steps(k, x, (begin, end))
        inner = begin + part * (end - begin)
        if whole is not None and self._keeps_energy(k, x, (begin, inner, end), whole):
            return self._note(k, begin, end, whole)
        if halvings > 0:
            before, strayed = len(self.found), self.strayed
            first = self._go(k, x, begin, inner, part, halvings - 1)
            second = None if first is None else self._go(k, first, inner, end, part, halvings - 1)
            if second is not None:
                return second
            del self.found[before:]
            self.strayed = strayed
        if whole is None:
            return None
        # Where its parts meet a configuration from which no way leads on it strides across.
        u, h = self.controls(k, begin, end), end - begin
        before_it, after_it = self._energy(x, u, begin, h), self._energy(whole.x, u, end, h)
        self.strayed += np.inf if before_it is None or after_it is None else abs(after_it[0] - before_it[0])
        return self._note(k, begin, end, whole)

    def _note(self, k: int, begin: float, end: float, made: _Made) -> Array:
        """Note what was made of a step; return the state at its end."""
        u = self.controls(k, begin, end)
        self.found.append(RefinedStep(end, u, made.x, made.lam, made.quality, made.redundant))
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
        row[m.n_inputs :] = x[m.nq - m.nrho : m.nq] + short * x[m.nx - m.nrho :]
        out = self.vi.core.roll_out(np.array((t, t + short)), x.copy(), None, row[None, :], None, energies=True)
        if out.steps < 1:
            return None
        kinetic, potential, _, _, size = out.energies[0]
        return float(kinetic + potential), float(size)
