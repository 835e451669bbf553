"""Random mechanisms as plain arrays: what the oracles read, and what the core is built from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from leastaction import Mechanism, _core


@dataclass(frozen=True)
class Tree:
    """A mechanism. Joint -1 is the world; ``length_variable`` -1: the length is the constant.

    A tree has joints (parent, constant pose, twist ``[v; w]``, variable), bodies, points, distances between
    points, damping of the dynamic variables, and a matrix of zeros and ones from inputs to forces.
    """

    n_dynamic: int
    n_kinematic: int
    parent: np.ndarray
    pose: np.ndarray
    twist: np.ndarray
    variable: np.ndarray
    body_joint: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray
    point_joint: np.ndarray
    point_offset: np.ndarray
    ends: np.ndarray
    length: np.ndarray
    length_variable: np.ndarray
    damping: np.ndarray
    inputs: np.ndarray

    @property
    def nq(self) -> int:
        return self.n_dynamic + self.n_kinematic

    def core_joints(self) -> list[int]:
        """Return the joints in the order of the core: those with a mass behind them, depth first, then the others."""
        heavy = set(self.body_joint.tolist()) - {-1}
        for joint in reversed(range(len(self.parent))):
            heavy |= {int(self.parent[joint])} if joint in heavy else set()
        order, stack = [], [-1]
        while stack:
            order.append(stack.pop())
            stack += [j for j in reversed(range(len(self.parent))) if self.parent[j] == order[-1] and j in heavy]
        return order[1:] + [j for j in range(len(self.parent)) if j not in heavy]

    def core(self) -> _core.Mechanism:
        builder = _core.MechanismBuilder(self.n_dynamic, self.n_kinematic, self.inputs.shape[1])
        place = {-1: -1}
        for j in self.core_joints():
            place[j] = builder.add_joint(place[self.parent[j]], self.pose[j], self.twist[j], int(self.variable[j]))
        for joint, mass, com, inertia in zip(self.body_joint, self.mass, self.com, self.inertia, strict=True):
            builder.add_body(place[joint], float(mass), com, inertia)
        for joint, offset in zip(self.point_joint, self.point_offset, strict=True):
            builder.add_point(place[joint], offset)
        builder.set_gravity(self.gravity)
        for (p1, p2), length, variable in zip(self.ends, self.length, self.length_variable, strict=True):
            builder.add_distance(int(p1), int(p2), float(length), int(variable))
        for i, coefficient in enumerate(self.damping):
            builder.add_damping(i, float(coefficient))
        for i, a in np.argwhere(self.inputs):
            builder.add_joint_force(int(i), int(a))
        return builder.build()

    def mechanism(self) -> Mechanism:
        """Return what `MidpointVI` needs of a mechanism, round about the description in Python."""
        names = tuple(f"q{i}" for i in range(self.nq))
        fields = {
            "core": self.core(),
            "_plan": SimpleNamespace(elements={}),
            "tree": SimpleNamespace(balls=(), rotations=()),
            "nd": self.n_dynamic,
            "nrho": self.n_kinematic,
            "nq": self.nq,
            "nv": self.nq,
            "first_rho": self.n_dynamic,
            "n_inputs": self.inputs.shape[1],
            "nc": len(self.ends),
            "nx": 2 * self.nq,
            "ndx": 2 * self.nq,
            "variables": names,
            "coordinates": names,
            "dynamic": names[: self.n_dynamic],
            "kinematic": names[self.n_dynamic :],
            "inputs": tuple(f"u{a}" for a in range(self.inputs.shape[1])),
            "constraints": tuple(f"h{c}" for c in range(len(self.ends))),
        }
        made = Mechanism.__new__(Mechanism)
        for name, value in fields.items():
            object.__setattr__(made, name, value)
        return made

    def without_constraints(self) -> Tree:
        return replace(
            self,
            ends=self.ends[:0],
            length=self.length[:0],
            length_variable=self.length_variable[:0],
        )


def random_tree(
    seed: int,
    *,
    joints: int = 9,
    kinematic: int = 3,
    lengths: int = 2,
    inputs: int = 3,
    kind: int = 0,
) -> Tree:
    """Return a tree with branches, massless joints, several bodies on one joint, and strings.

    The last joint moves no mass and is kinematic, as the upper end of a string is. The variables stand in
    an order of their own, `lengths` of them are lengths of strings. The constraints: a string of prescribed
    length from a moving body to the massless joint, one from a moving body to the world, and, if there are
    more than three joints, a rod of fixed length between two bodies of the tree. `kind` shifts the kinds of joints.
    """
    rng = np.random.default_rng(seed)
    nd = joints - kinematic
    parent = np.array([-1, *(int(rng.integers(max(-1, j - 3), j)) for j in range(1, joints))])
    parent[-1] = -1
    dynamic_joint = np.zeros(joints, dtype=bool)
    dynamic_joint[rng.permutation(joints - 1)[:nd]] = True
    variable = np.empty(joints, dtype=int)
    variable[dynamic_joint] = rng.permutation(nd)
    kinematic_order = nd + rng.permutation(kinematic + lengths)
    variable[~dynamic_joint] = kinematic_order[:kinematic]
    length_names = kinematic_order[kinematic:]

    # Bodies: none on the last joint, on the leaves always, elsewhere often; some on one joint, one fixed.
    leaf = ~np.isin(np.arange(joints), parent)
    body_joint = [j for j in range(joints - 1) if leaf[j] or rng.random() < 0.6]
    body_joint = np.array([-1, *body_joint, body_joint[0]])
    nb = len(body_joint)
    points = np.array([joints - 2, joints - 1, joints - 3, -1, 0, joints - 2])
    ends = np.array([[0, 1], [3, 2], [5, 4]][: 3 if joints > 3 else 2])
    length_variable = np.full(len(ends), -1)
    length_variable[: len(length_names)] = length_names
    forces = np.zeros((nd, inputs), dtype=int)
    for a in range(inputs):
        forces[rng.integers(nd), a] = 1
    return Tree(
        n_dynamic=nd,
        n_kinematic=kinematic + lengths,
        parent=parent,
        pose=np.array([_pose(rng) if rng.random() < 0.8 else np.eye(4) for _ in range(joints)]),
        twist=np.array([_twist(rng, kind + j) for j in range(joints)]),
        variable=variable,
        body_joint=body_joint,
        mass=rng.uniform(0.2, 3.0, nb),
        com=rng.uniform(-0.4, 0.4, (nb, 3)),
        inertia=np.array([_inertia(rng) for _ in range(nb)]),
        gravity=np.array([0.7, -1.3, -9.8]),
        point_joint=points,
        point_offset=rng.uniform(-0.5, 0.5, (len(points), 3)),
        ends=ends,
        length=rng.uniform(1.0, 2.0, len(ends)),
        length_variable=length_variable,
        damping=rng.uniform(0.1, 1.0, nd),
        inputs=forces,
    )


@dataclass(frozen=True)
class StepProblem:
    """The start of a step on the constraints, in motion, and where the prescribed variables go."""

    tree: Tree
    dt: float
    q: np.ndarray
    p: np.ndarray
    v_rho: np.ndarray
    inputs: np.ndarray
    rho_next: np.ndarray


def step_problem(tree: Tree, seed: int, *, dt: float = 0.01) -> StepProblem:
    """Return a random start: the strings are as long as its ends are apart, so it satisfies h = 0."""
    rng = np.random.default_rng([seed, 7])
    nd = tree.n_dynamic
    q = rng.uniform(-1.0, 1.0, tree.nq)
    lengths = tree.length_variable
    q[lengths[lengths >= 0]] = 0.0
    slack = replace(tree, length=np.zeros(len(tree.ends)), length_variable=np.full_like(lengths, -1))
    apart = np.sqrt(slack.core().constraints(q))
    q[lengths[lengths >= 0]] = apart[lengths >= 0]
    tree = replace(tree, length=apart)
    core = tree.core()
    v = rng.uniform(-1.0, 1.0, tree.nq)
    Dh = core.constraint_jacobian(q).reshape(-1, tree.nq)
    v[:nd] -= np.linalg.lstsq(Dh[:, :nd], Dh @ v, rcond=None)[0]
    p = core.gradient(q, v)[1][:nd] + 0.1 * rng.uniform(-1.0, 1.0, nd)
    return StepProblem(
        tree=tree,
        dt=dt,
        q=q,
        p=p,
        v_rho=rng.uniform(-1.0, 1.0, tree.n_kinematic),
        inputs=rng.uniform(-2.0, 2.0, tree.inputs.shape[1]),
        rho_next=q[nd:] + dt * v[nd:] + 0.3 * dt**2 * rng.uniform(-1.0, 1.0, tree.n_kinematic),
    )


def _rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def _pose(rng: np.random.Generator) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = _rotation(rng)
    out[:3, 3] = rng.uniform(-0.6, 0.6, 3)
    return out


def _twist(rng: np.random.Generator, j: int) -> np.ndarray:
    """Return, in turn: about an axis, along an axis, about a line anywhere, along one, a screw."""
    unit = np.eye(3)[rng.integers(3)]
    line = rng.standard_normal(3)
    line /= np.linalg.norm(line)
    kind = j % 6
    if kind in (0, 3):
        return np.concatenate([np.zeros(3), unit])
    if kind == 1:
        return np.concatenate([unit, np.zeros(3)])
    if kind == 2:
        return np.concatenate([np.cross(rng.uniform(-0.5, 0.5, 3), line), line])
    if kind == 4:
        return np.concatenate([1.3 * line, np.zeros(3)])
    return rng.uniform(-1.0, 1.0, 6)


def _inertia(rng: np.random.Generator) -> np.ndarray:
    """Return the inertia of some points of mass: symmetric, full, and one that a body can have."""
    r = rng.uniform(-0.3, 0.3, (6, 3))
    r -= r.mean(axis=0)
    return np.sum(r**2) * np.eye(3) - r.T @ r
