"""The measured order of the method, against fine solutions of the differential equations of motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from leastaction.mechanics import Damping, Gravity, JointForce, Mechanism, rx, ry, rz, tx, tz
from leastaction.models.cart_pendulum import cart_pendulum
from physics.laws import G, mass_on_string, measured_order, swing, times

END = 1.0
STEPS = (100, 200, 400)


def driven_arm() -> Mechanism:
    """Return three joints with damping and two inputs, on a turntable whose angle is prescribed."""
    return Mechanism(
        [rz("table", kinematic=True, mass=2.0, com=(0.4, 0.0, 0.0), inertia=(0.2, 0.2, 0.3)), [
            tx(0.5), [rx("lift", mass=1.5, com=(0.0, 0.4, -0.1), inertia=(0.1, 0.05, 0.08, 0.01, 0.0, 0.02)), [
                tz("slide", mass=0.8), [ry("wrist", mass=0.5, com=(0.2, 0.0, 0.1))],
            ]],
        ]],
        [
            Gravity((0.0, 0.0, -G)),
            Damping({"lift": 0.8, "slide": 0.5}, default=0.1),
            JointForce("lift", input="motor"),
            JointForce("slide", input="drive"),
        ],
    )  # fmt: skip


def inputs(t: float) -> np.ndarray:
    return np.array([8.0 * np.sin(5.0 * t), 12.0 * np.cos(3.0 * t)])


def table(t: float) -> tuple[float, float, float]:
    """Return the angle of the turntable, its velocity and its acceleration."""
    return 0.7 * np.sin(2.0 * t), 1.4 * np.cos(2.0 * t), -2.8 * np.sin(2.0 * t)


def fine(
    m: Mechanism,
    q0: np.ndarray,
    v0: np.ndarray,
    force: Callable[[float, np.ndarray], np.ndarray],
    rho: Callable[[float], tuple[float, float, float]] | None = None,
) -> Callable[[np.ndarray], np.ndarray]:
    """Return q and p of the dynamic variables, (2 nd, N), by solving d/dt L_v = L_q + f to 1e-12."""
    nd = m.nd

    def whole(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if rho is None:
            return y[:nd], y[nd:], np.zeros(0)
        r, r1, r2 = rho(t)
        return np.append(y[:nd], r), np.append(y[nd:], r1), np.array([r2])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        q, v, a_rho = whole(t, y)
        L_q, _ = m.core.gradient(q, v)
        _, L_vq, M = m.core.hessian(q, v)
        right = (L_q - L_vq @ v)[:nd] + force(t, v[:nd]) - M[:nd, nd:] @ a_rho
        return np.concatenate([v[:nd], np.linalg.solve(M[:nd, :nd], right)])

    y0 = np.concatenate([q0[:nd], v0[:nd]])
    out = solve_ivp(rate, (0.0, END), y0, method="DOP853", rtol=1e-12, atol=1e-12, dense_output=True)

    def q_and_p(t: np.ndarray) -> np.ndarray:
        columns = [whole(at, y)[:2] for at, y in zip(t, out.sol(t).T, strict=True)]
        return np.array([np.concatenate([q[:nd], m.momentum(q, v)[:nd]]) for q, v in columns]).T

    return q_and_p


def order(m: Mechanism, q0: np.ndarray, v0: np.ndarray, exact, split: str, steps, **signals) -> float:
    def error(n: int) -> float:
        t = times(END, n)
        run = swing(m, q0, v0, t, split=split, **signals)
        return float(np.abs(np.hstack([run.q[:, : m.nd], run.p]).T - exact(t)).max())

    return measured_order(error, steps)


def cart() -> tuple:
    m = cart_pendulum(damping=0.5, pivot_torque=True)
    q0, v0 = np.array([0.1, 2.0]), np.array([0.5, -1.0])
    return m, q0, v0, fine(m, q0, v0, lambda t, v: inputs(t) - 0.5 * v), {"inputs": inputs}


def arm() -> tuple:
    m = driven_arm()
    assert m.variables == ("lift", "slide", "wrist", "table")
    q0, v0 = np.array([0.3, 0.2, -0.4, 0.0]), np.array([1.0, -0.5, 0.8, 1.4])

    def force(t: float, v: np.ndarray) -> np.ndarray:
        return np.append(inputs(t), 0.0) - np.array([0.8, 0.5, 0.1]) * v

    exact = fine(m, q0, v0, force, table)
    return m, q0, v0, exact, {"inputs": inputs, "rho": lambda t: [table(t)[0]]}


@pytest.mark.parametrize("build", [cart, arm])
def test_symmetric_split_is_of_second_order_with_forcing_and_damping(build) -> None:
    m, q0, v0, exact, signals = build()
    assert order(m, q0, v0, exact, "symmetric", STEPS, **signals) == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("build", [cart, arm])
def test_left_split_is_of_first_order(build) -> None:
    m, q0, v0, exact, signals = build()
    assert order(m, q0, v0, exact, "left", (400, 800, 1600), **signals) == pytest.approx(1.0, abs=0.05)


def reeled() -> tuple[Callable[[float], float], Callable[[np.ndarray], np.ndarray]]:
    """Return a string's length in time, and the angle of the pendulum on it: th'' = -(g sin th + 2 l' th')/l."""

    def length(t: float) -> float:
        return 1.2 + 0.3 * np.sin(3.0 * t)

    def rate(t: float, y: np.ndarray) -> list[float]:
        reel = 0.9 * np.cos(3.0 * t)
        return [y[1], -(G * np.sin(y[0]) + 2.0 * reel * y[1]) / length(t)]

    out = solve_ivp(rate, (0.0, END), [0.8, 1.0], method="DOP853", rtol=1e-12, atol=1e-12, dense_output=True)
    return length, lambda t: out.sol(t)[0]


def reeled_error(steps: int, uneven: bool = False) -> float:
    length, angle = reeled()
    m = mass_on_string()
    t = times(END, steps)
    if uneven:
        t = END * (t + 0.1 * np.sin(2 * np.pi * t) / np.pi)
    l0, th, reel = length(0.0), 0.8, 0.9
    q0 = m.configuration({"x": l0 * np.sin(th), "z": -l0 * np.cos(th), "length": l0})
    v0 = m.configuration(
        {
            "x": reel * np.sin(th) + l0 * np.cos(th),
            "z": -reel * np.cos(th) + l0 * np.sin(th),
            "length": reel,
        }
    )
    run = swing(m, q0, v0, t, rho=lambda at: [length(at)])
    assert np.abs(m.constraint_values(run.q)).max() < 1e-12
    wanted = np.array([length(at) for at in t]) * np.sin(angle(t))
    return float(np.abs(run["x"] - wanted).max())


@pytest.mark.parametrize("uneven", [False, True])
def test_second_order_on_a_string_that_is_reeled(uneven: bool) -> None:
    slope = measured_order(lambda n: reeled_error(n, uneven), STEPS)
    assert slope == pytest.approx(2.0, abs=0.05)
