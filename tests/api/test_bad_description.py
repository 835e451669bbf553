"""Every broken description is a typed error that names what is wrong; none of them ends the process."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from leastaction.errors import (
    ArgumentError,
    DescriptionError,
    InconsistentStartError,
    LeastActionError,
    MotionFileError,
    OutputError,
    ResultFileError,
    StepError,
    closest,
)
from leastaction.mechanics import (
    Body,
    Damping,
    Distance,
    Gravity,
    JointForce,
    Mechanism,
    pose,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
    world,
)

# Angles of many turns are asked for on purpose here.
pytestmark = pytest.mark.filterwarnings("ignore::leastaction.errors.UnitWarning")

NAN, INF = float("nan"), float("inf")


def cart():
    return [tx("x", name="cart", mass=10.0), [rz("theta"), [ty(-1.0, name="bob", mass=1.0)]]]


def with_kinematic():
    return [*cart(), tx("rail", name="trolley", kinematic=True)]


def self_containing():
    children = [rz("theta", mass=1.0, inertia=(1, 1, 1))]
    children.append(children)
    return children


def used_twice():
    limb = ty(-1.0, name="limb", mass=1.0)
    return [rx("a"), [limb], rx("b"), [limb]]


def shared_list():
    limb = [ty(-1.0, name="limb", mass=1.0)]
    return [rx("a"), limb, rx("b"), limb]


FRAMES = {
    "mass is NaN": (lambda: tx("x", name="cart", mass=NAN), "'cart'.*mass.*nan"),
    "mass is infinite": (lambda: tx("x", name="cart", mass=INF), "'cart'.*mass.*inf"),
    "mass is negative": (lambda: tx("x", name="cart", mass=-1.0), "'cart'.*-1.*positive"),
    "mass is text": (lambda: tx("x", name="cart", mass="10"), "'cart'.*'10'.*number"),
    "mass is a truth value": (lambda: tx("x", name="cart", mass=True), "'cart'.*True.*number"),
    "huge whole number": (lambda: tx(10**400), "tx.*finite"),
    "bodies that are a number": (lambda: tx("x", name="cart", bodies=3), "'cart'.*list of Body.*3"),
    "nonphysical in part": (
        lambda: Body(1.0, allow_nonphysical=np.array([True, False])),
        "allow_nonphysical.*True or False",
    ),
    "rotation whose squares overflow": (
        lambda: pose(rotation=1e300 * np.eye(3)),
        "rotation is not orthonormal",
    ),
    "amount is NaN": (lambda: rz(NAN), "rz.*nan"),
    "amount is nothing": (lambda: rz(None), "rz.*None"),
    "amount is a list": (lambda: rz([1.0]), r"rz.*\[1.0\]"),
    "amount is complex": (lambda: rz(1j), "rz.*1j"),
    "empty variable": (lambda: rz(""), "rz.*not empty"),
    "empty name": (lambda: rz("a", name="  "), "name of a rz.*not empty"),
    "name is a number": (lambda: rz("a", name=3), "name of a rz.*3"),
    "constant marked kinematic": (lambda: tx(0.5, kinematic=True), r"tx\(0.5\).*constant"),
    "com without mass": (lambda: tx("x", name="cart", com=(0, 0, 1)), "'cart'.*com.*mass="),
    "inertia without mass": (lambda: tx("x", inertia=(1, 1, 1)), "x.*inertia.*mass="),
    "com of two numbers": (
        lambda: tx("x", name="cart", mass=1, com=(0, 0)),
        r"'cart'.*com.*\(2,\).*\(3,\)",
    ),
    "com with NaN": (
        lambda: tx("x", name="cart", mass=1, com=(0, NAN, 0)),
        r"'cart'.*com.*nan.*\(1,\)",
    ),
    "com as text": (lambda: tx("x", mass=1, com="abc"), "com.*'abc'"),
    "ragged com": (lambda: tx("x", mass=1, com=[1, [2, 3], 4]), "com.*real numbers"),
    "inertia of four numbers": (lambda: tx("x", mass=1, inertia=(1, 1, 1, 0)), r"inertia.*\(4,\)"),
    "inertia as text": (lambda: tx("x", mass=1, inertia="abc"), "inertia.*expected"),
    "ragged inertia": (lambda: tx("x", mass=1, inertia=[[1], [2, 3]]), "inertia"),
    "inertia with NaN": (lambda: tx("x", mass=1, inertia=(1, NAN, 1)), "inertia.*nan"),
    "inertia that is negative": (
        lambda: tx("x", name="cart", mass=1, inertia=(1, 1, -1)),
        "'cart'.*principal moments.*negative",
    ),
    "inertia with too large products": (
        lambda: tx("x", mass=1, inertia=(1, 1, 1, 2, 0, 0)),
        "principal moments.*negative",
    ),
    "inertia that is not symmetric": (
        lambda: tx("x", mass=1, inertia=[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]),
        "not symmetric",
    ),
    "inertia of no real body": (
        lambda: tx("x", name="cart", mass=1, inertia=(0.1, 0.1, 1)),
        "'cart'.*sum of the other two.*allow_nonphysical",
    ),
    "bodies that are none": (lambda: tx("x", bodies=[3.0]), "bodies.*3.0"),
    "one body for the list": (lambda: tx("x", bodies=Body(1.0)), "bodies.*list"),
    "pose of nothing": (lambda: pose(), "4x4"),
    "pose both ways": (lambda: pose(np.eye(4), translation=(0, 0, 0)), "not both"),
    "pose of 3x3": (lambda: pose(np.eye(3), name="p"), r"pose 'p'.*\(3, 3\).*\(4, 4\)"),
    "pose with NaN": (lambda: pose(translation=(0, NAN, 0), name="p"), r"'p'.*nan.*\(1,\)"),
    "pose with a bad last row": (lambda: pose(np.eye(4) * 2.0, name="p"), "'p'.*last row"),
    "pose that stretches": (lambda: pose(rotation=1.01 * np.eye(3), name="p"), "'p'.*orthonormal"),
    "pose by angles": (
        lambda: pose(rotation=(0.0, 0.0, 1.57)),
        r"rotation: got shape \(3,\), expected \(3, 3\), that is a matrix; give angles as rz",
    ),
    "inertia in the order of URDF": (
        lambda: Body(1.0, inertia=(0.1, 0.0, 0.0, 0.1, 0.0, 0.1)),
        r"none may be negative.* six numbers are \[Ixx, Iyy, Izz, Ixy, Ixz, Iyz\]: URDF",
    ),
    "pose that reflects": (lambda: pose(rotation=np.diag([1, 1, -1]), name="p"), "'p'.*reflection"),
}

DESCRIPTIONS = {
    "frame name twice": (lambda: [tx("a", name="f"), ty("b", name="f")], "duplicate.*'f'"),
    "frame named world": (lambda: [tx("a", name="world")], "duplicate.*'world'"),
    "variable dynamic here, kinematic there": (
        lambda: [tx("a", mass=1), [ty("a", name="slide", kinematic=True)]],
        r"'a' is dynamic in the frame 'tx\(a\)' and kinematic in 'slide'",
    ),
    "list that holds itself": (self_containing, "cycle"),
    "frame in two places": (used_twice, "'limb'.*two places"),
    "list in two places": (shared_list, "'limb'.*two places"),
    "list before its frame": (lambda: [[tx("a")], tx("b")], "list stands first"),
    "two lists in a row": (lambda: [tx("a"), [ty("b")], [tz("c")]], "follows another list"),
    "number among the frames": (lambda: [tx("a"), 3], "got 3"),
    "text among the frames": (lambda: [tx("a"), ["b"]], r"children of tx\(a\).*'b'"),
    "function not called": (lambda: [tx], r"call it, as in tx\('x'\)"),
    "nothing": (lambda: None, "list of frames.*NoneType"),
    "text": (lambda: "tx", "list of frames.*str"),
    "frame without its list": (lambda: tx("x", mass=1.0), "list of frames.*Frame"),
    "massless variable": (lambda: [tx("a", mass=1.0), [ry("slack")]], "massless.*'slack'"),
    "inertia that a translation does not see": (
        lambda: [tx("slack", bodies=[Body(0.0, inertia=(1, 1, 1))])],
        "massless.*'slack'",
    ),
    "point mass on the axis": (lambda: [rz("spin"), [tz(1.0, mass=1.0)]], "massless.*'spin'.*axis"),
    "point mass always on the axis": (
        lambda: [tx("a"), [ry("b"), [rz("spin"), [tz("c", mass=1.0)]]]],
        "massless.*'spin'.*axis",
    ),
}

ELEMENTS = {
    "no element": (lambda: [3.0], "got 3.0"),
    "class for an element": (lambda: [Gravity], "got <class"),
    "element without its list": (lambda: Gravity(), "list"),
    "two gravities": (lambda: [Gravity(), Gravity((0, 1, 0))], "only one Gravity"),
    "gravity of two numbers": (lambda: [Gravity((0, 1))], r"Gravity.*\(3,\)"),
    "gravity with NaN": (lambda: [Gravity((0, NAN, 1))], "Gravity.*nan"),
    "element name twice": (
        lambda: [Damping(0.1, name="e"), Gravity(name="e")],
        "duplicate element name 'e'.*Damping.*Gravity",
    ),
    "empty element name": (lambda: [Gravity(name="")], "name of a Gravity"),
    "damping of an unknown variable": (lambda: [Damping({"tetha": 0.1})], "'tetha'.*mean 'theta'"),
    "damping of a kinematic variable": (
        lambda: [Damping({"rail": 0.1})],
        "'rail' is a kinematic.*dynamic one is needed.*'x', 'theta'",
    ),
    "negative damping": (lambda: [Damping({"theta": -0.1})], "theta.*-0.1"),
    "damping with NaN": (lambda: [Damping(NAN)], "Damping.*nan"),
    "damping as text": (lambda: [Damping("0.1")], "Damping.*'0.1'"),
    "force on an unknown variable": (lambda: [JointForce("y", input="u")], "unknown variable 'y'"),
    "force on a frame": (lambda: [JointForce("cart", input="u")], "unknown variable 'cart'"),
    "force on a kinematic variable": (
        lambda: [JointForce("rail", input="u")],
        "'rail' is a kinematic.*dynamic",
    ),
    "force with an unnamed input": (lambda: [JointForce("x", input="")], "input.*not empty"),
    "distance to an unknown frame": (
        lambda: [Distance("world", "bop", 1.0, name="rope")],
        "'rope'.*'bop'.*mean 'bob'",
    ),
    "distance to a variable": (lambda: [Distance("world", "theta", 1.0)], "unknown frame 'theta'"),
    "distance of a frame to itself": (
        lambda: [Distance("bob", "bob", 1.0, name="rope")],
        "'rope'.*both",
    ),
    "string of zero length": (
        lambda: [Distance("world", "bob", 0.0, name="rope")],
        "'rope'.*zero length",
    ),
    "string of negative length": (
        lambda: [Distance("world", "bob", -1, name="rope")],
        "'rope'.*-1",
    ),
    "string of NaN length": (lambda: [Distance("world", "bob", NAN, name="rope")], "'rope'.*nan"),
    "length is a dynamic variable": (
        lambda: [Distance("world", "bob", "theta", name="rope")],
        "'rope'.*'theta' is a dynamic.*kinematic",
    ),
    "length that moves an end": (
        lambda: [Distance("trolley", "bob", "rail", name="rope")],
        "'rope'.*'rail' is also",
    ),
    "distance within a body": (
        lambda: [Distance("rz(theta)", "bob", 1.0, name="rope")],
        "'rope'.*no dynamic variable",
    ),
    "elements that are no list": (lambda: None, "elements.*list.*None"),
    "elements by name": (lambda: {"g": Gravity()}, "elements.*list.*'g'"),
    "distance that is prescribed": (
        lambda: [Distance("world", "trolley", "l", name="rope")],
        "'rope'.*no dynamic variable",
    ),
}

ORDERS = {
    "unknown": ({"dynamic": ["x", "tetha"]}, "dynamic.*'tetha'.*mean 'theta'"),
    "missing": ({"dynamic": ["x"]}, "dynamic.*lacks 'theta'"),
    "twice": ({"dynamic": ["x", "x", "theta"]}, "dynamic.*'x'.*2 times"),
    "text": ({"dynamic": "x"}, "dynamic.*list"),
    "numbers": ({"dynamic": [0, 1]}, "dynamic.*list of names"),
    "kinematic unknown": ({"kinematic": ["rail", "rope"]}, "kinematic.*'rope'.*'rail'"),
    "kinematic missing": ({"kinematic": []}, "kinematic.*lacks 'rail'"),
    "input unknown": ({"inputs": ["u"]}, "inputs.*'u'.*no inputs"),
    "a number": ({"inputs": 3}, "inputs.*list of names.*3"),
}


def check_raises(action, pattern):
    with pytest.raises(DescriptionError, match=f"(?s){pattern}"):
        action()


@pytest.mark.parametrize("case", FRAMES)
def test_bad_frame(case):
    make, pattern = FRAMES[case]
    check_raises(make, pattern)


@pytest.mark.parametrize("case", DESCRIPTIONS)
def test_bad_tree(case):
    make, pattern = DESCRIPTIONS[case]
    check_raises(lambda: Mechanism(make()), pattern)


@pytest.mark.parametrize("case", ELEMENTS)
def test_bad_element(case):
    make, pattern = ELEMENTS[case]
    check_raises(lambda: Mechanism(with_kinematic(), make()), pattern)


@pytest.mark.parametrize("case", ORDERS)
def test_bad_order(case):
    orders, pattern = ORDERS[case]
    check_raises(lambda: Mechanism(with_kinematic(), **orders), pattern)


def test_a_frame_in_two_chains_is_found_too():
    limb = ty(-1.0, name="limb", mass=1.0)
    tree = world()
    tree.rx("a").put(limb)
    tree.rx("b").put(limb)
    check_raises(lambda: Mechanism(tree), "'limb'.*two places")


def test_a_broken_list_leaves_the_chain_as_it_was():
    tree = world()
    tree.tx("x", mass=1.0)
    check_raises(lambda: tree.add([ty("y"), 3]), "got 3")
    check_raises(lambda: tree.put([ty("y")]), "expected a frame")
    assert Mechanism(tree).variables == ("x",)


def test_what_is_nearly_massless_is_not_refused():
    tiny = Mechanism([tx("a", mass=10.0), [ty(20.0), [rz("b"), [tx(1e-3, mass=1e-6)]]]])
    assert tiny.mass_matrix([0.0, 0.0])[1, 1] == pytest.approx(1e-12, rel=1e-3)
    rotor = Mechanism([rz("spin", bodies=[Body(0.0, inertia=(0.5, 0.5, 1e-9))])])
    assert rotor.mass_matrix([0.0])[0, 0] == pytest.approx(1e-9)


def test_a_rod_and_an_allowed_lumped_inertia_are_accepted():
    assert Body(1.0, inertia=(1.0, 1.0, 0.0)).inertia[2, 2] == 0.0
    assert Body(1.0, inertia=(0.1, 0.1, 1.0), allow_nonphysical=True).inertia[2, 2] == 1.0


def test_a_rotation_with_the_digits_of_a_file_is_made_orthonormal():
    angle = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    taken = pose(rotation=angle.round(10)).matrix[:3, :3]
    np.testing.assert_allclose(taken.T @ taken, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(taken, angle, atol=1e-9)


BAD_CALLS = {
    "unknown frame": (lambda m: m.frame_pose([0, 0], "bop"), "'bop'.*mean 'bob'"),
    "frame by number": (lambda m: m.frame_pose([0, 0], 3), "unknown frame 3"),
    "frames as text": (lambda m: m.positions([0, 0], "bob"), "list of frames"),
    "unknown among the frames": (lambda m: m.positions([0, 0], ["Bob"]), "'Bob'.*mean 'bob'"),
    "short q": (lambda m: m.positions([0]), r"q.*\(1,\).*\(2,\).*x, theta"),
    "short batch": (lambda m: m.positions(np.zeros((3, 3))), r"q.*\(3, 3\).*\(any, 2\)"),
    "cube": (lambda m: m.positions(np.zeros((3, 3, 2))), r"q.*\(3, 3, 2\)"),
    "q with NaN": (lambda m: m.energy([0, NAN], [0, 0]), "q.*nan.*'theta'"),
    "v with infinity": (lambda m: m.momentum([0, 0], [INF, 0]), "v.*inf.*'x'"),
    "v of another length": (
        lambda m: m.energy(np.zeros((3, 2)), np.zeros((4, 2))),
        r"v.*\(4, 2\).*\(3, 2\)",
    ),
    "q as text": (lambda m: m.mass_matrix("ab"), "q.*'ab'"),
    "complex q": (lambda m: m.mass_matrix([1j, 0]), "q.*real numbers"),
    "ragged q": (lambda m: m.energy([[1], [2, 3]], [0, 0]), "q.*real numbers"),
    "nothing for q": (lambda m: m.constraint_values(None), "q.*None"),
    "unknown variable": (lambda m: m.configuration({"tetha": 1.0}), "'tetha'.*mean 'theta'"),
    "value is NaN": (lambda m: m.configuration({"theta": NAN}), "'theta'.*nan"),
    "value is text": (lambda m: m.configuration({"theta": "1"}), "'theta'.*'1'"),
}


@pytest.mark.parametrize("case", BAD_CALLS)
def test_bad_argument(case):
    call, pattern = BAD_CALLS[case]
    mechanism = Mechanism(cart())
    with pytest.raises(ArgumentError, match=f"(?s){pattern}"):
        call(mechanism)


def test_errors_have_one_base_and_survive_a_worker_process():
    residuals = {"small": 0.1, "large": -2.0, "broken": NAN}
    errors = [
        DescriptionError("text"),
        ArgumentError("text"),
        MotionFileError("text"),
        OutputError("text"),
        ResultFileError("text"),
        InconsistentStartError("text", residuals=residuals),
        StepError("text", t=0.5, residuals=residuals, iteration=7, state=[1.0]),
    ]
    for error in errors:
        assert isinstance(error, LeastActionError)
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error)
        assert str(again) == "text"
    assert list(again.residuals) == ["broken", "large", "small"]
    assert (again.t, again.iteration, again.state) == (0.5, 7, [1.0])
    assert isinstance(DescriptionError("text"), ValueError)
    assert isinstance(OutputError("text"), OSError)


def test_close_matches():
    assert closest("Theta", ["theta", "x"], what="variables") == "did you mean 'theta'?"
    assert closest("QQ", ["qq"], what="variables") == "did you mean 'qq'?"
    assert closest("zzz", [], what="inputs") == "the mechanism has no inputs"
    many = [f"f{i}" for i in range(30)]
    assert closest(None, many, what="frames").endswith("and 18 more")


# Random descriptions, valid and broken: each either compiles to finite numbers or is a typed error.

amounts = st.one_of(
    st.floats(-2.0, 2.0),
    st.sampled_from(["a", "b", "c", "d", "e", "f", "g"]),
    st.sampled_from([NAN, INF, None, "", 1e300, [1.0]]),
)
masses = st.one_of(st.none(), st.floats(0.0, 5.0), st.sampled_from([NAN, -1.0, "m", 1e300]))
inertias = st.one_of(
    st.none(),
    st.sampled_from([(1, 1, 1), (0.3, 0.3, 0.1), (1, 1, 1, 0.1, 0.1, 0.1)]),
    st.lists(st.floats(-1.0, 2.0), min_size=2, max_size=6),
)
options = st.fixed_dictionaries(
    {},
    optional={
        "name": st.sampled_from(["p", "q", "r", "world", ""]),
        "mass": masses,
        "inertia": inertias,
        "kinematic": st.booleans(),
    },
)
primitives = st.sampled_from([tx, ty, tz, rx, ry, rz])
frames = st.tuples(primitives, amounts, options)
trees = st.recursive(
    st.lists(frames, max_size=3),
    lambda lower: st.lists(st.one_of(frames, lower), max_size=4),
    max_leaves=12,
)
names = st.sampled_from(["world", "p", "q", "r", "a", "b", "rz(a)", "nobody"])
elements = st.lists(
    st.one_of(
        st.just((Gravity, ())),
        st.tuples(st.just(Damping), st.tuples(st.one_of(amounts, st.dictionaries(names, masses)))),
        st.tuples(st.just(JointForce), st.tuples(names, names)),
        st.tuples(st.just(Distance), st.tuples(names, names, amounts)),
    ),
    max_size=3,
)


def build(tree):
    if isinstance(tree, tuple):
        make, amount, chosen = tree
        return make(amount, **chosen)
    return [build(item) for item in tree]


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(tree=trees, acting=elements, order=st.one_of(st.none(), st.lists(names, max_size=3)))
def test_random_descriptions_compile_or_are_refused(tree, acting, order):
    try:
        mechanism = Mechanism(build(tree), [make(*arguments) for make, arguments in acting], dynamic=order)
    except DescriptionError:
        return
    q = np.linspace(-1.0, 1.0, mechanism.nq)
    assert np.isfinite(mechanism.positions(q)).all()
    assert np.isfinite(mechanism.constraint_jacobian(q)).all()
    assert str(mechanism).startswith("world")
    assert len(mechanism.frames) == len(set(mechanism.frames))


sound = st.recursive(
    st.just([]),
    lambda lower: st.lists(st.tuples(primitives, st.booleans(), st.floats(-1.0, 1.0), lower), min_size=1, max_size=3),
    max_leaves=8,
)


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(shape=sound)
def test_random_sound_descriptions_always_compile(shape):
    counter = iter(range(10_000))

    def grow(children):
        description = []
        for make, kinematic, amount, below in children:
            variable = f"v{next(counter)}"
            description += [
                make(variable, kinematic=kinematic, mass=1.0, inertia=(0.2, 0.3, 0.4)),
                [tz(amount, mass=abs(amount)), *grow(below)],
            ]
        return description

    mechanism = Mechanism(grow(shape), [Gravity(), Damping(0.1)])
    q = np.linspace(-1.0, 1.0, mechanism.nq)
    inertia = mechanism.mass_matrix(q)
    np.testing.assert_allclose(inertia, inertia.T, atol=1e-12)
    if mechanism.nq:
        assert np.linalg.eigvalsh(inertia)[0] > -1e-12
