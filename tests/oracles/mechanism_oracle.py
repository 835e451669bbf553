"""An independent reading of a `Mechanism`: energies, constraints, forces and steps, from their definitions.

It takes the description that the user gave (the tree and the elements with their public attributes) and nothing of
what the package derives from it. Poses are 4x4 matrices, velocities their derivatives along v, the kinetic energy
of a body is ``tr(G' J G'^T) / 2`` with its 4x4 pseudo-inertia J, generalised forces are virtual work, and every
derivative is JAX's. What an element means is in `derivatives/elements/formulas.py`.

All functions of `Oracle` are pure, so they can be differentiated; a time domain is built on `kinetic`, `potential`,
`constraints` and `force` alone, as `step_residuals` is.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from itertools import chain
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from derivatives.elements import formulas
from leastaction.mechanics import Body, Element, Mechanism
from leastaction.mechanics.description.tree import TreeJoint

Data = dict[str, jnp.ndarray]
Orders = Callable[[np.ndarray], list[np.ndarray]]

# Trees of the same number of joints share the graphs of their poses and kinetic energies: q is filled up with
# variables that move nothing to this many.
ROOM = 11


def _understood(options: dict[str, object]) -> dict[str, object]:
    """Return those options of the compiler that the installed version knows."""

    def known(name: str) -> bool:
        try:
            jax.jit(lambda x: x, compiler_options={name: options[name]})(0.0)
        except jax.errors.JaxRuntimeError:
            return False
        return True

    return {name: value for name, value in options.items() if known(name)}


# The graph of an element is run a few times only: how fast it is compiled counts, not how fast it runs.
OPTIONS = _understood({"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False})


class Near(NamedTuple):
    """A configuration, and the joints' poses (n, 4, 4) there with their first three derivatives by q."""

    q: jnp.ndarray
    poses: list[jnp.ndarray]


class Place:
    """A configuration, and where everything is in it; poses are computed when they are asked for.

    With ``near`` they are their Taylor polynomials of third order about that configuration, which have the same
    first three derivatives there: the tree is then differentiated once, in a graph that all elements share.
    """

    def __init__(self, oracle: Oracle, q: jnp.ndarray, near: Near | None = None) -> None:
        self.oracle = oracle
        self.q = q
        self.near = near
        self._joints: dict[int, jnp.ndarray] = {-1: jnp.eye(4)}

    def __getitem__(self, name: str) -> jnp.ndarray:
        return self.q[self.oracle.index[name]]

    def joint(self, j: int) -> jnp.ndarray:
        """The pose of a joint's moved frame."""
        if j not in self._joints:
            self._joints[j] = self._moved(j) if self.near is None else self._expanded(j, self.near)
        return self._joints[j]

    def _moved(self, j: int) -> jnp.ndarray:
        joint = self.oracle.joints[j]
        s = joint.factors @ self.q + joint.offset
        return self.joint(joint.parent) @ jnp.tensordot(amounts(joint.hat, s), joint.moves, 1)

    def _expanded(self, j: int, near: Near) -> jnp.ndarray:
        G, G_q, G_qq, G_qqq = (part[j] for part in near.poses)
        e = self.q - near.q
        return G + (G_q + (G_qq + G_qqq @ e / 3) @ e / 2) @ e

    def pose(self, frame: str) -> jnp.ndarray:
        joint, local = self.oracle.frames[frame]
        return self.joint(joint) @ local

    def origin(self, frame: str) -> jnp.ndarray:
        return self.pose(frame)[:3, 3]

    def rotation(self, frame: str) -> jnp.ndarray:
        return self.pose(frame)[:3, :3]


class JointData(NamedTuple):
    parent: int
    hat: np.ndarray
    moves: np.ndarray
    factors: np.ndarray
    offset: float


class BodyData(NamedTuple):
    frame: str
    joint: int
    mass: float
    centre: np.ndarray
    pseudo: np.ndarray


class Oracle:
    """The functions of a mechanism, read from its description.

    ``index``: where each variable is in q. ``inputs``: where each input is in u. ``frames``: joint and constant pose
    of every frame. ``joints``, ``bodies``: constants of the tree.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        # No part of the core is kept: what JAX holds on to outlives the interpreter's end.
        self.elements: list[Element] = list(mechanism.elements.values())
        self.dynamic = mechanism.dynamic
        self.nd, self.nq, self.nu, self.nc = mechanism.nd, mechanism.nq, mechanism.nu, mechanism.nc
        self.index = {name: i for i, name in enumerate(mechanism.variables)}
        self.inputs = {name: i for i, name in enumerate(mechanism.inputs)}
        tree = mechanism.tree
        self.frames = {f.name: (f.joint, np.asarray(f.pose)) for f in tree.frames}
        self.joints = [self._joint(joint) for joint in tree.joints]
        self.bodies = [
            _body(frame.name, frame.joint, np.asarray(frame.pose), body)
            for frame in tree.frames
            for body in frame.frame.bodies
        ]

    def _joint(self, joint: TreeJoint) -> JointData:
        factors = np.zeros(len(self.index))
        for name, factor in joint.coordinate.terms:
            factors[self.index[name]] += factor
        x, y, z, a, b, c = joint.twist
        hat = np.zeros((4, 4))
        hat[:3] = [[0, -c, b, x], [c, 0, -a, y], [-b, a, 0, z]]
        powers = [np.linalg.matrix_power(hat, k) for k in range(4)]
        moves = np.asarray(joint.pose) @ np.stack(powers)
        return JointData(joint.parent, hat, moves, factors, joint.coordinate.offset)

    # Functions of the configuration and the velocity

    def place(self, q: jnp.ndarray, near: Near | None = None) -> Place:
        return Place(self, q, near)

    def kinetic(self, q: jnp.ndarray, v: jnp.ndarray) -> jnp.ndarray:
        """Return T: half of tr(G' J G'^T) summed over the joints, G' the rate of the pose along v, and the rotors'."""
        spare = jnp.zeros(ROOM - self.nq)
        q, v = (jnp.concatenate([part, spare]) for part in (q, v))
        return tree_energy(self.tree_data, q, v)

    def potential(self, q: jnp.ndarray, near: Near | None = None) -> jnp.ndarray:
        """Return V: the sum of the formulas of all potentials."""
        place = self.place(q, near)
        found = [formula(place, element) for formula, element in self._known(formulas.POTENTIALS)]
        return sum(found, start=jnp.zeros(()))

    def constraints(self, q: jnp.ndarray, near: Near | None = None) -> jnp.ndarray:
        """Return h (nc,): the formulas of all constraints, in the order of the elements."""
        place = self.place(q, near)
        found = [formula(place, element) for formula, element in self._known(formulas.CONSTRAINTS)]
        return jnp.stack(list(chain.from_iterable(found))) if found else jnp.zeros(0)

    def force(self, q: jnp.ndarray, v: jnp.ndarray, u: jnp.ndarray, near: Near | None = None) -> jnp.ndarray:
        """Return the generalised forces (nq,) of all force elements."""
        inputs = {name: u[i] for name, i in self.inputs.items()}
        motion = formulas.Motion(partial(self.place, near=near), q, v, inputs)
        found = [formula(motion, element) for formula, element in self._known(formulas.FORCES)]
        return sum(found, start=jnp.zeros(len(q)))

    def _known(self, table: dict[str, Callable]) -> list[tuple[Callable, Element]]:
        kinds = [(formulas.kind(element), element) for element in self.elements]
        return [(table[kind], element) for kind, element in kinds if kind in table]

    # With all derivatives, compiled

    def near(self, q: np.ndarray) -> Near:
        """Return the poses at q with their derivatives."""
        found = _pose_graph(self.tree_data, jnp.asarray(_spread(q, ROOM)))
        return Near(jnp.asarray(q), _cut([np.asarray(a) for a in found], 3, np.arange(self.nq)))

    @cached_property
    def potential_orders(self) -> Orders:
        """V and its first three derivatives by q."""
        if not self._known(formulas.POTENTIALS):
            return _nothing((), 3)
        return self._orders(self.potential, 3)

    @cached_property
    def constraint_orders(self) -> Orders:
        """The h (nc,) and their first three derivatives by q."""
        if not self._known(formulas.CONSTRAINTS):
            return _nothing((0,), 3)
        return self._orders(self.constraints, 3)

    @cached_property
    def force_orders(self) -> Orders:
        """The forces (nq,) and their first two derivatives by z = [q; v; u]; one more by q is in them."""
        nq = self.nq
        if not self._known(formulas.FORCES):
            return _nothing((nq,), 2)

        def force(z: jnp.ndarray, near: Near) -> jnp.ndarray:
            return self.force(z[:nq], z[nq : 2 * nq], z[2 * nq :], near)

        return self._orders(force, 2)

    def _orders(self, function: Callable[[jnp.ndarray, Near], jnp.ndarray], count: int) -> Orders:
        graph = jax.jit(
            lambda z, near: orders(lambda at: function(at, near), count)(z),
            compiler_options=OPTIONS,
        )
        nq = self.nq
        return lambda z: [np.array(a) for a in graph(jnp.asarray(z), self.near(z[:nq]))]

    def kinetic_orders(self, z: np.ndarray) -> list[np.ndarray]:
        """T and its first three derivatives by z = [q; v]."""
        q, v = z[: self.nq], z[self.nq :]
        padded = jnp.asarray(np.concatenate([_spread(q, ROOM), _spread(v, ROOM)]))
        found = [np.array(a) for a in _kinetic_graph(self.tree_data, padded)]
        return _cut(found, 0, np.r_[: self.nq, ROOM : ROOM + self.nq])

    @cached_property
    def tree_data(self) -> Data:
        """The constants of the tree as arrays. Bodies on one joint are one: their pseudo-inertias add up."""
        pseudo = np.zeros((len(self.joints), 4, 4))
        for body in self.bodies:
            if body.joint >= 0:  # the world does not move
                pseudo[body.joint] += body.pseudo
        names = JointData._fields
        data = {n: jnp.array([getattr(joint, n) for joint in self.joints]) for n in names}
        spare = jnp.zeros((len(self.joints), ROOM - self.nq))
        filled = jnp.concatenate([data["factors"], spare], axis=1)
        # The energy of the rotors is v'Rv/2, a matrix of zeros where there are none.
        rotors = np.zeros((ROOM, ROOM))
        for formula, element in self._known(formulas.ROTORS):
            rotors[: self.nq, : self.nq] += formula(self.index, element)
        return {**data, "factors": filled, "pseudo": jnp.array(pseudo), "rotors": jnp.array(rotors)}


def _body(frame: str, joint: int, pose: np.ndarray, body: Body) -> BodyData:
    """The 4x4 pseudo-inertia, int [r; 1] [r; 1]^T dm, of a body, moved from its frame to that of the joint."""
    J = np.zeros((4, 4))
    c = body.com
    # int r r^T dm about the centre of mass from int (r.r E - r r^T) dm, then moved by c
    J[:3, :3] = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia + body.mass * np.outer(c, c)
    J[:3, 3] = J[3, :3] = body.mass * c
    J[3, 3] = body.mass
    return BodyData(frame, joint, body.mass, np.asarray(c), pose @ J @ pose.T)


def amounts(hat: np.ndarray, s: jnp.ndarray) -> jnp.ndarray:
    """Return how much of each power of the twist ``hat`` (4, 4), from 0 to 3, is in ``exp(hat s)``.

    hat^4 = -w^2 hat^2 with the rate of turn w, so the series ends there.
    """
    w2 = hat[0, 1] ** 2 + hat[0, 2] ** 2 + hat[1, 2] ** 2
    turns = w2 > 0.0
    w = jnp.sqrt(jnp.where(turns, w2, 1.0))
    second = jnp.where(turns, (1.0 - jnp.cos(w * s)) / w**2, 0.0)
    third = jnp.where(turns, (w * s - jnp.sin(w * s)) / w**3, 0.0)
    return jnp.stack([jnp.ones_like(s), s, second, third])


def orders(function: Callable[[jnp.ndarray], jnp.ndarray], count: int) -> Callable[[jnp.ndarray], list[jnp.ndarray]]:
    """Return ``z -> [f, Df, D2f, ...]``; every order comes with the one above it, so that the graph stays small."""

    def values(z: jnp.ndarray) -> tuple[jnp.ndarray, list[jnp.ndarray]]:
        value = function(z)
        return value, [value]

    for _ in range(count):

        def values(z: jnp.ndarray, below: Callable = values) -> tuple[jnp.ndarray, list]:
            slope, found = jax.jacfwd(below, has_aux=True)(z)
            return slope, [*found, slope]

    return lambda z: values(z)[1]


def tree_poses(d: Data, q: jnp.ndarray) -> jnp.ndarray:
    """Return the poses of the joints' moved frames; the graph does not grow with the tree."""
    n = len(d["parent"])

    def move(G: jnp.ndarray, joint: tuple) -> tuple[jnp.ndarray, None]:
        j, parent, hat, moves, factors, offset = joint
        s = factors @ q + offset
        return G.at[j].set(G[parent] @ jnp.tensordot(amounts(hat, s), moves, 1)), None

    start = jnp.tile(jnp.eye(4), (n + 1, 1, 1))  # the last one is the world's
    joints = (jnp.arange(n), *(d[name] for name in JointData._fields))
    return jax.lax.scan(move, start, joints)[0][:-1]


def tree_energy(d: Data, q: jnp.ndarray, v: jnp.ndarray) -> jnp.ndarray:
    rates = jax.jvp(partial(tree_poses, d), (q,), (v,))[1]
    return 0.5 * jnp.einsum("bij,bjk,bik", rates, d["pseudo"], rates) + 0.5 * v @ d["rotors"] @ v


def _nothing(shape: tuple[int, ...], count: int) -> Orders:
    return lambda z: [np.zeros(shape + (len(z),) * order) for order in range(count + 1)]


def _spread(values: np.ndarray, room: int) -> np.ndarray:
    return np.concatenate([values, np.zeros(room - len(values))])


def _cut(parts: list[np.ndarray], axes: int, at: np.ndarray) -> list[np.ndarray]:
    """Return the entries ``at`` of every axis of differentiation; a value has `axes` axes of its own."""
    return [
        np.array(part[np.ix_(*(np.arange(n) for n in part.shape[:axes]), *[at] * order)])
        for order, part in enumerate(parts)
    ]


@jax.jit
def _kinetic_graph(d: Data, z: jnp.ndarray) -> list[jnp.ndarray]:
    def energy(at: jnp.ndarray) -> jnp.ndarray:
        return tree_energy(d, at[:ROOM], at[ROOM:])

    return [energy(z), *orders(jax.grad(energy), 2)(z)]


@jax.jit
def _pose_graph(d: Data, q: jnp.ndarray) -> list[jnp.ndarray]:
    return orders(partial(tree_poses, d), 3)(q)
