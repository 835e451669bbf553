"""Ready mechanisms, described as a user would describe them.

Each module holds one mechanism: a function of the module's name that builds it, and what belongs to it.
`MODELS` lists those that need no argument, by the name that the command line takes.
"""

from __future__ import annotations

from collections.abc import Callable

from leastaction.errors import unknown
from leastaction.mechanics import Mechanism
from leastaction.models import (
    andrews,
    bricard,
    broad_hand,
    cart_pendulum,
    chain,
    four_bars,
    hand,
    marionette,
    puppet_arm,
    scissor_lift,
)
from leastaction.numerics.public import public

__all__ = [
    "MODELS", "andrews", "bricard", "broad_hand", "build", "cart_pendulum", "chain", "four_bars", "hand", "marionette",
    "puppet_arm", "scissor_lift",
]  # fmt: skip

MODELS: dict[str, Callable[[], Mechanism]] = {
    "andrews": andrews.andrews,
    "bricard": bricard.bricard,
    "cart_pendulum": cart_pendulum.cart_pendulum,
    "four_bars": four_bars.four_bars,
    "hand": hand.hand,
    "marionette": marionette.marionette,
    "pendulum_chain": chain.pendulum_chain,
    "puppet_arm": puppet_arm.puppet_arm,
    "scissor_lift": scissor_lift.scissor_lift,
}
"""The models by name, each with its default arguments."""


@public
def build(name: str) -> Mechanism:
    """Build a model by name.

    Parameters
    ----------
    name : str
        One of `MODELS`.

    Raises
    ------
    ArgumentError
        For an unknown name.
    """
    if name not in MODELS:
        raise unknown("model", name, MODELS)
    return MODELS[name]()
