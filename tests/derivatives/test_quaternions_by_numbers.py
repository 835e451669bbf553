"""Exact second derivatives of steps by numbers and the final time beside quaternions: against differences."""

from __future__ import annotations

import numpy as np
import pytest

from derivatives.differences import extrapolated
from derivatives.test_prescribed_rotations import CASES, carried
from derivatives.test_quaternions import AT_JOINTS, FORCES, ROD, WRENCH, tumbling, turned
from leastaction.mechanics import JointSpring, Mechanism, MidpointVI, project_velocity
from leastaction.numerics.arrays import Array
from leastaction.optimal.discrete.system import derivatives_by
from leastaction.optimal.system import FINAL_TIME
from leastaction.systems import MidpointSystem


def floating(rng: np.random.Generator) -> tuple[Mechanism, Array]:
    """Return what floats on a rod, and a configuration on it."""
    m = tumbling(ROD, *FORCES, WRENCH, *AT_JOINTS)
    q = turned(m, rng)
    apart = np.diff(m.positions(q, ("toe", "hand")), axis=0)
    return m.with_parameters({"rod.length": float(np.linalg.norm(apart))}), q


def on_a_bar(rng: np.random.Generator) -> tuple[Mechanism, Array]:
    """Return what hangs on a bar that is turned, with a body that is pinned to it."""
    m = carried(*CASES["all"], JointSpring("hip.wy", 0.5, 0.1))
    q = turned(m, rng)
    x = m.coordinates.index("beside.x")
    q[x : x + 3] -= (m.positions(q, ("eye",)) - m.positions(q, ("tip",)))[0]
    return m, q


@pytest.mark.parametrize("case", [floating, on_a_bar])
def test_they_are_those_of_differences(case) -> None:
    rng = np.random.default_rng(11)
    m, q = case(rng)
    v = project_velocity(m, q, rng.standard_normal(m.nv), hold=list(m.kinematic)).v
    system = MidpointSystem(MidpointVI(m, tolerance=1e-15), [0.0, 0.05])
    u = 0.2 * rng.standard_normal((1, system.nu))
    run = system.integrator.core.roll_out(system.t, system.integrator.start(q, v).x, None, u, None)
    names = [name for name in m.parameters if m.slots_of_elements(m.members_of([name])[0]) is not None]
    names = [name for name in names if not name.startswith("gravity")]
    z = rng.standard_normal((1, m.ndx))
    found = system.curvature_by_parameters(run.x, u, z, names)
    assert found is not None
    assert found.shape == (1, len(names), m.ndx + system.nu + len(names))

    def slopes(values: Array) -> Array:
        """Return ``z . D f`` of the step at other numbers, in the chart about where the step itself led."""
        near = system.with_parameters_near(dict(zip(names, values.tolist(), strict=True)))
        ends = near.step_each(run.x, u).x
        A, B = near.linearize_each(run.x, u, ends)
        by = derivatives_by(near, np.concatenate([run.x[:1], ends]), u, names)
        read = z[0] @ system.space.difference_derivative(ends, run.x[1:])[0]
        return np.concatenate([read @ A[0], read @ B[0], read @ by[0]])

    at = np.array([m.parameters[name] for name in names])
    for j, name in enumerate(names):
        h = 3e-4 * max(0.1, abs(at[j])) * np.eye(len(names))[j]
        wanted = (8.0 * (slopes(at + h) - slopes(at - h)) - slopes(at + 2 * h) + slopes(at - 2 * h)) / (12.0 * h[j])
        # As good as differences of four places are.
        assert np.abs(found[0, j] - wanted).max() < 1e-7 * max(0.1, np.abs(wanted).max()), name


@pytest.mark.parametrize("multipliers", [False, True])
@pytest.mark.parametrize("at_instants", [False, True])
@pytest.mark.parametrize("case", [floating, on_a_bar])
def test_by_the_final_time_they_are_those_of_differences(case, at_instants: bool, multipliers: bool) -> None:
    rng = np.random.default_rng(7)
    m, q = case(rng)
    v = project_velocity(m, q, rng.standard_normal(m.nv), hold=list(m.kinematic)).v
    vi = MidpointVI(m, tolerance=1e-15, at_instants=m.inputs if at_instants else ())
    system = MidpointSystem(vi, [0.0, 0.06], multipliers=multipliers)
    u = 0.2 * rng.standard_normal((1, system.nu))
    x = np.zeros(system.nx)
    x[: m.nx] = vi.start(q, v).x
    x = np.array([x, system.f(x, u[0], 0)])
    z = rng.standard_normal((1, system.ndx))
    found = system.curvature_by_final_time(x, u, z)[0]
    np.testing.assert_allclose(found[:-1, :-1], system.curvature(x[0], u[0], 0, z[0]), atol=1e-11)

    def slopes(end: float) -> Array:
        """Return ``z . D f`` of a step of another length, in the chart about where the step itself led."""
        other = system.with_parameters({FINAL_TIME: end})
        ends = other.step_each(x, u).x
        near = other.linearize_each(x, u, ends)
        by = derivatives_by(other, np.concatenate([x[:1], ends]), u, [FINAL_TIME])
        read = z[0] @ system.space.difference_derivative(ends, x[1:])[0]
        return np.concatenate([read @ near.A[0], read @ near.B[0], read @ by[0]])

    wanted = extrapolated(slopes, 0.06, 0.005)
    assert np.abs(wanted).max() > 1.0
    np.testing.assert_allclose(found[-1], wanted, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_array_equal(found[-1], found[:, -1])
