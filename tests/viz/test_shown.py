"""What `show` draws of a mechanism: bodies, rails, springs, strings, forces, references, limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import leastaction
from api.saving_cases import played
from leastaction import (
    Body,
    Distance,
    ElasticString,
    Gravity,
    JointForce,
    Mechanism,
    MidpointVI,
    TendonForce,
    free,
    rz,
    show,
    simulate,
    tx,
    ty,
    tz,
)  # fmt: skip
from leastaction.errors import ArgumentError, DescriptionError
from leastaction.mechanics.description.shapes import Shape
from leastaction.models import MODELS, build
from leastaction.models.hand import hand, posture
from leastaction.models.marionette import marionette, rest_pose
from leastaction.viz import Scene
from leastaction.viz.viewer.show import active_limits
from leastaction.viz.viewer.skeletons import equivalent_box
from leastaction.viz.viewer.stage import staged
from viz import scenes


def only(view: leastaction.viz.View) -> Scene:
    (scene,) = view.scenes
    return scene


def test_a_body_is_drawn_as_the_box_that_has_its_inertia() -> None:
    m, (a, b, c) = 3.0, (0.2, 0.5, 0.9)
    inertia = m / 12.0 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    sides, _ = equivalent_box(Body(m, inertia=inertia))
    np.testing.assert_allclose(np.sort(sides), [a, b, c])
    scene = only(show(Mechanism([free("f", axes="xyz", mass=m, inertia=inertia, name="box")])))
    (shape,) = scene.shapes
    assert shape.kind == "box"
    assert shape.frame == "box"
    np.testing.assert_allclose(np.sort(shape.size), [a, b, c])
    assert scene.focus == "box"  # it floats, so the camera follows it


def test_a_slide_is_on_a_rail_and_not_on_a_post() -> None:
    m = Mechanism(
        [tx("x", name="cart", mass=2.0), [rz("a"), [ty(-1.0, name="bob", mass=1.0)]]], [Gravity((0, -9.81, 0))]
    )
    scene = only(show(simulate(m, [0.5, 2.0], None, np.linspace(0.0, 1.0, 21))))
    assert {(bone.start, bone.end) for bone in scene.bones} == {("rz(a)", "bob")}
    rail, hinge = sorted(scene.marks, key=lambda mark: mark.kind, reverse=True)
    assert (rail.kind, rail.frame, rail.name) == ("slide", "world", "x")
    travel = simulate(m, [0.5, 2.0], None, np.linspace(0.0, 1.0, 21))["x"]
    assert rail.reach[0] < travel.min()
    assert rail.reach[1] > travel.max()
    assert (hinge.kind, hinge.frame) == ("hinge", "rz(a)")
    kinds = {shape.frame: shape.kind for shape in scene.shapes}
    assert kinds == {"cart": "box", "bob": "sphere"}


def test_what_floats_has_no_rails() -> None:
    plane = Mechanism([tx("x"), [tz("z", name="bob", mass=1.0)]])
    gantry = Mechanism([tx("x", mass=1.0), [tz("z", name="bob", mass=1.0)]])
    assert [mark.name for mark in only(show(plane)).marks] == []
    assert [mark.name for mark in only(show(gantry)).marks] == ["x", "z"]
    m = marionette()
    scene = only(show(m, q=rest_pose(m)))
    assert all(mark.kind != "slide" for mark in scene.marks)
    assert scene.focus
    assert len([cord for cord in scene.cords if cord.kind == "string"]) == 6


def test_springs_and_dampers_say_what_they_pull() -> None:
    scene = only(scenes.suspended())
    assert {cord.name: cord.kind for cord in scene.cords} == {"spring": "spring", "damper": "damper"}
    assert scene.tension is not None
    own = np.flatnonzero(np.isin(scene.t, np.linspace(0.0, 2.0, 41)))
    z = scene.poses["block"][own, 2, 3]
    assert len(own) == 41
    np.testing.assert_allclose(scene.tension["spring"][own], 40.0 * (3.0 - z - 1.0), atol=1e-9)
    assert np.ptp(scene.tension["damper"]) > 0.01
    (wind,) = scene.arrows
    assert wind.kind == "force"
    np.testing.assert_allclose(wind.vector, np.broadcast_to([1.0, 0.0, 2.0], wind.vector.shape))
    np.testing.assert_allclose(wind.place, scene.poses["block"][:, :3, 3])


def test_strings_are_coloured_by_their_multipliers() -> None:
    m = Mechanism(
        [tz(2.0, name="hook"), tx("x"), [tz("z", name="bob", mass=2.0)]],
        [Gravity(), Distance("hook", "bob", "length", name="rope")],
    )  # fmt: skip
    vi = MidpointVI(m)
    q = m.configuration({"z": 1.0, "length": 1.0})
    run = vi.simulate(vi.start(q), np.linspace(0.0, 0.5, 26), rho=lambda t: [1.0])
    scene = only(show(run))
    (rope,) = scene.cords
    assert (rope.kind, rope.path) == ("string", ("hook", "bob"))
    assert scene.tension is not None
    np.testing.assert_allclose(scene.tension["rope"][3:-3], 2.0 * 9.81, rtol=1e-6)


def test_strings_go_over_their_points_and_pull_by_their_laws() -> None:
    m = Mechanism(
        [tx(1.0, name="over"), tx(2.0, name="end"), tz("z", name="bob", mass=1.0)],
        [
            Gravity(),
            ElasticString(("bob", "over", "end"), 50.0, 1.8, name="cord"),
            TendonForce(("bob", "end"), "pull", 2.0, name="muscle"),
        ],
    )
    run = simulate(m, [-0.8], None, np.linspace(0.0, 0.2, 5), inputs=[3.0])
    scene = only(show(run))
    cord = next(cord for cord in scene.cords if cord.name == "cord")
    assert cord.path == ("bob", "over", "end")
    assert scene.tension is not None
    z = np.interp(run.t, scene.t, scene.points["bob"][:, 2])
    stretch = np.hypot(z, 1.0) + 1.0 - 1.8
    np.testing.assert_allclose(np.interp(run.t, scene.t, scene.tension["cord"]), 50.0 * stretch, rtol=1e-3)
    np.testing.assert_allclose(scene.tension["muscle"], 6.0)


def test_a_reaction_is_an_arrow_that_carries_the_weight() -> None:
    # A bar that cannot turn is pinned: the pin carries all of it.
    m = Mechanism(
        [tx("x"), [tz("z", name="end"), [tx(1.0, name="middle", mass=4.0)]], tz(0.0, name="bearing")],
        [Gravity(), leastaction.PointToPoint("end", "bearing", "xz", name="pin")],
    )
    run = simulate(m, [0.0, 0.0], None, np.linspace(0.0, 0.2, 5))
    (pin,) = only(show(run)).arrows
    assert (pin.kind, pin.name) == ("reaction", "pin")
    np.testing.assert_allclose(pin.vector, np.broadcast_to([0.0, 0.0, 4.0 * 9.81], pin.vector.shape), atol=1e-6)


def test_motors_are_torques_along_their_axes() -> None:
    m = Mechanism(
        [rz("a", mass=1.0, inertia=[0.1] * 3), [tx("x", mass=1.0)]], [JointForce("a", "turn"), JointForce("x", "push")]
    )
    run = simulate(m, [0.0, 1.0], None, np.linspace(0.0, 0.1, 3), inputs=[2.0, 3.0])
    arrows = {arrow.kind: arrow for arrow in only(show(run, up="z")).arrows}
    np.testing.assert_allclose(
        arrows["torque"].vector, np.broadcast_to([0.0, 0.0, 2.0], (len(arrows["torque"].vector), 3))
    )
    np.testing.assert_allclose(arrows["force"].vector[0], [3.0, 0.0, 0.0])


def test_shapes_replace_bars_and_reference_is_a_ghost() -> None:
    run = scenes.four_bar_run()
    shape = Shape(frame="B0", kind="box", size=[0.2, 0.2, 0.2])
    scene = only(show(run, shapes=[shape], reference=run.q[0], traces=["B0"], title="Linkage"))
    assert scene.bones == ()
    assert scene.shapes == (shape,)
    assert scene.ghost_poses is not None
    np.testing.assert_allclose(scene.ghost_poses["B0"], np.broadcast_to(scene.poses["B0"][0], scene.poses["B0"].shape))
    assert (scene.title, scene.traces) == ("Linkage", ("B0",))
    assert len(show([run, run]).scenes) == len(show(run, beside=run).scenes) == 2


def test_limits_mark_when_they_are_active() -> None:
    from leastaction.optimal import LimitReport, LimitState

    k = np.arange(5)
    dual = np.array([[0.0], [0.0], [3.0], [2.0], [0.0]])
    side = LimitState("Bound('push')", ("push <= 5",), False, k, np.ones((5, 1)), dual, np.ones(1), dual > 0.0)
    (limit,) = active_limits(LimitReport((side,), 1e-9, 0.0), np.linspace(0.0, 2.0, 5))
    assert (limit.name, limit.spans) == ("push <= 5", ((1.0, 2.0),))


@pytest.mark.parametrize("name", MODELS)
def test_every_ready_mechanism_can_be_shown(name: str) -> None:
    scene = only(show(build(name), joints=True))
    assert scene.bones or scene.shapes
    assert "<canvas" in show(scene).page()


def test_tendons_run_over_their_points() -> None:
    m = hand()
    assert any(len(cord.via) > 1 for cord in only(show(m, q=posture(m, 0.5))).cords)


def test_what_a_rig_did_moves() -> None:
    run = played()
    scene = only(show(run))
    places = run.mechanism.positions(run.q, ["bob"])[:, 0]
    assert places[-1] == pytest.approx(scene.points["bob"][-1])
    assert places[0] == pytest.approx(scene.points["bob"][0])
    assert np.abs(places[-1] - places[0]).max() > 1e-3


def test_what_cannot_be_shown() -> None:
    m = Mechanism([rz("a", name="arm", mass=1.0, inertia=[0.1] * 3)])
    with pytest.raises(ArgumentError, match="got int, expected a Mechanism"):
        show(3)
    with pytest.raises(ArgumentError, match="an empty list"):
        show([])
    with pytest.raises(ArgumentError, match="arm2"):
        show(m, traces=["arm2"])
    with pytest.raises(ArgumentError, match="traces: expected a list of frames, got the string 'arm'"):
        show(m, traces="arm")
    assert repr(show(m, title="An arm")) == (
        "<View of 'An arm': .open() shows it in the browser, .save('view.html') writes it>"
    )
    with pytest.raises(ArgumentError, match="leg"):
        show(m, shapes=[Shape(frame="leg", kind="sphere", size=[1.0])])
    with pytest.raises(ArgumentError, match=r"q: got shape \(2,\)|q"):
        show(m, q=[0.0, 1.0])
    run = simulate(m, [0.0], [1.0], np.linspace(0.0, 1.0, 5))
    with pytest.raises(ArgumentError, match="q: only a mechanism"):
        show(run, q=[0.0])
    with pytest.raises(ArgumentError, match="reference"):
        show(run, reference=np.zeros((3, 1)))
    with pytest.raises(ArgumentError, match=r"which is not there.*packages="):
        show(m, shapes=[Shape(frame="arm", kind="mesh", size=np.ones(3), file=Path("absent.stl"))]).page()


def test_shapes_that_are_wholly_transparent_are_not_drawn() -> None:
    """They would hide what is behind them; where all are, bodies are drawn as without shapes."""
    m = Mechanism([rz("angle", name="arm", mass=1.0, inertia=(0.1, 0.1, 0.1))])
    seen = Shape(frame="arm", kind="sphere", size=[0.1])
    touched = Shape(frame="arm", kind="sphere", size=[0.3], color=(0.0, 0.0, 1.0, 0.0))
    assert only(show(m, shapes=[seen, touched])).shapes == (seen,)
    assert touched not in only(show(m, shapes=[touched])).shapes


def test_scenery_that_is_far_off_does_not_make_the_rest_small() -> None:
    m = Mechanism([rz("angle", name="arm", mass=1.0, inertia=(0.1, 0.1, 0.1))])
    arm = Shape(frame="arm", kind="box", size=[0.5, 0.1, 0.1])
    table = Shape(frame="world", kind="box", size=[0.4, 0.4, 0.1])
    away = np.eye(4)
    away[1, 3] = 20.0
    stairs = Shape(frame="world", kind="box", size=[1.0, 1.0, 1.0], pose=away)

    def size(*shapes: Shape) -> float:
        (stage,) = staged([only(show(m, shapes=shapes))])
        return stage.size

    assert size(arm, table, stairs) == size(arm, table) > size(arm)
    assert size(stairs) > 1.0  # alone it is what there is to see


def test_a_rod_goes_from_here_to_there() -> None:
    for a, b in (((0.1, 0.2, 0.3), (0.1, 0.2, -0.5)), ((1.0, 0.0, 0.0), (-0.2, 0.4, 0.1)), ((0, 0, 0), (0, 0.3, 0))):
        rod = Shape.rod("bob", a, b, 0.05)
        assert rod.kind == "capsule"
        radius, length = rod.size
        ends = rod.pose @ np.array([[0.0, 0.0, -0.5 * length, 1.0], [0.0, 0.0, 0.5 * length, 1.0]]).T
        np.testing.assert_allclose(ends[:3].T, [a, b], atol=1e-15)
        np.testing.assert_allclose(rod.pose[:3, :3].T @ rod.pose[:3, :3], np.eye(3), atol=1e-15)
        assert np.linalg.det(rod.pose) == pytest.approx(1.0)
        assert radius == 0.05
    with pytest.raises(DescriptionError, match="to itself"):
        Shape.rod("bob", (1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.05)
