"""The continuous system ``x' = f(x, u, t)``: all that the optimiser knows of what it steers.

Three methods at one time are enough to define a system. Methods over many samples ask for one after the other, unless
the system has a faster way for many at once: each asks a method that begins with ``own_`` first.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.differences import fourth_order
from leastaction.optimal.system import Linearization, System, missing_unless, second_derivative

_PART = 1e-3  # step of differences by a parameter, in parts of its value


class ContinuousSystem(System):
    """A system in continuous time.

    Subclasses set `nx` and `nu`, and implement what `System` says. All derivatives are by the nx numbers of a state,
    and gains act on them, also where not all numbers are states, as of a unit quaternion: a rate that leads from states
    to states is enough. A `space` says how costs take differences.
    """

    by_numbers = True
    quantities: tuple[str, ...] = ("input", "state")
    jumps: Sequence[float] = ()
    """Times (s) where f jumps with time, if it does: integrators start anew there."""
    autonomous: bool = False
    """Whether f does not depend on time: a free final time then needs no derivatives by it."""

    @abstractmethod
    def f(self, x: Array, u: Array, t: float) -> Array:
        """Return the rate of the state (nx,). A state without one raises `StepError`."""

    @abstractmethod
    def derivatives(self, x: Array, u: Array, t: float) -> tuple[Array, Array]:
        """Return ``A = df/dx`` (nx, nx) and ``B = df/du`` (nx, nu)."""

    def rates(self, x: Array, u: Array, t: Array) -> Array:
        """Return the rates of the state (n, nx) at samples ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""
        found = self.own_rates(x, u, t)
        if found is not None:
            return found
        x, u = read_only(x), read_only(u)
        return np.stack([self.f(*at) for at in zip(x, u, t.tolist(), strict=True)])

    def own_rates(self, x: Array, u: Array, t: Array) -> Array | None:
        """Return the same at once; None of a system that has no such way."""

    def starting_at(self, t: float) -> ContinuousSystem:
        """Return the same system, its initial states those of a time (s): constraints may change with it."""
        return self.own_starting_at(t) or self

    def own_starting_at(self, t: float) -> ContinuousSystem | None:
        """Return it where that makes a difference; None where it makes none."""

    # ---- Parameters: what can be found together with a motion ---------------------------------------

    def with_parameters(self, values: Mapping[str, float]) -> ContinuousSystem | None:
        """Return the same system with other values of some parameters; None of a system without."""

    def with_parameters_near(self, values: Mapping[str, float]) -> ContinuousSystem | None:
        """Return the same for differences, also of values that are not quite possible; None: as `with_parameters`."""

    def rates_by(self, x: Array, u: Array, t: Array, names: Sequence[str]) -> Array:
        """Return the derivatives (n, nx, len(names)) of the rates at samples by some parameters.

        By differences of fourth order over a thousandth of the parameter, good to about eleven digits.
        """
        columns = []
        for name in names:
            value = self.parameters[name]

            def rates(by: float, name: str = name, value: float = value) -> Array:
                return with_parameters(self, {name: value + by}, near=True).rates(x, u, t)

            columns.append(fourth_order(rates, _PART * (abs(value) or 1.0)))
        return np.stack(columns, axis=-1) if columns else np.empty((len(t), self.nx, 0))

    # ---- Samples ------------------------------------------------------------------------------------

    def roll_out_pieces(
        self, h: Array, t: Array, matrix: Array, reference: tuple[Array, Array], K: Array, z: Array, u: Array
    ) -> int | None:
        """Simulate pieces of a mesh under a feedback, as far as it succeeds; return how many pieces that are.

        None of a system that leaves all of it to `CollocationSystem`, which goes on where this ends.

        Parameters
        ----------
        h : ndarray (n,)
            Lengths of the pieces (s).
        t : ndarray (n, points)
            Times of their points (s).
        matrix : ndarray (points, points)
            Of the method.
        reference : ndarray (n+1, nz) and (n, points * nu)
            States of the discrete system, and inputs.
        K : ndarray (n, points * nu, ndz)
            Gains, on differences of these states.
        z, u : ndarray (n+1, nz) and (n, points * nu)
            Written to, but for the first state, which is given.
        """

    def linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        """Return the derivatives at samples ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""
        found = self.own_linearize(x, u, t)
        if found is not None:
            return found
        A, B = np.empty((len(t), self.nx, self.nx)), np.empty((len(t), self.nx, self.nu))
        x, u, t = (read_only(array.copy()) for array in (x, u, t))
        for i in range(len(t)):
            A[i], B[i] = self.derivatives(x[i], u[i], float(t[i]))
        return Linearization(A, B, partial(self.curvatures, x, u, t))

    def own_linearize(self, x: Array, u: Array, t: Array) -> Linearization | None:
        """Return the same at once; None of a system that has no such way."""

    def slopes(self, x: Array, u: Array, t: Array) -> Array:
        """Return ``df/dx`` (n, nx, nx) at samples, as far as Newton's method needs it to find states."""
        found = self.own_slopes(x, u, t)
        return self.linearize(x, u, t).A if found is None else found

    def own_slopes(self, x: Array, u: Array, t: Array) -> Array | None:
        """Return the same where less of it is needed than `linearize` returns."""

    def curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        """Return ``z . D2f`` (n, nx+nu, nx+nu) at samples; z (n, nx) like the others."""
        found = self.own_curvatures(x, u, t, z)
        if found is not None:
            return found
        n = self.nx + self.nu
        H = np.empty((len(t), n, n))
        x, u, z = read_only(x), read_only(u), read_only(z)
        for i in range(len(t)):
            H[i] = second_derivative(self, x[i], u[i], float(t[i]), z[i])
        return H

    def own_curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array | None:
        """Return the same at once; None of a system that has no such way."""


def with_parameters(system: ContinuousSystem, values: Mapping[str, float], *, near: bool = False) -> ContinuousSystem:
    """Return `ContinuousSystem.with_parameters`, or `with_parameters_near`; complain where there is none."""
    found = system.with_parameters_near(values) if near else None
    return missing_unless(system.with_parameters(values) if found is None else found, system, "with_parameters")
