"""Inputs of a midpoint simulation as feedback, and rows of a single input without their second axis."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction import Feedback, Gravity, JointForce, Mechanism, MidpointVI, rz, simulate, tx
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
