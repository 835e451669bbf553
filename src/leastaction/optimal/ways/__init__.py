"""Ways to begin again, where a run diverges or ends without a minimum: each a file of its own.

`WAYS` is the policy: before each iteration, and where a stage ends without a minimum, the first of them that applies
and can be begun is taken. Any of them can be switched off: ``Options(without=["easing"])``.
"""

from __future__ import annotations

from leastaction.optimal.loop.way import Way
from leastaction.optimal.ways.easing import EASING
from leastaction.optimal.ways.freely import FREELY
from leastaction.optimal.ways.gaps import GAPS
from leastaction.optimal.ways.resolved import RESOLVED

WAYS: tuple[Way, ...] = (FREELY, GAPS, EASING, RESOLVED)
"""All of them, in the order in which they are tried."""

__all__ = ["WAYS", "Way"]
