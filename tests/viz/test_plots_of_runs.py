"""Plots of runs: what is on the axes, in which units, and whether it is what the run has."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leastaction import (
    Bound,
    ContinuousTrajectory,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    PointToPoint,
    QuadraticCost,
    Trajectory,
    optimize,
    rx,
    rz,
    simulate,
    tx,
    ty,
    tz,
    var,
)
from leastaction.errors import ArgumentError
from leastaction.models import build, four_bars
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.optimal import FunctionSystem
from leastaction.viz import plot_energy, plot_poses, plot_reactions, plot_residuals, plot_run, save_png
from leastaction.viz.energy import work_and_energy
from leastaction.viz.reactions import reactions_of

pytestmark = pytest.mark.filterwarnings("error")
T = np.linspace(0.0, 1.0, 51)


def axes_of(figure: Figure) -> dict[str, Axes]:
    """Return the panels by the names on top, or by what their axes say."""
    return {(axes.get_title(loc="left") or axes.get_ylabel()): axes for axes in figure.axes}


def line(axes: Axes, label: str) -> Any:
    """Return a line of a panel by its label."""
    return next(line for line in axes.lines if line.get_label() == label)


def shaded(axes: Axes) -> list[tuple[float, float]]:
    """Return the times that are shaded, each from when to when."""
    # A rectangle, which older versions of Matplotlib make a polygon of.
    extents = [patch.get_path().transformed(patch.get_patch_transform()).get_extents() for patch in axes.patches]
    return [(extent.x0, extent.x1) for extent in extents]


def pushed_cart(push: float = 3.0) -> Trajectory:
    """Return a cart with a pendulum under a push that changes its sign half way."""
    vi = MidpointVI(cart_pendulum())
    inputs = np.where(T[:-1] < 0.5, push, -push)[:, None]
    return vi.simulate(vi.start([0.0, 0.3]), T, inputs=inputs)


@pytest.fixture(scope="module")
def cart() -> Trajectory:
    return pushed_cart()


def test_variables_and_inputs_are_drawn_with_names_and_units(cart: Trajectory) -> None:
    figure = plot_run(cart, title="A cart")
    panels = axes_of(figure)
    assert list(panels) == ["x", "theta", "x-force"]
    assert [axes.get_ylabel() for axes in panels.values()] == ["length (m)", "angle (°)", "force (N)"]
    assert figure.axes[-1].get_xlabel() == "time (s)"
    assert figure.get_size_inches()[0] == 8.0
    np.testing.assert_allclose(line(panels["theta"], "theta").get_ydata(), np.degrees(cart["theta"]))
    np.testing.assert_array_equal(line(panels["x"], "x").get_ydata(), cart["x"])
    held = line(panels["x-force"], "x-force")
    assert held.get_drawstyle() == "steps-post"
    np.testing.assert_array_equal(held.get_xdata(), T)
    np.testing.assert_array_equal(held.get_ydata(), [*cart["x-force"], cart["x-force"][-1]])


def test_what_is_named_is_drawn_with_momenta_and_patterns(cart: Trajectory) -> None:
    panels = axes_of(plot_run(cart, ["p_*"]))
    assert {name: axes.get_ylabel() for name, axes in panels.items()} == {
        "p_x": "momentum (kg m/s)", "p_theta": "angular momentum (kg m²/s)",
    }  # fmt: skip
    continuous = simulate(cart_pendulum(), [0.0, 0.3], None, T)
    panels = axes_of(plot_run(continuous, "v_*"))
    assert {name: axes.get_ylabel() for name, axes in panels.items()} == {
        "v_x": "velocity (m/s)", "v_theta": "angular velocity (°/s)",
    }  # fmt: skip
    np.testing.assert_allclose(line(panels["v_theta"], "v_theta").get_ydata(), np.degrees(continuous.v[:, 1]))


def test_bounds_are_drawn_and_the_time_on_them_is_shaded(cart: Trajectory) -> None:
    limits = [Bound("x-force", -5.0, 3.0), Bound("theta", max=lambda t: 1.0 + t), Bound("x", max=9.0, of="rate")]
    panels = axes_of(plot_run(cart, limits=limits))
    (begin, end), *others = shaded(panels["x-force"])
    assert (round(begin, 9), round(end, 9), others) == (0.0, 0.5, [])
    lines = [drawn.get_ydata() for drawn in panels["x-force"].lines[1:]]
    assert [set(values) for values in lines] == [{-5.0}, {3.0}]
    np.testing.assert_allclose(panels["theta"].lines[1].get_ydata(), np.degrees(1.0 + T))
    assert shaded(panels["theta"]) == []
    low, high = panels["x-force"].get_ylim()
    assert low < -5.0
    assert high > 3.0
    assert len(panels["x"].lines) == 1  # a limit of its rate is none of the length


def test_limits_of_a_result_are_shaded_where_its_report_says_so() -> None:
    system = MidpointSystem(MidpointVI(cart_pendulum()), T)
    x, u = np.zeros((51, 4)), np.zeros((50, 1))
    x[:, 0] = 0.5 * T
    cost = QuadraticCost(x, u, Q=[100.0, 0.1, 0.0, 0.0], R=[1e-4])
    result = optimize(
        system, cost, initial=(np.zeros(4), u), limits=[Bound("x-force", -20.0, 20.0), Bound("x", max=0.1)]
    )
    report = result.limits
    assert report is not None
    panels = axes_of(plot_run(result, reference=(x, u)))
    for name, labels in (("x-force", ("x-force >= -20", "x-force <= 20")), ("x", ("x <= 0.1",))):
        active = {int(k) for label in labels for k in report.active(label)}
        assert active, name
        middles = T[:-1] + 0.01 if name == "x-force" else T
        inside = {k for k, t in enumerate(middles) for a, b in shaded(panels[name]) if a < t < b}
        assert inside == active
        drawn = sorted({round(float(v), 9) for bound in panels[name].lines[2:] for v in bound.get_ydata()})
        assert drawn == ([-20.0, 20.0] if name == "x-force" else [0.1])
    reference = panels["x"].lines[0]
    np.testing.assert_array_equal(reference.get_ydata(), x[:, 0])
    assert len(panels["theta"].lines) == 2  # no limit, but a reference


def test_reference_has_gaps_where_nothing_was_wanted(cart: Trajectory) -> None:
    keyframes = np.full(cart.q.shape, np.nan)
    keyframes[[10, -1], 1] = 3.0
    panels = axes_of(plot_run(cart, reference=keyframes))
    assert len(panels["x"].lines) == 1
    dots = panels["theta"].lines[0]
    assert dots.get_marker() == "o"
    assert list(dots.get_markevery()) == [10, len(cart.t) - 1]


def test_reference_is_a_run_a_result_or_arrays_of_the_first_columns(cart: Trajectory) -> None:
    other = pushed_cart(2.0)
    for reference in (other, other.q, other.x, (other.x, other.inputs)):
        panels = axes_of(plot_run(cart, reference=reference))
        np.testing.assert_allclose(panels["theta"].lines[0].get_ydata(), np.degrees(other["theta"]))
        assert len(panels["x-force"].lines) == (1 if isinstance(reference, np.ndarray) else 2)


def test_a_few_of_a_unit_share_a_panel_and_many_have_small_ones() -> None:
    m = four_bars.four_bars(loops=1)
    vi = MidpointVI(m)
    few = plot_run(vi.simulate(vi.start(*four_bars.at_angle(m, 1.0, 0.5)), T))
    (axes,) = few.axes
    assert [drawn.get_label() for drawn in axes.lines] == list(m.variables)
    looks = [(drawn.get_color(), drawn.get_linestyle(), drawn._dash_pattern) for drawn in axes.lines]
    assert len({color for color, *_ in looks}) == len({str(dashes) for *_, dashes in looks}) == 3
    hand = build("hand")
    vi = MidpointVI(hand)
    figure = plot_run(vi.simulate(vi.start(np.zeros(hand.nq)), T[:5]))
    assert [axes.get_title(loc="left") for axes in figure.axes] == [*hand.variables, *hand.inputs]
    assert len({round(axes.get_position().x0, 6) for axes in figure.axes}) == 4
    ends = [axes.get_position() for axes in figure.axes]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(ends, 2))


def test_a_line_that_hardly_moves_does_not_cut_off_those_beside_it() -> None:
    m = Mechanism([tx("still", mass=1.0), ty("moved", mass=1.0)], [])
    vi = MidpointVI(m)
    (axes,) = plot_run(vi.simulate(vi.start([0.0, 0.0], [0.0, 5.0]), np.linspace(0.0, 1.0, 11))).axes
    low, high = axes.get_ylim()
    assert low <= 0.0
    assert high >= 5.0


def test_result_of_no_mechanism_shows_its_states(tmp_path: Any) -> None:
    system = FunctionSystem(lambda x, u, k: x + 0.1 * u, nx=2, nu=2, N=20, derivatives="complex-step")
    x, u = np.ones((21, 2)), np.zeros((20, 2))
    result = optimize(system, QuadraticCost(x, u, Q=[1.0, 2.0], R=[0.1, 0.1]), initial=(np.zeros(2), u))
    figure = plot_run(result)
    assert [axes.get_ylabel() for axes in figure.axes] == ["state", "input"]
    save_png(figure, tmp_path / "a.png", dpi=40)
    with pytest.raises(ArgumentError, match="knows no mechanism"):
        plot_energy(result)


def test_wrong_arguments_are_named(cart: Trajectory) -> None:
    for draw in (plot_run, plot_energy, plot_residuals, plot_reactions):
        with pytest.raises(ArgumentError, match=f"{draw.__name__}: got int, expected a run"):
            draw(3)  # type: ignore[operator]
    with pytest.raises(ArgumentError, match=r"plot_run: names: unknown name 'tetha'.*'theta'"):
        plot_run(cart, "tetha")
    with pytest.raises(ArgumentError, match="names: got no names"):
        plot_run(cart, [])
    with pytest.raises(ArgumentError, match="plot_run: reference"):
        plot_run(cart, reference=cart.q[1:])
    with pytest.raises(ArgumentError, match="got 5 columns, expected those of 4 states at most"):
        plot_run(cart, reference=np.zeros((51, 5)))
    with pytest.raises(ArgumentError, match="limits: unknown name 'push'"):
        plot_run(cart, limits=[Bound("push", -1.0, 1.0)])
    with pytest.raises(ArgumentError, match="expected a number"):
        plot_run(cart, limits=[Bound("x-force", max=np.zeros(7))])
    with pytest.raises(ArgumentError, match="without constraints"):
        plot_reactions(cart)
    short = MidpointVI(cart_pendulum())
    with pytest.raises(ArgumentError, match="got a run of 1 steps"):
        plot_energy(short.simulate(short.start([0.0, 0.1]), [0.0, 0.1]))


def lifted() -> Mechanism:
    """Return a block that hangs on a prescribed hook by a string, damped."""
    return Mechanism(
        [
            tz("hook", name="hook", kinematic=True),
            tz("z", name="block", mass=2.0),
        ],
        [Gravity((0.0, 0.0, -9.81)), Damping({"z": 0.5}), Distance("hook", "block", 1.0, name="string")],
    )


def test_string_holds_the_weight_and_what_it_takes_to_lift() -> None:
    m = lifted()
    vi = MidpointVI(m)
    hook = 1.0 + 0.5 * 3.0 * T**2  # lifted with 3 m/s^2
    q0 = m.configuration({"hook": 1.0, "z": 0.0})
    run = vi.simulate(vi.start(q0), T, rho=hook[:, None])
    (tension,) = reactions_of(run)
    speed = 3.0 * tension.t
    assert tension.unit == "N"
    np.testing.assert_allclose(tension.values, 2.0 * (9.81 + 3.0) + 0.5 * speed, rtol=1e-9)
    (axes,) = plot_reactions(run).axes
    assert axes.get_title(loc="left") == "string"
    assert axes.get_ylabel() == "force (N)"


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_balance_is_kept_where_motors_push_and_dampers_take(kind: str) -> None:
    m = Mechanism(
        [
            tx("x", name="cart", mass=1.0),
            [rz("theta", name="arm"), [ty(-0.5, name="bob", mass=0.4)]],
        ],
        [Gravity((0.0, -9.81, 0.0)), Damping(0.3), JointForce("x", "push")],
    )
    t = np.linspace(0.0, 2.0, 401)
    run: Trajectory | ContinuousTrajectory
    if kind == "discrete":
        vi = MidpointVI(m)
        run = vi.simulate(vi.start([0.0, 0.5]), t, inputs=5.0 * np.sin(4.0 * t[:-1, None]))
    else:
        run = simulate(m, [0.0, 0.5], None, t[::20], inputs=lambda at, _: [5.0 * np.sin(4.0 * at)])
    found = work_and_energy(run)
    assert np.ptp(found.work) > 0.2 * found.scale
    assert np.abs(found.balance).max() < (1e-4 if kind == "discrete" else 1e-6) * found.scale
    figure = plot_energy(run)
    above, below = figure.axes
    assert [drawn.get_label() for drawn in above.lines] == ["kinetic", "potential", "total", "work done"]
    assert above.get_ylabel() == "energy (J)"
    np.testing.assert_array_equal(below.lines[1].get_ydata(), found.balance)


def test_balance_counts_what_prescribed_motion_does() -> None:
    m = lifted()
    vi = MidpointVI(m)
    hook = 1.0 + 0.1 * (1.0 - np.cos(5.0 * T))
    run = vi.simulate(vi.start(m.configuration({"hook": 1.0, "z": 0.0})), T, rho=hook[:, None])
    found = work_and_energy(run)
    assert np.ptp(found.work) > 0.5
    assert np.abs(found.balance).max() < 2e-3 * found.scale


def test_balance_tells_of_a_run_that_is_no_motion(cart: Trajectory) -> None:
    from dataclasses import replace

    honest = work_and_energy(cart)
    wrong = work_and_energy(replace(cart, inputs=0.5 * cart.inputs))
    assert np.abs(wrong.balance).max() > 50.0 * np.abs(honest.balance).max()


def test_residuals_are_those_of_rounding_and_show_what_is_off() -> None:
    from dataclasses import replace

    m = four_bars.four_bars(loops=1)
    vi = MidpointVI(m)
    run = vi.simulate(vi.start(*four_bars.at_angle(m, 1.0, 0.5)), T)
    figure = plot_residuals(run)
    assert [axes.get_ylabel() for axes in figure.axes] == ["constraint (m)", "equations (relative)"]
    for axes in figure.axes:
        assert max(drawn.get_ydata().max() for drawn in axes.lines if len(drawn.get_ydata())) < 1e-10
    q = run.q.copy()
    q[20, 0] += 1e-3
    off = plot_residuals(replace(run, q=q))
    gap = np.abs(m.constraint_values(q[20])).max()
    assert max(drawn.get_ydata().max() for drawn in off.axes[0].lines if len(drawn.get_ydata())) == pytest.approx(gap)
    assert max(drawn.get_ydata().max() for drawn in off.axes[1].lines if len(drawn.get_ydata())) > 1e-4
    continuous = plot_residuals(simulate(m, *four_bars.at_angle(m, 1.0, 0.5), T))
    labels = [axes.get_ylabel() for axes in continuous.axes]
    assert labels == ["constraint (m)", "its rate (m/s)", "equations (relative)"]


def test_reactions_in_continuous_time_are_those_of_steps() -> None:
    m = Mechanism(
        [tx("x"), [ty("y"), [rx("turn", name="rod", mass=1.0, inertia=(0.1, 0.1, 0.1))]]],
        [Gravity((0.0, -9.81, 0.0)), PointToPoint("rod", "world", "xy", name="pin")],
    )
    vi = MidpointVI(m)
    (_, discrete), (_, continuous) = (
        reactions_of(vi.simulate(vi.start(np.zeros(3)), T)),
        reactions_of(simulate(m, np.zeros(3), None, T)),
    )
    assert discrete.unit == continuous.unit == "N"
    np.testing.assert_allclose(discrete.values, continuous.values[1:-1], rtol=1e-6)
    assert abs(continuous.values[0]) == pytest.approx(9.81)


def test_several_runs_are_drawn_over_each_other(cart: Trajectory) -> None:
    other = simulate(cart_pendulum(), [0.0, 0.3], None, T[:26])
    figure = plot_run({"pushed": cart, "let go": other}, ["theta", "p_x"])
    panels = axes_of(figure)
    first, second = panels["theta"].lines
    np.testing.assert_allclose(first.get_ydata(), np.degrees(cart["theta"]))
    np.testing.assert_allclose(second.get_ydata(), np.degrees(other["theta"]))
    assert first.get_color() != second.get_color()
    assert len(panels["p_x"].lines) == 1  # the other one has velocities
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["pushed", "let go"]
    assert panels["theta"].get_xlim() == (0.0, 1.0)
    # A variable that moves joints of both kinds has no unit of its own: it is drawn as that of the first run.
    nut = Mechanism([tz(0.1 * var("theta")), [rz(var("theta"), mass=1.0, inertia=(1.0, 1.0, 1.0))]], [Gravity()])
    vi = MidpointVI(nut)
    turned = vi.simulate(vi.start([0.3]), T)
    drawn = plot_run({"pushed": cart, "nut": turned}, "theta", reference=turned).axes[0].lines
    for line_ in (drawn[0], drawn[2]):
        np.testing.assert_allclose(line_.get_ydata(), np.degrees(turned["theta"]))
    with pytest.raises(ArgumentError, match="got no runs"):
        plot_run({})
    with pytest.raises(ArgumentError, match="got ndarray, expected a run"):
        plot_run({"pushed": cart, "let go": cart.q})  # type: ignore[dict-item]


def test_figures_are_written_under_each_other(cart: Trajectory, tmp_path: Any) -> None:
    from matplotlib.image import imread

    tall, low = plot_run(cart), plot_energy(cart)
    both = imread(save_png([tall, low], tmp_path / "both.png", dpi=50))
    heights = [imread(save_png(figure, tmp_path / "one.png", dpi=50)).shape[0] for figure in (tall, low)]
    assert both.shape[:2] == (sum(heights), 400)
    assert (both[: heights[0]].min(), both[heights[0] :].min()) < (0.5, 0.5)
    with pytest.raises(ArgumentError, match="got no figures"):
        save_png([], tmp_path / "none.png")


def test_an_input_may_have_the_name_of_a_variable() -> None:
    m = Mechanism([rz("arm", mass=1.0, inertia=(1.0, 1.0, 1.0))], [JointForce("arm", input="arm")])
    vi = MidpointVI(m)
    run = vi.simulate(vi.start([0.0]), T, inputs=2.0 * np.ones((50, 1)))
    angle, torque = plot_run(run, reference=(run.q, run.inputs), limits=[Bound("arm", max=2.0)]).axes
    assert [axes.get_ylabel() for axes in (angle, torque)] == ["angle (°)", "torque (N m)"]
    np.testing.assert_allclose(angle.lines[1].get_ydata(), np.degrees(run.q[:, 0]))
    assert set(torque.lines[1].get_ydata()) == {2.0}
    assert (len(angle.lines), len(torque.lines)) == (2, 3)  # a limit is one of the input first
    assert shaded(torque) == [(0.0, 1.0)]
    (angle, _) = plot_run(run, limits=[Bound("arm", max=2.0, of="variable")]).axes
    assert set(np.round(angle.lines[1].get_ydata(), 9)) == {round(np.degrees(2.0), 9)}
    cost = QuadraticCost(np.ones((51, 2)), np.zeros((50, 1)), Q=[1.0, 0.0], R=[1e-3])
    limits = [Bound("arm", max=0.4, of="input"), Bound("arm", max=0.1, of="variable")]
    result = optimize(MidpointSystem(vi, T), cost, initial=(np.zeros(2), np.zeros((50, 1))), limits=limits)
    angle, torque = plot_run(result).axes
    assert set(np.round(angle.lines[1].get_ydata(), 6)) == {round(np.degrees(0.1), 6)}
    assert set(np.round(torque.lines[1].get_ydata(), 6)) == {0.4}


def test_poses_are_pictures_with_their_times(cart: Trajectory) -> None:
    figure = plot_poses(cart, [0.0, 0.5], title="A cart")
    assert [axes.get_title() for axes in figure.axes] == ["0 s", "0.5 s"]
    first, second = (np.asarray(axes.images[0].get_array()) for axes in figure.axes)
    assert first.shape == second.shape
    assert np.mean(np.any(first != second, axis=2)) > 0.005  # it moved
    with pytest.raises(ArgumentError, match=r"times: got \[2.0\], expected some from 0 to 1 s"):
        plot_poses(cart, [2.0])
    with pytest.raises(ArgumentError, match="plot_poses: got int, expected a run"):
        plot_poses(3)  # type: ignore[arg-type]
