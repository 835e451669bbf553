"""Following a wanted motion by names, with mechanisms that are no puppets."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from leastaction import (
    Bound,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    MidpointSystem,
    MidpointVI,
    PlaceCost,
    PointToPoint,
    QuadraticCost,
    Status,
    follow,
    optimize,
    play,
    pose,
    project_configuration,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from leastaction.errors import ArgumentError
from leastaction.io import Motion
from leastaction.mechanics import State
from leastaction.models.cart_pendulum import cart_pendulum
from leastaction.models.puppet_arm import hang, puppet_arm
from leastaction.optimal import OptimizationResult, check_derivatives
from leastaction.systems.following.ways import Ways, rank

# Curves are followed by few steps, for the ways: shorter steps would have other minima.
pytestmark = [
    pytest.mark.filterwarnings("ignore::leastaction.errors.CoarseStepWarning"),
    pytest.mark.filterwarnings("ignore::leastaction.errors.EnergyBalanceWarning"),
]

T = np.linspace(0.0, 2.0, 101)
ARM = Mechanism(
    [rz("shoulder"), [ty(-0.5, mass=1.0, name="elbow end"), [rz("elbow"), [ty(-0.4, mass=0.5, name="hand")]]]],
    [Gravity((0.0, -9.81, 0.0)), JointForce("shoulder", "turn"), JointForce("elbow", "bend")],
)
# The hand goes round a circle.
CIRCLE = np.stack([0.2 + 0.1 * np.sin(np.pi * T), -0.6 + 0.1 * np.cos(np.pi * T), 0.0 * T], axis=1)


@pytest.mark.parametrize("steps", [T, np.linspace(0.0, 1.0, 21) ** 1.3])
def test_places_of_frames_have_exact_derivatives(steps: np.ndarray) -> None:
    m = Mechanism([rx("a"), [ty(0.3), [rz("b"), [ty(-0.4, mass=0.5, name="hand")]]]], [Gravity(), JointForce("a", "f")])
    system = MidpointSystem(MidpointVI(m), steps)
    rng = np.random.default_rng(1)
    n = len(steps)
    plain = QuadraticCost(np.zeros((n, 4)), np.zeros((n - 1, 1)), Q=[1.0, 0.0, 0.1, 0.1], R=[0.1])
    places = rng.normal(size=(n, 3))
    places[3] = np.nan
    cost = PlaceCost(plain, system, {"hand": places}, {"hand": 3.0})
    x, u = rng.normal(size=(n, 4)), rng.normal(size=(n - 1, 1))
    assert check_derivatives(system, 0.1 * x, 0.1 * u, cost=cost).ok
    away = m.positions(x[:, :2], ["hand"])[:, 0] - places
    assert cost.value(x, u) == pytest.approx(plain.value(x, u) + 1.5 * np.nansum(away**2))
    # A part of it costs what it costs there.
    part = cost.window(2, 5, N=n - 1, nu=1)
    np.testing.assert_allclose(part.stage_values(x[2:5], u[2:5], 0), cost.stage_values(x[2:5], u[2:5], 2))


def test_the_hand_of_an_arm_goes_where_it_is_wanted() -> None:
    found = follow(ARM, {"hand": CIRCLE}, {"hand": 100.0}, t=T)
    assert found.result.success
    # It begins at rest, and the circle does not.
    assert found.errors["hand"] < 0.01
    made = found.trajectory.mechanism.positions(found.trajectory.q, ["hand"])[:, 0]
    assert np.abs(made - CIRCLE)[20:].max() < 2e-3
    assert set(found.errors) == {"hand"}
    # As found by hand, with the cost that its weights are short for.
    found = follow(ARM, {"hand": CIRCLE}, {"hand": 100.0, "shoulder": 0.0, "elbow": 0.0}, t=T)
    m = found.system.integrator.mechanism
    plain = QuadraticCost(0.0 * found.result.x, 0.0 * found.result.u, Q=np.zeros(m.nx), R=[1e-6, 1e-6])
    cost = PlaceCost(plain, found.system, {"hand": CIRCLE}, {"hand": 100.0})
    again = optimize(found.system, cost, initial=(found.result.x, found.result.u))
    assert again.cost == pytest.approx(found.result.cost, rel=1e-6)


def test_the_convex_part_of_a_places_price_is_gauss_and_newtons() -> None:
    m = ARM
    system = MidpointSystem(MidpointVI(m), T[:5])
    rng = np.random.default_rng(2)
    plain = QuadraticCost(np.zeros((5, 4)), np.zeros((4, 2)), Q=np.zeros(4), R=[0.1, 0.1])
    cost = PlaceCost(plain, system, {"hand": 3.0 * rng.normal(size=(5, 3))}, {"hand": 2.0})
    x, u = rng.normal(size=(5, 4)), rng.normal(size=(4, 2))
    J = m.frame_jacobian(x[:, :2], "hand")[:, :3]
    convex, exact = cost.convex_hessian(x, u), cost.hessian(x, u)
    np.testing.assert_allclose(convex.Q[:, :2, :2], 2.0 * (np.swapaxes(J, 1, 2) @ J)[:-1], atol=1e-14)
    assert np.linalg.eigvalsh(exact.Q).min() < -0.1  # so far away it does bend downwards


# Six joints, of which the last three hardly move the tool; and two arms that hold one point together.
SIX = Mechanism(
    [rz("j1"), [tz(0.3), [ry("j2"), [tx(0.2, mass=3, inertia=(0.01, 0.05, 0.05)), tx(0.4), [
        ry("j3"), [tx(0.2, mass=2, inertia=(0.01, 0.03, 0.03)), tx(0.4), [
            rx("j4"), [ry("j5"), [rz("j6"), [
                tx(0.1, mass=0.5, inertia=(0.001, 0.001, 0.001)), tx(0.15, name="tool")]]]]]]]]]],
    [Gravity(), Damping({f"j{i}": 0.1 for i in range(1, 7)}), *(JointForce(f"j{i}", f"u{i}") for i in range(1, 7))],
)  # fmt: skip
FIVE_BAR = Mechanism(
    [ry("a"), [tx(0.25, mass=0.3), tx(0.5), [ry("b"), [tx(0.3, mass=0.2), tx(0.6, name="tip")]]],
     tx(0.4), [ry("c"), [tx(0.25, mass=0.3), tx(0.5), [ry("d"), [tx(0.3, mass=0.2), tx(0.6, name="other tip")]]]]],
    [Gravity(), JointForce("a", "left"), JointForce("c", "right"), PointToPoint("tip", "other tip", axes="xz")],
)  # fmt: skip
LONG = np.linspace(0.0, 3.0, 301)
EIGHT = np.stack(
    [
        0.5 + 0.1 * np.cos(2 * np.pi * LONG / 3),
        0.3 * np.sin(2 * np.pi * LONG / 3),
        0.4 + 0.1 * np.sin(4 * np.pi * LONG / 3),
    ],
    axis=1,
)
ROUND = np.stack(
    [0.2 + 0.1 * np.sin(4 * np.pi * LONG / 3), 0.0 * LONG, -0.8 + 0.1 * np.cos(4 * np.pi * LONG / 3)], axis=1
)


@pytest.mark.parametrize(
    ("mechanism", "frame", "path", "weight", "error", "most"),
    [(SIX, "tool", EIGHT, 100.0, 1e-3, 15), (FIVE_BAR, "tip", ROUND, 1.0, 4e-3, 8)],
    ids=["arm of six joints", "five-bar"],
)
def test_places_are_followed_at_once(
    mechanism: Mechanism, frame: str, path: np.ndarray, weight: float, error: float, most: int
) -> None:
    """The inputs of the start are those of the wanted motion, and a loop stays on its branch."""
    found = follow(mechanism, {frame: path}, {frame: weight}, t=LONG)
    assert found.result.success
    assert found.way == "from the wanted motion"
    assert found.result.iterations <= most
    assert found.errors[frame] < error


def drones() -> tuple[Mechanism, State]:
    """A plate on three ropes under three drones, hovering."""
    hooks: list[Any] = []
    plate = rz("c", mass=0.6, inertia=(0.01, 0.01, 0.02), name="plate")
    tree: list[Any] = [tx("x"), [ty("y"), [tz("z"), [rx("a"), [ry("b"), [plate, hooks]]]]]]
    elements: list[Any] = [Gravity()]
    where = {}
    for i, angle in enumerate(2.0 * np.pi * np.arange(3) / 3.0):
        side = np.array([np.cos(angle), np.sin(angle)])
        hooks.append(pose(translation=(*(0.2 * side), 0.0), name=f"hook {i}"))
        tree += [tx(f"x{i}"), [ty(f"y{i}"), [tz(f"z{i}", mass=0.5, name=f"drone {i}")]]]
        where |= {f"x{i}": 0.6 * side[0], f"y{i}": 0.6 * side[1], f"z{i}": float(np.sqrt(0.8**2 - 0.4**2))}
        elements.append(Distance(f"drone {i}", f"hook {i}", length=0.8, name=f"rope {i}"))
        elements += [JointForce(f"{axis}{i}", input=f"f{axis}{i}") for axis in "xyz"]
    carrier = Mechanism(tree, elements)
    return carrier, MidpointVI(carrier).start(carrier.configuration(where))


def test_what_is_carried_goes_where_it_is_wanted_and_its_carriers_find_their_way() -> None:
    """Only the plate's place is said: no pose of the drones follows from that. The search had taken 957 iterations."""
    carrier, hovering = drones()
    s = np.linspace(0.0, 1.0, 101)
    way = np.stack([2.0 * (3.0 * s**2 - 2.0 * s**3), 0.0 * s, 0.0 * s], axis=1)
    limits = [Bound("rope*", 0.5, 12.0, of="tension"), Bound("fz*", 0.0, 14.0), Bound("fx*", -6.0, 6.0)]
    told: list[str] = []
    found = follow(carrier, {"plate": way}, {"plate": 200.0}, limits, t=2.5 * s, start=hovering, progress=told.append)
    assert found.result.success, found.result.message
    assert found.errors["plate"] < 1e-3
    assert found.result.limits is not None
    assert found.result.limits.excess < 1e-6
    assert any(found.way in line for line in told)
    x = found.result.x[-1]
    assert np.ptp([x[carrier.variables.index(f"x{i}")] for i in range(3)]) < 2.0  # they came along


def test_what_an_arm_reaches_only_when_stretched_is_not_approached_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the last millimetres take ever shorter steps: a hundred at each instant, most of the time of a search."""
    asked, jacobian = [], Mechanism.frame_jacobian

    def counted(m: Mechanism, *given: Any, **options: Any) -> np.ndarray:
        asked.append(given)
        return jacobian(m, *given, **options)

    monkeypatch.setattr(Mechanism, "frame_jacobian", counted)
    t = np.linspace(0.0, 0.4, 21)
    stretched = np.tile([0.0, -0.9, 0.0], (21, 1))
    bent = MidpointVI(ARM).start(ARM.configuration({"shoulder": 0.3, "elbow": -0.7}))
    found = follow(ARM, {"hand": stretched}, {"hand": 100.0}, t=t, start=bent)
    assert found.result.success
    assert len(asked) < 21 * 40


def test_a_result_that_keeps_to_its_limits_is_better_than_a_cheaper_one() -> None:
    system = MidpointSystem(MidpointVI(cart_pendulum()), np.linspace(0.0, 0.4, 21))
    wanted = np.zeros((21, 4))
    wanted[:, 0] = 1.0
    cost = QuadraticCost(wanted, np.zeros((20, 1)), Q=[1.0, 0.0, 0.0, 0.0], R=[1e-4])
    start, limits = (np.zeros(4), np.zeros((20, 1))), [Bound("x-force", -1.0, 1.0)]
    kept = optimize(system, cost, initial=start, limits=limits)
    free = optimize(system, cost, initial=start)
    broken = optimize(system, cost, initial=free, limits=limits, max_iterations=0)
    assert broken.cost < kept.cost
    assert min([broken, kept], key=rank) is kept


def test_a_heavily_shifted_model_that_expects_nothing_is_no_minimum() -> None:
    """Of a loop that jumps from one branch to the other: an end that claims a minimum has one."""
    system = MidpointSystem(MidpointVI(FIVE_BAR), LONG[:151], multipliers=True)
    q = np.zeros((151, 4))
    for k in range(151):
        guess = [0.55, 1.06, 0.82, 1.35] if k < 2 else [-0.9, 0.5, -0.05, -1.58]
        q[k] = project_configuration(FIVE_BAR, guess, attempts=1).q
    x = np.hstack([q, np.zeros((151, 6))])
    u = np.zeros((150, 2))
    cost = PlaceCost(QuadraticCost(x, u, Q=np.zeros(10), R=[1e-6, 1e-6]), system, {"tip": ROUND[:151]}, {"tip": 1.0})
    found = optimize(system, cost, initial=(x, u), shooting="multiple", max_iterations=40, tolerance=1e-6)
    if found.status is Status.CONVERGED:
        assert found.expected_decrease <= 1e-6 * found.cost


def test_limits_are_kept_to_and_what_they_cost_is_seen() -> None:
    free = follow(ARM, {"hand": CIRCLE}, {"hand": 100.0}, t=T)
    most = 0.8 * np.abs(free.result.u[:, 0]).max()
    found = follow(ARM, {"hand": CIRCLE}, {"hand": 100.0}, [Bound("turn", -most, most)], t=T)
    assert found.result.success
    assert np.abs(found.result.u[:, 0]).max() <= most * (1.0 + 1e-6)
    assert found.result.cost > free.result.cost


def test_a_cart_follows_and_its_pendulum_stays_up() -> None:
    m = cart_pendulum()
    wanted = Motion(("x", "theta"), T, np.stack([0.3 * np.sin(np.pi * T) ** 2, np.full(101, np.pi)], axis=1))
    found = follow(m, wanted, {"x": 10.0, "x-force": 1e-5}, [Bound("x-force", -60.0, 60.0)])
    assert found.result.success
    assert found.errors["x"] < 0.12
    assert found.errors["theta"] < 0.15
    assert np.abs(found.result.u).max() <= 60.0 * (1.0 + 1e-6)
    # The plan and its feedback are good for a rig.
    assert play(found.system, found.result).off(found.result.x[:, :2], "theta") < 0.05


def test_an_arm_on_a_string_that_pulls() -> None:
    m = puppet_arm()
    angles = np.stack([0.35 + 0.2 * np.sin(np.pi * T / 2.0) ** 2, 0.5 + 0.2 * np.sin(np.pi * T / 2.0) ** 2], axis=1)
    start = MidpointVI(m).start(hang(m, angles[0]))
    weights = {"shoulder": 100.0, "elbow": 100.0, "acceleration of string-*": 1e-3}
    found = follow(
        m,
        {"shoulder": angles[:, 0], "elbow": angles[:, 1]},
        weights,
        [Bound("string", min=0.2, of="tension")],
        t=T,
        start=start,
        tolerance=1e-4,
    )
    assert found.result.success
    assert found.trajectory.tensions()["string"].min() > 0.2 - 1e-4
    assert np.degrees(max(found.errors.values())) < 10.0
    np.testing.assert_array_equal(found.result.x[0, : m.nq], start.q)


def test_keyframes_are_met_and_what_is_between_them_is_free() -> None:
    key = np.full(101, np.nan)
    key[[0, 30, 60, 100]] = 0.0, 0.5, -0.2, 0.3
    slide = Mechanism([tx("x", mass=1.0, name="block")], [JointForce("x", "push")])
    found = follow(slide, {"x": key}, {"push": 1e-7}, t=T)
    assert found.result.success
    assert found.errors["x"] < 1e-3
    assert "x " in str(found)
    # The least effort through keyframes: its jumps are at them, and it changes linearly between.
    bends = np.abs(np.diff(found.result.u[:, 0], n=2))
    assert bends[[k for k in range(98) if min(abs(k + 1 - np.array([30, 60]))) > 1]].max() < 1e-6 * bends.max()
    places = np.full((101, 3), np.nan)
    places[:, 0] = key
    by_frame = follow(slide, {"block": places}, {"push": 1e-7, "x": 0.0}, t=T)
    np.testing.assert_allclose(by_frame.result.x, found.result.x, atol=1e-6)
    assert by_frame.errors["block"] == pytest.approx(found.errors["x"], abs=1e-8)


def test_keyframes_of_a_closed_linkage() -> None:
    key = np.full(101, np.nan)
    begins = project_configuration(FIVE_BAR, FIVE_BAR.configuration(), attempts=20).q
    key[[0, 40, 100]] = begins[0] + np.array([0.0, 0.15, -0.1])
    found = follow(FIVE_BAR, {"a": key}, t=T, start=MidpointVI(FIVE_BAR).start(begins))
    assert found.result.success
    assert found.errors["a"] < 1e-2


def test_what_is_wrong_with_limits_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("leastaction.systems.following.ways.optimized", None)  # it is not even tried
    with pytest.raises(ArgumentError, match=r"^follow: Bound\('turm'\): unknown name 'turm'"):
        follow(ARM, {"hand": CIRCLE}, t=T, limits=[Bound("turm", -1.0, 1.0)])


def test_what_is_wrong_with_every_way_is_told_as_it_is() -> None:
    with pytest.raises(ArgumentError, match=r"^follow: Bound\('elbow'\): .*the initial state is fixed"):
        follow(ARM, {"elbow": np.full(101, 0.5)}, t=T, limits=[Bound("elbow", max=0.2)])


def test_what_had_not_arrived_without_limits_goes_on_before_its_limits_are_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As rounding has it, the search without limits takes more than a round, and from its way there limits lose it."""
    system = MidpointSystem(MidpointVI(ARM), T)
    cost = QuadraticCost(np.zeros((101, 4)), np.zeros((100, 2)), Q=np.ones(4), R=np.ones(2))
    start = np.zeros((101, 4)), np.zeros((100, 2))
    plain = optimize(system, cost, initial=start, max_iterations=0)
    calls: list[tuple[str, int]] = []

    def scripted(*_: Any, max_iterations: int, initial: Any = None, limits: Any = (), **resume: Any) -> Any:
        calls.append(("limited" if limits else "free", max_iterations))
        if not limits:
            return replace(plain, status=Status.CONVERGED if "resume" in resume else Status.ITERATION_LIMIT, cost=1.0)
        if isinstance(initial, OptimizationResult) and initial.success:
            return replace(plain, status=Status.CONVERGED, cost=2.0)
        return replace(plain, status=Status.LINE_SEARCH_FAILED, cost=3.0)

    monkeypatch.setattr("leastaction.systems.following.ways.optimized", scripted)
    ways = Ways(system, cost, [Bound("turn", -1.0, 1.0)], [start, start], {}, None)
    way, found = ways.search(1000)
    assert (way, found.cost) == ("from what is found without limits", 2.0)
    first = [("limited", 60), ("limited", 60), ("free", 60), ("free", 60), ("limited", 60)]
    assert calls == [*first, ("free", 300), ("free", 300), ("limited", 300)]


def test_wrong_arguments_are_named() -> None:
    for arguments, options, message in (
        (({"hant": CIRCLE},), {"t": T}, "nothing is called 'hant'.*hand"),
        (({"hand": CIRCLE},), {}, "t: got none"),
        ((Motion(("elbow",), T, T[:, None]),), {"t": T}, "times of its own"),
        (({},), {"t": T}, "nothing that is wanted"),
        (({"hand": CIRCLE[1:]},), {"t": T}, "motion: 'hand'"),
        (({"hand": CIRCLE * np.nan},), {"t": T}, "motion: 'hand': got nothing but NaN"),
        (({"elbow": np.where(T > 1.0, np.inf, np.nan)},), {"t": T}, "motion: 'elbow': got inf"),
        (({"elbow": "high"},), {"t": T}, "motion: 'elbow': got 'high'"),
        (({"hand": CIRCLE}, {"foot": 1.0}), {"t": T}, "weights: nothing is called 'foot'"),
        (({"hand": CIRCLE}, {"hand": -1.0}), {"t": T}, "expected a number >= 0"),
        (({"hand": CIRCLE}, {"turn": 0.0}), {"t": T}, "'turn' has none"),
    ):
        with pytest.raises(ArgumentError, match=message):
            follow(ARM, *arguments, **options)  # type: ignore[arg-type]


def test_a_weight_without_a_place_is_named() -> None:
    system = MidpointSystem(MidpointVI(ARM), T)
    plain = QuadraticCost(np.zeros((101, 4)), np.zeros((100, 2)), Q=np.ones(4), R=np.ones(2))
    with pytest.raises(ArgumentError, match=r"weights: 'hant' has no place that is wanted; did you mean 'hand'"):
        PlaceCost(plain, system, {"hand": CIRCLE}, {"hant": 1.0})


def test_a_start_that_is_no_state_is_named() -> None:
    with pytest.raises(ArgumentError, match=r"start: got .*ndarray.*expected a State; MidpointVI\(mechanism\).start"):
        follow(ARM, {"hand": np.zeros((101, 3))}, t=T, start=np.zeros(2))
