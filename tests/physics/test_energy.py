"""Energy of a conservative mechanism: it stays in a band that narrows with dt^2, and does not drift.

The midpoint integrator is the implicit midpoint rule on Hamilton's equations, which keeps
``H - dt^2/24 (p' q'' - q' p'') + O(dt^4)``. The energy itself follows where the motion goes on its way to
equipartition, so a drift is looked for in that sum, where it would be seen a thousand times sooner.
"""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.mechanics import Damping, Gravity, Mechanism, Trajectory, world
from leastaction.models.chain import pendulum_chain
from physics.laws import floating_chain, in_motion, measured_order, swing, times

LINKS = 10


def swinging(m: Mechanism, steps: int, dt: float) -> Trajectory:
    return swing(m, np.full(LINKS, 0.15), np.zeros(LINKS), dt * np.arange(steps + 1))


def energies(run: Trajectory, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Return H(q_k, p_k) at every so many instants, and the sum that is kept to fourth order."""
    m, dt = run.mechanism, run.t[1] - run.t[0]
    H, kept = [], []
    for k in range(1, run.steps, every):
        (q0, q1, q2), (p0, p1, p2) = run.q[k - 1 : k + 2], run.p[k - 1 : k + 2]
        v = np.linalg.solve(m.mass_matrix(q1), p1)
        H.append(m.energy(q1, v).total)
        turn = (p2 - p0) @ (q2 - 2 * q1 + q0) - (q2 - q0) @ (p2 - 2 * p1 + p0)
        kept.append(H[-1] - turn / (48.0 * dt))
    return np.array(H), np.array(kept)


def drift(energy: np.ndarray, blocks: int = 10) -> tuple[float, float]:
    """Return the linear trend over the whole run and its standard error, from means over blocks."""
    means = energy[: len(energy) // blocks * blocks].reshape(blocks, -1).mean(axis=1)
    x = np.arange(blocks) - (blocks - 1) / 2
    slope = (x @ means) / (x @ x)
    residual = means - means.mean() - slope * x
    error = np.sqrt(residual @ residual / (blocks - 2) / (x @ x))
    return float(slope * blocks), float(error * blocks)


def test_trend_is_seen_where_there_is_one() -> None:
    noise = np.random.default_rng(0).standard_normal(20000)
    for slope, seen in ((0.0, False), (0.2, True)):
        trend, error = drift(noise + np.linspace(0.0, slope, 20000))
        assert (abs(trend) > 4.0 * error) == seen


def test_energy_of_ten_links_over_1e5_steps_stays_in_a_band_without_drift() -> None:
    run = swinging(pendulum_chain(LINKS), 100_000, 0.005)
    H, kept = energies(run, every=10)
    swung = np.ptp(run.energy().kinetic)
    assert swung > 100.0
    # The motion is chaotic: its rare whips set the width of the band, which rounding alone moves by a factor of
    # thirty. So its width is bounded from afar; what the corrected energy keeps is compared with it.
    assert 1e-5 * swung < np.ptp(H) < 5e-2 * swung
    assert np.ptp(run.energy().total) < 0.1 * swung
    assert np.ptp(kept) < 0.1 * np.ptp(H)
    # Drift is what must not be. Ten means leave eight degrees of freedom: beyond four standard errors is one machine
    # in 250 by chance alone, beyond ten one in a hundred thousand.
    trend, error = drift(kept)
    assert abs(trend) < 1e-7 * swung  # over the whole run: 1e-12 a step
    assert abs(trend) < 10.0 * error or abs(trend) < 1e-8 * swung


@pytest.mark.parametrize("damping", [1e-6, 1e-5])
def test_a_drift_would_be_seen(damping: float) -> None:
    """The least damping, one part in a million a second, is ten times the bound in a fifth of the time."""
    place = world()
    for k in range(LINKS):
        place = place.rx(f"theta{k}").tz(-1.0, mass=1.0, inertia=(0.1, 0.2, 0.3))
    m = Mechanism(place, [Gravity((0.0, 0.0, -9.8)), Damping(damping)])
    trend, error = drift(energies(swinging(m, 20_000, 0.005), every=10)[1])
    assert trend < -damping * 100.0
    if damping > 1e-6:  # ten times as much is beyond what chance may do, too
        assert trend < -10.0 * error


def test_energy_band_narrows_with_the_square_of_the_time_step() -> None:
    m = floating_chain(elements=[Gravity((0.0, 0.0, -2.0))])
    q, v = in_motion(m, 4)

    def width(steps: int) -> float:
        return float(np.ptp(swing(m, q, v, times(1.0, steps)).energy().total))

    assert measured_order(width, (200, 400, 800)) == pytest.approx(2.0, abs=0.1)
