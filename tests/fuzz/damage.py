"""What breaks a description: one thing in one place, drawn, with its label.

``Damage.certain`` says that nothing sensible can be made of it, so that it must be refused; what is not certain
(a stiffness of 1e300, an axis of zero length) may be taken, and is held to give finite numbers or errors.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from fuzz.pieces import Bowl, Fit, NoFit
from fuzz.trees import Call, Draw, Node, Wood
from leastaction import mechanics as la
from leastaction.mechanics import expressions as ex

NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Damage:
    """``kind``: of the value, such as "not finite". ``where``: the element type or the function that got it."""

    kind: str
    where: str
    what: str
    certain: bool


class UsersMistake(Exception):
    """What a function of the user's own raises; the package must pass it on."""


class Raises(Bowl):
    def value(self, z: Any) -> Any:
        raise UsersMistake


class Flat(Bowl):
    """A gradient of another shape."""

    def gradient(self, z: Any) -> Any:
        return z[:-1]


class Textual(Bowl):
    def hessian(self, z: Any) -> Any:
        return "none"


class Undefined(Bowl):
    def value(self, z: Any) -> Any:
        return NAN * z[0]


class Rotten(Bowl):
    """Complex numbers for real z."""

    def value(self, z: Any) -> Any:
        return 1j


# Bad values by the kind of a field: (kind of damage, value, certain).
Bad = list[tuple[str, Any, bool]]


def but(bad: Bad, *values: Any) -> Bad:
    """Return the list without some plain values."""
    return [entry for entry in bad if not any(type(entry[1]) is type(v) and entry[1] == v for v in values)]


def choose(d: Draw, bad: Bad) -> tuple[str, Any, bool]:
    """Draw a kind of damage, then a value of that kind."""
    kind = d.pick(list(dict.fromkeys(entry[0] for entry in bad)))
    label, value, certain = d.pick([entry for entry in bad if entry[0] == kind])
    return label, value, certain


NOTHING: Bad = [("wrong type", value, True) for value in (None, object(), b"x", 1j, {1: 2}, len)]
NUMBER: Bad = [
    *NOTHING,
    ("wrong type", "1", True),
    ("wrong type", True, True),
    ("wrong shape", [1.0], True),
    ("wrong shape", np.array([1.0, 2.0]), True),
    ("not finite", NAN, True),
    ("not finite", INF, True),
    ("not finite", np.float64(-np.inf), True),
    ("not finite", 10**400, True),
    ("huge", 1e300, False),
    ("tiny", 1e-300, False),
    ("tiny", 5e-324, False),
    ("zero", 0.0, False),
    ("zero", np.int64(0), False),
    ("negative", -1.5, False),
]  # fmt: skip
POSITIVE: Bad = [(k, v, certain or k == "negative") for k, v, certain in NUMBER]
NAME: Bad = [
    *NOTHING,
    ("wrong type", 3, True),
    ("wrong type", ["a"], True),
    ("empty", "", True),
    ("empty", "  ", True),
    ("unknown name", "nowhere", True),
    ("unknown name", "TIP1", True),
]
FREE_NAME: Bad = [bad for bad in NAME if bad[0] != "unknown name"]
TITLE: Bad = but(FREE_NAME, None)
NAMES: Bad = [
    *NOTHING,
    ("wrong type", 3, True),
    ("wrong type", "tip1", True),
    ("wrong type", [None, 3], True),
    ("empty", [], True),
    ("empty", ["", "post"], True),
    ("unknown name", ["post", "nowhere"], True),
    ("duplicate", ["post", "post"], True),
    ("wrong shape", [["post", "world"], ["post"]], True),
]
VECTOR: Bad = [
    *NOTHING,
    ("wrong type", "w", True),
    ("wrong type", ["1", "2", "3"], True),
    ("wrong type", (1j, 0.0, 0.0), True),
    ("wrong type", 3.0, True),
    ("wrong shape", (0.0, 1.0), True),
    ("wrong shape", np.eye(3), True),
    ("wrong shape", [[1.0], [1.0, 2.0], 3.0], True),
    ("not finite", (0.0, NAN, 1.0), True),
    ("not finite", (INF, 0.0, 0.0), True),
    ("huge", (1e300, -1e300, 1e300), False),
    ("tiny", (1e-300, 0.0, 1e-310), False),
    ("zero", (0.0, 0.0, 0.0), False),
]
FACTORS: Bad = [
    *but(NOTHING, {1: 2}),
    ("wrong type", {3: 1.0}, True),
    ("wrong type", {"a": "1"}, True),
    ("wrong type", [["a", 1.0]], True),
    ("empty", "", True),
    ("empty", {"": 1.0}, True),
    ("unknown name", {"nowhere": 1.0}, True),
    ("unknown name", "nowhere", True),
    ("not finite", {"a": NAN}, True),
    ("huge", {"a": 1e300}, False),
    ("tiny", {"a": 1e-300}, False),
]
CURVE: Bad = [
    *NOTHING,
    ("wrong type", 3.0, True),
    ("wrong type", "linear", True),
    ("wrong shape", Call(la.Curve, [[0.0, 1.0], [1.0]]), True),
    ("wrong shape", Call(la.Curve, [[0.0], [1.0]]), True),
    ("not finite", Call(la.Curve, [[0.0, 1.0], [1.0, NAN]]), True),
    ("duplicate", Call(la.Curve, [[0.0, 0.0, 1.0], [1.0, 2.0, 3.0]]), True),
    ("huge", Call(la.Curve, [[0.0, 1.0, 2.0], [1e300, -1e300, 1e300]]), False),
    ("huge", Call(la.Curve, [[0.0, 1.0, 2.0], [1e308, -1e308, 1e308]]), False),
    ("huge", Call(la.Curve, [np.linspace(0, 1e300, 9).tolist(), [0.0, 1.0, 2.0] * 3]), False),
    ("tiny", Call(la.Curve, [[0.0, 1e-300, 1.0], [1.0, 2.0, 3.0]]), False),
    ("tiny", Call(la.Curve, [np.linspace(0, 1e-300, 9).tolist(), [0.0, 1.0, 2.0] * 3]), False),
    ("tiny", Call(la.Curve, [np.linspace(0, 5e-324, 9).tolist(), [0.0, 1.0, 2.0] * 3]), True),
]  # fmt: skip
TRIPLE: Bad = [
    ("wrong type", 3.0, True),
    ("wrong type", "abc", True),
    ("wrong type", object(), True),
    ("wrong type", (None, 0.0, 0.0), True),
    ("wrong type", ([1.0], 0.0, 0.0), True),
    ("wrong type", {0: 1.0, 1: 2.0, 2: 3.0}, True),
    ("wrong shape", (0.0, 1.0), True),
    ("wrong shape", np.zeros((3, 3)), True),
    ("wrong shape", np.array(1.0), True),
    ("empty", ("", 0.0, 0.0), True),
    ("not finite", (0.0, NAN, 0.0), True),
    ("not finite", np.array([INF, 0.0, 0.0]), True),
    ("huge", (1e300, 0.0, 1e300), False),
    ("tiny", (1e-300, 0.0, 0.0), False),
    ("zero", (0.0, 0.0, 0.0), False),
]
FLAG: Bad = [
    ("wrong type", np.array([True, False]), True),
    ("wrong type", "no", True),
    ("wrong type", object(), True),
]
ROTATION: Bad = [
    *but(NOTHING, None),
    ("wrong shape", [1.0, 2.0], True),
    ("wrong shape", np.eye(2), True),
    ("not finite", np.full((3, 3), NAN), True),
    ("negative", -np.eye(3), True),
    ("huge", 1e300 * np.eye(3), True),
    ("tiny", 1e-300 * np.eye(3), True),
    ("zero", np.zeros((3, 3)), True),
]
COEFFICIENTS: Bad = [
    *NOTHING,
    ("wrong type", 1.0, True),
    ("wrong type", ("1", 2.0), True),
    ("empty", [], True),
    ("wrong shape", [0.1] * 9, True),
    ("negative", [1.0, -1.0], True),
    ("zero", [1.0, 0.0], True),
    ("not finite", [NAN, 1.0], True),
    ("huge", [1e300, 1e300], False),
    ("tiny", [1e-300], False),
]
SCALAR: Bad = [*FACTORS, *but(NAMES, "tip1")]
POLYNOMIAL: Bad = [
    *NOTHING,
    ("wrong type", 1.0, True),
    ("wrong type", ("1", 2.0), True),
    ("empty", [], True),
    ("wrong shape", [0.1], True),
    ("wrong shape", [0.1] * 17, True),
    ("not finite", [1.0, NAN], True),
    ("huge", [1e300, 1e300], False),
]
DAMPING: Bad = [
    *but(NOTHING, {1: 2}),
    ("wrong type", "1", True),
    ("wrong type", {3: 1.0}, True),
    ("wrong shape", [1.0, 2.0], True),
    ("negative", -1.0, True),
    ("negative", {"a": -1.0}, True),
    ("unknown name", {"nowhere": 1.0}, True),
    ("not finite", NAN, True),
    ("huge", 1e300, False),
    ("tiny", 1e-300, False),
    ("zero", 0.0, False),
]
PATH_AXES: Bad = [
    *NOTHING,
    ("empty", "", True),
    ("unknown name", "xw", True),
    ("duplicate", "xx", True),
]
FUNCTION: Bad = [
    *NOTHING,
    ("wrong type", Bowl, True),
    ("wrong type", Textual(), False),
    ("wrong type", Rotten(), False),
    ("wrong shape", Flat(), False),
    ("not finite", Undefined(), False),
    ("raises", Raises(), False),
]


def _expressions() -> Bad:
    q = ex.variable("a")
    return [
        *NOTHING,
        ("wrong type", "q**2", True),
        ("wrong type", sympy.Symbol("plain"), True),
        ("wrong type", sympy.Symbol("plain") * q, True),
        ("wrong shape", ex.point("post"), True),
        ("unknown name", ex.variable("nowhere"), True),
        ("unknown name", ex.distance("post", "nowhere"), True),
        ("unknown name", sympy.Function("f")(q), True),
        ("not finite", q * sympy.nan, True),
        ("not finite", q + sympy.zoo, True),
        ("not finite", q * sympy.oo, True),
        ("not finite", sympy.I * q, True),
        ("not finite", sympy.log(-1 - q**2), False),
        ("not finite", sympy.sqrt(-1 - q**2), False),
        ("not finite", sympy.asin(3 + q**2), False),
        ("not finite", 1 / (q - q * ex.parameter("one", 1.0)), False),
        ("not smooth", sympy.Max(q, 0), True),
        ("not smooth", sympy.Piecewise((q, q > 0), (0, True)), True),
        ("duplicate", ex.parameter("k", 1.0) * q + ex.parameter("k", 2.0), True),
        ("huge", 1e300 * q**3, False),
        ("huge", sympy.Integer(10) ** 400 * q, False),
        ("huge", sympy.exp(sympy.exp(10 + q**2)), False),
        ("tiny", 1e-300 * q, False),
        ("tiny", q / sympy.Integer(10) ** 400, False),
        ("zero", q - q, False),
    ]


EXPRESSION = _expressions()

FIELDS: dict[str, Bad] = {
    **dict.fromkeys(("frame", "frame1", "frame2", "plane", "line", "variable"), NAME),
    **dict.fromkeys(("stiffness", "coefficient", "speed", "smoothing"), POSITIVE),
    "length": but(POSITIVE, "1"),
    **dict.fromkeys(("exponent", "strength", "gain", "damping", "gain_by_place", "gain_by_rate"), NUMBER),
    **dict.fromkeys(("on", "of"), SCALAR),
    "inertia": POSITIVE,
    **dict.fromkeys(("rest", "offset"), but(NUMBER, "1")),
    **dict.fromkeys(("frames", "points", "variables", "measured"), NAMES),
    **dict.fromkeys(("axis", "normal", "direction", "vector", "wind"), VECTOR),
    **dict.fromkeys(("force_length", "force_velocity"), CURVE),
    **dict.fromkeys(("force", "torque"), TRIPLE),
    **dict.fromkeys(("planar", "tension_only"), FLAG),
    **dict.fromkeys(("x", "y", "z", "input"), FREE_NAME),
    "name": TITLE,
    "factors": FACTORS,
    "rotation": ROTATION,
    "axes": PATH_AXES,
    **dict.fromkeys(("function", "magnitude"), FUNCTION),
    "expression": EXPRESSION,
    "along": [*EXPRESSION, ("unknown name", "nowhere", True), ("empty", "", True)],
    "directions": [*NOTHING, ("wrong type", [("post", "w")], True), ("wrong shape", ["post"], True),
                   ("huge", [("post", (1e300, 1e300, 0.0))], False), ("tiny", [("post", (1e-300, 0.0, 0.0))], False),
                   ("zero", [("post", (0.0, 0.0, 0.0))], True)],
}  # fmt: skip
# Where a field means something else than in the others.
OWN: dict[tuple[str, str], Bad] = {
    ("CoulombFriction", "force"): POSITIVE,
    ("NonlinearSpring", "force"): CURVE,
    ("Armature", "variable"): FACTORS,
    ("Servo", "stiffness"): NUMBER,
    ("Servo", "offset"): NUMBER,
    ("PolynomialCoupling", "coefficients"): POLYNOMIAL,
    ("JointSpring", "variable"): FACTORS,
    ("JointForce", "variable"): FACTORS,
    ("NonlinearDamping", "coefficients"): COEFFICIENTS,
    ("Damping", "coefficients"): DAMPING,
    ("Damping", "default"): POSITIVE,
}


def hurt_element(d: Draw, calls: list[Call]) -> Damage:
    """Put a bad value into one field of one element."""
    # The first is the one that the description is about.
    call = d.pick([calls[0], calls[0], *calls])
    kind = call.function.__name__
    fields = [f.name for f in dataclasses.fields(call.function)]
    optional = {f.name for f in dataclasses.fields(call.function) if f.default is None}
    field = d.pick([*call.options, *fields])
    bad = OWN.get((kind, field)) or FIELDS[field]
    label, value, certain = choose(d, bad)
    if value is None and (field in optional or field == "name"):
        certain = False
    # A function may depend on no point, or twice on the same.
    if kind.startswith("Python") and (value == [] if isinstance(value, list) else False):
        certain = False
    if field == "points" and label == "duplicate":
        certain = False
    # Where the name stands for something here after all.
    if label == "unknown name" and field in ("x", "y", "z"):
        certain = False
    # A default says nothing where one coefficient holds for all.
    if field == "default" and not isinstance(call.options["coefficients"], dict):
        certain = value != 0.0
    call.options[field] = value
    return Damage(label, kind, f"{field}={value!r}", certain)


def misfit(d: Draw, calls: list[Call], frames: list[str], variables: list[str]) -> Damage | None:
    """Let an element act on any frames and variables, whether it can or not."""
    call = d.pick(calls)
    named = [
        field for field in call.options
        if FIELDS.get(field) is NAME or field in ("frames", "input", "x", "y", "z")
    ]  # fmt: skip
    if not named:
        return None
    for field in named:
        pool = variables if field in ("variable", "input", "x", "y", "z") else frames
        call.options[field] = d.some(pool, 1, 4) if field == "frames" else d.pick(pool)
    if "length" in call.options and d.chance(50):
        call.options["length"] = d.pick(variables)
    return Damage("misfit", call.function.__name__, repr(call), False)


def contradict(d: Draw, calls: list[Call], wood: Wood) -> Damage | None:
    """Add two rods of different lengths between the same frames; they must be refused, but only at the start."""
    try:
        first, second = Fit(d, wood).pair()
    except NoFit:
        return None
    calls += [Call(la.Distance, [first, second, length]) for length in (1.0, 2.0)]
    return Damage("contradiction", "Distance", f"two lengths of {first} to {second}", False)


AMOUNT: Bad = [
    *NOTHING,
    ("wrong type", ["a"], True),
    ("wrong type", {3: 1.0}, True),
    ("wrong type", {"a": "1"}, True),
    ("empty", {}, True),
    ("empty", "", True),
    ("not finite", NAN, True),
    ("not finite", {"a": INF}, True),
    ("zero", {"a": 0.0}, True),
    ("huge", {"a": 1e300}, False),
    ("huge", 1e300, False),
    ("tiny", {"a": 1e-300}, False),
    ("massless", {"a": 1.0, "never": 1.0}, True),
    ("contradiction", la.var("a") - la.var("a"), False),
]
INERTIA: Bad = [
    *but(NOTHING, None),
    ("wrong type", "unit", True),
    ("wrong type", 1.0, True),
    ("wrong shape", (1.0, 1.0), True),
    ("wrong shape", [[1.0, 2.0], [3.0]], True),
    ("not finite", (1.0, NAN, 1.0), True),
    ("negative", (1.0, 1.0, -1.0), True),
    ("contradiction", (1.0, 1.0, 9.0), True),
    ("contradiction", [[1.0, 0.5, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]], True),
    ("huge", (1e300, 1e300, 1e300), False),
    ("huge", (1e308, 1e308, 1e308, 1e308, -1e308, 1e308), False),
    ("tiny", (1e-300, 1e-300, 1e-300), False),
    ("zero", (0.0, 0.0, 0.0), False),
]
KINEMATIC: Bad = [
    ("wrong type", None, True),
    ("wrong type", 3, True),
    ("wrong type", "a", True),
    ("wrong type", [None], True),
    ("wrong type", [["a"]], True),
    ("unknown name", ["nowhere"], True),
    ("contradiction", True, False),
]
BODIES: Bad = [
    ("wrong type", 3, True),
    ("wrong type", None, True),
    ("wrong type", [None], True),
    ("wrong type", "ab", True),
    ("wrong type", Call(la.Body, [1.0]), True),
    ("negative", [Call(la.Body, [-1.0])], True),
    ("not finite", [Call(la.Body, [1.0], {"com": (NAN, 0.0, 0.0)})], True),
    ("wrong type", [Call(la.Body, ["1"])], True),
]
POINT: Bad = but(VECTOR, None)
MATRIX: Bad = [
    *but(NOTHING, None),
    ("wrong shape", np.eye(3), True),
    ("not finite", np.full((4, 4), NAN), True),
    ("zero", np.zeros((4, 4)), True),
    ("negative", -np.eye(4), True),
    ("huge", 1e300 * np.eye(4), True),
]
COMPOSITION_AXES: Bad = [
    *NOTHING,
    ("wrong type", 3, True),
    ("empty", "", True),
    ("unknown name", "xyw", True),
    ("duplicate", "xx", True),
    ("wrong shape", "xyzx", True),
]
NODE_FIELDS: dict[str, Bad] = {
    "mass": but(POSITIVE, None),
    "com": POINT,
    "inertia": INERTIA,
    "bodies": BODIES,
    "name": [*TITLE, ("duplicate", "post", True), ("duplicate", "world", False)],
    "kinematic": KINEMATIC,
    "offset": NUMBER,
    "axis": VECTOR,
    "point": POINT,
    "linear": POINT,
    "angular": POINT,
    "pitch": NUMBER,
    "axes": COMPOSITION_AXES,
    "translation": POINT,
    "rotation": ROTATION,
    "matrix": MATRIX,
}


def hurt_node(d: Draw, nodes: list[Node]) -> Damage:
    """Put a bad value into one option, or the amount, of one frame."""
    call = d.pick(nodes).call
    others = [node.call for node in nodes if node.call is not call]
    where = call.function.__name__
    options = [*call.options, "mass", "inertia", "name", "bodies"]
    if call.args and where not in ("universal", "ball", "free"):
        options += ["kinematic", "offset", "amount"]
    option = d.pick(options)
    if option == "amount":
        label, value, certain = choose(d, AMOUNT)
        call.args[0] = value
        if label == "massless" and (
            call.options.get("kinematic") or any("'a'" in repr(other.args) for other in others)
        ):
            certain = False  # where "a" moves something else as well, "a" and "never" are two freedoms
    else:
        label, value, certain = choose(d, NODE_FIELDS[option])
        if where == "prismatic" and option == "axis" and label == "wrong type" and isinstance(value, str):
            certain = True
        if label == "duplicate" and call.options.get(option) == value:
            certain = False
        call.options[option] = value
    return Damage(label, where, f"{option}={value!r}", certain)


ORDERS: Bad = [
    ("wrong type", 3, True),
    ("wrong type", "a", True),
    ("wrong type", [None], True),
    ("unknown name", ["nowhere"], True),
    ("duplicate", ["a", "a"], True),
    ("empty", [""], True),
]
LISTS: Bad = [
    ("wrong type", None, True),
    ("wrong type", 3, True),
    ("wrong type", "abc", True),
    ("wrong type", [None], True),
    ("wrong type", [la.Gravity], True),
    ("wrong type", Call(la.Gravity), True),
    ("duplicate", [Call(la.Gravity), Call(la.Gravity)], True),
    ("duplicate", [Call(la.Gravity, [], {"name": "g", "frames": ["post"]}), Call(la.Damping, [1.0], {"name": "g"})],
     True),
    ("wrong type", {"g": 1}, True),
]  # fmt: skip
DESCRIPTIONS: Bad = [
    ("wrong type", None, True),
    ("wrong type", 3, True),
    ("wrong type", "tx", True),
    ("wrong type", Call(la.tx, ["a"]), True),
    ("wrong type", {}, True),
    ("empty", [], False),
    ("massless", [Call(la.tx, ["a"])], True),
    ("massless", [Call(la.rz, ["a"], {"mass": 1.0})], True),
]
# What a list of frames may not hold, at a place that is drawn.
INTRUDERS: Bad = [
    ("wrong type", None, True),
    ("wrong type", "tx", True),
    ("wrong type", 3.0, True),
    ("wrong type", la.rz, True),
    ("wrong type", Call(la.Gravity), True),
    ("cyclic", "itself", True),
    ("cyclic", "an outer list", True),
    ("duplicate", "a frame twice", True),
    ("wrong shape", [[], []], True),
]
VALUES: Bad = [
    ("unknown name", {"nowhere.mass": 1.0}, True),
    ("wrong type", 3, True),
    ("wrong type", None, True),
    ("wrong type", "tip1.mass", True),
    ("wrong type", {3: 1.0}, True),
]
