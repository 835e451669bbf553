"""Derivatives of whole mechanisms, seen through the step itself: the remainder of its Taylor polynomial.

If A, B and the second derivatives are right, what the polynomial of degree two leaves of a shifted step falls
with the third power of the shift; a wrong entry anywhere along the direction leaves a lower power.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from leastaction.mechanics import (
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    State,
    project_configuration,
    project_velocity,
    rx,
    ry,
    rz,
    tx,
    tz,
)
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.chain import pendulum_chain
from leastaction.models.marionette import marionette, rest_pose


class Moving(NamedTuple):
    """A mechanism in motion, and the size of shifts under which its step is smooth."""

    mechanism: Mechanism
    q: np.ndarray
    v: np.ndarray
    inputs: np.ndarray
    shift: float = 0.1


def crane(**order: list[str]) -> Mechanism:
    """Return a mechanism with everything: a prescribed turntable with a mass, inputs, damping, two ropes."""
    load = [rx("swing", mass=2.0, com=(0.0, 0.1, -0.7), inertia=(0.3, 0.25, 0.1, 0.01, 0.02, -0.03))]
    return Mechanism(
        [rz("table", kinematic=True, mass=5.0, com=(0.3, 0.1, 0.0), inertia=(1.0, 1.0, 1.5)), [
            tz(1.0), [ry("boom", mass=3.0, com=(0.8, 0.0, 0.0), inertia=(0.1, 0.6, 0.6)), [
                tx("reach", mass=1.0), [tx(0.3, name="tip"), [*load, [tz(-1.0, name="hook")]]],
            ]],
            tx(-0.5, name="winch"),
        ], tx(2.0), [rz(0.3), [tz("post", name="post", kinematic=True)]]],
        [
            Gravity((0.0, 0.3, -9.8)),
            Damping({"boom": 0.4}, default=0.1),
            JointForce("boom", input="motor"),
            JointForce("reach", input="drive"),
            JointForce("swing", input="motor"),
            Distance("tip", "winch", "rope", name="hoist"),
            Distance("hook", "post", "stay-length", name="stay"),
        ],
        **order,
    )  # fmt: skip


def moving_crane(**order: list[str]) -> Moving:
    m = crane(**order)
    values = {"table": 0.4, "boom": -0.3, "reach": 0.9, "swing": 0.5, "post": 0.2}
    q = m.configuration({**values, "rope": 1.5, "stay-length": 1.2})
    q = project_configuration(m, q, hold=list(values), move_kinematic=True).q
    v = m.configuration({"table": 1.1, "boom": 0.7, "reach": -0.4, "swing": -1.3, "post": 0.3})
    v = project_velocity(m, q, v, hold=list(values), move_kinematic=True).v
    return Moving(m, q, v, np.array([3.0, -2.0])[: m.nu])


def moving_marionette() -> Moving:
    m = marionette()
    q = rest_pose(m)
    rng = np.random.default_rng(1)
    return Moving(m, q, project_velocity(m, q, 0.3 * rng.standard_normal(m.nq)).v, np.zeros(0), 0.02)


def moving_chain() -> Moving:
    rng = np.random.default_rng(2)
    return Moving(pendulum_chain(5), *rng.uniform(-1.0, 1.0, (2, 5)), np.zeros(0))


def moving_cart() -> Moving:
    return Moving(
        cart_pendulum(pivot_torque=True),
        np.array([0.2, 2.0]),
        np.array([1.0, -3.0]),
        np.array([5.0, 1.0]),
    )


MOVING = [moving_cart, moving_chain, moving_crane, moving_marionette]


def step(vi: MidpointVI, x: np.ndarray, u: np.ndarray, dt: float) -> np.ndarray:
    """Return [next x; lam] of one step."""
    m = vi.mechanism
    state = State(0.0, x[: m.nq], x[m.nq : m.nq + m.nd], x[m.nq + m.nd :])
    made = vi.step(state, dt, inputs=u[: m.nu], rho_next=u[m.nu :])
    return np.concatenate([made.state.x, made.lam])


@pytest.mark.parametrize("split", ["symmetric", "left"])
@pytest.mark.parametrize("build", MOVING)
def test_remainder_is_of_third_order(build: Callable[[], Moving], split: str) -> None:
    m, q, v, inputs, shift = build()
    dt = 0.01
    vi = MidpointVI(m, split=split, threads=1)
    x, u = vi.start(q, v).x, np.concatenate([inputs, (q + dt * v)[m.nd :]])
    run = vi.simulate(vi.start(q, v), [0.0, dt], inputs=inputs, rho=u[None, m.nu :])
    d, full = vi.linearize(run, multipliers=True), vi.tensors(run, 0)
    first = np.vstack([np.hstack([d.A[0], d.B[0]]), np.hstack([d.lam_dx[0], d.lam_du[0]])])
    second = np.concatenate([full.x, full.lam])
    rng = np.random.default_rng(3)
    # A shift of momenta or of strings moves a step dt times less, or as much, than one of configurations.
    size = np.concatenate([np.full(m.nq, 1.0), np.full(m.nx - m.nq, 10.0), np.full(m.nu + m.nrho, 1.0)])
    along = rng.uniform(-1.0, 1.0, m.nx + m.nu + m.nrho) * size
    along[m.nx + m.nu :] = along[m.nd : m.nq]  # prescribed: both ends of the step together
    middle = step(vi, x, u, dt)
    remainders = []
    for e in (shift, shift / 2, shift / 4):
        # The odd and the even part of the change, each of which has a remainder of its own order.
        shifted = [step(vi, x + s * along[: m.nx], u + s * along[m.nx :], dt) for s in (e, -e)]
        odd, even = (shifted[0] - shifted[1]) / 2, (shifted[0] + shifted[1]) / 2 - middle
        wanted1, wanted2 = e * first @ along, 0.5 * e**2 * second @ along @ along
        parts = slice(0, m.nx), slice(m.nx, None)
        remainders.append(
            [
                np.linalg.norm(a[part] - b[part])
                for a, b in ((odd, wanted1), (even, wanted2))
                for part in parts[: 2 if m.nc else 1]
            ]
        )
    orders = np.diff(-np.log2(remainders), axis=0)[-1]
    half = len(orders) // 2
    assert np.all(np.abs(orders[:half] - 3.0) < 0.15), orders
    assert np.all(np.abs(orders[half:] - 4.0) < 0.3), orders


@pytest.mark.parametrize("build", MOVING)
def test_first_derivatives_are_not_differences_and_agree_with_them(
    build: Callable[[], Moving],
) -> None:
    m, q, v, inputs, _ = build()
    dt, h = 0.01, 1e-4
    vi = MidpointVI(m, threads=1)
    x, u = vi.start(q, v).x, np.concatenate([inputs, (q + dt * v)[m.nd :]])
    run = vi.simulate(vi.start(q, v), [0.0, dt], inputs=inputs, rho=u[None, m.nu :])
    d = vi.linearize(run)
    AB = np.hstack([d.A[0], d.B[0]])
    differences = np.empty_like(AB)
    for j, e in enumerate(np.eye(len(x) + len(u))):
        # Richardson: the error falls with h^4
        coarse, fine = (
            (step(vi, x + s * e[: m.nx], u + s * e[m.nx :], dt) - step(vi, x - s * e[: m.nx], u - s * e[m.nx :], dt))[
                : m.nx
            ]
            / (2 * s)
            for s in (h, h / 2)
        )
        differences[:, j] = (4 * fine - coarse) / 3
    error = np.abs(AB - differences).max() / np.abs(AB).max()
    assert 1e-15 < error < 1e-7
    assert np.abs(d.A).max() > 0.5
    assert np.abs(d.B).max(initial=1.0) > 1e-6


def test_order_of_the_names_permutes_the_derivatives() -> None:
    plain = moving_crane()
    mixed = moving_crane(
        dynamic=["swing", "boom", "reach"],
        kinematic=["stay-length", "post", "rope", "table"],
        inputs=["drive", "motor"],
    )
    first, second = plain.mechanism, mixed.mechanism
    assert first.variables != second.variables
    vi1, vi2 = MidpointVI(first, threads=1), MidpointVI(second, threads=1)
    to = [first.variables.index(name) for name in second.variables]
    inputs = [first.inputs.index(name) for name in second.inputs]
    rho = [i - first.nd for i in to[first.nd :]]
    assert np.allclose(mixed.q, plain.q[to], atol=1e-14)
    dynamic, nq = to[: first.nd], first.nq
    x = [*to, *(nq + i for i in dynamic), *(nq + first.nd + i for i in rho)]
    u = [*inputs, *(first.nu + i for i in rho)]
    dt = 0.01
    runs = []
    for vi, case in ((vi1, plain), (vi2, mixed)):
        m = vi.mechanism
        force = np.array([{"motor": 3.0, "drive": -2.0}[name] for name in m.inputs])
        start = vi.start(case.q, case.v)
        runs.append(vi.simulate(start, [0.0, dt], inputs=force, rho=(case.q + dt * case.v)[None, m.nd :]))
    d1, d2 = vi1.linearize(runs[0]), vi2.linearize(runs[1])
    close(d2.A[0], d1.A[0][np.ix_(x, x)])
    close(d2.B[0], d1.B[0][np.ix_(x, u)])
    z = np.random.default_rng(0).standard_normal(first.nx)
    H1 = vi1.curvature(runs[0], d1, z[None])[0]
    H2 = vi2.curvature(runs[1], d2, z[x][None])[0]
    xu = [*x, *(first.nx + i for i in u)]
    close(H2, H1[np.ix_(xu, xu)])


def test_time_steps_of_any_length_and_any_number_of_threads() -> None:
    m, q, v, inputs, _ = moving_crane()
    t = np.cumsum([0.0, 0.01, 0.004, 0.02, 0.001, 0.013])
    results = []
    for threads in (1, 3):
        vi = MidpointVI(m, threads=threads)
        run = vi.simulate(vi.start(q, v), t, inputs=inputs, rho=lambda at: (q + at * v)[m.nd :])
        assert run.steps == 5, run.message
        d = vi.linearize(run, multipliers=True)
        z = np.random.default_rng(4).standard_normal((5, m.nx))
        results.append((d.A, d.B, d.lam, d.lam_dx, d.lam_du, vi.curvature(run, d, z)))
    for one, three in zip(*results, strict=True):
        close(one, three, 1e-13)
    # Each step by itself, from the state it starts at.
    for k in range(5):
        single = vi.simulate(run.state(k), t[k : k + 2], inputs=inputs, rho=run.rho[k + 1 : k + 2])
        close(vi.linearize(single).A[0], results[0][0][k], 1e-9)
    assert np.abs(results[0][0][0] - results[0][0][3]).max() > 1.0


def close(ours: np.ndarray, theirs: np.ndarray, tolerance: float = 1e-10) -> None:
    assert np.abs(ours - theirs).max() < tolerance * np.abs(theirs).max()
