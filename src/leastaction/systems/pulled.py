"""Strings whose tensions are inputs: the bridge in discrete time with forces that act as those of constraints do."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from leastaction.errors import ArgumentError
from leastaction.mechanics.discrete.midpoint import MidpointVI
from leastaction.numerics.public import public
from leastaction.systems.midpoint import MidpointSystem


@public
class PulledSystem(MidpointSystem):
    """A `MidpointSystem` in which the forces of some inputs act at the instants, as those of constraints do.

    In a step of the midpoint rule an input's force acts at the step's middle, a constraint's at its start:
    ``p_1 + D_1 L_d + f_d^- = Dh(q_1)' lam``. Here some inputs u get the second place, ``dt f(q_1, 0, u)`` in that of
    ``-Dh(q_1)' lam``, and half as much at the first instant, before which nothing acts. So a string whose tension is
    such an input (`TendonForce`) and a string of the same length as a constraint (`Distance`) make the same motion
    to the last bits: ``lam = dt T / (2 L)``. But with the tension as the input no equation has to be solved for it,
    nothing loses rank where strings cannot act on what they hold, and a string pulls if its input has a bound.

    State and input are those of `MidpointSystem`; any number of threads may share one system.

    Parameters
    ----------
    integrator : MidpointVI
        Of a mechanism without constraints.
    t : array_like, shape (N+1,)
        Times (s), increasing.
    at_instants : sequence of str
        The inputs that act at the instants.

    Raises
    ------
    ArgumentError
        For a mechanism with constraints, an unknown input, or times that do not increase.
    """

    def __init__(self, integrator: MidpointVI, t: ArrayLike, *, at_instants: Sequence[str]) -> None:
        m = integrator.mechanism
        if m.nc:
            raise ArgumentError(
                f"PulledSystem: the mechanism has {m.nc} constraints, expected none: leave them out, and put a force "
                "in the place of each"
            )
        super().__init__(integrator.with_instants(at_instants), t)
        self.first_share = 0.5

    @property
    def at_instants(self) -> tuple[str, ...]:
        """The inputs whose forces act at the instants."""
        return self.integrator.at_instants
