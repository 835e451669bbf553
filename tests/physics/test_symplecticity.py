"""The step of an unforced mechanism is symplectic and reversible."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space

from leastaction.mechanics import (
    Damping,
    MidpointVI,
    State,
    Trajectory,
    project_velocity,
)
from leastaction.models.chain import pendulum_chain
from leastaction.models.marionette import marionette, rest_pose
from physics.laws import (
    complete,
    floating_chain,
    in_motion,
    mass_on_string,
    swing,
    times,
)

SYMPLECTIC = 1e-10


def canonical(nd: int) -> np.ndarray:
    zero, one = np.zeros((nd, nd)), np.eye(nd)
    return np.block([[zero, one], [-one, zero]])


def canonical_rows(run: Trajectory) -> list[int]:
    """Return where [q dynamic; p] is in the state."""
    m = run.mechanism
    return [*range(m.nd), *range(m.nq, m.nq + m.nd)]


def violation(run: Trajectory) -> float:
    """Return the largest entry of A'JA - J, on shifts that keep the constraints at the step's start."""
    m = run.mechanism
    J, at = canonical(m.nd), canonical_rows(run)
    worst = 0.0
    for k, A in enumerate(MidpointVI(m, threads=1).linearize(run).A):
        along = np.eye(2 * m.nd)
        if m.nc:
            keeps = null_space(m.constraint_jacobian(run.q[k])[:, : m.nd])
            along = np.block(
                [
                    [keeps, np.zeros((m.nd, m.nd))],
                    [np.zeros((m.nd, keeps.shape[1])), np.eye(m.nd)],
                ]
            )
        step = A[np.ix_(at, at)] @ along
        size = np.abs(step.T) @ np.abs(J) @ np.abs(step)
        worst = max(worst, float(np.abs(step.T @ J @ step - along.T @ J @ along).max() / size.max()))
    return worst


UNEVEN = np.cumsum([0.0, *np.tile([0.01, 0.003, 0.02, 0.007], 10)])


@pytest.mark.parametrize("build", [floating_chain, lambda: pendulum_chain(6)])
def test_unconstrained(build) -> None:
    m = build()
    run = swing(m, *in_motion(m, 1), UNEVEN)
    assert violation(run) < SYMPLECTIC


def test_constrained() -> None:
    run = swing(mass_on_string(length=1.5), [0.9, -1.2], [0.8, 0.6], UNEVEN)
    assert violation(run) < SYMPLECTIC


def test_marionette_without_damping() -> None:
    m = marionette(damping=0.0)
    q = rest_pose(m)
    v = project_velocity(m, q, 0.3 * np.random.default_rng(1).standard_normal(m.nq)).v
    v[m.nd :] = 0.0
    v = project_velocity(m, q, v).v
    assert violation(swing(m, q, v, times(0.2, 20))) < SYMPLECTIC


def test_damping_is_not_symplectic() -> None:
    m = floating_chain(elements=[Damping(0.1)])
    assert violation(swing(m, *in_motion(m, 1), UNEVEN)) > 1e-5


def backwards(run: Trajectory) -> State:
    """Return the last state with all velocities turned round."""
    end = run.last
    return State(0.0, end.q, -end.p, -end.v_rho)


@pytest.mark.parametrize("build", [floating_chain, lambda: pendulum_chain(6)])
def test_time_can_be_turned_round(build) -> None:
    m = build()
    run = swing(m, *in_motion(m, 2), UNEVEN)
    vi = MidpointVI(m)
    back = complete(vi.simulate(backwards(run), UNEVEN[-1] - UNEVEN[::-1]))
    assert np.abs(back.q - run.q[::-1]).max() < 1e-9
    assert np.abs(back.p + run.p[::-1]).max() < 1e-9
    assert np.ptp(run.q, axis=0).max() > 0.1


def test_time_can_be_turned_round_with_prescribed_strings() -> None:
    """On constraints too; the impulse of the strings at a node belongs to the step that leaves it."""
    m = marionette(damping=0.0)
    q, t = rest_pose(m), times(0.3, 30)
    rho = np.tile(q[m.nd :], (31, 1)) + 0.05 * (1 - np.cos(4 * t))[:, None]
    run = swing(m, q, np.zeros(m.nq), t, rho=rho)
    back = complete(MidpointVI(m).simulate(backwards(run), t, rho=rho[::-1]))
    assert np.abs(back.q - run.q[::-1]).max() < 1e-8
    for k in range(1, 30):
        kick = m.constraint_jacobian(run.q[k])[:, : m.nd].T @ run.lam[k]
        assert np.abs(back.p[30 - k] + (run.p[k] - kick)).max() < 1e-7
