"""URDF: links and joints, masses, limits, and what they look like."""

from __future__ import annotations

from leastaction.io.mechanisms.urdf.robot import read_urdf

__all__ = ["read_urdf"]
