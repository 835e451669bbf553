"""Expressions that change with the time.

Held against a twin whose prescribed variable is the time, a closed form, and the balance of energy.
"""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    ContinuousDynamics,
    FinalTime,
    Gravity,
    Mechanism,
    MechanismSystem,
    MidpointSystem,
    MidpointVI,
    project_configuration,
    project_velocity,
    ry,
    simulate,
    tx,
    tz,
)
from leastaction.control import simulate_many
from leastaction.elements import ExpressionConstraint, ExpressionForce, ExpressionPotential
from leastaction.expressions import distance, input_, parameter, point, rate, speed, time, variable

sympy = pytest.importorskip("sympy")

BODY = {"mass": 1.0, "com": (0.1, 0.0, -0.4), "inertia": (0.1, 0.2, 0.15)}
T = np.linspace(0.3, 0.8, 26)


def elements(now) -> list:
    """A potential and a force of two coordinates that change with the time."""
    k = parameter("k", 3.0)
    pull = ExpressionPotential(
        k * (point("tip")[0] - 0.4 * sympy.sin(5.0 * now) ** 3) ** 2 * (1.0 + now**2), name="pull"
    )
    push = ExpressionForce(
        input_("drive") * sympy.cos(3.0 * now) - parameter("c", 0.3) * now * speed("b") * distance("tip", "far") ** 2,
        "b",
        name="push",
    )
    far = distance("tip", "far") * (1.0 + now**2)
    along = ExpressionForce(sympy.exp(-now) * rate(far), distance("tip", "far") - now * variable("a"), name="along")
    return [Gravity(), pull, push, along]


def moving(now) -> ExpressionConstraint:
    """A constraint that changes with the time."""
    swing = parameter("swing", 0.08) * sympy.sin(4.0 * now) * (1.0 + variable("b") / 2)
    return ExpressionConstraint(point("tip")[0] - point("Q")[0] - swing, name="hold")


def tree(*, clock: bool, loop: bool) -> list:
    arm = [ry("a", **BODY), [tz(-0.5), [ry("b", **BODY), [tz(-0.6, name="tip")]]]]
    rest = [tx(1.2, name="far"), *([tx("clock", kinematic=True, name="clock")] if clock else [])]
    return [*arm, *rest, *([ry("c", **BODY), [tz(-0.7, name="Q")]] if loop else [])]


def pair(*, loop: bool = False) -> tuple[Mechanism, Mechanism]:
    """The mechanism, and its twin whose last variable is the time."""
    clock = variable("clock")
    of_time = Mechanism(tree(clock=False, loop=loop), [*elements(time()), *([moving(time())] if loop else [])])
    twin = Mechanism(tree(clock=True, loop=loop), [*elements(clock), *([moving(clock)] if loop else [])])
    assert twin.kinematic == ("clock",)
    return of_time, twin


def start_of(m: Mechanism, t: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """A configuration and a velocity, which a constraint that moves asks for."""
    now = m.at_time(t)
    q = project_configuration(now, [0.4, -0.3, 0.2][: m.nd]).q
    return q, project_velocity(now, q, np.zeros(m.nv)).v


@pytest.fixture(scope="module", params=[False, True], ids=["tree", "loop"])
def runs(request):
    """Runs of both, at steps of different lengths."""
    m, twin = pair(loop=request.param)
    t, u = np.cumsum(np.concatenate(([0.3], np.tile([0.01, 0.03], 12)))), np.linspace(1.0, -2.0, 24)
    vi, other = MidpointVI(m), MidpointVI(twin)
    q, v = start_of(m)
    run = vi.simulate(vi.start(q, v, t=0.3), t, inputs=u)
    begin = other.start(np.append(q, 0.3), np.append(v, 1.0), t=0.3)
    same = other.simulate(begin, t, inputs=u, rho=lambda now: [now])
    return run, same, vi, other


def places(run, twin) -> np.ndarray:
    """Where the entries of a state stand among those of the twin."""
    m, n = run.mechanism, twin.mechanism.nq
    return np.concatenate([np.arange(m.nq), n + np.arange(m.nd)])


def test_steps_are_those_of_the_twin(runs) -> None:
    run, same, *_ = runs
    assert run.status.name == "COMPLETED"
    assert np.abs(np.diff(run.q, axis=0)).max() > 0.02
    assert run.x == pytest.approx(same.x[:, places(run, same)], abs=1e-12)
    assert run.lam == pytest.approx(same.lam, abs=1e-11)
    assert run.energy().total == pytest.approx(same.energy().total, abs=1e-11)
    # The twin's work is what moves its clock.
    assert run.balance.residual == pytest.approx(same.balance.residual, abs=2e-3 * run.balance.scale)
    assert run.balance.swing < 0.02 * np.ptp(run.energy().total)


def test_derivatives_of_steps_are_those_of_the_twin(runs) -> None:
    run, same, vi, other = runs
    at, m = places(run, same), run.mechanism
    mine, theirs = vi.linearize(run), other.linearize(same)
    np.testing.assert_allclose(mine.A, theirs.A[:, at][:, :, at], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(mine.B, theirs.B[:, at, : m.n_inputs], rtol=1e-9, atol=1e-10)
    z = np.random.default_rng(0).normal(size=(run.steps, m.nx))
    weights = np.zeros((run.steps, same.mechanism.nx))
    weights[:, at] = z
    order = np.concatenate([at, same.mechanism.nx + np.arange(m.n_inputs)])
    assert vi.curvature(run, mine, z) == pytest.approx(
        other.curvature(same, theirs, weights)[:, order][:, :, order], abs=1e-8
    )
    names = ["pull.k", "push.c"]
    by, by_theirs = vi.differentiate_by(run, names), other.differentiate_by(same, names)
    assert by.x == pytest.approx(by_theirs.x[:, at], abs=1e-10)


def test_derivatives_by_the_final_time(runs) -> None:
    run, _, vi, _ = runs
    system = MidpointSystem(vi, run.t)
    by = system.differentiate_by(run.x, run.u, [FinalTime().name])[:, :, 0]
    h, end = 1e-5, run.t[-1]
    for k in (0, 7, 23):
        ahead, behind = (
            system.with_parameters({FinalTime().name: end + way}).f(run.x[k], run.u[k], k) for way in (h, -h)
        )
        assert by[k] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)
    _, slopes = system.linearize_by(run.x, run.u, [FinalTime().name])
    assert slopes[:, :, 0] == pytest.approx(by, abs=1e-12)


@pytest.mark.parametrize("loop", [False, True], ids=["tree", "loop"])
def test_continuous_time_is_that_of_the_twin(*, loop: bool) -> None:
    m, twin = pair(loop=loop)
    # Off the constraint, which stabilisation sees.
    mine, theirs = (ContinuousDynamics(of, constraint_damping=3.0, constraint_stiffness=7.0) for of in (m, twin))
    rng, n = np.random.default_rng(1), m.nd
    q, v, u, t = rng.normal(size=(4, n)), rng.normal(size=(4, n)), rng.normal(size=(4, 1)), rng.uniform(0.0, 2.0, 4)
    Q, V = np.column_stack([q, t]), np.column_stack([v, np.ones(4)])
    found, of_twin = mine.accelerations(q, v, u, t=t), theirs.accelerations(Q, V, u)
    a = found.a
    assert a == pytest.approx(of_twin.a, abs=1e-11)
    assert found.lam == pytest.approx(of_twin.lam, abs=1e-11)
    assert np.abs(a - mine.accelerations(q, v, u).a).max() > 0.1
    d, e = mine.linearize(q, v, u, t=t), theirs.linearize(Q, V, u)
    for name in ("a_dq", "a_dv", "lam_dq", "lam_dv"):
        assert getattr(d, name) == pytest.approx(getattr(e, name)[:, :, :n], abs=1e-10), name
    z, w = rng.normal(size=(4, n)), rng.normal(size=(4, m.nc))
    order = [*range(n), *range(n + 1, 2 * n + 1), 2 * n + 2]
    bent = theirs.curvature(Q, V, u, z_a=z, z_lam=w)[:, order][:, :, order]
    assert mine.curvature(q, v, u, t=t, z_a=z, z_lam=w) == pytest.approx(bent, abs=1e-8)
    assert not MechanismSystem(m).autonomous
    assert MechanismSystem(twin).autonomous
    assert mine.inverse_dynamics(q, v, a, found.lam, u=u, t=t) == pytest.approx(np.zeros((4, n)), abs=1e-11)


def test_the_rate_of_what_depends_on_the_time_alone() -> None:
    mass = Mechanism([tx("x", mass=1.0)], [ExpressionForce(rate(time() ** 2) + rate(parameter("k", 3.0)), "x")])
    assert simulate(mass, [0.0], None, [0.0, 1.0], rtol=1e-10)["x"][-1] == pytest.approx(1.0 / 3.0)


def test_a_closed_form_and_the_order() -> None:
    swing = Mechanism([tx("x", mass=2.0)], [ExpressionPotential(-6.0 * variable("x") * sympy.cos(4.0 * time()))])
    t = np.linspace(0.0, 2.0, 51)
    exact = 3.0 * (1.0 - np.cos(4.0 * t)) / 16.0
    run = simulate(swing, [0.0], None, t, rtol=1e-10, atol=1e-12)
    assert run["x"] == pytest.approx(exact, abs=1e-9)
    assert run.status.name == "COMPLETED"
    vi = MidpointVI(swing)
    errors = [
        np.abs(vi.simulate(vi.start([0.0]), np.linspace(0.0, 2.0, n + 1))["x"][:: n // 50] - exact).max()
        for n in (200, 400)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def test_many_at_once_know_the_time() -> None:
    m, _ = pair()
    vi = MidpointVI(m)
    begins = [vi.start(start_of(m)[0] + 0.01 * i, t=0.3) for i in range(9)]
    alone = vi.simulate(begins[4], T, inputs=[1.0])
    many = simulate_many(vi, np.array([begin.x for begin in begins]), T, [1.0])
    assert many.x[4] == pytest.approx(alone.x, abs=1e-10)


def test_it_is_kept_in_files_and_printed(tmp_path) -> None:
    m, _ = pair()
    m.save(tmp_path / "m.yaml")
    back = Mechanism.load(tmp_path / "m.yaml")
    assert "time()" in (tmp_path / "m.yaml").read_text(encoding="utf-8")
    assert "time()" in str(m)
    vi, other = MidpointVI(m), MidpointVI(back)
    q, _ = start_of(m)
    assert (vi.step(vi.start(q, t=1.0), 0.1).state.x == other.step(other.start(q, t=1.0), 0.1).state.x).all()
    assert np.abs(vi.step(vi.start(q, t=1.0), 0.1).state.x - vi.step(vi.start(q), 0.1).state.x).max() > 1e-3
