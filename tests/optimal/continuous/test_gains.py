"""Gains along a motion that was found on a mesh: right to the end, whatever the weight there and however stiff."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from leastaction.elements import Damping, JointForce, JointSpring
from leastaction.limits import Bound
from leastaction.mechanics import Mechanism, tx
from leastaction.numerics.arrays import Array
from leastaction.optimal import ContinuousQuadraticCost, optimize
from leastaction.systems import MechanismSystem
from optimal.continuous.systems import CartPendulum

SECONDS, R = 2.0, 0.1


def exact(weight: float, t: Array) -> Array:
    """Return the gains (n, 1, 2) of a double integrator without running cost, by the inverse of the cost to go.

    ``W = P^-1`` is ``e^-As W(T) e^-A's`` and the integral of ``e^-Ar B R^-1 B'e^-A'r`` over what is left, s.
    """
    out = []
    for s in SECONDS - t:
        back = np.array([[1.0, -s], [0.0, 1.0]])
        W = back @ back.T / weight + np.array([[s**3 / 3.0, -(s**2) / 2.0], [-(s**2) / 2.0, s]]) / R
        out.append(np.linalg.inv(W)[1:] / R)
    return np.array(out)


@pytest.mark.parametrize("weight", [1.0, 1e4, 1e8])
def test_gains_of_a_double_integrator_have_their_closed_form(weight: float) -> None:
    system = MechanismSystem(Mechanism([tx("slide", mass=1.0)], [JointForce("slide", input="push")]))
    cost = ContinuousQuadraticCost(np.zeros(2), np.zeros(1), Q=np.zeros(2), R=[R], Q_final=np.full(2, weight))
    found = optimize(system, cost, initial=([1.0, 0.0], np.zeros(1)), horizon=(0.0, SECONDS))
    t = np.concatenate([np.linspace(0.0, 1.95, 40), SECONDS - np.logspace(-1.5, -9.0, 40), [SECONDS]])
    wanted = exact(weight, t)
    off = np.abs(found.feedback(t) - wanted).max(axis=(1, 2)) / np.abs(wanted).max(axis=(1, 2))
    assert off.max() < 1e-5
    assert np.abs(found.K[-1] - [[0.0, weight / R]]).max() < 1e-6 * weight / R


def by_integration(system: object, cost: object, found: object, t: Array) -> Array:
    """Return the gains at times that decrease, by SciPy's implicit integration of the Riccati equation."""
    n = system.nx

    def law(at: float, P: Array) -> tuple[Array, Array, Array]:
        x, u = found.dense.sample(np.array([at]))
        A, B = (each[0] for each in system.linearize(x, u, np.array([at])))
        Q, weight, _ = (each if each is None else each[0] for each in cost.hessian(x, u, np.array([at])))
        return A, np.linalg.solve(weight, B.T @ P), Q - (B.T @ P).T @ np.linalg.solve(weight, B.T @ P)

    def rate(at: float, flat: Array) -> Array:
        P = flat.reshape(n, n)
        A, _, rest = law(at, P)
        return -(rest + P @ A + A.T @ P).ravel()

    last = cost.final_hessian(found.x[-1], SECONDS)
    out = solve_ivp(rate, (SECONDS, t[-1]), last.ravel(), "Radau", t, rtol=1e-6, atol=1e-8)
    return np.array([law(at, P.reshape(n, n))[1] for at, P in zip(out.t, out.y.T, strict=True)])


def held_by_a_spring(stiffness: float, damping: float) -> MechanismSystem:
    """A slide that is pushed, and a light one on it that is gone after some microseconds."""
    elements = [JointSpring("b", stiffness), Damping({"b": damping}), JointForce("a", input="push")]
    return MechanismSystem(Mechanism([tx("a", mass=1.0), [tx("b", mass=0.01)]], elements))


@pytest.mark.parametrize("case", ["cart", "stiff"])
def test_gains_are_those_of_a_fine_integration(case: str) -> None:
    system = CartPendulum() if case == "cart" else held_by_a_spring(1e4, 1e3)
    x0 = [0.3, 0.5, 0.0, 0.0] if case == "cart" else [0.3, 0.0, 0.0, 0.0]
    cost = ContinuousQuadraticCost(np.zeros(4), np.zeros(1), Q=np.ones(4), R=[R], Q_final=np.full(4, 1e3))
    limits = [Bound("u[0]" if case == "cart" else "push", -0.5, 0.5)]
    found = optimize(system, cost, initial=(x0, np.zeros(1)), horizon=(0.0, SECONDS), limits=limits)
    assert found.success
    t = np.array([1.999, 1.9, 1.7])
    wanted = by_integration(system, cost, found, t)
    off = np.abs(found.feedback(t) - wanted).max(axis=(1, 2)) / np.abs(wanted).max(axis=(1, 2))
    assert off.max() < 1e-4


def test_what_oscillates_fast_is_no_trap() -> None:
    system = held_by_a_spring(1e8, 1.0)
    cost = ContinuousQuadraticCost(
        np.zeros(4), np.zeros(1), Q=np.r_[1.0, 0.0, 0.0, 0.0], R=[R], Q_final=np.full(4, 1.0)
    )
    found = optimize(system, cost, initial=([0.3, 0.0, 0.0, 0.0], np.zeros(1)), horizon=(0.0, SECONDS))
    assert np.isfinite(found.K).all()
    assert len(found.feedback.breaks) < 3000
