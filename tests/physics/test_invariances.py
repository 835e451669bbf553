"""What a description may change without changing the motion, and two ways to prescribe a variable."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from leastaction.mechanics import (
    Body,
    BodyWrench,
    Coupling,
    Damping,
    Distance,
    Drag,
    Element,
    Frame,
    Gravity,
    HingeLoop,
    HybridWrench,
    InverseSquareGravity,
    JointForce,
    JointSpring,
    LinearDamper,
    LinearSpring,
    Mechanism,
    MidpointVI,
    PointOnLine,
    PointOnPlane,
    PrescribedPath,
    SpatialWrench,
    TendonForce,
    TorsionalSpring,
    Trajectory,
    pose,
    project_configuration,
    project_velocity,
    rx,
    ry,
    rz,
    tx,
    ty,
    tz,
)
from physics.laws import G, complete, times

SAME = 1e-12


def rotation(seed: int) -> np.ndarray:
    """Return a rotation of no special kind."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def shifted(matrix: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return the tensor |d|^2 1 - d d^T of a unit mass at an offset, added to a matrix."""
    return matrix + offset @ offset * np.eye(3) - np.outer(offset, offset)


def halves(body: Body) -> tuple[Body, Body]:
    """Return two bodies that are the given one together: unequal, and apart."""
    share, apart = 0.3, 0.1 * np.array([0.3, -0.2, 0.4])
    masses = share * body.mass, (1 - share) * body.mass
    coms = body.com + (1 - share) * apart, body.com - share * apart
    rest = body.inertia.copy()
    for mass, com in zip(masses, coms, strict=True):
        rest -= mass * shifted(np.zeros((3, 3)), com - body.com)
    return tuple(
        Body(mass, com=com, inertia=part * rest, allow_nonphysical=True)
        for mass, com, part in zip(masses, coms, (0.6, 0.4), strict=True)
    )


@dataclass(frozen=True)
class Writing:
    """A way to write the same mechanism down."""

    split: bool = False
    padded: bool = False
    permuted: bool = False
    world: np.ndarray | None = None

    def bodies(self, body: Body) -> Sequence[Body]:
        return halves(body) if self.split else (body,)

    def put(self, frame: Frame, *children: list) -> list:
        """Return a frame with its children, with frames between them that take each other back."""
        branches = list(children)
        if self.permuted:
            branches = branches[::-1]
        below = [part for branch in branches for part in branch]
        if not self.padded:
            return [frame, below] if below else [frame]
        turn = rotation(5)
        there = pose(translation=[0.3, -0.1, 0.2], rotation=turn)
        back = pose(translation=-turn.T @ [0.3, -0.1, 0.2], rotation=turn.T)
        return [frame, [tx(0.0), [there, [rz(0.0), [back, below]]]]] if below else [frame]

    def direction(self, vector: Sequence[float]) -> np.ndarray:
        """Return a vector of the base in world axes."""
        return np.asarray(vector) if self.world is None else self.world[:3, :3] @ vector

    def point(self, vector: Sequence[float]) -> np.ndarray:
        moved = self.direction(vector)
        return moved if self.world is None else moved + self.world[:3, 3]


def machine(way: Writing) -> Mechanism:
    """Return a branched mechanism with a loop, springs, forces and constraints of most kinds."""

    def body(mass: float, *com: float) -> Sequence[Body]:
        inertia = mass * np.array([0.03, 0.04, 0.05, 0.004, -0.003, 0.002])
        return way.bodies(Body(mass, com=com, inertia=inertia))

    hand = way.put(tz(-0.3, name="hand", bodies=body(0.3, 0.0, 0.0, 0.0)))
    fore = way.put(ry("elbow", bodies=body(0.8, 0.02, 0.0, -0.15)), hand)
    upper = way.put(
        rx("shoulder", bodies=body(1.2, 0.0, 0.03, -0.2)),
        way.put(tz(-0.4, name="elbow-frame"), fore),
        way.put(ty(0.1, name="hook")),
    )
    leg = way.put(
        rz("hip", bodies=body(0.9, 0.1, 0.0, -0.1)),
        way.put(
            tx(0.3),
            way.put(rx("knee", bodies=body(0.5, 0.0, 0.1, -0.2)), way.put(tz(-0.4, name="foot"))),
        ),
    )
    tail = way.put(
        pose(translation=[-0.2, 0.0, 0.0], name="root"),
        way.put(
            ry("tail1", bodies=body(0.4, 0.0, 0.0, -0.2)),
            way.put(
                tz(-0.4),
                way.put(ry("tail2", bodies=body(0.4, 0.0, 0.0, -0.2)), way.put(tz(-0.4, name="tip"))),
            ),
        ),
        way.put(
            pose(translation=[0.4, 0.0, 0.0]),
            way.put(ry("strut", bodies=body(0.3, 0.0, 0.0, -0.3)), way.put(tz(-0.6, name="end"))),
        ),
    )
    torso = way.put(
        rx("a", name="torso", bodies=body(4.0, 0.05, -0.02, 0.1)),
        way.put(tx(0.25, name="joint"), upper),
        way.put(tx(-0.25), leg),
        tail,
    )
    base = way.put(
        pose(np.eye(4) if way.world is None else way.world, name="base"),
        way.put(tx("x"), way.put(ty("y"), way.put(tz("z"), way.put(rz("c"), way.put(ry("b"), torso))))),
        way.put(pose(translation=[0.5, 0.2, 1.0], rotation=rotation(3), name="anchor")),
    )
    elements: list[Element] = [
        Gravity(way.direction([0.0, 0.0, -G])),
        LinearSpring("anchor", "hand", 40.0, 0.5),
        LinearSpring("base", "torso", 60.0, name="centring"),
        TorsionalSpring("joint", "hook", 3.0, "x", 0.2),
        JointSpring({"hip": 1.0, "knee": -0.5}, 4.0),
        JointSpring("a", 30.0),
        JointSpring("b", 30.0),
        InverseSquareGravity("foot", "hand", 0.2),
        HingeLoop("tip", "end", "y", planar=True, name="loop"),
        Distance("anchor", "joint", 1.1, name="rod"),
        PointOnPlane("anchor", "foot", [0.3, -0.2, 1.0], name="floor"),
        Coupling({"elbow": 1.0, "shoulder": -0.5}, name="gear"),
        Damping(0.3),
        LinearDamper("foot", "joint", 0.3),
        Drag("hand", 0.2, wind=way.direction([1.0, 0.5, 0.0])),
        TendonForce(["hook", "elbow-frame", "anchor"], input="muscle"),
        JointForce("hip", input="motor"),
        BodyWrench("hand", force=(0.4, "jet", 0.0), torque=(0.0, 0.1, 0.05)),
        HybridWrench("foot", force=way.direction([0.5, -0.3, 0.2])),
        SpatialWrench(
            "torso",
            force=way.direction([0.2, 0.1, 0.3]),
            # About the origin of the base, wherever that is in the world.
            torque=way.direction([0.1, 0.0, -0.1])
            + np.cross(way.point([0.0, 0.0, 0.0]), way.direction([0.2, 0.1, 0.3])),
        ),
    ]  # fmt: skip
    return Mechanism(base, elements[::-1] if way.permuted else elements, inputs=["muscle", "motor", "jet"])


@functools.cache
def set_off() -> tuple[dict[str, float], dict[str, float]]:
    """Return a configuration and a velocity on the constraints, by name."""
    m = machine(Writing())
    values, speeds = np.random.default_rng(7).uniform(-0.3, 0.3, (2, m.nq))
    values = m.named(values) | {"y": -0.9, "tail1": -0.3, "tail2": 0.5}
    q = project_configuration(m, m.configuration(values)).q
    return m.named(q), m.named(project_velocity(m, q, speeds).v)


def pushed(m: Mechanism) -> Trajectory:
    """Return the same motion of the mechanism, whatever the order of its variables."""
    q, v = set_off()
    vi = MidpointVI(m, tolerance=1e-15)

    def inputs(t: float) -> list[float]:
        return [3.0 + t, np.sin(5 * t), 0.5 * np.cos(3 * t)]

    start = vi.start(m.configuration(q), m.configuration(v))
    return complete(vi.simulate(start, times(1.0, 100), inputs=inputs))


def moved_world() -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(11), [0.7, -1.2, 0.4]
    return matrix


WAYS = {
    "bodies split in two": Writing(split=True),
    "constant frames inserted": Writing(padded=True),
    "siblings and elements permuted": Writing(permuted=True),
    "world moved": Writing(world=moved_world()),
    "all at once": Writing(split=True, padded=True, permuted=True, world=moved_world()),
}


@pytest.fixture(scope="module")
def wanted() -> Trajectory:
    run = pushed(machine(Writing()))
    assert np.ptp(run.q, axis=0).min() > 0.02  # everything moves
    assert np.abs(run.mechanism.constraint_values(run.q)).max() < 1e-12
    return run


@pytest.mark.parametrize("way", WAYS)
def test_a_description_may_be_written_otherwise(way: str, wanted: Trajectory) -> None:
    found = pushed(machine(WAYS[way]))
    for name in wanted.mechanism.variables:
        assert np.abs(found[name] - wanted[name]).max() < SAME
    size = np.abs(wanted.lam).max()
    for name in wanted.mechanism.constraints:
        assert np.abs(found[name] - wanted[name]).max() < SAME * size
    # The height that energies count from moves with the world.
    energy, other = wanted.energy().total, found.energy().total
    assert np.abs((other - other[0]) - (energy - energy[0])).max() < 10 * SAME


def test_what_is_not_the_same_moves_otherwise(wanted: Trajectory) -> None:
    """Guards the test above: what is a millionth of the forces off would be seen."""
    m = machine(Writing()).with_elements([HybridWrench("torso", force=(0.0, 0.0, 1e-6))])
    assert np.abs(pushed(m).q - wanted.q).max() > 1e3 * SAME


# A variable that is prescribed, and the same one held to the prescription by a constraint


def signal(t: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(3.0 * t) + 0.1 * t**2


def pendulums(first: Frame) -> list:
    """Return two links and a side branch on a frame that is moved."""
    return [first, [
        rz("theta", mass=0.8, com=(0.0, -0.5, 0.0), inertia=(0.01, 0.02, 0.03)), [
            ty(-1.0), [rz("phi", mass=0.5, com=(0.1, -0.3, 0.0), inertia=(0.02, 0.01, 0.02)), [
                ty(-0.6, name="end"),
            ]],
        ],
        rx("side", mass=0.6, com=(0.1, 0.0, -0.4), inertia=(0.02, 0.03, 0.01)),
    ]]  # fmt: skip


def surroundings() -> list[Element]:
    return [
        Gravity((0.0, -G, 0.0)),
        Damping({"theta": 0.2, "phi": 0.1, "side": 0.05}),
        LinearSpring("post", "end", 15.0, 0.8),
    ]


def reactions(run: Trajectory, name: str) -> np.ndarray:
    """Return the impulse (N,) that keeps a kinematic variable on its prescription at every instant.

    What the discrete equation of motion lacks there: ``p_k + D1Ld(q_k, q_k+1)`` with the momentum
    ``p_k = D2Ld(q_k-1, q_k)``, at the start that of the velocity.
    """
    m, i = run.mechanism, run.mechanism.variables.index(name)
    dt = np.diff(run.t)
    forward, backward = np.empty(run.steps), np.empty(run.steps)
    for k in range(run.steps):
        L_q, L_v = m.core.gradient(0.5 * (run.q[k] + run.q[k + 1]), run.v[k])
        forward[k] = 0.5 * dt[k] * L_q[i] - L_v[i]
        backward[k] = 0.5 * dt[k] * L_q[i] + L_v[i]
    return backward[:-1] + forward[1:]


def agree(kinematic: Mechanism, held: Mechanism, variable: str, source: str, constraint: str) -> None:
    """Check that both move alike, and that the multiplier is the reaction on the prescribed variable."""
    t = times(1.5, 300)
    rate = (signal(1e-6) - signal(-1e-6)) / 2e-6
    named = {"theta": 0.5, "phi": -0.3, "side": 0.2}
    speeds = {"theta": 1.0, "phi": -2.0, "side": 0.7}

    def run(m: Mechanism, extra: Sequence[str]) -> Trajectory:
        moved = dict.fromkeys(extra, float(signal(0.0)))
        moving = dict.fromkeys(extra, float(rate))
        vi = MidpointVI(m, tolerance=1e-15)
        start = vi.start(m.configuration(named | moved), m.configuration(speeds | moving))
        return complete(vi.simulate(start, t, rho=signal(t)[:, None]))

    one, two = run(kinematic, [variable]), run(held, [variable, source])
    for name in (*named, variable):
        assert np.abs(one[name] - two[name]).max() < 1e-10
    impulses = reactions(one, variable)
    assert np.abs(impulses).max() > 1e-3
    assert two[constraint][1:] == pytest.approx(impulses, abs=1e-9 * np.abs(impulses).max())


@pytest.mark.parametrize("joint", [tx, rz, ry])
def test_a_prescribed_joint_is_a_joint_held_by_a_coupling(joint: Callable[..., Frame]) -> None:
    post = [pose(translation=[0.5, 0.3, 0.1], name="post")]
    body = {"mass": 2.0, "com": (0.1, 0.0, 0.0), "inertia": (0.3, 0.2, 0.1)}
    kinematic = Mechanism([*pendulums(joint("drive", kinematic=True, **body)), *post], surroundings())
    held = Mechanism(
        [*pendulums(joint("drive", **body)), *post, rz("source", kinematic=True)],
        [*surroundings(), Coupling({"drive": 1.0, "source": -1.0}, name="servo")],
    )
    agree(kinematic, held, "drive", "source", "servo")


def test_a_prescribed_slide_is_a_frame_on_a_prescribed_path() -> None:
    post = [pose(translation=[0.5, 0.3, 0.1], name="post")]
    kinematic = Mechanism([*pendulums(tx("drive", kinematic=True, name="cart", mass=2.0)), *post], surroundings())
    held = Mechanism(
        [*pendulums(tx("drive", name="cart", mass=2.0)), *post],
        [*surroundings(), PrescribedPath("cart", x="source", name="servo")],
    )
    agree(kinematic, held, "drive", "source", "servo.x")


def test_a_slide_is_a_point_on_a_line() -> None:
    """A joint that leaves one freedom moves as free coordinates that a guide takes the others from."""
    sliding = Mechanism(
        [tx("x"), [rz("theta"), [ty(-1.0, mass=1.0)], tx(0.0, name="cart", mass=2.0)]],
        [Gravity((1.0, -G, 0.0))],
    )
    guided = Mechanism(
        [
            *[tx("x"), [ty("y"), [rz("theta"), [ty(-1.0, mass=1.0)], tx(0.0, name="cart", mass=2.0)]]],
            tz(0.0, name="rail"),
        ],
        [Gravity((1.0, -G, 0.0)), PointOnPlane("rail", "cart", "y", name="guide")],
    )  # fmt: skip
    line = Mechanism(
        [
            *[tx("x"), [ty("y"), [tz("z"), [rz("theta"), [ty(-1.0, mass=1.0)], tx(0.0, name="cart", mass=2.0)]]]],
            tz(0.0, name="rail"),
        ],
        [Gravity((1.0, -G, 0.0)), PointOnLine("rail", "cart", "x", name="guide")],
    )  # fmt: skip
    runs = []
    for m in (sliding, guided, line):
        vi = MidpointVI(m)
        start = vi.start(m.configuration({"theta": 1.0}), m.configuration({"x": 0.3}))
        runs.append(complete(vi.simulate(start, times(2.0, 400))))
    for run in runs[1:]:
        for name in ("x", "theta"):
            assert np.abs(run[name] - runs[0][name]).max() < 1e-10
