"""MJCF, through MuJoCo's specification of it, which is read and never compiled."""

from __future__ import annotations

from leastaction.io.mechanisms.mjcf.elements import elements_of
from leastaction.io.mechanisms.mjcf.keyframes import keyframes_of
from leastaction.io.mechanisms.mjcf.robot import read_mjcf

__all__ = ["elements_of", "keyframes_of", "read_mjcf"]
