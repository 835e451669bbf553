"""Following a wanted motion with any mechanism."""

from __future__ import annotations

from leastaction.systems.following.follow import Followed, follow

__all__ = ["Followed", "follow"]
