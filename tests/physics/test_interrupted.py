"""Ctrl-C keeps the steps that were made, whatever takes long in them."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

from leastaction.mechanics import Gravity, Mechanism, MidpointVI, PythonPotential, SimulationStatus, rx, tz
from leastaction.models.chain import pendulum_chain

pytestmark = pytest.mark.skipif(not hasattr(signal, "raise_signal"), reason="needs signals")


def interrupt_after(seconds: float) -> threading.Timer:
    timer = threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    return timer


def test_native_steps_are_kept_up_to_ctrl_c() -> None:
    """Within the steps that are made without looking at Python."""
    m = pendulum_chain(400)
    vi = MidpointVI(m)
    start = vi.start(np.full(m.nq, 0.1))
    timer = interrupt_after(0.15)
    began = time.monotonic()
    run = vi.simulate(start, np.arange(4_000) * 1e-4)
    timer.join()
    assert time.monotonic() - began < 20.0
    assert run.status is SimulationStatus.INTERRUPTED
    assert 0 < run.steps < 2000, "not even the first of the pieces between looks at Python"
    assert np.isfinite(run.x).all()
    whole = vi.simulate(start, run.t)
    assert np.array_equal(whole.x, run.x)
    assert run.balance is not None
    assert len(run.balance.residual) == run.steps
    on = vi.simulate(run.last, run.t[-1] + np.arange(10) * 1e-4)
    assert on.status is SimulationStatus.COMPLETED


class SlowSpring:
    """A spring that is interrupted where it is evaluated for the so-manieth time."""

    calls = 0

    def value(self, z: np.ndarray) -> float:
        type(self).calls += 1
        if type(self).calls == 400:
            signal.raise_signal(signal.SIGINT)
        return float(0.5 * z @ z)

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return z

    def hessian(self, z: np.ndarray) -> np.ndarray:
        return np.eye(len(z))


def test_steps_are_kept_when_a_slow_element_is_interrupted() -> None:
    m = Mechanism([rx("a"), [tz(-1.0, mass=1.0)]], [Gravity(), PythonPotential(SlowSpring(), variables=["a"])])
    vi = MidpointVI(m)
    start = vi.start([0.5])
    run = vi.simulate(start, np.linspace(0.0, 10.0, 1001))
    assert run.status is SimulationStatus.INTERRUPTED
    assert 20 < run.steps < 399
    again = vi.simulate(start, run.t)
    assert again.status is SimulationStatus.COMPLETED
    assert np.array_equal(again.x, run.x)
