"""Trajectory optimisation of systems ``x+ = f(x, u, k)`` and ``x' = f(x, u, t)``; knows no mechanics.

A system is a `DiscreteSystem` or a `ContinuousSystem`, a cost a `Cost` or a `ContinuousCost`; `optimize`
brings them together.
"""

from __future__ import annotations

from leastaction._names import by_stub

__getattr__, __dir__, __all__ = by_stub(__name__)
