"""Runs a program with `allocations.c` preloaded: it counts blocks of memory and chooses where they stand."""

from __future__ import annotations

import functools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent

PREAMBLE = """
import ctypes
import json

import numpy as np

from leastaction import *
from leastaction.elements import *
from leastaction.mechanics import *
from leastaction.optimal import *
from leastaction.systems import PulledSystem
from leastaction.models import MODELS, andrews, four_bars, marionette, puppet_arm, scissor_lift

memory = ctypes.CDLL(None)
memory.blocks_taken.restype = ctypes.c_long
memory.place_blocks_at.argtypes = [ctypes.c_size_t]


def started(name, integrator):
    # Inputs, and a start of each model that moves.
    mechanism = integrator.mechanism
    rng = np.random.default_rng(3)
    match name:
        case "andrews":
            return integrator.start(andrews.start(mechanism))
        case "four_bars":
            return integrator.start(*four_bars.at_angle(mechanism, 1.0, 0.5))
        case "marionette":
            return integrator.start(marionette.rest_pose(mechanism))
        case "puppet_arm":
            return integrator.start(puppet_arm.hang(mechanism, [0.3, 0.2]))
        case "scissor_lift":
            return integrator.start(*scissor_lift.at_angle(mechanism, 0.8, 0.2))
        case "bricard":
            return integrator.start(np.zeros(mechanism.nq))
        case _:
            return integrator.start(0.1 * rng.normal(size=mechanism.nq))
"""


@functools.cache
def library() -> Path:
    """Compile the library, once; skip the test where that cannot be done."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("needs Linux and a C compiler")
    out = Path(tempfile.mkdtemp()) / "allocations.so"
    # The compiler must not recognise a calloc in the calloc.
    flags = ["-shared", "-fPIC", "-O2", "-fno-builtin", "-Wall", "-Werror"]
    subprocess.run([compiler, *flags, "-o", out, HERE / "allocations.c"], check=True)
    return out


def run(program: str, *arguments: str, variant: str | None = None) -> Any:
    """Return what a program prints as JSON, the library preloaded."""
    chosen = {"LEASTACTION_CORE": variant} if variant else {}
    result = subprocess.run(
        [sys.executable, "-c", PREAMBLE + program, *arguments],
        env=os.environ | chosen | {"LD_PRELOAD": str(library())},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)
