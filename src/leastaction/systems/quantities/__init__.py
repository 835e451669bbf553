"""What can be limited of a mechanism, by the names of its description: in discrete and in continuous time."""

from __future__ import annotations
