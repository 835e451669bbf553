"""The linear-quadratic problem, projection and descent in discrete time."""

from __future__ import annotations
