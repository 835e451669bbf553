"""Periodic orbits and shortest times against Ipopt, on the same discrete problem by multiple shooting."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import leastaction as la
from leastaction.optimal import Bound, Equal, FinalTime, OptimizationResult, Periodic, QuadraticCost, optimize
from leastaction.systems import MidpointSystem
from optimal.systems import swinging_double_pendulum

ca = pytest.importorskip("casadi", reason="an oracle of `make test ORACLES=1`")


def ipopt(
    system: MidpointSystem,
    cost: QuadraticCost,
    start: OptimizationResult,
    *,
    ends: Any,
    most: float = np.inf,
    price: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return states, inputs, final time and cost that Ipopt finds from near a motion.

    ``ends``: conditions on the first and the last state. ``most``: of the inputs. ``price``: of the final time, which
    is held if that is nothing.
    """
    from benchmarks.casadi_mechanism import Symbolic

    N, nx, nu = system.N, system.nx, system.nu
    nc = system.integrator.mechanism.nc
    x, u, T = ca.MX.sym("x", nx, N + 1), ca.MX.sym("u", nu, N), ca.MX.sym("T")
    lam = ca.MX.sym("lam", nc, N)
    step = Symbolic(system.integrator.mechanism).step(ca.SX.sym("dt")).map(N)
    F = step(x[:, :-1], u, lam, x[:, 1:], ca.repmat(T / N, 1, N))
    dx, du = x - cost.x_wanted.T, u - cost.u_wanted.T
    value = 0.5 * (
        ca.sum(ca.vec(ca.DM(np.tile(cost.Q[:, None], N)) * dx[:, :-1] ** 2))
        + ca.sum(ca.vec(ca.DM(np.tile(cost.R[:, None], N)) * du**2))
        + ca.dot(ca.DM(cost.Q_final), dx[:, -1] ** 2)
    )
    w = ca.vertcat(ca.vec(x), ca.vec(u), ca.vec(lam), T)
    g = ca.vertcat(ca.vec(F), ends(x[:, 0], x[:, -1]))
    T0 = start.unknowns.get("final time", float(system.t[-1]))
    n = nx * (N + 1)
    lower, upper = np.full(w.numel(), -np.inf), np.full(w.numel(), np.inf)
    inputs = slice(n, n + nu * N)
    lower[inputs], upper[inputs] = -most, most
    lower[-1], upper[-1] = (0.1, 20.0) if price else (T0, T0)
    options = {"print_level": 0, "sb": "yes", "tol": 1e-10, "max_iter": 500}
    solver = ca.nlpsol("peer", "ipopt", {"x": w, "f": value + price * T, "g": g}, {"print_time": 0, "ipopt": options})
    rng = np.random.default_rng(0)
    forces = system.integrator.linearize_arrays(system.t, start.x, start.u).lam
    guess = np.concatenate([start.x.ravel(), start.u.ravel(), forces.ravel(), [T0]])
    guess += 0.02 * rng.normal(size=guess.size) * np.abs(guess).max()
    guess[-1] = T0 * (1.1 if price else 1.0)
    found = solver(x0=guess, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
    assert solver.stats()["return_status"] == "Solve_Succeeded"
    z = np.array(found["x"]).ravel()
    return z[:n].reshape(N + 1, nx), z[inputs].reshape(N, nu), float(z[-1]), float(found["f"])


def test_a_periodic_orbit() -> None:
    N = 50
    system, cost = swinging_double_pendulum(N)
    for most in (np.inf, 1.2):
        limits = [Periodic(), *([Bound("hip", -most, most)] if most < np.inf else [])]
        start = np.zeros(4), np.zeros((N, 1))
        result = optimize(system, cost, initial=start, free_start=True, limits=limits, tolerance=1e-11)
        assert result.success, result.message
        x, u, _, value = ipopt(system, cost, result, ends=lambda first, last: last - first, most=most)
        assert result.cost == pytest.approx(value, rel=1e-7)
        np.testing.assert_allclose(result.x, x, atol=1e-5)
        np.testing.assert_allclose(result.u, u, atol=1e-4)
        assert (np.abs(u).max() > most - 1e-3) == (most < np.inf)


def test_a_periodic_orbit_of_a_closed_linkage() -> None:
    """Momenta return whole, also what constraints take up of them at once: the first step is like any other."""
    N = 40
    m = la.Mechanism(
        [la.rx("a"), [la.tz(-1.0, name="A", mass=1.0), [la.rx("b"), [la.tz(-1.0, name="B", mass=1.0)]]]],
        [
            la.Gravity((0.0, 0.0, -9.81)),
            la.Distance("B", "world", 1.5),
            la.JointForce("a", input="torque"),
            la.Damping(0.1),
        ],
    )
    t = np.linspace(0.0, 1.5, N + 1)
    vi = la.MidpointVI(m, threads=1)
    run = vi.simulate(vi.start(la.project_configuration(m, [0.3, 1.0]).q), t)
    system = MidpointSystem(vi, t)
    wanted = np.zeros((N + 1, 4))
    wanted[:, 0] = run.q[0, 0] + 0.3 * np.sin(2.0 * np.pi * t / 1.5)
    cost = QuadraticCost(wanted, np.zeros((N, 1)), Q=[10.0, 0.0, 1e-4, 1e-4], R=[0.01])
    start = run.x[0], np.zeros((N, 1))
    result = optimize(system, cost, initial=start, free_start=True, limits=[Periodic()], tolerance=1e-11)
    assert result.success, result.message
    x, u, _, value = ipopt(system, cost, result, ends=lambda first, last: last - first)
    assert result.cost == pytest.approx(value, rel=1e-7)
    np.testing.assert_allclose(result.x, x, atol=1e-4)
    np.testing.assert_allclose(result.u, u, atol=1e-3)
    # So it is: not the tangent part of the first momentum alone.
    v = np.linalg.solve(m.mass_matrix(result.x[0, :2]), result.x[0, 2:])
    assert abs((m.constraint_jacobian(result.x[0, :2]) @ v).item()) > 1e-6


def test_the_shortest_swing_of_a_pendulum_on_a_cart() -> None:
    """From rest to rest two metres away under a bounded push, the pole hanging at both ends."""
    N = 50
    m = la.Mechanism(
        [la.ty("cart", mass=4.0), [la.rx("pole"), [la.tz(-1.0, mass=1.0, name="bob")]]],
        [la.Gravity((0.0, 0.0, -9.8)), la.JointForce("cart", input="push"), la.Damping({"pole": 0.05})],
    )
    system = MidpointSystem(la.MidpointVI(m, threads=1), np.linspace(0.0, 3.0, N + 1))
    cost = QuadraticCost(np.zeros((N + 1, 4)), np.zeros((N, 1)), Q=np.zeros(4), R=[1e-5])
    end = np.array([2.0, 0.0, 0.0, 0.0])
    result = optimize(
        system,
        cost,
        initial=(np.zeros(4), np.zeros((N, 1))),
        unknowns=[FinalTime(0.1, 20.0, price=1.0)],
        limits=[Bound("push", -15.0, 15.0), Equal(["cart", "pole"], end[:2]), Equal("*", 0.0, of="momentum")],
        tolerance=1e-11,
    )
    assert result.success, result.message
    x, u, T, value = ipopt(
        system, cost, result, ends=lambda first, last: ca.vertcat(first, last - end), most=15.0, price=1.0
    )
    assert result.cost == pytest.approx(value, rel=1e-7)
    assert result.unknowns["final time"] == pytest.approx(T, rel=1e-6)
    assert np.sum(np.abs(u) > 15.0 - 1e-2) > 0.6 * N
    np.testing.assert_allclose(result.x, x, atol=1e-4)
