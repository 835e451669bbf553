"""Forces at the instants: strings by tensions make the motions of strings by lengths, with exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    TendonForce,
    rx,
    ry,
    tx,
    ty,
    tz,
)  # fmt: skip
from leastaction.errors import ArgumentError
from leastaction.systems import PulledSystem

ARM = [
    tz(1.0), [rx("a"), [ry("b"), [tz(-0.4, name="elbow", mass=0.5, inertia=(0.02, 0.02, 0.01)), [
        rx("c"), [tz(-0.3, name="hand", mass=0.3, inertia=(0.01, 0.01, 0.01))],
    ]]]],
    tz(2.0), [tx("x1", kinematic=True), [ty("y1", name="end1", kinematic=True)]],
    tz(2.0), [tx("x2", kinematic=True), [ty("y2", name="end2", kinematic=True)]],
]  # fmt: skip
ENDS = ["x1", "y1", "x2", "y2"]
T = np.linspace(0.0, 0.3, 31)


def by_tension() -> PulledSystem:
    arm = Mechanism(
        ARM,
        [
            Gravity((0.0, 0.0, -9.8)),
            TendonForce(("elbow", "end1"), "T1"),
            JointForce("c", "motor"),
            TendonForce(("hand", "end2"), "T2"),
        ],
        kinematic=ENDS,
    )
    return PulledSystem(MidpointVI(arm), T, at_instants=["T1", "T2"])


def pulled() -> tuple[PulledSystem, np.ndarray, np.ndarray]:
    """A motion by tensions: (system, x, u)."""
    system = by_tension()
    rng = np.random.default_rng(5)
    x0 = np.array([0.3, 0.2, 0.4, 0.0, 0.1, 0.1, 0.3, *np.zeros(7)])
    u = np.zeros((30, 7))
    u[:, [0, 2]] = rng.uniform(3.0, 5.0, size=(30, 2))
    u[:, 3:] = x0[3:7] + 0.02 * np.sin(4.0 * T[1:, None] + np.arange(4))
    done = system.rollout(x0, np.zeros((31, 14)), u, np.zeros((30, 7, 14)), 0, 30)
    assert done.complete
    assert done.worst_step is not None
    return system, done.x, u


def test_the_same_motion_with_lengths_as_constraints() -> None:
    _, x, u = pulled()
    arm = Mechanism(
        ARM,
        [
            Gravity((0.0, 0.0, -9.8)),
            Distance("elbow", "end1", "L1", name="one"),
            Distance("hand", "end2", "L2", name="two"),
        ],
        kinematic=[*ENDS, "L1", "L2"],
    )
    q = np.hstack([x[:, :7], np.zeros((31, 2))])
    lengths = np.stack(
        [
            np.linalg.norm(arm.positions(q, [a])[:, 0] - arm.positions(q, [b])[:, 0], axis=1)
            for a, b in (("elbow", "end1"), ("hand", "end2"))
        ],
        axis=1,
    )
    q[:, 7:] = lengths
    integrator = MidpointVI(arm)
    run = integrator.simulate(integrator.start(q[0]), T, rho=q[:, 3:])
    np.testing.assert_allclose(run.q, q, atol=1e-9)
    np.testing.assert_allclose(run.p[1:], x[1:, 7:10], atol=1e-9)
    share = np.diff(T)
    share[0] *= 0.5
    np.testing.assert_allclose(run.lam, share[:, None] * u[:, [0, 2]] / (2.0 * lengths[:-1]), atol=1e-9)


@pytest.mark.parametrize("k", [0, 7])
def test_derivatives(k: int) -> None:
    """Against central differences of what is exact to rounding."""
    system, x, u = pulled()
    h = 1e-5
    nx = system.nx
    z = np.random.default_rng(k).normal(size=nx)
    whole = system.linearize(x, u)
    A, B = system.derivatives(x[k], u[k], k)
    np.testing.assert_allclose(whole.A[k], A, atol=1e-12)
    np.testing.assert_allclose(whole.B[k], B, atol=1e-12)

    def at(y: np.ndarray) -> np.ndarray:
        return system.f(y[:nx], y[nx:], k)

    def slope(y: np.ndarray) -> np.ndarray:
        A, B = system.derivatives(y[:nx], y[nx:], k)
        return np.concatenate([z @ A, z @ B])

    y = np.concatenate([x[k], u[k]])
    steps = h * np.eye(len(y))
    first = np.stack([(at(y + e) - at(y - e)) / (2.0 * h) for e in steps], axis=1)
    np.testing.assert_allclose(np.hstack([A, B]), first, atol=1e-7)
    second = np.stack([(slope(y + e) - slope(y - e)) / (2.0 * h) for e in steps], axis=1)
    H = system.curvature(x[k], u[k], k, z)
    np.testing.assert_allclose(H, second, atol=1e-6)
    weights = np.zeros((31, nx))
    weights[k + 1] = z
    np.testing.assert_allclose(whole.curvature(weights)[k], H, atol=1e-12)


def test_a_roll_out_is_that_of_single_steps_and_tells_of_failure() -> None:
    system, x, u = pulled()
    K = 0.1 * np.random.default_rng(1).normal(size=(30, 7, 14))
    fed = system.rollout(x[4] + 1e-3, x, u, K, 4, 9)
    assert fed.complete
    state = x[4] + 1e-3
    for k in range(4, 9):
        state = system.f(state, u[k] - K[k] @ (state - x[k]), k)
    np.testing.assert_allclose(fed.x[-1], state, atol=1e-12)
    wild = u.copy()
    wild[3, 0] = np.inf
    cut = system.rollout(x[0], x, wild, 0.0 * K, 0, 30)
    assert (cut.steps_done, cut.complete) == (3, False)
    assert "step 3 at t = 0.03 s" in str(cut.failure)


def test_what_it_refuses() -> None:
    arm = by_tension().integrator.mechanism
    with pytest.raises(ArgumentError, match=r"at_instants: .*T3"):
        PulledSystem(MidpointVI(arm), T, at_instants=["T3"])
    held = arm.with_elements([Distance("elbow", "hand", 0.3, name="rod")])
    with pytest.raises(ArgumentError, match="has 1 constraints, expected none"):
        PulledSystem(MidpointVI(held), T, at_instants=["T1"])
    plain = MidpointSystem(MidpointVI(arm), T)
    assert plain.nu == by_tension().nu
