"""A simulation in continuous time that lost energy says so, and where."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from leastaction.errors import EnergyBalanceWarning
from leastaction.mechanics import (
    Body,
    Damping,
    Gravity,
    JointForce,
    Mechanism,
    PointToPoint,
    ry,
    simulate,
    tx,
    tz,
)
from leastaction.mechanics.continuous.monitoring import EnergyBalance, Passages
from leastaction.mechanics.continuous.trajectory import IntegrationStatus

G = 9.81


def lift(segments: int) -> tuple[Mechanism, np.ndarray, np.ndarray]:
    """Return a hanging scissor lift, a configuration and its one direction to move in."""
    link = {"mass": 1.0, "com": (0, 0, -0.5), "inertia": (1 / 12, 1 / 12, 0.0)}

    def chain(k: int, side: str) -> list[object]:
        inner = [] if k == segments else [tz(-1.0), chain(k + 1, side)]
        return [
            ry(f"{side}{k}", **link),
            [tz(-0.5, name=f"{side}m{k}"), tz(-1.0, name=f"{side}e{k}"), *inner],
        ]

    tree = [*chain(1, "L"), tx("x", mass=0.5), chain(1, "R")]
    pins = [PointToPoint(f"Lm{k}", f"Rm{k}", "xz", name=f"pin{k}") for k in range(1, segments + 1)]
    m = Mechanism(tree, [Gravity((0, 0, -G)), *pins])
    a = 0.6
    values = {"x": 2.0 * 0.5 * np.sin(a) * 1.0}
    for k in range(1, segments + 1):
        values[f"L{k}"] = -a if k == 1 else (2 * a if k % 2 == 0 else -2 * a)
        values[f"R{k}"] = a if k == 1 else (-2 * a if k % 2 == 0 else 2 * a)
    q = m.configuration(values)
    n = np.linalg.svd(m.constraint_jacobian(q))[2][-1]
    return m, q, n * np.sign(n[0])


def test_a_lift_passes_its_upright_configuration_and_keeps_its_energy() -> None:
    """Its links pass upright, where the constraints lose rank; the motion goes smoothly on."""
    for segments, speed, rtol in (
        (5, 7.0, 1e-8),
        (5, 7.0, 1e-10),
        (8, 0.5, 1e-8),
        (3, 0.5, 1e-10),
    ):
        m, q, n = lift(segments)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            run = simulate(m, q, speed * n, np.linspace(0.0, 3.0, 31), rtol=rtol)
        case = f"{segments} segments, {speed} rad/s, rtol {rtol}"
        assert run.status is IntegrationStatus.COMPLETED, case
        energy = run.energy().total
        assert run.balance is not None
        assert np.abs(energy - energy[0]).max() < 1e-5 * run.balance.scale, case
        assert len(run.balance.crossings) >= 2, case
        assert "constraints lost rank in the step to t = " in run.message
        # It has one freedom: every link moves with the first.
        assert np.abs(run["L2"] + 2.0 * run["L1"]).max() < 1e-6, case
        assert np.abs(run["R3"] + 2.0 * run["L1"]).max() < 1e-6, case
        assert np.abs(run["x"] + np.sin(run["L1"])).max() < 1e-6, case


def test_an_even_number_of_constraints_that_turn_over_is_seen() -> None:
    """The sign of a determinant does not show them."""
    m, q, n = lift(2)
    run = simulate(m, q, 4.0 * n, np.linspace(0.0, 2.0, 21))
    assert run.balance is not None
    upright = np.count_nonzero(np.diff(np.sign(run["L1"])))
    assert upright >= 2
    assert len(run.balance.crossings) == upright


def test_a_run_that_lost_energy_says_so_in_its_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it does without what leads over a loss of rank."""
    monkeypatch.setattr(Passages, "is_near", lambda self, t, x: False)
    m, q, n = lift(5)
    lossy = 0
    for speed, rtol in ((7.0, 1e-8), (-7.0, 1e-8)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            run = simulate(m, q, speed * n, np.linspace(0.0, 3.0, 31), rtol=rtol)
        energy = run.energy()
        lost = float(energy.total[0] - energy.total[-1])
        assert run.balance is not None
        assert run.balance.lost == pytest.approx(lost, abs=1e-3 * run.balance.scale)
        told = [w for w in caught if w.category is EnergyBalanceWarning]
        if abs(lost) > 2e-3 * run.balance.scale:
            lossy += 1
            assert told
            assert run.status is IntegrationStatus.UNBALANCED
            assert "does not balance" in run.message
            assert "lose rank" in run.warnings[0]
            assert "does not balance" in str(run)
        elif abs(lost) < 1e-4 * run.balance.scale and not told:
            assert run.status is IntegrationStatus.COMPLETED
            assert not run.warnings
    print(f"{lossy} runs lost energy")


def test_work_of_inputs_damping_and_prescribed_motion_is_no_loss() -> None:
    tree = [
        tx("cart", mass=2.0, kinematic=True),
        [ry("arm", bodies=[Body(1.0, com=(0, 0, -0.7), inertia=(0.05, 0.05, 0.01))])],
    ]
    m = Mechanism(tree, [Gravity((0, 0, -G)), JointForce("arm", input="torque"), Damping({"arm": 0.3})])
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 4.0, 41)
    run = simulate(
        m, [0.4, 0.0], None, t,
        inputs=3.0 * rng.normal(size=(40, 1)),
        rho=0.3 * (1.0 - np.cos(2.0 * t))[:, None],
    )  # fmt: skip
    balance = run.balance
    assert balance is not None
    assert abs(run.energy().total[-1] - run.energy().total[0]) > 0.1
    assert abs(balance.lost) < 1e-5 * balance.scale
    assert not run.warnings
    assert not balance.crossings
    assert simulate(m, [0.4, 0.0], None, t, dense_output=False).balance is None


def test_a_loss_is_told_with_its_instant() -> None:
    found = EnergyBalance(lost=6.0, scale=100.0, worst=5.0, t=1.5, crossings=(0.2, 1.5))
    assert "5 J of them in the step to t = 1.5 s" in str(found.complaint(1e-8))
    assert "lose rank (t = 1.5 s)" in str(found.complaint(1e-8))
    assert found.complaint(1e-4) is None
    assert "lost rank in the step to t = 0.2 s" in str(found)
    assert EnergyBalance(1e-5, 100.0, 1e-5, 0.1).complaint(1e-8) is None
