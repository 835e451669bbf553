"""The continuous system ``x' = f(x, u, t)``: all that the optimiser knows of what it steers.

Three methods at one time are enough to define a system; a system with a faster way for many times at once
overrides those over samples.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from leastaction.numerics.arrays import Array, read_only
from leastaction.numerics.differences import fourth_order
from leastaction.optimal.quantity import Quantity
from leastaction.optimal.system import Linearization, System

_PART = 1e-3  # of a parameter, by which it is moved for differences


class ContinuousSystem(System):
    """A system in continuous time.

    Subclasses set `nx` and `nu`, and implement what `System` says. All derivatives are by the nx numbers of a state,
    and gains act on them, also where not all numbers are states, as of a unit quaternion: a rate that leads from states
    to states is enough. A `space` says how costs take differences.
    """

    by_numbers = True
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
        x, u = read_only(x), read_only(u)
        return np.stack([self.f(*at) for at in zip(x, u, t.tolist(), strict=True)])

    def starting_at(self, t: float) -> ContinuousSystem:  # noqa: ARG002 - overridden
        """Return the same system with initial states that are some at a time (s), where constraints change with it."""
        return self

    # ---- Parameters: what can be found together with a motion ---------------------------------------

    def with_parameters(self, values: Mapping[str, float]) -> ContinuousSystem:
        """Return the same system with other values of some parameters."""
        raise NotImplementedError(f"{type(self).__name__} has no parameters: implement `with_parameters`.")

    def with_parameters_near(self, values: Mapping[str, float]) -> ContinuousSystem:
        """Return the same for values that are off by a little, for differences: as if all of them were possible."""
        return self.with_parameters(values)

    def rates_by(self, x: Array, u: Array, t: Array, names: Sequence[str]) -> Array:
        """Return the derivatives (n, nx, len(names)) of the rates at samples by some parameters.

        By differences of fourth order over a thousandth of the parameter, good to about eleven digits.
        """
        columns = []
        for name in names:
            value = self.parameters[name]

            def rates(by: float, name: str = name, value: float = value) -> Array:
                return self.with_parameters_near({name: value + by}).rates(x, u, t)

            columns.append(fourth_order(rates, _PART * (abs(value) or 1.0)))
        return np.stack(columns, axis=-1) if columns else np.empty((len(t), self.nx, 0))

    # ---- Samples ------------------------------------------------------------------------------------

    def quantity(self, kind: str, t: Array | None = None) -> Quantity:  # noqa: ARG002 - overridden
        """Return the quantities of a kind, by name; of one that depends on time, at the instants t."""
        return super().quantity(kind)

    def roll_out_pieces(
        self,
        h: Array,  # noqa: ARG002 - overridden, all of them
        matrix: Array,  # noqa: ARG002
        reference: tuple[Array, Array],  # noqa: ARG002
        K: Array,  # noqa: ARG002
        z: Array,  # noqa: ARG002
        u: Array,  # noqa: ARG002
    ) -> int:
        """Simulate pieces by collocation under a feedback, as far as it goes; return how many pieces it went.

        For `CollocationSystem`, which goes on where a system that has no faster way ends: here, at once.

        Parameters
        ----------
        h : ndarray (n,)
            Lengths of the pieces (s).
        matrix : ndarray (points, points)
            Of the method.
        reference : ndarray (n+1, nz) and (n, points * nu)
            States of the discrete system, and inputs.
        K : ndarray (n, points * nu, nz)
            Gains.
        z, u : ndarray (n+1, nz) and (n, points * nu)
            Written to, but for the first state, which is given.
        """
        return 0

    def linearize(self, x: Array, u: Array, t: Array) -> Linearization:
        """Return the derivatives at samples ``x`` (n, nx), ``u`` (n, nu), ``t`` (n,)."""
        A, B = np.empty((len(t), self.nx, self.nx)), np.empty((len(t), self.nx, self.nu))
        x, u, t = (read_only(array.copy()) for array in (x, u, t))
        for i in range(len(t)):
            A[i], B[i] = self.derivatives(x[i], u[i], float(t[i]))
        return Linearization(A, B, partial(self.curvatures, x, u, t))

    def slopes(self, x: Array, u: Array, t: Array) -> Array:
        """Return ``df/dx`` (n, nx, nx) at samples, as far as Newton's method needs it to find states."""
        A, _ = self.linearize(x, u, t)
        return A

    def curvatures(self, x: Array, u: Array, t: Array, z: Array) -> Array:
        """Return ``z . D2f`` (n, nx+nu, nx+nu) at samples; z (n, nx) like the others."""
        n = self.nx + self.nu
        H = np.empty((len(t), n, n))
        x, u, z = read_only(x), read_only(u), read_only(z)
        for i in range(len(t)):
            H[i] = self.curvature(x[i], u[i], float(t[i]), z[i])
        return H
