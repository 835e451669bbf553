"""Every element type on a random tree, with random numbers, at a configuration that meets its equations.

A case is a function that gets a `Plant` (a tree that grows frames where the element wants them) and returns the
elements. `CASES` lists them; `types` says which element types a case is the proof of.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
import sympy

from leastaction import mechanics as la
from leastaction.mechanics import Body, Branch, Element, Mechanism, PythonFunction, world
from leastaction.mechanics import expressions as ex
from oracles.mechanism_oracle import Oracle

DYNAMIC, KINEMATIC = ("a", "b", "c", "d", "e", "f"), ("r", "s")
ARM = 4  # links of each arm


@dataclass(frozen=True)
class Link:
    """A joint of the plant: where it hangs, which chained call makes it, by how much it moves, what it carries."""

    parent: str
    base: np.ndarray
    method: str
    options: dict[str, object]
    amount: object
    kinematic: bool
    bodies: tuple[dict[str, object], ...]


class Plant:
    """A random branched tree of mixed joints, and a configuration ``values`` of it.

    Two arms of four joints each: the first on the world, the second on the world or on the first (``apart``: on the
    world, so that all dynamic joints lie between the two ends). One joint of them is prescribed, one is driven by
    two variables that also move joints of their own, one carries no mass and one two bodies. A ninth joint,
    prescribed and without a mass, is the moving end of a string. ``left`` and ``right`` are frames on the last links
    of the arms, ``middle`` is one on the way, ``post`` is on the ninth joint; all off the joints' axes.
    """

    def __init__(self, seed: int, name: str, *, apart: bool = False) -> None:
        self.rng = rng = np.random.default_rng([seed, *name.encode()])
        self.frames: dict[str, tuple[str, np.ndarray]] = {}
        self.links: dict[str, Link] = {}
        self.values = {n: float(rng.uniform(-1.0, 1.0)) for n in (*DYNAMIC, *KINEMATIC)}
        roots = ["world"] if apart else ["world", "L0", "L1"]
        parents = ["world", "L0", "L1", "L2", str(rng.choice(roots)), "L4", "L5", "L6"]
        prescribed, driven, empty, twice = rng.permutation(6)[:4]
        order = iter(rng.permutation(DYNAMIC))
        # The last links have a variable of their own, the inner ones may not.
        inner = [0, 1, 2, 4, 5, 6]
        kinds = rng.permutation(9)
        for j, parent in enumerate(parents):
            at = inner.index(j) if j in inner else -1
            if at == driven:
                first, second = rng.choice(DYNAMIC, 2, replace=False)
                amount: object = {str(first): 0.6, str(second): -0.8}
            else:
                amount = "r" if at == prescribed else str(next(order))
            bodies = [self._body()] * (1 if at != empty else 0) + [self._body()] * int(at == twice)
            self._add(j, parent, int(kinds[j]), amount, at == prescribed, tuple(bodies))
        self._add(8, "world", int(kinds[8]), "s", True, ())
        self.left, self.right = self.frame("L3"), self.frame("L7")
        self.middle, self.post = self.frame("L1"), self.frame("L8")

    def _add(self, j: int, parent: str, kind: int, amount: object, kinematic: bool, bodies: tuple) -> None:
        methods = ["rx", "ry", "rz", "rx", "tz", "revolute", "prismatic", "screw", "twist"]
        method, rng = methods[kind], self.rng
        three = [rng.uniform(-1.0, 1.0, 3) for _ in range(2)]
        options: dict[str, object] = {
            "revolute": {"axis": three[0], "point": three[1]},
            "prismatic": {"axis": three[0]},
            "screw": {"axis": three[0], "point": three[1], "pitch": 0.2},
            "twist": {"linear": three[0], "angular": three[1]},
        }.get(method, {})
        if isinstance(amount, dict):
            options = {**options, "offset": 0.2}
        base = random_pose(rng)
        self.links[f"L{j}"] = Link(parent, base, method, options, amount, kinematic, bodies)

    def _body(self) -> dict[str, object]:
        r = self.rng.uniform(-0.3, 0.3, (6, 3))
        r -= r.mean(axis=0)
        return {
            "mass": float(self.rng.uniform(0.5, 2.0)),
            "com": self.rng.uniform(-0.3, 0.3, 3),
            "inertia": np.sum(r**2) * np.eye(3) - r.T @ r,
        }

    # What cases ask for

    def number(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def three(self) -> tuple[float, ...]:
        return tuple(float(c) for c in self.rng.uniform(-1.0, 1.0, 3))

    def frame(self, link: str, pose: np.ndarray | None = None) -> str:
        """Add a constant frame to a link, anywhere or where its pose in the world is the given one; its name."""
        local = random_pose(self.rng) if pose is None else np.linalg.inv(self.pose(link)) @ pose
        name = f"F{len(self.frames)}"
        self.frames[name] = (link, local)
        return name

    def pose(self, frame: str) -> np.ndarray:
        mechanism = self.mechanism([])
        q = jnp.asarray(self.configuration(mechanism))
        return np.array(Oracle(mechanism).place(q).pose(frame))

    def origin(self, frame: str) -> np.ndarray:
        return self.pose(frame)[:3, 3]

    def length(self, *frames: str) -> float:
        points = [self.origin(frame) for frame in frames]
        return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))

    def mechanism(self, elements: Sequence[Element]) -> Mechanism:
        places: dict[str, Branch] = {"world": world()}
        for name, link in self.links.items():
            place = places[link.parent].pose(link.base)
            places[name] = getattr(place, link.method)(
                link.amount,
                kinematic=link.kinematic,
                name=name,
                bodies=[Body(**body) for body in link.bodies],
                **link.options,
            )
        for name, (link, local) in self.frames.items():
            places[name] = places[link].pose(local, name=name)
        return Mechanism(places["world"], elements)

    def configuration(self, mechanism: Mechanism) -> np.ndarray:
        return mechanism.configuration({n: self.values[n] for n in mechanism.variables})


def random_pose(rng: np.random.Generator) -> np.ndarray:
    out = np.eye(4)
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    out[:3, :3] = q * np.sign(np.linalg.det(q))
    out[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    return out


@dataclass(frozen=True)
class Case:
    """``types``: names of the element types that it proves. ``flat``: orders that vanish and are held to zero."""

    name: str
    family: str
    types: tuple[str, ...]
    build: Callable[[Plant], list[Element]]
    apart: bool
    flat: frozenset[int]


CASES: dict[str, Case] = {}


def case(
    family: str, *types: str, apart: bool = False, flat: Sequence[int] = ()
) -> Callable[[Callable[[Plant], list[Element]]], Callable[[Plant], list[Element]]]:
    def register(build: Callable[[Plant], list[Element]]) -> Callable[[Plant], list[Element]]:
        name = build.__name__
        CASES[name] = Case(name, family, types, build, apart, frozenset(flat))
        return build

    return register


@dataclass(frozen=True)
class Problem:
    """A mechanism and a configuration on its constraints."""

    mechanism: Mechanism
    q: np.ndarray


@cache
def problem(name: str, seed: int) -> Problem:
    """Return the mechanism of a case. Every case grows trees of its own, so the cases see many trees."""
    plant = Plant(seed, name, apart=CASES[name].apart)
    elements = CASES[name].build(plant)
    mechanism = plant.mechanism(elements)
    return Problem(mechanism, plant.configuration(mechanism))


# A mechanism holds the Python functions of its elements, and those this module with its cache: the interpreter's end
# would find the circle closed, and the core report its objects as leaked.
atexit.register(problem.cache_clear)


# Potentials


@case("potential", "Gravity")
def gravity(p: Plant) -> list[Element]:
    return [la.Gravity(p.three())]


@case("potential", "Gravity")
def gravity_of_some(p: Plant) -> list[Element]:
    heavy = [name for name, link in p.links.items() if link.bodies]
    return [la.Gravity(p.three(), frames=heavy[1:4])]


@case("potential", "InverseSquareGravity")
def inverse_square_gravity(p: Plant) -> list[Element]:
    return [la.InverseSquareGravity(p.left, p.right, strength=p.number(0.5, 2.0))]


@case("potential", "LinearSpring")
def linear_spring(p: Plant) -> list[Element]:
    stiffness, length = p.number(5.0, 20.0), p.number(0.3, 0.8)
    return [la.LinearSpring(p.left, p.right, stiffness=stiffness, length=length)]


@case("potential", "LinearSpring")
def linear_spring_of_no_length(p: Plant) -> list[Element]:
    return [la.LinearSpring(p.left, p.post, stiffness=p.number(5.0, 20.0))]


@case("potential", "LinearSpring")
def linear_spring_of_variable_length(p: Plant) -> list[Element]:
    """By variables that are prescribed: of the spring alone, of a frame too; by one that is free."""
    p.values["slack"] = 0.6 * p.length(p.left, p.right)
    return [
        la.LinearSpring(p.left, p.right, stiffness=p.number(5.0, 20.0), length="slack"),
        la.LinearSpring(p.left, "world", stiffness=p.number(5.0, 20.0), length="s"),
        la.LinearSpring(p.post, "world", stiffness=p.number(5.0, 20.0), length="b"),
    ]


@case("potential", "JointSpring", flat=(3,))
def joint_spring_of_variable_rest(p: Plant) -> list[Element]:
    p.values["wish"] = 0.3
    return [
        la.JointSpring("b", stiffness=p.number(5.0, 20.0), rest="c"),
        la.JointSpring({"a": 1.5, "r": -0.7}, stiffness=p.number(5.0, 20.0), rest="wish"),
    ]


@case("potential", "TorsionalSpring")
def torsional_spring_of_variable_rest(p: Plant) -> list[Element]:
    p.values["wish"] = -0.4
    return [
        la.TorsionalSpring(p.left, "world", stiffness=p.number(1.0, 3.0), rest="s"),
        la.TorsionalSpring(p.right, p.post, stiffness=p.number(1.0, 3.0), axis="x", rest="wish"),
    ]


@case("potential", "ElasticString")
def elastic_string_of_variable_length(p: Plant) -> list[Element]:
    path, rope = [p.left, p.post, p.middle], [p.left, "world", p.right]
    p.values["reel"] = 0.9 * p.length(*path)
    p.values["wound"] = 0.7 * p.length(*rope)
    return [
        la.ElasticString(path, stiffness=p.number(5.0, 20.0), length="reel", smoothing=0.1),
        la.ElasticString(rope, stiffness=9.0, length="wound", tension_only=False),
    ]


@case("potential", "JointSpring", flat=(3,))
def joint_spring(p: Plant) -> list[Element]:
    return [
        la.JointSpring("b", stiffness=p.number(5.0, 20.0), rest=p.number(-1.0, 1.0)),
        la.JointSpring({"a": 1.5, "r": -0.7}, stiffness=p.number(5.0, 20.0), rest=0.3),
    ]


@case("potential", "TorsionalSpring")
def torsional_spring(p: Plant) -> list[Element]:
    return [
        la.TorsionalSpring(p.left, p.middle, stiffness=p.number(1.0, 3.0), rest=p.number(-1, 1)),
        la.TorsionalSpring(p.right, "world", stiffness=p.number(1.0, 3.0), axis="x"),
    ]


def curve(p: Plant, low: float, high: float) -> la.Curve:
    x = np.linspace(low, high, 9)
    return la.Curve(x, 2.0 + np.sin(9.0 * x / (high - low) + p.number(0.0, 6.0)))


@case("potential", "NonlinearSpring")
def nonlinear_spring(p: Plant) -> list[Element]:
    return [
        la.NonlinearSpring("c", curve(p, -3.0, 3.0)),
        la.NonlinearSpring({"d": 1.2, "s": 0.8}, curve(p, -3.0, 3.0)),
        la.NonlinearSpring([p.left, p.post, p.right], curve(p, 0.0, 8.0)),
    ]


@case("potential", "ElasticString")
def elastic_string(p: Plant) -> list[Element]:
    path = [p.left, p.post, p.middle]
    length = 0.4 * p.length(*path)
    return [la.ElasticString(path, stiffness=p.number(5.0, 20.0), length=length)]


@case("potential", "ElasticString")
def elastic_string_about_slack(p: Plant) -> list[Element]:
    """At the kink that the smoothing rounds."""
    path = [p.left, p.right]
    length = p.length(*path) + 0.03
    return [la.ElasticString(path, stiffness=p.number(5.0, 20.0), length=length, smoothing=0.1)]


@case("potential", "ElasticString")
def elastic_rod(p: Plant) -> list[Element]:
    path = [p.left, p.middle, p.right]
    length = 1.1 * p.length(*path)
    return [la.ElasticString(path, stiffness=p.number(5.0, 20.0), length=length, tension_only=False)]


@case("potential", "ElasticString", "NonlinearSpring")
def elastic_tackle(p: Plant) -> list[Element]:
    """Over two pieces that count differently, as those of a string that goes twice through a loose pulley."""
    pieces = {(p.left, p.post, p.middle): 1.0, (p.middle, p.right): 0.5}
    length = 0.6 * p.length(p.left, p.post, p.middle)
    return [
        la.ElasticString(pieces, stiffness=p.number(5.0, 20.0), length=length),
        la.NonlinearSpring({(p.left, p.right): -2.0}, curve(p, -16.0, 0.0)),
    ]


# Rotors


@case("rotor", "Armature", flat=(1,))
def armature(p: Plant) -> list[Element]:
    """On a variable, on sums that couple branches, and on a prescribed variable."""
    return [
        la.Armature("b", p.number(0.5, 2.0)),
        la.Armature({"a": 3.0, "e": -2.0, "r": 0.7}, p.number(0.2, 0.5)),
        la.Armature({"c": -6.0}, p.number(0.01, 0.02)),
        la.Armature({"f": 1.5, "s": 1.0}, p.number(0.2, 0.5)),
    ]


# Constraints


@case("constraint", "Distance")
def distance(p: Plant) -> list[Element]:
    p.values["rope"] = p.length(p.right, p.post)
    length = p.length(p.left, p.middle)
    return [la.Distance(p.left, p.middle, length), la.Distance(p.right, p.post, "rope")]


@case("constraint", "PointToPoint", apart=True)
def point_to_point(p: Plant) -> list[Element]:
    hand = p.frame("L7", _moved(random_pose(p.rng), p.origin(p.left)))
    return [la.PointToPoint(p.left, hand)]


@case("constraint", "PointToPoint")
def point_to_point_in_a_plane(p: Plant) -> list[Element]:
    hand = p.frame("L7", _moved(random_pose(p.rng), p.origin(p.left) + 0.4 * np.eye(3)[0]))
    return [la.PointToPoint(p.left, hand, "zy")]


@case("constraint", "PathLength")
def path_length(p: Plant) -> list[Element]:
    tendon, rope = [p.left, p.post, p.middle, p.right], [p.right, p.middle, "world"]
    p.values["rope"] = p.length(*rope)
    return [la.PathLength(tendon, p.length(*tendon)), la.PathLength(rope, "rope")]


@case("constraint", "PointOnPlane", apart=True)
def point_on_plane(p: Plant) -> list[Element]:
    normal = p.three()
    tilted, level = random_pose(p.rng), random_pose(p.rng)
    across = np.cross(tilted[:3, :3] @ normal, p.three())
    board = p.frame("L2", _moved(tilted, p.origin(p.right) + across))
    floor = p.frame("world", _moved(level, p.origin(p.left) + level[:3, :3] @ [0.3, -0.4, 0.0]))
    return [la.PointOnPlane(board, p.right, normal=normal), la.PointOnPlane(floor, p.left)]


@case("constraint", "PointOnLine", apart=True)
def point_on_line(p: Plant) -> list[Element]:
    rail, wire, direction = random_pose(p.rng), random_pose(p.rng), p.three()
    slot = p.frame("L2", _moved(rail, p.origin(p.right) + rail[:3, :3] @ [0.3, 0.0, 0.0]))
    fixed = p.frame("world", _moved(wire, p.origin(p.left) + wire[:3, :3] @ direction))
    return [la.PointOnLine(slot, p.right), la.PointOnLine(fixed, p.left, direction=direction)]


@case("constraint", "HingeLoop", apart=True)
def hinge_loop(p: Plant) -> list[Element]:
    turned = _about(p.number(-1.0, 1.0), 2)
    return [la.HingeLoop(p.left, p.frame("L7", p.pose(p.left) @ turned))]


@case("constraint", "HingeLoop", apart=True)
def hinge_loop_about_y(p: Plant) -> list[Element]:
    turned = _about(p.number(-1.0, 1.0), 1)
    return [la.HingeLoop(p.left, p.frame("L7", p.pose(p.left) @ turned), axis="y")]


@case("constraint", "HingeLoop", apart=True)
def hinge_loop_in_a_plane(p: Plant) -> list[Element]:
    """Only its equations within the plane: nothing forces the tree to be planar."""
    hand = p.frame("L7", p.pose(p.left) @ _about(p.number(-1.0, 1.0), 2))
    return [la.HingeLoop(p.left, hand, planar=True)]


@case("constraint", "FixedOrientation", apart=True)
def fixed_orientation(p: Plant) -> list[Element]:
    hand = p.pose(p.left)
    hand[:3, 3] += p.three()
    return [la.FixedOrientation(p.left, p.frame("L7", hand))]


@case("constraint", "Coupling", flat=(2, 3))
def coupling(p: Plant) -> list[Element]:
    factors = {"a": 1.5, "c": -2.0, "r": 0.5}
    return [la.Coupling(factors, offset=sum(f * p.values[n] for n, f in factors.items()))]


@case("constraint", "Coupling", flat=(2, 3))
def coupling_to_a_variable(p: Plant) -> list[Element]:
    factors = {"a": 1.5, "c": -2.0, "r": 0.5}
    p.values["total"] = sum(f * p.values[n] for n, f in factors.items())
    return [la.Coupling(factors, offset="total")]


@case("constraint", "PolynomialCoupling")
def polynomial_coupling(p: Plant) -> list[Element]:
    c = (0.3, -1.2, 0.4, 0.2, -0.1)

    def rest(s: float, x: float) -> float:
        return s - sum(a * x**k for k, a in enumerate(c[1:], 1))

    tendon, spring = {(p.left, p.right): 0.7, (p.middle, p.post): -0.2}, {"c": 1.5, "e": -0.5, "s": 0.4}
    length = 0.7 * p.length(p.left, p.right) - 0.2 * p.length(p.middle, p.post)
    turned = sum(f * p.values[n] for n, f in spring.items())
    first = rest(p.values["a"], p.values["b"])
    return [
        la.PolynomialCoupling("a", "b", (first, *c[1:])),
        la.PolynomialCoupling(tendon, spring, (rest(length, turned), *c[1:])),
    ]


@case("constraint", "PathLength")
def tackle(p: Plant) -> list[Element]:
    pieces = {(p.left, p.post, p.middle): 1.0, (p.right, "world"): 0.5, (p.left, p.middle): 2.0}
    length = sum(f * p.length(*path) for path, f in pieces.items())
    return [la.PathLength(pieces, length)]


@case("constraint", "PrescribedPath", apart=True)
def prescribed_path(p: Plant) -> list[Element]:
    p.values["there_x"], _, p.values["there_z"] = (float(c) for c in p.origin(p.right))
    p.values["up"] = float(p.origin(p.left)[1])
    return [
        la.PrescribedPath(p.right, x="there_x", z="there_z"),
        la.PrescribedPath(p.left, y="up"),
    ]


# Forces


@case("force", "Damping", flat=(2,))
def damping(p: Plant) -> list[Element]:
    return [la.Damping({"a": p.number(0.1, 1.0), "d": p.number(0.1, 1.0)}, default=0.2)]


@case("force", "JointForce", flat=(2,))
def joint_force(p: Plant) -> list[Element]:
    return [la.JointForce("b", input="m"), la.JointForce("e", input="n"), la.JointForce("f", "m")]


@case("force", "JointForce", flat=(2,))
def joint_force_on_a_sum(p: Plant) -> list[Element]:
    return [
        la.JointForce({"a": 0.5, "b": 0.5}, input="m"),
        la.JointForce({"c": 1.3, "r": -0.4, "b": 0.2}, input="n"),
        la.JointForce("b", input="m"),
    ]


@case("force", "Motor")
def motor(p: Plant) -> list[Element]:
    return [
        la.Motor(p.left, p.right, input="m", gain=p.number(0.5, 2.0)),
        la.Motor("world", p.right, input="n", axis=p.three()),
    ]


@case("force", "LinearMotor")
def linear_motor(p: Plant) -> list[Element]:
    return [
        la.LinearMotor(p.left, p.right, input="m", gain=p.number(0.5, 2.0)),
        la.LinearMotor(p.post, p.middle, input="n"),
    ]


@case("force", "NonlinearDamping")
def nonlinear_damping(p: Plant) -> list[Element]:
    coefficients = (p.number(0.1, 1.0), p.number(0.1, 1.0), p.number(0.1, 1.0))
    return [la.NonlinearDamping("c", coefficients), la.NonlinearDamping("e", coefficients[:2])]


@case("force", "NonlinearDamping", "CoulombFriction")
def damping_of_tendons(p: Plant) -> list[Element]:
    return [
        la.NonlinearDamping({"a": 1.2, "d": -0.7}, (p.number(0.1, 1.0),)),
        la.NonlinearDamping({(p.left, p.post): 1.0, (p.middle, p.right): 0.5}, (0.2, p.number(0.1, 1.0))),
        la.CoulombFriction({"b": 1.2, "e": -0.7, "r": 0.2}, force=p.number(0.5, 2.0), speed=p.number(0.3, 0.6)),
        la.CoulombFriction([p.left, p.right], force=p.number(0.5, 2.0), speed=p.number(0.3, 0.6)),
    ]


@case("force", "Servo")
def servo(p: Plant) -> list[Element]:
    """Of place, of speed, and with everything, on all kinds of scalars."""
    k = p.number(2.0, 5.0)
    tendon = {(p.left, p.post, p.middle): 1.0, (p.middle, p.right): -0.5}
    return [
        la.Servo("a", "m", gain=k, stiffness=k, damping=0.3),
        la.Servo({"b": 2.0, "d": -0.5}, "n", gain=k, damping=k),
        la.Servo(tendon, "n", 1.2, offset=-0.4, stiffness=0.8, damping=0.6, gain_by_place=0.3, gain_by_rate=-0.5),
        la.Servo([p.left, p.right], "m", gain=0.0, gain_by_rate=-0.7),
    ]


@case("force", "LinearDamper")
def linear_damper(p: Plant) -> list[Element]:
    return [la.LinearDamper(p.left, p.post, coefficient=p.number(0.5, 2.0))]


@case("force", "CoulombFriction")
def coulomb_friction(p: Plant) -> list[Element]:
    return [la.CoulombFriction("d", force=p.number(0.5, 2.0), speed=p.number(0.2, 0.5))]


@case("force", "BodyWrench")
def body_wrench(p: Plant) -> list[Element]:
    return [la.BodyWrench(p.left, force=("m", 0.7, -0.4), torque=(0.3, "n", "m"))]


@case("force", "HybridWrench")
def hybrid_wrench(p: Plant) -> list[Element]:
    return [la.HybridWrench(p.right, force=("m", 0.7, -0.4), torque=(0.3, "n", 0.5))]


@case("force", "SpatialWrench")
def spatial_wrench(p: Plant) -> list[Element]:
    return [la.SpatialWrench(p.left, force=(0.2, "m", "n"), torque=("n", 0.8, 0.5))]


@case("force", "BodyWrench", "HybridWrench", "SpatialWrench")
def propeller(p: Plant) -> list[Element]:
    """An input with a factor for each component that it has."""
    return [
        la.BodyWrench(p.left, force=(0.0, 0.3, {"m": 1.5}), torque=({"n": 0.4}, "n", {"m": -0.02})),
        la.HybridWrench(p.right, force=({"m": -0.7}, "n", 0.1)),
        la.SpatialWrench(p.middle, torque=({"m": 0.7}, 0.0, {"n": -1.1})),
    ]


@case("force", "BodyWrench", "HybridWrench")
def torque_or_force_alone(p: Plant) -> list[Element]:
    return [
        la.BodyWrench(p.right, torque=(0.3, "n", 0.5)),
        la.HybridWrench(p.left, force=p.three()),
    ]


@case("force", "TendonForce")
def tendon_force(p: Plant) -> list[Element]:
    return [la.TendonForce([p.left, p.post, p.right], input="m", gain=p.number(0.5, 2.0))]


@case("force", "TendonForce")
def muscle(p: Plant) -> list[Element]:
    return [
        la.TendonForce(
            [p.left, p.middle, p.right],
            input="m",
            gain=p.number(0.5, 2.0),
            force_length=curve(p, 0.0, 8.0),
            force_velocity=curve(p, -6.0, 6.0),
        )
    ]


@case("force", "TendonForce")
def tackle_force(p: Plant) -> list[Element]:
    pieces = {(p.left, p.post, p.middle): 1.0, (p.middle, p.right): 0.5}
    return [
        la.TendonForce(
            pieces,
            input="m",
            gain=p.number(0.5, 2.0),
            force_length=curve(p, 0.0, 8.0),
            force_velocity=curve(p, -6.0, 6.0),
        )
    ]


@case("force", "Drag")
def drag(p: Plant) -> list[Element]:
    return [
        la.Drag(p.left, coefficient=p.number(0.2, 1.0), wind=p.three()),
        la.Drag(p.right, coefficient=p.number(0.2, 1.0), exponent=1.5, smoothing=0.1),
    ]


# Elements of the user's own


@case("potential", "ExpressionPotential")
def expression_potential(p: Plant) -> list[Element]:
    """A magnet, a wind vane and a spring on an angle between points, in all kinds of functions."""
    magnet = -ex.parameter("strength", 0.3) / ex.distance(p.left, p.right) ** 3
    vane = ex.direction(p.middle, (1.0, 2.0, -0.5)).dot(ex.direction(p.right, "z"))
    angle = sympy.atan2(ex.point(p.post)[1], 3.0 + ex.point(p.post)[0] ** 2)
    mixed = sympy.exp(vane / 2) * sympy.tanh(ex.variable("b")) + angle**2 * sympy.sin(ex.variable("s"))
    return [
        la.ExpressionPotential(magnet + 2.0 * vane, name="magnet"),
        la.ExpressionPotential(ex.parameter("scale", 1.7) * mixed),
    ]


@case("constraint", "ExpressionConstraint")
def expression_constraint(p: Plant) -> list[Element]:
    """A cam whose follower is a point, and a screw of variable pitch."""
    turn, slide, angle = ex.variable("a"), ex.variable("c"), ex.variable("f")
    follower = ex.point(p.left)[2] - 0.1 * sympy.cos(2 * turn)
    height = p.origin(p.left)[2] - 0.1 * np.cos(2 * p.values["a"])
    thread = slide - (0.3 * angle + 0.05 * angle**3)
    start = p.values["c"] - (0.3 * p.values["f"] + 0.05 * p.values["f"] ** 3)
    return [
        la.ExpressionConstraint(follower - ex.parameter("height", float(height)), name="cam"),
        la.ExpressionConstraint(thread - float(start), name="screw"),
    ]


@case("force", "ExpressionForce")
def expression_force(p: Plant) -> list[Element]:
    """A muscle along a distance, an excited joint, and a force on a point across a moving plane."""
    length, speed = ex.distance(p.left, p.post), ex.speed("b")
    muscle = -ex.input_("m") * sympy.exp(-((length - 1) ** 2)) / (1 + ex.rate(length) ** 2)
    excited = ex.parameter("gain", 0.4) * (1 - ex.variable("b") ** 2) * speed + ex.input_("n")
    height = ex.direction(p.middle, "y").dot(ex.point(p.right) - ex.point(p.middle))
    return [
        la.ExpressionForce(muscle, along=length, name="muscle"),
        la.ExpressionForce(excited, along="b", name="excited"),
        la.ExpressionForce(-2.0 * ex.rate(height) * height**2, along=height, name="film"),
    ]


class Well(PythonFunction):
    """f = 1 / (1 + |p1 - p2|^2) + 3 d . d' q, with z = [p1; p2; d; d'; q]; takes JAX's arrays too."""

    def value(self, z: Any) -> Any:
        apart = z[:3] - z[3:6]
        return 1.0 / (1.0 + apart @ apart) + 3.0 * (z[6:9] @ z[9:12]) * z[12]

    def gradient(self, z: np.ndarray) -> np.ndarray:
        apart = z[:3] - z[3:6]
        slope = -2.0 * apart / (1.0 + apart @ apart) ** 2
        turned = [3.0 * z[9:12] * z[12], 3.0 * z[6:9] * z[12], [3.0 * (z[6:9] @ z[9:12])]]
        return np.concatenate([slope, -slope, *turned])

    def hessian(self, z: np.ndarray) -> np.ndarray:
        apart = z[:3] - z[3:6]
        size = 1.0 + apart @ apart
        block = 8.0 * np.outer(apart, apart) / size**3 - 2.0 * np.eye(3) / size**2
        out = np.zeros((13, 13), dtype=z.dtype)
        out[:3, :3] = out[3:6, 3:6] = block
        out[:3, 3:6] = out[3:6, :3] = -block
        out[6:9, 9:12] = out[9:12, 6:9] = 3.0 * z[12] * np.eye(3)
        out[6:9, 12] = out[12, 6:9] = 3.0 * z[9:12]
        out[9:12, 12] = out[12, 9:12] = 3.0 * z[6:9]
        return out


class Less(PythonFunction):
    """Another function less a constant."""

    def __init__(self, function: PythonFunction, constant: float) -> None:
        self.function, self.constant = function, constant

    def value(self, z: Any) -> Any:
        return self.function.value(z) - self.constant

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return self.function.gradient(z)

    def hessian(self, z: np.ndarray) -> np.ndarray:
        return self.function.hessian(z)


def _well(p: Plant) -> dict[str, Any]:
    return {
        "points": (p.left, p.right),
        "directions": ((p.left, "x"), (p.middle, (0.6, 0.0, 0.8))),
        "variables": ("b",),
    }


@case("potential", "PythonPotential")
def python_potential(p: Plant) -> list[Element]:
    return [la.PythonPotential(Well(), **_well(p))]


@case("constraint", "PythonConstraint")
def python_constraint(p: Plant) -> list[Element]:
    z = [
        *(p.origin(frame) for frame in (p.left, p.right)),
        p.pose(p.left)[:3, 0],
        p.pose(p.middle)[:3, :3] @ (0.6, 0.0, 0.8),
        [p.values["b"]],
    ]
    constant = float(Well().value(np.concatenate(z)))
    return [la.PythonConstraint(Less(Well(), constant), **_well(p))]


@case("force", "PythonForce")
def python_force(p: Plant) -> list[Element]:
    return [la.PythonForce(Well(), "m", gain=p.number(0.5, 2.0), **_well(p))]


class Brake(PythonFunction):
    """F = u exp(-s w) - (1 + w^2) s' w' - s'^3 of y = [s, w, s', w', u]; without an input u is one."""

    def _parts(self, y: Any) -> tuple[Any, ...]:
        return (y[0], y[1], y[2], y[3], y[4] if len(y) > 4 else 1.0)

    def value(self, y: Any) -> Any:
        s, w, ds, dw, u = self._parts(y)
        exp = jnp.exp if isinstance(y, jnp.ndarray) else np.exp
        return u * exp(-s * w) - (1.0 + w**2) * ds * dw - ds**3

    def gradient(self, y: np.ndarray) -> np.ndarray:
        s, w, ds, dw, u = self._parts(y)
        e = np.exp(-s * w)
        out = [-u * w * e, -u * s * e - 2.0 * w * ds * dw, -(1.0 + w**2) * dw - 3.0 * ds**2, -(1.0 + w**2) * ds, e]
        return np.array(out[: len(y)])

    def hessian(self, y: np.ndarray) -> np.ndarray:
        s, w, ds, dw, u = self._parts(y)
        e = np.exp(-s * w)
        out = np.zeros((5, 5), dtype=y.dtype)
        out[0, 0], out[1, 1], out[2, 2] = u * w**2 * e, u * s**2 * e - 2.0 * ds * dw, -6.0 * ds
        out[0, 1] = out[1, 0] = -u * e + u * s * w * e
        out[0, 4] = out[4, 0] = -w * e
        out[1, 4] = out[4, 1] = -s * e
        out[1, 2] = out[2, 1] = -2.0 * w * dw
        out[1, 3] = out[3, 1] = -2.0 * w * ds
        out[2, 3] = out[3, 2] = -(1.0 + w**2)
        return out[: len(y), : len(y)]


@case("force", "PythonForce")
def python_force_with_rates(p: Plant) -> list[Element]:
    """Along a function of places, and along a variable; with and without an input."""
    return [
        la.PythonForce(Well(), "m", magnitude=Brake(), measured=["c"], gain=p.number(0.5, 2.0), **_well(p)),
        la.PythonForce("a", magnitude=Brake(), measured=["r"]),
    ]


def _moved(pose: np.ndarray, origin: np.ndarray) -> np.ndarray:
    out = pose.copy()
    out[:3, 3] = origin
    return out


def _about(angle: float, axis: int) -> np.ndarray:
    out = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[i, i] = out[j, j] = np.cos(angle)
    out[j, i] = np.sin(angle)
    out[i, j] = -out[j, i]
    return out
