"""The motion nearest to a plan that a machine makes whose strings stretch.

What is planned on strings that do not stretch need not be a motion of one on which they do: a bar that carries seven
strings has six numbers to make up for seven stretches, and pulls of some hundredths of a second make elastic strings
swing. A regulator along it would be asked, at every instant, for what there is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from numpy.typing import ArrayLike

from leastaction.control.rigs.pushing import Pushing, PushingCost
from leastaction.control.rigs.strings import Strings, as_springs
from leastaction.errors import LeastActionError
from leastaction.numerics.arrays import Array
from leastaction.optimal import QuadraticCost, Status
from leastaction.optimal.optimizer import optimized
from leastaction.systems.midpoint import MidpointSystem

_PUSHING: Final = 500.0  # 1/J, the price of the energy by which a spring is short of the least that its string pulls
_ITERATIONS: Final = 100
_ROUGHLY: Final = 1e-2  # tolerance


def nearest(
    model: MidpointSystem, x: Array, u: Array, *, Q: ArrayLike, R: ArrayLike, least: Mapping[str, float]
) -> tuple[Array, Array]:
    """Return the motion of a model with elastic strings that is nearest to a plan; the plan itself if none is found.

    Its strings are springs that do not push, or hardly: that has a price, as in `Regulator`.

    Parameters
    ----------
    model : MidpointSystem
        With elastic strings that only pull.
    x, u : ndarray (N+1, nx), (N, nu)
        The plan, which the model need not go along.
    Q, R : array_like
        What it is to be near by, as of `QuadraticCost`.
    least : mapping of str to float
        By how much strings are to be stretched at the least (m), by name. Others may be as slack as they are planned.

    Raises
    ------
    KeyboardInterrupt
        Where Ctrl-C ends the search.
    """
    m = model.mechanism
    springs = MidpointSystem(model.integrator.like(as_springs(m)), model.t)
    strings = Strings(m)
    room = strings.room_along(x[:, : m.nq])
    for i, name in enumerate(strings.names):
        if name in least:
            room[:, i] = -least[name]
    cost = PushingCost(QuadraticCost(x, u, Q=Q, R=R, space=springs), springs, Pushing(strings, room, _PUSHING))
    try:
        found = optimized(
            springs, cost, initial=(x, u), shooting="multiple", max_iterations=_ITERATIONS, tolerance=_ROUGHLY
        )
    except LeastActionError:
        return x, u
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return found.x, found.u
