"""Files of mechanisms: `load` reads a URDF or an MJCF and returns a `Model`."""

from __future__ import annotations

from leastaction.io.mechanisms.loading import load
from leastaction.io.mechanisms.model import Keyframe, LeftOut, Model

__all__ = ["Keyframe", "LeftOut", "Model", "load"]
