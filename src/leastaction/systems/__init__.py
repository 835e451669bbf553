"""The bridges between mechanics and optimal control: a mechanism as a system that the optimisers can steer."""

from __future__ import annotations

from leastaction._names import by_stub

__getattr__, __dir__, __all__ = by_stub(__name__)
