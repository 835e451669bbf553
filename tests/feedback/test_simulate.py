"""`simulate` in either kind of time: under inputs that are known, and in loops that are closed."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import leastaction as la
from leastaction.control import ClosedLoop, close_loop, lqr, monte_carlo
from leastaction.costs import tracking
from leastaction.errors import ArgumentError
from leastaction.mechanics import ContinuousDynamics, Feedback
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import LinearSystem
from leastaction.optimal.continuous import FunctionContinuousSystem
from leastaction.viz import plot_energy, plot_run

T = 0.02 * np.arange(101)
UP = np.array([0.0, np.pi, 0.0, 0.0])


def plants() -> dict[str, object]:
    return {"steps": la.MidpointVI(cart_pendulum(), threads=1), "continuous": cart_pendulum()}


def predictive() -> la.MPC:
    model = la.MidpointSystem(la.MidpointVI(cart_pendulum(), threads=1), T[:41])
    cost = tracking(model, {"x": 5.0, "theta": 30.0, "*.v": 1.0}, {"theta": np.pi}, effort=1e-3)
    return la.MPC(model, cost, [la.Bound("x-force", -80.0, 80.0)])


def gains() -> np.ndarray:
    model = la.MidpointSystem(la.MidpointVI(cart_pendulum(), threads=1), T[:2])
    return lqr(*model.derivatives(UP, np.zeros(1), 0), [1.0, 10.0, 0.1, 0.1], [0.01], dt=0.02).gain


@pytest.mark.parametrize("kind", ["steps", "continuous"])
def test_under_known_inputs_and_laws_it_is_what_each_kind_of_time_does(kind: str) -> None:
    plant, q0, v0 = plants()[kind], {"theta": 0.4}, {"x": 0.1}
    for inputs in ([0.5], lambda t: [np.sin(t)], lambda t, x: -0.5 * x[:1], None):
        found = la.simulate(plant, q0, v0, T, inputs=inputs)
        if kind == "steps":
            expected = plant.simulate(plant.start(q0, v0), T, inputs=inputs)
        else:
            expected = la.mechanics.simulate(plant, q0, v0, T, inputs=inputs)
        np.testing.assert_array_equal(found.q, expected.q)


@pytest.mark.parametrize("kind", ["steps", "continuous"])
def test_known_inputs_in_a_loop_move_it_as_they_do_outside(kind: str) -> None:
    """Inputs by rows are held over the steps in both; readings, which nobody looks at, come beside them."""
    rows = np.sin(3.0 * T[:-1, None])
    outside = la.simulate(plants()[kind], {"theta": 0.4}, None, T, inputs=rows)
    loop = la.simulate(plants()[kind], {"theta": 0.4}, None, T, inputs=rows, measure="theta", noise=0.1, seed=3)
    np.testing.assert_allclose(loop.x[:, :2], outside.q, atol=1e-7)
    assert (loop["theta"] - loop.y[:, 0]).std() == pytest.approx(0.1, rel=0.3)
    np.testing.assert_array_equal(loop.u, rows)


@pytest.mark.parametrize("kind", ["steps", "continuous"])
@pytest.mark.parametrize("by", ["an MPC", "a Feedback", "a law"])
def test_controllers_hold_it_up_by_noisy_late_readings_while_it_is_pushed(kind: str, by: str) -> None:
    K = gains()
    controller = {
        "an MPC": predictive,
        "a Feedback": lambda: Feedback(K, UP, np.zeros(1)),
        "a law": lambda: lambda t, x: -K @ (x - UP),
    }[by]()
    model = la.MidpointSystem(la.MidpointVI(cart_pendulum(), threads=1), T)
    kalman = la.KalmanFilter(model, measure=["x", "theta"], noise=1e-3, process={"p_*": 0.01}, x=UP, spread=0.05)
    pushed = {"steps": "p_theta", "continuous": "v_theta"}[kind]
    run = la.simulate(
        plants()[kind], [0.0, np.pi + 0.05], None, T, inputs=controller, measure=["x", "theta"], noise=1e-3, delay=0.02,
        estimator=kalman, disturbance={pushed: 0.01}, seed=2,
    )  # fmt: skip
    assert isinstance(run, ClosedLoop)
    assert run.failure is None
    assert np.abs(run["theta"][50:] - np.pi).max() < 0.1
    assert run.y.shape == (101, 2)
    assert len(run.infos) == (100 if by == "an MPC" else 0)
    assert "100 steps, t = 0 to 2 s" in str(run)
    assert "of 2 readings" in str(run)


def test_it_is_the_closed_loop_of_states() -> None:
    law, vi = (lambda t, x: -3.0 * x[:1] - x[2:3]), plants()["steps"]
    start = vi.start([0.1, 0.2], [0.3, 0.0])
    expected = close_loop(vi, law, start.x, T, delay=0.04)
    np.testing.assert_array_equal(la.simulate(vi, start, None, T, inputs=law, delay=0.04).x, expected.x)
    np.testing.assert_array_equal(la.simulate(vi, [0.1, 0.2], [0.3, 0.0], T, inputs=law, delay=0.04).x, expected.x)
    system = LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], N=5)
    for when in ((None, 0.1 * np.arange(6)), (0.1 * np.arange(6),)):
        run = la.simulate(system, [1.0, 0.0], *when, inputs=lambda t, x: -x[:1])
        np.testing.assert_array_equal(run.x[1], [1.0, -0.1])


def test_times_may_stand_right_after_a_whole_state() -> None:
    vi = plants()["steps"]
    start = vi.start([0.1, 0.2], [0.3, 0.0])
    np.testing.assert_array_equal(la.simulate(vi, start, T).x, vi.simulate(start, T).x)
    np.testing.assert_array_equal(la.simulate(vi, start, t=T).x, vi.simulate(start, T).x)
    # All numbers of a state are one.
    np.testing.assert_array_equal(la.simulate(vi, start.x, T).x, vi.simulate(start, T).x)
    noisy = la.simulate(vi, start.x, T, inputs=[0.0], noise=0.1)
    np.testing.assert_array_equal(noisy.x, la.simulate(vi, start, T, inputs=[0.0], noise=0.1).x)
    whole, parts = [0.1, 0.2, 0.3, 0.0], ([0.1, 0.2], [0.3, 0.0])
    np.testing.assert_array_equal(la.simulate(cart_pendulum(), whole, T).x, la.simulate(cart_pendulum(), *parts, T).x)


WRONG = {
    "a keyword": (lambda vi: la.simulate(vi, [0.0, 0.1], None, T, nois=1), "no argument 'nois'; did you mean 'noise'"),
    "one of the other kind": (lambda vi: la.simulate(vi, [0.0, 0.1], None, T, rtol=0.1), "no argument 'rtol'"),
    "one that does not go": (
        lambda vi: la.simulate(vi, [0.0, 0.1], None, T, noise=0.1, law_at="midpoint"),
        "law_at: got it in a loop that is closed, expected none but inputs, measure, noise",
    ),
    "a flag": (lambda _: la.simulate(cart_pendulum(), [0.0, 0.1], None, T, dense_output="no"), "dense_output: got"),
    "a delay": (lambda vi: la.simulate(vi, [0.0, 0.1], None, T, inputs=[0.0], delay=0.03), "delay: got 0.03 s"),
    "a velocity of a system": (
        lambda _: la.simulate(LinearSystem(np.eye(2), np.eye(2), N=5), [0.0, 0.1], [0.0], T, inputs=[0.0, 0.0]),
        "v0: got one beside a LinearSystem, expected None",
    ),
    "no mechanism": (lambda _: la.simulate([], [0.0], None, T, noise=0.1), "dynamics: got list, expected a Mechanism"),
    "inputs": (lambda vi: la.simulate(vi, [0.0, 0.1], None, T, inputs=[0.0, 1.0], seed=0), r"inputs: got shape \(2,\)"),
    "no times": (lambda vi: la.simulate(vi, [0.0, 0.1], T), r"simulate: lacks t: call simulate\(dynamics, q0, v0, t\)"),
    "neither": (lambda vi: la.simulate(vi, {"x": 0.1}), "simulate: lacks t"),
    "a velocity beside a state": (lambda vi: la.simulate(vi, vi.start([0.0, 0.1]), [0.0, 0.0], T), "beside a State"),
    "a name": (lambda vi: la.simulate(vi, [0.0, 0.1], None, T, measure="thet"), "measure: unknown name 'thet'"),
}  # fmt: skip


@pytest.mark.parametrize(("wrong", "message"), WRONG.values(), ids=WRONG)
def test_what_is_wrong_is_said(wrong, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        wrong(plants()["steps"])


def test_dynamics_of_a_mechanism_are_a_plant() -> None:
    run = la.simulate(ContinuousDynamics(cart_pendulum()), {"theta": 0.1}, None, T, inputs=[0.0], seed=0)
    np.testing.assert_allclose(run.x[:, :2], la.simulate(cart_pendulum(), {"theta": 0.1}, None, T).q, atol=1e-7)


def test_what_is_read_is_by_default_what_the_estimator_reads() -> None:
    """Of a plant in continuous time too, whose own state has velocities where the estimator's has momenta."""
    model, q0, v0 = la.MidpointSystem(la.MidpointVI(cart_pendulum(), threads=1), T), [0.0, 2.0], [1.0, -1.0]
    momentum = la.MidpointVI(cart_pendulum()).start(q0, v0).p[1]
    for plant in plants().values():
        kalman = la.KalmanFilter(model, measure=["p_theta"], noise=1e-3, process=1e-3, x=UP)
        run = la.simulate(plant, q0, v0, T[:3], inputs=[0.0], estimator=kalman)
        assert run.y.shape == (3, 1)
        assert run.y[0, 0] == pytest.approx(momentum, rel=1e-12)


def test_in_continuous_time_a_law_acts_always_or_is_held_between_instants() -> None:
    """The two differ by the first order of the time between instants; held inputs are those of each piece."""
    plant, law = cart_pendulum(), Feedback([[-2.0, 120.0, -8.0, 25.0]], UP, np.zeros(1))
    q0, t = [0.0, np.pi - 0.05], T[:51]
    always, held = la.simulate(plant, q0, None, t, inputs=law), la.simulate(plant, q0, None, t, inputs=law, seed=0)
    finely = la.simulate(plant, q0, None, 0.02 / 16 * np.arange(801), inputs=law, seed=0)
    off, less = (np.abs(x[:, 1] - always.q[:, 1]).max() for x in (held.x, finely.x[::16]))
    assert 1e-6 < less < 0.1 * off
    x = held.x[0]
    for k in range(3):
        piece = la.simulate(plant, x[:2], x[2:], t[k : k + 2], inputs=law(t[k], x))
        x = np.concatenate([piece.q[-1], piece.v[-1]])
    np.testing.assert_allclose(held.x[3], x, atol=1e-8)


def test_a_system_of_ones_own_in_continuous_time_under_a_controller_of_ones_own() -> None:
    class Law:
        """A controller that logs what it was given."""

        info = ""

        def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
            self.info = f"asked at {t:.1f} s"
            return -2.0 * x[:1] - 3.0 * x[1:]

    flow = lambda x, u, t: np.array([x[1], u[0]])  # noqa: E731
    system = FunctionContinuousSystem(flow, nx=2, nu=1, derivatives="finite-differences")
    run = la.simulate(system, [1.0, 0.0], None, 0.1 * np.arange(41), inputs=Law(), noise=1e-3)
    assert run.infos[3] == "asked at 0.3 s"
    assert "40 steps" in str(run)
    # A solver, whose steps are its own, asks no controller; as a law it would be asked between the instants.
    for how in ({"inputs": Law()}, {"u": Law()}):
        with pytest.raises(ArgumentError, match=r"got a controller, Law, .* leastaction\.simulate\("):
            la.mechanics.simulate(cart_pendulum(), UP[:2], None, T, **how)
    x = np.array([1.0, 0.0])
    for k, y in enumerate(run.y[:-1]):
        u = -2.0 * y[0] - 3.0 * y[1]
        x = np.array([x[0] + 0.1 * x[1] + 0.005 * u, x[1] + 0.1 * u])
        np.testing.assert_allclose(run.x[k + 1], x, atol=1e-8)


@pytest.mark.parametrize("kind", ["steps", "continuous"])
def test_a_loop_is_saved_read_pickled_shown_and_drawn(kind: str, tmp_path: Path) -> None:
    model = la.MidpointSystem(la.MidpointVI(cart_pendulum(), threads=1), T)
    kalman = la.KalmanFilter(model, measure=["x", "theta"], noise=1e-3, process={"p_*": 0.01}, x=UP, spread=0.05)
    loop = la.simulate(
        plants()[kind], [0.0, np.pi + 0.05], None, T[:11], inputs=predictive(), measure=["x", "theta"], noise=1e-3,
        delay=0.02, estimator=kalman,
    )  # fmt: skip
    for ending in ("npz", "h5"):
        pytest.importorskip("h5py" if ending == "h5" else "numpy")
        back = la.open(loop.save(tmp_path / f"loop.{ending}"))
        assert isinstance(back, ClosedLoop)
        for name in ("t", "x", "u", "y", "estimates", "surprise"):
            np.testing.assert_array_equal(getattr(back, name), getattr(loop, name))
        assert back.infos == loop.infos
        assert str(back) == str(loop)
        assert (back.units, back.reading_names) == (loop.units, ("x", "theta"))
    assert pickle.loads(pickle.dumps(loop)).mechanism is not None
    # What names states and readings is told apart: an instant, four states, an input and two readings are a line.
    header, first = loop.save(tmp_path / "loop.csv").read_text().splitlines()[:2]
    assert "y.theta" in header
    assert len(first.split(",")) == 8
    (scene,) = la.show(loop).scenes
    assert scene.t[-1] == loop.t[-1]
    assert len(scene.t) >= 11
    panels = plot_run(loop, ["theta", "x-force"]).axes
    assert [panel.get_title(loc="left") for panel in panels] == ["theta", "x-force"]
    with pytest.raises(ArgumentError, match="a closed loop did, which has no multipliers"):
        plot_energy(loop)


def test_a_loop_of_no_mechanism_is_saved_and_is_nothing_to_be_shown(tmp_path: Path) -> None:
    system = LinearSystem([[1.0, 0.1], [0.0, 1.0]], [[0.0], [0.1]], N=5)
    loop = la.simulate(system, [1.0, 0.0], 0.1 * np.arange(6), inputs=lambda t, x: -x[:1])
    back = la.open(loop.save(tmp_path / "loop.npz"))
    np.testing.assert_array_equal(back["x[0]"], loop["x[0]"])
    assert back.mechanism is None
    assert len(plot_run(loop, reference=loop).axes) == 3  # two states and an input, in panels of their own
    with pytest.raises(ArgumentError, match="what a ClosedLoop has over time is no motion of a mechanism"):
        la.show(loop)


def test_what_is_done_is_kept_where_ctrl_c_ends_a_loop() -> None:
    def law(t: float, x: np.ndarray) -> list[float]:
        if t > 0.49:
            raise KeyboardInterrupt
        return [float(np.sin(t))]

    loop = la.simulate(plants()["steps"], {"theta": 0.3}, None, T, inputs=law, noise=1e-3)
    assert loop.interrupted
    assert str(loop).startswith("interrupted at t = 0.5 s of 2 s")
    assert (len(loop.t), len(loop.x), len(loop.u), len(loop.y)) == (26, 26, 25, 26)
    bands = monte_carlo(lambda rng: la.simulate(plants()["steps"], {}, None, T, inputs=law, noise=1e-3), 5)
    assert (len(bands.x), bands.failures[0][0]) == (1, 0)

    def stopped(rng: np.random.Generator) -> ClosedLoop:
        if begun:
            raise KeyboardInterrupt
        begun.append(True)
        return la.simulate(plants()["steps"], {"theta": 0.3}, None, T[:5], inputs=[0.0], noise=1e-3)

    begun: list[bool] = []
    assert len(monte_carlo(stopped, 5).x) == 1
    with pytest.raises(KeyboardInterrupt):
        monte_carlo(stopped, 5)


SLIDES = la.Mechanism(
    [la.tx("x", mass=1.0), la.ty("y", mass=2.0), la.tz("lift", kinematic=True), la.tz("hook", kinematic=True)],
    [la.JointForce("x", "left"), la.JointForce("y", "right")],
)


def test_signals_by_name_are_those_in_their_order() -> None:
    vi, t = la.MidpointVI(SLIDES), np.linspace(0.0, 1.0, 11)
    start, rows = vi.start({"lift": 1.0, "hook": 2.0}), np.arange(10.0)
    given = vi.simulate(start, t, inputs={"right": rows, "left": 3.0}, rho={"hook": 2.0 + t})
    both = np.stack([np.full(10, 3.0), rows], axis=1)
    other = vi.simulate(start, t, inputs=both, rho=np.stack([np.ones(11), 2.0 + t], axis=1))
    assert (given.x == other.x).all()
    assert given["lift"][-1] == 1.0  # what has no signal stays where it is
    run = vi.simulate(start, t, inputs={"right": np.sin}, rho={"hook": lambda s: 2.0 + s})
    assert np.allclose(run.u[:, 1], np.sin(t[1:] - 0.05))
    assert np.allclose(run["hook"], 2.0 + t)
    smooth = la.simulate(SLIDES, {"lift": 1.0}, None, t, inputs={"right": np.sin, "left": 1.0})
    assert abs(2.0 * smooth["y"][-1] - (1.0 - np.sin(1.0))) < 1e-8
    assert abs(smooth["x"][-1] - 0.5) < 1e-8


@pytest.mark.parametrize(
    ("inputs", "message"),
    [
        ({"rihgt": 1.0}, "inputs: unknown name 'rihgt'; did you mean 'right'"),
        ({"right": np.ones(11)}, r"inputs: got shape \(11, 2\), expected \(10, 2\)"),
        (
            {"right": np.ones(10), "left": np.ones(9)},
            "inputs: got rows of different lengths: 9 of 'left', 10 of 'right'",
        ),
        ({"right": np.ones(10), "left": np.sin}, "inputs: got rows of 'right' and a function for 'left'"),
        ({"right": lambda t, x: 1.0}, r"inputs\['right'\]: got a function of time and state; give one for all"),
        ({"right": [np.nan] * 10}, r"inputs\['right'\]: got nan"),
    ],
)
def test_what_is_wrong_with_signals_by_name_is_said(inputs, message: str) -> None:
    vi = la.MidpointVI(SLIDES)
    with pytest.raises(ArgumentError, match=message):
        vi.simulate(vi.start(np.zeros(4)), np.linspace(0.0, 1.0, 11), inputs=inputs)


@pytest.mark.parametrize("inputs", [2.0, lambda t: 2.0, lambda t, x: 2.0], ids=["constant", "of time", "law"])
def test_a_single_input_may_be_a_number(inputs) -> None:
    m, t, start = cart_pendulum(), 0.02 * np.arange(11), [0.0, 3.0]
    row = la.simulate(la.MidpointVI(m), start, None, t, inputs=[2.0])
    assert np.allclose(la.simulate(la.MidpointVI(m), start, None, t, inputs=inputs).x, row.x, atol=1e-12)
    smooth = [la.simulate(m, start, None, t, inputs=each) for each in (inputs, [2.0])]
    assert np.allclose(smooth[0].q, smooth[1].q, atol=1e-7)
    if inputs != 2.0:
        loop = la.simulate(la.MidpointVI(m), start, None, t, inputs=inputs, measure=["x"])
        assert np.allclose(loop["theta"], row["theta"], atol=1e-12)
    with pytest.raises(ArgumentError, match=r"q: got shape \(\), expected \(2,\)"):
        la.simulate(la.MidpointVI(m), 0.3, None, t)
