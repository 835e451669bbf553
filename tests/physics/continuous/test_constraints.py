"""Constraints in continuous time: projection, Baumgarte's stabilisation, drift without either."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from leastaction.errors import InconsistentStartError
from leastaction.mechanics import Body, Gravity, Mechanism, PointToPoint, world
from leastaction.mechanics.continuous.dynamics import ContinuousDynamics
from leastaction.mechanics.continuous.simulation import simulate
from leastaction.mechanics.continuous.stabilisation import Baumgarte, Projection, project
from leastaction.mechanics.continuous.trajectory import ContinuousTrajectory, IntegrationStatus
from leastaction.models import bricard, four_bars
from physics.laws import mass_on_string, pendulum, times

G = 9.81
LINK = 1.0


def lift(segments: int) -> Mechanism:
    """Return a scissor lift that hangs from a fixed pivot and a slider: links of 1 m and 1 kg, slender rods.

    Left links start at the left ends of their segment, at angles below the x axis, right ones at the right ends.
    """
    rod = Body(1.0, com=(LINK / 2, 0.0, 0.0), inertia=(0.0, 1.0 / 12.0, 1.0 / 12.0))
    tree = world()
    ends = {"L": tree, "R": tree.tx("slider", bodies=[Body(0.5)])}
    for n in range(segments):
        turned = {side: end.ry(f"{side}{n}", bodies=[rod]) for side, end in ends.items()}
        for side, branch in turned.items():
            branch.tx(LINK / 2, name=f"middle_{side}{n}")
        # The left link ends where the right link of the next segment begins.
        ends = {
            "R": turned["L"].tx(LINK, name=f"end_L{n}"),
            "L": turned["R"].tx(LINK, name=f"end_R{n}"),
        }
    pins = [PointToPoint(f"middle_L{n}", f"middle_R{n}", "xz", name=f"pin{n}") for n in range(segments)]
    return Mechanism(tree, [Gravity((0.0, 0.0, -G)), *pins])


def lift_at(m: Mechanism, angle: float) -> np.ndarray:
    """Return the configuration in which the links are at an angle below the horizontal."""
    turn = np.pi - 2.0 * angle
    values = {"slider": LINK * np.cos(angle), "L0": angle, "R0": np.pi - angle}
    for name in m.variables:
        if name[1:] not in ("lider", "0"):
            values[name] = turn if name[0] == "R" else -turn
    return m.configuration(values)


def lift_angle(segments: int, start: float, t: np.ndarray) -> np.ndarray:
    """Return the angle by the equation of its one degree of freedom, from rest, to 1e-12.

    ``T = 1/2 J(a) a'^2`` with ``J = sum_n 2 (L^2/4 sin^2 + (n - 1/2)^2 L^2 cos^2 + L^2/12) + m_s L^2 sin^2``,
    ``V = -2 g L sin(a) sum_n (n - 1/2)``.
    """
    arms = np.arange(segments) + 0.5

    def rate(_: float, y: np.ndarray) -> list[float]:
        a, w = y
        s, c = np.sin(a), np.cos(a)
        J = np.sum(2.0 * (s**2 / 4.0 + arms**2 * c**2 + 1.0 / 12.0)) + 0.5 * s**2
        dJ = 2.0 * s * c * (np.sum(2.0 * (0.25 - arms**2)) + 0.5)
        return [w, (2.0 * G * c * arms.sum() - 0.5 * dJ * w**2) / J]

    out = solve_ivp(rate, (t[0], t[-1]), [start, 0.0], t_eval=t, method="DOP853", rtol=1e-12, atol=1e-12)
    return out.y[0]  # fmt: skip


def done(run: ContinuousTrajectory) -> ContinuousTrajectory:
    assert run.status is IntegrationStatus.COMPLETED, run.message
    return run


@pytest.mark.parametrize("constraints", ["project", Baumgarte(0.02), "none"])
def test_scissor_lift_moves_as_its_one_degree_of_freedom(constraints) -> None:
    m = lift(3)
    q0, t = lift_at(m, 0.6), times(1.4, 30)
    assert np.abs(m.constraint_values(q0)).max() < 1e-14
    run = done(simulate(m, q0, None, t, constraints=constraints, rtol=1e-9, atol=1e-10))
    np.testing.assert_allclose(run["L0"], lift_angle(3, 0.6, t), atol=1e-5)
    assert set(run.drift) == set(m.constraints)
    largest = max(d.h for d in run.drift.values())
    if constraints == "project":
        assert largest < 1e-13
        assert max(d.rate for d in run.drift.values()) < 1e-12
        assert np.abs(m.constraint_values(run.q)).max() < 1e-13
        between = run(np.linspace(0.0, 1.4, 77))
        assert np.abs(m.constraint_values(between[:, : m.nq])).max() < 1e-13
    else:
        assert 1e-12 < largest < 1e-5


def test_projection_passes_a_singular_configuration_time_and_again() -> None:
    # Upright links: there the pins of a segment leave it two ways to go on, and drift takes the wrong one.
    m, t = lift(3), times(6.0, 60)
    run = done(simulate(m, lift_at(m, 0.6), None, t, rtol=1e-9, atol=1e-10))
    assert np.sum(np.diff(np.sign(np.cos(run["L0"]))) != 0.0) > 3
    np.testing.assert_allclose(run["L0"], lift_angle(3, 0.6, t), atol=1e-3)


def test_projection_holds_for_long_where_the_bare_equations_drift_away() -> None:
    m = four_bars.four_bars(1)
    q0, v0 = four_bars.at_angle(m, 1.2, 0.5)
    t = times(30.0, 30)
    held, bare = (done(simulate(m, q0, v0, t, constraints=c, rtol=1e-6, atol=1e-7)) for c in ("project", "none"))
    largest = [max(d.h for d in run.drift.values()) for run in (held, bare)]
    assert largest[0] < 1e-13
    assert largest[1] > 1e4 * largest[0]
    # How wrong a run goes depends on which steps the solver takes, which rounding decides after a while.
    energy = held.energy().total
    assert np.abs(energy - energy[0]).max() < 1e-2


def test_redundant_constraints_are_projected_on() -> None:
    m = bricard.bricard()
    run = done(simulate(m, np.zeros(m.nq), None, times(1.0, 20), rtol=1e-7, atol=1e-8))
    assert m.constraint_rank(run.q[-1]) < m.nc
    assert max(d.h for d in run.drift.values()) < 1e-12
    energy = run.energy().total
    assert np.abs(run.q[-1]).max() > 0.1
    np.testing.assert_allclose(energy, energy[0], atol=1e-4)


@pytest.mark.parametrize("ratio", [1.0, 0.4])
def test_deviations_die_out_as_baumgarte_says(ratio: float) -> None:
    T = 0.05
    m, t = mass_on_string(length=1.0), times(0.5, 50)
    run = done(
        simulate(m, [0.6, -0.8001], [0.0, 0.0], t, constraints=Baumgarte(T, ratio), rtol=1e-11, atol=1e-13)
    )  # fmt: skip
    h = m.constraint_values(run.q)[:, 0]
    roots = np.roots([T**2, 2.0 * ratio * T, 1.0])
    if ratio == 1.0:
        wanted = (1.0 + t / T) * np.exp(-t / T)
    else:
        a, b = roots
        wanted = ((b * np.exp(a * t) - a * np.exp(b * t)) / (b - a)).real
    np.testing.assert_allclose(h / h[0], wanted, atol=1e-6)
    assert run.drift["string0"].h == pytest.approx(abs(h[0]))


def test_baumgartes_multipliers_and_accelerations_are_those_of_the_motion() -> None:
    m = mass_on_string(length=1.0)
    law = Baumgarte(0.1)
    run = done(simulate(m, [0.6, -0.79], None, times(0.2, 4), constraints=law, rtol=1e-10))
    for q, v, a, lam in zip(run.q, run.v, run.a, run.lam, strict=True):
        jacobian = m.constraint_jacobian(q)
        # M a = m g + Dh' lam, and h'' = Dh a + v' D2h v.
        np.testing.assert_allclose(2.0 * a, [0.0, -2.0 * G] + jacobian.T @ lam, atol=1e-9)
        second = jacobian @ a + v @ m.core.constraint_hessian(q, np.ones(1)) @ v
        wanted = -20.0 * (jacobian @ v) - 100.0 * m.constraint_values(q)
        np.testing.assert_allclose(second, wanted, atol=1e-8)


def test_projection_goes_the_shortest_way_in_the_metric_of_the_mass_matrix() -> None:
    m = four_bars.four_bars(1)
    q, v = four_bars.at_angle(m, 0.9, 1.0)
    off = q + 1e-5 * np.array([1.0, -2.0, 0.5])
    fast = v + np.array([0.3, 0.1, -0.2])
    near, speed = project(m, off, fast, 1e-10)
    assert np.abs(m.constraint_values(near)).max() < 1e-14
    jacobian, mass = m.constraint_jacobian(near), m.mass_matrix(near)
    assert np.abs(jacobian @ speed).max() < 1e-14
    free = np.linalg.svd(jacobian)[2][2:]  # the motion that the constraints leave
    assert np.abs(free @ mass @ (off - near)).max() < 1e-9
    assert np.abs(free @ mass @ (fast - speed)).max() < 1e-13


def test_projection_leaves_what_needs_none() -> None:
    m = pendulum()
    a, b = (simulate(m, [1.0], None, [0.0, 1.0], constraints=c) for c in ("project", "none"))
    assert np.array_equal(a.q, b.q)
    assert a.drift == {}


@pytest.mark.parametrize("method", ["Radau", "BDF", "LSODA"])
def test_implicit_methods_get_the_derivative_of_the_stabilised_equations(method: str) -> None:
    # Stiff: a time constant far below the motion. A wrong Jacobian would cost many more steps, or fail.
    m = four_bars.four_bars(1)
    q0, v0 = four_bars.at_angle(m, 1.2, 0.5)
    run = done(
        simulate(m, q0, v0, [0.0, 2.0], method=method, constraints=Baumgarte(1e-4), rtol=1e-5, atol=1e-7)
    )  # fmt: skip
    assert run.effort.jacobians > 0
    assert run.effort.steps < 600


def test_the_jacobian_is_exact() -> None:
    from leastaction.mechanics.continuous.equations import Equations
    from leastaction.mechanics.continuous.signals import Feedback, InputLaw, WholeInput

    m = mass_on_string()
    rng = np.random.default_rng(4)
    gain, x = rng.uniform(-1.0, 1.0, (1, 6)), rng.uniform(0.3, 1.0, 6)
    law = WholeInput([InputLaw(Feedback(gain, np.zeros(6), np.zeros(1)), times(1.0, 1), ["a"], "u")])
    baumgarte = Baumgarte(0.3, 0.7)
    dynamics = ContinuousDynamics(m, constraint_damping=baumgarte.damping, constraint_stiffness=baumgarte.stiffness)
    equations = Equations(dynamics, law, None, None)
    ours, size = equations.jacobian(0.0, x), 1e-6
    columns = [
        (equations.rate(0.0, x + size * e) - equations.rate(0.0, x - size * e)) / (2.0 * size) for e in np.eye(6)
    ]
    np.testing.assert_allclose(ours, np.array(columns).T, atol=2e-7 * np.abs(ours).max())
    assert np.abs(ours[5]).max() > 0.1, "the prescribed variable is fed back"


def test_starts_off_the_constraints() -> None:
    m = mass_on_string(length=1.0)
    for constraints in ("project", "none", Projection(1e-9)):
        with pytest.raises(InconsistentStartError, match="string0"):
            simulate(m, [0.6, -0.9], None, [0.0, 1.0], constraints=constraints)
        with pytest.raises(InconsistentStartError, match="rate of 'string0'"):
            simulate(m, [0.6, -0.8], [1.0, 1.0], [0.0, 1.0], constraints=constraints)
