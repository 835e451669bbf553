"""The marionette that is measured: the conformance case if its folder is there, else the package's own."""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from leastaction.mechanics import Mechanism, MidpointVI
from leastaction.models import marionette as model

Array = np.ndarray

ROOT = Path(__file__).resolve().parent.parent
DT = 0.01
ARMS_AND_LEGS = ("right_leg", "left_arm", "right_arm", "left_leg")


@dataclass(frozen=True)
class Case:
    """A mechanism with a motion.

    ``t`` (N+1,), ``x0`` (nx,), ``u`` (N, nrho): times, first state, kinematic variables at the ends of the
    steps. ``q``: the configurations (N+1, nq) that an independent program gave for it, if there is one.
    """

    name: str
    mechanism: Mechanism
    t: Array
    x0: Array
    u: Array
    q: Array | None

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.t) - 1


def marionette() -> Case:
    """Return `marionette_strings` of CONFORMANCE_DIR with its own motion, or the package's marionette."""
    folder = Path(os.environ.get("CONFORMANCE_DIR", ROOT.parent / "shared" / "conformance"))
    path = folder / "marionette_strings.json"
    if path.exists():
        loaded = _loader().load_case(path)
        if loaded.mechanism is not None:
            m, arrays = loaded.mechanism, loaded.arrays
            x0 = np.concatenate([arrays["q"][0], arrays["p"][0], np.zeros(m.nrho)])
            u = np.hstack([arrays["u"], arrays["rho_next"]])
            return Case("marionette_strings", m, arrays["t"], x0, u, arrays["q"])
    return package_marionette()


def package_marionette() -> Case:
    """Return the package's marionette, which walks on the spot."""
    m = model.marionette()
    t = DT * np.arange(301)
    rho = string_motion(m, model.rest_pose(m)[m.nd :], t)
    x0 = MidpointVI(m).start(model.rest_pose(m)).x
    return Case("package marionette", m, t, x0, rho[1:], None)


def string_motion(mechanism: Mechanism, rho0: Array, t: Array) -> Array:
    """Return kinematic variables (N+1, nrho) that let the puppet walk on the spot.

    The strings of arms and legs are let out and drawn in by up to 0.1 m at 0.3 Hz, an arm together with the
    leg of the other side; everything else stays. It is how the conformance case moves.
    """
    rho = np.tile(rho0, (len(t), 1))
    swing = 0.1 * np.sin(2.0 * np.pi * 0.3 * (t - t[0]))
    for part in ARMS_AND_LEGS:
        column = mechanism.kinematic.index(f"{part}_string-length")
        sign = 1.0 if part in ("right_leg", "left_arm") else -1.0
        rho[:, column] += sign * swing
    return rho


def _loader() -> ModuleType:
    """Return the tests' reader of conformance cases, which is no part of a package."""
    name, path = "_conformance_loader", ROOT / "tests" / "conformance" / "loader.py"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
