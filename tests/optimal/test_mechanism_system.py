"""The bridge: a mechanism under its integrator is a system like any other to the optimiser."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from leastaction import (
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    QuadraticCost,
    optimize,
    project_configuration,
    rx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError, StepError
from leastaction.optimal import check_derivatives
from leastaction.optimal.discrete.descent import escape
from leastaction.optimal.discrete.hessians import ModelHessian
from leastaction.optimal.discrete.linear_quadratic import Workspace, unpacked
from optimal.systems import crane

Motion = tuple[MidpointSystem, np.ndarray, np.ndarray]


def crane_motion(split: str = "symmetric") -> Motion:
    """Return the crane as a system, and a motion of it."""
    mechanism, q = crane()
    vi = MidpointVI(mechanism, split=split)
    t = np.linspace(0.0, 0.2, 21)
    run = vi.simulate(
        vi.start(q),
        t,
        inputs=lambda s: [3.0 * np.sin(9 * s)],
        rho=lambda s: q[mechanism.nd :] + np.array([0.1, -0.2]) * s,
    )
    return MidpointSystem(vi, t), run.x, run.u


@pytest.mark.parametrize("split", ["symmetric", "left"])
@pytest.mark.parametrize("multipliers", [False, True])
def test_derivatives_of_the_system(split: str, multipliers: bool) -> None:
    system, x, u = crane_motion(split)
    if multipliers:
        system = MidpointSystem(system.integrator, system.t, multipliers=True)
        x = system.rollout(
            np.append(x[0], 0.0),
            np.hstack([x, np.zeros((len(x), 1))]),
            u,
            np.zeros((system.N, system.nu, system.nx)),
            0,
            system.N,
        ).x
    report = check_derivatives(system, x, u, tolerance=1e-5)
    assert report.ok, report.errors


def mimicked() -> Motion:
    """Return a mechanism whose first variable moves a frame without mass first, and masses after another's, moving."""
    mechanism = Mechanism(
        [
            rx("b"), [tz(-0.3, name="pointer")],
            tz(2.0), [rx("a"), [tz(-1.0, mass=1.0), [rx("b"), [tz(-0.5, name="tip", mass=1.0)]]]],
            ty(0.5), [tz("post", name="post", kinematic=True)],
        ],
        [Gravity(), JointForce("b", "motor"), Distance("tip", "post", "length", name="string")],
    )  # fmt: skip
    q = project_configuration(mechanism, mechanism.configuration({"a": 0.3, "b": 0.4, "post": 1.0, "length": 1.0})).q
    vi = MidpointVI(mechanism)
    t = np.linspace(0.0, 0.2, 21)
    run = vi.simulate(
        vi.start(q), t, inputs=lambda s: [np.sin(9 * s)], rho=lambda s: q[mechanism.nd :] + np.array([0.1, -0.2]) * s
    )
    return MidpointSystem(vi, t), run.x, run.u


@pytest.mark.parametrize("motion", [crane_motion, mimicked])
@pytest.mark.parametrize("multipliers", [False, True])
def test_the_pattern_holds_all_that_is_not_zero(motion: Callable[[], Motion], multipliers: bool) -> None:
    plain, x, u = motion()
    system = MidpointSystem(plain.integrator, plain.t, multipliers=multipliers)
    if multipliers:
        x = np.hstack([x, np.zeros((len(x), system.nx - plain.nx))])
    found = system.linearize(x, u)
    assert found.pattern is not None
    seen = np.any(np.concatenate([found.A, found.B], axis=2) != 0.0, axis=0)
    assert not np.any(seen & ~found.pattern)
    assert np.mean(seen == found.pattern) > 0.9  # the twist does not couple with everything
    z = np.random.default_rng(0).normal(size=(system.N, system.nx))
    np.testing.assert_array_equal(unpacked(found.packed_curvature(z), found.pattern), found.curvature(z))


@pytest.mark.parametrize("motion", [crane_motion, mimicked])
def test_negative_curvature_is_found_in_packed_hessians(motion: Callable[[], Motion]) -> None:
    system, x, u = motion()
    cost = QuadraticCost(np.ones_like(x), np.zeros_like(u), Q=np.ones(system.nx), R=np.full(system.nu, 0.1))
    weights, gradient = ModelHessian.of(cost.hessian(x, u)), cost.gradient(x, u)
    known = system.linearize(x, u)
    z = 1e4 * np.random.default_rng(0).normal(size=(system.N, system.nx))
    found = [
        escape(lin, gradient, lambda _: weights, H, Workspace(system.N, system.nx, system.nu), 0.0)
        for lin, H in (
            (known, known.packed_curvature(z)),
            (dataclasses.replace(known, pattern=None), known.curvature(z)),
        )
    ]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0][3] < 0.0
    assert found[0][2:] == pytest.approx(found[1][2:], rel=1e-9)


def test_whole_trajectories_agree_with_single_steps() -> None:
    system, x, u = crane_motion()
    linearized = system.linearize(x, u)
    z = np.random.default_rng(1).normal(size=x.shape)
    hessians = system.curvatures(x, u, z)
    for k in (0, 7, system.N - 1):
        np.testing.assert_allclose(system.f(x[k], u[k], k), x[k + 1], atol=1e-10)
        A, B = system.derivatives(x[k], u[k], k)
        np.testing.assert_allclose(linearized.A[k], A, atol=1e-9 * np.abs(A).max())
        np.testing.assert_allclose(linearized.B[k], B, atol=1e-9 * np.abs(B).max())
        H = system.curvature(x[k], u[k], k, z[k + 1])
        np.testing.assert_allclose(hessians[k], H, atol=1e-8 * np.abs(H).max())


def test_states_along_a_motion_are_those_of_a_run() -> None:
    plain, x, _ = crane_motion()
    m = plain.mechanism
    q, p, v_rho = np.split(x, [m.nq, m.nq + m.nd], axis=1)
    np.testing.assert_allclose(plain.states_along(q, p, v_rho[0]), x, atol=1e-12)
    more = MidpointSystem(plain.integrator, plain.t, multipliers=True).states_along(q, p)
    np.testing.assert_allclose(more[1:, : m.nx], x[1:], atol=1e-12)
    assert not more[0, m.nq + m.nd :].any()
    assert not more[:, m.nx :].any()
    for wrong, message in (
        ((q[:5], p), r"q: got shape \(5, 6\), expected \(21, 6\), that is \(N\+1, nq\)"),
        ((q, p[:, :2]), r"p: got shape \(21, 2\), expected \(21, 4\)"),
        ((q, p, v_rho), r"v_rho: got shape \(21, 2\), expected \(2,\)"),
    ):
        with pytest.raises(ArgumentError, match=message):
            plain.states_along(*wrong)


def test_appended_multipliers_are_those_of_the_step() -> None:
    plain, x, u = crane_motion()
    system = MidpointSystem(plain.integrator, plain.t, multipliers=True)
    start = np.append(x[0], 7.0)
    K = np.zeros((system.N, system.nu, system.nx))
    run = system.rollout(start, np.tile(start, (system.N + 1, 1)), u, K, 0, system.N)
    trajectory = system.trajectory(run.x, run.u)
    assert run.x[0, -1] == 7.0  # the start's own; nothing led to it
    np.testing.assert_allclose(run.x[1:, -1], trajectory["string"], rtol=1e-9)
    assert np.abs(trajectory["string"]).min() > 1e-3


def test_a_step_without_solution_is_named() -> None:
    system, x, u = crane_motion()
    far = u[0].copy()
    far[-1] = 1e-3  # a string that cannot reach
    with pytest.raises(StepError, match="t = 0 s") as caught:
        system.f(x[0], far, 0)
    assert "constraint 'string'" in caught.value.residuals
    ubar = u.copy()
    ubar[4, -1] = 1e-3
    K = np.zeros((system.N, system.nu, system.nx))
    run = system.rollout(x[0], x, ubar, K, 0, system.N)
    assert run.steps_done == 4
    assert run.failure is not None
    assert "step 4" in run.failure


def test_newton_tail_on_a_mechanism() -> None:
    system, x, u = crane_motion()
    wanted = x.copy()
    wanted[:, 0] += 0.5 * np.sin(15 * system.t)
    cost = QuadraticCost(wanted, u, Q=np.r_[np.full(6, 10.0), np.full(6, 1e-3)], R=np.full(system.nu, 1e-2))
    result = optimize(system, cost, initial=(x, u), method="newton", tolerance=1e-17, absolute_tolerance=0.0)
    assert result.success
    decrease = np.asarray(result.history.expected_decrease)
    assert result.history.method[-3:] == ("newton",) * 3
    # Each expected decrease falls with the square of the one before.
    assert decrease[-2] < 1e3 * decrease[-3] ** 2
    assert decrease[-1] < 1e3 * decrease[-2] ** 2


def test_times_must_increase() -> None:
    system, _, _ = crane_motion()
    with pytest.raises(ArgumentError, match="must increase"):
        MidpointSystem(system.integrator, [0.0, 0.1, 0.1])


def test_a_start_is_a_state_and_inputs_by_name_as_well() -> None:
    mechanism, q = crane()
    vi = MidpointVI(mechanism)
    start, t = vi.start(q), np.linspace(0.0, 0.1, 11)
    winch, length = (float(q[mechanism.variables.index(name)]) for name in ("winch", "length"))
    by_name, by_place = {"length": length, "winch": winch}, np.zeros((10, 3))
    for multipliers in (False, True):
        system = MidpointSystem(vi, t, multipliers=multipliers)
        for name, value in by_name.items():
            by_place[:, system.input_names.index(name)] = value
        x = np.append(start.x, [0.0] * multipliers)
        cost = QuadraticCost(x, by_place, Q=np.ones(system.nx), R=np.ones(3))
        expected = optimize(system, cost, initial=(x, by_place))
        for initial in ((start, by_name), (start.x, by_place[0]), (x, by_name)):
            np.testing.assert_array_equal(optimize(system, cost, initial=initial).x, expected.x)
    with pytest.raises(ArgumentError, match=r"initial u: unknown name 'lenght'; did you mean 'length'"):
        optimize(system, cost, initial=(start, {"lenght": 1.0}))
    with pytest.raises(ArgumentError, match=r"initial u: got shape \(2,\), expected \(10, 3\) or \(3,\)"):
        optimize(system, cost, initial=(start, [0.0, 1.0]))
