"""Motions whose closed form is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from leastaction.mechanics import (
    Damping,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    rx,
    rz,
    tx,
    ty,
    tz,
)
from oracles.closed_forms import (
    damped_velocity,
    pendulum_angle,
    pendulum_period,
    steady_precession,
)
from physics.laws import G, mass_on_string, measured_order, pendulum, swing, times

# What a step may leave of a momentum: the tolerance of 1e-13, of two or three terms that are as large. It adds up.
SOLVED = 3e-13

IFTOMM_A01_PERIOD = 2.367841947576237  # 4 K(1/sqrt 2) / sqrt(9.81)


def test_iftomm_a01_pendulum_against_jacobi() -> None:
    """Released horizontally, 10 s: the error falls with dt^2, and what is left of it with dt^4."""
    assert pendulum_period(np.pi / 2) == pytest.approx(IFTOMM_A01_PERIOD, rel=1e-14)
    end = 10.0
    exact = pendulum_angle(times(end, 2000), np.pi / 2)
    runs = [swing(pendulum(), [np.pi / 2], [0.0], times(end, n * 2000))["theta"][::n] for n in (1, 2, 4)]
    errors = [np.abs(run - exact).max() for run in runs]
    assert errors[0] < 5e-4
    assert np.allclose(np.divide(errors[:-1], errors[1:]), 4.0, atol=0.01)
    once = [(4 * fine - coarse) / 3 for coarse, fine in pairwise(runs)]
    assert np.abs((16 * once[1] - once[0]) / 15 - exact).max() < 1e-9


def test_iftomm_a01_energy_error_is_allowed() -> None:
    run = swing(pendulum(), [np.pi / 2], [0.0], times(10.0, 12500))
    energy = run.energy().total
    assert np.abs(energy).max() < 5e-5


def test_iftomm_a01_period() -> None:
    def period(steps: int) -> float:
        t = times(12 * 2.4, steps)
        theta = swing(pendulum(), [np.pi / 2], [0.0], t)["theta"]
        down = np.flatnonzero((theta[:-1] > 0) & (theta[1:] <= 0))
        crossings = []
        for k in (down[0], down[-1]):
            near = slice(k - 3, k + 5)
            inverse = np.polynomial.Polynomial.fit(theta[near], t[near], 7)
            crossings.append(inverse(0.0))
        return (crossings[1] - crossings[0]) / (len(down) - 1)

    coarse, fine = period(14400), period(28800)
    assert coarse == pytest.approx(IFTOMM_A01_PERIOD, rel=1e-5)
    assert abs(coarse - IFTOMM_A01_PERIOD) > 3.9 * abs(fine - IFTOMM_A01_PERIOD)
    assert (4 * fine - coarse) / 3 == pytest.approx(IFTOMM_A01_PERIOD, rel=1e-10)


@pytest.mark.parametrize("amplitude", [0.05, 1.0, 2.5, 3.0])
def test_pendulum_at_any_amplitude(amplitude: float) -> None:
    t = times(pendulum_period(amplitude), 4000)
    theta = swing(pendulum(), [amplitude], [0.0], t)["theta"]
    assert np.abs(theta - pendulum_angle(t, amplitude)).max() < 1e-4 * amplitude
    assert theta[-1] == pytest.approx(amplitude, rel=1e-5)
    assert theta[2000] == pytest.approx(-amplitude, rel=1e-5)


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_projectile_is_exact(split: str) -> None:
    """The midpoint rule has no error on parabolas: potential forces are not split."""
    m = Mechanism([tx("x"), [ty("y"), [tz("z", mass=3.0)]]], [Gravity((0.3, -0.2, -G))])
    q, v = np.array([1.0, -2.0, 0.5]), np.array([4.0, 1.0, 7.0])
    t = times(2.0, 40)
    run = swing(m, q, v, t, split=split)
    exact = q + np.outer(t, v) + 0.5 * np.outer(t**2, [0.3, -0.2, -G])
    allowed = run.steps * SOLVED
    assert np.abs(run.q - exact).max() < allowed * np.abs(exact).max()
    assert np.abs(run.p - 3.0 * (v + np.outer(t, [0.3, -0.2, -G]))).max() < allowed * np.abs(run.p).max()
    # At uneven time steps too.
    uneven = np.cumsum([0.0, 0.1, 0.01, 0.3, 0.002, 0.05])
    run = swing(m, q, v, uneven, split=split)
    exact = q + np.outer(uneven, v) + 0.5 * np.outer(uneven**2, [0.3, -0.2, -G])
    assert np.abs(run.q - exact).max() < run.steps * SOLVED * np.abs(exact).max()


def test_constant_force_is_exact_in_the_symmetric_split_only() -> None:
    m = Mechanism([tx("x", mass=2.0)], [JointForce("x", input="push")])
    t = times(3.0, 30)
    ends = {split: swing(m, [0.0], [1.0], t, inputs=[4.0], split=split)["x"][-1] for split in ("symmetric", "left")}
    assert ends["symmetric"] == pytest.approx(3.0 + 0.5 * 2.0 * 9.0, rel=30 * SOLVED)
    # Left: the momentum at each start jumps by all of dt f, so the mass is dt f / (2 m) faster.
    assert ends["left"] == pytest.approx(3.0 + 9.0 + 3.0 * 0.1 * 4.0 / (2 * 2.0), rel=30 * SOLVED)


def test_damped_mass() -> None:
    mass, damping, force = 2.0, 0.8, 3.0
    m = Mechanism([tx("x", mass=mass)], [JointForce("x", input="push"), Damping(damping)])

    def momentum(steps: int) -> np.ndarray:
        return swing(m, [0.0], [5.0], times(4.0, steps), inputs=[force]).p[:, 0]

    def error(steps: int) -> float:
        exact = mass * damped_velocity(times(4.0, steps), 5.0, mass, damping, force)
        return float(np.abs(momentum(steps) - exact).max())

    assert measured_order(error, (20, 40, 80)) == pytest.approx(2.0, abs=0.02)
    # The discrete motion has a closed form of its own, which holds to rounding.
    h = 4.0 / 20
    factor = (1 - damping * h / (2 * mass)) / (1 + damping * h / (2 * mass))
    final = mass * force / damping
    wanted = final + (mass * 5.0 - final) * factor ** np.arange(21)
    assert np.abs(momentum(20) - wanted).max() < 1e-12


def test_mass_on_a_string_circles_evenly() -> None:
    length, rate, mass = 1.5, 2.0, 2.0
    m = mass_on_string(length=length, gravity=0.0)
    run = swing(m, [length, 0.0], [0.0, rate * length], times(3.0, 3000))
    radius = np.hypot(run["x"], run["z"])
    assert np.abs(radius - length).max() < 1e-12
    angle = np.unwrap(np.arctan2(run["z"], run["x"]))
    assert np.ptp(np.diff(angle)) < 1e-12  # to the last digit the same angle each step
    assert angle[-1] == pytest.approx(rate * 3.0, rel=1e-6)
    # The string pulls with m v^2 / L, from the second step on: at the start the impulse is half a step's.
    pull = run.tensions()["string0"]
    assert pull[1:] == pytest.approx(mass * rate**2 * length, rel=1e-5)


def test_weight_on_a_string_that_is_lifted() -> None:
    """The tension is m (g + a), whatever the speed."""
    acceleration, mass = 0.7, 2.0
    m = mass_on_string()
    t = times(1.0, 100)
    length = 2.0 - 0.5 * acceleration * t**2
    start = m.configuration({"z": -2.0, "length": 2.0})
    run = swing(m, start, np.zeros(3), t, rho=length[:, None])
    # h = z^2 - length^2 is met to 1e-13 of its terms, and has the slope 2 z: an error of 1e-13 of the length.
    assert np.abs(run["z"] + length).max() < 1e-12
    assert np.abs(run["x"]).max() == 0.0
    assert run.tensions()["string0"][1:] == pytest.approx(mass * (G + acceleration), rel=1e-3)
    still = swing(m, start, np.zeros(3), t)
    assert still.tensions()["string0"][1:] == pytest.approx(mass * G, rel=1e-10)


def test_steady_precession_of_a_heavy_top_is_exact() -> None:
    """A symmetric top keeps its tilt and precesses at the rate of Euler's equations, at any time step.

    Steady precession goes along affine symmetries of the variables, so the midpoint rule has no error on it.
    """
    about, across, mass, arm, tilt, spin = 0.02, 0.03, 1.5, 0.2, 0.6, 80.0
    body = rz("spin", mass=mass, com=(0.0, 0.0, arm), inertia=(across, across, about))
    m = Mechanism([rz("turn"), [rx("tilt"), [body]]], [Gravity((0.0, 0.0, -G))])
    rate = steady_precession(tilt, spin, about, across + mass * arm**2, mass * G * arm)
    assert 1.0 < rate < 3.0
    relative = spin - rate * np.cos(tilt)
    for steps in (50, 500):
        run = swing(m, [0.0, tilt, 0.0], [rate, 0.0, relative], times(1.0, steps))
        assert np.abs(run["tilt"] - tilt).max() < 1e-9
        assert np.abs(run["turn"] - rate * run.t).max() < 1e-9
        assert np.abs(run["spin"] - relative * run.t).max() < 1e-8
    # Another rate nutates.
    run = swing(m, [0.0, tilt, 0.0], [1.1 * rate, 0.0, relative], times(1.0, 500))
    assert np.ptp(run["tilt"]) > 1e-3


def test_rest_is_kept() -> None:
    m = pendulum()
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.0]), times(10.0, 1000))
    assert not run.q.any()
    assert not run.p.any()
