"""Continuous trajectories as discrete ones and back, the Legendre transform, and gains across the two."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from leastaction.errors import ArgumentError
from leastaction.mechanics import Mechanism, MidpointVI, SimulationStatus, rz, tx, ty
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.legendre import legendre_jacobian, to_momentum, to_velocity
from leastaction.mechanics.continuous.prescribed import PrescribedMotion
from leastaction.mechanics.continuous.signals import Feedback
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, IntegrationStatus
from leastaction.mechanics.conversion import (
    gain_to_continuous,
    gain_to_discrete,
    to_continuous,
    to_discrete,
)
from leastaction.mechanics.elements import Gravity
from leastaction.models import four_bars
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.systems import MidpointSystem
from physics.laws import G, floating_chain, in_motion, mass_on_string, measured_order, times
from physics.test_order import driven_arm, inputs, reeled, table

STEPS = (100, 200, 400)


def done(run: ContinuousTrajectory) -> ContinuousTrajectory:
    assert run.status is IntegrationStatus.COMPLETED, run.message
    return run


def arm_motion(t: np.ndarray) -> tuple[Mechanism, ContinuousTrajectory]:
    """Return an arm with inputs and damping on a turntable that is prescribed."""
    m = driven_arm()
    motion = PrescribedMotion(*(lambda t, i=i: [table(t)[i]] for i in range(3)))
    q0, v0 = np.array([0.3, 0.2, -0.4, 0.0]), np.array([1.0, -0.5, 0.8, 1.4])
    signals = {"inputs": lambda t, x: inputs(t), "rho": motion}
    return m, done(simulate(m, q0, v0, t, rtol=1e-11, atol=1e-12, **signals))


def reeled_motion(t: np.ndarray) -> tuple[Mechanism, ContinuousTrajectory]:
    """Return a mass on a string that is reeled."""
    length, _ = reeled()
    m = mass_on_string()
    motion = PrescribedMotion(
        lambda t: [length(t)], lambda t: [0.9 * np.cos(3.0 * t)], lambda t: [-2.7 * np.sin(3.0 * t)]
    )
    s, c = np.sin(0.8), np.cos(0.8)
    q0, v0 = [1.2 * s, -1.2 * c, 1.2], [0.9 * s + 1.2 * c, -0.9 * c + 1.2 * s, 0.9]
    return m, done(simulate(m, q0, v0, t, rho=motion, rtol=1e-11, atol=1e-12))


def loop_motion(t: np.ndarray) -> tuple[Mechanism, ContinuousTrajectory]:
    """Return a closed loop of bars."""
    m = four_bars.four_bars(1)
    return m, done(simulate(m, *four_bars.at_angle(m, 1.4, 0.5), t, rtol=1e-11, atol=1e-12))


MOTIONS = {"arm": arm_motion, "reeled": reeled_motion, "loop": loop_motion}


# The Legendre transform


def test_momenta_and_velocities_are_inverse() -> None:
    m = driven_arm()
    q, v = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 7, m.nq))
    p = to_momentum(m, q, v)
    np.testing.assert_allclose(p, [m.momentum(*pair)[: m.nd] for pair in zip(q, v, strict=True)])
    np.testing.assert_allclose(to_velocity(m, q, p, v[:, m.nd :]), v, atol=1e-12)
    np.testing.assert_allclose(to_velocity(m, q[2], p[2], v[2, m.nd :]), v[2], atol=1e-12)
    assert np.abs(to_velocity(m, q, p) - v)[:, : m.nd].max() > 1e-3, "the turntable carries momentum"


def test_jacobian_of_the_legendre_transform() -> None:
    for m in (driven_arm(), floating_chain()):
        q, v = in_motion(m, 3)
        x, size = np.concatenate([q, v]), 1e-6

        def discrete(x: np.ndarray, m=m) -> np.ndarray:
            q, v = x[: m.nq], x[m.nq :]
            return np.concatenate([q, to_momentum(m, q, v), v[m.nd :]])

        T = legendre_jacobian(m, q, v)
        columns = [(discrete(x + size * e) - discrete(x - size * e)) / (2 * size) for e in np.eye(m.nx)]
        np.testing.assert_allclose(T, np.array(columns).T, atol=1e-8 * np.abs(T).max())
        assert np.array_equal(legendre_jacobian(m, [q, q], [v, v])[1], T)


def test_velocities_of_momenta_that_the_constraints_stop() -> None:
    m = four_bars.four_bars(1)
    q, v = four_bars.at_angle(m, 1.0, 1.0)
    p = to_momentum(m, q, v) + m.constraint_jacobian(q).T @ [0.7, -2.0]
    assert np.abs(to_velocity(m, q, p) - v).max() > 0.1
    np.testing.assert_allclose(to_velocity(m, q, p, keep_constraints=True), v, atol=1e-12)


# Trajectories


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("field", ["q", "p", "lam"])
def test_discrete_trajectories_approach_continuous_ones(motion, sampled, field) -> None:
    # The sampled curve is compared with the integrator's own, which knows nothing of how it was made; that one
    # with the continuous motion.
    m, run = MOTIONS[motion](np.linspace(0.0, 1.0, 3))
    if field == "lam" and not m.nc:
        return
    vi = MidpointVI(m, threads=1)

    def error(steps: int) -> float:
        t = times(1.0, steps)
        ours = to_discrete(run, vi, t)
        assert ours.status is SimulationStatus.COMPLETED
        if sampled:
            other = getattr(to_discrete(run, vi, t, sampled=True), field)
            off = getattr(ours, field) - other
            # Per second, as multipliers are impulses; the first one holds half a step and is off by O(dt).
            return float(np.abs(off[1:] * steps if field == "lam" else off).max())
        back = getattr(to_continuous(ours), {"p": "v"}.get(field, field))
        here = run(t)
        wanted = {"q": here[:, : m.nq], "p": here[:, m.nq :]}.get(field)
        if wanted is None:
            u = run.input(t)
            dynamics = ContinuousDynamics(m)
            wanted = dynamics.accelerations(here[:, : m.nq], here[:, m.nq :], u[:, : m.nu], u[:, m.nu :]).lam
        return float(np.abs(back - wanted).max())

    assert measured_order(error, STEPS) == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("motion", MOTIONS)
def test_sampled_curves_are_trajectories_but_for_the_third_order(motion) -> None:
    m, run = MOTIONS[motion](np.linspace(0.0, 1.0, 3))
    vi = MidpointVI(m, threads=1)

    def defect(steps: int) -> float:
        curve = to_discrete(run, vi, times(1.0, steps), sampled=True)
        k = steps // 5 * 3
        end = vi.step(curve.state(k), 1.0 / steps, inputs=curve.inputs[k], rho_next=curve.rho[k + 1]).state
        return float(np.abs(end.q - curve.q[k + 1]).max())

    assert measured_order(defect, (25, 50, 100)) > 2.7


def test_there_and_back_between_the_instants() -> None:
    m, run = arm_motion(times(1.0, 10))
    vi = MidpointVI(m, threads=1)

    def error(steps: int) -> float:
        back = to_continuous(to_discrete(run, vi, times(1.0, steps)))
        between = np.linspace(0.0, 1.0, 61)
        return float(np.abs(back(between) - run(between)).max())

    assert measured_order(error, STEPS) == pytest.approx(2.0, abs=0.2)


def test_a_trajectory_without_dense_output_at_its_own_instants() -> None:
    m = cart_pendulum()
    t = times(1.0, 50)
    run = done(simulate(m, [0.1, 2.0], [0.5, -1.0], t, dense_output=False))
    vi = MidpointVI(m, threads=1)
    assert np.array_equal(to_discrete(run, vi, sampled=True).q, run.q)
    np.testing.assert_allclose(to_discrete(run, vi).q, run.q, atol=1e-2)
    with pytest.raises(ArgumentError, match="dense_output=True"):
        to_discrete(run, vi, times(1.0, 20))


def test_status_and_drift_go_with_a_run() -> None:
    m = mass_on_string(length=1.0)
    vi = MidpointVI(m, threads=1)
    run = vi.simulate(vi.start([0.6, -0.8]), times(1.0, 20))
    back = to_continuous(run)
    assert back.status is IntegrationStatus.COMPLETED
    assert back.drift["string0"].h < 1e-12
    assert back.drift["string0"].rate < 1e-12
    np.testing.assert_allclose(back.lam[5:-5, 0], -run.lam[5:, 0][:-4] * 20.0, rtol=2e-2)


def test_wrong_conversions() -> None:
    m, other = cart_pendulum(), four_bars.four_bars(1)
    run = simulate(m, [0.0, 1.0], None, times(1.0, 10))
    with pytest.raises(ArgumentError, match="other names"):
        to_discrete(run, MidpointVI(other))
    with pytest.raises(ArgumentError, match="from 0 to 1 s"):
        to_discrete(run, MidpointVI(m), times(2.0, 10))
    discrete = to_discrete(run, MidpointVI(m))
    with pytest.raises(ArgumentError, match="other names"):
        to_continuous(discrete, dynamics=ContinuousDynamics(other))
    with pytest.raises(ArgumentError, match="K: got shape"):
        gain_to_discrete(m, [0.0, 1.0], [0.0, 0.0], np.zeros((2, 4)), 0.01)
    with pytest.raises(ArgumentError, match="dt"):
        gain_to_discrete(m, [0.0, 1.0], [0.0, 0.0], np.zeros((1, 4)), 0.0)


# Gains


def pushed() -> Mechanism:
    """Return a pendulum on a cart that is pushed."""
    return cart_pendulum(damping=0.3)


def led() -> Mechanism:
    """Return a pendulum on a cart whose motion is prescribed."""
    return Mechanism([tx("cart", kinematic=True), [rz("theta"), [ty(-1.0, mass=1.0)]]], [Gravity((0.0, -G, 0.0))])


def upright(m: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Return the upright configuration, and the gains of a regulator about it in continuous time."""
    q = m.configuration({"theta": np.pi})
    d = ContinuousDynamics(m).linearize(q, np.zeros(m.nq))
    nd, nq = m.nd, m.nq
    A, B = np.zeros((m.nx, m.nx)), np.zeros((m.nx, m.nu + m.nrho))
    A[:nq, nq:] = np.eye(nq)
    A[nq : nq + nd] = np.hstack([d.a_dq, d.a_dv])
    B[nq : nq + nd] = np.hstack([d.a_du, d.a_drho_a])
    B[nq + nd :, m.nu :] = np.eye(m.nrho)
    P = solve_continuous_are(A, B, np.eye(m.nx), np.eye(B.shape[1]))
    return q, B.T @ P


@pytest.mark.parametrize("build", [pushed, led])
def test_closed_loops_agree_to_the_time_step(build) -> None:
    # Of small deviations: gains on p and on v are alike to the first order in them.
    m, small = build(), 1e-5
    q, K = upright(m)
    x0 = np.concatenate([q, np.zeros(m.nq)])
    law = Feedback(K, x0, np.zeros(len(K)))
    t = times(4.0, 40)
    run = done(simulate(m, q + small, None, t, u=law, rtol=1e-11, atol=1e-14))
    theta = run["theta"] - np.pi
    assert np.abs(theta[-1]) < 0.2 * small < 0.99 * small <= np.abs(theta[0])

    def error(steps: int) -> float:
        gains = np.tile(gain_to_discrete(m, q, np.zeros(m.nq), K, 4.0 / steps), (steps, 1, 1))
        vi = MidpointVI(m, threads=1)
        xbar = np.tile(x0, (steps + 1, 1))
        ubar = np.tile(np.concatenate([np.zeros(m.nu), q[m.nd :]]), (steps, 1))
        system = MidpointSystem(vi, times(4.0, steps))
        out = system.rollout(vi.start(q + small).x, xbar, ubar, gains, 0, steps)
        assert out.failure is None
        return float(np.abs(out.x[:: steps // 40, : m.nq] - run.q).max()) / small

    assert error(3200) < 0.05
    assert measured_order(error, (800, 1600, 3200)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("build", [pushed, led, driven_arm])
def test_gains_go_there_and_back(build) -> None:
    m = build()
    rng = np.random.default_rng(6)
    q, v = rng.uniform(-1.0, 1.0, (2, 5, m.nq))
    K = rng.uniform(-1.0, 1.0, (5, m.nu + m.nrho, m.nx))
    discrete = gain_to_discrete(m, q, v, K, 0.1)
    np.testing.assert_allclose(gain_to_continuous(m, q, v, discrete, 0.1), K, atol=1e-11)
    np.testing.assert_allclose(gain_to_discrete(m, q[1], v[1], K[1], 0.1), discrete[1], atol=1e-12)
    # On small deviations both laws give the same forces, and the extrapolated prescribed variables.
    T, dx = legendre_jacobian(m, q[0], v[0]), rng.uniform(-1.0, 1.0, m.nx)
    du, du_discrete = -K[0] @ dx, -discrete[0] @ (T @ dx)
    np.testing.assert_allclose(du_discrete[: m.nu], du[: m.nu], atol=1e-12)
    rho, v_rho = dx[m.nd : m.nq], dx[m.nq + m.nd :]
    wanted = rho + 0.1 * v_rho + 0.01 * du[m.nu :]
    np.testing.assert_allclose(du_discrete[m.nu :], wanted, atol=1e-12)


def test_discrete_gains_hold_a_continuous_motion() -> None:
    m, dt = led(), 0.01
    q, K = upright(m)
    discrete = gain_to_discrete(m, q, np.zeros(m.nq), K, dt)
    # A gain that was made otherwise would not be known to come from K.
    back = gain_to_continuous(m, q, np.zeros(m.nq), discrete, dt)
    law = Feedback(back, np.concatenate([q, np.zeros(m.nq)]), np.zeros(1))
    run = done(simulate(m, q + 0.05, None, times(8.0, 20), u=law))
    assert np.abs(run.q[-1] - q).max() < 5e-3
