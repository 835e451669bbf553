"""Inputs of a midpoint simulation as feedback, and rows of a single input without their second axis."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import (
    Damping,
    Feedback,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    PointToPoint,
    project_configuration,
    rz,
    simulate,
    to_velocity,
    tx,
)
from leastaction.errors import ArgumentError
from leastaction.mechanics.discrete.trajectory import SimulationStatus

T = 0.01 * np.arange(101)


@pytest.fixture(scope="module")
def vi() -> MidpointVI:
    m = Mechanism(
        [rz("theta"), [tx(1.0, mass=1.0)]],
        [Gravity((0.0, -9.81, 0.0)), JointForce("theta", input="torque")],
    )
    return MidpointVI(m)


def test_a_feedback_is_held_over_each_step(vi: MidpointVI) -> None:
    gain = np.array([[30.0, 5.0]])
    feedback = Feedback(gain, np.array([0.3, 0.0]), np.array([9.81 * np.cos(0.3)]))
    start = vi.start([0.0])
    run = vi.simulate(start, T, inputs=feedback)
    assert run.status is SimulationStatus.COMPLETED
    expected = [feedback(t, x) for t, x in zip(run.t[:-1], run.x[:-1], strict=True)]
    assert np.array_equal(run.inputs, expected)
    assert abs(run["theta"][-1] - 0.3) < 0.05
    state = start
    for k in range(3):
        state = vi.step(state, 0.01, inputs=feedback(state.t, state.x)).state
        np.testing.assert_allclose(state.x, run.x[k + 1], atol=1e-12)
    plain = vi.simulate(start, T, inputs=lambda t, x: feedback(t, x))
    assert np.array_equal(plain.x, run.x)
    again = vi.simulate(start, T, inputs=run.inputs)
    np.testing.assert_allclose(again.x, run.x, atol=1e-9)


def test_a_feedback_gets_states_to_read_and_is_told_of_wrong_shapes(vi: MidpointVI) -> None:
    def meddling(t: float, x: np.ndarray) -> np.ndarray:
        x[0] = 0.0
        return x[:1]

    with pytest.raises(ValueError, match="read-only"):
        vi.simulate(vi.start([0.0]), T, inputs=meddling)
    with pytest.raises(ArgumentError, match=r"inputs\(0, x\): got shape \(2,\), expected \(1,\)"):
        vi.simulate(vi.start([0.0]), T, inputs=lambda t, x: x)


def test_rows_of_one_input_need_no_second_axis(vi: MidpointVI) -> None:
    rows = np.sin(T[:-1])
    flat = vi.simulate(vi.start([0.0]), T, inputs=rows)
    column = vi.simulate(vi.start([0.0]), T, inputs=rows[:, None])
    assert np.array_equal(flat.x, column.x)
    with pytest.raises(ArgumentError, match=r"inputs: got shape \(7,\).*rows are of shape \(100, 1\)"):
        vi.simulate(vi.start([0.0]), T, inputs=np.zeros(7))


def test_continuous_time_tells_rows_held_from_rows_joined_so_it_asks_for_the_axis(
    vi: MidpointVI,
) -> None:
    for count in (10, 11):
        with pytest.raises(ArgumentError, match=r"rows are of shape \(10, 1\) or \(11, 1\)"):
            simulate(vi.mechanism, [0.0], None, T[:11], inputs=np.zeros(count))


# Inside the step


def arm() -> MidpointVI:
    """Return a planar arm of three links with a torque on every joint."""
    tree: list[object] = []
    for name in ("c", "b", "a"):
        tree = [rz(name), [tx(0.25, mass=1.0, inertia=(0.01, 0.02, 0.02)), tx(0.5), tree]]
    torques = [JointForce(name, input=f"torque {name}") for name in "abc"]
    return MidpointVI(Mechanism(tree, [Gravity((0.0, -9.81, 0.0)), *torques]))


def test_a_law_inside_the_step_is_of_second_order() -> None:
    """Inverse dynamics with feedback on an arm (dissertation 5.2), against the closed loop in continuous time."""
    vi = arm()
    m = vi.mechanism

    def law(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wanted = 0.5 * np.sin([2.0 * t, 3.0 * t, t])
        return 20.0 * (wanted - q) - 1.5 * v + 3.0 * np.sin(q)

    def inside(t: float, x: np.ndarray) -> np.ndarray:
        return law(t, x[:3], to_velocity(m, x[:3], x[3:]))

    exact = simulate(
        m, [0.3, -0.2, 0.1], [0.5, 0.0, 0.0], [0.0, 1.0],
        inputs=lambda t, x: law(t, x[:3], x[3:]), rtol=1e-12, atol=1e-12,
    )  # fmt: skip
    errors: dict[str, list[float]] = {"start": [], "midpoint": []}
    for where, off in errors.items():
        for steps in (100, 200, 400):
            run = vi.simulate(
                vi.start([0.3, -0.2, 0.1], [0.5, 0.0, 0.0]),
                np.linspace(0.0, 1.0, steps + 1),
                inputs=inside,
                law_at=where,
            )
            assert run.status is SimulationStatus.COMPLETED
            off.append(float(np.abs(run.q[-1] - exact.q[-1]).max()))
    order = {where: np.log2(np.divide(e[:-1], e[1:])) for where, e in errors.items()}
    print(order, errors)
    assert np.all(np.abs(order["midpoint"] - 2.0) < 0.1)
    assert np.all(np.abs(order["start"] - 1.0) < 0.25)
    assert errors["midpoint"][-1] < 0.1 * errors["start"][-1]


def test_a_law_inside_the_step_acts_as_a_damper_does() -> None:
    """In a closed loop, with a prescribed variable, and so stiff that to iterate on the law would diverge."""
    for damping, dt in ((0.4, 0.01), (5e3, 0.01)):
        tree = [
            rz("a"),
            [tx(0.3, mass=1.0), tx(0.6, name="A")],
            tx("base", kinematic=True),
            [rz("b"), [tx(0.3, mass=0.5), tx(0.9), [rz("c"), [tx(0.4, mass=0.7, name="C")]]]],
        ]
        elements = [Gravity((0.0, -9.81, 0.0)), PointToPoint("A", "C", "xy")]
        m = Mechanism(tree, [*elements, JointForce("a", input="brake")])
        vi = MidpointVI(m)
        damped = MidpointVI(Mechanism(tree, [*elements, Damping({"a": damping})]))
        q = project_configuration(m, m.configuration({"a": 1.0, "b": 0.4, "c": 1.0}), hold=["a"]).q
        t = dt * np.arange(17)
        base = (0.05 * np.sin(3.0 * t))[:, None]

        def law(t: float, x: np.ndarray, m: Mechanism = m, damping: float = damping) -> np.ndarray:
            v = to_velocity(m, x[: m.nq], x[m.nq : m.nq + m.nd], x[m.nq + m.nd :])
            return -damping * v[:1]

        run = vi.simulate(vi.start(q), t, inputs=law, rho=base, law_at="midpoint")
        expected = damped.simulate(damped.start(q), t, rho=base)
        assert run.status is expected.status is SimulationStatus.COMPLETED
        np.testing.assert_allclose(run.q, expected.q, atol=1e-8)
        # The inputs are recorded: the same motion follows from them.
        again = vi.simulate(vi.start(q), t, inputs=run.inputs, rho=base)
        np.testing.assert_allclose(again.x, run.x, atol=1e-8)


def test_a_law_without_a_solution_inside_the_step_says_so(vi: MidpointVI) -> None:
    run = vi.simulate(
        vi.start([0.0]),
        T,
        inputs=lambda t, x: 1e3 * np.where(x[:1] > 0.0, -1.0, 1.0),
        law_at="midpoint",
    )
    assert run.status is SimulationStatus.STEP_FAILED
    assert "no input agrees with the law at the midpoint, 'torque' is" in run.message
    with pytest.raises(ArgumentError, match="law_at: got 'end', expected 'start' or 'midpoint'"):
        vi.simulate(vi.start([0.0]), T, law_at="end")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((np.zeros((5, 1, 4)), np.zeros(4), np.zeros(1)), r"K: got shape \(5, 1, 4\), expected \(n, nx\).*function"),
        ((np.zeros((1, 4)), np.zeros((6, 4)), np.zeros(1)), r"xbar: got shape \(6, 4\), expected \(nx,\)"),
        ((np.zeros((1, 4)), np.zeros(4), np.zeros((5, 1))), r"ubar: got shape \(5, 1\), expected \(n,\)"),
    ],
)
def test_gains_of_all_steps_are_to_be_given_as_a_function(parts: tuple[np.ndarray, ...], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Feedback(*parts)
