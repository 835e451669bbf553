"""Steps, starts and velocities that go through one call into the core: the same as by its parts, and its errors."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Body,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PointToPoint,
    ball,
    project_configuration,
    project_velocity,
    rx,
    ry,
    to_momentum,
    to_velocity,
    tx,
    tz,
)
from leastaction.errors import ArgumentError, InconsistentStartError, StepError

BODY = {"mass": 1.0, "com": (0.1, 0.0, -0.5), "inertia": (0.1, 0.2, 0.15)}


def four_bar() -> Mechanism:
    """A loop on a slide that is prescribed, driven at its crank."""
    far = tx(0.9, name="far")
    chain = ry("a", **BODY), [tz(-0.5), [ry("b", **BODY), [tz(-1.0, name="P")]]]
    rocker = [ry("c", **BODY), [tz(-0.6, name="Q")]]
    tree = [tx("slide", kinematic=True), [*chain, far, rocker]]
    return Mechanism(tree, [Gravity(), JointForce("a", input="drive"), PointToPoint("P", "Q", "xz", name="loop")])


@pytest.fixture(scope="module")
def made() -> tuple[Mechanism, MidpointVI, np.ndarray, np.ndarray]:
    m = four_bar()
    q = project_configuration(m, m.configuration({"a": 0.4, "b": -0.9, "c": 0.6, "slide": 0.1}), attempts=20).q
    v = project_velocity(m, q, np.array([1.0, 0.3, -0.2, 0.5])).v
    return m, MidpointVI(m), q, v


def test_a_step_is_the_first_of_a_roll_out(made) -> None:
    _, vi, q, v = made
    state, dt, u, rho = vi.start(q, v, t=0.3), 0.01, np.array([0.7]), np.array([0.11])
    step = vi.step(state, dt, inputs=u, rho_next=rho)
    out = vi.core.roll_out(np.array([0.3, 0.31]), state.x, None, np.concatenate((u, rho))[None], None)
    assert (step.state.x == out.x[1]).all()
    assert (step.lam == out.lam[0]).all()
    told = (step.state.t, step.iterations, step.quality.s, step.quality.angle)
    assert told == (0.3 + dt, out.iterations, out.worst.s, out.worst.angle)
    assert not step.state.q.flags.writeable
    # A list is as good as an array; what is left out is zero, and where it was.
    same = vi.step(state, dt, inputs=[0.7], rho_next=[0.11])
    assert (same.state.x == step.state.x).all()
    still = vi.core.roll_out(np.array([0.3, 0.31]), state.x, None, np.array([[0.0, q[-1]]]), None)
    assert (vi.step(state, dt).state.x == still.x[1]).all()


def test_a_start_has_the_momentum_of_the_mass_matrix(made) -> None:
    m, vi, q, v = made
    start = vi.start(q, v)
    assert start.p == pytest.approx((m.mass_matrix(q) @ v)[: m.nd], abs=1e-13)
    assert (np.concatenate((start.q, start.v_rho)) == np.concatenate((q, v[m.nd :]))).all()
    assert vi.start(q).p == pytest.approx(np.zeros(m.nd))
    assert to_velocity(m, q, start.p, start.v_rho) == pytest.approx(v, abs=1e-13)
    assert to_velocity(m, np.array([q, q]), np.array([start.p, 2 * start.p]))[1, : m.nd] == pytest.approx(
        np.linalg.solve(m.mass_matrix(q)[: m.nd, : m.nd], 2 * start.p), abs=1e-12
    )
    assert to_momentum(m, q, v) == pytest.approx(start.p, abs=1e-14)


def test_velocities_of_quaternions() -> None:
    m = Mechanism([ball("top", axes="quaternion", **BODY)], [Gravity()])
    q, v = np.array([0.5, 0.5, -0.5, 0.5]), np.array([0.3, -2.0, 1.0])
    assert to_velocity(m, q, to_momentum(m, q, v)) == pytest.approx(v, abs=1e-13)


def test_what_does_not_fit_is_named(made) -> None:
    _, vi, q, v = made
    with pytest.raises(InconsistentStartError, match="loop"):
        vi.start(q + np.array([0.0, 1e-6, 0.0, 0.0]))
    with pytest.raises(InconsistentStartError, match="project_velocity"):
        vi.start(q, v + np.array([0.0, 1e-3, 0.0, 0.0]))
    with pytest.raises(ArgumentError, match=r"momentum: got .* for 'x'"):
        MidpointVI(Mechanism([tx("x", mass=10.0)], [])).start([0.0], [1e308])
    with pytest.raises(ArgumentError, match="mass matrix is singular"):
        to_velocity(
            Mechanism([ball("top", axes="zxz", mass=1.0, inertia=(0.5, 0.5, 0.5))], []),
            [0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0],
        )
    state = vi.start(q, v)
    with pytest.raises(ArgumentError, match="inputs: got nan"):
        vi.step(state, 0.01, inputs=[np.nan])
    with pytest.raises(StepError, match="failed"):
        vi.step(vi.start(q, 200.0 * v), 0.5)


def test_a_mass_matrix_that_is_not_definite_has_velocities_too() -> None:
    odd = Body(1.0, inertia=[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], allow_nonphysical=True)
    m = Mechanism([rx("a", mass=0.0, inertia=(0.1, 0.1, 0.1)), [ry("b", bodies=[odd])]], [])
    p = np.array([1.0, 3.0])
    assert np.linalg.eigvalsh(m.mass_matrix([0.0, 0.0]))[0] < 0.0
    assert to_velocity(m, [0.0, 0.0], p) == pytest.approx(np.linalg.solve(m.mass_matrix([0.0, 0.0]), p))
