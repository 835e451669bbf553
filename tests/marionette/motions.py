"""Motions that several tests follow: made up for the marionette, and captured ones."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from leastaction.io import Motion
from leastaction.models.marionette import REST, marionette

PUPPET = marionette()

_BESIDE = Path(__file__).resolve().parents[3] / "shared"


def captured(file: str) -> Path:
    """Return a real capture by its name, such as wave_hello.bvh; without the captures a test is skipped."""
    path = Path(os.environ.get("SHARED_DIR", _BESIDE)) / "data" / "mocap" / file
    if not path.exists():
        pytest.skip(f"no {path} (set SHARED_DIR)")
    return path


def leap(duration: float = 0.5, dt: float = 0.01) -> Motion:
    """Return a motion that hanging strings cannot make: the puppet darts half a metre ahead and turns."""
    t = np.linspace(0.0, duration, round(duration / dt) + 1)
    s = t / duration
    rise = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    q = np.zeros((len(t), PUPPET.nd))
    for name, angle in REST.items():
        q[:, PUPPET.dynamic.index(name)] = angle
    q[:, PUPPET.dynamic.index("torso_ty")] = 0.5 * rise
    q[:, PUPPET.dynamic.index("torso_rz")] = 0.8 * rise
    return Motion(PUPPET.dynamic, t, q, "leap")
