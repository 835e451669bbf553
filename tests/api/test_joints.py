"""General joints, couplings and compositions come out as what they say, and broken ones are refused."""

from __future__ import annotations

import pickle
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from api.recorder import Recorder, twist_matrix
from leastaction.errors import DescriptionError
from leastaction.mechanics import (
    Affine,
    Body,
    Distance,
    Mechanism,
    ball,
    free,
    pose,
    prismatic,
    revolute,
    rx,
    ry,
    rz,
    screw,
    twist,
    tx,
    ty,
    tz,
    universal,
    var,
    world,
)
from leastaction.mechanics.description.flattening import flatten
from leastaction.mechanics.mechanism.compilation import plan
from leastaction.mechanics.mechanism.view import tree_view
from leastaction.mechanics.mechanism.view_html import html_view

NAN = float("nan")
AXIS, POINT = np.array([0.3, -1.2, 0.7]), np.array([0.2, 0.5, -0.4])
UNIT = AXIS / np.linalg.norm(AXIS)


# Angles of many turns are asked for on purpose here.
pytestmark = pytest.mark.filterwarnings("ignore::leastaction.errors.UnitWarning")


def described(description, elements=(), **orders):
    return plan(flatten(description), elements, **orders)


def recorded(description, elements=(), **orders):
    recorder = Recorder()
    described(description, elements, **orders).emit(recorder)
    return recorder


def placed(description, values):
    """World pose of every frame, by name, from the recorded joints alone."""
    settled = described(description)
    recorder = Recorder()
    settled.emit(recorder)
    q = [values[name] for name in (*settled.dynamic, *settled.kinematic)]
    joints = recorder.joint_poses(q)
    return {
        frame.name: (np.eye(4) if frame.joint < 0 else joints[frame.joint]) @ frame.pose
        for frame in settled.tree.frames
    }


# Joints about and along any axis

JOINTS = {
    "twist": (
        lambda s, **o: twist(s, linear=(0.1, 0.2, -0.3), angular=(0.4, -0.5, 0.6), **o),
        np.array([0.1, 0.2, -0.3, 0.4, -0.5, 0.6]),
    ),
    "twist without rotation": (
        lambda s, **o: twist(s, linear=(0.1, 0.2, -0.3), **o),
        np.array([0.1, 0.2, -0.3, 0.0, 0.0, 0.0]),
    ),
    "screw": (
        lambda s, **o: screw(s, axis=AXIS, point=POINT, pitch=0.05, **o),
        np.concatenate([np.cross(POINT, UNIT) + 0.05 * UNIT, UNIT]),
    ),
    "revolute": (
        lambda s, **o: revolute(s, axis=AXIS, point=POINT, **o),
        np.concatenate([np.cross(POINT, UNIT), UNIT]),
    ),
    "prismatic": (
        lambda s, **o: prismatic(s, axis=AXIS, **o),
        np.concatenate([UNIT, np.zeros(3)]),
    ),
}


@pytest.mark.parametrize("kind", JOINTS)
def test_a_joint_moves_along_its_twist(kind):
    make, expected = JOINTS[kind]
    calls = recorded([pose(translation=(1, 2, 3)), [make("s", mass=1.0, inertia=(1, 1, 1))]])
    np.testing.assert_allclose(calls.joints[0][2], expected, atol=1e-15)
    np.testing.assert_array_equal(calls.joints[0][1][:3, 3], [1, 2, 3])


@pytest.mark.parametrize("amount", [-2.4, 1e-9, 0.0, 0.7, 40.0])
@pytest.mark.parametrize("kind", JOINTS)
def test_a_constant_amount_is_the_constant_motion(kind, amount):
    make, expected = JOINTS[kind]
    poses = placed([make(amount, name="f")], {})
    scale = max(1.0, abs(amount))
    np.testing.assert_allclose(poses["f"], expm(twist_matrix(expected) * amount), atol=2e-14 * scale)


def test_a_point_of_the_axis_stays_and_a_screw_advances_by_its_pitch_a_turn():
    description = [
        revolute("a", axis=AXIS, point=POINT, name="hinge", mass=1.0),
        screw("b", axis="-z", point=POINT, pitch=0.01 / (2 * np.pi), name="nut", mass=1.0),
    ]
    poses = placed(description, {"a": 1.1, "b": 2 * np.pi})
    np.testing.assert_allclose(poses["hinge"] @ [*POINT, 1.0], [*POINT, 1.0], atol=1e-15)
    np.testing.assert_allclose(poses["hinge"][:3, :3], Rotation.from_rotvec(1.1 * UNIT).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(poses["nut"][:3, 3], [0, 0, -0.01], atol=1e-15)


def test_the_primitives_are_special_cases():
    for letter in "xyz":
        for sign in ("", "-"):
            slide = prismatic("s", axis=sign + letter)
            turn = revolute("s", axis=sign + letter)
            factor = -1.0 if sign else 1.0
            primitives = {"x": (tx, rx), "y": (ty, ry), "z": (tz, rz)}[letter]
            np.testing.assert_array_equal(slide.twist, factor * primitives[0]("s").twist)
            np.testing.assert_array_equal(turn.twist, factor * primitives[1]("s").twist)


def test_the_length_of_an_axis_does_not_matter():
    for scale in (1e-200, 1.0, 1e200):
        np.testing.assert_allclose(revolute("s", axis=scale * AXIS).twist, revolute("s", axis=AXIS).twist, rtol=1e-15)


def test_chained_and_nested_descriptions_are_the_same():
    tree = world()
    tree.screw("a", axis="z", pitch=0.1, mass=1.0).revolute("b", axis=AXIS, mass=1.0, com=(1, 0, 0)).prismatic(
        "c", axis="x", mass=1.0
    ).twist("d", linear=(1, 0, 0), angular=(0, 0, 1), mass=1.0)
    tree.universal("u").ball("b1", axes="xyz", mass=1.0, inertia=(1, 1, 1)).free(
        "f", axes="xyz", mass=1.0, inertia=(1, 1, 1)
    )
    nested = [
        screw("a", axis="z", pitch=0.1, mass=1.0), [
            revolute("b", axis=AXIS, mass=1.0, com=(1, 0, 0)), [
                prismatic("c", axis="x", mass=1.0), [
                    twist("d", linear=(1, 0, 0), angular=(0, 0, 1), mass=1.0)]]],
        universal("u"), [
            ball("b1", axes="xyz", mass=1.0, inertia=(1, 1, 1)), [free("f", axes="xyz", mass=1.0, inertia=(1, 1, 1))]],
    ]  # fmt: skip
    assert tree_view(described(tree)) == tree_view(described(nested))
    one, other = recorded(tree), recorded(nested)
    assert one.coordinates == other.coordinates
    for first, second in zip(one.joints, other.joints, strict=True):
        np.testing.assert_array_equal(first[2], second[2])


# Couplings

numbers = st.floats(-1e3, 1e3).map(lambda x: round(x, 3))


@given(numbers, numbers, numbers, numbers.filter(lambda x: abs(x) > 0.01))
def test_arithmetic_on_variables_is_arithmetic_on_their_values(a, b, c, d):
    values = {"x": a, "y": b}
    x, y = var("x"), var("y")
    for made, expected in (
        (x + y, a + b),
        (x - y, a - b),
        (c * x + d, c * a + d),
        (d - x * c, d - a * c),
        (np.float64(c) * x, c * a),
        (x + np.float64(c), a + c),
        (np.float64(c) - x, c - a),
        (-(x / d) + (+y), -(a / d) + b),
        ((x + y) * c - (x - y) / d + c, (a + b) * c - (a - b) / d + c),
        (x - x + c, c),
    ):
        assert made.value(values) == pytest.approx(expected, rel=1e-12, abs=1e-6)


def test_expressions_read_as_formulas_and_drop_what_cancels():
    x, y = var("x"), var("y")
    assert str(2 * x - y + 0.3) == "2 x - y + 0.3"
    assert str(-x + 0.5 * y - 1) == "-x + 0.5 y - 1"
    assert str(x - x + 0.25) == "0.25"
    assert (x + y - x).names == ("y",)
    assert 2 * x == Affine((("x", 2.0),)) == x + x
    assert var("x").plain
    assert not (2 * x).plain


def test_couplings_three_ways_are_the_same_calls():
    for amount, offset in (
        ({"theta": 2.0, "phi": -1.0}, 0.3),
        (2.0 * var("theta") - var("phi") + 0.3, 0.0),
        (2.0 * var("theta") - var("phi"), 0.3),
    ):
        calls = recorded(
            [rz("theta", mass=1.0, com=(1, 0, 0)), [rz("phi", mass=1.0, com=(1, 0, 0)), [
                rz(amount, offset=offset, name="driven", mass=1.0, com=(1, 0, 0))]]]
        )  # fmt: skip
        assert calls.coordinates == [({0: 1.0}, 0.0), ({1: 1.0}, 0.0), ({0: 2.0, 1: -1.0}, 0.3)]


def test_an_offset_turns_the_frame_at_zero():
    poses = placed([rz("a", offset=0.4, name="f", mass=1.0, com=(1, 0, 0))], {"a": 0.3})
    np.testing.assert_allclose(poses["f"][:3, :3], Rotation.from_euler("z", 0.7).as_matrix(), atol=1e-15)
    constant = placed([tx(0.5, offset=0.25, name="g")], {})
    assert constant["g"][0, 3] == 0.75


def test_one_variable_moves_many_frames():
    parallel = [
        rz("a", name="arm"), [ty(1.0), [rz(-var("a"), name="plate", mass=1.0)]],
        rz(0.5 * var("a"), name="half", mass=1.0, com=(1, 0, 0)),
    ]  # fmt: skip
    settled = described(parallel)
    assert settled.dynamic == ("a",)
    poses = placed(parallel, {"a": 0.8})
    # The plate is carried around but does not turn.
    np.testing.assert_allclose(poses["plate"][:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(poses["plate"][:3, 3], [-np.sin(0.8), np.cos(0.8), 0], atol=1e-15)
    np.testing.assert_allclose(poses["half"][:3, :3], Rotation.from_euler("z", 0.4).as_matrix(), atol=1e-15)


def test_variables_of_both_kinds_in_one_joint():
    description = [
        tx("x", mass=1.0),
        rz({"k": 1.0, "a": 2.0}, kinematic=["k"], name="mixed", mass=1.0, com=(1, 0, 0)),
        tx(3.0 * var("k") - var("m"), kinematic=True),
    ]
    settled = described(description)
    assert (settled.dynamic, settled.kinematic) == (("x", "a"), ("k", "m"))
    assert [joint.kinematic for joint in settled.tree.joints] == [False, False, True]
    assert recorded(description).coordinates == [
        ({0: 1.0}, 0.0),
        ({2: 1.0, 1: 2.0}, 0.0),
        ({2: 3.0, 3: -1.0}, 0.0),
    ]


def test_variables_that_cancel_leave_a_constant_frame():
    settled = described([tx(var("a") - var("a") + 0.5, name="f", mass=1.0)])
    assert settled.tree.joints == ()
    assert settled.tree.frames[1].pose[0, 3] == 0.5


def test_names_of_coupled_frames_are_readable():
    frames = described([rz("a", mass=1, com=(1, 0, 0)), [rz(2 * var("a")), screw("b", axis="z", pitch=1.0, mass=1)],
                        rz("a")]).tree.frames  # fmt: skip
    assert [frame.name for frame in frames] == [
        "world", "rz(a)", "rz(2 a)", "screw(b)", "rz(a)#2",
    ]  # fmt: skip


# Compositions


@pytest.mark.parametrize("axes", ["xyz", "zyx", "zxz", "yxy"])
def test_a_free_joint_is_three_translations_and_euler_angles(axes):
    description = [free("body", axes=axes, mass=1.0, inertia=(1, 1, 1))]
    settled = described(description)
    turns = [f"body.r{a}{'2' if a in axes[:i] else ''}" for i, a in enumerate(axes)]
    assert settled.dynamic == ("body.x", "body.y", "body.z", *turns)
    numbers = np.random.default_rng(0).uniform(-1, 1, 6)
    poses = placed(description, dict(zip(settled.dynamic, numbers, strict=True)))
    expected = np.eye(4)
    expected[:3, 3] = numbers[:3]
    expected[:3, :3] = Rotation.from_euler(axes.upper(), numbers[3:]).as_matrix()
    np.testing.assert_allclose(poses["body"], expected, atol=1e-15)


def test_bodies_and_children_belong_to_the_last_frame():
    settled = described([ball("hip", axes="xyz", mass=2.0, inertia=(1, 1, 1)), [tz(-0.4, name="knee", mass=1.0)]])
    names = [frame.name for frame in settled.tree.frames]
    assert names == ["world", "rx(hip.rx)", "ry(hip.ry)", "hip", "knee"]
    frames = {frame.name: frame for frame in settled.tree.frames}
    assert names[frames["knee"].parent] == "hip"
    assert [joint for joint, *_ in settled.tree.bodies()] == [2, 2]


def test_a_composition_takes_amounts_a_name_and_kinds():
    joint = universal(["a", -0.5 * var("a") + 0.1], axes="zx", name="wrist", kinematic=["a"])
    settled = described([joint, [tx(1.0, name="tip")]])
    assert settled.kinematic == ("a",)
    assert settled.tree.frames[2].name == "wrist"
    part = ball("b", axes="xyz", kinematic=["b.rz"], mass=1.0, inertia=(1, 1, 1), name="head")
    assert part.variables == ("b.rx", "b.ry", "b.rz")
    assert repr(part) == "ball(b.rx, b.ry, b.rz) 'b'"
    settled = described([part])
    assert (settled.dynamic, settled.kinematic) == (("b.rx", "b.ry"), ("b.rz",))
    assert settled.tree.frames[-1].name == "head"
    whole = described([free("hand", axes="xyz", kinematic=True), [tx(0.1)]])
    assert whole.dynamic == ()
    assert len(whole.kinematic) == 6


def test_the_mechanism_knows_its_ball_joints():
    settled = described([
        universal("u"), [ball("hip", axes="xyz", mass=1.0, inertia=(1, 1, 1))],
        free("torso", axes="zxz", mass=1.0, inertia=(1, 1, 1)),
        ball("held", axes="xyz", kinematic=True),
        ball("led", axes="xyz", kinematic=["led.rx"], mass=1.0, inertia=(1, 1, 1)),
    ])  # fmt: skip
    balls = settled.tree.balls
    assert [b.name for b in balls] == ["hip", "torso", "held", "led"]
    assert balls[0].variables == ("hip.rx", "hip.ry", "hip.rz")
    assert balls[1].variables == ("torso.rz", "torso.rx", "torso.rz2")
    assert [b.singular for b in balls] == [np.pi / 2, 0.0, np.pi / 2, np.pi / 2]
    # With the outer or inner angle prescribed, the others are determined everywhere.
    assert [b.watched for b in balls] == [True, True, False, False]


def test_a_composition_stands_in_one_place_only():
    joint = ball("b", axes="xyz", mass=1.0, inertia=(1, 1, 1))
    with pytest.raises(DescriptionError, match="two places"):
        described([joint, [joint]])


# Massless variables


def test_a_variable_is_massless_only_if_none_of_its_joints_moves_a_mass():
    slack = [rz("a"), rz(2 * var("a"), name="gear")]
    assert Mechanism([*slack, rz(-var("a"), mass=1.0, com=(1, 0, 0))]).dynamic == ("a",)
    with pytest.raises(DescriptionError, match=r"massless dynamic variable 'a'.*frames 'rz\(a\)', 'gear'"):
        Mechanism(slack)


def test_variables_that_move_masses_only_together_are_refused():
    with pytest.raises(DescriptionError, match=r"'a', 'b' move masses only in combination.*'gear'"):
        Mechanism([rz({"a": 1.0, "b": -2.0}, name="gear", mass=1.0, com=(1, 0, 0))])
    # With a joint of its own for one, a prescribed one, or as many combinations as variables: determined.
    for extra, kinematic in ((rz("a", mass=1.0, com=(1, 0, 0)), False), (tx("c", mass=1.0), ["a"])):
        driven = rz({"a": 1.0, "b": -2.0}, kinematic=kinematic, mass=1.0, com=(1, 0, 0))
        Mechanism([extra, driven])
    Mechanism([
        rz(var("a") + var("b"), mass=1.0, com=(1, 0, 0)),
        rz(var("a") - var("b"), mass=1.0, com=(1, 0, 0)),
    ])  # fmt: skip
    with pytest.raises(DescriptionError, match="'a', 'b', 'c' move masses only in combination"):
        Mechanism([
            tx(var("a") + var("b"), mass=1.0), tx(var("b") + var("c"), mass=1.0),
            tx(var("a") - var("c"), mass=1.0),
        ])  # fmt: skip


def test_inertia_counts_at_any_scale_of_a_twist():
    for scale in (1e-7, 1.0, 1e7):
        Mechanism([tx(100.0), [twist("s", angular=(0, 0, scale), mass=1.0, com=(0.01, 0, 0))]])
        with pytest.raises(DescriptionError, match=r"massless dynamic variable 's'.*axis"):
            Mechanism([ry(0.3), [tx(100.0), [twist("s", angular=(0, 0, scale)), [tz(0.7, mass=1.0)]]]])


# Views


def shown():
    return described(
        [
            free("torso", axes="xyz", mass=5.0, inertia=(1, 1, 1)), [
                universal(["s", -0.5 * var("s") + 0.1], name="head", mass=1.0, com=(0, 0, 0.1)),
                tz(-0.2), [screw("s", axis="z", point=(0.1, 0, 0), pitch=0.02, mass=0.5)],
            ],
            rz(2 * var("s") + 0.3, name="gear", bodies=[Body(1.0, com=(1, 0, 0)), Body(0.5)]),
            tx({"k": 1.0, "s": 0.5}, kinematic=["k"], name="both <&>", mass=1.0),
            ty("k", kinematic=True),
        ],
        [Distance("head", "gear", "rope", name="string")],
    )  # fmt: skip


def test_the_printed_view_shows_couplings_and_compositions():
    assert tree_view(shown()).splitlines() == [
        "world",
        "├── torso  free(torso: x y z rx ry rz)  [5 kg, inertia 1 1 1]",
        "│   ├── head  universal(s, -0.5 s + 0.1)  axes xy  [1 kg, com 0 0 0.1]",
        "│   └── torso/tz(-0.2)",
        "│       └── screw(s)  about (0, 0, 1) through (0.1, 0, 0), 0.02 m/rad  [0.5 kg]",
        "├── gear  rz(2 s + 0.3)  [1 kg, com 1 0 0]  [0.5 kg]",
        "├── both <&>  tx(k + 0.5 s)  kinematic: k  [1 kg]",
        "└── ty(k)  kinematic",
        "Distance 'string': head to gear, rope",
        "s moves 5 frames: rx(s), head, screw(s), gear, both <&>",
        "k moves 2 frames: both <&>, ty(k)",
        "dynamic (7): torso.x, torso.y, torso.z, torso.rx, torso.ry, torso.rz, s",
        "kinematic (2): k, rope",
        "inputs (0)",
        "constraints (1): string",
    ]


class Balanced(HTMLParser):
    """Check that every tag is closed in order; collect the text and the attributes."""

    def __init__(self):
        super().__init__(convert_charrefs=True)
        self.open, self.text, self.attributes, self.tags = [], "", [], set()

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.tags.add(tag)
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.text += data


def test_the_notebook_view_is_sound_and_self_contained():
    text = html_view(shown())
    page = Balanced()
    page.feed(text)
    page.close()
    assert page.open == []
    assert not {"script", "link", "img", "iframe"} & page.tags
    assert "http" not in text
    assert "@import" not in text
    assert {name for name, _ in page.attributes} <= {"class", "style", "open"}
    for expected in (
        "Mechanism14 frames, 7 dynamic, 2 kinematic, 1 constraint", "└─",
        "both <&>", "rz(2 s + 0.3)", "kinematic: k", "5 kg, inertia 1 1 1", "Distance string",
        "head to gear, rope", "variables that move several frames", "universal(s, -0.5 s + 0.1)",
        "about (0, 0, 1) through (0.1, 0, 0), 0.02 m/rad", "torso.rz", "rope",
    ):  # fmt: skip
        assert expected in page.text
    mechanism = Mechanism([tx("x", name="<b>cart</b>", mass=1.0)])
    assert "&lt;b&gt;cart" in mechanism._repr_html_()
    assert "<b>cart" not in mechanism._repr_html_()


def test_the_notebook_view_of_a_long_chain_stays_short():
    description = [tx(0.1, mass=1.0)]
    for k in range(1000):
        description = [rz(f"q{k}"), [tx(1.0, mass=1.0), description]]
    settled = described(description)
    text = html_view(settled)
    page = Balanced()
    page.feed(text)
    assert "… and 1701 more" in page.text  # of 2001 frames behind the world
    assert len(text) < 250_000
    printed = tree_view(settled)
    assert "… and 1701 more" in printed.splitlines()
    assert "dynamic (1000): q999, q998," in printed
    assert printed.splitlines()[-4].endswith("and 800 more")
    assert len(printed) < 250_000


def test_a_pickled_mechanism_keeps_its_compositions():
    mechanism = Mechanism([ball("b", axes="xyz", mass=1.0, inertia=(1, 1, 1)), [tx(1.0, mass=1.0)]])
    again = pickle.loads(pickle.dumps(mechanism))
    assert str(again) == str(mechanism)
    assert again.balls[0].variables == mechanism.balls[0].variables


# Errors

BROKEN = {
    "axis of nothing": (lambda: revolute("a", axis=(0, 0, 0)), "revolute: the axis is zero"),
    "axis by an unknown letter": (lambda: prismatic("a", axis="w"), "prismatic.*'w'.*'x'"),
    "axis of two numbers": (lambda: screw("a", axis=(0, 1), pitch=1), r"screw: axis.*\(3,\)"),
    "axis with NaN": (lambda: screw("a", axis=(0, NAN, 1), pitch=1), "screw: axis.*nan"),
    "point with NaN": (lambda: revolute("a", axis="z", point=(NAN, 0, 0)), "revolute: point.*nan"),
    "point out of sight": (
        lambda: revolute("a", axis=(1, 1, 1), point=(1.7e308, -1.7e308, 0)),
        "revolute.*too far",
    ),
    "pitch as text": (lambda: screw("a", axis="z", pitch="1"), "pitch.*'1'"),
    "pitch that is infinite": (lambda: screw("a", axis="z", pitch=float("inf")), "pitch.*inf"),
    "twist of nothing": (lambda: twist("a"), "both zero.*pose"),
    "twist with NaN": (lambda: twist("a", linear=(NAN, 0, 0)), "twist: linear.*nan"),
    "empty mapping": (lambda: rz({}), "rz.*empty mapping"),
    "factor of zero": (lambda: rz({"a": 1.0, "b": 0.0}), "rz: the factor of 'b' is 0"),
    "factor of NaN": (lambda: rz({"a": NAN}), "rz: the factor of 'a'.*nan"),
    "factor as text": (lambda: rz({"a": "2"}), "rz: the factor of 'a'.*'2'"),
    "variable that is a number": (lambda: rz({3: 1.0}), "a variable of rz.*3"),
    "variable without a name": (lambda: var(""), "var.*not empty"),
    "product of variables": (lambda: var("a") * var("b"), r"\(a\) \* \(b\).*not linear"),
    "division by zero": (lambda: var("a") / 0, r"\(a\) / 0"),
    "variable times NaN": (lambda: NAN * var("a"), "nan"),
    "overflow": (lambda: 1e300 * (1e300 * var("a")), "the factor of 'a'.*inf"),
    "offset as text": (lambda: rz("a", offset="1"), "rz: offset.*'1'"),
    "kinematic as text": (lambda: rz("a", kinematic="a"), r"rz\(a\): kinematic must be.*'a'"),
    "kinematic of another variable": (
        lambda: rz({"alpha": 1.0, "beta": 2.0}, kinematic=["alhpa"]),
        "'alhpa'.*mean 'alpha'",
    ),
    "kinematic constant expression": (
        lambda: rz(var("a") - var("a"), kinematic=True),
        r"rz\(0\).*constant",
    ),
    "universal about one axis": (lambda: universal("u", axes="xx"), "universal.*'xx'.*2 letters"),
    "ball about two axes": (lambda: ball("b", axes="xy"), "ball.*'xy'.*3 letters"),
    "axes that are no text": (lambda: ball("b", axes=3), "ball.*axes 3"),
    "ball with neighbours alike": (lambda: ball("b", axes="xxy"), "neighbours"),
    "ball of two amounts": (lambda: ball(["a", "b"]), r"3 coordinates \(rx, ry, rz\)"),
    "ball without a name": (lambda: ball(" "), "name of a ball"),
    "ball of a number": (lambda: free(3.0), "free.*6 coordinates.*3.0"),
    "ball that is kinematic elsewhere": (
        lambda: ball("b", axes="xyz", kinematic=["c.rx"]),
        r"ball\(b.rx, b.ry, b.rz\).*'c.rx'",
    ),
    "ball with a bad mass": (lambda: ball("b", mass=-1.0), "'b'.*-1.*positive"),
}

BROKEN_TREES = {
    "ball twice": (
        lambda: [ball("b", mass=1, inertia=(1, 1, 1)), ball("b", mass=1, inertia=(1, 1, 1))],
        "duplicate frame name 'b'",
    ),
    "kinds that differ within a coupling": (
        lambda: [rz("a", name="one", mass=1), rz({"a": 1.0, "b": 1.0}, kinematic=True, name="two")],
        "'a' is dynamic in the frame 'one' and kinematic in 'two'.*mark it",
    ),
    "constants that overflow": (
        lambda: [tx(1.7e308), [tx(1.7e308, name="far")]],
        "'far'.*too far from 'world/tx",
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_joint_is_refused(case):
    make, message = BROKEN[case]
    with pytest.raises(DescriptionError, match=message):
        make()


@pytest.mark.parametrize("case", BROKEN_TREES)
def test_a_broken_tree_of_joints_is_refused(case):
    make, message = BROKEN_TREES[case]
    with pytest.raises(DescriptionError, match=message):
        described(make())


def test_what_is_no_number_is_left_to_python():
    for wrong in (
        lambda: var("a") + "b",
        lambda: "b" - var("a"),
        lambda: var("a") * None,
        lambda: var("a") / var("b"),
        lambda: True * var("a"),
    ):
        with pytest.raises(TypeError):
            wrong()


# Random descriptions, valid and broken: each either compiles to finite numbers or is a typed error.


def mostly(sound, broken):
    return st.integers(0, 19).flatmap(lambda n: broken if n == 13 else sound)


variables = st.sampled_from(["a", "b", "c", "d", "e"])
good = st.floats(0.5, 2.0)
factors = mostly(st.floats(-2.0, 2.0), st.sampled_from([NAN, 0.0, 1e300, "1"]))
amounts = mostly(
    st.one_of(
        variables,
        st.floats(-2.0, 2.0),
        st.dictionaries(variables, good, min_size=1, max_size=3),
        st.builds(lambda a, f, b, c: f * var(a) - var(b) / f + c, variables, good, variables, good),
    ),
    st.one_of(st.dictionaries(variables, factors, max_size=3), st.sampled_from([1e300, NAN, {}, None])),
)
vectors = mostly(
    st.one_of(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.sampled_from(["x", "y", "-z"])),
    st.sampled_from(["w", (0, 0, 0), (1e300, 0, 0), (1, NAN, 0), (0, 1)]),
)
numbers3 = vectors.filter(lambda v: not isinstance(v, str))
masses = st.fixed_dictionaries(
    {
        "mass": mostly(st.sampled_from([0.0, 0.5, 2.0, 2.0]), st.sampled_from([1e300, -1.0])),
        "inertia": st.just((0.2, 0.3, 0.4)),
        "com": st.just((0.1, 0.2, 0.3)),
        "kinematic": mostly(st.just(False), st.one_of(st.just(True), st.lists(variables, max_size=2), st.just("a"))),
    },
)
kinds = st.one_of(
    st.tuples(
        st.just(twist),
        amounts,
        st.fixed_dictionaries({}, optional={"linear": numbers3, "angular": numbers3}),
    ),
    st.tuples(
        st.just(revolute),
        amounts,
        st.fixed_dictionaries({"axis": vectors}, optional={"point": numbers3}),
    ),
    st.tuples(st.just(prismatic), amounts, st.fixed_dictionaries({"axis": vectors})),
    st.tuples(st.just(screw), amounts, st.fixed_dictionaries({"axis": vectors, "pitch": factors})),
    st.tuples(
        st.sampled_from([tx, ry, rz]),
        amounts,
        st.fixed_dictionaries({}, optional={"offset": factors}),
    ),
    st.tuples(
        st.sampled_from([ball, free]),
        st.one_of(variables, st.lists(amounts, min_size=3, max_size=3)),
        st.fixed_dictionaries(
            {}, optional={"axes": mostly(st.sampled_from(["xyz", "zxz", "quaternion"]), st.just("xxy"))}
        ),
    ),
    st.tuples(st.just(universal), st.one_of(variables, st.tuples(amounts, amounts)), st.just({})),
)
members = st.tuples(kinds, masses)
trees = st.recursive(
    st.lists(members, max_size=2),
    lambda lower: st.lists(st.one_of(members, lower), max_size=4),
    max_leaves=8,
)  # fmt: skip


def build(tree):
    if isinstance(tree, tuple):
        (make, amount, own), options = tree
        return make(amount, **own, **options)
    return [build(item) for item in tree]


@settings(max_examples=300, suppress_health_check=list(HealthCheck))
@given(tree=trees)
def test_random_joints_compile_or_are_refused(tree):
    try:
        mechanism = Mechanism(build(tree))
    except DescriptionError:
        return
    q, v = np.linspace(-1.0, 1.0, mechanism.nq), np.linspace(1.0, 0.5, mechanism.nv)
    for rotation in mechanism.tree.rotations:
        place = mechanism.coordinates.index(rotation.quaternion[0])
        q[place : place + 4] = 0.5, -0.5, 0.5, 0.5
    inertia = mechanism.mass_matrix(q)
    assert np.isfinite(mechanism.positions(q)).all()
    assert np.isfinite(inertia).all()
    assert (np.diag(inertia)[: mechanism.nd] >= 0.0).all()
    assert mechanism.energy(q, v).kinetic == pytest.approx(0.5 * v @ inertia @ v, rel=1e-9, abs=1e-12)
    for name in mechanism.frames:
        J = mechanism.frame_jacobian(q, name)
        np.testing.assert_allclose(mechanism.frame_velocity(q, v, name), J @ v, rtol=1e-9, atol=1e-9)
    assert str(mechanism).startswith("world")
    assert mechanism._repr_html_().endswith("</div>")


def test_an_inertia_that_is_lost_far_from_the_origin_is_told() -> None:
    arm = [rz("a", mass=1.0, com=(0.5, 0.0, 0.0), inertia=(0.01, 0.08, 0.08))]
    assert Mechanism([tx(1e6), arm]).variables == ("a",)
    with pytest.raises(DescriptionError, match=r"'a' moves is lost to rounding: .* 1e\+08 m from the world's origin"):
        Mechanism([tx(1e8), arm])
