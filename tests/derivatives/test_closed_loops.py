"""Loops of bodies that `PointToPoint` closes: in space and in the plane, with their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Damping,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    PointToPoint,
    check_consistent,
    project_configuration,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.errors import DescriptionError
from leastaction.optimal import check_derivatives


def loop(axes: str = "xyz") -> Mechanism:
    """Return two arms of three joints each on a sliding and a fixed base, joined at their hands."""
    arm = [
        [rz("a1"), [rx("a2"), [tz(-1.0, mass=1.0, inertia=(0.1, 0.12, 0.05)), [
            ry("a3"), [tz(-0.8, name="left hand", mass=0.5, inertia=(0.02, 0.025, 0.01))],
        ]]]],
    ]  # fmt: skip
    return Mechanism(
        [
            tx("base", kinematic=True), *arm,
            ty(1.0), [rx("b1"), [tz(-1.1, mass=1.2, inertia=(0.1, 0.1, 0.1)), [
                ry("b2"), [rz("b3"), [tx(0.3, mass=0.2, inertia=(0.01, 0.01, 0.01)), [
                    tz(-0.7, name="right hand", mass=0.4, inertia=(0.02, 0.02, 0.02)),
                ]]],
            ]]],
        ],
        [
            Gravity(),
            Damping(0.05),
            JointForce("b1", "torque"),
            PointToPoint("left hand", "right hand", axes, name="grip"),
        ],
    )  # fmt: skip


@pytest.mark.parametrize(("axes", "freedom"), [("x", 5), ("zy", 4), ("xyz", 3)])
def test_equations_and_freedom(axes: str, freedom: int) -> None:
    m = loop(axes)
    assert m.constraints == tuple(f"grip.{axis}" for axis in axes)
    q = np.random.default_rng(0).normal(size=m.nq)
    assert m.degrees_of_freedom(q) == freedom
    left, right = m.positions(q, ["left hand", "right hand"])
    wanted = (left - right)[["xyz".index(axis) for axis in axes]]
    np.testing.assert_allclose(m.constraint_values(q), wanted, atol=1e-15)
    step = 1e-6
    slopes = [(m.constraint_values(q + e) - m.constraint_values(q - e)) / (2 * step) for e in step * np.eye(m.nq)]
    np.testing.assert_allclose(m.constraint_jacobian(q), np.transpose(slopes), atol=1e-9)


def test_a_loop_moves_closed_with_exact_derivatives() -> None:
    m = loop()
    q = project_configuration(m, m.configuration({"a2": 0.5, "b1": -0.4, "a3": 0.2, "b2": 0.3})).q
    vi = MidpointVI(m)
    t = 0.01 * np.arange(201)
    run = vi.simulate(vi.start(q), t, inputs=lambda s: [2.0 * np.sin(5 * s)], rho=lambda s: q[m.nd :] + 0.1 * s)
    assert run.steps == 200, run.message
    assert np.ptp(run.q[:, : m.nd], axis=0).max() > 0.1
    assert np.abs(m.constraint_values(run.q)).max() < 1e-13
    check_consistent(m, run.q[-1])
    some = slice(0, 11)
    system = MidpointSystem(vi, t[some], multipliers=True)
    x = np.hstack([run.x[some], np.vstack([np.zeros(m.nc), run.lam[:10]])])
    report = check_derivatives(system, x, run.u[:10], tolerance=1e-5)
    assert report.ok, report.errors


def test_damping_is_all_that_takes_energy_from_a_loop() -> None:
    m = loop()
    q = project_configuration(m, m.configuration({"a2": 0.5, "b1": -0.4})).q
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(q), 0.005 * np.arange(401))
    energy = run.energy()
    swung = np.ptp(energy.kinetic)
    assert swung > 0.1
    taken = np.sum(0.05 * np.sum(run.v[:, : m.nd] ** 2, axis=1)) * 0.005
    assert energy.total[0] - energy.total[-1] == pytest.approx(taken, rel=0.02)


@pytest.mark.parametrize("axes", ["", "w", "xx", "xyzx", 3])
def test_axes_that_are_none(axes: object) -> None:
    with pytest.raises(DescriptionError, match="expected some of 'xyz'"):
        PointToPoint("a", "b", axes)  # type: ignore[arg-type]


def test_a_frame_on_itself_and_what_nothing_moves() -> None:
    with pytest.raises(DescriptionError, match="two different frames"):
        PointToPoint("a", "a")
    with pytest.raises(DescriptionError, match="nothing can bring them together"):
        Mechanism(
            [tx("x", mass=1.0), tx(1.0, name="here"), ty(1.0, name="there")],
            [PointToPoint("here", "there")],
        )
