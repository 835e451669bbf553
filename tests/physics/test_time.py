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
    PointToPoint,
    ry,
    simulate,
    tx,
    tz,
)
from leastaction.control import simulate_many
from leastaction.elements import ExpressionConstraint, ExpressionForce, ExpressionPotential
from leastaction.errors import DescriptionError
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
    along = ExpressionForce(sympy.exp(-now) * rate(distance("tip", "far")), distance("tip", "far"), name="along")
    return [Gravity(), pull, push, along]


def tree(*, clock: bool, loop: bool) -> list:
    arm = [ry("a", **BODY), [tz(-0.5), [ry("b", **BODY), [tz(-0.6, name="tip")]]]]
    rest = [tx(1.2, name="far"), *([tx("clock", kinematic=True, name="clock")] if clock else [])]
    return [*arm, *rest, *([ry("c", **BODY), [tz(-0.7, name="Q")]] if loop else [])]


def pair(*, loop: bool = False) -> tuple[Mechanism, Mechanism]:
    """The mechanism, and its twin whose last variable is the time."""
    hold = [PointToPoint("tip", "Q", axes="x", name="hold")] if loop else []
    of_time = Mechanism(tree(clock=False, loop=loop), [*elements(time()), *hold])
    twin = Mechanism(tree(clock=True, loop=loop), [*elements(variable("clock")), *hold])
    assert twin.kinematic == ("clock",)
    return of_time, twin


def start_of(m: Mechanism) -> np.ndarray:
    return (
        np.array([0.4, -0.3])
        if m.nd == 2
        else np.array([0.4, -0.3, np.arcsin((0.5 * np.sin(0.4) + 0.6 * np.sin(0.1)) / 0.7)])
    )


@pytest.fixture(scope="module", params=[False, True], ids=["tree", "loop"])
def runs(request):
    """Runs of both, at steps of different lengths."""
    m, twin = pair(loop=request.param)
    t, u = np.cumsum(np.concatenate(([0.3], np.tile([0.01, 0.03], 12)))), np.linspace(1.0, -2.0, 24)
    vi, other = MidpointVI(m), MidpointVI(twin)
    q = start_of(m)
    run = vi.simulate(vi.start(q, t=0.3), t, inputs=u)
    begin = other.start(np.append(q, 0.3), t=0.3)
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


def test_continuous_time_is_that_of_the_twin() -> None:
    m, twin = pair()
    mine, theirs = ContinuousDynamics(m), ContinuousDynamics(twin)
    rng = np.random.default_rng(1)
    q, v, u, t = rng.normal(size=(4, 2)), rng.normal(size=(4, 2)), rng.normal(size=(4, 1)), rng.uniform(0.0, 2.0, 4)
    Q, V = np.column_stack([q, t]), np.column_stack([v, np.ones(4)])
    a = mine.accelerations(q, v, u, t=t).a
    assert a == pytest.approx(theirs.accelerations(Q, V, u).a, abs=1e-12)
    assert np.abs(a - mine.accelerations(q, v, u).a).max() > 0.1
    d, e = mine.linearize(q, v, u, t=t), theirs.linearize(Q, V, u)
    assert d.a_dq == pytest.approx(e.a_dq[:, :, :2], abs=1e-12)
    assert d.a_dv == pytest.approx(e.a_dv[:, :, :2], abs=1e-12)
    z = rng.normal(size=(4, 2))
    order = [0, 1, 3, 4, 6]
    of_twin = theirs.curvature(Q, V, u, z_a=z)[:, order][:, :, order]
    assert mine.curvature(q, v, u, t=t, z_a=z) == pytest.approx(of_twin, abs=1e-10)
    assert not MechanismSystem(m).autonomous
    assert MechanismSystem(twin).autonomous
    assert mine.inverse_dynamics(q, v, a, u=u, t=t) == pytest.approx(np.zeros((4, 2)), abs=1e-12)


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
    begins = [vi.start(start_of(m) + 0.01 * i, t=0.3) for i in range(9)]
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
    q = start_of(m)
    assert (vi.step(vi.start(q, t=1.0), 0.1).state.x == other.step(other.start(q, t=1.0), 0.1).state.x).all()
    assert np.abs(vi.step(vi.start(q, t=1.0), 0.1).state.x - vi.step(vi.start(q), 0.1).state.x).max() > 1e-3


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: ExpressionConstraint(variable("a") - time()),
        lambda: ExpressionForce(1.0, time() * variable("a")),
        lambda: ExpressionForce(rate(time() * variable("a")), "a"),
    ],
)
def test_where_the_time_may_not_occur(wrong) -> None:
    with pytest.raises(DescriptionError, match="the time occurs where only the configuration may"):
        wrong()
