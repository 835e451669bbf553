"""A feedback law inside the discrete step: evaluated where forces act, at the midpoint.

A law held over a step acts with the state of its start, late by half a step, which costs an order of accuracy. At the
midpoint a step from q1 to q2 has::

    q = (q1 + q2)/2,   v = (q2 - q1)/dt,   p = dL/dv(q, v)

(halfway of a rotation that is a quaternion, with the angular velocity that leads there evenly)
and its input solves ``u = law(t + dt/2, [q; rho; p; v_rho])``, where q2 depends on u. That is solved by Newton's
method, with the exact derivative B of the step and the law differentiated along it. Such a closed loop is of second
order, and a law ``-c v`` is the same as a damper.
"""

from __future__ import annotations

import numpy as np

from leastaction import _core
from leastaction.errors import StepError
from leastaction.mechanics.discrete.derivatives import linearize_arrays
from leastaction.mechanics.discrete.integrator import Integrator
from leastaction.mechanics.discrete.trajectory import state_of
from leastaction.mechanics.mechanism.turns import difference, middles, moved_state
from leastaction.numerics.arrays import Array, as_array, read_only
from leastaction.numerics.signals import StateLaw

_CLOSE = 1e-11  # of the largest input, or of 1: how far input and law may be apart
_CORRECTIONS = 12
_FRESH = 3  # corrections with an older derivative, updated by Broyden's formula, before a new one
_PART = 1e-4  # of a change of the input by one: the way over which the law is differentiated


class MidpointLaw:
    """The inputs of steps by a law at their midpoints, one step after the other. Not for several threads.

    ``law``: ``law(t, x) -> (n_inputs,)``, with ``x = [q; rho; p; v_rho]`` at the midpoint.
    """

    def __init__(self, integrator: Integrator, law: StateLaw) -> None:
        self.integrator = integrator
        self.law = law
        self._slope: Array | None = None  # of law - u by u, at the last step
        self._u: Array | None = None

    def step(self, t: Array, x: Array, rho_next: Array) -> tuple[_core.RollOut, Array]:
        """Return the step from a state under the law's input, and that input.

        ``t`` (2,): times of its ends (s). ``x`` (nx,): state at its start. ``rho_next`` (nrho,): kinematic variables at
        its end. Returns the roll-out of a single step, as it is where it failed, and the input (n_inputs,). Raises
        `StepError` if no input is found that agrees with the law.
        """
        n = self.integrator.mechanism.n_inputs
        u = self._at(float(t[0]), x) if self._u is None else self._u
        out = self._made(t, x, u, rho_next)
        slope, age = self._slope, 0
        gap: Array = np.zeros(n)
        step: Array = gap
        for correction in range(_CORRECTIONS + 1):
            if out.steps < 1:
                return out, u
            before, gap = gap, self._value(t, x, out.x[1]) - u
            if float(np.abs(gap).max(initial=0.0)) <= _CLOSE * (1.0 + np.abs(u).max(initial=0.0)):
                self._slope, self._u = slope, u
                return out, u
            if slope is None or age == _FRESH:
                slope, age = self._differentiated(t, x, u, rho_next, out.x[1]), 0
            elif correction > 0:
                slope = slope + np.outer(gap - before - slope @ step, step) / (step @ step)
                age += 1
            step = np.asarray(-np.linalg.lstsq(slope, gap, rcond=None)[0], dtype=np.float64)
            u = u + step
            out = self._made(t, x, u, rho_next)
        m = self.integrator.mechanism
        i = int(np.argmax(np.abs(gap)))
        raise StepError(
            f"the step at t = {t[0]:.6g} s failed: no input agrees with the law at the midpoint, {m.inputs[i]!r} is "
            f"{gap[i]:.3g} off after {_CORRECTIONS} corrections. Give a law that is smooth over a step, a smaller "
            "time step, or law_at='start'",
            t=float(t[0]),
            residuals=dict(zip(m.inputs, gap.tolist(), strict=True)),
            iteration=_CORRECTIONS,
            state=state_of(m, float(t[0]), x),
        )

    def _made(self, t: Array, x: Array, u: Array, rho_next: Array) -> _core.RollOut:
        inputs = np.concatenate([u, rho_next])[None, :]
        return self.integrator.core.roll_out(t, x.copy(), None, inputs, None)

    def _at(self, t: float, x: Array) -> Array:
        m = self.integrator.mechanism
        given = self.law(t, read_only(x))
        return as_array(given, f"inputs({t:g}, x)", (m.n_inputs,), names=m.inputs)

    def _value(self, t: Array, x: Array, x_next: Array) -> Array:
        """Return what the law gives at the midpoint of a step."""
        m = self.integrator.mechanism
        ends = np.stack([x[: m.nq], x_next[: m.nq]])
        q, v = middles(m, ends)[0], difference(m, ends[1], ends[0]) / (t[1] - t[0])
        p = np.asarray(m.core.gradient(q, v)[1])[: m.nd]
        return self._at(0.5 * float(t[0] + t[1]), np.concatenate([q, p, v[m.nd :]]))

    def _differentiated(self, t: Array, x: Array, u: Array, rho_next: Array, x_next: Array) -> Array:
        """Return the derivative (n_inputs, n_inputs) of the law less the input, by the input."""
        m = self.integrator.mechanism
        pair = np.stack([x, x_next])
        inputs = np.concatenate([u, rho_next])[None, :]
        B = linearize_arrays(self.integrator, t, pair, inputs).B[0][:, : m.n_inputs]
        slope = -np.eye(m.n_inputs)
        for j, along in enumerate(B.T):
            # So short a way that the configuration moves by a part of itself at most.
            size = _PART / max(1.0, float(np.abs(along[: m.nv]).max(initial=0.0)) / (t[1] - t[0]))
            ahead = self._value(t, x, moved_state(m, x_next, size * along))
            slope[:, j] += (ahead - self._value(t, x, moved_state(m, x_next, -size * along))) / (2.0 * size)
        return slope
