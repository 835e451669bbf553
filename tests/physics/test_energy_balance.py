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
from leastaction.mechanics.continuous.monitoring import EnergyBalance

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


def test_a_lift_that_loses_energy_at_its_upright_configuration_says_so() -> None:
    """Its links pass upright, where the constraints lose rank; some ways of doing so lose energy."""
    m, q, n = lift(5)
    lossy = 0
    for speed, rtol in ((7.0, 1e-8), (7.0, 1e-10), (-7.0, 1e-8), (0.5, 1e-8), (4.0, 1e-6)):
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
            assert "lose rank" in run.warnings[0]
            assert "does not balance" in str(run)
        elif abs(lost) < 1e-4 * run.balance.scale and not told:
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
