"""Trees of frames, drawn as data: which function is called with what, and what hangs on it.

A tree that is drawn is sound: every dynamic variable moves a mass, names are unique, numbers are ordinary.
What breaks it is in `damage`. Frames, variables, inputs and elements share one alphabet, so that a name often
stands for several things at once, as it may.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st

from leastaction import mechanics as la

DYNAMIC, KINEMATIC = ("a", "b", "c", "d", "e"), ("r", "s")
FRAMES = ("a", "b", "arm", "r", "hand", "g", "x y", "ρ<1>")


class Draw:
    """Draws of plain things, each cheap."""

    def __init__(self, draw: Any) -> None:
        self._draw = draw

    def below(self, count: int) -> int:
        return int(self._draw(_below(count)))

    def chance(self, percent: int) -> bool:
        # Shrinks towards what is left out.
        return self.below(100) >= 100 - percent

    def pick(self, choices: Any) -> Any:
        return choices[self.below(len(choices))]

    def some(self, choices: Any, least: int, most: int) -> list[Any]:
        """Draw different ones, in any order."""
        left = list(choices)
        count = least + self.below(min(most, len(left)) - least + 1)
        return [left.pop(self.below(len(left))) for _ in range(count)]

    def number(self, low: float, high: float) -> float:
        """Draw an ordinary number, in a thousand steps."""
        return round(low + (high - low) * self.below(1001) / 1000, 6)

    def three(self, low: float = -1.0, high: float = 1.0) -> tuple[float, ...]:
        return tuple(self.number(low, high) for _ in range(3))

    def rotation(self) -> np.ndarray:
        q, r = np.linalg.qr(np.random.default_rng(self.below(64)).standard_normal((3, 3)))
        q = q * np.sign(np.diag(r))
        return q * np.sign(np.linalg.det(q))


@cache
def _below(count: int) -> Any:
    return st.integers(0, count - 1)


@dataclass
class Call:
    """A call that the user makes: ``function(*args, **options)``."""

    function: Any
    args: list[Any] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        given = [repr(a) for a in self.args] + [f"{k}={v!r}" for k, v in self.options.items()]
        return f"{getattr(self.function, '__name__', self.function)}({', '.join(given)})"


@dataclass
class Node:
    """A frame or composition of the tree, as its call, and the nodes on it."""

    call: Call
    children: list[Node] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"{self.call!r}, {self.children}" if self.children else repr(self.call)


@dataclass(frozen=True)
class Spot:
    """A frame that elements may name.

    ``joints``: the joints between the world and it, each with the dynamic variables that move it and whether
    it turns. ``prescribed``: the kinematic variables that move it. ``heavy``: whether it carries a mass.
    ``apart``: whether its origin lies on no joint's axis, so that it coincides with no other spot.
    """

    name: str
    joints: tuple[tuple[int, tuple[str, ...], bool], ...]
    prescribed: frozenset[str]
    heavy: bool
    apart: bool


@dataclass
class Wood:
    """A drawn tree: its nodes, and what elements can refer to."""

    nodes: list[Node]
    spots: list[Spot]
    dynamic: list[str]
    kinematic: list[str]
    world: str

    def every(self) -> list[Node]:
        found, stack = [], list(self.nodes)
        while stack:
            node = stack.pop()
            found.append(node)
            stack += node.children
        return found


def draw_wood(d: Draw) -> Wood:
    """Draw a sound tree."""
    return _Grower(d).grow()


class _Grower:
    def __init__(self, d: Draw) -> None:
        self.d = d
        self.dynamic: list[str] = []
        self.kinematic: list[str] = []
        self.free_names = list(FRAMES)
        self.joints = 0
        self.world = "world"
        self.nodes: list[Node] = []
        self.spots: list[Spot] = []

    def grow(self) -> Wood:
        d = self.d
        if d.chance(5):
            self.world = "ground"
        root = Spot(self.world, (), frozenset(), False, False)
        self.spots.append(root)
        places: list[tuple[list[Node], Spot]] = [(self.nodes, root)]
        for index in range(1 + d.below(4)):
            siblings, at = d.pick(places)
            kind = 0 if index == 0 else d.below(10)
            if kind <= 7:
                node, spot = self.joint(at, dynamic=index == 0 or d.chance(85))
            else:
                node, spot = self.composition(at) if kind == 8 else self.constant(at)
            siblings.append(node)
            places.append((node.children, spot))
            if spot.joints != at.joints or d.chance(30):
                self.tip(node, spot)
        post = Call(la.pose, options={"translation": d.three(-2.0, 2.0), "name": "post"})
        self.nodes.append(Node(post))
        self.spots.append(Spot("post", (), frozenset(), False, True))
        return Wood(self.nodes, self.spots, self.dynamic, self.kinematic, self.world)

    def name(self) -> str | None:
        if not self.free_names or not self.d.chance(80):
            return None
        return str(self.free_names.pop(self.d.below(len(self.free_names))))

    def body(self) -> dict[str, Any]:
        d = self.d
        return {"mass": d.number(0.2, 2.0), "com": d.three(-0.3, 0.3), "inertia": self.inertia()}

    def inertia(self) -> Any:
        d = self.d
        x, y, z = (d.number(0.1, 1.0) for _ in range(3))
        return [(y + z, x + z, x + y), (y + z, x + z, x + y, 0.01, -0.02, 0.0), np.diag([y + z, x + z, x + y])][
            d.below(3)
        ]  # fmt: skip

    def variable(self, dynamic: bool) -> str:
        pool, known = (DYNAMIC, self.dynamic) if dynamic else (KINEMATIC, self.kinematic)
        new = [name for name in pool if name not in known]
        if known and (not new or self.d.chance(15)):
            return str(self.d.pick(known))
        known.append(self.d.pick(new))
        return known[-1]

    def joint(self, at: Spot, *, dynamic: bool) -> tuple[Node, Spot]:
        d = self.d
        own = self.variable(dynamic)
        moved, prescribed = ((own,), ()) if dynamic else ((), (own,))
        amount: Any = own
        options: dict[str, Any] = {} if dynamic else {"kinematic": True}
        if self.dynamic and d.chance(20):
            other = d.pick(self.dynamic if dynamic else self.kinematic)
            factor, more = d.number(0.3, 1.5), d.number(0.3, 1.5)
            shape = d.below(3)
            # The sum is a joint of its own: the variable's own joint, which moves a mass, comes before it.
            if other != own and own not in self.lonely():
                amount = [{own: factor, other: more}, factor * la.var(own) + more * la.var(other)][shape % 2]
                moved, prescribed = ((own, other), ()) if dynamic else ((), (own, other))
            else:
                amount = [{own: factor}, factor * la.var(own) + 0.3, -la.var(own)][shape]
        elif dynamic and self.kinematic and d.chance(20):
            led = d.pick(self.kinematic)
            amount, prescribed = {own: d.number(0.3, 1.5), led: d.number(0.3, 1.5)}, (led,)
            options["kinematic"] = [led]
        if d.chance(15):
            options["offset"] = d.number(-1.0, 1.0)
        kind = d.below(13)
        simple = [la.rx, la.ry, la.rz, la.tx, la.ty, la.tz, la.rz, la.ry]
        if kind < len(simple):
            call = Call(simple[kind], [amount], options)
            turns = simple[kind].__name__[0] == "r"
        else:
            call, turns = self.general(kind - len(simple), amount, options)
        name = self.name()
        if name is not None:
            call.options["name"] = name
        call.options |= self.body()
        if d.chance(15):
            call.options["bodies"] = [Call(la.Body, [d.number(0.1, 1.0)], {"com": d.three()})]
        self.joints += 1
        spot = Spot(
            name or "", (*at.joints, (self.joints, moved, turns)), at.prescribed | set(prescribed), True, False
        )  # fmt: skip
        return self.settle(Node(call), spot)

    def lonely(self) -> set[str]:
        """Return the variables that have no joint of their own yet: those that were met just now."""
        settled = {name for spot in self.spots for _, names, _ in spot.joints for name in names}
        settled |= {name for spot in self.spots for name in spot.prescribed}
        return {name for name in (*self.dynamic, *self.kinematic) if name not in settled}

    def general(self, kind: int, amount: Any, options: dict[str, Any]) -> tuple[Call, bool]:
        d = self.d
        axis = d.pick(["x", "-y", "z", (0.3, -1.2, 0.7), (0.0, 2.0, 1.0)])
        if kind == 0:
            return Call(la.prismatic, [amount], {"axis": axis, **options}), False
        if kind == 1:
            return Call(la.revolute, [amount], {"axis": axis, "point": d.three(), **options}), True
        if kind == 2:
            pitch = d.number(-0.3, 0.3)
            return Call(la.screw, [amount], {"axis": axis, "pitch": pitch, **options}), True
        twist = {"linear": d.three(0.1, 1.0), "angular": d.three(0.1, 1.0)}
        if kind == 3:
            return Call(la.twist, [amount], {**twist, **options}), True
        return Call(la.twist, [amount], {"linear": twist["linear"], **options}), False

    def composition(self, at: Spot) -> tuple[Node, Spot]:
        d = self.d
        make, axes = d.pick([(la.universal, "xy"), (la.ball, "xyz"), (la.ball, "zxz"), (la.free, "zyx")])
        name = self.name() or f"joint{self.joints}"
        prescribed = d.chance(15)
        slides = [f"{name}.{axis}" for axis in "xyz"] if make is la.free else []
        turns = [f"{name}.r{axis}{'2' if axis in axes[:i] else ''}" for i, axis in enumerate(axes)]
        options: dict[str, Any] = {"axes": axes, **self.body()}
        if prescribed:
            options["kinematic"] = True
        (self.kinematic if prescribed else self.dynamic).extend([*slides, *turns])
        joints = list(at.joints)
        for variable in (*slides, *turns):
            self.joints += 1
            joints.append((self.joints, () if prescribed else (variable,), variable in turns))
        kinematic = at.prescribed | (set(slides + turns) if prescribed else set())
        return self.settle(Node(Call(make, [name], options)), Spot(name, tuple(joints), kinematic, True, False))

    def constant(self, at: Spot) -> tuple[Node, Spot]:
        d = self.d
        call = d.pick(
            [
                lambda: Call(d.pick([la.tx, la.ty, la.tz, la.rx, la.rz]), [d.number(-1.0, 1.0)]),
                lambda: Call(la.pose, options={"translation": d.three(), "rotation": d.rotation()}),
                lambda: Call(la.screw, [d.number(-1.0, 1.0)], {"axis": "z", "pitch": 0.2}),
                lambda: Call(la.tx, [0.3], {"offset": 0.2}),
            ]
        )()
        heavy = d.chance(25)
        if heavy:
            call.options["mass"] = d.number(0.2, 2.0)
        name = self.name()
        if name is not None:
            call.options["name"] = name
        return self.settle(Node(call), Spot(name or "", at.joints, at.prescribed, heavy, False))

    def tip(self, node: Node, at: Spot) -> None:
        """Put a frame on a node off the axes of all joints, where elements can act."""
        name = f"tip{len(self.spots)}"
        options = {"translation": self.d.three(0.3, 1.3), "name": name}
        node.children.append(Node(Call(la.pose, options=options)))
        self.spots.append(Spot(name, at.joints, at.prescribed, False, True))

    def settle(self, node: Node, spot: Spot) -> tuple[Node, Spot]:
        """Note a new spot; a frame without a name cannot be referred to, but counts for its joints."""
        self.spots.append(spot)
        return node, spot
