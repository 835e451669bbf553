"""Strings and rods: they hold, they may be doubled, and where they cannot hold that is said."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import InconsistentStartError, LeastActionError, StepError
from leastaction.mechanics import (
    Distance,
    Gravity,
    Mechanism,
    MidpointVI,
    SimulationStatus,
    project_configuration,
    tx,
    ty,
    tz,
)
from leastaction.models.marionette import marionette, rest_pose
from physics.laws import G, mass_on_string, swing, times

HELD = 1e-11


def walk_on_strings(steps: int) -> tuple[Mechanism, float]:
    """Return the marionette, and its largest violation of a string in a motion of so many steps of 10 ms."""
    m = marionette()
    q, t = rest_pose(m), 0.01 * np.arange(steps + 1)
    rng = np.random.default_rng(6)
    phase, size = rng.uniform(0, 2 * np.pi, m.nrho), rng.uniform(0.02, 0.05, m.nrho)
    ramp = np.minimum(1.0, t / 2.0)[:, None] ** 2
    rho = q[m.nd :] + ramp * size * np.sin(2 * np.pi * 0.5 * t[:, None] + phase)
    run = swing(m, q, np.zeros(m.nq), t, rho=rho)
    assert np.ptp(run.q[:, : m.nd], axis=0).min() > 1e-3  # everything moves
    return m, float(np.abs(m.constraint_values(run.q)).max())


def test_strings_of_the_marionette_hold_over_1e5_steps() -> None:
    _, worst = walk_on_strings(100_000)
    assert worst < HELD


def test_doubled_string_gives_the_same_motion_and_shares_the_pull() -> None:
    q, v, t = [0.6, -0.8], [0.8, 0.6], times(2.0, 400)
    single = swing(mass_on_string(length=1.0), q, v, t)
    double = swing(mass_on_string(length=1.0, copies=2), q, v, t)
    assert double.rank_deficient
    assert not single.rank_deficient
    assert np.abs(double.q - single.q).max() < 1e-9
    # The least multiplier is the one that shares equally.
    assert np.abs(double.lam - single.lam / 2).max() < 1e-8 * np.abs(single.lam).max()
    pulls = double.tensions()
    assert pulls["string0"] == pytest.approx(pulls["string1"], rel=1e-7)


def test_doubled_string_has_the_derivatives_of_the_single_one() -> None:
    q, v, t = [0.6, -0.8], [0.8, 0.6], times(0.05, 5)
    results = []
    for copies in (1, 2):
        m = mass_on_string(length=1.0, copies=copies)
        vi, run = MidpointVI(m, threads=1), swing(m, q, v, t)
        d = vi.linearize(run)
        z = np.random.default_rng(1).standard_normal((5, m.nx))
        results.append((d.A, d.lam.sum(axis=1), vi.curvature(run, d, z)))
    for one, two in zip(*results, strict=True):
        assert np.abs(two - one).max() < 1e-8 * np.abs(one).max()


def crossed() -> Mechanism:
    """Return a mass in a plane on two strings, whose lengths may contradict each other."""
    return Mechanism(
        [tx("x"), [tz("z", name="bob", mass=1.0)], tx(-1.0, name="left"), tx(1.0, name="right")],
        [
            Gravity((0, 0, -G)),
            Distance("bob", "left", "left-length", name="left string"),
            Distance("bob", "right", "right-length", name="right string"),
        ],
    )


def test_strings_too_short_to_meet_are_an_error_that_names_them() -> None:
    m = crossed()
    vi = MidpointVI(m)
    q = m.configuration({"z": -1.0, "left-length": np.sqrt(2), "right-length": np.sqrt(2)})
    start = vi.start(q)
    hang = vi.step(start, 0.01)
    assert hang.state.q == pytest.approx(q)
    with pytest.raises(StepError, match="string") as caught:
        vi.step(start, 0.01, rho_next=[0.7, 0.7])
    error = caught.value
    assert {"constraint 'left string'", "constraint 'right string'"} <= set(error.residuals)
    worst = next(iter(error.residuals))
    assert worst.startswith("constraint")
    assert error.state.q is not None
    assert error.t == 0.0
    # Nothing is left half changed: the same integrator still makes the step it made before.
    again = vi.step(error.state, 0.01)
    assert np.array_equal(again.state.x, hang.state.x)
    with pytest.raises(InconsistentStartError, match=r"left string|right string"):
        project_configuration(m, m.configuration({"left-length": 0.7, "right-length": 0.7}))


def test_contradictory_strings_are_an_error_that_names_them() -> None:
    m = Mechanism(
        [tx("x"), [tz("z", name="bob", mass=1.0)], tx(0.0, name="anchor")],
        [Distance("bob", "anchor", "a", name="long"), Distance("bob", "anchor", "b", name="short")],
    )
    vi = MidpointVI(m)
    start = vi.start(m.configuration({"z": -1.0, "a": 1.0, "b": 1.0}))
    with pytest.raises(LeastActionError, match=r"long|short"):
        vi.step(start, 0.01, rho_next=[1.01, 0.99])
    with pytest.raises(InconsistentStartError, match=r"long|short"):
        vi.start(m.configuration({"z": -1.0, "a": 1.01, "b": 0.99}))
    assert vi.step(start, 0.01, rho_next=[1.01, 1.01]).state.q[1] == pytest.approx(-1.01)


def test_motion_that_cannot_be_followed_ends_with_what_was_good() -> None:
    m = crossed()
    vi = MidpointVI(m)
    t = times(1.0, 100)
    length = np.sqrt(2) - 0.8 * t  # the strings no longer meet from 1 m on, at about 0.52 s
    q = m.configuration({"z": -1.0, "left-length": length[0], "right-length": length[0]})
    run = vi.simulate(vi.start(q), t, rho=np.column_stack([length, length]))
    assert run.status is SimulationStatus.STEP_FAILED
    assert 45 <= run.steps <= 52
    assert "string" in run.message
    assert f"{run.t[-1]:.6g}" in run.message
    for array, rows in ((run.t, 1), (run.q, 1), (run.p, 1), (run.lam, 0), (run.inputs, 0)):
        assert len(array) == run.steps + rows
        assert np.all(np.isfinite(array))
    assert np.abs(m.constraint_values(run.q)).max() < HELD
    assert run["z"][0] == -1.0
    assert run["z"][-1] > -0.3


def test_planes_apart_share_no_constraint() -> None:
    """Two masses on strings of their own move as each would alone."""
    m = Mechanism(
        [
            *[tx("x1"), [tz("z1", name="bob1", mass=1.0)]],
            *[ty(3.0), [tx("x2"), [tz("z2", name="bob2", mass=5.0)]]],
            *[tx(0.0, name="a1"), ty(3.0, name="a2")],
        ],
        [Gravity((0, 0, -G)), Distance("bob1", "a1", 1.0), Distance("bob2", "a2", 1.0)],
    )
    t = times(1.0, 200)
    run = swing(m, [0.6, -0.8, 0.6, -0.8], np.zeros(4), t)
    alone = swing(mass_on_string(length=1.0), [0.6, -0.8], np.zeros(2), t)
    assert np.abs(run["x1"] - alone["x"]).max() < 1e-11
    assert np.abs(run["x2"] - alone["x"]).max() < 1e-11
