"""What is no motion is refused with what was given, what was expected, and what to do."""

from __future__ import annotations

import numpy as np
import pytest

from leastaction.errors import ArgumentError, StepError
from leastaction.mechanics import Distance, Gravity, Mechanism, MidpointVI, SimulationStatus, State, pose, tx, tz
from leastaction.models.cart_pendulum import cart_pendulum
from physics.laws import mass_on_string, pendulum, times

BAD = [np.nan, np.inf, -np.inf]


def vi_and_start() -> tuple[MidpointVI, State]:
    vi = MidpointVI(cart_pendulum())
    return vi, vi.start([0.0, 1.0])


@pytest.mark.parametrize("bad", BAD)
def test_numbers_that_are_not_finite(bad: float) -> None:
    vi, start = vi_and_start()
    for call in (
        lambda: vi.start([0.0, bad]),
        lambda: vi.start([0.0, 1.0], [bad, 0.0]),
        lambda: vi.start([0.0, 1.0], p=[bad, 0.0]),
        lambda: vi.start([0.0, 1.0], t=bad),
        lambda: vi.step(start, bad),
        lambda: vi.step(start, 0.01, inputs=[bad]),
        lambda: vi.step(State(0.0, np.array([bad, 0.0]), start.p, start.v_rho), 0.01),
        lambda: vi.step(State(0.0, start.q, np.array([0.0, bad]), start.v_rho), 0.01),
        lambda: vi.simulate(start, [0.0, bad]),
        lambda: vi.simulate(start, [0.0, 0.01, 0.02], inputs=[[0.0], [bad]]),
        lambda: vi.simulate(start, [0.0, 0.01], inputs=lambda t: [bad]),
        lambda: vi.start_from_configurations([0.0, 1.0], [bad, 1.0], 0.01),
    ):
        with pytest.raises(ArgumentError, match="finite"):
            call()


@pytest.mark.parametrize("bad", BAD)
def test_prescribed_motion_that_is_not_finite(bad: float) -> None:
    m = mass_on_string()
    vi = MidpointVI(m)
    start = vi.start(m.configuration({"z": -1.0, "length": 1.0}))
    with pytest.raises(ArgumentError, match=r"rho.*length"):
        vi.step(start, 0.01, rho_next=[bad])
    with pytest.raises(ArgumentError, match=r"rho.*length"):
        vi.simulate(start, [0.0, 0.1, 0.2], rho=[[1.0], [bad]])


@pytest.mark.parametrize("dt", [0.0, -0.01])
def test_time_that_does_not_go_on(dt: float) -> None:
    vi, start = vi_and_start()
    with pytest.raises(ArgumentError, match=r"dt.*positive"):
        vi.step(start, dt)
    with pytest.raises(ArgumentError, match=r"dt.*positive"):
        vi.start_from_configurations([0.0, 1.0], [0.0, 1.0], dt)
    with pytest.raises(ArgumentError, match=r"increase.*t\[1\]"):
        vi.simulate(start, [0.0, 0.1, 0.1 + dt, 0.3])


def test_wrong_shapes() -> None:
    vi, start = vi_and_start()
    for call in (
        lambda: vi.start([0.0]),
        lambda: vi.start([0.0, 1.0], [0.0, 0.0, 0.0]),
        lambda: vi.start([[0.0, 1.0]]),
        lambda: vi.step(start, 0.01, inputs=[1.0, 2.0]),
        lambda: vi.step(start, 0.01, rho_next=[1.0]),
        lambda: vi.simulate(start, [0.0]),
        lambda: vi.simulate(start, []),
        lambda: vi.simulate(start, 0.1),
        lambda: vi.simulate(start, [[0.0, 0.1]]),
        lambda: vi.simulate(start, [0.0, 0.1, 0.2], inputs=np.zeros((3, 1))),
        lambda: vi.simulate(start, [0.0, 0.1], inputs=lambda t: [1.0, 2.0]),
        lambda: vi.simulate(start, [0.0, 0.1], inputs="push"),
    ):
        with pytest.raises(ArgumentError, match=r"expected|at least"):
            call()


def test_times_that_start_elsewhere() -> None:
    vi, start = vi_and_start()
    with pytest.raises(ArgumentError, match=r"first time is 1.*start is at 0"):
        vi.simulate(start, [1.0, 1.1])


def test_settings_out_of_range() -> None:
    m = pendulum()
    for options in (
        {"split": "right"},
        {"tolerance": 0.0},
        {"tolerance": np.nan},
        {"tolerance": 1.0},
        {"max_iterations": 0},
    ):
        with pytest.raises(ArgumentError, match=next(iter(options))):
            MidpointVI(m, **options)


def test_unknown_names_and_steps() -> None:
    vi, start = vi_and_start()
    run = vi.simulate(start, times(0.1, 10))
    with pytest.raises(ArgumentError, match="did you mean 'theta'"):
        run["thetta"]
    with pytest.raises(ArgumentError, match=r"10.*0 to 9"):
        vi.tensors(run, 10)
    with pytest.raises(ArgumentError, match="z"):
        vi.curvature(run, vi.linearize(run), np.zeros((9, 4)))


def test_a_run_that_failed_at_once_has_no_derivatives_and_says_so() -> None:
    vi, start = vi_and_start()
    run = vi.simulate(start, times(0.1, 10), inputs=[np.finfo(float).max])
    assert run.steps == 0
    d = vi.linearize(run)
    assert d.A.shape == (0, 4, 4)
    assert d.curvature(np.zeros((0, 4))).shape == (0, 5, 5)
    with pytest.raises(ArgumentError, match="k: got 0, expected a trajectory of one step or more"):
        vi.tensors(run, 0)


def test_what_is_no_trajectory_is_not_linearized_in_silence() -> None:
    m = mass_on_string(length=1.0)
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.6, -0.8]), times(0.02, 2))
    x = run.x.copy()
    x[2, 0] = np.nan
    with pytest.raises(StepError, match="step 1"):
        vi.linearize_arrays(run.t, x, run.u)


def test_inputs_beyond_all_bounds_fail_and_the_process_lives() -> None:
    vi, start = vi_and_start()
    run = vi.simulate(start, times(0.1, 10), inputs=[1e300])
    assert run.status is SimulationStatus.STEP_FAILED
    assert run.steps < 10
    assert np.all(np.isfinite(run.x))
    with pytest.raises(StepError) as caught:
        vi.step(start, 0.01, inputs=[1e300])
    assert np.array_equal(caught.value.state.q, start.q)
    assert caught.value.iteration >= 0
    assert vi.step(start, 0.01).state.q[1] == pytest.approx(1.0, abs=1e-2)


def test_more_strings_than_freedoms_are_told_by_name() -> None:
    """Prescribed lengths have to agree with each other: a step that misses by some 1e-9 m says which."""
    masts = {"left": -1.0, "middle": 0.2, "right": 1.0}
    m = Mechanism(
        [
            tx("x"),
            [tz("z", mass=1.0, name="ball")],
            *(pose(translation=(x, 0, 0), name=name) for name, x in masts.items()),
        ],
        [Gravity(), *(Distance(name, "ball", length=f"l_{name}", name=f"{name}_string") for name in masts)],
    )
    lengths = [np.hypot(x, 1.0) for x in masts.values()]
    vi = MidpointVI(m)
    start = vi.start([0.0, -1.0, *lengths])
    assert vi.step(start, 0.01).state.q[1] == pytest.approx(-1.0)
    off = [*lengths[:2], lengths[2] + 4e-9]
    with pytest.raises(StepError, match=r"'right_string' asks nothing .* 'left_string', 'middle_string' .*'l_left'"):
        vi.step(start, 0.01, rho_next=off)
