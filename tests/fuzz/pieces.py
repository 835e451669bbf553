"""Elements, drawn as calls that fit a tree; one function for every type."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sympy

from fuzz.trees import Call, Draw, Spot, Wood
from leastaction import mechanics as la
from leastaction.mechanics import Curve, PythonFunction
from leastaction.mechanics import expressions as ex

INPUTS = ("u", "a", "w")
ROPES = ("rope", "winch", "g")
CURVES = (
    Curve([0.0, 1.0, 2.0], [0.5, 1.0, 3.0]),
    Curve(np.linspace(-2.0, 4.0, 9), 2.0 + np.sin(np.linspace(-2.0, 4.0, 9))),
)


class Bowl(PythonFunction):
    """f = z . z / 2 - 2."""

    def value(self, z: Any) -> Any:
        with np.errstate(over="ignore", invalid="ignore"):
            return 0.5 * (z @ z) - 2.0

    def gradient(self, z: Any) -> Any:
        return z

    def hessian(self, z: Any) -> Any:
        return np.eye(len(z))

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


class NoFit(Exception):
    """The tree has nothing that the element could act on."""


class Fit:
    """What of a tree suits an element."""

    def __init__(self, d: Draw, wood: Wood) -> None:
        self.d, self.wood = d, wood
        self.named = [spot for spot in wood.spots if spot.name]
        self.tips = [spot for spot in self.named if spot.apart]

    def _choose(self, choices: list[Any]) -> Any:
        if not choices:
            raise NoFit
        return self.d.pick(choices)

    def mover(self) -> Spot:
        """Draw a tip that dynamic variables move."""
        return self._choose([tip for tip in self.tips if any(names for _, names, _ in tip.joints)])

    def pair(self, turning: bool = False) -> tuple[str, str]:
        """Draw two tips that dynamic variables move (turn) relative to each other."""
        tips = self.tips
        return self._choose(
            [
                (one.name, other.name)
                for one in tips
                for other in tips
                if any(names and (turns or not turning) for _, names, turns in set(one.joints) ^ set(other.joints))
            ]
        )

    def path(self) -> list[str]:
        """Draw two to four tips, of which the first two move relative to each other."""
        names = list(self.pair())
        for _ in range(self.d.below(3)):
            names.append(self.d.pick([tip.name for tip in self.tips if tip.name != names[-1]]))
        return names

    def dynamic(self) -> str:
        return self._choose(self.wood.dynamic)

    def sum(self) -> dict[str, float]:
        names = [self.dynamic(), *self.d.some((*self.wood.dynamic, *self.wood.kinematic), 0, 2)]
        return {name: self.d.number(0.2, 2.0) * self.d.pick([-1, 1]) for name in names}

    def tackle(self) -> dict[tuple[str, ...], float]:
        """Draw a sum of paths."""
        return {tuple(self.path()): self.d.number(0.3, 1.5) * self.d.pick([-1, 1]) for _ in range(1 + self.d.below(2))}

    def scalar(self) -> Any:
        return self.d.pick([self.dynamic, self.sum, self.path, self.tackle])()

    def length(self, *frames: str) -> Any:
        """Draw a length, or the name of a new kinematic variable, or of one that moves none of the frames."""
        if self.d.chance(75):
            return self.d.number(0.5, 2.5)
        return self.prescribed(*frames)

    def rest(self) -> Any:
        """Draw a number, or the name of a new kinematic variable."""
        return self.d.number(-0.5, 0.5) if self.d.chance(75) else "wish"

    def prescribed(self, *frames: str) -> str:
        moving = {n for spot in self.named if spot.name in frames for n in spot.prescribed}
        free = [name for name in self.wood.kinematic if name not in moving]
        return self.d.pick([*ROPES, *free])

    def direction(self) -> Any:
        return self.d.pick(["x", "y", "z", (0.3, -0.5, 0.8), (0.0, 0.0, 2.0)])

    def triple(self) -> Any:
        d = self.d
        return tuple(d.pick(INPUTS) if d.chance(40) else d.number(-2.0, 2.0) for _ in range(3))


def gravity(d: Draw, f: Fit) -> dict[str, Any]:
    heavy = [spot.name for spot in f.named if spot.heavy]
    if heavy and d.chance(60):
        return {"vector": d.three(-9.0, 9.0), "frames": d.some(heavy, 1, 3)}
    return {"vector": d.three(-9.0, 9.0)} if d.chance(50) else {}


def _ends(f: Fit, turning: bool = False) -> dict[str, Any]:
    return dict(zip(("frame1", "frame2"), f.pair(turning), strict=True))


def wrench(d: Draw, f: Fit) -> dict[str, Any]:
    which = d.below(3)
    parts = {"force": f.triple()} if which != 1 else {}
    return {"frame": f.mover().name, **parts, **({"torque": f.triple()} if which else {})}


def prescribed_path(d: Draw, f: Fit) -> dict[str, Any]:
    frame = f.mover().name
    return {"frame": frame, **{axis: f.prescribed(frame) for axis in d.some("xyz", 1, 3)}}


def tendon(d: Draw, f: Fit) -> dict[str, Any]:
    curves = {field: d.pick(CURVES) for field in d.some(["force_length", "force_velocity"], 0, 2)}
    gain = {"gain": d.number(0.2, 2.0)} if d.chance(50) else {}
    return {"frames": f.path(), "input": d.pick(INPUTS), **gain, **curves}


def drag(d: Draw, f: Fit) -> dict[str, Any]:
    more = {"exponent": d.number(1.0, 2.5), "wind": d.three(), "smoothing": d.number(0.001, 0.1)}
    chosen = {name: more[name] for name in d.some(list(more), 0, 3)}
    return {"frame": f.mover().name, "coefficient": d.number(0.1, 2.0), **chosen}


def damping(d: Draw, f: Fit) -> dict[str, Any]:
    if d.chance(30):
        return {"coefficients": d.number(0.0, 1.0)}
    named = {name: d.number(0.0, 1.0) for name in d.some(f.wood.dynamic, 1, 3)}
    return {"coefficients": named, **({"default": d.number(0.0, 0.5)} if d.chance(40) else {})}


def scalar(d: Draw, f: Fit) -> Any:
    """Draw an expression that some dynamic variable changes, smooth everywhere."""
    one, other = f.pair()
    q = ex.variable(f.dynamic())
    return d.pick(
        [
            lambda: ex.parameter("k", d.number(0.5, 2.0)) * sympy.cos(q),
            lambda: 0.1 * q**3 - 0.2 * q + sympy.tanh(q),
            lambda: ex.distance(one, other) ** 2 - 1,
            lambda: ex.direction(one, "x").dot(ex.direction(other, (0.0, 0.6, 0.8))) + 0.3 * q,
            lambda: sympy.exp(-(ex.point(one)[2] ** 2)) + ex.parameter("height", 0.2) * q,
            lambda: sympy.atan2(ex.point(one)[0], 4 + ex.point(one)[1] ** 2) - 0.1 * q,
            lambda: sympy.sqrt(1 + q**2) - 1.1,
        ]
    )()


def force(d: Draw, f: Fit) -> dict[str, Any]:
    along = d.pick([f.dynamic, lambda: scalar(d, f), lambda: ex.distance(*f.pair())])()
    place = ex.variable(along) if isinstance(along, str) else along
    size = d.pick(
        [
            lambda: -ex.parameter("c", d.number(0.1, 1.0)) * ex.rate(place),
            lambda: ex.input_(d.pick(INPUTS)) * sympy.sin(place),
            lambda: d.number(-1.0, 1.0),
            lambda: -place * (1 + ex.speed(f.dynamic()) ** 2) / 10,
        ]
    )()
    return {"expression": size, "along": along}


def python(d: Draw, f: Fit) -> dict[str, Any]:
    one, other = f.pair()
    which = 1 + d.below(7)
    parts: dict[str, Any] = {"points": [one, other]} if which & 1 else {}
    if which & 2:
        parts["variables"] = d.some(f.wood.dynamic, 1, 2)
    if which & 4:
        parts["directions"] = [(one, "x"), (other, (0.0, 1.0, 1.0))]
        if which == 4:
            parts["variables"] = [f.dynamic()]
    return {"function": Bowl(), **parts}


FEEDBACK = ("offset", "stiffness", "damping", "gain_by_place", "gain_by_rate")

ELEMENTS: dict[str, Callable[[Draw, Fit], dict[str, Any]]] = {
    "Gravity": gravity,
    "InverseSquareGravity": lambda d, f: {**_ends(f), "strength": d.number(0.1, 2.0)},
    "LinearSpring": lambda d, f: {
        **(e := _ends(f)), "stiffness": d.number(0.5, 9.0),
        **({"length": f.length(*e.values())} if d.chance(60) else {}),
    },
    "JointSpring": lambda d, f: {
        "variable": f.sum() if d.chance(50) else f.dynamic(), "stiffness": d.number(0.5, 9.0), "rest": f.rest()
    },
    "TorsionalSpring": lambda d, f: {
        **_ends(f, True), "stiffness": d.number(0.5, 9.0), "axis": f.direction(), "rest": f.rest()
    },
    "NonlinearSpring": lambda d, f: {
        "on": f.scalar(), "force": d.pick(CURVES)
    },
    "ElasticString": lambda d, f: {
        "frames": (p := f.path()), "stiffness": d.number(0.5, 9.0), "length": f.length(*p),
        **({"tension_only": False} if d.chance(30) else {"smoothing": d.number(0.01, 0.1)}),
    },
    "Distance": lambda d, f: (lambda e: {**e, "length": f.length(*e.values())})(_ends(f)),
    "PointToPoint": lambda d, f: {**_ends(f), "axes": d.pick(["x", "yz", "xyz", "z"])},
    "PathLength": lambda d, f: (lambda p: {"frames": p, "length": f.length(*p)})(f.path()),
    "PointOnPlane": lambda d, f: {
        **dict(zip(("plane", "frame"), f.pair(), strict=True)), "normal": f.direction()
    },
    "PointOnLine": lambda d, f: {
        **dict(zip(("line", "frame"), f.pair(), strict=True)), "direction": f.direction()
    },
    "HingeLoop": lambda d, f: {**_ends(f), "axis": f.direction(), "planar": d.chance(60)},
    "FixedOrientation": lambda d, f: {
        **_ends(f, True), **({"rotation": d.rotation()} if d.chance(50) else {})
    },
    "Coupling": lambda d, f: {"factors": f.sum(), "offset": f.rest()},
    "PrescribedPath": prescribed_path,
    "Damping": damping,
    "JointForce": lambda d, f: {"variable": f.sum() if d.chance(30) else f.dynamic(), "input": d.pick(INPUTS)},
    "Motor": lambda d, f: {**_ends(f, True), "input": d.pick(INPUTS), "axis": f.direction()},
    "LinearMotor": lambda d, f: {**_ends(f), "input": d.pick(INPUTS), "gain": d.number(0.5, 2.0)},
    "NonlinearDamping": lambda d, f: {
        "on": f.scalar(), "coefficients": [d.number(0.1, 1.0) for _ in range(1 + d.below(3))]
    },
    "LinearDamper": lambda d, f: {**_ends(f), "coefficient": d.number(0.1, 2.0)},
    "CoulombFriction": lambda d, f: {
        "on": f.scalar(), "force": d.number(0.1, 2.0), "speed": d.number(0.05, 0.5)
    },
    "BodyWrench": wrench,
    "HybridWrench": wrench,
    "SpatialWrench": wrench,
    "TendonForce": tendon,
    "Servo": lambda d, f: {
        "on": f.scalar(), "input": d.pick(INPUTS), "gain": d.number(0.5, 2.0),
        **{name: d.number(0.1, 1.0) for name in d.some(FEEDBACK, 0, 3)},
    },
    "Armature": lambda d, f: {"variable": f.sum() if d.chance(50) else f.dynamic(), "inertia": d.number(0.1, 2.0)},
    "PolynomialCoupling": lambda d, f: {
        "on": f.scalar(), "of": f.scalar(), "coefficients": [d.number(-0.5, 0.5) for _ in range(2 + d.below(3))]
    },
    "Drag": drag,
    "ExpressionPotential": lambda d, f: {"expression": scalar(d, f)},
    "ExpressionConstraint": lambda d, f: {"expression": scalar(d, f) - d.number(-0.2, 0.2)},
    "ExpressionForce": force,
    "PythonPotential": python,
    "PythonConstraint": python,
    "PythonForce": lambda d, f: {**python(d, f), "input": d.pick(INPUTS), "gain": d.number(0.1, 1.0)},
}  # fmt: skip


def draw_elements(d: Draw, wood: Wood, kind: str) -> list[Call]:
    """Draw elements that fit the tree, the first of a given type, and at most one gravity for all."""
    fit, calls, names = Fit(d, wood), [], ["g", "a", "spring", "tip1", "a.b", "x y"]
    constraints = 0
    kinds = list(ELEMENTS)
    for wanted in [kind, *(d.pick(kinds) for _ in range(d.pick([1, 2, 0, 1, 2, 3])))]:
        # More constraints than one are soon more than the variables.
        if issubclass(getattr(la, wanted), la.Constraint):
            constraints += 1
            if constraints > 1 and not d.chance(20):
                continue
        try:
            options = ELEMENTS[wanted](d, fit)
        except NoFit:
            continue
        for_all = [c for c in calls if c.function is la.Gravity and "frames" not in c.options]
        if wanted == "Gravity" and "frames" not in options and for_all:
            continue
        if names and d.chance(35):
            options["name"] = names.pop(d.below(len(names)))
        calls.append(Call(getattr(la, wanted), [], options))
    return calls
