"""Rotations that are prescribed as quaternions: what takes them, and what is told of mistakes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import leastaction
from leastaction.costs import QuadraticCost
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics import (
    Gravity,
    Mechanism,
    MidpointVI,
    PrescribedMotion,
    Trajectory,
    ball,
    free,
    rx,
    ry,
    simulate,
    tz,
)
from leastaction.numerics.arrays import Array
from leastaction.optimal import Status


def bar() -> Mechanism:
    """A body that hangs on a bar, which a hand turns, beside a slide that is prescribed too."""
    held = ball("hand", axes="quaternion", kinematic=True, mass=0.2, inertia=(1e-3, 1e-3, 2e-3))
    body = ry("swing", name="body", mass=0.5, com=(0.0, 0.0, -0.2), inertia=(2e-3, 2e-3, 1e-3))
    return Mechanism([tz("lift", kinematic=True), [held, [rx("lean"), [body]]]], [Gravity()])


def curve(t: float) -> Array:
    return np.array([0.1 * t, np.cos(t), 0.6 * np.sin(t), 0.0, 0.8 * np.sin(t)])


def turned(m: Mechanism, steps: int = 50) -> Trajectory:
    vi = MidpointVI(m)
    return vi.simulate(vi.start(np.r_[0.2, -0.1, curve(0.0)]), np.linspace(0.0, 0.5, steps + 1), rho=curve)


def test_names_and_sizes() -> None:
    m = bar()
    assert m.kinematic == ("lift", "hand.wx", "hand.wy", "hand.wz")
    assert m.coordinates == ("lean", "swing", "lift", "hand.qw", "hand.qx", "hand.qy", "hand.qz")
    assert (m.nq, m.nv, m.nd, m.nrho, m.first_rho, m.nx, m.ndx) == (7, 6, 2, 4, 2, 13, 12)
    run = turned(m)
    assert run.rho.shape == (51, 5)
    assert run.u.shape == (50, 4)
    assert np.abs(run.rho - np.array([curve(t) for t in run.t])).max() < 1e-14
    # Twice the angle of the quaternion, about its axis.
    assert np.abs(run.u[:, 1:] - 0.01 * np.array([1.2, 0.0, 1.6])).max() < 1e-14
    assert np.abs(run.v_rho[1:] - [0.1, 1.2, 0.0, 1.6]).max() < 1e-12


def test_steps_rows_and_functions_are_the_same_motion() -> None:
    m = bar()
    vi, run = MidpointVI(m), turned(m)
    rows = np.array([curve(t) for t in run.t])
    again = vi.simulate(run.state(0), run.t, rho=rows)
    assert np.array_equal(again.q, run.q)
    state = run.state(0)
    for k in range(5):
        state = vi.step(state, run.t[k + 1] - run.t[k], rho_next=rows[k + 1]).state
    assert np.abs(state.x - run.state(5).x).max() < 1e-12
    still = vi.step(run.state(5), 0.01).state
    assert np.array_equal(still.q[m.first_rho :], run.rho[5])
    assert np.array_equal(vi.simulate(run.state(5), [run.t[5], run.t[5] + 0.01]).rho[1], run.rho[5])
    finer = vi.simulate(run.state(0), run.t[::10], rho=curve, energy_tolerance=1e-5)
    assert len(finer.t) > len(run.t[::10])
    assert np.abs(finer.rho - np.array([curve(t) for t in finer.t])).max() < 1e-14
    coarse = vi.simulate(run.state(0), run.t[::10], rho=rows[::10], energy_tolerance=1e-5)
    # Between rows it turns evenly, as this curve does.
    assert np.abs(coarse.rho - np.array([curve(t) for t in coarse.t])).max() < 1e-12


def test_files_and_pictures_take_it(tmp_path: Path) -> None:
    m = bar()
    m.save(tmp_path / "bar.yaml")
    assert Mechanism.load(tmp_path / "bar.yaml") == m
    run = turned(m)
    run.save(tmp_path / "run.npz")
    back = leastaction.open(tmp_path / "run.npz")
    assert np.array_equal((back.trajectory if hasattr(back, "trajectory") else back).q, run.q)
    leastaction.show(run).save(tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 1000
    assert "hand" in str(m)


def test_the_hand_is_an_input_of_an_optimisation() -> None:
    """The turns of the hand are found that bring it to where it is wanted, with the body in its place."""
    m = bar()
    t = np.linspace(0.0, 0.6, 31)
    system = leastaction.MidpointSystem(MidpointVI(m), t)
    x0 = MidpointVI(m).start(np.r_[0.0, 0.0, curve(0.0)]).x
    wanted = MidpointVI(m).start(np.r_[0.3, -0.4, 0.2, np.cos(0.5), np.sin(0.5), 0.0, 0.0]).x
    Q, Q_final = 1e-2 * np.eye(m.ndx), np.diag(np.r_[np.full(m.nv, 3e3), np.full(m.nv, 2.0)])
    cost = QuadraticCost(
        Q=Q,
        R=np.eye(m.nrho),
        Q_final=Q_final,
        x_wanted=np.tile(wanted, (31, 1)),
        u_wanted=np.zeros((30, m.nrho)),
        space=system,
    )
    result = leastaction.optimize(system, cost, initial=(x0, np.zeros((30, m.nrho))))
    assert result.status is Status.CONVERGED, result.message
    reached = m.frame_pose(result.x[-1, : m.nq], "hand")[:3, :3]
    meant = m.frame_pose(wanted[: m.nq], "hand")[:3, :3]
    assert np.abs(reached - meant).max() < 0.1


def test_what_is_prescribed_in_continuous_time_goes_by_name() -> None:
    m, t = bar(), np.linspace(0.0, 0.5, 51)
    rows = np.array([curve(time) for time in t])
    q0, v0 = np.r_[0.2, -0.1, curve(0.0)], None
    whole = simulate(m, q0, v0, t, rho=rows)
    turns = rows[:, 1:] * np.where(np.arange(51) % 3 == 1, -1.0, 1.0)[:, None]  # of either sign
    spline = PrescribedMotion.through(t, rows[:, :1])
    for lift in (rows[:, 0], spline, make_interp_spline(t, rows[:, 0], k=5)):
        by_name = simulate(m, q0, v0, t, rho={"hand": turns, "lift": lift})
        np.testing.assert_allclose(by_name.x, whole.x, atol=1e-9)
    # What is left out stays where it begins, and so does what has a number.
    for held in ({}, {"lift": 0.0}):
        still = simulate(m, q0, v0, t, rho={"hand": turns, **held})
        np.testing.assert_array_equal(still["lift"], 0.0)
        np.testing.assert_allclose(still.q[:, 3:7], whole.q[:, 3:7], atol=1e-12)
    for wrong, message in (
        ({"hnd": turns}, "rho: unknown name 'hnd'; did you mean 'hand'"),
        ({"hand": turns, "lift": lambda t: 0.1 * t}, r"rho\['lift'\]: got the function .* says nothing of its"),
        ({"lift": rows}, r"rho\['lift'\]: got shape \(51, 5\)"),
        ({"lift": 0.3}, "the start has 'lift' at 0, but the prescribed motion has it at 0.3"),
    ):
        with pytest.raises(ArgumentError, match=message):
            simulate(m, q0, v0, t, rho=wrong)


def test_rows_may_begin_with_the_other_sign() -> None:
    run = turned(bar())
    rows = run.rho.copy()
    rows[::3, 1:] *= -1.0
    begin = np.r_[0.2, -0.1, curve(0.0)]
    vi = MidpointVI(bar())
    assert np.abs(vi.simulate(vi.start(begin), run.t, rho=rows).q[:, :2] - run.q[:, :2]).max() < 1e-14


REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "length": (
        lambda: MidpointVI(bar()).simulate(start(), [0.0, 0.1], rho=[[0.0, 1.1, 0.0, 0.0, 0.0]]),
        r"hand\.qw.*1\.1",
    ),
    "step": (
        lambda: MidpointVI(bar()).step(start(), 0.1, rho_next=[0.0, 1.0, 0.5, 0.0, 0.0]),
        r"rho_next.*unit quaternion",
    ),
    "columns": (lambda: MidpointVI(bar()).simulate(start(), [0.0, 0.1], rho=[[0.0, 0.1, 0.0, 0.0]]), r"rho.*\(1, 5\)"),
    "other start": (
        lambda: MidpointVI(bar()).simulate(start(), [0.0, 0.1], rho=[[0.0, 0.6, 0.8, 0.0, 0.0]] * 2),
        r"first row has 'hand\.qx'",
    ),
    "continuous": (lambda: swung([[0.0, 1.1, 0.0, 0.0, 0.0]] * 2), r"rho.*hand\.qw.*1\.1"),
    "across": (
        lambda: swung(PrescribedMotion.through([-0.1, 0.1], [-curve(0.0), curve(0.0)])),
        "'hand' has the length 0.*stay with one",
    ),
    "start": (lambda: swung([np.r_[0.0, 0.6, 0.8, 0.0, 0.0]] * 2), r"q0.*'hand\.qx' at 0.*has it at 0\.8"),
}


def swung(rho: Any) -> Any:
    return simulate(bar(), np.r_[0.2, -0.1, curve(0.0)], None, [0.0, 0.1], rho=rho)


def start() -> Any:
    return MidpointVI(bar()).start(np.r_[0.0, 0.0, curve(0.0)])


@pytest.mark.parametrize("what", list(REFUSED))
def test_mistakes_are_named(what: str) -> None:
    call, match = REFUSED[what]
    with pytest.raises(ArgumentError, match=match):
        call()


def test_all_turns_or_none() -> None:
    with pytest.raises(DescriptionError, match=r"all of a\.wx, a\.wy, a\.wz or none"):
        free("a", axes="quaternion", kinematic=["a.x", "a.wx"])
    m = Mechanism([free("a", axes="quaternion", kinematic=["a.wx", "a.wy", "a.wz"], mass=1.0)], [Gravity()])
    assert m.dynamic == ("a.x", "a.y", "a.z")
