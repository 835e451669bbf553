"""Threads that the machine does not give: the calling one does their part, with the same results."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("resource", reason="limits a process by the means of Unix")

STACK = 8 << 10  # kB of a thread: 4 MB of addresses hold none, 20 MB hold two

PROGRAM = """
import resource
import sys
from pathlib import Path

import numpy as np

from leastaction import ContinuousDynamics
from leastaction.models import marionette

mechanism = marionette.marionette()
rng = np.random.default_rng(5)
q, v = np.split(0.1 * rng.normal(size=(400, 2 * mechanism.nq)), 2, axis=1)
alone = ContinuousDynamics(mechanism, threads=1).accelerations(q, v)
together = ContinuousDynamics(mechanism, threads=8)
if (room := float(sys.argv[1])) < np.inf:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + int(room * 2**20),) * 2)
got = together.accelerations(q, v)
assert np.array_equal(got.a, alone.a) and np.array_equal(got.lam, alone.lam)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads its size where Linux has it")
@pytest.mark.parametrize("room", [4.0, 20.0, float("inf")])
def test_parts_of_threads_that_cannot_start_are_done(room: float) -> None:
    # The shell sets the limit: a function to call before `exec` would need a fork, which the threads of JAX forbid.
    result = subprocess.run(
        [
            "sh",
            "-c",
            f'ulimit -S -s {STACK} && exec "$@"',
            "sh",
            sys.executable,
            "-W",
            "error",
            "-c",
            PROGRAM,
            str(room),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
