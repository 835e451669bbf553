"""The functions of a step against the steps that the integrator makes, and against differences of the order below."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError
from leastaction.mechanics import (
    Damping,
    Distance,
    Drag,
    Gravity,
    JointForce,
    LinearSpring,
    Mechanism,
    MidpointVI,
    Trajectory,
    pose,
    project_configuration,
    revolute,
    rx,
    rz,
    screw,
    twist,
    tx,
    ty,
    tz,
    var,
)

DT, STEP = 0.01, 1e-5
HEAVY = {"mass": 0.7, "com": (0.1, -0.2, 0.3), "inertia": (0.3, 0.4, 0.5, 0.01, -0.02, 0.03)}


def mechanism(*, lift: bool = True) -> Mechanism:
    """Joints of every kind, a coupling, prescribed variables in the tree and on a string, forces of all sorts."""
    tree = [
        tz("lift", kinematic=lift, name="base", **HEAVY), [
            revolute("a", axis=(0.3, -1.2, 0.7), point=(0.2, 0.5, -0.4), **HEAVY), [
                pose(translation=(0.1, -0.2, 0.3)), [
                    screw("b", axis="-y", pitch=0.3, **HEAVY), [
                        twist("c", linear=(0.1, 0.2, -0.3), angular=(0.4, -0.5, 1.6), name="tip", **HEAVY)]],
            ],
            rx(0.5 * var("a") - var("d"), name="side", **HEAVY), [ty("d", mass=0.5), [rz("e", name="end", **HEAVY)]],
        ],
        tx("hand", kinematic=True, name="hand"),
    ]  # fmt: skip
    elements = [
        Gravity(),
        LinearSpring("hand", "end", stiffness=30.0, length=0.5, name="spring"),
        Damping(dict.fromkeys("abcde", 0.2), name="oil"),
        Drag("tip", 0.4, name="air"),
        JointForce("a", "torque", name="motor"),
        Distance("tip", "hand", "rope", name="rope"),
    ]
    names = ("lift", "hand", "rope") if lift else ("hand", "rope")
    return Mechanism(tree, elements, kinematic=names)


def a_run(split: str, steps: int = 12) -> tuple[MidpointVI, Trajectory]:
    m = mechanism()
    vi = MidpointVI(m, split=split, threads=1)
    rough = m.configuration({"a": 0.3, "b": -0.2, "c": 0.4, "d": 0.3, "e": 0.5, "hand": 0.9, "rope": 1.0})
    q0 = project_configuration(m, rough).q
    t = np.cumsum([0.0, *(DT * (1.0 + 0.3 * np.sin(np.arange(steps))))])
    rho = q0[m.nd :] + np.column_stack([0.05 * np.sin(7 * t), 0.1 * (1 - np.cos(5 * t)), 0.04 * np.sin(6 * t)])
    rng = np.random.default_rng(2)
    run = vi.simulate(vi.start(q0), t, inputs=rng.uniform(-2.0, 2.0, (steps, 1)), rho=rho)
    assert run.steps == steps, run.message
    assert np.abs(run.lam).max() > 1e-4
    return vi, run


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_they_are_what_the_steps_solve(split: str) -> None:
    vi, run = a_run(split)
    m = vi.mechanism
    for k in range(run.steps):
        q1, q2, u, h = run.q[k], run.q[k + 1], run.inputs[k], run.t[k + 1] - run.t[k]
        Ld = vi.discrete_lagrangian(q1, q2, h)
        fdm, fdp = vi.discrete_force(q1, q2, u, h)
        lines = run.p[k] + (Ld.by("q1") + fdm.value - m.constraint(q1).gradient.T @ run.lam[k])[: m.nd]
        np.testing.assert_allclose(lines, 0.0, atol=1e-11)
        np.testing.assert_allclose((Ld.by("q2") + fdp.value)[: m.nd], run.p[k + 1], atol=1e-11)
    assert np.any(fdp.value) == (split == "symmetric")


@pytest.mark.parametrize("split", ["symmetric", "left"])
def test_their_sum_over_the_elements_is_the_whole(split: str) -> None:
    vi, run = a_run(split, 3)
    q1, q2, u = run.q[1], run.q[2], run.inputs[1]
    whole = vi.discrete_potential(q1, q2, DT)
    parts = [vi.discrete_potential(q1, q2, DT, name) for name in ("gravity", "spring")]
    middle, rate = (q1 + q2) / 2, (q2 - q1) / DT
    kinetic = vi.mechanism.energy(middle, rate).kinetic
    assert vi.discrete_lagrangian(q1, q2, DT).value == pytest.approx(DT * kinetic - whole.value)
    np.testing.assert_allclose(sum(part.hessian for part in parts), whole.hessian, atol=1e-14)
    assert parts[1].value == pytest.approx(DT * vi.mechanism.potential(middle, "spring").value)
    for side in (0, 1):
        each = [vi.discrete_force(q1, q2, u, DT, name)[side] for name in ("oil", "air", "motor")]
        np.testing.assert_allclose(
            sum(f.gradient for f in each), vi.discrete_force(q1, q2, u, DT)[side].gradient, atol=1e-14
        )


def test_every_order_is_the_derivative_of_the_one_below() -> None:
    vi, run = a_run("symmetric", 3)
    rng = np.random.default_rng(4)
    # Far apart: at rest the drag, rounded there, bends too sharply for differences.
    q1, q2, u = run.q[1], run.q[1] + 0.3 * rng.normal(size=vi.mechanism.nq), run.inputs[1]
    d1, d2, e1, e2, du = (*rng.normal(size=(4, vi.mechanism.nq)), rng.normal(size=1))

    def difference(function):
        return (function(STEP) - function(-STEP)) / (2.0 * STEP)

    def near(found, wanted) -> None:
        assert np.abs(wanted).max() > 1e-4
        np.testing.assert_allclose(found, wanted, atol=1e-7 * max(1.0, np.abs(wanted).max()), rtol=1e-6)

    def Ld(s: float, dt: float = 0.3):
        return vi.discrete_lagrangian(q1 + s * d1, q2 + s * d2, dt)

    at = np.concatenate([d1, d2])
    near(Ld(0.0).gradient @ at, difference(lambda s: np.asarray(Ld(s).value)))
    near(Ld(0.0).hessian @ at, difference(lambda s: Ld(s).gradient))
    near(Ld(0.0).along(q1=d1, q2=d2).hessian, difference(lambda s: Ld(s).hessian))
    near(
        Ld(0.0).along(q1=e1, q2=e2).along(q1=d1, q2=d2).hessian,
        difference(lambda s: Ld(s).along(q1=e1, q2=e2).hessian),
    )
    for side in (0, 1):

        def fd(s: float, side: int = side):
            return vi.discrete_force(q1 + s * d1, q2 + s * d2, u + s * du, 0.3)[side]

        near(fd(0.0).gradient @ np.concatenate([at, du]), difference(lambda s, fd=fd: fd(s).value))
        near(fd(0.0).hessian @ np.concatenate([at, du]), difference(lambda s, fd=fd: fd(s).gradient))
    potential = vi.discrete_potential(q1, q2, 0.3, "spring")
    near(
        potential.along(q1=d1, q2=d2).hessian,
        difference(lambda s: vi.discrete_potential(q1 + s * d1, q2 + s * d2, 0.3, "spring").hessian),
    )


def test_what_drives_a_prescribed_variable_drives_a_free_one_the_same_way() -> None:
    """The lift is set free and given the force: it makes the motion that was prescribed."""
    vi, run = a_run("left")
    m = vi.mechanism
    force = vi.driving_force(run)
    assert force.shape == (run.steps - 1, m.nrho)
    column = m.kinematic.index("lift")
    dt = np.diff(run.t)
    # All of a force acts at the start of a step here: the impulse at each instant is that of one input.
    impulse = force[:, column] * (dt[:-1] + dt[1:]) / 2.0
    freed = mechanism(lift=False).with_elements([JointForce("lift", "winch")])
    loose = MidpointVI(freed, split="left", threads=1)
    order = [m.variables.index(name) for name in freed.variables]
    Ld = vi.discrete_lagrangian(run.q[0], run.q[1], dt[0])
    p = Ld.by("q2")[order][: freed.nd]
    start = loose.start(run.q[1][order], p=p, t=run.t[1])
    inputs = np.column_stack([run.inputs[1:, 0], impulse / dt[1:]])
    assert freed.inputs == ("torque", "winch")
    again = loose.simulate(start, run.t[1:], inputs=inputs, rho=run.rho[1:, 1:])
    assert again.steps == run.steps - 1, again.message
    np.testing.assert_allclose(again.q, run.q[1:, order], atol=1e-9)
    assert np.ptp(again["lift"]) > 1e-3


def test_it_is_that_of_continuous_time_to_second_order() -> None:
    """A crane lifts a swinging load smoothly: the winch's force from the step and from the equations of motion."""
    from leastaction.mechanics import ContinuousDynamics

    m = Mechanism(
        [tz("lift", kinematic=True, mass=2.0), [rx("swing", name="arm"), [tz(-1.0, mass=1.5, name="load")]]],
        [Gravity(), Damping(0.3)],
    )
    errors = []
    for N in (50, 100):
        t = np.linspace(0.0, 1.0, N + 1)
        vi = MidpointVI(m)
        start = vi.start([0.6, 0.0], [0.0, 0.0])
        run = vi.simulate(start, t, rho=0.2 * (1 - np.cos(3 * t))[:, None])
        found = vi.driving_force(run)[:, 0]
        v = (run.q[2:] - run.q[:-2]) / (2.0 * t[1])
        a = (run.q[2:] - 2.0 * run.q[1:-1] + run.q[:-2]) / t[1] ** 2
        wanted = ContinuousDynamics(m).inverse_dynamics(run.q[1:-1], v, a)[:, 1]
        errors.append(np.abs(found - wanted).max())
    assert errors[1] < 0.02
    assert 3.5 < errors[0] / errors[1] < 4.5
    # It carries the weight, and more or less of it as it speeds up.
    assert abs(found.mean() - 3.5 * 9.81) < 5.0


def test_bad_questions_are_named() -> None:
    vi, run = a_run("symmetric", 3)
    q1, q2 = run.q[:2]
    with pytest.raises(ArgumentError, match="dt: got 0"):
        vi.discrete_lagrangian(q1, q2, 0.0)
    with pytest.raises(ArgumentError, match=r"q2: got shape \(2,\)"):
        vi.discrete_lagrangian(q1, q2[:2], DT)
    with pytest.raises(ArgumentError, match="unknown element 'sprin'; did you mean 'spring'"):
        vi.discrete_potential(q1, q2, DT, "sprin")
    with pytest.raises(ArgumentError, match="'rope' is a Distance; the forces are"):
        vi.discrete_force(q1, q2, None, DT, "rope")
    with pytest.raises(ArgumentError, match="with other names"):
        MidpointVI(mechanism(lift=False)).driving_force(run)
    with pytest.raises(ArgumentError, match="dt V of 'spring': unknown argument 'q'; did you mean 'q2' or 'q1'"):
        vi.discrete_potential(q1, q2, DT, "spring").along(q=q1)
    with pytest.raises(ArgumentError, match=r"tensors: .*takes .* MB.*curvature"):
        vi.tensors(run, 1, max_bytes=1000)
