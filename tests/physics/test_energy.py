"""Energy of a conservative mechanism: it stays in a band that narrows with dt^2, and does not drift."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import Gravity, Trajectory
from leastaction.models.chain import pendulum_chain
from physics.laws import floating_chain, in_motion, measured_order, swing, times


def chain_energy(steps: int, dt: float) -> Trajectory:
    links = 10
    m = pendulum_chain(links)
    return swing(m, np.full(links, 0.15), np.zeros(links), dt * np.arange(steps + 1))


def drift(energy: np.ndarray, blocks: int = 50) -> tuple[float, float]:
    """Return the linear trend over the whole run and its standard error, from means over blocks."""
    means = energy[: len(energy) // blocks * blocks].reshape(blocks, -1).mean(axis=1)
    x = np.arange(blocks) - (blocks - 1) / 2
    slope = (x @ means) / (x @ x)
    residual = means - means.mean() - slope * x
    error = np.sqrt(residual @ residual / (blocks - 2) / (x @ x))
    return float(slope * blocks), float(error * blocks)


def assert_band_without_drift(run: Trajectory, band: float) -> None:
    energy = run.energy()
    total, scale = energy.total, np.ptp(energy.kinetic)
    assert scale > 1.0
    width = np.ptp(total)
    assert 0.0 < width < band * scale
    trend, error = drift(total)
    assert abs(trend) < 4.0 * error
    assert abs(trend) < 0.02 * width


def test_trend_is_seen_where_there_is_one() -> None:
    noise = np.random.default_rng(0).standard_normal(20000)
    for slope, seen in ((0.0, False), (0.2, True)):
        trend, error = drift(noise + np.linspace(0.0, slope, 20000))
        assert (abs(trend) > 4.0 * error) == seen


def test_energy_of_a_chain_of_ten_links() -> None:
    assert_band_without_drift(chain_energy(5000, 0.01), 0.02)


@pytest.mark.slow
def test_energy_of_a_chain_of_ten_links_over_1e5_steps() -> None:
    assert_band_without_drift(chain_energy(100_000, 0.01), 0.02)


def test_energy_band_narrows_with_the_square_of_the_time_step() -> None:
    m = floating_chain(elements=[Gravity((0.0, 0.0, -2.0))])
    q, v = in_motion(m, 4)

    def width(steps: int) -> float:
        return float(np.ptp(swing(m, q, v, times(1.0, steps)).energy().total))

    assert measured_order(width, (200, 400, 800)) == pytest.approx(2.0, abs=0.1)
