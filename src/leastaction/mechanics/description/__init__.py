"""How a mechanism is described: frames, joints, poses, bodies, and the tree that they make."""

from __future__ import annotations
