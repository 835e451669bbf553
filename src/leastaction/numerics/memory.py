"""What large results take, said before they are made."""

from __future__ import annotations

import math
from collections.abc import Sequence

from leastaction.errors import ArgumentError

MAX_BYTES = 2**30
"""What a full tensor may take unless its caller allows more (1 GiB)."""


def check_memory(shape: Sequence[int], max_bytes: float, what: str, instead: str) -> None:
    """Complain about an array of doubles that is larger than allowed, before it is made.

    ``what``: what it is, and ``instead``: what to do, for the message. Raises `ArgumentError`.
    """
    needed = 8 * math.prod(shape)
    if needed > max_bytes:
        raise ArgumentError(
            f"{what}: the full tensor of shape {tuple(shape)} takes {needed / 1e6:.3g} MB, and max_bytes allows "
            f"{max_bytes / 1e6:.3g} MB; {instead}, or allow more"
        )
