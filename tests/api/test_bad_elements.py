"""Every element refuses what it cannot be: the error names it, what was given, what was expected, what to do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from leastaction import mechanics as la
from leastaction.errors import DescriptionError
from leastaction.mechanics import Curve, Mechanism, rx, ry, rz, tx, ty, tz

NAN, INF = float("nan"), float("inf")
CURVE = Curve([0.0, 1.0, 2.0], [0.0, 1.0, 3.0])


def tree():
    """A cart with a pendulum, a trolley on a prescribed rail with a wheel, a mast that only turns, and a post."""
    return [
        tx("x", name="cart", mass=2.0),
        [rz("theta", name="arm"), [ty(-1.0, name="bob", mass=1.0)]],
        tx("rail", name="trolley", kinematic=True),
        [tz(0.5, name="hook"), rx("spin", name="wheel", mass=1.0, inertia=(1, 1, 1))],
        ry("yaw", name="mast", mass=1.0, inertia=(1, 1, 1)),
        tz(3.0, name="post"),
    ]


# By type: what is wrong with the fields alone, and what the mechanism does not fit.
FIELDS = {
    "Gravity": {
        "two numbers": (lambda: la.Gravity((0, 1)), r"Gravity: vector.*\(3,\)"),
        "one name": (lambda: la.Gravity(frames="bob"), "frames.*list.*'bob'"),
        "no frames": (lambda: la.Gravity(frames=[]), r"frames.*list.*\[\].*leave it out"),
        "twice": (lambda: la.Gravity(frames=["bob", "bob"], name="g"), "'g'.*twice"),
        "number": (lambda: la.Gravity(frames=[3]), "frames.*3"),
    },
    "InverseSquareGravity": {
        "zero": (lambda: la.InverseSquareGravity("cart", "bob", 0.0), "strength.*zero"),
        "nan": (lambda: la.InverseSquareGravity("cart", "bob", NAN), "strength.*nan"),
        "itself": (lambda: la.InverseSquareGravity("bob", "bob", 1.0, name="pull"), "'pull'.*both"),
    },
    "LinearSpring": {
        "negative": (lambda: la.LinearSpring("cart", "bob", -1.0), "stiffness.*-1.*positive"),
        "zero": (lambda: la.LinearSpring("cart", "bob", 0), "stiffness.*0.*positive"),
        "text": (lambda: la.LinearSpring("cart", "bob", "k", name="s"), "'s': stiffness.*'k'"),
        "length": (lambda: la.LinearSpring("cart", "bob", 1, length=-1), "length.*-1.*zero or more"),
        "frame": (lambda: la.LinearSpring("cart", 3, 1.0), "a frame.*3"),
    },
    "JointSpring": {
        "stiffness": (lambda: la.JointSpring("theta", -2.0), "stiffness.*-2.*positive"),
        "rest": (lambda: la.JointSpring("theta", 1.0, rest=INF), "rest.*inf"),
        "no variable": (lambda: la.JointSpring("", 1.0), "not empty"),
        "empty": (lambda: la.JointSpring({}, 1.0), "mapping is empty"),
        "zero factor": (lambda: la.JointSpring({"x": 0.0}, 1.0), "'x' is zero.*leave"),
        "list": (lambda: la.JointSpring(["x"], 1.0), r"mapping.*\['x'\]"),
        "factor": (lambda: la.JointSpring({"x": "1"}, 1.0), "'x'.*'1'.*number"),
    },
    "TorsionalSpring": {
        "axis": (lambda: la.TorsionalSpring("cart", "arm", 1.0, axis="w"), "axis.*'w'.*'x', 'y'"),
        "no axis": (lambda: la.TorsionalSpring("cart", "arm", 1.0, axis=(0, 0, 0)), "axis.*zero"),
        "rest": (lambda: la.TorsionalSpring("cart", "arm", 1.0, rest=4), "4 rad.*JointSpring"),
        "stiffness": (lambda: la.TorsionalSpring("cart", "arm", -1), "stiffness.*-1"),
    },
    "NonlinearSpring": {
        "no curve": (lambda: la.NonlinearSpring("x", 3.0), "force.*Curve.*3.0"),
        "function": (lambda: la.NonlinearSpring("x", np.sin), "Curve.from_function"),
        "one frame": (lambda: la.NonlinearSpring(["bob"], CURVE), "1 frame,.*two or more"),
        "number": (lambda: la.NonlinearSpring(3, CURVE), "on.*list of frames.*3"),
    },
    "ElasticString": {
        "one frame": (lambda: la.ElasticString("bob", 1, 1), "frames.*list.*'bob'"),
        "stands still": (lambda: la.ElasticString(["x", "x"], 1, 1), "'x' follows itself"),
        "length": (lambda: la.ElasticString(["a", "b"], 1, 0), "length.*0.*positive"),
        "stiffness": (lambda: la.ElasticString(["a", "b"], NAN, 1), "stiffness.*nan"),
        "smoothing": (lambda: la.ElasticString(["a", "b"], 1, 1, smoothing=0), "smoothing.*tension_only"),
        "ways": (lambda: la.ElasticString(["a", "b"], 1, 1, tension_only="no"), "tension_only.*'no'.*True or"),
    },
    "PathLength": {
        "length": (lambda: la.PathLength(["a", "b"], -1.0), "length.*-1.*positive"),
        "no length": (lambda: la.PathLength(["a", "b"], None), "length.*None.*number"),
        "frames": (lambda: la.PathLength([], 1.0), "0 frames.*two or more"),
        "empty name": (lambda: la.PathLength(["a", ""], 1.0), "not empty"),
    },
    "PointOnPlane": {
        "normal": (lambda: la.PointOnPlane("post", "bob", normal="up"), "normal.*'up'"),
        "two numbers": (lambda: la.PointOnPlane("post", "bob", normal=(0, 1)), r"normal.*\(3,\)"),
        "itself": (lambda: la.PointOnPlane("bob", "bob", name="p"), "'p'.*'bob'.*two different"),
    },
    "PointOnLine": {
        "direction": (lambda: la.PointOnLine("post", "bob", direction=(0, NAN, 1)), "direction.*nan"),
        "itself": (lambda: la.PointOnLine("bob", "bob"), "'bob'.*two different"),
    },
    "HingeLoop": {
        "axis": (lambda: la.HingeLoop("bob", "post", axis="xy"), "axis.*'xy'"),
        "itself": (lambda: la.HingeLoop("bob", "bob"), "both ends"),
        "planar": (lambda: la.HingeLoop("bob", "post", planar=np.ones(2)), "planar.*True or False"),
    },
    "FixedOrientation": {
        "shape": (lambda: la.FixedOrientation("bob", "post", rotation=[1, 2]), r"rotation.*\(3, 3\)"),
        "stretch": (
            lambda: la.FixedOrientation("bob", "post", rotation=2 * np.eye(3), name="held"),
            "'held': rotation.*orthonormal",
        ),
    },
    "Coupling": {
        "one name": (lambda: la.Coupling("x"), "factors.*mapping.*'x'"),
        "nothing": (lambda: la.Coupling({}), "empty"),
        "offset": (lambda: la.Coupling({"x": 1}, offset=NAN, name="gear"), "'gear': offset.*nan"),
    },
    "PrescribedPath": {
        "nothing": (lambda: la.PrescribedPath("bob"), "no coordinate.*x=, y=, z="),
        "number": (lambda: la.PrescribedPath("bob", y=1.0), "y, a kinematic variable.*1.0"),
    },
    "JointForce": {
        "list": (lambda: la.JointForce(["x"], "u"), r"variable.*mapping.*\['x'\]"),
        "zero factor": (lambda: la.JointForce({"x": 0.0}, "u"), "'x' is zero.*leave"),
        "input": (lambda: la.JointForce("x", 3), "input.*3"),
    },
    "Motor": {
        "axis": (lambda: la.Motor("cart", "arm", "u", axis="w"), "axis.*'w'.*'x', 'y'"),
        "gain": (lambda: la.Motor("cart", "arm", "u", gain=0), "gain.*zero.*input does nothing"),
        "itself": (lambda: la.Motor("arm", "arm", "u", name="m"), "'m'.*both ends.*'arm'"),
    },
    "LinearMotor": {
        "gain": (lambda: la.LinearMotor("cart", "bob", "u", gain=NAN), "gain.*nan"),
        "input": (lambda: la.LinearMotor("cart", "bob", ""), "input.*not empty"),
    },
    "NonlinearDamping": {
        "a number": (lambda: la.NonlinearDamping("x", 1.0), "list.*1.0"),
        "none": (lambda: la.NonlinearDamping("x", ()), "one to eight"),
        "last": (lambda: la.NonlinearDamping("x", (1, -1)), "c3.*-1.*positive.*fast motion"),
        "text": (lambda: la.NonlinearDamping("x", ("1", 2)), "c1.*'1'.*number"),
        "bytes": (lambda: la.NonlinearDamping("x", b"x"), "list.*b'x'"),
    },
    "LinearDamper": {
        "negative": (lambda: la.LinearDamper("bob", "post", -1), "coefficient.*-1.*positive"),
        "itself": (lambda: la.LinearDamper("bob", "bob", 1), "both ends"),
    },
    "CoulombFriction": {
        "force": (lambda: la.CoulombFriction("x", force=-1, speed=1), "force.*-1.*positive"),
        "speed": (lambda: la.CoulombFriction("x", force=1, speed=0), "speed.*0.*positive"),
    },
    "BodyWrench": {
        "nothing": (lambda: la.BodyWrench("bob"), "neither.*force=.*torque="),
        "two": (lambda: la.BodyWrench("bob", force=(0, 1)), r"force.*three.*\(0, 1\)"),
        "text": (lambda: la.BodyWrench("bob", torque="abc"), "torque.*three.*'abc'"),
        "nan": (lambda: la.BodyWrench("bob", force=(0, NAN, 1), name="w"), "'w': force: y.*nan"),
        "bytes": (lambda: la.BodyWrench("bob", force=b"abc"), "force.*three.*b'abc'"),
        "array of no axis": (lambda: la.BodyWrench("bob", force=np.array(1.0)), "force.*three.*array"),
        "empty input": (lambda: la.BodyWrench("bob", force=("", 0, 0)), "force: x.*not empty"),
        "gain": (lambda: la.BodyWrench("bob", force=("u", 0, 0), gain=0.0), "gain.*zero"),
        "gain of none": (lambda: la.BodyWrench("bob", force=(1, 0, 0), gain=2.0, name="w"), "'w': the gain 2 is of no"),
        "gain of its own": (lambda: la.BodyWrench("bob", force=({"u": 2}, 0, 0), gain=2.0), "gain 2 is of no input"),
    },
    "HybridWrench": {"a number": (lambda: la.HybridWrench("bob", force=3.0), "force.*three.*3.0")},
    "SpatialWrench": {"frame": (lambda: la.SpatialWrench("", force=(0, 0, 1)), "frame.*not empty")},
    "TendonForce": {
        "gain": (lambda: la.TendonForce(["a", "b"], "u", gain=0), "gain.*zero"),
        "input": (lambda: la.TendonForce(["a", "b"], 3), "input.*3"),
        "curve": (lambda: la.TendonForce(["a", "b"], "u", force_length=1.0), "force_length.*Curve"),
        "curve of rate": (
            lambda: la.TendonForce(["a", "b"], "u", force_velocity=[1.0], name="biceps"),
            "'biceps': force_velocity.*Curve",
        ),
    },
    "Servo": {
        "no gain": (lambda: la.Servo("x", "u", gain=0.0, damping=1.0, name="s"), "'s': every gain is zero.*'u'"),
        "offset": (lambda: la.Servo("x", "u", offset=NAN), "offset.*nan"),
        "path": (lambda: la.Servo({("bob", "post"): 0.0}, "u"), "factor of the path bob to post is zero"),
        "no path": (lambda: la.Servo({("bob",): 1.0}, "u"), "1 frame, expected two"),
    },
    "Armature": {
        "inertia": (lambda: la.Armature("x", 0.0), "inertia.*0.*positive"),
        "factor": (lambda: la.Armature({"x": 0}, 1.0), "'x' is zero"),
    },
    "PolynomialCoupling": {
        "constant": (lambda: la.PolynomialCoupling("x", "theta", [1.0]), "coefficients.*two to sixteen.*1.0"),
        "nan": (lambda: la.PolynomialCoupling("x", "theta", [1.0, NAN]), "c1.*nan"),
        "nothing": (lambda: la.PolynomialCoupling("x", {}, [1.0, 2.0]), "mapping is empty"),
    },
    "Drag": {
        "coefficient": (lambda: la.Drag("bob", 0.0), "coefficient.*0.*positive"),
        "exponent": (lambda: la.Drag("bob", 1.0, exponent=0.5), "exponent.*0.5.*1"),
        "wind": (lambda: la.Drag("bob", 1.0, wind=(1, 2)), r"wind.*\(3,\)"),
        "smoothing": (lambda: la.Drag("bob", 1.0, smoothing=-1), "smoothing.*-1"),
    },
    "Damping": {
        "negative": (lambda: la.Damping({"x": -1}, name="oil"), "'oil'.*x.*-1.*zero or more"),
        "default": (lambda: la.Damping(1.0, default=NAN), "default.*nan.*mapping"),
        "array": (lambda: la.Damping(0.0, default=np.array([1.0, 2.0])), "default.*number"),
    },
}  # fmt: skip

MISFITS = {
    "Gravity": {
        "unknown": (lambda: la.Gravity(frames=["bop"]), "unknown frame 'bop'.*mean 'bob'"),
        "massless": (lambda: la.Gravity(frames=["arm"]), "'arm' carries no mass.*'cart', 'bob'"),
    },
    "InverseSquareGravity": {
        "one body": (lambda: la.InverseSquareGravity("trolley", "hook", 1.0), "no variable moves 'tr"),
        "unknown": (lambda: la.InverseSquareGravity("cart", "bop", 1.0), "mean 'bob'"),
    },
    "LinearSpring": {
        "one body": (lambda: la.LinearSpring("arm", "bob", 1.0, name="s"), "'s': no variable moves"),
        "together": (lambda: la.LinearSpring("arm", "cart", 1, length=1), "every configuration.*choose"),
        "own": (lambda: la.LinearSpring("trolley", "bob", 1, length="rail"), "length 'rail' is also"),
    },
    "JointSpring": {
        "unknown": (lambda: la.JointSpring("tetha", 1.0), "unknown variable 'tetha'.*mean 'theta'"),
        "frame": (lambda: la.JointSpring({"x": 1, "cart": 1}, 1.0), "unknown variable 'cart'"),
        "own": (lambda: la.JointSpring({"x": 1, "theta": 1}, 1.0, rest="x"), "rest 'x' is also"),
    },
    "TorsionalSpring": {
        "slides": (lambda: la.TorsionalSpring("world", "cart", 1), "no variable turns 'world'"),
    },
    "NonlinearSpring": {
        "unknown": (lambda: la.NonlinearSpring(["cart", "bop"], CURVE), "mean 'bob'"),
        "fixed": (lambda: la.NonlinearSpring(["arm", "bob"], CURVE), "path arm to bob.*its length"),
    },
    "ElasticString": {
        "fixed": (lambda: la.ElasticString(["arm", "bob", "arm"], 1, 1), "no variable moves the frames"),
    },
    "PathLength": {
        "prescribed": (
            lambda: la.PathLength(["world", "trolley", "post"], 1.0),
            "no dynamic variable moves.*world to trolley to post",
        ),
        "dynamic": (lambda: la.PathLength(["world", "bob"], "theta"), "'theta' is a dynamic"),
        "own": (lambda: la.PathLength(["trolley", "bob"], "rail"), "'rail' is also"),
    },
    "PointOnPlane": {
        "prescribed": (lambda: la.PointOnPlane("post", "hook"), "no dynamic variable moves 'post'"),
        "unknown": (lambda: la.PointOnPlane("Post", "bob"), "'Post'.*mean 'post'"),
    },
    "PointOnLine": {
        "prescribed": (lambda: la.PointOnLine("hook", "post"), "no dynamic variable moves 'hook'"),
    },
    "HingeLoop": {"one body": (lambda: la.HingeLoop("arm", "bob"), "close the loop")},
    "FixedOrientation": {
        "slides": (lambda: la.FixedOrientation("world", "cart"), "no dynamic variable turns 'world'"),
    },
    "Coupling": {
        "kinematic": (lambda: la.Coupling({"rail": 1.0}), "no dynamic variable is among 'rail'"),
        "unknown": (lambda: la.Coupling({"y": 1.0, "x": 1.0}), "unknown variable 'y'"),
        "dynamic": (lambda: la.Coupling({"x": 1.0}, offset="theta"), "'theta' is a dynamic.*kinematic one"),
    },
    "PrescribedPath": {
        "dynamic": (lambda: la.PrescribedPath("bob", x="theta"), "'theta' is a dynamic"),
        "own": (lambda: la.PrescribedPath("wheel", x="rail"), "x 'rail' is also"),
        "prescribed": (lambda: la.PrescribedPath("hook", y="path"), "no dynamic variable moves 'hook'"),
    },
    "JointForce": {
        "kinematic": (lambda: la.JointForce("rail", "u"), "'rail' is a kinematic.*dynamic one"),
        "only kinematic": (lambda: la.JointForce({"rail": 2.0}, "u"), "no dynamic variable is among"),
        "unknown": (lambda: la.JointForce({"x": 1.0, "y": 1.0}, "u"), "unknown variable 'y'"),
    },
    "Motor": {
        "slides": (lambda: la.Motor("world", "cart", "u"), "no dynamic variable turns 'world'"),
        "unknown": (lambda: la.Motor("world", "masts", "u"), "mean 'mast'"),
    },
    "LinearMotor": {
        "prescribed": (lambda: la.LinearMotor("post", "hook", "u"), "no dynamic variable moves 'post'"),
        "together": (lambda: la.LinearMotor("cart", "arm", "u"), "'cart' and 'arm' coincide"),
    },
    "NonlinearDamping": {
        "kinematic": (lambda: la.NonlinearDamping("rail", (1.0,)), "'rail' is a kinematic.*dynamic"),
    },
    "LinearDamper": {
        "one body": (lambda: la.LinearDamper("arm", "bob", 1.0), "no variable moves"),
        "together": (lambda: la.LinearDamper("cart", "arm", 1.0), "'cart' and 'arm' coincide"),
    },
    "CoulombFriction": {
        "unknown": (lambda: la.CoulombFriction("y", force=1, speed=1), "unknown variable 'y'"),
    },
    "BodyWrench": {
        "fixed": (lambda: la.BodyWrench("post", force=(0, 0, 1)), "no variable moves 'post'"),
    },
    "HybridWrench": {
        "unknown": (lambda: la.HybridWrench("bop", force=("u", 0, 1)), "unknown frame 'bop'"),
    },
    "SpatialWrench": {
        "fixed": (lambda: la.SpatialWrench("world", torque=(0, 0, 1)), "no variable moves 'world'"),
    },
    "TendonForce": {
        "fixed": (lambda: la.TendonForce(["arm", "bob"], "u"), "no variable moves the frames"),
        "together": (lambda: la.TendonForce(["bob", "world", "mast"], "u"), "'world' and 'mast' coi"),
        "unknown": (lambda: la.TendonForce(["arm", "Post"], "u"), "mean 'post'"),
    },
    "Servo": {
        "prescribed": (lambda: la.Servo("rail", "u"), "'rail' is a kinematic"),
        "fixed": (lambda: la.Servo({("arm", "bob"): 2.0}, "u"), "no dynamic variable moves the frames"),
    },
    "Armature": {"unknown": (lambda: la.Armature("y", 1.0), "unknown variable 'y'")},
    "PolynomialCoupling": {
        "prescribed": (lambda: la.PolynomialCoupling("rail", "theta", (0.0, 1.0)), "no dynamic variable.*'rail'"),
        "unknown": (lambda: la.PolynomialCoupling("x", "y", (0.0, 1.0)), "unknown variable 'y'"),
    },
    "Drag": {"fixed": (lambda: la.Drag("post", 1.0), "no variable moves 'post'")},
    "Damping": {"unknown": (lambda: la.Damping({"y": 1.0}), "unknown variable 'y'")},
}  # fmt: skip


def flat(table):
    return [pytest.param(*case, id=f"{kind} {what}") for kind, cases in table.items() for what, case in cases.items()]


@pytest.mark.parametrize(("make", "pattern"), flat(FIELDS))
def test_bad_fields(make, pattern):
    with pytest.raises(DescriptionError, match=f"(?s){pattern}"):
        make()


@pytest.mark.parametrize(("make", "pattern"), flat(MISFITS))
def test_an_element_that_does_not_fit(make, pattern):
    with pytest.raises(DescriptionError, match=f"(?s){pattern}"):
        Mechanism(tree(), [make()])


@pytest.mark.parametrize("table", [FIELDS, MISFITS])
def test_every_message_starts_with_the_type(table):
    for kind, cases in table.items():
        for make, _ in cases.values():
            with pytest.raises(DescriptionError) as caught:
                Mechanism(tree(), [make()])
            assert str(caught.value).startswith(kind)


def test_every_element_type_is_here():
    families = {"Element", "Potential", "Force", "Constraint", "Wrench"}
    elsewhere = {"Distance", "PointToPoint"}
    users_own = ("expression", "python_function")
    types = {
        name
        for name, kind in vars(la).items()
        if isinstance(kind, type) and issubclass(kind, la.Element) and not kind.__module__.endswith(users_own)
    }
    assert types - families - elsewhere == set(FIELDS) == set(MISFITS)


# Random arguments, many of them wrong: each element compiles to finite numbers or is a typed error.

junk = st.sampled_from([None, NAN, INF, "", "u", -1.0, 0, [], {}, True, 1j, b"x", object(), CURVE])
names = st.sampled_from(["world", "cart", "arm", "bob", "trolley", "hook", "mast", "post", "bop"])
variables = st.sampled_from(["x", "theta", "spin", "yaw", "rail", "y"])
plain = st.floats(0.1, 2.0)
sums = st.one_of(variables, st.dictionaries(variables, st.floats(-1.0, 1.0), max_size=2))
paths = st.lists(names, min_size=1, max_size=4)
triples = st.lists(st.one_of(plain, st.sampled_from(["u", "w"])), min_size=3, max_size=3)
directions = st.one_of(st.sampled_from(["x", "y", "z", "w"]), st.lists(plain, min_size=3, max_size=3))
rotations = st.sampled_from([np.eye(3), np.eye(2), -np.eye(3), np.full((3, 3), NAN)])
sound = {
    **dict.fromkeys(("frame", "frame1", "frame2", "plane", "line"), names),
    **dict.fromkeys(("frames",), paths),
    **dict.fromkeys(("x", "y", "z", "input"), variables),
    "variable": sums,
    **dict.fromkeys(("on", "factors"), st.one_of(sums, paths)),
    **dict.fromkeys(("rest", "offset"), st.one_of(plain, st.sampled_from(["wish", "rail", "x"]))),
    **dict.fromkeys(("axis", "normal", "direction", "vector", "wind"), directions),
    **dict.fromkeys(("force_length", "force_velocity"), st.just(CURVE)),
    "force": st.one_of(triples, plain, st.just(CURVE)),
    "torque": triples,
    "length": st.one_of(plain, st.sampled_from(["rope", "rail", "x"])),
    "rotation": rotations,
    "coefficients": st.one_of(st.lists(plain, max_size=3), plain),
    "planar": st.booleans(),
    "tension_only": st.booleans(),
}
types = st.sampled_from([getattr(la, kind) for kind in FIELDS])


@settings(max_examples=600, deadline=None, suppress_health_check=list(HealthCheck))
@given(kind=types, data=st.data())
def test_random_arguments_make_an_element_or_a_typed_error(kind, data):
    given = {}
    for field in dataclasses.fields(kind):
        optional = field.default is not dataclasses.MISSING
        if field.name == "name" or (optional and data.draw(st.booleans())):
            continue
        good = sound.get(field.name, plain)
        given[field.name] = data.draw(st.one_of(*[good] * 9, junk), label=field.name)
    try:
        mechanism = Mechanism(tree(), [kind(**given)])
    except DescriptionError as error:
        message = str(error)
    else:
        message = str(mechanism).splitlines()[-5]
        q = np.linspace(0.2, 0.9, mechanism.nq)
        assert np.isfinite(mechanism.energy(q, q).total)
        assert np.isfinite(mechanism.constraint_values(q)).all()
        assert np.isfinite(mechanism.core.force(q, q, np.ones(mechanism.nu))).all()
    assert message.startswith(kind.__name__)
