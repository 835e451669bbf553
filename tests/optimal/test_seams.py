"""Where a motion that returns goes on from its last step to its first: limits on rates of inputs, on accelerations."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Bound,
    Damping,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    rx,
    tx,
    tz,
)
from leastaction.limits import FinalTime, Parameter, Periodic

N, LASTS = 24, 2.0
SLIDE = Mechanism([tx("x", mass=1.0)], [Damping(0.3), JointForce("x", input="push")])


def wanted(t):
    """Return a square wave, which no push follows."""
    return np.sign(np.sin(2.0 * np.pi * np.asarray(t) / LASTS + 0.3))


def solved(limits, shift, dt=None, **more):
    """Return the motion of the slide that begins `shift` steps later in the round."""
    dt = np.roll(np.full(N, LASTS / N) if dt is None else dt, -shift)
    late = 0.0 if shift == 0 else float(np.sum(np.roll(dt, shift)[:shift]))
    t = np.concatenate([[0.0], np.cumsum(dt)])
    system = MidpointSystem(MidpointVI(SLIDE, threads=1), t)
    # What is wanted of the last instant is of no weight: it is the first one again.
    states = np.stack([wanted(t + late), 0.0 * t], axis=1)
    cost = QuadraticCost(states, np.zeros(1), Q=[10.0, 0.0], R=[1e-3], Q_final=[0.0, 0.0])
    start = np.zeros(2), np.zeros((N, 1))
    return optimize(system, cost, initial=start, limits=[Periodic("*"), *limits], free_start=True, **more)


def rates(result):
    """Return rates of the input into every step, the first from the last."""
    dt, u = np.diff(result.t), result.u[:, 0]
    return (u - np.roll(u, 1)) / (0.5 * (dt + np.roll(dt, 1)))


def accelerations(result):
    dt = np.diff(result.t)
    v = np.diff(result.x[:, 0]) / dt
    return (v - np.roll(v, 1)) / (0.5 * (dt + np.roll(dt, 1)))


LIMITS = {
    "rates": ([Bound("push", -20.0, 20.0, of="input rate")], rates, 20.0),
    "accelerations": ([Bound("x", -8.0, 8.0, of="acceleration")], accelerations, 8.0),
}


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("which", LIMITS)
def test_it_is_all_one_where_a_round_begins(which, even):
    limits, quantity, most = LIMITS[which]
    dt = None if even else LASTS / N * (1.0 + 0.4 * np.sin(np.arange(N)))
    dt = dt if dt is None else dt * LASTS / dt.sum()
    found = [solved(limits, shift, dt) for shift in (0, 1, 9)]
    for shift, result in zip((0, 1, 9), found, strict=True):
        assert result.success, result.message
        assert np.abs(quantity(result)).max() == pytest.approx(most, rel=1e-6)
        assert result.cost == pytest.approx(found[0].cost, rel=1e-7)
        np.testing.assert_allclose(np.roll(result.u, shift, axis=0), found[0].u, atol=2e-4 * most)
    # Without the limit the seam would be steeper than that.
    assert np.abs(quantity(solved([], 0))[0]) > 1.02 * most


def test_a_wheel_that_turns_on_has_its_accelerations_limited_at_the_seam_too():
    """The round of a pendulum that goes over the top, once a second: angles differ by a turn."""
    wheel = Mechanism([rx("a"), [tz(-0.5, mass=1.0)]], [Gravity(), JointForce("a", input="push")])
    t = np.linspace(0.0, 1.0, 31)

    def found(shift, limits):
        system = MidpointSystem(MidpointVI(wheel, threads=1), t)
        a = 2.0 * np.pi * (t + shift / 30.0)
        states = np.stack([a, np.full(31, 0.25 * 2.0 * np.pi)], axis=1)
        cost = QuadraticCost(states, np.zeros(1), Q=[1.0, 0.0], R=[1e-2], Q_final=[0.0, 0.0])
        start = states, np.zeros((30, 1))
        back = Periodic("*", modulo={"a": 2.0 * np.pi})
        return optimize(system, cost, initial=start, limits=[back, *limits], free_start=True)

    free = found(0, [])
    assert free.success, free.message
    most = 0.8 * np.abs(np.diff(free.x[:, 0], 2)).max() * 900.0
    first, other = (found(shift, [Bound("a", -most, most, of="acceleration")]) for shift in (0, 7))
    for result in (first, other):
        assert result.success, result.message
        assert result.x[-1, 0] - result.x[0, 0] == pytest.approx(2.0 * np.pi, abs=1e-8)
        v = np.diff(result.x[:, 0]) * 30.0
        assert np.abs(v - np.roll(v, 1)).max() * 30.0 == pytest.approx(most, rel=1e-5)
    assert first.cost == pytest.approx(other.cost, rel=1e-6)


def test_the_seam_is_limited_beside_unknowns():
    limits = LIMITS["rates"][0]
    unknowns = [FinalTime(1.0, 4.0, price=3.0), Parameter("damping.x", 0.0, 1.0, weight=5.0)]
    found = [solved(limits, shift, unknowns=unknowns) for shift in (0, 9)]
    for result in found:
        assert result.success, result.message
        assert np.abs(rates(result)).max() == pytest.approx(20.0, rel=1e-6)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-7)
    assert found[0].unknowns["final time"] == pytest.approx(found[1].unknowns["final time"], rel=1e-5)


def test_what_does_not_return_has_no_step_before_its_first():
    result = solved([], 0)
    system = MidpointSystem(MidpointVI(SLIDE, threads=1), result.t)
    cost = QuadraticCost(np.stack([wanted(result.t), 0.0 * result.t], axis=1), np.zeros(1), Q=[10.0, 0.0], R=[1e-3])
    limits = [Periodic("p_x"), Bound("x", -8.0, 8.0, of="acceleration"), Bound("push", -60.0, 60.0, of="input rate")]
    start = np.zeros(2), np.zeros((N, 1))
    some = optimize(system, cost, initial=start, limits=limits, free_start=True)
    assert some.success, some.message
    assert np.abs(accelerations(some)[1:]).max() < 8.0 + 1e-6
    assert np.abs(rates(some)).max() < 60.0 + 1e-5
